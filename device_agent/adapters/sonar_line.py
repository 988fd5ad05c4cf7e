"""What the rangefinder's microcontroller says, line by line (docs/hardware.md describes it for whoever builds one).

``$U1,<ms>,<kind>,<mm>*<crc>`` and a line feed: the microcontroller's own milliseconds, what was heard, how far away, a
checksum. Whatever is not such a line, whole and with the right checksum, is left out.
"""

from __future__ import annotations

import binascii
import enum
import re
from dataclasses import dataclass

MAX_LINE_BYTES = 40
"""No line is longer; more without an end is noise."""
_LINE = re.compile(rb"\$(U1,(\d{1,10}),([ENF]),(\d{1,5}))\*([0-9A-F]{4})")


class SonarKind(enum.Enum):
    """What came of one ping."""

    ECHO = "E"
    NO_ECHO = "N"
    FAULT = "F"
    """The rangefinder does not answer the microcontroller."""


@dataclass(frozen=True, slots=True)
class SonarLine:
    """One line."""

    sensor_ms: int
    """When the ping was sent, on the microcontroller's clock, which begins anew at 2³²."""
    kind: SonarKind
    distance_mm: int
    """How far away the nearest echo came from; 0 unless the kind is ECHO."""


def checksum(body: bytes) -> int:
    """Return the CRC-16/CCITT-FALSE of what stands between ``$`` and ``*``: polynomial 1021, initial value FFFF."""
    return binascii.crc_hqx(body, 0xFFFF)


def encoded(line: SonarLine) -> bytes:
    """Return a line as it is sent."""
    body = f"U1,{line.sensor_ms},{line.kind.value},{line.distance_mm}".encode("ascii")
    return b"$%b*%04X\n" % (body, checksum(body))


def decoded(text: bytes) -> SonarLine | None:
    """Return what a line without its line feed says; None where it is damaged, or no such line."""
    match = _LINE.fullmatch(text.rstrip(b"\r"))
    if match is None or int(match[5], 16) != checksum(match[1]):
        return None
    kind = SonarKind(match[3].decode("ascii"))
    sensor_ms, distance_mm = int(match[2]), int(match[4])
    if sensor_ms >= 2**32 or (distance_mm > 0) != (kind is SonarKind.ECHO):
        return None
    return SonarLine(sensor_ms, kind, distance_mm)


class LineParser:
    """Cuts a stream of bytes into lines, whatever comes; it remembers no more than one line."""

    def __init__(self) -> None:
        self._begun = b""

    @property
    def waiting_bytes(self) -> int:
        """How much is remembered of the line that has begun; never more than ``MAX_LINE_BYTES``."""
        return len(self._begun)

    def feed(self, data: bytes) -> list[SonarLine]:
        """Take bytes as they arrive; return the good lines that end in them."""
        *ended, begun = (self._begun + data).split(b"\n")
        self._begun = begun[-MAX_LINE_BYTES:]
        # Noise may come right before a line; the line itself begins at its last "$".
        found = (decoded(text[text.rfind(b"$") :]) for text in ended)
        return [line for line in found if line is not None]

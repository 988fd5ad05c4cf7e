"""A file of a device's messages in the order in which they came: appended to, checked, and readable after a crash.

::

    VBRLOG1\\n                                  8 bytes
    length  checksum  payload                  once a message; numbers are unsigned, 32 bits, little-endian

The payload is msgpack: arrival on the console's clock, the offset of the device's clock (both in seconds), and the
message as it was on the wire. The checksum is its CRC-32. A crash, or a disk that is full, leaves at most one record
that is torn, at the end: a reader ends before it. Anything else that does not fit is an error.
"""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import BinaryIO

import msgspec

from navcore.errors import InputError, WireError
from navcore.misfit import words_of
from navcore.wire import MAX_MESSAGE_BYTES, DeviceMessage, decode_from_device

MAGIC = b"VBRLOG1\n"
MAX_LOG_BYTES = 64 << 20
"""A log is no larger: what comes after that is left out, and the writer says so."""
_HEAD = struct.Struct("<II")
_MAX_PAYLOAD_BYTES = MAX_MESSAGE_BYTES + 64


class MessageLogError(InputError):
    """A message log is damaged, or is none."""


@dataclass(frozen=True, slots=True)
class WireRecord:
    """A message as it came."""

    arrival_s: float
    """On the console's steady clock."""
    offset_s: float
    """Device clock minus console clock, as it was known then."""
    data: bytes
    """The message on the wire."""


@dataclass(frozen=True, slots=True)
class TimedMessage:
    """A message that was read back."""

    arrival_s: float
    """On the console's steady clock."""
    offset_s: float
    """Device clock minus console clock, as it was known then."""
    message: DeviceMessage


class MessageLogWriter:
    """Writes a new log. Not thread-safe."""

    def __init__(self, path: Path, max_bytes: int = MAX_LOG_BYTES) -> None:
        """Make the file. Raises OSError, also where there is one already."""
        self._out: BinaryIO = path.open("xb", buffering=0)
        self._max_bytes = max_bytes
        self.size_bytes = self._out.write(MAGIC)
        self.message_count = 0
        self.is_full = False
        """Something was left out, for the log would have become too large."""

    def append(self, records: Iterable[WireRecord]) -> None:
        """Add messages; what is written survives the end of this process. Raises OSError."""
        pieces = []
        for record in records:
            piece = _encoded(record)
            self.is_full = self.is_full or self.size_bytes + len(piece) > self._max_bytes
            if self.is_full:
                break
            pieces.append(piece)
            self.size_bytes += len(piece)
        rest = memoryview(b"".join(pieces))
        while rest:
            rest = rest[self._out.write(rest) :]
        self.message_count += len(pieces)

    def close(self) -> None:
        """End the log; afterwards it survives a power cut."""
        if not self._out.closed:
            os.fsync(self._out.fileno())
            self._out.close()

    def __enter__(self) -> MessageLogWriter:
        """Return the writer."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """End the log."""
        self.close()


def read_messages(path: Path) -> Iterator[TimedMessage]:
    """Read a log, message by message; a torn end is left out. Raises MessageLogError or WireError (another version)."""
    for number, payload in enumerate(_payloads(path), 1):
        try:
            arrival_s, offset_s, data = msgspec.msgpack.decode(payload, type=tuple[float, float, bytes])
        except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
            raise MessageLogError(
                f"Record {number} of {path.name} is no message ({words_of(error)}): it cannot be shown."
            ) from error
        try:
            message = decode_from_device(data)
        except WireError as error:
            raise WireError(
                f"Message {number} of {path.name} cannot be read ({error}): it was kept by another version."
            ) from error
        yield TimedMessage(arrival_s, offset_s, message)


def _encoded(record: WireRecord) -> bytes:
    payload = msgspec.msgpack.encode((record.arrival_s, record.offset_s, record.data))
    return _HEAD.pack(len(payload), zlib.crc32(payload)) + payload


def _payloads(path: Path) -> Iterator[bytes]:
    try:
        with path.open("rb") as file:
            size_bytes = os.fstat(file.fileno()).st_size
            begin = file.read(len(MAGIC))
            if begin != MAGIC:
                if size_bytes < len(MAGIC) and MAGIC.startswith(begin):
                    return
                raise MessageLogError(f"{path.name} is no log of messages: it begins otherwise.")
            yield from _records(file, size_bytes, path.name)
    except OSError as error:
        raise MessageLogError(
            f"{path.name} cannot be read ({error.strerror}): see whether it is still there."
        ) from error


def _records(file: BinaryIO, size_bytes: int, name: str) -> Iterator[bytes]:
    while True:
        at = file.tell()
        head = file.read(_HEAD.size)
        if len(head) < _HEAD.size:
            return
        length, checksum = _HEAD.unpack(head)
        end = at + _HEAD.size + length
        payload = file.read(length) if 0 < length <= _MAX_PAYLOAD_BYTES else b""
        if payload and len(payload) == length and zlib.crc32(payload) == checksum:
            yield payload
        elif end >= size_bytes or (length == 0 and _is_empty(file, at)):
            # Whoever wrote it was killed in the middle, or the power went before the disk had it all.
            return
        else:
            raise MessageLogError(f"{name} is damaged at byte {at}: what comes after it cannot be shown.")


def _is_empty(file: BinaryIO, at: int) -> bool:
    file.seek(at)
    while piece := file.read(1 << 20):
        if piece.count(0) != len(piece):
            return False
    return True

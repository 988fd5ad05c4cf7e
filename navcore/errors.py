"""Every error the product raises on purpose.

VbrError
├── InputError            a file, a folder, a message or a parameter is not what it should be
│   ├── RecordingError    a recording cannot be read
│   ├── SiteError         a site folder is missing, damaged, or newer than this program
│   ├── SettingError      a setting has no such name, or its value is out of range
│   └── WireError         a message between device and console cannot be read
│       └── VersionError  device and console speak different versions of the protocol
├── PlanningError         there is no way, and the text says why
├── MappingError          no map could be built from what was recorded
├── SensorError           a sensor delivers nothing, or nothing fresh
└── MissingPackageError   an optional package is needed and the text says which extra brings it

The text of each is one sentence for the person at the keyboard: what is wrong, and what to do. Whatever of a file or a
message stands in it, it can be read: it is cut to a length, and what steers a terminal is written out.
"""

from __future__ import annotations

import re

LONGEST_LINE = 1000
_END_LENGTH = 300
"""What to do stands at the end of a sentence."""
_STEERING = re.compile(r"[\x00-\x09\x0b-\x1f\x7f-\x9f\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff]")
"""Control characters, line and text directions, and halves of characters, which no file can be written with."""


class VbrError(Exception):
    """Base of every error raised on purpose; its text is written for the user."""

    def __init__(self, *arguments: object) -> None:
        super().__init__(*(_readable(each) if isinstance(each, str) else each for each in arguments))


def _readable(text: str) -> str:
    plain = _STEERING.sub(lambda found: ascii(found[0])[1:-1], text)
    return "\n".join(map(_shortened, plain.split("\n"))) if len(plain) > LONGEST_LINE else plain


def _shortened(line: str) -> str:
    if len(line) <= LONGEST_LINE:
        return line
    return f"{line[: LONGEST_LINE - _END_LENGTH - 3]} … {line[-_END_LENGTH:]}"


class InputError(VbrError):
    """Something that came from outside is not usable."""


class RecordingError(InputError):
    """A recording (TUM RGB-D layout) cannot be read."""


class SiteError(InputError):
    """A site folder or package is missing, damaged, or of a newer format."""


class SettingError(InputError):
    """A setting is unknown, out of its range, or out of order with another one; ``keys`` are those that it is about."""

    def __init__(self, text: str, *, keys: tuple[str, ...] = ()) -> None:
        super().__init__(text)
        self.keys = keys


class WireError(InputError):
    """A message cannot be decoded."""


class VersionError(WireError):
    """Device and console speak different versions of the protocol; the text says which is to be updated."""


class PlanningError(VbrError):
    """No route exists; the text names why.

    The text is for whoever looks after the map. Whoever walks hears ``why``, a key of the sentences that begin with
    ``no_way_``, with ``fields`` filled in.
    """

    def __init__(self, text: str, why: str, **fields: str) -> None:
        super().__init__(text)
        self.why, self.fields = why, fields


class MappingError(VbrError):
    """A map could not be built from the recording."""


class SensorError(VbrError):
    """A sensor has nothing fresh to give."""


class MissingPackageError(VbrError):
    """An optional package is needed; the text names the extra that brings it."""

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

The text of each is one sentence for the person at the keyboard: what is wrong, and what to do.
"""

from __future__ import annotations


class VbrError(Exception):
    """Base of every error raised on purpose; its text is written for the user."""


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
    """No route exists; the text names why."""


class MappingError(VbrError):
    """A map could not be built from the recording."""


class SensorError(VbrError):
    """A sensor has nothing fresh to give."""


class MissingPackageError(VbrError):
    """An optional package is needed; the text names the extra that brings it."""

"""How a recording goes to the console's machine over HTTP: what both ends say to each other. See link.md.

The device offers a recording (POST :data:`OFFERS_PATH`), and is told from which byte on it is missing; it then puts
piece after piece (PUT :func:`piece_path`), and is told the same after each. So it goes on after any interruption of
either side, and what has arrived is not sent again.
"""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec

from navcore.wire import Count, ShortText

OFFERS_PATH = "/api/device/recordings"
PIECE_BYTES = 128 << 10
"""What is sent at a time: little enough that nothing urgent waits long behind it."""
MAX_RECORDING_BYTES = 4 << 30
"""More than an hour of a map walk."""

RecordingKind = Literal["recording", "walk"]
"""A folder in the TUM RGB-D layout as one archive, of which a map can be built; or a file that the loop recorded."""


class RecordingOffer(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A recording that is to be sent."""

    kind: RecordingKind
    name: ShortText
    """As people call it; it names no path."""
    size_bytes: Count
    sha256: Annotated[str, msgspec.Meta(pattern=r"^[0-9a-f]{64}\Z")]
    """Of all of it; it also names it, so that sending can go on later."""
    date: ShortText = ""
    """Day on which it was recorded, where that is known."""


class RecordingHeld(msgspec.Struct, frozen=True):
    """What the console has of a recording."""

    next_byte: Count
    """From here on it is missing."""
    complete: bool
    """All of it is there, its checksum fits, and it is kept."""


def piece_path(sha256: str, offset: int) -> str:
    """Return where the piece of a recording that begins at this byte is put."""
    return f"{OFFERS_PATH}/{sha256}?offset={offset}"

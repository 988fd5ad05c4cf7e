"""How large the picture in a JPEG is, read from its header: before anybody makes room for its pixels.

A few bytes may declare a picture of gigabytes; a decoder makes room for it first, and finds out afterwards that most of
it is missing. ITU-T T.81, annex B: segments ``FF marker length`` until the frame header (SOF) tells height and width.
"""

from __future__ import annotations

import struct

from navcore.errors import WireError

MAX_PICTURE_PX = 1 << 20
"""No picture that a device sends has more pixels: width times height."""
_BEGIN = b"\xff\xd8"
_FRAME_HEADERS = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
"""SOF0 to SOF15; the three left out are tables and reserved."""
_ALONE = frozenset({0x01, *range(0xD0, 0xD8)})
"""Markers without a length: TEM and RST0 to RST7."""
_FRAME = struct.Struct(">HBHH")
"""Length, bits a sample, height, width."""


def jpeg_size_px(data: bytes) -> tuple[int, int] | None:
    """Return (width, height) as the header declares them; None where it is no JPEG, or ends before it says so."""
    if not data.startswith(_BEGIN):
        return None
    at = len(_BEGIN)
    while at + 2 + _FRAME.size <= len(data) and data[at] == 0xFF:
        marker = data[at + 1]
        if marker in _FRAME_HEADERS:
            _, _, height_px, width_px = _FRAME.unpack_from(data, at + 2)
            return width_px, height_px
        if marker == 0xFF:
            # Any number of these may fill the room before a marker.
            at += 1
        elif marker in _ALONE:
            at += 2
        else:
            at += 2 + int.from_bytes(data[at + 2 : at + 4], "big")
    return None


def refuse_picture(jpeg: bytes) -> None:
    """Raise WireError for what is no JPEG, or declares more pixels than a device's picture has."""
    size_px = jpeg_size_px(jpeg)
    if size_px is None or 0 in size_px:
        raise WireError("A picture is no JPEG: update the device.")
    if size_px[0] * size_px[1] > MAX_PICTURE_PX:
        raise WireError(f"A picture of {size_px[0]} × {size_px[1]} pixels is larger than any device sends: update it.")

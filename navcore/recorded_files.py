"""The files of a recording, read with care: numbers, tables of values, and images that must be whole."""

from __future__ import annotations

import math
import struct
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from navcore.errors import RecordingError
from navcore.jpeg_size import jpeg_size_px

_IMAGE_ENDS = ((b"\xff\xd8", b"\xff\xd9"), (b"\x89PNG", b"IEND"))
"""How a whole JPEG or PNG file begins, and what stands at its end."""


MAX_PICTURE_BYTES = 64 << 20
MAX_PIXEL_COUNT = 1 << 25
"""A picture of 8K has fewer. Looked at before a picture is decoded: a few bytes can claim to be gigabytes."""
_PNG_SIZE = struct.Struct(">8x4x4sII")


def read_image(path: Path, how: int) -> NDArray[Any] | None:
    """Return the image, or None where there is none or a part is missing (a decoder would fill it with grey)."""
    try:
        data = path.read_bytes() if path.stat().st_size <= MAX_PICTURE_BYTES else b""
        is_whole = any(data.startswith(head) and tail in data[-64:] for head, tail in _IMAGE_ENDS)
        if not is_whole or not 0 < _pixel_count(data) <= MAX_PIXEL_COUNT:
            return None
        return cv2.imdecode(np.frombuffer(data, np.uint8), how)
    except (OSError, struct.error, cv2.error):
        return None


def _pixel_count(data: bytes) -> int:
    """Return what a picture says of its size; 0 of none. Raises struct.error where a PNG ends before that."""
    if data.startswith(b"\x89PNG"):
        kind, width_px, height_px = _PNG_SIZE.unpack_from(data)
        return int(width_px * height_px) if kind == b"IHDR" else 0
    width_px, height_px = jpeg_size_px(data) or (0, 0)
    return width_px * height_px


def is_inside(file: Path, folder: Path) -> bool:
    """Tell whether a file lies below a folder, whatever links there are; a loop of links leads nowhere."""
    try:
        return file.resolve().is_relative_to(folder.resolve())
    except (OSError, RuntimeError):
        return False


def read_values(path: Path, need: str) -> dict[str, float]:
    """Read lines of ``name value``; ``need`` says what is missing where there is no such file."""
    values: dict[str, float] = {}
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise RecordingError(f"{path} cannot be read: {need}.") from error
    for number, line in enumerate(lines, 1):
        words = line.split("#", 1)[0].replace("=", " ").replace(":", " ").split()
        if not words:
            continue
        if len(words) != 2 or not is_number(words[1]):
            raise RecordingError(f"{path}, line {number}: expected a name and a number, found {line.strip()!r}.")
        values[words[0]] = float(words[1])
    return values


def is_number(word: str) -> bool:
    """Tell whether a word is a finite number."""
    try:
        return math.isfinite(float(word))
    except ValueError:
        return False

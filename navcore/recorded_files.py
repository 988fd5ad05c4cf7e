"""The files of a recording, read with care: numbers, tables of values, and images that must be whole."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from navcore.errors import RecordingError

_IMAGE_ENDS = ((b"\xff\xd8", b"\xff\xd9"), (b"\x89PNG", b"IEND"))
"""How a whole JPEG or PNG file begins, and what stands at its end."""


def read_image(path: Path, how: int) -> NDArray[Any] | None:
    """Return the image, or None where there is none or a part is missing (a decoder would fill it with grey)."""
    try:
        data = path.read_bytes()
        is_whole = any(data.startswith(head) and tail in data[-64:] for head, tail in _IMAGE_ENDS)
        return cv2.imdecode(np.frombuffer(data, np.uint8), how) if is_whole else None
    except (OSError, cv2.error):
        return None


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

"""What the files of a point cloud have in common: a table of named numbers, a row for each point."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

MAX_POINTS = 50_000_000
PIECE_ROWS = 1 << 16
"""So many points of a file are made at a time."""
_PIECE_BYTES = 1 << 20
_END_OF_WORD = re.compile(rb"\s|\Z")
MAX_COORDINATE_M = 100_000.0
_COLOUR_NAMES = (("red", "green", "blue"), ("diffuse_red", "diffuse_green", "diffuse_blue"), ("r", "g", "b"))


class Columns(NamedTuple):
    """The columns that matter here."""

    x: NDArray[Any]
    """(n,)."""
    y: NDArray[Any]
    z: NDArray[Any]
    rgb: NDArray[np.uint8] | None
    """(n, 3); None in a file without colours."""


def table_from_text(text: bytes, count: int, width: int) -> NDArray[np.float64]:
    """Return the first ``count`` rows (count, width) of a table of numbers. Raises ValueError."""
    pieces: list[NDArray[np.float64]] = []
    missing, begin = count * width, 0
    while missing > 0 and begin < len(text):
        # A word as an object of its own takes twenty times what it takes in the file: only some are there at a time.
        end = _END_OF_WORD.search(text, min(len(text), begin + _PIECE_BYTES)).start()  # type: ignore[union-attr]
        piece = np.array(text[begin:end].split(None, missing)[:missing], dtype=np.float64)
        pieces.append(piece)
        missing, begin = missing - len(piece), end
    if missing > 0:
        raise ValueError(f"its header promises {count} points, but fewer follow")
    return np.concatenate([*pieces, np.zeros(0)]).reshape(count, width)


def rows_from_bytes(data: bytes, offset: int, count: int, row: np.dtype[Any]) -> NDArray[Any]:
    """Return rows (count,) of a structured type. Raises ValueError where the bytes do not go that far."""
    if count * row.itemsize > len(data) - offset:
        raise ValueError(f"its header promises {count} points, but fewer follow")
    return np.frombuffer(data, row, count, offset)


def colours_of(columns: Mapping[str, NDArray[Any]]) -> NDArray[np.uint8] | None:
    """Return three columns of 8 bits (n, 3) from whatever the file calls them and however it scales them."""
    for names in _COLOUR_NAMES:
        if all(name in columns for name in names):
            return np.stack([_as_bytes(columns[name]) for name in names], axis=1)
    return None


def _as_bytes(values: NDArray[Any]) -> NDArray[np.uint8]:
    if values.dtype == np.uint8:
        return values
    if values.dtype == np.uint16:
        return (values >> 8).astype(np.uint8)
    numbers = np.nan_to_num(values.astype(np.float64))
    # Numbers without a type of their own: shares of full brightness, unless one is too large for that.
    scale = 255.0 if values.dtype.kind == "f" and numbers.max(initial=0.0) <= 1.0 else 1.0
    return np.clip(np.round(numbers * scale), 0, 255).astype(np.uint8)


def colours_from_bits(bits: NDArray[np.uint32]) -> NDArray[np.uint8]:
    """Return (n, 3) of colours packed as 0xRRGGBB (n,)."""
    return np.stack([(bits >> shift) & 0xFF for shift in (16, 8, 0)], axis=1).astype(np.uint8)

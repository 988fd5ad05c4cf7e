"""PCD, the point cloud format of PCL and ROS: a header of fields, then text, binary, or compressed columns.

See https://pointclouds.org/documentation/tutorials/pcd_file_format.html. Colours are packed into one field ``rgb``.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from navcore.cloud_columns import (
    MAX_POINTS,
    PIECE_ROWS,
    Columns,
    colours_from_bits,
    colours_of,
    rows_from_bytes,
    table_from_text,
)
from navcore.lzf import unpack_lzf

MAX_HEADER_BYTES = 65_536
MAX_ROW_BYTES = 65_536
MAX_EXPANSION = 128
"""LZF makes no byte into more than 88."""
_KINDS = {"F": "f", "U": "u", "I": "i"}
_SIZES = {"F": (4, 8), "U": (1, 2, 4, 8), "I": (1, 2, 4, 8)}


@dataclass(frozen=True, slots=True)
class _Header:
    row: np.dtype[Any]
    """A row of the table; fields with several numbers have a shape."""
    count: int
    form: str
    """ascii, binary, or binary_compressed."""
    end: int
    """Where the header ends."""


def encoded(points_m: NDArray[np.float32], colours_rgb: NDArray[np.uint8]) -> Iterator[bytes]:
    """Return a binary file of points (n, 3) and colours (n, 3), piece by piece."""
    count = len(points_m)
    header = (
        "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS x y z rgb\nSIZE 4 4 4 4\nTYPE F F F F\n"
        f"COUNT 1 1 1 1\nWIDTH {count}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {count}\nDATA binary\n"
    )
    yield header.encode("ascii")
    for begin in range(0, count, PIECE_ROWS):
        points = points_m[begin : begin + PIECE_ROWS]
        wide = colours_rgb[begin : begin + PIECE_ROWS].astype(np.uint32)
        rows = np.empty((len(points), 4), "<u4")
        rows[:, :3] = np.ascontiguousarray(points, dtype="<f4").view("<u4")
        rows[:, 3] = (wide[:, 0] << 16) | (wide[:, 1] << 8) | wide[:, 2]
        yield rows.tobytes()


def decode(data: bytes) -> Columns:
    """Return the points of a file. Raises ValueError with what is wrong."""
    header = _header(data)
    names = list(header.row.names or ())
    if not {"x", "y", "z"} <= set(names):
        raise ValueError("its points have no x, y and z")
    if header.form == "ascii":
        columns = _from_text(data, header)
    elif header.form == "binary":
        rows = rows_from_bytes(data, header.end, header.count, header.row)
        columns = {name: rows[name].copy() for name in names}
    else:
        columns = _from_compressed(data, header)
    rgb = _packed_colours(columns)
    if any(columns[name].ndim != 1 for name in "xyz"):
        raise ValueError("its x, y or z is several numbers")
    return Columns(columns["x"], columns["y"], columns["z"], rgb if rgb is not None else colours_of(columns))


def _header(data: bytes) -> _Header:
    words: dict[str, list[str]] = {}
    offset = 0
    while "DATA" not in words:
        end = data.find(b"\n", offset, MAX_HEADER_BYTES)
        if end < 0:
            raise ValueError("it does not begin like a PCD file")
        line = data[offset:end].decode("ascii", "replace").split("#", 1)[0].split()
        offset = end + 1
        if line:
            words[line[0]] = line[1:]
    fields, kinds = words.get("FIELDS", []), words.get("TYPE", [])
    sizes = _numbers(words.get("SIZE", []))
    counts = _numbers(words.get("COUNT", ["1"] * len(fields)))
    form = " ".join(words["DATA"])
    if not fields or not len(fields) == len(kinds) == len(sizes) == len(counts):
        raise ValueError("its header does not say the type of each field")
    if form not in ("ascii", "binary", "binary_compressed"):
        raise ValueError(f"its points are stored as {form[:40]!r}")
    points = _numbers(words.get("POINTS", []))
    if not points:
        points = [int(np.prod(_numbers(words.get("WIDTH", ["0"]) + words.get("HEIGHT", ["1"])), dtype=object))]
    if points[0] > MAX_POINTS:
        raise ValueError(f"its header promises {points[0]} points, more than {MAX_POINTS}")
    return _Header(_row_type(fields, kinds, sizes, counts), points[0], form, offset)


def _numbers(words: list[str]) -> list[int]:
    if not all(word.isdecimal() and len(word) <= 12 for word in words):
        raise ValueError(f"its header says {' '.join(words)[:60]!r}, where whole numbers are expected")
    return [int(word) for word in words]


def _row_type(fields: list[str], kinds: list[str], sizes: list[int], counts: list[int]) -> np.dtype[Any]:
    row: list[tuple[str, str, tuple[int, ...]]] = []
    width = 0
    for i, (field, kind, size, count) in enumerate(zip(fields, kinds, sizes, counts, strict=True)):
        width += size * count
        if kind not in _KINDS or size not in _SIZES[kind] or not 1 <= count <= MAX_ROW_BYTES or width > MAX_ROW_BYTES:
            raise ValueError(f"its field {field[:40]!r} is of a type that does not exist")
        # PCL calls its padding "_", as often as it needs some.
        name = f"padding {i}" if field == "_" else field
        row.append((name, f"<{_KINDS[kind]}{size}", () if count == 1 else (count,)))
    if len({name for name, _, _ in row}) != len(row):
        raise ValueError("two of its fields have the same name")
    return np.dtype(row)


def _from_text(data: bytes, header: _Header) -> dict[str, NDArray[Any]]:
    names = list(header.row.names or ())
    forms = [header.row[name] for name in names]
    widths = [int(np.prod(form.shape, dtype=np.int64)) for form in forms]
    table = table_from_text(data[header.end :], header.count, sum(widths))
    starts = np.cumsum([0, *widths])[:-1]
    columns: dict[str, NDArray[Any]] = {}
    for name, form, start, width in zip(names, forms, starts.tolist(), widths, strict=True):
        column = table[:, start] if width == 1 else table[:, start : start + width]
        with np.errstate(invalid="ignore"):
            columns[name] = column.astype(form.base)
    return columns


def _from_compressed(data: bytes, header: _Header) -> dict[str, NDArray[Any]]:
    """Compressed files hold two sizes, then the columns one after the other, packed by LZF."""
    sizes = rows_from_bytes(data, header.end, 2, np.dtype("<u4")).tolist()
    fits = sizes[1] == header.count * header.row.itemsize and sizes[0] <= len(data) - header.end - 8
    if not fits or sizes[1] > MAX_EXPANSION * sizes[0]:
        raise ValueError(f"its header promises {header.count} points, but others follow")
    packed = np.frombuffer(data, np.uint8, sizes[0], header.end + 8).copy()
    plain = np.zeros(sizes[1], np.uint8)
    if unpack_lzf(packed, plain) != sizes[1]:
        raise ValueError("its compressed points are damaged")
    columns: dict[str, NDArray[Any]] = {}
    offset = 0
    for name in header.row.names or ():
        form = header.row[name]
        length = header.count * form.itemsize
        columns[name] = plain[offset : offset + length].view(form.base).reshape(header.count, *form.shape)
        offset += length
    return columns


def _packed_colours(columns: dict[str, NDArray[Any]]) -> NDArray[np.uint8] | None:
    """Return the colours of a field rgb or rgba: 0xRRGGBB, whether the header calls it a float or a number."""
    packed = next((columns[name] for name in ("rgb", "rgba") if name in columns), None)
    if packed is None or packed.ndim != 1 or packed.dtype.itemsize != 4:
        return None
    return colours_from_bits(np.ascontiguousarray(packed).view(np.uint32))

"""PLY, the Stanford polygon format: a header of elements and their properties, then text or binary rows.

See http://paulbourke.net/dataformats/ply; CloudCompare, MeshLab, Open3D and Blender read and write it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from navcore.cloud_columns import MAX_POINTS, PIECE_ROWS, Columns, colours_of, rows_from_bytes, table_from_text

MAX_HEADER_BYTES = 65_536
_TYPES = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4",
    "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4",
    "float32": "f4", "float64": "f8",
}  # fmt: skip
_ORDER = {"binary_little_endian": "<", "binary_big_endian": ">", "ascii": "="}


@dataclass(slots=True)
class _Element:
    name: str
    count: int
    properties: list[tuple[str, str]] = field(default_factory=list)
    """Name and NumPy type of each."""
    has_lists: bool = False


def encoded(points_m: NDArray[np.float32], colours_rgb: NDArray[np.uint8]) -> Iterator[bytes]:
    """Return a binary little-endian file of points (n, 3) and colours (n, 3), piece by piece."""
    row = np.dtype([(name, "<f4") for name in "xyz"] + [(name, "u1") for name in ("red", "green", "blue")])
    properties = [f"property float {name}" for name in "xyz"]
    properties += [f"property uchar {name}" for name in ("red", "green", "blue")]
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(points_m)}", *properties, "end_header"]
    yield ("\n".join(header) + "\n").encode("ascii")
    for begin in range(0, len(points_m), PIECE_ROWS):
        points, colours = points_m[begin : begin + PIECE_ROWS], colours_rgb[begin : begin + PIECE_ROWS]
        rows = np.empty(len(points), row)
        for axis, name in enumerate("xyz"):
            rows[name] = points[:, axis]
        for channel, name in enumerate(("red", "green", "blue")):
            rows[name] = colours[:, channel]
        yield rows.tobytes()


def decode(data: bytes) -> Columns:
    """Return the vertices of a file. Raises ValueError with what is wrong."""
    order, elements, offset = _header(data)
    before = 0
    for element in elements:
        if element.name == "vertex":
            return _vertices(data, order, element, offset, before)
        if element.has_lists and order != "=":
            raise ValueError("its faces stand before its points")
        before += element.count
        if order != "=":
            offset += element.count * _row_type(element, order).itemsize
    raise ValueError("it has no vertices")


def _header(data: bytes) -> tuple[str, list[_Element], int]:
    end = data.find(b"end_header", 0, MAX_HEADER_BYTES)
    line_end = data.find(b"\n", end) if end >= 0 else -1
    if not data.startswith(b"ply") or line_end < 0:
        raise ValueError("it does not begin like a PLY file")
    order = ""
    elements: list[_Element] = []
    for line in data[:end].decode("ascii", "replace").splitlines()[1:]:
        match line.split():
            case [] | ["comment" | "obj_info", *_]:
                continue
            case ["format", form, _] if form in _ORDER:
                order = _ORDER[form]
            case ["element", name, count] if count.isdecimal() and int(count[:12]) <= MAX_POINTS:
                elements.append(_Element(name, int(count)))
            case ["property", "list", _, _, _] if elements:
                elements[-1].has_lists = True
            case ["property", kind, name] if elements and kind in _TYPES:
                elements[-1].properties.append((name, _TYPES[kind]))
            case _:
                raise ValueError(f"its header says {line.strip()[:60]!r}")
    if not order:
        raise ValueError("its header does not say whether it is text or binary")
    return order, elements, line_end + 1


def _row_type(element: _Element, order: str) -> np.dtype[Any]:
    return np.dtype([(name, order + kind) for name, kind in element.properties])


def _vertices(data: bytes, order: str, element: _Element, offset: int, before: int) -> Columns:
    names = [name for name, _ in element.properties]
    if element.has_lists or not {"x", "y", "z"} <= set(names) or len(set(names)) != len(names):
        raise ValueError("its vertices have no x, y and z of their own")
    columns: dict[str, NDArray[Any]]
    if order == "=":
        # Elements before the vertices take a line each.
        text = data[offset:].split(b"\n", before)[-1]
        table = table_from_text(text, element.count, len(names))
        with np.errstate(invalid="ignore"):
            columns = {name: table[:, i].astype(kind) for i, (name, kind) in enumerate(element.properties)}
    else:
        rows = rows_from_bytes(data, offset, element.count, _row_type(element, order))
        columns = {name: rows[name].astype(rows[name].dtype.newbyteorder("=")) for name in names}
    return Columns(columns["x"], columns["y"], columns["z"], colours_of(columns))

"""Coloured point clouds as files that other programs read and write: PLY (Stanford) and PCD (PCL, ROS).

Written are the forms that every reader knows: little-endian binary, float coordinates, 8-bit colours. Read are ASCII
and binary ones, and PCD's compressed one; what else a file holds (normals, intensities, faces) is passed over. A header
is believed only as far as the bytes behind it go. Open3D has no place on the device, so this is done here.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from navcore import pcd_files, ply_files
from navcore.cloud_columns import MAX_COORDINATE_M, MAX_POINTS, Columns
from navcore.errors import InputError

MAX_FILE_BYTES = 1 << 31
GREY = 160
"""Brightness of points of a file without colours."""
_FORMS = ".ply or .pcd"


class CloudPoints(NamedTuple):
    """A coloured cloud, metres."""

    points_m: NDArray[np.float32]
    """(n, 3)."""
    colours_rgb: NDArray[np.uint8]
    """(n, 3)."""


def refuse_unknown_form(path: Path) -> None:
    """Raise InputError where a file's name says neither PLY nor PCD."""
    if path.suffix.lower() not in (".ply", ".pcd"):
        raise InputError(f"{path} is no kind of cloud file that is known here: give a name that ends in {_FORMS}.")


def write_cloud(path: Path, points_m: NDArray[np.float32], colours_rgb: NDArray[np.uint8]) -> None:
    """Write a cloud, points (n, 3) and colours (n, 3); the same cloud gives the same bytes.

    The name's ending says which form. Raises InputError for another ending, or where the file cannot be written.
    """
    refuse_unknown_form(path)
    encoded = ply_files.encoded if path.suffix.lower() == ".ply" else pcd_files.encoded
    try:
        with path.open("wb") as out:
            out.writelines(encoded(points_m, colours_rgb))
    except OSError as error:
        raise InputError(f"{path} cannot be written ({error.strerror}): name another file.") from error


def read_cloud(path: Path) -> CloudPoints:
    """Read a cloud; points that are no numbers are left out. Raises InputError, saying what is wrong with the file."""
    refuse_unknown_form(path)
    try:
        if path.stat().st_size > MAX_FILE_BYTES:
            raise InputError(f"{path} is larger than 2 GiB: thin the cloud first.")
        data = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error.strerror}): name a file that is there.") from error
    decode = ply_files.decode if path.suffix.lower() == ".ply" else pcd_files.decode
    try:
        return _as_points(decode(data))
    except (ValueError, OverflowError, MemoryError) as error:
        raise InputError(f"{path} is damaged or of a form that is not known here: {error}.") from error


def _as_points(columns: Columns) -> CloudPoints:
    count = len(columns.x)
    if count > MAX_POINTS:
        raise ValueError(f"it holds {count} points, more than {MAX_POINTS}")
    points = np.stack([columns.x, columns.y, columns.z], axis=1).astype(np.float64)
    usable = np.isfinite(points).all(axis=1)
    if not usable.any():
        raise ValueError("it holds no points")
    if np.abs(points[usable]).max() > MAX_COORDINATE_M:
        raise ValueError("it has points farther than 100 km from its origin; its unit must be metres")
    colours = np.full((count, 3), GREY, np.uint8)
    if columns.rgb is not None:
        colours = columns.rgb
    return CloudPoints(points[usable].astype(np.float32), np.ascontiguousarray(colours[usable]))

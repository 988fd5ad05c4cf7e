"""Fewer points of a cloud, and cleaner ones: evenly thinned, and without those that lie by themselves.

Every function returns which points stay, ascending, so that colours and what else belongs to each point can follow::

    kept = shown_points(points_m, 1_000_000)
    points_m, colours_rgb, weights = points_m[kept], colours_rgb[kept], weights[kept]

The same cloud gives the same points. What is not finite never stays.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from console.map_geometry.open3d_library import point_cloud
from navcore.errors import InputError

IndexArray = NDArray[np.int64]

NEIGHBOURS_COUNT = 16
"""A point is judged by its distance to so many others …"""
OUTLIER_DEVIATIONS = 3.0
"""… and is an outlier where that exceeds the cloud's mean by so many standard deviations (R. Rusu et al., "Towards 3D
point cloud based object maps for household environments", Robotics and Autonomous Systems 56, 2008)."""
JUDGED_COUNT = 150_000
"""Of a larger cloud one point in each of so many voxels is judged for all in it: what is alone is alone there too."""
_BITS = 21
"""Of a voxel's index along each axis, in one integer."""
_ENOUGH_SHARE = 0.9
"""So many of the points that are allowed is near enough to all of them."""
_MAX_ROUNDS = 12
_AREA_CELL_M = 0.25


def shown_points(points_m: NDArray[Any], max_count: int) -> IndexArray:
    """Return the points (n, 3) that a picture of the cloud shows: at most ``max_count``, evenly in space, no outliers.

    Raises InputError where ``max_count`` is below 1.
    """
    thinned = evenly_thinned(points_m, max_count)
    return thinned[without_outliers(points_m[thinned])]


def finite_points(points_m: NDArray[Any]) -> IndexArray:
    """Return which points (n, 3) have three finite coordinates."""
    return np.flatnonzero(np.isfinite(points_m).all(axis=1))


def one_per_voxel(points_m: NDArray[Any], voxel_m: float) -> IndexArray:
    """Return the first point of each voxel of this size that points (n, 3) lie in. Raises InputError for no size."""
    if not (math.isfinite(voxel_m) and voxel_m > 0.0):
        raise InputError(f"A voxel cannot be {voxel_m:g} m wide: give a positive number.")
    finite = finite_points(points_m)
    keys = _voxel_keys(_from_corner(points_m[finite]), voxel_m)
    return finite[np.sort(np.unique(keys, return_index=True)[1])]


def evenly_thinned(points_m: NDArray[Any], max_count: int) -> IndexArray:
    """Return at most ``max_count`` of the points (n, 3), one in each of equally large voxels; all where they are few.

    The voxels are as small as the number allows. Raises InputError where it is below 1.
    """
    if max_count < 1:
        raise InputError(f"A cloud cannot be thinned to {max_count} points: give a number from 1.")
    finite = finite_points(points_m)
    if len(finite) <= max_count:
        return finite
    offsets_m = _from_corner(points_m[finite])
    keys = _voxel_keys(offsets_m, _fitting_voxel_m(offsets_m, max_count))
    return finite[np.sort(np.unique(keys, return_index=True)[1])]


def without_outliers(
    points_m: NDArray[Any], neighbours_count: int = NEIGHBOURS_COUNT, deviations: float = OUTLIER_DEVIATIONS
) -> IndexArray:
    """Return the points (n, 3) that are not much farther from their neighbours than this cloud's usually are."""
    finite = finite_points(points_m)
    if len(finite) <= neighbours_count:
        return finite
    judged, judge_of = _judges(_from_corner(points_m[finite]))
    _, kept = point_cloud(points_m[finite[judged]]).remove_statistical_outlier(neighbours_count, deviations)
    stays = np.zeros(len(judged), np.bool_)
    stays[np.asarray(kept, np.int64)] = True
    return finite[stays[judge_of]]


def _judges(offsets_m: NDArray[np.float32]) -> tuple[IndexArray, IndexArray]:
    """Return the points (k,) that stand for all, and for each point (n,) which of them stands for it."""
    if len(offsets_m) <= JUDGED_COUNT:
        return np.arange(len(offsets_m)), np.arange(len(offsets_m))
    keys = _voxel_keys(offsets_m, _fitting_voxel_m(offsets_m, JUDGED_COUNT))
    _, first, inverse = np.unique(keys, return_index=True, return_inverse=True)
    return first, inverse


def _from_corner(points_m: NDArray[Any]) -> NDArray[np.float32]:
    """Return points as offsets from their lowest corner: small numbers, which 32 bits hold to a millimetre."""
    if not len(points_m):
        return np.zeros((0, 3), np.float32)
    return np.asarray(points_m - points_m.min(axis=0), np.float32)


def _voxel_keys(offsets_m: NDArray[np.float32], voxel_m: float) -> IndexArray:
    # Beyond 2 million voxels along an axis, far points share the last one: nothing overflows.
    cells: IndexArray = np.minimum(offsets_m * np.float32(1.0 / voxel_m), np.float32((1 << _BITS) - 1)).astype(np.int64)
    return (cells[:, 0] << (2 * _BITS)) | (cells[:, 1] << _BITS) | cells[:, 2]


def _fitting_voxel_m(offsets_m: NDArray[np.float32], max_count: int) -> float:
    """Return the size of voxels of which at most ``max_count``, and not many fewer, hold points.

    A cloud is surfaces: the number of voxels falls with the square of their size, more or less. The first guess is the
    size at which the surfaces that it covers would be filled, and what it gives corrects it.
    """
    surface_m2 = _occupied_count(offsets_m, _AREA_CELL_M) * _AREA_CELL_M**2
    voxel_m = max(math.sqrt(surface_m2 / max_count), 1e-6)
    too_small_m, fits_m = 0.0, math.inf
    for _ in range(_MAX_ROUNDS):
        count = _occupied_count(offsets_m, voxel_m)
        if count <= max_count:
            fits_m = min(fits_m, voxel_m)
            if count >= _ENOUGH_SHARE * max_count:
                break
        else:
            too_small_m = max(too_small_m, voxel_m)
        guess_m = voxel_m * math.sqrt(count / (0.95 * max_count))
        # A guess that leaves the bracket is no better than its middle.
        inside = too_small_m < guess_m < fits_m
        voxel_m = guess_m if inside else (too_small_m + fits_m) / 2 if math.isfinite(fits_m) else 2 * voxel_m
    while not math.isfinite(fits_m):
        voxel_m *= 2.0
        fits_m = voxel_m if _occupied_count(offsets_m, voxel_m) <= max_count else fits_m
    return fits_m


def _occupied_count(offsets_m: NDArray[np.float32], voxel_m: float) -> int:
    keys = np.sort(_voxel_keys(offsets_m, voxel_m))
    return 1 + int(np.count_nonzero(keys[1:] != keys[:-1]))

"""The walls of a cloud, as lines on the floor: upright planes, cut where there is nothing of them, as at doors."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from console.map_geometry.cloud_cleaning import one_per_voxel
from console.map_geometry.open3d_library import import_open3d, point_cloud
from navcore.geometry import FloatArray

MIN_HEIGHT_M = 1.2
"""A lower plane is the side of a table, a counter, a radiator."""
MIN_LENGTH_M = 0.5
MIN_GAP_M = 0.5
"""A gap that a person fits through ends a piece of wall."""
MAX_LEAN_RAD = math.radians(8.0)
_LOW_M, _HIGH_M = 0.3, 1.95
"""Above furniture's feet, and below the lintels of doors."""
_NEAR_M = 0.08
_VOXEL_M = 0.08
_BIN_M, _COLUMN_M = 0.1, 0.04
_MIN_VOXELS = 4
"""Of a bin along the wall, for stray points do not close a gap."""
_MIN_POINTS = 60


def wall_segments(points_m: NDArray[Any]) -> FloatArray:
    """Return the walls of a cloud (n, 3), levelled, floor about z = 0, as segments (m, 2, 2), longest first."""
    points = np.asarray(points_m[one_per_voxel(points_m, _VOXEL_M)], np.float64)
    points = points[(points[:, 2] > _LOW_M) & (points[:, 2] < _HIGH_M)]
    if len(points) < _MIN_POINTS:
        return np.zeros((0, 2, 2))
    columns = _columns(points)
    found = [piece for patch in _planar_patches(points) for piece in _pieces(patch, *columns)]
    found.sort(key=lambda piece: (-float(np.hypot(*(piece[1] - piece[0]))), *piece.ravel().tolist()))
    return np.array(found, np.float64).reshape(-1, 2, 2)


def _planar_patches(points_m: FloatArray) -> list[Any]:
    """Return planar patches as oriented boxes (A. Araújo, M. Oliveira, "A robust statistics approach for plane
    detection in unorganized point clouds", Pattern Recognition 100, 2020)."""
    geometry = import_open3d().geometry
    cloud = point_cloud(points_m)
    cloud.estimate_normals(geometry.KDTreeSearchParamHybrid(0.3, 20))
    return list(
        cloud.detect_planar_patches(
            normal_variance_threshold_deg=60, coplanarity_deg=75, outlier_ratio=0.75,
            min_plane_edge_length=MIN_LENGTH_M,
            min_num_points=_MIN_POINTS, search_param=geometry.KDTreeSearchParamKNN(20),
        )
    )  # fmt: skip


def _columns(points_m: FloatArray) -> tuple[FloatArray, NDArray[np.int64]]:
    """Return the columns (k, 2) that points (n, 3) stand in, and how many are in each (k,)."""
    cells, counts = np.unique(np.floor(points_m[:, :2] / _COLUMN_M).astype(np.int64), axis=0, return_counts=True)
    return np.asarray((cells + 0.5) * _COLUMN_M, np.float64), counts.astype(np.int64)


def _pieces(patch: Any, columns_m: FloatArray, counts: NDArray[np.int64]) -> list[FloatArray]:
    normal = np.asarray(patch.R)[:, 2]
    corners = np.asarray(patch.get_box_points())
    if abs(normal[2]) > math.sin(MAX_LEAN_RAD) or np.ptp(corners[:, 2]) < MIN_HEIGHT_M:
        return []
    across = normal[:2] / np.hypot(*normal[:2])
    along = np.array([-across[1], across[0]])
    centre = np.asarray(patch.center)[:2]
    reach = (corners[:, :2] - centre) @ along
    offsets = columns_m - centre
    places_m = offsets @ along
    on_it = (np.abs(offsets @ across) < _NEAR_M) & (places_m >= reach.min()) & (places_m <= reach.max())
    return [centre + along * np.array([[begin], [end]]) for begin, end in _filled(places_m[on_it], counts[on_it])]


def _filled(places_m: FloatArray, counts: NDArray[np.int64]) -> list[tuple[float, float]]:
    """Return the stretches of a line that are filled, from where its columns (n,) stand, with so many points each."""
    if not len(places_m):
        return []
    first = int(np.floor(places_m.min() / _BIN_M))
    in_bin = np.bincount(np.floor(places_m / _BIN_M).astype(np.int64) - first, counts)
    bins = np.flatnonzero(in_bin >= _MIN_VOXELS) + first
    if not len(bins):
        return []
    runs = np.split(bins, np.flatnonzero(np.diff(bins) > MIN_GAP_M / _BIN_M) + 1)
    stretches = [(float(run[0]) * _BIN_M, float(run[-1] + 1) * _BIN_M) for run in runs]
    return [(begin, end) for begin, end in stretches if end - begin >= MIN_LENGTH_M]

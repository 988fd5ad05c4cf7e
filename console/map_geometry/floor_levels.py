"""The floor of a cloud: planes that people walk on, of one height or several.

The map is level, z up, and its floor lies about z = 0. A plane at another height is floor where a path runs over it;
where none does, it may as well be a long table, or what lies beyond a railing.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from console.map_geometry.cloud_cleaning import evenly_thinned, one_per_voxel
from console.map_geometry.open3d_library import import_open3d, point_cloud
from console.map_geometry.path_samples import sampled
from navcore.geometry import FloatArray

LOWEST_M, HIGHEST_M = -3.0, 1.5
"""Floor is looked for between these heights: half a storey down or up."""
MAX_TILT_RAD = math.radians(6.0)
"""A ramp of 1:12 (ISO 21542) is 4.8°, and the map's own level is not perfect."""
MIN_AREA_M2 = 1.0
"""A smaller plane is a step, or noise."""
PATH_ON_LEVEL_M = 0.5
"""A plane is floor where at least so much of a path runs over it."""
NEAR_PLANE_M = 0.04
"""What is nearer to the plane than this lies on it: noise of depth cameras at the distances at which floor is seen."""
_MAIN_WITHIN_M = 0.3
"""The map was made level by its floor, which lies at z = 0 (navcore.slam.leveling)."""
_VOXEL_M = 0.1
_CELL_M = 0.1
_UPRIGHT_COS = math.cos(math.radians(20.0))
_MAX_LEVELS = 8
_MIN_POINTS = 100
_ROUNDS, _ROUND_POINTS = 300, 20_000
"""Planes are proposed by a part of the points, and confirmed by all of them."""
_NORMAL_RADIUS_M, _NORMAL_NEIGHBOURS = 0.3, 16


@dataclass(frozen=True, slots=True, eq=False)
class FloorLevel:
    """A plane z = a x + b y + c that people walk on."""

    coefficients: FloatArray
    """(3,): a, b, and c in metres."""
    points_m: FloatArray
    """Points (n, 3) of the thinned cloud that lie on it."""
    area_m2: float
    """How much of it has been seen."""

    def heights_m(self, points_m: NDArray[Any]) -> FloatArray:
        """Return how far points (n, 3) lie above it (n,)."""
        a, b, c = self.coefficients
        return np.asarray(points_m[:, 2] - a * points_m[:, 0] - b * points_m[:, 1] - c, np.float64)


def floor_levels(points_m: NDArray[Any], walked_m: Sequence[FloatArray]) -> tuple[FloorLevel, ...]:
    """Return the floor of a cloud (n, 3): its largest plane, and those that a walked line (k, 2) runs over.

    The same cloud gives the same planes, none perhaps; the largest comes first.
    """
    planes = sorted(_level_planes(_lying_points(points_m)), key=lambda plane: -plane.area_m2)
    near_zero = [plane for plane in planes if abs(float(np.median(plane.points_m[:, 2]))) < _MAIN_WITHIN_M]
    main = near_zero[:1]
    walked = [plane for plane in planes if plane not in main and _runs_over(plane, walked_m)]
    return tuple(main + walked)


def _lying_points(points_m: NDArray[Any]) -> FloatArray:
    """Return the points whose surroundings lie flat, at heights where floor may be, thinned evenly."""
    candidates = np.asarray(points_m[one_per_voxel(points_m, _VOXEL_M)], np.float64)
    candidates = candidates[(candidates[:, 2] > LOWEST_M) & (candidates[:, 2] < HIGHEST_M)]
    if len(candidates) < _MIN_POINTS:
        return np.zeros((0, 3))
    cloud = point_cloud(candidates)
    search = import_open3d().geometry.KDTreeSearchParamHybrid(_NORMAL_RADIUS_M, _NORMAL_NEIGHBOURS)
    cloud.estimate_normals(search)
    lying: FloatArray = candidates[np.abs(np.asarray(cloud.normals)[:, 2]) > _UPRIGHT_COS]
    return lying


def _level_planes(lying_m: FloatArray) -> list[FloorLevel]:
    planes: list[FloorLevel] = []
    left = lying_m
    for _ in range(_MAX_LEVELS):
        if len(left) < _MIN_POINTS:
            break
        import_open3d().utility.random.seed(0)
        # Certain to go all rounds: whether it may stop earlier would hang on which thread is faster.
        proposing = left[evenly_thinned(left, _ROUND_POINTS)]
        (a, b, c, d), _ = point_cloud(proposing).segment_plane(NEAR_PLANE_M, 3, _ROUNDS, 1.0)
        on_it = np.abs(left @ (a, b, c) + d) < NEAR_PLANE_M
        points, left = left[on_it], left[~on_it]
        area_m2 = len(_cells(points)) * _CELL_M**2
        if area_m2 < MIN_AREA_M2:
            break
        if abs(c) > math.cos(MAX_TILT_RAD) * math.sqrt(a * a + b * b + c * c):
            planes.append(FloorLevel(np.array([-a / c, -b / c, -d / c]), points, area_m2))
    return planes


def _cells(points_m: FloatArray) -> NDArray[np.int64]:
    return np.unique(np.floor(points_m[:, :2] / _CELL_M).astype(np.int64), axis=0)


def _runs_over(plane: FloorLevel, paths_m: Sequence[FloatArray]) -> bool:
    """Whether enough of the paths lies within a cell of where the plane has been seen."""
    cells = _cells(plane.points_m)
    low = cells.min(axis=0) - 1
    width, height = (cells.max(axis=0) - low + 2).tolist()
    seen = np.zeros((height, width), np.uint8)
    seen[cells[:, 1] - low[1], cells[:, 0] - low[0]] = 1
    seen = np.asarray(cv2.dilate(seen, np.ones((3, 3), np.uint8)))
    on_it = 0
    for path in paths_m:
        at = np.floor(sampled(path, _CELL_M).points_m / _CELL_M).astype(np.int64) - low
        at = at[((at >= 0) & (at < (width, height))).all(axis=1)]
        on_it += int(seen[at[:, 1], at[:, 0]].sum())
    return on_it * _CELL_M >= PATH_ON_LEVEL_M

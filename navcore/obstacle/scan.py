"""From a depth image to what stands in the way and where one can walk (reference [13] of the paper, reconstructed).

The blind wedge: a camera at eye height, pitched 15° down, sees the floor from about 1.8 m on, and nothing low that is
nearer. What is too near and too low to be seen has been seen before, from farther away: :mod:`memory` keeps it. This
scan is of one image.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from navcore.geometry import FloatArray, Transform
from navcore.obstacle.corridor import candidate_directions, clearance_ahead_m
from navcore.obstacle.levelling import (
    Expected,
    Levelling,
    level_as_expected,
    level_by_floor,
    level_by_pose_and_floor,
)
from navcore.obstacle.polar_grid import MAX_RANGE_M, RANGE_STEP_M, PolarGrid, polar_grid
from navcore.settings import ObstacleSettings
from navcore.types import BearingState, CameraIntrinsics, DepthImage, ObstacleScan

Scanner = Callable[[DepthImage, CameraIntrinsics, Transform | None, ObstacleSettings, Expected | None], ObstacleScan]
"""What :func:`scan` is: a replay of a walk without pictures has another one."""
_MIN_OBSTACLE_POINTS = 4
"""Points in a cell and the next one before something stands there: flying pixels and noise are fewer."""
_MIN_DROP_POINTS = 8
"""A glossy floor mirrors points to below it, so more are asked for."""
_TOP_CELLS = 3
_MIN_VALID_SHARE = 0.3
_HOLE_CELLS, _HOLE_BEARINGS = 2, 3
"""So long a stretch of floor, and so wide in bearings, that gives no depth is no noise: something absorbs the light."""
_HOLE_VALID_SHARE, _HOLE_MIN_RAYS = 0.1, 6
_HOLE_TOP_M = 0.1
"""Nobody knows how high it is: it is remembered as what is low, and stays until the floor is seen there."""
_MIN_RAY_SHARE = 0.4
"""Bearings with fewer rays than this share of the usual are beside the image."""


def scan(
    depth_m: DepthImage,
    intrinsics: CameraIntrinsics,
    world_from_camera: Transform | None,
    settings: ObstacleSettings,
    expected: Expected | None = None,
) -> ObstacleScan:
    """Return what the depth image says along each bearing, and the candidate walkable directions.

    Args:
        depth_m: depth (h, w), metres; NaN where the sensor gave nothing.
        intrinsics: of the depth image.
        world_from_camera: pose with the floor at z = 0, for levelling; None while not localized, then the floor is
            looked for in the image.
        settings: thresholds.
        expected: without a pose, how the camera is held by its calibration; None where it has none. With one that is
            not sure, how high it was a moment ago; None with a pose that is sure, which tells more.
    """
    levelling: Levelling | None
    if world_from_camera is not None:
        last_m = None if expected is None else expected.height_m
        levelling = level_by_pose_and_floor(world_from_camera, depth_m, intrinsics, last_m)
    elif expected is not None:
        levelling = level_as_expected(expected, depth_m, intrinsics)
    else:
        levelling = level_by_floor(depth_m, intrinsics)
    if levelling is None:
        return nothing_known(depth_m)
    return scan_levelled(depth_m, intrinsics, levelling, settings)


def scan_levelled(
    depth_m: DepthImage, intrinsics: CameraIntrinsics, levelling: Levelling, settings: ObstacleSettings
) -> ObstacleScan:
    """Scan with a given attitude and height of the camera (see :func:`scan`)."""
    grid = polar_grid(depth_m, intrinsics, levelling, settings)
    seen = _bearings_in_image(grid)
    bearing_rad = grid.bearing_rad[seen]
    nearest_m, top_m, state = _nearest(grid)
    found = ObstacleScan(
        bearing_rad, nearest_m[seen], state[seen], (), grid.valid_fraction, None,
        top_m[seen], grid.steepest[seen], levelling.height_m, tilt_rad=levelling.tilt_rad,
    )  # fmt: skip
    return with_directions(found, settings)


def with_directions(scan: ObstacleScan, settings: ObstacleSettings) -> ObstacleScan:
    """Return a scan of one image with the candidate directions, and the room ahead, that follow from its bearings."""
    seen = scan.bearing_rad, scan.nearest_m
    ahead_m = clearance_ahead_m(*seen, settings.person_width_m, MAX_RANGE_M)
    return replace(
        scan,
        candidates=candidate_directions(*seen, scan.state, settings, MAX_RANGE_M),
        nearest_ahead_m=ahead_m if ahead_m < MAX_RANGE_M else None,
    )


def nothing_known(depth_m: DepthImage) -> ObstacleScan:
    """Return the scan of an image in which not even the floor is found: no bearing is known, nothing is walkable."""
    empty = np.zeros(0)
    fraction = float(np.count_nonzero(depth_m > 0.0)) / max(1, depth_m.size)
    return ObstacleScan(empty, empty, np.zeros(0, dtype=np.int8), (), fraction)


def _nearest(grid: PolarGrid) -> tuple[FloatArray, FloatArray, NDArray[np.int8]]:
    """Return distance, height and state of each bearing: the first cells that hold enough points."""
    obstacle_m, first = _first_cell_m(grid.obstacle_count, grid.obstacle_sum_m, _MIN_OBSTACLE_POINTS)
    middles = (np.arange(grid.drop_count.shape[1]) + 0.5) * RANGE_STEP_M
    drop_m, _ = _first_cell_m(grid.drop_count, grid.drop_count * middles, _MIN_DROP_POINTS)
    state = np.full(len(obstacle_m), BearingState.FREE, dtype=np.int8)
    state[np.isfinite(obstacle_m)] = BearingState.OBSTACLE
    state[drop_m < obstacle_m] = BearingState.DROP
    hole_m, is_bottomless = _holes(grid)
    hole = hole_m < np.minimum(obstacle_m, drop_m)
    state[hole] = BearingState.UNKNOWN
    nearest_m = np.minimum(np.minimum(obstacle_m, drop_m), hole_m)
    unknown = grid.valid_count < _MIN_VALID_SHARE * grid.ray_count
    # Where most is missing but something near was measured, the near thing counts; the rest stays unknown.
    unknown |= is_bottomless
    unknown &= ~np.isfinite(nearest_m)
    state[unknown] = BearingState.UNKNOWN
    nearest_m[unknown] = np.nan
    top_m = np.where(state == BearingState.OBSTACLE, _top_m(grid, first), np.where(hole, _HOLE_TOP_M, 0.0))
    return nearest_m, top_m, state


def _holes(grid: PolarGrid) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Return where (n,) the floor ends in a hole, inf where it does not, and whether (n,) not even its edge is shown.

    What absorbs the light of a depth camera, or throws it elsewhere, leaves a hole in the floor: from its foot to
    where the view over its top meets the floor again. How far away it is, is known where the floor before it is shown;
    that it is nothing, is not. A hole that the image begins with may be anything, a hand before the camera included.
    """
    rays, valid = (_with_neighbours(each) for each in (grid.floor_ray_count, grid.floor_valid_count))
    missing = (rays >= _HOLE_MIN_RAYS) & (valid <= _HOLE_VALID_SHARE * rays)
    run_count = np.lib.stride_tricks.sliding_window_view(missing, _HOLE_CELLS, axis=1).sum(axis=2)
    first, is_hole = np.argmax(run_count == _HOLE_CELLS, axis=1), (run_count == _HOLE_CELLS).any(axis=1)
    is_floor = (rays >= _HOLE_MIN_RAYS) & ~missing
    has_edge = is_hole & is_floor.any(axis=1) & (np.argmax(is_floor, axis=1) < first)
    from_m = np.where(has_edge, first * RANGE_STEP_M, np.inf)
    # All of the bearings that a hole was found in together show it.
    hole_m = np.asarray(_windows(from_m, np.inf).min(axis=1), dtype=np.float64)
    return hole_m, np.asarray(_windows(is_hole & ~has_edge, 0).max(axis=1), dtype=np.bool_)


def _with_neighbours(count: NDArray[np.int32]) -> NDArray[np.int64]:
    return np.asarray(_windows(count, 0).sum(axis=-1))


def _windows(values: NDArray[Any], beyond: float) -> NDArray[Any]:
    """Return each bearing's values together with those of its neighbours, along a last axis."""
    aside = _HOLE_BEARINGS // 2
    padded = np.pad(values, [(aside, aside)] + [(0, 0)] * (values.ndim - 1), constant_values=beyond)
    return np.lib.stride_tricks.sliding_window_view(padded, _HOLE_BEARINGS, axis=0)


def _top_m(grid: PolarGrid, first: NDArray[np.intp]) -> FloatArray:
    """Return how high (n,) what begins in a cell is there and in the next ones: an upper edge may lie farther back."""
    last = grid.obstacle_top_m.shape[1] - 1
    rows = np.arange(len(first))
    tops = [grid.obstacle_top_m[rows, np.minimum(first + step, last)] for step in range(_TOP_CELLS)]
    return np.asarray(np.max(tops, axis=0), dtype=np.float64)


def _first_cell_m(count: NDArray[np.int32], sum_m: FloatArray, min_count: int) -> tuple[FloatArray, NDArray[np.intp]]:
    """Return, for each bearing, the mean distance in the first two neighbouring cells with enough points, and which."""
    both = count[:, :-1] + count[:, 1:]
    sums = sum_m[:, :-1] + sum_m[:, 1:]
    enough = both >= min_count
    first = np.argmax(enough, axis=1)
    rows = np.arange(len(count))
    mean_m = sums[rows, first] / np.maximum(both[rows, first], 1)
    return np.where(enough.any(axis=1), mean_m, np.inf), first


def _bearings_in_image(grid: PolarGrid) -> NDArray[np.bool_]:
    """Return which bearings the image covers; rays at its tilted corners do not make a bearing known."""
    usual = float(np.median(grid.ray_count[grid.ray_count > 0])) if grid.ray_count.any() else 0.0
    covered: NDArray[np.bool_] = grid.ray_count > _MIN_RAY_SHARE * usual
    return covered

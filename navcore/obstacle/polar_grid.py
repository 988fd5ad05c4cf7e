"""The depth image as a polar grid on the floor: by bearing and distance, what stands there and where the floor ends."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from navcore.compiled import kernel
from navcore.geometry import FloatArray
from navcore.obstacle.levelling import Levelling
from navcore.settings import ObstacleSettings
from navcore.types import CameraIntrinsics, DepthImage

BEARING_STEP_RAD = math.radians(1.0)
MAX_BEARING_RAD = math.radians(60.0)
RANGE_STEP_M = 0.1
MAX_RANGE_M = 6.0
_WIDTH_PX = 320
"""Wider images are read every second, third … pixel: 1° of bearing is 4 pixels wide even then."""
_SLACK_FROM_M = 2.0
_SLACK_PER_M = 0.02
"""Beyond 2 m, height thresholds widen by 1.1°: what is left of tilt, and depth noise that grows with z². Nothing is
decided there yet: by the time it matters it is nearer."""
_EXPECTED_FLOOR_M = 3.5
"""Rays that would meet the floor nearer than this must have measured something, or their bearing is unknown."""


@dataclass(frozen=True, slots=True, eq=False)
class PolarGrid:
    """Counts of points (bearings, ranges), bearings ascending from −60° (right) to +60° (left)."""

    bearing_rad: FloatArray
    """Middles of the bearing cells (n,)."""
    obstacle_count: NDArray[np.int32]
    obstacle_sum_m: FloatArray
    """Sum of the horizontal distances of the points in each cell."""
    obstacle_top_m: FloatArray
    """Height of the highest of them above the floor; 0 where there is none."""
    drop_count: NDArray[np.int32]
    """Rays that pass through the floor in this cell: its edge."""
    floor_ray_count: NDArray[np.int32]
    """Rays (bearings, ranges up to 3.5 m) that should have met the floor there, or something that stands before it."""
    floor_valid_count: NDArray[np.int32]
    """Those of them that measured something."""
    steepest: FloatArray
    """How steeply down (n,) the image shows each bearing: metres down for each metre ahead; 0 where only upwards."""
    valid_fraction: float
    """Share of all pixels that carry a depth."""

    @property
    def ray_count(self) -> NDArray[np.int64]:
        """Rays (n,) of each bearing that should have met the floor, or something that stands on it."""
        return np.asarray(self.floor_ray_count.sum(axis=1))

    @property
    def valid_count(self) -> NDArray[np.int64]:
        """Those of them (n,) that measured something."""
        return np.asarray(self.floor_valid_count.sum(axis=1))


def polar_grid(
    depth_m: DepthImage, intrinsics: CameraIntrinsics, levelling: Levelling, settings: ObstacleSettings
) -> PolarGrid:
    """Sort the points of a depth image (h, w) into the grid by bearing, distance and height above the floor."""
    stride = max(1, round(depth_m.shape[1] / _WIDTH_PX))
    bearings = 2 * round(MAX_BEARING_RAD / BEARING_STEP_RAD)
    shape = (bearings, round(MAX_RANGE_M / RANGE_STEP_M))
    obstacle_count, drop_count = np.zeros(shape, np.int32), np.zeros(shape, np.int32)
    obstacle_sum_m, obstacle_top_m = np.zeros(shape, np.float64), np.zeros(shape, np.float64)
    steepest = np.zeros(bearings, np.float64)
    floor_shape = (bearings, round(_EXPECTED_FLOOR_M / RANGE_STEP_M))
    floor_ray_count, floor_valid_count = np.zeros(floor_shape, np.int32), np.zeros(floor_shape, np.int32)
    camera = np.array([intrinsics.fx_px, intrinsics.fy_px, intrinsics.cx_px, intrinsics.cy_px])
    heights = np.array([levelling.height_m, settings.low_height_m, settings.head_height_m, settings.drop_depth_m])
    measured, total = _fill(
        np.ascontiguousarray(depth_m, dtype=np.float32), stride, camera,
        np.ascontiguousarray(levelling.level_from_camera, dtype=np.float64), heights,
        obstacle_count, obstacle_sum_m, obstacle_top_m, drop_count, floor_ray_count, floor_valid_count, steepest,
    )  # fmt: skip
    middles = np.asarray((np.arange(bearings) + 0.5) * BEARING_STEP_RAD - MAX_BEARING_RAD, dtype=np.float64)
    fraction = measured / total if total else 0.0
    return PolarGrid(
        middles, obstacle_count, obstacle_sum_m, obstacle_top_m, drop_count, floor_ray_count, floor_valid_count,
        steepest, fraction,
    )  # fmt: skip


@kernel
def _fill(  # noqa: C901 - one pass over the image; a kernel is not cut up
    depth_m: DepthImage,
    stride: int,
    camera: FloatArray,
    rotation: FloatArray,
    heights: FloatArray,
    obstacle_count: NDArray[np.int32],
    obstacle_sum_m: FloatArray,
    obstacle_top_m: FloatArray,
    drop_count: NDArray[np.int32],
    floor_ray_count: NDArray[np.int32],
    floor_valid_count: NDArray[np.int32],
    steepest: FloatArray,
) -> tuple[int, int]:
    height_px, width_px = depth_m.shape
    fx, fy, cx, cy = camera[0], camera[1], camera[2], camera[3]
    eye_m, low_m, head_m, drop_m = heights[0], heights[1], heights[2], heights[3]
    bearings, ranges = obstacle_count.shape
    measured = 0
    total = 0
    for row in range(0, height_px, stride):
        v = (row - cy) / fy
        for col in range(0, width_px, stride):
            total += 1
            u = (col - cx) / fx
            forward = rotation[0, 0] * u + rotation[0, 1] * v + rotation[0, 2]
            left = rotation[1, 0] * u + rotation[1, 1] * v + rotation[1, 2]
            up = rotation[2, 0] * u + rotation[2, 1] * v + rotation[2, 2]
            z = depth_m[row, col]
            valid = z > 0.0 and z < 100.0
            if valid:
                measured += 1
            across = math.sqrt(forward * forward + left * left)
            if across < 1e-6:
                continue
            bearing = math.floor((math.atan2(left, forward) + MAX_BEARING_RAD) / BEARING_STEP_RAD)
            if bearing < 0 or bearing >= bearings:
                continue
            steepest[bearing] = max(steepest[bearing], -up / across)
            if up < 0.0 and eye_m * across < -up * _EXPECTED_FLOOR_M:
                floor_cell = min(int(eye_m * across / -up / RANGE_STEP_M), floor_ray_count.shape[1] - 1)
                floor_ray_count[bearing, floor_cell] += 1
                if valid:
                    floor_valid_count[bearing, floor_cell] += 1
            if not valid:
                continue
            range_m = z * across
            above_m = eye_m + z * up
            slack_m = max(0.0, range_m - _SLACK_FROM_M) * _SLACK_PER_M
            if above_m > low_m + slack_m:
                cell = int(range_m / RANGE_STEP_M)
                if above_m < head_m and cell < ranges:
                    obstacle_count[bearing, cell] += 1
                    obstacle_sum_m[bearing, cell] += range_m
                    obstacle_top_m[bearing, cell] = max(obstacle_top_m[bearing, cell], above_m)
            elif above_m < -(drop_m + slack_m):
                # The ray went through the floor on its way: there is the edge, at the latest.
                cell = int(range_m * eye_m / (eye_m - above_m) / RANGE_STEP_M)
                if cell < ranges:
                    drop_count[bearing, cell] += 1
    return measured, total

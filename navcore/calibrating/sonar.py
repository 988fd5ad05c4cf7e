"""Where the rangefinder looks and what its distances are off by, against a flat wall that the depth camera sees.

The wall's plane is fitted in each depth image. The rangefinder hears the nearest point of the wall within its cone, so
it says the perpendicular distance while the cone's axis is nearer to the wall's normal than half the cone, and more
beyond: d = D / cos(max(0, θ − half the cone)) + bias, θ being the angle between axis and normal. So the bias comes
from readings at several distances, and the axis's bearing from turning left and right beyond the cone.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from navcore.calibration import MAX_BIAS_M, SonarAlignment
from navcore.errors import InputError
from navcore.geometry import FloatArray
from navcore.types import CameraIntrinsics, DepthImage, Frame, SonarReading, SonarState

MIN_READINGS = 30
_MIN_DISTANCE_SPREAD_M = 0.5
_MIN_TURN_RAD = math.radians(12.0)
"""To both sides; within the cone the wall sounds the same whichever way the rangefinder looks."""
_MAX_APART_S = 0.15
"""A reading belongs to a frame that was taken so much earlier or later."""
_WALL_M = 0.03
_MIN_WALL_SHARE = 0.6
"""Share of the picture's middle that must lie on the wall."""
_UPRIGHT = math.sin(math.radians(35.0))
"""The wall's normal has no more than this along the image's height: else it is the floor."""
_ROUNDS = 80
_GRID = 48
_RESIDUAL_SCALE_M = 0.04
_MAX_RESIDUAL_M = 0.10
_SIGMA_OF_MAD = 1.4826


@dataclass(frozen=True, slots=True)
class _Pair:
    """A reading, and the wall at that moment."""

    echo_m: float
    wall_m: float
    """Perpendicular distance of the wall from the camera."""
    normal: tuple[float, float, float]
    """From the camera towards the wall, in the camera's frame."""

    @property
    def turn_rad(self) -> float:
        """How far to the left of the optical axis the wall's normal is."""
        return math.atan2(-self.normal[0], self.normal[2])


def measured_sonar(
    sensed: Iterable[tuple[Frame, SonarReading | None]],
    intrinsics: CameraIntrinsics,
    half_field_rad: float,
    now_s: float,
) -> SonarAlignment:
    """Return how the rangefinder is aligned with the depth camera.

    Args:
        sensed: frames and the readings of the same moments, of somebody who faces a bare, flat wall, walks slowly from
            1 m to 3 m and turns slowly to the left and to the right.
        intrinsics: of the depth images.
        half_field_rad: half of the ultrasonic field.
        now_s: the present time, seconds since 1970, to be noted.

    Raises:
        InputError: where there is no wall, too few readings, or they leave something open; the text says what to do.
    """
    frame_count, wall_count, pairs = 0, 0, []
    for number, (frame, reading) in enumerate(sensed):
        frame_count += 1
        wall = wall_plane(frame.depth_m, intrinsics, number)
        if wall is None:
            continue
        wall_count += 1
        if reading is not None and abs(reading.stamp_s - frame.stamp_s) <= _MAX_APART_S and _is_echo(reading):
            assert reading.distance_m is not None
            x, y, z = (float(each) for each in wall[0])
            pairs.append(_Pair(reading.distance_m, wall[1], (x, y, z)))
    _refuse_poor(pairs, frame_count, wall_count)
    return _fitted(pairs, half_field_rad, now_s)


def wall_plane(depth_m: DepthImage, intrinsics: CameraIntrinsics, seed: int = 0) -> tuple[FloatArray, float] | None:
    """Return the normal (3,), away from the camera, and the distance of a wall that fills the picture's middle.

    None where there is none. The same seed and image give the same answer.
    """
    points = _middle_points(depth_m, intrinsics)
    if len(points) < _GRID * _GRID // 4:
        return None
    rng = np.random.default_rng(seed)
    picks = points[rng.integers(0, len(points), (_ROUNDS, 3))]
    normals = np.cross(picks[:, 1] - picks[:, 0], picks[:, 2] - picks[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    off_m = np.abs((points @ normals.T) - np.sum(normals * picks[:, 0], axis=1))
    inside = off_m < _WALL_M
    best = inside[:, int(np.argmax(inside.sum(axis=0)))]
    if best.mean() < _MIN_WALL_SHARE:
        return None
    kept = points[best]
    middle = kept.mean(axis=0)
    normal: FloatArray = np.linalg.svd(kept - middle, full_matrices=False)[2][2]
    normal = normal if normal @ middle > 0.0 else -normal
    return None if abs(normal[1]) > _UPRIGHT else (normal, float(normal @ middle))


def _middle_points(depth_m: DepthImage, intrinsics: CameraIntrinsics) -> FloatArray:
    """Return points (n, 3) of the upper middle of the image, camera axes: below it the floor comes into view."""
    height, width = depth_m.shape
    rows = np.linspace(0.1 * height, 0.6 * height, _GRID).astype(np.int64)[:, None]
    columns = np.linspace(0.2 * width, 0.8 * width, _GRID).astype(np.int64)[None, :]
    z = depth_m[rows, columns].astype(np.float64)
    x = (columns - intrinsics.cx_px) / intrinsics.fx_px * z
    y = (rows - intrinsics.cy_px) / intrinsics.fy_px * z
    points = np.stack([x, y, z], axis=-1).reshape(-1, 3)
    good = np.isfinite(points).all(axis=1) & (points[:, 2] > 0.2) & (points[:, 2] < 6.0)
    return points[good]


def _is_echo(reading: SonarReading) -> bool:
    distance_m = reading.distance_m
    return reading.state is SonarState.OK and distance_m is not None and math.isfinite(distance_m) and distance_m > 0


def _refuse_poor(pairs: list[_Pair], frame_count: int, wall_count: int) -> None:
    if wall_count < MIN_READINGS:
        raise InputError(
            f"A wall was seen in {wall_count} of {frame_count} frames, and {MIN_READINGS} are needed: face a bare, flat"
            " wall, 1 to 3 m away."
        )
    if len(pairs) < MIN_READINGS:
        raise InputError(
            f"The rangefinder gave {len(pairs)} echoes with the wall in view, and {MIN_READINGS} are needed: see"
            " whether it is plugged in, with `vbr doctor`."
        )
    distances_m = np.array([pair.wall_m for pair in pairs])
    if np.ptp(distances_m) < _MIN_DISTANCE_SPREAD_M:
        raise InputError(
            f"The wall was between {distances_m.min():.2f} and {distances_m.max():.2f} m away: walk slowly from 1 m to"
            " 3 m before it."
        )
    turns_rad = np.array([pair.turn_rad for pair in pairs])
    if turns_rad.max() < _MIN_TURN_RAD or turns_rad.min() > -_MIN_TURN_RAD:
        raise InputError(
            f"You turned {math.degrees(max(0.0, -turns_rad.min())):.0f}° to the left and"
            f" {math.degrees(max(0.0, turns_rad.max())):.0f}° to the right of the wall, which leaves open where the"
            " rangefinder looks: turn slowly, 20° to both sides."
        )


def expected_echo_m(
    wall_m: FloatArray, normals: FloatArray, half_field_rad: float, bearing_rad: float, bias_m: float
) -> FloatArray:
    """Return what a rangefinder that looks along a bearing says (n,) of walls at distances (n,) with normals (n, 3)."""
    axis = np.array([-math.sin(bearing_rad), 0.0, math.cos(bearing_rad)])
    theta: FloatArray = np.arccos(np.clip(normals @ axis, -1.0, 1.0))
    echo_m: FloatArray = wall_m / np.cos(np.maximum(0.0, theta - half_field_rad)) + bias_m
    return echo_m


def _fitted(pairs: list[_Pair], half_field_rad: float, now_s: float) -> SonarAlignment:
    echo_m = np.array([pair.echo_m for pair in pairs])
    wall_m = np.array([pair.wall_m for pair in pairs])
    normals = np.array([pair.normal for pair in pairs])

    def off_m(parameters: FloatArray) -> FloatArray:
        off: FloatArray = expected_echo_m(wall_m, normals, half_field_rad, parameters[0], parameters[1]) - echo_m
        return off

    # The model is flat inside the cone, so that one start may find no slope to go down.
    starts = [np.array([math.radians(degrees), 0.0]) for degrees in (-15.0, -5.0, 0.0, 5.0, 15.0)]
    fits = [least_squares(off_m, start, loss="soft_l1", f_scale=_RESIDUAL_SCALE_M) for start in starts]
    best = min(fits, key=lambda fit: float(fit.cost))
    bearing_rad, bias_m = (float(each) for each in best.x)
    residual_m = _SIGMA_OF_MAD * float(np.median(np.abs(off_m(best.x))))
    if residual_m > _MAX_RESIDUAL_M or abs(bias_m) > MAX_BIAS_M:
        raise InputError(
            f"The rangefinder does not agree with the depth camera (off by {bias_m:+.2f} m, ±{residual_m:.2f} m): see"
            " that both look at the same bare wall, and that nothing stands in between."
        )
    jacobian = np.asarray(best.jac, np.float64)
    information = jacobian.T @ jacobian
    if np.linalg.matrix_rank(information, tol=1e-6) < 2:
        raise InputError("The readings leave open where the rangefinder looks: turn farther to both sides.")
    sigmas = np.sqrt(np.diag(np.linalg.inv(information))) * max(residual_m, 1e-4)
    return SonarAlignment(now_s, bearing_rad, float(sigmas[0]), bias_m, float(sigmas[1]), residual_m, len(pairs))

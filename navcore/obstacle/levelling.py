"""Levelling: which way is up for the depth camera, and how high it is above the floor.

From localization where there is a pose; from the floor in the depth image itself while there is none. In both cases
the floor in the image then takes out what is left of tilt and height, so that a pitch that is off by a degree does not
make an obstacle of the floor four metres ahead. A pose that is not sure can be farther off than that: then the floor is
looked for where the walker's eye was above it last.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from navcore.floor_plane import MIN_POINTS, trimmed_plane
from navcore.geometry import FloatArray, Transform, heading_of_camera, rotation_about_z
from navcore.types import CameraIntrinsics, DepthImage

_POINT_COUNT = 2500
"""Points of the image that a plane is fitted to."""
_FLOOR_RANGE_M = (0.5, 4.5)
_FLOOR_BAND_M = 0.15
_FLOOR_BAND_PER_M = 0.03
"""A floor point may lie this much off the uncorrected floor, growing with its distance: 1.7° of tilt."""
_MAX_TILT = math.tan(math.radians(4.0))
_MAX_HEIGHT_ERROR_M = 0.12
_RANSAC_ROUNDS = 150
_MAX_FROM_NOMINAL = math.cos(math.radians(60.0))
"""Unlocalized, the floor's normal lies within this of the image's up: people do not lie on their side while walking."""
_CAMERA_HEIGHT_M = (0.4, 2.5)
_FLOOR_SHARE = 0.08
_MAX_FROM_EXPECTED_M = 0.35
"""People stoop, and stand on tiptoe."""
_HIGHER_M, _LOWER_M = 0.08, 0.05
"""So much higher or lower than a moment ago the floor may be found: where only the floor beyond a step is in view, that
is not the walker's, also if they stoop."""
_MAX_FROM_POSE = math.cos(math.radians(5.0))
"""Nor is a flight of stairs, or a steep ramp: they slope more than a pose that is not sure tilts."""


@dataclass(frozen=True, slots=True, eq=False)
class Levelling:
    """The camera's attitude and height."""

    level_from_camera: FloatArray
    """Rotation (3, 3) to axes x forward along the heading, y left, z up."""
    height_m: float
    """Height of the camera above the floor."""

    @property
    def tilt_rad(self) -> float:
        """Angle between the image's up (−y of the camera) and up."""
        return math.acos(min(1.0, max(-1.0, -float(self.level_from_camera[2, 1]))))


@dataclass(frozen=True, slots=True, eq=False)
class Expected:
    """What is known of the camera's attitude and height without looking at the floor (a calibration, and gravity)."""

    height_m: float
    """Height of the camera above the floor."""
    up: FloatArray | None = None
    """Up (3,) in the camera's frame; None where nothing tells: a head that nods turns the camera."""


def level_by_pose(world_from_camera: Transform) -> Levelling:
    """Take attitude and height from localization; the floor of the world is z = 0."""
    heading = heading_of_camera(world_from_camera)
    rotation = rotation_about_z(-heading) @ world_from_camera.rotation
    return Levelling(rotation, float(world_from_camera.translation[2]))


def level_by_floor(depth_m: DepthImage, intrinsics: CameraIntrinsics, seed: int = 0) -> Levelling | None:
    """Find the floor as the largest plane below the camera (RANSAC); None where no plane can be the floor.

    Args:
        depth_m: depth (h, w), metres, NaN where missing.
        intrinsics: of the depth image.
        seed: of the random choices; the same seed and image give the same answer.
    """
    points = sampled_points(depth_m, intrinsics)
    if len(points) < MIN_POINTS:
        return None
    rng = np.random.default_rng(seed)
    picks = rng.integers(0, len(points), (_RANSAC_ROUNDS, 3))
    corner = points[picks[:, 0]]
    normals = np.cross(points[picks[:, 1]] - corner, points[picks[:, 2]] - corner)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    # Camera axes are x right, y down: up is −y.
    normals *= -np.sign(normals[:, 1:2])
    heights = -(normals * corner).sum(axis=1)
    possible = (-normals[:, 1] > _MAX_FROM_NOMINAL) & (heights > _CAMERA_HEIGHT_M[0]) & (heights < _CAMERA_HEIGHT_M[1])
    if not possible.any():
        return None
    normals, heights = normals[possible], heights[possible]
    tolerance_m = 0.015 + 0.004 * points[:, 2] ** 2
    above = points @ normals.T + heights
    # A table top has floor below it: what lies below a plane counts against it.
    score = (np.abs(above) < tolerance_m[:, None]).sum(axis=0) - 2 * (above < -3 * tolerance_m[:, None]).sum(axis=0)
    best = int(np.argmax(score))
    if score[best] < _FLOOR_SHARE * len(points):
        return None
    found = _levelling_of(normals[best], float(heights[best]))
    refined = _refined(found, points)
    return found if refined is None else refined


def level_as_expected(
    expected: Expected, depth_m: DepthImage, intrinsics: CameraIntrinsics, seed: int = 0
) -> Levelling | None:
    """Find the floor where it is expected to be (see :func:`level_by_floor`).

    A plane at another height is no floor, but a table. Where none is in view, up and height are taken as expected;
    None where up is not known either.
    """
    found = level_by_floor(depth_m, intrinsics, seed)
    if found is not None and abs(found.height_m - expected.height_m) <= _MAX_FROM_EXPECTED_M:
        return found
    if expected.up is None:
        return None
    return refine_by_floor(_levelling_of(expected.up, expected.height_m), depth_m, intrinsics)


def level_by_pose_and_floor(
    world_from_camera: Transform, depth_m: DepthImage, intrinsics: CameraIntrinsics, last_height_m: float | None
) -> Levelling:
    """Take attitude and height from localization, and from the floor in the image what they are wrong by.

    Where the floor is not to be seen as the pose has it, it is looked for at the height above it that the camera had
    last: by a pose that is 0.2 m too low, and 2° too flat, all of the floor ahead would be a drop.

    Args:
        world_from_camera: pose with the floor at z = 0.
        depth_m: depth (h, w), metres, NaN where missing.
        intrinsics: of the depth image.
        last_height_m: of the camera above the floor, a moment ago; None where the pose is sure, or that is not known.
    """
    by_pose, points = level_by_pose(world_from_camera), sampled_points(depth_m, intrinsics)
    refined = _refined(by_pose, points)
    if refined is not None or last_height_m is None:
        return by_pose if refined is None else refined
    found = level_by_floor(depth_m, intrinsics)
    # Three points make a plane; it is the floor where enough of it is in view.
    if found is None or _refined(found, points) is None:
        return by_pose
    is_alike = float(found.level_from_camera[2] @ by_pose.level_from_camera[2]) >= _MAX_FROM_POSE
    return found if is_alike and -_HIGHER_M <= found.height_m - last_height_m <= _LOWER_M else by_pose


def refine_by_floor(levelling: Levelling, depth_m: DepthImage, intrinsics: CameraIntrinsics) -> Levelling:
    """Take out the small tilt and height error that the floor in the image shows, if it shows enough."""
    refined = _refined(levelling, sampled_points(depth_m, intrinsics))
    return levelling if refined is None else refined


def sampled_points(depth_m: DepthImage, intrinsics: CameraIntrinsics) -> FloatArray:
    """Return some thousand points (n, 3) of the lower two thirds of the image, in camera axes, metres."""
    height, width = depth_m.shape
    stride = max(1, round(math.sqrt(height * width * 0.67 / _POINT_COUNT)))
    rows, cols = np.mgrid[height // 3 : height : stride, stride // 2 : width : stride]
    z = depth_m[rows, cols].astype(np.float64)
    good = (z > 0.0) & (z < 8.0)
    z, rows, cols = z[good], rows[good], cols[good]
    x = (cols - intrinsics.cx_px) / intrinsics.fx_px * z
    y = (rows - intrinsics.cy_px) / intrinsics.fy_px * z
    return np.stack([x, y, z], axis=1)


def _levelling_of(normal: FloatArray, height_m: float) -> Levelling:
    forward = np.array([0.0, 0.0, 1.0]) - normal[2] * normal
    if np.linalg.norm(forward) < 1e-6:
        forward = np.array([0.0, -1.0, 0.0]) + normal[1] * normal
    forward /= np.linalg.norm(forward)
    return Levelling(np.stack([forward, np.cross(normal, forward), normal]), height_m)


def _refined(levelling: Levelling, points_camera: FloatArray) -> Levelling | None:
    """Fit z = a x + b y + c to the floor, trimmed twice, and turn the level axes onto it; None where it is not."""
    points = points_camera @ levelling.level_from_camera.T
    points[:, 2] += levelling.height_m
    range_m = np.hypot(points[:, 0], points[:, 1])
    near = (range_m > _FLOOR_RANGE_M[0]) & (range_m < _FLOOR_RANGE_M[1])
    floor = points[near & (np.abs(points[:, 2]) < _FLOOR_BAND_M + _FLOOR_BAND_PER_M * range_m)]
    fitted = trimmed_plane(floor)
    if fitted is None:
        return None
    plane = fitted.coefficients
    if abs(plane[0]) > _MAX_TILT or abs(plane[1]) > _MAX_TILT or abs(plane[2]) > _MAX_HEIGHT_ERROR_M:
        return None
    normal_level = np.array([-plane[0], -plane[1], 1.0])
    length = float(np.linalg.norm(normal_level))
    normal_camera = levelling.level_from_camera.T @ (normal_level / length)
    return _levelling_of(normal_camera, (levelling.height_m - float(plane[2])) / length)

"""The floor as an anchor: it holds the camera's height and its two tilts where nothing else does.

Where a frame's surfaces are not those of a key frame (seen from the other side, or moved since), odometry carries the
pose on alone and drifts in all six directions. The floor is still there, the same from every side: what key frames saw
of it around the place, whichever way they looked, is compared with what the frame sees, plane with plane.

It says something only where it is known to be flat: steps, platforms and ramps, in the map or in the frame, and a floor
that is not where the map has it, say nothing. The map is level, its floor near z = 0; in one that is not, nothing looks
like floor.
"""

from __future__ import annotations

import math

import numpy as np

from navcore.floor_plane import FloorPlane, trimmed_plane
from navcore.geometry import FloatArray
from navcore.slam.depth_model import DepthModel, model_of_grid, points_and_normals
from navcore.slam.lie import exp_so3, inverse_se3
from navcore.slam.pose_factor import PoseFactor
from navcore.slam.slam_map import SlamMap

FLOOR_BAND_M = 0.15
"""The map's floor lies within this of z = 0."""
LEVELS_M = (-0.6, 0.35)
"""Level surfaces at these heights are floor, or tell that the floor is not flat; chairs and tables are higher."""
UP_COSINE = math.cos(math.radians(15.0))
"""A level surface's normal is within this angle of up."""
RANGE_M = (0.4, 4.5)
"""Horizontal distances at which floor is looked at."""
NEAR_M = 5.0
"""Key frames within this distance of a frame show the floor that it sees."""
NEAR_KEYFRAMES = 16
"""Of so many of them at most, the nearest."""
CELL_M = 0.5
"""Floor is known in squares of this size."""
MIN_KNOWN_SHARE = 0.6
"""Share of the frame's floor that the map must know."""
MIN_FLAT_SHARE = 0.9
"""Share of the level surfaces that must lie in one plane."""
ONE_PLANE_M = 0.05
"""Points nearer to a plane than this lie in it."""
MAX_SLOPE = math.tan(math.radians(2.0))
"""A steeper floor of the map is a ramp, or the map is bent."""
MAX_HEIGHT_M = 0.12
MAX_TILT = math.tan(math.radians(4.0))
"""A floor that disagrees with the pose by more than this is another one."""
MAX_SURPRISE = 16.0
"""Squared Mahalanobis distance between it and what was expected: 99.9 % of the χ² distribution with three degrees of
freedom."""
CORRELATED_POINTS = 60.0
"""Errors of neighbouring points are alike: so many count as one."""
FLOOR_SIGMA_M = 0.01
FLOOR_SIGMA_RAD = 0.004
"""Standard deviation of height and tilt that many points do not take away: floors are uneven, and depth errs alike."""
THINNED = 2
"""Every so many cells of a key frame's surfaces, each way."""

_HELD = [2, 3, 4]
"""What a floor holds, of (position, rotation) in the world: height, and the rotations about x and y."""


class FloorAnchor:
    """The floor of one map; what key frames saw of it is worked out when it is asked for."""

    def __init__(self, slam_map: SlamMap) -> None:
        self._map = slam_map
        poses = slam_map.camera_from_world
        self._centres = -np.einsum("kji,kj->ki", poses[:, :3, :3], poses[:, :3, 3])
        self._usable = slam_map.keyframe_depth.any(axis=(1, 2))
        self._seen_by: dict[int, FloatArray] = {}

    def factor(self, seen: DepthModel, camera_from_world: FloatArray, covariance: FloatArray) -> PoseFactor | None:
        """Return what the floor says of a frame's pose; None where it says nothing.

        Args:
            seen: the frame's surfaces.
            camera_from_world: (4, 4), its pose as far as it is known.
            covariance: (6, 6), of its (position, rotation) in the world, relative to the map around.

        Heading and place on the floor have no information.
        """
        world_from_camera = inverse_se3(np.ascontiguousarray(camera_from_world))
        centre = world_from_camera[:3, 3]
        floor = _flat(_level_points(seen, world_from_camera), centre)
        known = None if floor is None else self._known_under(floor, centre)
        if floor is None or known is None:
            return None
        # Both as seen from under the camera, so that c is the height right there.
        a, b, c = floor.coefficients - known.coefficients
        correction = np.array([-c, -b, a])
        if abs(c) > MAX_HEIGHT_M or max(abs(a), abs(b)) > MAX_TILT:
            return None
        own = _covariance(floor) + _covariance(known) + np.diag([FLOOR_SIGMA_M**2] + [FLOOR_SIGMA_RAD**2] * 2)
        spread = own + covariance[np.ix_(_HELD, _HELD)]
        if float(correction @ np.linalg.solve(spread, correction)) > MAX_SURPRISE:
            return None
        corrected = _corrected(world_from_camera, correction)
        return PoseFactor(inverse_se3(corrected), _information(own, corrected[:3, :3]))

    def _known_under(self, floor: FloorPlane, centre: FloatArray) -> FloorPlane | None:
        """Return the map's floor under what a frame sees of it, from under the camera; None unless known and flat."""
        middle = floor.points[:, :2].mean(axis=0)
        reach_m = float(np.linalg.norm(floor.points[:, :2] - middle, axis=1).max())
        points = self._points_around(centre)
        points = points[np.linalg.norm(points[:, :2] - centre[:2] - middle, axis=1) < reach_m]
        known = _flat(points, centre)
        if known is None or np.abs(known.coefficients[:2]).max() > MAX_SLOPE:
            return None
        if abs(float(known.points[:, 2].mean() + centre[2])) > FLOOR_BAND_M:
            return None
        is_known = np.isin(_cells(floor.points, centre), _cells(known.points, centre))
        return known if float(is_known.mean()) >= MIN_KNOWN_SHARE else None

    def _points_around(self, centre: FloatArray) -> FloatArray:
        """Return what key frames around a place saw of level surfaces (n, 3), in the world."""
        distance = np.where(self._usable, np.linalg.norm(self._centres - centre, axis=1), np.inf)
        nearest = np.argsort(distance, kind="stable")[:NEAR_KEYFRAMES]
        parts = [self._points_of(int(k)) for k in nearest if distance[k] < NEAR_M]
        return np.concatenate([np.zeros((0, 3)), *parts])

    def _points_of(self, keyframe: int) -> FloatArray:
        if keyframe not in self._seen_by:
            model = model_of_grid(self._map.keyframe_depth[keyframe], self._map.camera)
            pose = inverse_se3(np.ascontiguousarray(self._map.camera_from_world[keyframe]))
            self._seen_by[keyframe] = _level_points(model, pose)[:: THINNED * THINNED]
        return self._seen_by[keyframe]


def _level_points(model: DepthModel, world_from_camera: FloatArray) -> FloatArray:
    """Return points (n, 3) of the level surfaces about as high as the floor that a view shows, in the world."""
    points, normals = points_and_normals(model)
    rotation, centre = world_from_camera[:3, :3], world_from_camera[:3, 3]
    is_level = normals @ rotation[2] > UP_COSINE
    points = points[is_level] @ rotation.T
    range_m = np.hypot(points[:, 0], points[:, 1])
    points += centre
    low_m, high_m = LEVELS_M
    near = (range_m > RANGE_M[0]) & (range_m < RANGE_M[1]) & (points[:, 2] > low_m) & (points[:, 2] < high_m)
    return np.asarray(points[near])


def _flat(points: FloatArray, centre: FloatArray) -> FloorPlane | None:
    """Return the plane of level surfaces (n, 3) in the world, measured from the camera's centre (3,); None where they
    are few, or not of one plane."""
    points = points - centre
    plane = trimmed_plane(points)
    if plane is None or float((np.abs(plane.heights_m(points)) < ONE_PLANE_M).mean()) < MIN_FLAT_SHARE:
        return None
    return plane


def _cells(points: FloatArray, centre: FloatArray) -> FloatArray:
    """Return the number of the square of floor (n,) in which each point (n, 3), measured from a centre, lies."""
    column, row = np.floor((points[:, :2] + centre[:2]) / CELL_M).T
    return np.asarray(column * 100_003.0 + row)


def _covariance(plane: FloorPlane) -> FloatArray:
    """Return the covariance (3, 3) of height, and rotations about x and y, that a fit leaves open."""
    rows = np.column_stack([plane.points[:, :2], np.ones(len(plane.points))])
    variance = float(np.mean(plane.heights_m(plane.points) ** 2))
    fitted = CORRELATED_POINTS * variance * np.linalg.inv(rows.T @ rows)
    # z = a x + b y + c is put level by turning by −b about x, by a about y, and lifting by −c.
    turned = np.array([[0.0, 0.0, -1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])
    return np.asarray(turned @ fitted @ turned.T)


def _corrected(world_from_camera: FloatArray, correction: FloatArray) -> FloatArray:
    """Return a pose (4, 4) that is lifted, and turned about x and y, by a correction (3,)."""
    lift_m, about_x_rad, about_y_rad = correction
    corrected = world_from_camera.copy()
    corrected[:3, :3] = exp_so3(np.array([about_x_rad, about_y_rad, 0.0])) @ corrected[:3, :3]
    corrected[2, 3] += lift_m
    return corrected


def _information(covariance: FloatArray, rotation: FloatArray) -> FloatArray:
    """Return the information (6, 6) of a twist in the camera's frame, of a covariance (3, 3) of what a floor holds."""
    world_from_twist = np.zeros((6, 6))
    world_from_twist[:3, :3] = world_from_twist[3:, 3:] = -rotation
    held = world_from_twist[_HELD]
    return np.asarray(held.T @ np.linalg.inv(covariance) @ held)

"""What the fisheye camera does for localization: it steadies a pose, and finds it where the front sees little.

The lens and its mounting come with the pictures, so that nothing is prepared, and nothing costs time, without one.
"""

from __future__ import annotations

import math

import numpy as np

from navcore.geometry import FloatArray
from navcore.slam import pose
from navcore.slam.fisheye_tracking import FisheyeMatch, candidates_near, joined
from navcore.slam.fisheye_view import FisheyeFeatures, FisheyeView
from navcore.slam.keyframes import NO_LANDMARK, Features, IntArray
from navcore.slam.lie import inverse_se3
from navcore.slam.matching import match_all
from navcore.slam.slam_map import SlamMap
from navcore.slam.tracking import Track, fraction_of_step
from navcore.types import Frame

MAX_APART_S = 0.1
"""A fisheye picture taken so much earlier or later than the frame is not used."""
SEARCH_CANDIDATES = 6
"""Key frames that look like the fisheye picture, which are tried."""
SEARCH_RADIUS_FACTOR = 3.0
"""Search radius around landmarks after a pose was found from descriptors alone, times the usual one."""
CONVINCING_COUNT = 80
"""With so many landmarks no further candidate is tried."""
MIN_ALIKE = 12
"""Descriptors that must match a candidate key frame."""
MIN_RIGID = 10
"""Of them, those that must agree on one pose."""
DESCRIPTOR_DISTANCE = 60
"""Bits that two descriptors of one point may differ by."""
DESCRIPTOR_RATIO = 0.85
"""Best distance over second best, at most."""
MAX_OFF_CENTRE_RAD = math.radians(60.0)
"""Rays farther than this from the direction in which most of a key frame is seen do not vote for the pose."""


class FisheyeAid:
    """The fisheye side of one localizer; remembers no picture."""

    def __init__(self, slam_map: SlamMap, reference_feature_count: int) -> None:
        self._map = slam_map
        self._count = reference_feature_count
        self._centres = -np.einsum(
            "kji,kj->ki", slam_map.camera_from_world[:, :3, :3], slam_map.camera_from_world[:, :3, 3]
        )
        self._camera: object = None
        self._view: FisheyeView | None = None

    def see(self, frame: Frame, last: Track | None, before_last: Track | None) -> FisheyeFeatures | None:
        """Return the features of the frame's fisheye picture; None where it has none of about the same time.

        The last two frames say how the camera moved between the two captures.
        """
        image = frame.fisheye
        if image is None or abs(image.stamp_s - frame.stamp_s) > MAX_APART_S:
            return None
        if self._view is None or self._camera is not image.camera:
            self._view, self._camera = FisheyeView(image.camera, self._count), image.camera
        return self._view.extract(image.grey, _moved(image.stamp_s - frame.stamp_s, last, before_last))

    def join(self, seen: FisheyeFeatures, track: Track, radius_factor: float) -> FisheyeMatch:
        """Refine a frame's pose with what the fisheye picture shows of the map around it."""
        assert self._view is not None
        candidates = candidates_near(self._map, self._centres, track.camera_from_world)
        return joined(self._map, self._view, seen, track, candidates, radius_factor)

    def find(self, seen: FisheyeFeatures, features: Features, stamp_s: float) -> FisheyeMatch | None:
        """Find the pose without a guess, by the key frames that look like any part of the fisheye picture."""
        usable = np.flatnonzero(~seen.unusable).astype(np.int32)
        alike, _ = self._map.places.query(seen.features.descriptors[usable], SEARCH_CANDIDATES)
        best: FisheyeMatch | None = None
        for candidate in alike.tolist():
            guess = self._guess(seen, usable, candidate)
            if guess is None:
                continue
            unseen = np.full(len(features), NO_LANDMARK, np.int32)
            found = self.join(seen, Track(stamp_s, features, guess, unseen, np.zeros((6, 6))), SEARCH_RADIUS_FACTOR)
            if found.is_evidence and (best is None or found.found_count > best.found_count):
                best = found
            if best is not None and best.found_count >= CONVINCING_COUNT:
                break
        return best

    def _guess(self, seen: FisheyeFeatures, usable: IntArray, candidate: int) -> FloatArray | None:
        """Return the depth camera's pose (4, 4) from the landmarks of one key frame; None where they do not agree."""
        assert self._view is not None
        row = self._map.landmark_of[candidate]
        landmarks = row[row >= 0]
        if len(landmarks) < MIN_ALIKE:
            return None
        match = match_all(
            self._map.descriptors[landmarks], seen.features.descriptors[usable], DESCRIPTOR_DISTANCE, DESCRIPTOR_RATIO
        )
        matched = np.flatnonzero(match >= 0)
        if len(matched) < MIN_ALIKE:
            return None
        rays = self._view.rays_of(seen.features.uv_px[usable[match[matched]]])
        fisheye_from_world = _pose_from_rays(self._map.positions[landmarks[matched]], rays, self._view.focal_px)
        if fisheye_from_world is None:
            return None
        return np.asarray(inverse_se3(np.ascontiguousarray(seen.fisheye_from_camera)) @ fisheye_from_world)


def _pose_from_rays(points: FloatArray, rays: FloatArray, focal_px: float) -> FloatArray | None:
    """Return the pose (4, 4) at which points (n, 3) lie along rays (n, 3), many of them possibly wrong.

    A pinhole camera pointed at most of them sees them all in front of it, also those beside the lens.
    """
    turned_from_fisheye = _facing(np.median(rays, axis=0))
    turned = rays @ turned_from_fisheye.T
    ahead = turned[:, 2] > math.cos(MAX_OFF_CENTRE_RAD)
    if np.count_nonzero(ahead) < MIN_RIGID:
        return None
    uv_px = focal_px * turned[ahead, :2] / turned[ahead, 2:]
    solved = pose.pnp_ransac(points[ahead], uv_px, focal_px, focal_px, 0.0, 0.0, min_inliers=MIN_RIGID)
    if solved is None:
        return None
    found = solved[0].copy()
    found[:3, :] = turned_from_fisheye.T @ found[:3, :]
    return found


def _facing(direction: FloatArray) -> FloatArray:
    """Return ``turned_from_camera`` (3, 3) of a camera turned to look along a direction (3,) of the other's frame."""
    forward = direction / max(float(np.linalg.norm(direction)), 1e-9)
    right = np.cross(np.array([0.0, 1.0, 0.0]), forward)
    right /= max(float(np.linalg.norm(right)), 1e-9)
    return np.stack([right, np.cross(forward, right), forward])


def _moved(later_s: float, last: Track | None, before_last: Track | None) -> FloatArray:
    """Return how the camera moves in a time (4, 4), at the velocity of the last two frames."""
    if later_s == 0.0 or last is None or before_last is None or last.stamp_s <= before_last.stamp_s:
        return np.eye(4)
    step = last.camera_from_world @ inverse_se3(np.ascontiguousarray(before_last.camera_from_world))
    return fraction_of_step(step, later_s / (last.stamp_s - before_last.stamp_s))

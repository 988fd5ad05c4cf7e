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
from navcore.slam.pose_factor import PoseFactor
from navcore.slam.relocalization import is_same_place
from navcore.slam.slam_map import SlamMap
from navcore.slam.tracking import Track, fraction_of_step
from navcore.types import FisheyeCamera, FisheyeImage, Frame

MAX_APART_S = 0.1
"""A fisheye picture taken so much earlier or later than the frame is not used."""
SEARCH_CANDIDATES = 6
"""Key frames that look like the fisheye picture, which are tried."""
SEARCH_RADIUS_FACTOR = 3.0
"""Search radius around landmarks after a pose was found from descriptors alone, times the usual one."""
RIVAL_SHARE = 0.6
"""Where another place shows more than this share of the best one's landmarks, neither is believed."""
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
    """The fisheye side of one localizer. It holds the frame at hand; features are extracted when they are needed."""

    def __init__(self, slam_map: SlamMap, reference_feature_count: int) -> None:
        self._map = slam_map
        self._count = reference_feature_count
        self._centres = -np.einsum(
            "kji,kj->ki", slam_map.camera_from_world[:, :3, :3], slam_map.camera_from_world[:, :3, 3]
        )
        self._view: FisheyeView | None = None
        self._camera: FisheyeCamera | None = None
        self._image: FisheyeImage | None = None
        self._moved: FloatArray = np.eye(4)
        self._seen: FisheyeFeatures | None = None

    def look(self, frame: Frame, last: Track | None, before_last: Track | None) -> None:
        """Take up a frame; the last two say how the camera moved between its two captures."""
        image, self._seen = frame.fisheye, None
        self._image = None if image is None or abs(image.stamp_s - frame.stamp_s) > MAX_APART_S else image
        if self._image is not None:
            self._moved = _moved(self._image.stamp_s - frame.stamp_s, last, before_last)

    @property
    def has_picture(self) -> bool:
        """Whether the frame at hand has a fisheye picture of about the same time."""
        return self._image is not None

    def join(self, track: Track, radius_factor: float, known: PoseFactor | None = None) -> FisheyeMatch | None:
        """Refine the frame's pose with what the fisheye picture shows of the map around it.

        ``known`` is what is known of it besides. None where there is no picture, or what it shows is no evidence for
        the pose.
        """
        if self._image is None:
            return None
        view, seen = self._extracted(self._image)
        candidates = candidates_near(self._map, self._centres, track.camera_from_world)
        match = joined(self._map, view, seen, track, candidates, radius_factor, known)
        return match if match.is_evidence else None

    def _extracted(self, image: FisheyeImage) -> tuple[FisheyeView, FisheyeFeatures]:
        if self._view is None or self._camera is not image.camera:
            self._view, self._camera = FisheyeView(image.camera, self._count), image.camera
        if self._seen is None:
            self._seen = self._view.extract(image.grey, self._moved)
        return self._view, self._seen

    def find(self, features: Features, stamp_s: float) -> FisheyeMatch | None:
        """Find the pose without a guess, by the key frames that look like any part of the fisheye picture.

        ``features`` are the front view's, which take no part. None where there is no picture, no place shows enough, or
        two places show about as much.
        """
        if self._image is None:
            return None
        _, seen = self._extracted(self._image)
        usable = np.flatnonzero(~seen.unusable).astype(np.int32)
        alike, _ = self._map.places.query(seen.features.descriptors[usable], SEARCH_CANDIDATES)
        best: FisheyeMatch | None = None
        rival = 0
        for candidate in alike.tolist():
            guess = self._guess(seen, usable, candidate)
            if guess is None:
                continue
            unseen = np.full(len(features), NO_LANDMARK, np.int32)
            found = self.join(Track(stamp_s, features, guess, unseen, np.zeros((6, 6))), SEARCH_RADIUS_FACTOR)
            if found is None or not found.is_sure:
                continue
            if best is not None and is_same_place(best.track, found.track):
                best = max(best, found, key=lambda match: match.found_count)
            elif best is None or found.found_count > best.found_count:
                rival, best = 0 if best is None else best.found_count, found
            else:
                rival = max(rival, found.found_count)
        return None if best is None or rival > RIVAL_SHARE * best.found_count else best

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

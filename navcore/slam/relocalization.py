"""Finding the pose without a guess: by the key frames that look alike, verified by geometry.

A wrong pose is worse than none. A candidate must convince: many of its landmarks must agree on one rigid motion, the
map around that pose must be found again by projection, and the depth image must agree with where the landmarks lie.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from navcore.geometry import FloatArray
from navcore.slam import pose
from navcore.slam.keyframes import Features, IntArray
from navcore.slam.matching import match_all, project_landmarks
from navcore.slam.tracking import FrameMatch, MapView, extend_by_map, local_keyframes, local_landmarks, refined
from navcore.types import DepthImage

MIN_ALIKE = 12
"""Descriptors that must match a candidate key frame."""
MIN_RIGID = 10
"""Of them, those that must agree on one pose."""
DESCRIPTOR_DISTANCE = 60
"""Bits that two descriptors of one point may differ by."""
DESCRIPTOR_RATIO = 0.85
"""Best distance over second best, at most."""


def relocalize(
    view: MapView, features: Features, stamp_s: float, candidates: Iterable[int], min_inliers: int
) -> FrameMatch | None:
    """Return the pose at which most landmarks agree, at least ``min_inliers``, around any of the candidates."""
    best: FrameMatch | None = None
    for candidate in candidates:
        found = _from_candidate(view, features, stamp_s, int(candidate))
        if found is None or found.landmark_count < min_inliers:
            continue
        if best is None or found.landmark_count > best.landmark_count:
            best = found
        if best.landmark_count >= 4 * min_inliers:
            break
    return best


def _from_candidate(view: MapView, features: Features, stamp_s: float, candidate: int) -> FrameMatch | None:
    row = view.landmark_of[candidate]
    landmarks = row[row >= 0]
    landmarks = landmarks[view.landmark_alive[landmarks]]
    if len(landmarks) < MIN_ALIKE:
        return None
    match = match_all(view.descriptors[landmarks], features.descriptors, DESCRIPTOR_DISTANCE, DESCRIPTOR_RATIO)
    matched = np.flatnonzero(match >= 0)
    if len(matched) < MIN_ALIKE:
        return None
    landmarks, feature_index = landmarks[matched], match[matched]
    guess = _guess(view, features, landmarks, feature_index)
    if guess is None:
        return None
    found = refined(stamp_s, features, guess, feature_index, view.positions[landmarks], landmarks, view.camera)
    for radius_factor in (3.0, 1.0):
        if found.landmark_count < MIN_RIGID:
            return None
        around = local_landmarks(view, local_keyframes(view, found.track.landmarks))
        found, _ = extend_by_map(view, found.track, around, radius_factor)
    return found


def _guess(view: MapView, features: Features, landmarks: IntArray, feature_index: IntArray) -> FloatArray | None:
    camera = view.camera
    solved = pose.pnp_ransac(
        view.positions[landmarks],
        features.uv_px[feature_index],
        camera.fx_px,
        camera.fy_px,
        camera.cx_px,
        camera.cy_px,
        min_inliers=MIN_RIGID,
    )
    return None if solved is None else solved[0]


@dataclass(frozen=True, slots=True)
class DepthSupport:
    """What the depth image says of landmarks that should be in view."""

    agreeing: int
    """The surface is where the landmark lies."""
    seen_through: int
    """The surface lies behind the landmark: it is not there, or the pose is wrong."""

    @property
    def share(self) -> float:
        """Share of the decided ones that agree, 0–1; 0 where none is decided. What hides a landmark says nothing."""
        decided = self.agreeing + self.seen_through
        return self.agreeing / decided if decided else 0.0


def depth_support(
    view: MapView, camera_from_world: FloatArray, landmarks: IntArray, depth_m: DepthImage
) -> DepthSupport:
    """Compare a depth image (h, w) with the landmarks that should be in view at a pose."""
    uvr, _, octave, _ = project_landmarks(
        camera_from_world, view.positions[landmarks], view.normals[landmarks], view.reach[landmarks], view.camera
    )
    visible = octave >= 0
    pixel = np.floor(uvr[visible, :2] + 0.5).astype(np.int64)
    z = view.camera.bf_px_m / (uvr[visible, 0] - uvr[visible, 2])
    height, width = depth_m.shape
    measured = depth_m[np.clip(pixel[:, 1], 0, height - 1), np.clip(pixel[:, 0], 0, width - 1)]
    margin = 0.1 + 0.05 * z
    with np.errstate(invalid="ignore"):
        agreeing = np.count_nonzero(np.abs(measured - z) < margin)
        seen_through = np.count_nonzero(measured - z >= margin)
    return DepthSupport(int(agreeing), int(seen_through))

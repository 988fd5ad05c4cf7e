"""Finding the pose without a guess: by the key frames that look alike, verified by geometry.

A wrong pose is worse than none, so a candidate must convince twice: many of its landmarks must agree on one rigid
motion, and then the map around that pose must be found again by projection.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from navcore.geometry import FloatArray
from navcore.slam import pose
from navcore.slam.keyframes import Features, IntArray
from navcore.slam.matching import match_all
from navcore.slam.tracking import FrameMatch, MapView, extend_by_map, local_keyframes, local_landmarks, refined

MIN_ALIKE = 15
"""Descriptors that must match a candidate key frame."""
MIN_RIGID = 12
"""Of them, those that must agree on one pose."""
DESCRIPTOR_DISTANCE = 60
"""Bits that two descriptors of one point may differ by."""
DESCRIPTOR_RATIO = 0.85
"""Best distance over second best, at most."""


def relocalize(
    view: MapView,
    keyframe_features: dict[int, Features] | None,
    features: Features,
    stamp_s: float,
    candidates: Iterable[int],
    min_inliers: int,
) -> FrameMatch | None:
    """Return the pose at which at least ``min_inliers`` landmarks agree, from the first candidate that convinces."""
    del keyframe_features
    for candidate in candidates:
        found = _from_candidate(view, features, stamp_s, int(candidate), min_inliers)
        if found is not None:
            return found
    return None


def _from_candidate(
    view: MapView, features: Features, stamp_s: float, candidate: int, min_inliers: int
) -> FrameMatch | None:
    row = view.landmark_of[candidate]
    landmarks = row[row >= 0]
    landmarks = landmarks[view.landmark_alive[landmarks]]
    match = match_all(view.descriptors[landmarks], features.descriptors, DESCRIPTOR_DISTANCE, DESCRIPTOR_RATIO)
    matched = np.flatnonzero(match >= 0)
    if len(matched) < MIN_ALIKE:
        return None
    landmarks, feature_index = landmarks[matched], match[matched]
    guess = _guess(view, features, landmarks, feature_index)
    if guess is None:
        return None
    found = refined(
        stamp_s, features, guess, feature_index, view.positions[landmarks], landmarks, view.camera
    )
    if found.landmark_count < MIN_RIGID:
        return None
    for radius_factor in (3.0, 1.0):
        around = local_landmarks(view, local_keyframes(view, found.track.landmarks))
        found, _ = extend_by_map(view, found.track, around, radius_factor)
    return found if found.landmark_count >= min_inliers else None


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

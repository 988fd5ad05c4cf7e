"""Finding the pose without a guess: by the key frames that look alike, verified by geometry.

A wrong pose is worse than none. A candidate must convince: many of its landmarks must agree on one rigid motion, the
map around that pose must be found again by projection, and the depth image must agree with where the landmarks lie.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from navcore.geometry import FloatArray
from navcore.slam import pose
from navcore.slam.keyframes import Features, IntArray
from navcore.slam.lie import inverse_se3
from navcore.slam.matching import match_all
from navcore.slam.tracking import FrameMatch, MapView, Track, extend_by_map, local_keyframes, local_landmarks, refined

MIN_ALIKE = 12
"""Descriptors that must match a candidate key frame."""
MIN_RIGID = 10
"""Of them, those that must agree on one pose."""
DESCRIPTOR_DISTANCE = 60
"""Bits that two descriptors of one point may differ by."""
DESCRIPTOR_RATIO = 0.85
"""Best distance over second best, at most."""
MEASURED_SHARE = 0.6
"""Share of the matches that must have a depth for the pose to be found from depths, which takes a tenth of the time."""
TOLERANCE_M = 0.06
TOLERANCE_PER_M = 0.02
"""Two points agree within the first, and this times the square of their depth: how depth cameras err."""
TRIPLES = 400
"""Triples of matches that are tried: with a quarter of the matches right, one of them is right with 99.8 %."""
SAME_PLACE_M = 0.3
SAME_PLACE_COSINE = 0.985
"""Poses nearer to each other than this, and turned by less than 10°, are taken for one."""
SHARED_LANDMARKS = 20
"""Landmarks that a key frame shares with a pose that was found already, for it to be the same place."""
PNP_ITERATIONS = 100
"""Samples that are tried without depths."""


def relocalize(
    view: MapView, features: Features, stamp_s: float, candidates: Iterable[int], min_inliers: int
) -> FrameMatch | None:
    """Return the pose at which most landmarks agree, at least ``min_inliers``, around any of the candidates."""
    best: FrameMatch | None = None
    for found in proposals(view, features, stamp_s, candidates, min_inliers):
        if best is None or found.landmark_count > best.landmark_count:
            best = found
        if best.landmark_count >= 4 * min_inliers:
            break
    return best


def proposals(
    view: MapView, features: Features, stamp_s: float, candidates: Iterable[int], min_inliers: int
) -> Iterator[FrameMatch]:
    """Yield poses, each at another place, at which at least ``min_inliers`` landmarks around a candidate agree."""
    weighed: list[Track] = []
    for candidate in candidates:
        if any(_shows(view, int(candidate), other) for other in weighed):
            continue
        found = _from_candidate(view, features, stamp_s, int(candidate))
        if found is None or any(is_same_place(found.track, other) for other in weighed):
            continue
        for radius_factor in (3.0, 1.0):
            if found.landmark_count < MIN_RIGID:
                break
            around = local_landmarks(view, local_keyframes(view, found.track.landmarks))
            found, _ = extend_by_map(view, found.track, around, radius_factor)
        if found.landmark_count >= min_inliers:
            weighed.append(found.track)
            yield found


def _shows(view: MapView, keyframe: int, track: Track) -> bool:
    """Tell whether a key frame sees what a pose has found already: it would only lead to that pose again."""
    row = view.landmark_of[keyframe]
    return int(np.count_nonzero(np.isin(row[row >= 0], track.landmarks))) >= SHARED_LANDMARKS


def is_same_place(track: Track, other: Track) -> bool:
    """Tell whether two poses are so near to each other that the search by projection makes one of them."""
    step = track.camera_from_world @ inverse_se3(other.camera_from_world)
    turn_cosine = 0.5 * (float(np.trace(step[:3, :3])) - 1.0)
    return float(np.linalg.norm(step[:3, 3])) < SAME_PLACE_M and turn_cosine > SAME_PLACE_COSINE


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
    return found if found.landmark_count >= MIN_RIGID else None


def _guess(view: MapView, features: Features, landmarks: IntArray, feature_index: IntArray) -> FloatArray | None:
    """Return the pose with which most matches agree: by their depths, or by their pixels where few have any."""
    camera = view.camera
    in_camera = features.points_in_camera(camera)[feature_index]
    measured = np.isfinite(in_camera[:, 2])
    if np.count_nonzero(measured) >= MEASURED_SHARE * len(measured):
        in_camera = in_camera[measured]
        tolerance_m = TOLERANCE_M + TOLERANCE_PER_M * in_camera[:, 2] ** 2
        aligned = pose.align_ransac(
            in_camera, view.positions[landmarks[measured]], tolerance_m, iterations=TRIPLES, min_inliers=MIN_RIGID
        )
        return None if aligned is None else aligned[0]
    solved = pose.pnp_ransac(
        view.positions[landmarks],
        features.uv_px[feature_index],
        camera.fx_px,
        camera.fy_px,
        camera.cx_px,
        camera.cy_px,
        iterations=PNP_ITERATIONS,
        min_inliers=MIN_RIGID,
    )
    return None if solved is None else solved[0]

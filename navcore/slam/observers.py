"""The table of which key frames see each landmark, kept in step with ``landmark_of`` (see :mod:`navcore.slam.map`).

Row n of ``observers`` (N, W, 2) holds key frame and feature of the ``count[n]`` observations of landmark n; W grows if
it must. With it, covisibility and culling cost what the landmarks at hand have as observations, not the whole map.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from navcore.compiled import kernel
from navcore.slam.keyframes import NO_LANDMARK, IntArray

BoolArray = NDArray[np.bool_]


@kernel
def _forget_one(observers: IntArray, count: IntArray, landmark: int, keyframe: int, feature: int) -> None:
    for i in range(count[landmark]):
        if observers[landmark, i, 0] == keyframe and observers[landmark, i, 1] == feature:
            count[landmark] -= 1
            # The order of the rest stays, so that the result does not depend on what was removed before.
            for j in range(i, count[landmark]):
                observers[landmark, j, 0] = observers[landmark, j + 1, 0]
                observers[landmark, j, 1] = observers[landmark, j + 1, 1]
            return


@kernel
def connect(
    observers: IntArray, count: IntArray, landmark_of: IntArray, keyframe: int, features: IntArray, landmarks: IntArray
) -> None:
    """Let a key frame see ``landmarks`` (n,) at its ``features`` (n,); NO_LANDMARK disconnects."""
    for i in range(len(features)):
        feature, landmark = features[i], landmarks[i]
        before = landmark_of[keyframe, feature]
        if before == landmark:
            continue
        if before >= 0:
            _forget_one(observers, count, before, keyframe, feature)
        landmark_of[keyframe, feature] = landmark
        if landmark >= 0:
            observers[landmark, count[landmark], 0] = keyframe
            observers[landmark, count[landmark], 1] = feature
            count[landmark] += 1


@kernel
def disconnect(
    observers: IntArray, count: IntArray, landmark_of: IntArray, keyframes: IntArray, features: IntArray
) -> None:
    """Take the landmark away from each feature (n,) of each key frame (n,)."""
    for i in range(len(features)):
        before = landmark_of[keyframes[i], features[i]]
        if before >= 0:
            _forget_one(observers, count, before, keyframes[i], features[i])
            landmark_of[keyframes[i], features[i]] = NO_LANDMARK


@kernel
def clear(observers: IntArray, count: IntArray, landmark_of: IntArray, landmarks: IntArray) -> None:
    """Take landmarks (n,) away from every key frame."""
    for landmark in landmarks:
        for i in range(count[landmark]):
            landmark_of[observers[landmark, i, 0], observers[landmark, i, 1]] = NO_LANDMARK
        count[landmark] = 0


@kernel
def hand_over(observers: IntArray, count: IntArray, landmark_of: IntArray, old: int, new: int) -> None:
    """Let everybody who sees ``old`` see ``new`` in its place; who sees both keeps the feature that shows ``new``."""
    for i in range(count[old]):
        keyframe, feature = observers[old, i, 0], observers[old, i, 1]
        sees_both = False
        for j in range(count[new]):
            sees_both = sees_both or observers[new, j, 0] == keyframe
        if sees_both:
            landmark_of[keyframe, feature] = NO_LANDMARK
        else:
            landmark_of[keyframe, feature] = new
            observers[new, count[new], 0] = keyframe
            observers[new, count[new], 1] = feature
            count[new] += 1
    count[old] = 0


@kernel
def seen_by_each(observers: IntArray, count: IntArray, landmarks: IntArray, keyframe_count: int) -> IntArray:
    """Return how many of the landmarks (n,) each key frame sees (K,); negative entries are skipped."""
    shared = np.zeros(keyframe_count, np.int32)
    for landmark in landmarks:
        if landmark >= 0:
            for i in range(count[landmark]):
                shared[observers[landmark, i, 0]] += 1
    return shared


@kernel
def redundancy(
    observers: IntArray, count: IntArray, octaves: NDArray[np.int8], row: IntArray, keyframe: int, others_needed: int
) -> tuple[int, int]:
    """Return how many landmarks a key frame sees (its ``row`` of landmark_of), and how many of them enough others see.

    Others count where they see the landmark at the same, a finer, or the next coarser level; ``octaves`` (K, F).
    """
    seen, redundant = 0, 0
    for feature in range(len(row)):
        landmark = row[feature]
        if landmark < 0:
            continue
        seen += 1
        others = 0
        for i in range(count[landmark]):
            other = observers[landmark, i, 0]
            if other != keyframe and octaves[other, observers[landmark, i, 1]] <= octaves[keyframe, feature] + 1:
                others += 1
        if others >= others_needed:
            redundant += 1
    return seen, redundant

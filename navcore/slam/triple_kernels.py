"""The rigid motion on which most pairs of points agree, tried from three pairs at a time."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from navcore.compiled import kernel
from navcore.geometry import FloatArray

BoolArray = NDArray[np.bool_]


@kernel
def _frame_of_triple(p: FloatArray, q: FloatArray, r: FloatArray, frame: FloatArray) -> bool:
    """Write three orthonormal axes (rows) fixed to three points; False where they lie on a line."""
    length2 = 0.0
    along = 0.0
    for k in range(3):
        frame[0, k] = q[k] - p[k]
        frame[1, k] = r[k] - p[k]
        length2 += frame[0, k] * frame[0, k]
        along += frame[0, k] * frame[1, k]
    if length2 < 1e-12:
        return False
    height2 = 0.0
    for k in range(3):
        frame[1, k] -= along / length2 * frame[0, k]
        height2 += frame[1, k] * frame[1, k]
    if height2 < 1e-6 * length2:
        return False
    for k in range(3):
        frame[0, k] /= math.sqrt(length2)
        frame[1, k] /= math.sqrt(height2)
    fill_third_axis(frame)
    return True


@kernel
def fill_third_axis(frame: FloatArray) -> None:
    """Write the third row as the cross product of the first two."""
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        frame[2, k] = frame[0, i] * frame[1, j] - frame[0, j] * frame[1, i]


@kernel
def best_of_triples(a: FloatArray, b: FloatArray, limit2: FloatArray, triples: NDArray[np.int64]) -> BoolArray:
    """Return which pairs agree (n,) with the motion, given by three of them, with which most agree."""
    best_count = 0
    best = np.zeros((3, 4))
    trial = np.zeros((3, 4))
    frame_a = np.empty((3, 3))
    frame_b = np.empty((3, 3))
    for t in range(len(triples)):
        i, j, k = triples[t, 0], triples[t, 1], triples[t, 2]
        if not (_frame_of_triple(a[i], a[j], a[k], frame_a) and _frame_of_triple(b[i], b[j], b[k], frame_b)):
            continue
        for r in range(3):
            trial[r, 3] = (a[i, r] + a[j, r] + a[k, r]) / 3.0
            for c in range(3):
                trial[r, c] = (
                    frame_a[0, r] * frame_b[0, c] + frame_a[1, r] * frame_b[1, c] + frame_a[2, r] * frame_b[2, c]
                )
                trial[r, 3] -= trial[r, c] * (b[i, c] + b[j, c] + b[k, c]) / 3.0
        count = 0
        for n in range(len(a)):
            if _pair_error(a[n], b[n], trial) <= limit2[n]:
                count += 1
        if count > best_count:
            best_count = count
            for r in range(3):
                for c in range(4):
                    best[r, c] = trial[r, c]
    inliers = np.zeros(len(a), dtype=np.bool_)
    for n in range(len(a)):
        inliers[n] = best_count > 0 and _pair_error(a[n], b[n], best) <= limit2[n]
    return inliers


@kernel
def _pair_error(a: FloatArray, b: FloatArray, transform: FloatArray) -> float:
    total = 0.0
    for r in range(3):
        e = transform[r, 0] * b[0] + transform[r, 1] * b[1] + transform[r, 2] * b[2] + transform[r, 3] - a[r]
        total += e * e
    return total

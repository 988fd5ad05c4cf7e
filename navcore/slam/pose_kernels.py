"""The compiled parts of finding one camera's pose; see :mod:`navcore.slam.pose` for the arguments."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from navcore.compiled import kernel
from navcore.geometry import FloatArray
from navcore.slam.lie import update_pose

BoolArray = NDArray[np.bool_]

CHI2_MONO = 5.991
"""95 % of the χ² distribution with two degrees of freedom: a landmark seen without depth."""
CHI2_DEPTH = 7.815
"""95 % of the χ² distribution with three degrees of freedom: a landmark seen with depth."""
MIN_DEPTH_M = 0.05
MIN_OBSERVATIONS = 3
_ROUNDS = 4
_ITERATIONS = 10
_STEP_DONE = 1e-6


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
    _fill_third_axis(frame)
    return True


@kernel
def _fill_third_axis(frame: FloatArray) -> None:
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


@kernel
def _chi2(
    pose: FloatArray, x: FloatArray, o: FloatArray, w: float, fx: float, fy: float, cx: float, cy: float, bf: float
) -> float:
    """Weighted squared error of one observation; infinite behind the camera."""
    pz = pose[2, 0] * x[0] + pose[2, 1] * x[1] + pose[2, 2] * x[2] + pose[2, 3]
    if pz < MIN_DEPTH_M:
        return np.inf
    px = pose[0, 0] * x[0] + pose[0, 1] * x[1] + pose[0, 2] * x[2] + pose[0, 3]
    py = pose[1, 0] * x[0] + pose[1, 1] * x[1] + pose[1, 2] * x[2] + pose[1, 3]
    u = fx * px / pz + cx
    e0 = u - o[0]
    e1 = fy * py / pz + cy - o[1]
    total = e0 * e0 + e1 * e1
    if not math.isnan(o[2]):
        e2 = u - bf / pz - o[2]
        total += e2 * e2
    return float(total * w)


@kernel
def _robust_cost(
    pose: FloatArray,
    points: FloatArray,
    observations: FloatArray,
    inv_sigma2: FloatArray,
    used: BoolArray,
    robust: bool,
    fx: float,
    fy: float,
    cx: float,
    cy: float,
    bf: float,
) -> float:
    total = 0.0
    for i in range(points.shape[0]):
        if not used[i]:
            continue
        limit = CHI2_MONO if math.isnan(observations[i, 2]) else CHI2_DEPTH
        chi2 = _chi2(pose, points[i], observations[i], inv_sigma2[i], fx, fy, cx, cy, bf)
        if math.isinf(chi2):
            chi2 = 1e6
        if robust and chi2 > limit:
            chi2 = 2.0 * math.sqrt(limit * chi2) - limit
        total += chi2
    return total


@kernel
def _clear(h: FloatArray, g: FloatArray) -> None:
    for k in range(6):
        g[k] = 0.0
        for m in range(6):
            h[k, m] = 0.0


@kernel
def _normal_equations(
    pose: FloatArray,
    points: FloatArray,
    observations: FloatArray,
    inv_sigma2: FloatArray,
    used: BoolArray,
    robust: bool,
    fx: float,
    fy: float,
    cx: float,
    cy: float,
    bf: float,
    h: FloatArray,
    g: FloatArray,
) -> None:
    """Fill h (6, 6) = Σ JᵀWJ and g (6,) = Σ JᵀWe over the used observations."""
    _clear(h, g)
    j = np.empty((3, 6))
    e = np.empty(3)
    for i in range(points.shape[0]):
        if not used[i]:
            continue
        x = points[i]
        pz = pose[2, 0] * x[0] + pose[2, 1] * x[1] + pose[2, 2] * x[2] + pose[2, 3]
        if pz < MIN_DEPTH_M:
            continue
        px = pose[0, 0] * x[0] + pose[0, 1] * x[1] + pose[0, 2] * x[2] + pose[0, 3]
        py = pose[1, 0] * x[0] + pose[1, 1] * x[1] + pose[1, 2] * x[2] + pose[1, 3]
        iz = 1.0 / pz
        has_depth = not math.isnan(observations[i, 2])
        u = fx * px * iz + cx
        e[0] = u - observations[i, 0]
        e[1] = fy * py * iz + cy - observations[i, 1]
        chi2 = e[0] * e[0] + e[1] * e[1]
        limit = CHI2_MONO
        rows = 2
        if has_depth:
            e[2] = u - bf * iz - observations[i, 2]
            chi2 += e[2] * e[2]
            limit = CHI2_DEPTH
            rows = 3
        w = inv_sigma2[i]
        chi2 *= w
        if robust and chi2 > limit:
            w *= math.sqrt(limit / chi2)
        a = fx * iz
        b = -fx * px * iz * iz
        j[0, 0] = a
        j[0, 1] = 0.0
        j[0, 2] = b
        j[0, 3] = b * py
        j[0, 4] = a * pz - b * px
        j[0, 5] = -a * py
        c = fy * iz
        d = -fy * py * iz * iz
        j[1, 0] = 0.0
        j[1, 1] = c
        j[1, 2] = d
        j[1, 3] = -c * pz + d * py
        j[1, 4] = -d * px
        j[1, 5] = c * px
        if has_depth:
            f = b + bf * iz * iz
            j[2, 0] = a
            j[2, 1] = 0.0
            j[2, 2] = f
            j[2, 3] = f * py
            j[2, 4] = a * pz - f * px
            j[2, 5] = -a * py
        for r in range(rows):
            for k in range(6):
                jw = j[r, k] * w
                g[k] += jw * e[r]
                for m in range(k, 6):
                    h[k, m] += jw * j[r, m]
    for k in range(6):
        for m in range(k):
            h[k, m] = h[m, k]


@kernel
def _solve6(h: FloatArray, g: FloatArray, damping: float, step: FloatArray) -> bool:
    """Solve (h + damping · diag h) step = −g by Cholesky; False where it is not positive definite."""
    low = np.empty((6, 6))
    for i in range(6):
        for j in range(i + 1):
            s = h[i, j]
            if i == j:
                s += damping * h[i, i] + 1e-9
            for k in range(j):
                s -= low[i, k] * low[j, k]
            if i == j:
                if s <= 0.0:
                    return False
                low[i, i] = math.sqrt(s)
            else:
                low[i, j] = s / low[j, j]
    for i in range(6):
        s = -g[i]
        for k in range(i):
            s -= low[i, k] * step[k]
        step[i] = s / low[i, i]
    for i in range(5, -1, -1):
        s = step[i]
        for k in range(i + 1, 6):
            s -= low[k, i] * step[k]
        step[i] = s / low[i, i]
    return True


@kernel
def _orthonormalize(pose: FloatArray) -> None:
    """Make the rotation one again: many small rotations multiplied together drift away from it."""
    length2 = 0.0
    for k in range(3):
        length2 += pose[0, k] * pose[0, k]
    along = 0.0
    for k in range(3):
        pose[0, k] /= math.sqrt(length2)
        along += pose[0, k] * pose[1, k]
    height2 = 0.0
    for k in range(3):
        pose[1, k] -= along * pose[0, k]
        height2 += pose[1, k] * pose[1, k]
    for k in range(3):
        pose[1, k] /= math.sqrt(height2)
    _fill_third_axis(pose)


@kernel
def _descend(
    pose: FloatArray,
    points: FloatArray,
    observations: FloatArray,
    inv_sigma2: FloatArray,
    used: BoolArray,
    robust: bool,
    fx: float,
    fy: float,
    cx: float,
    cy: float,
    bf: float,
) -> None:
    """One round of Levenberg–Marquardt on the used observations, in place."""
    h = np.empty((6, 6))
    g = np.empty(6)
    step = np.empty(6)
    trial = np.empty((4, 4))
    damping = 1e-5
    cost = _robust_cost(pose, points, observations, inv_sigma2, used, robust, fx, fy, cx, cy, bf)
    is_linearized = False
    for _ in range(_ITERATIONS):
        if not is_linearized:
            _normal_equations(pose, points, observations, inv_sigma2, used, robust, fx, fy, cx, cy, bf, h, g)
            is_linearized = True
        gain = -1.0
        length2 = np.inf
        trial_cost = cost
        if _solve6(h, g, damping, step):
            update_pose(pose, step, trial)
            trial_cost = _robust_cost(trial, points, observations, inv_sigma2, used, robust, fx, fy, cx, cy, bf)
            gain = cost - trial_cost
            length2 = 0.0
            for k in range(6):
                length2 += step[k] * step[k]
        if gain >= 0.0:
            for i in range(3):
                for j in range(4):
                    pose[i, j] = trial[i, j]
            cost = trial_cost
            is_linearized = False
        damping = max(damping * 0.1, 1e-9) if gain >= 0.0 else max(damping * 10.0, 1e-5)
        converged = 0.0 <= gain < 1e-4 * cost
        if converged or length2 < _STEP_DONE * _STEP_DONE or damping > 1e3:
            break


@kernel
def _reclassify(
    pose: FloatArray,
    points: FloatArray,
    observations: FloatArray,
    inv_sigma2: FloatArray,
    used: BoolArray,
    fx: float,
    fy: float,
    cx: float,
    cy: float,
    bf: float,
) -> tuple[int, bool]:
    """Decide anew which observations are inliers; return how many are, and whether any changed sides."""
    changed = False
    count = 0
    for i in range(len(points)):
        limit = CHI2_MONO if math.isnan(observations[i, 2]) else CHI2_DEPTH
        inside = _chi2(pose, points[i], observations[i], inv_sigma2[i], fx, fy, cx, cy, bf) <= limit
        changed = changed or inside != used[i]
        used[i] = inside
        if inside:
            count += 1
    return count, changed


@kernel
def refine(
    pose: FloatArray,
    points: FloatArray,
    observations: FloatArray,
    inv_sigma2: FloatArray,
    fx: float,
    fy: float,
    cx: float,
    cy: float,
    bf: float,
) -> tuple[FloatArray, BoolArray, FloatArray]:
    """Refine a pose (4, 4) in place; return it, the inliers (n,) and the information (6, 6)."""
    used = np.ones(len(points), dtype=np.bool_)
    for round_index in range(_ROUNDS):
        robust = round_index < _ROUNDS - 2
        _descend(pose, points, observations, inv_sigma2, used, robust, fx, fy, cx, cy, bf)
        count, changed = _reclassify(pose, points, observations, inv_sigma2, used, fx, fy, cx, cy, bf)
        if count < MIN_OBSERVATIONS or not (changed or robust):
            break
    _orthonormalize(pose)
    h = np.zeros((6, 6))
    g = np.zeros(6)
    _normal_equations(pose, points, observations, inv_sigma2, used, False, fx, fy, cx, cy, bf, h, g)
    return pose, used, h

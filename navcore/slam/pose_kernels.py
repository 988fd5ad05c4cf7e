"""The compiled parts of finding one camera's pose; see :mod:`navcore.slam.pose` for the arguments."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from navcore.compiled import kernel
from navcore.geometry import FloatArray
from navcore.slam.lie import update_pose
from navcore.slam.pose_factor import add_factor, factor_cost
from navcore.slam.triple_kernels import fill_third_axis

BoolArray = NDArray[np.bool_]
Camera = tuple[float, float, float, float, float]
"""fx, fy, cx, cy in pixels, and bf, baseline × fx, in px·m."""
Point = tuple[float, float, float]

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
def _triple(rows: FloatArray, i: int) -> Point:
    return rows[i, 0], rows[i, 1], rows[i, 2]


@kernel
def _chi2(pose: FloatArray, x: Point, o: Point, w: float, camera: Camera) -> float:
    """Weighted squared error of one observation; infinite behind the camera."""
    pz = pose[2, 0] * x[0] + pose[2, 1] * x[1] + pose[2, 2] * x[2] + pose[2, 3]
    if pz < MIN_DEPTH_M:
        return np.inf
    px = pose[0, 0] * x[0] + pose[0, 1] * x[1] + pose[0, 2] * x[2] + pose[0, 3]
    py = pose[1, 0] * x[0] + pose[1, 1] * x[1] + pose[1, 2] * x[2] + pose[1, 3]
    u = camera[0] * px / pz + camera[2]
    e0 = u - o[0]
    e1 = camera[1] * py / pz + camera[3] - o[1]
    total = e0 * e0 + e1 * e1
    if not math.isnan(o[2]):
        e2 = u - camera[4] / pz - o[2]
        total += e2 * e2
    return float(total * w)


@kernel
def _chi2_across(pose: FloatArray, x: Point, o: Point, s: Point, w: float, camera: Camera) -> float:
    """Weighted squared error of one observation, but for that along its slide s; infinite behind the camera."""
    chi2 = _chi2(pose, x, o, w, camera)
    if (s[0] == 0.0 and s[1] == 0.0) or math.isinf(chi2):
        return chi2
    pz = pose[2, 0] * x[0] + pose[2, 1] * x[1] + pose[2, 2] * x[2] + pose[2, 3]
    px = pose[0, 0] * x[0] + pose[0, 1] * x[1] + pose[0, 2] * x[2] + pose[0, 3]
    py = pose[1, 0] * x[0] + pose[1, 1] * x[1] + pose[1, 2] * x[2] + pose[1, 3]
    u = camera[0] * px / pz + camera[2]
    along = s[0] * (u - o[0]) + s[1] * (camera[1] * py / pz + camera[3] - o[1])
    if not math.isnan(o[2]):
        along += s[2] * (u - camera[4] / pz - o[2])
    return float(chi2 - w * along * along)


@kernel
def _robust_cost(
    pose: FloatArray,
    points: FloatArray,
    observations: FloatArray,
    slides: FloatArray,
    inv_sigma2: FloatArray,
    used: BoolArray,
    robust: bool,
    camera: Camera,
    mean: FloatArray,
    information: FloatArray,
) -> float:
    """Return the cost of the used observations and of the factor."""
    total = factor_cost(pose, mean, information)
    for i in range(points.shape[0]):
        if not used[i]:
            continue
        limit = CHI2_MONO if math.isnan(observations[i, 2]) else CHI2_DEPTH
        chi2 = _chi2_across(
            pose, _triple(points, i), _triple(observations, i), _triple(slides, i), inv_sigma2[i], camera
        )
        if math.isinf(chi2):
            chi2 = 1e6
        if robust and chi2 > limit:
            chi2 = 2.0 * math.sqrt(limit * chi2) - limit
        total += chi2
    return total


@kernel
def _linearize(pose: FloatArray, x: Point, o: Point, camera: Camera, e: FloatArray, j: FloatArray) -> int:
    """Fill error e (3,) and Jacobian j (3, 6) of an observation; return its rows: 3 with depth, 0 behind the camera."""
    fx, fy, bf = camera[0], camera[1], camera[4]
    pz = pose[2, 0] * x[0] + pose[2, 1] * x[1] + pose[2, 2] * x[2] + pose[2, 3]
    if pz < MIN_DEPTH_M:
        return 0
    px = pose[0, 0] * x[0] + pose[0, 1] * x[1] + pose[0, 2] * x[2] + pose[0, 3]
    py = pose[1, 0] * x[0] + pose[1, 1] * x[1] + pose[1, 2] * x[2] + pose[1, 3]
    iz = 1.0 / pz
    u = fx * px * iz + camera[2]
    e[0] = u - o[0]
    e[1] = fy * py * iz + camera[3] - o[1]
    # Rows of d(u, v) / d(point); the point moves by ρ + φ × point.
    a, b = fx * iz, -fx * px * iz * iz
    c, d = fy * iz, -fy * py * iz * iz
    j[0, 0], j[0, 1], j[0, 2] = a, 0.0, b
    j[0, 3], j[0, 4], j[0, 5] = b * py, a * pz - b * px, -a * py
    j[1, 0], j[1, 1], j[1, 2] = 0.0, c, d
    j[1, 3], j[1, 4], j[1, 5] = -c * pz + d * py, -d * px, c * px
    if math.isnan(o[2]):
        return 2
    e[2] = u - bf * iz - o[2]
    f = b + bf * iz * iz
    j[2, 0], j[2, 1], j[2, 2] = a, 0.0, f
    j[2, 3], j[2, 4], j[2, 5] = f * py, a * pz - f * px, -a * py
    return 3


@kernel
def _hold_back(s: Point, rows: int, e: FloatArray, j: FloatArray) -> None:
    """Take out of error e (3,) and Jacobian j (3, 6) what lies along a slide."""
    along = 0.0
    for r in range(rows):
        along += s[r] * e[r]
    for r in range(rows):
        e[r] -= s[r] * along
    for k in range(6):
        along = 0.0
        for r in range(rows):
            along += s[r] * j[r, k]
        for r in range(rows):
            j[r, k] -= s[r] * along


@kernel
def _add_rows(e: FloatArray, j: FloatArray, rows: int, w: float, robust: bool, h: FloatArray, g: FloatArray) -> None:
    """Add the rows of one observation to g (6,) and to the upper half of h (6, 6)."""
    limit = CHI2_DEPTH if rows == 3 else CHI2_MONO
    chi2 = 0.0
    for r in range(rows):
        chi2 += w * e[r] * e[r]
    if robust and chi2 > limit:
        w *= math.sqrt(limit / chi2)
    for r in range(rows):
        for k in range(6):
            jw = j[r, k] * w
            g[k] += jw * e[r]
            for m in range(k, 6):
                h[k, m] += jw * j[r, m]


@kernel
def _normal_equations(
    pose: FloatArray,
    points: FloatArray,
    observations: FloatArray,
    slides: FloatArray,
    inv_sigma2: FloatArray,
    used: BoolArray,
    robust: bool,
    camera: Camera,
    mean: FloatArray,
    information: FloatArray,
    h: FloatArray,
    g: FloatArray,
) -> None:
    """Fill h (6, 6) = Σ JᵀWJ and g (6,) = Σ JᵀWe over the used observations and the factor."""
    h[:] = 0.0
    g[:] = 0.0
    j = np.empty((3, 6))
    e = np.empty(3)
    for i in range(len(points)):
        if used[i]:
            rows = _linearize(pose, _triple(points, i), _triple(observations, i), camera, e, j)
            if slides[i, 0] != 0.0 or slides[i, 1] != 0.0:
                _hold_back(_triple(slides, i), rows, e, j)
            _add_rows(e, j, rows, inv_sigma2[i], robust, h, g)
    for k in range(6):
        for m in range(k):
            h[k, m] = h[m, k]
    add_factor(pose, mean, information, h, g)


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
    fill_third_axis(pose)


@kernel
def _descend(
    pose: FloatArray,
    points: FloatArray,
    observations: FloatArray,
    slides: FloatArray,
    inv_sigma2: FloatArray,
    used: BoolArray,
    robust: bool,
    camera: Camera,
    mean: FloatArray,
    information: FloatArray,
) -> None:
    """One round of Levenberg–Marquardt on the used observations, in place."""
    h = np.empty((6, 6))
    g = np.empty(6)
    step = np.empty(6)
    trial = np.empty((4, 4))
    damping = 1e-5
    cost = _robust_cost(pose, points, observations, slides, inv_sigma2, used, robust, camera, mean, information)
    is_linearized = False
    for _ in range(_ITERATIONS):
        if not is_linearized:
            _normal_equations(
                pose, points, observations, slides, inv_sigma2, used, robust, camera, mean, information, h, g
            )
            is_linearized = True
        gain = -1.0
        length2 = np.inf
        trial_cost = cost
        if _solve6(h, g, damping, step):
            update_pose(pose, step, trial)
            trial_cost = _robust_cost(
                trial, points, observations, slides, inv_sigma2, used, robust, camera, mean, information
            )
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
    slides: FloatArray,
    inv_sigma2: FloatArray,
    used: BoolArray,
    camera: Camera,
) -> tuple[int, bool]:
    """Decide anew which observations are inliers; return how many are, and whether any changed sides."""
    changed = False
    count = 0
    for i in range(len(points)):
        limit = CHI2_MONO if math.isnan(observations[i, 2]) else CHI2_DEPTH
        inside = (
            _chi2_across(pose, _triple(points, i), _triple(observations, i), _triple(slides, i), inv_sigma2[i], camera)
            <= limit
        )
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
    slides: FloatArray,
    inv_sigma2: FloatArray,
    camera: Camera,
    mean: FloatArray,
    information: FloatArray,
) -> tuple[FloatArray, BoolArray, FloatArray]:
    """Refine a pose (4, 4) in place; return it, the inliers (n,) and the information (6, 6).

    ``camera`` is (fx, fy, cx, cy, bf); ``mean`` and ``information`` are those of a factor, zero where there is none.
    """
    has_factor = np.any(information != 0.0)
    used = np.ones(len(points), dtype=np.bool_)
    for round_index in range(_ROUNDS):
        robust = round_index < _ROUNDS - 2
        _descend(pose, points, observations, slides, inv_sigma2, used, robust, camera, mean, information)
        count, changed = _reclassify(pose, points, observations, slides, inv_sigma2, used, camera)
        if (count < MIN_OBSERVATIONS and not has_factor) or not (changed or robust):
            break
    _orthonormalize(pose)
    h = np.zeros((6, 6))
    g = np.zeros(6)
    _normal_equations(pose, points, observations, slides, inv_sigma2, used, False, camera, mean, information, h, g)
    return pose, used, h


@kernel
def has_slid(
    pose: FloatArray,
    points: FloatArray,
    observations: FloatArray,
    slides: FloatArray,
    inv_sigma2: FloatArray,
    camera: Camera,
) -> BoolArray:
    """Return which observations (n,) lie on an edge, but elsewhere on it than a pose (4, 4) puts their points."""
    away = np.zeros(len(points), np.bool_)
    for i in range(len(points)):
        if slides[i, 0] != 0.0 or slides[i, 1] != 0.0:
            limit = CHI2_MONO if math.isnan(observations[i, 2]) else CHI2_DEPTH
            away[i] = _chi2(pose, _triple(points, i), _triple(observations, i), inv_sigma2[i], camera) > limit
    return away

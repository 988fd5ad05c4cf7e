"""The compiled parts of bundle adjustment.

Shared arguments: ``camera`` (5,) is fx, fy, cx, cy in pixels and bf in px·m; observations are sorted by landmark, those
of landmark p being ``point_start[p] … point_start[p + 1]``; ``free`` (K,) is a key frame's index among the free ones or
−1; a step is a left-multiplied twist (translation, rotation) per free key frame.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from navcore.compiled import kernel
from navcore.geometry import FloatArray
from navcore.slam.lie import update_pose
from navcore.slam.pose_kernels import CHI2_DEPTH, CHI2_MONO, MIN_DEPTH_M

BoolArray = NDArray[np.bool_]
Int32Array = NDArray[np.int32]
Int64Array = NDArray[np.int64]

_BEHIND_CHI2 = 1e4
_POINT_FLOOR = 1e-6


@kernel
def _squared_error(camera: FloatArray, pose: FloatArray, x: FloatArray, uvr: FloatArray, w: float) -> float:
    pz = pose[2, 0] * x[0] + pose[2, 1] * x[1] + pose[2, 2] * x[2] + pose[2, 3]
    if pz < MIN_DEPTH_M:
        return np.inf
    px = pose[0, 0] * x[0] + pose[0, 1] * x[1] + pose[0, 2] * x[2] + pose[0, 3]
    py = pose[1, 0] * x[0] + pose[1, 1] * x[1] + pose[1, 2] * x[2] + pose[1, 3]
    u = camera[0] * px / pz + camera[2]
    e0 = u - uvr[0]
    e1 = camera[1] * py / pz + camera[3] - uvr[1]
    total = e0 * e0 + e1 * e1
    if not math.isnan(uvr[2]):
        e2 = u - camera[4] / pz - uvr[2]
        total += e2 * e2
    return float(total * w)


@kernel
def robust_cost(
    camera: FloatArray,
    keyframe: Int32Array,
    point: Int32Array,
    uvr: FloatArray,
    inv_sigma2: FloatArray,
    poses: FloatArray,
    points: FloatArray,
    used: BoolArray,
    robust: bool,
) -> float:
    """Return the sum of squared errors, beyond the χ² limits linear (Huber) where ``robust``."""
    total = 0.0
    for m in range(keyframe.shape[0]):
        if not used[m]:
            continue
        chi2 = _squared_error(camera, poses[keyframe[m]], points[point[m]], uvr[m], inv_sigma2[m])
        if math.isinf(chi2):
            chi2 = _BEHIND_CHI2
        limit = CHI2_MONO if math.isnan(uvr[m, 2]) else CHI2_DEPTH
        if robust and chi2 > limit:
            chi2 = 2.0 * math.sqrt(limit * chi2) - limit
        total += chi2
    return total


@kernel
def classify(
    camera: FloatArray,
    poses: FloatArray,
    points: FloatArray,
    keyframe: Int32Array,
    point: Int32Array,
    uvr: FloatArray,
    inv_sigma2: FloatArray,
    used: BoolArray,
) -> None:
    """Write into ``used`` (M,) which observations agree with poses and landmarks."""
    for m in range(keyframe.shape[0]):
        limit = CHI2_MONO if math.isnan(uvr[m, 2]) else CHI2_DEPTH
        used[m] = _squared_error(camera, poses[keyframe[m]], points[point[m]], uvr[m], inv_sigma2[m]) <= limit


@kernel
def observation_jacobians(
    camera: FloatArray, pose: FloatArray, x: FloatArray, uvr: FloatArray, e: FloatArray, jc: FloatArray, jp: FloatArray
) -> int:
    """Write error e (3,), its Jacobians by camera twist jc (3, 6) and by landmark jp (3, 3).

    Returns the number of rows: 0 behind the camera, 2 without depth, 3 with it.
    """
    pz = pose[2, 0] * x[0] + pose[2, 1] * x[1] + pose[2, 2] * x[2] + pose[2, 3]
    if pz < MIN_DEPTH_M:
        return 0
    px = pose[0, 0] * x[0] + pose[0, 1] * x[1] + pose[0, 2] * x[2] + pose[0, 3]
    py = pose[1, 0] * x[0] + pose[1, 1] * x[1] + pose[1, 2] * x[2] + pose[1, 3]
    iz = 1.0 / pz
    u = camera[0] * px * iz + camera[2]
    e[0] = u - uvr[0]
    e[1] = camera[1] * py * iz + camera[3] - uvr[1]
    a = camera[0] * iz
    b = -a * px * iz
    c = camera[1] * iz
    d = -c * py * iz
    jc[0, 0] = a
    jc[0, 1] = 0.0
    jc[0, 2] = b
    jc[0, 3] = b * py
    jc[0, 4] = a * pz - b * px
    jc[0, 5] = -a * py
    jc[1, 0] = 0.0
    jc[1, 1] = c
    jc[1, 2] = d
    jc[1, 3] = d * py - c * pz
    jc[1, 4] = -d * px
    jc[1, 5] = c * px
    for k in range(3):
        jp[0, k] = a * pose[0, k] + b * pose[2, k]
        jp[1, k] = c * pose[1, k] + d * pose[2, k]
    if math.isnan(uvr[2]):
        return 2
    e[2] = u - camera[4] * iz - uvr[2]
    f = b + camera[4] * iz * iz
    jc[2, 0] = a
    jc[2, 1] = 0.0
    jc[2, 2] = f
    jc[2, 3] = f * py
    jc[2, 4] = a * pz - f * px
    jc[2, 5] = -a * py
    for k in range(3):
        jp[2, k] = a * pose[0, k] + f * pose[2, k]
    return 3


@kernel
def linearize(  # noqa: C901
    camera: FloatArray,
    keyframe: Int32Array,
    point: Int32Array,
    uvr: FloatArray,
    inv_sigma2: FloatArray,
    free: Int32Array,
    poses: FloatArray,
    points: FloatArray,
    used: BoolArray,
    robust: bool,
    hcc: FloatArray,
    gc: FloatArray,
    hpp: FloatArray,
    gp: FloatArray,
    hcp: FloatArray,
) -> None:
    """Fill the normal equations: cameras hcc (C, 6, 6), gc; points hpp (N, 3, 3), gp; both hcp (M, 6, 3)."""
    hcc[:] = 0.0
    gc[:] = 0.0
    hpp[:] = 0.0
    gp[:] = 0.0
    e = np.empty(3)
    jc = np.empty((3, 6))
    jp = np.empty((3, 3))
    for m in range(keyframe.shape[0]):
        k = keyframe[m]
        c = free[k]
        p = point[m]
        for i in range(6):
            for j in range(3):
                hcp[m, i, j] = 0.0
        if not used[m]:
            continue
        rows = observation_jacobians(camera, poses[k], points[p], uvr[m], e, jc, jp)
        chi2 = 0.0
        for r in range(rows):
            chi2 += e[r] * e[r]
        w = inv_sigma2[m]
        chi2 *= w
        limit = CHI2_DEPTH if rows == 3 else CHI2_MONO
        if robust and chi2 > limit:
            w *= math.sqrt(limit / chi2)
        for r in range(rows):
            for i in range(3):
                jw = w * jp[r, i]
                gp[p, i] += jw * e[r]
                for j in range(3):
                    hpp[p, i, j] += jw * jp[r, j]
            if c < 0:
                continue
            for i in range(6):
                jw = w * jc[r, i]
                gc[c, i] += jw * e[r]
                for j in range(i, 6):
                    hcc[c, i, j] += jw * jc[r, j]
                for j in range(3):
                    hcp[m, i, j] += jw * jp[r, j]
    for c in range(hcc.shape[0]):
        for i in range(6):
            for j in range(i):
                hcc[c, i, j] = hcc[c, j, i]


@kernel
def damp_points(hpp: FloatArray, damping: float) -> FloatArray:
    """Return the inverses (N, 3, 3) of the landmarks' blocks, their diagonals made larger by ``damping``."""
    out = np.empty_like(hpp)
    for p in range(hpp.shape[0]):
        a = hpp[p, 0, 0] * (1.0 + damping) + _POINT_FLOOR
        d = hpp[p, 1, 1] * (1.0 + damping) + _POINT_FLOOR
        f = hpp[p, 2, 2] * (1.0 + damping) + _POINT_FLOOR
        b = hpp[p, 0, 1]
        c = hpp[p, 0, 2]
        e = hpp[p, 1, 2]
        m00 = d * f - e * e
        m01 = c * e - b * f
        m02 = b * e - c * d
        inv = 1.0 / (a * m00 + b * m01 + c * m02)
        out[p, 0, 0] = m00 * inv
        out[p, 0, 1] = m01 * inv
        out[p, 0, 2] = m02 * inv
        out[p, 1, 0] = m01 * inv
        out[p, 1, 1] = (a * f - c * c) * inv
        out[p, 1, 2] = (b * c - a * e) * inv
        out[p, 2, 0] = m02 * inv
        out[p, 2, 1] = out[p, 1, 2]
        out[p, 2, 2] = (a * d - b * b) * inv
    return out


@kernel
def pair_blocks(  # noqa: C901
    keyframe: Int32Array, free: Int32Array, point_start: Int64Array, cameras: int
) -> tuple[Int32Array, Int32Array, Int32Array]:
    """Number the pairs of free key frames that share a landmark.

    Returns ``block_of`` (C, C) with the number of the pair (row ≤ col) or −1, and the row and col (B,) of each block.
    """
    block_of = np.full((cameras, cameras), -1, dtype=np.int32)
    for c in range(cameras):
        block_of[c, c] = 0
    for p in range(point_start.shape[0] - 1):
        for m in range(point_start[p], point_start[p + 1]):
            i = free[keyframe[m]]
            if i < 0:
                continue
            for n in range(m, point_start[p + 1]):
                j = free[keyframe[n]]
                if j >= 0:
                    block_of[min(i, j), max(i, j)] = 0
    count = 0
    for i in range(cameras):
        for j in range(i, cameras):
            if block_of[i, j] == 0:
                block_of[i, j] = count
                count += 1
    row = np.empty(count, dtype=np.int32)
    col = np.empty(count, dtype=np.int32)
    for i in range(cameras):
        for j in range(i, cameras):
            if block_of[i, j] >= 0:
                row[block_of[i, j]] = i
                col[block_of[i, j]] = j
    return block_of, row, col


@kernel
def eliminate(  # noqa: C901
    keyframe: Int32Array,
    free: Int32Array,
    point_start: Int64Array,
    used: BoolArray,
    hcc: FloatArray,
    gc: FloatArray,
    gp: FloatArray,
    hcp: FloatArray,
    inverse: FloatArray,
    damping: float,
    block_of: Int32Array,
    block_count: int,
) -> tuple[FloatArray, FloatArray]:
    """Eliminate the landmarks: returns the upper blocks (B, 6, 6) of the reduced system and its right side (C, 6)."""
    blocks = np.zeros((block_count, 6, 6))
    rhs = np.empty_like(gc)
    for c in range(hcc.shape[0]):
        b = block_of[c, c]
        for i in range(6):
            rhs[c, i] = -gc[c, i]
            for j in range(6):
                blocks[b, i, j] = hcc[c, i, j]
            blocks[b, i, i] += damping * hcc[c, i, i] + _POINT_FLOOR
    y = np.empty((6, 3))
    for p in range(point_start.shape[0] - 1):
        for m in range(point_start[p], point_start[p + 1]):
            ci = free[keyframe[m]]
            if ci < 0 or not used[m]:
                continue
            for i in range(6):
                for j in range(3):
                    y[i, j] = (
                        hcp[m, i, 0] * inverse[p, 0, j]
                        + hcp[m, i, 1] * inverse[p, 1, j]
                        + hcp[m, i, 2] * inverse[p, 2, j]
                    )
                rhs[ci, i] += y[i, 0] * gp[p, 0] + y[i, 1] * gp[p, 1] + y[i, 2] * gp[p, 2]
            # Observations of a landmark are sorted by key frame, and so are the free indices: j ≥ i.
            for n in range(m, point_start[p + 1]):
                cj = free[keyframe[n]]
                if cj < 0 or not used[n]:
                    continue
                b = block_of[ci, cj]
                for i in range(6):
                    y0, y1, y2 = y[i, 0], y[i, 1], y[i, 2]
                    for j in range(6):
                        blocks[b, i, j] -= y0 * hcp[n, j, 0] + y1 * hcp[n, j, 1] + y2 * hcp[n, j, 2]
                if ci == cj and m != n:
                    for i in range(6):
                        for j in range(6):
                            blocks[b, j, i] -= y[i, 0] * hcp[n, j, 0] + y[i, 1] * hcp[n, j, 1] + y[i, 2] * hcp[n, j, 2]
    return blocks, rhs


@kernel
def back_substitute(
    keyframe: Int32Array,
    free: Int32Array,
    point_start: Int64Array,
    used: BoolArray,
    gp: FloatArray,
    hcp: FloatArray,
    inverse: FloatArray,
    step_c: FloatArray,
) -> FloatArray:
    """Return the landmarks' steps (N, 3) that belong to the cameras' steps (C, 6)."""
    out = np.empty_like(gp)
    s = np.empty(3)
    for p in range(point_start.shape[0] - 1):
        for j in range(3):
            s[j] = -gp[p, j]
        for m in range(point_start[p], point_start[p + 1]):
            c = free[keyframe[m]]
            if c < 0 or not used[m]:
                continue
            for j in range(3):
                for i in range(6):
                    s[j] -= hcp[m, i, j] * step_c[c, i]
        for j in range(3):
            out[p, j] = inverse[p, j, 0] * s[0] + inverse[p, j, 1] * s[1] + inverse[p, j, 2] * s[2]
    return out


@kernel
def step_cameras(poses: FloatArray, free: Int32Array, step_c: FloatArray) -> FloatArray:
    """Return the poses (K, 4, 4) after the step of the free ones."""
    out = poses.copy()
    for k in range(poses.shape[0]):
        if free[k] >= 0:
            update_pose(poses[k], step_c[free[k]], out[k])
    return out


@kernel
def step_points(points: FloatArray, step_p: FloatArray) -> FloatArray:
    """Return the landmarks (N, 3) after the step; one that would move more than 10 m stays, it is not determined."""
    out = points.copy()
    for p in range(points.shape[0]):
        if step_p[p, 0] ** 2 + step_p[p, 1] ** 2 + step_p[p, 2] ** 2 < 100.0:
            for j in range(3):
                out[p, j] += step_p[p, j]
    return out

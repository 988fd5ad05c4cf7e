"""The compiled parts of aligning views by their shading; see :mod:`navcore.slam.shading_alignment`."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from navcore.compiled import kernel
from navcore.geometry import FloatArray
from navcore.slam.depth_kernels import Surface
from navcore.slam.keyframes import ByteArray

MAX_STEP = 6
"""Grey levels between neighbouring cells beyond which they hold an edge: its grey depends on where the pixels lie."""
NUISANCES = 4
"""Gain, offset, and two terms of a lens that darkens towards the corners."""
ROBUST_LEVELS = 1.5
"""Grey levels of error beyond which a cell counts for less."""
DEPTH_GATE_M = 0.05
DEPTH_GATE_SHARE = 0.05
"""A cell shows the same place where its depth differs by less than this, and this share of the depth."""

MaskArray = NDArray[np.bool_]


@kernel
def calm_cells(grey: ByteArray) -> MaskArray:
    """Return which cells (rows, columns) differ little from their eight neighbours, and are neither black nor white."""
    rows, columns = grey.shape
    calm = np.zeros((rows, columns), np.bool_)
    for row in range(1, rows - 1):
        for column in range(1, columns - 1):
            middle = np.int32(grey[row, column])
            most = np.int32(0)
            for dy in range(-1, 2):
                for dx in range(-1, 2):
                    most = max(most, abs(np.int32(grey[row + dy, column + dx]) - middle))
            calm[row, column] = most <= MAX_STEP and 5 < middle < 250
    return calm


@kernel
def _grey_at(grey: ByteArray, calm: MaskArray, u: float, v: float) -> tuple[bool, float, float, float]:
    """Return whether the grey at a place is known, the grey between the four cells around it, and its slopes."""
    left, top = math.floor(u), math.floor(v)
    if left < 0 or left + 1 >= grey.shape[1] or top < 0 or top + 1 >= grey.shape[0]:
        return False, 0.0, 0.0, 0.0
    if not (calm[top, left] and calm[top, left + 1] and calm[top + 1, left] and calm[top + 1, left + 1]):
        return False, 0.0, 0.0, 0.0
    a, b = float(grey[top, left]), float(grey[top, left + 1])
    c, d = float(grey[top + 1, left]), float(grey[top + 1, left + 1])
    du, dv = u - left, v - top
    across = (1.0 - dv) * (b - a) + dv * (d - c)
    down = (1.0 - du) * (c - a) + du * (d - b)
    return True, a + du * (b - a) + dv * down, across, down


@kernel
def _add_row(j: FloatArray, e: float, w: float, h: FloatArray, g: FloatArray) -> None:
    """Add one weighted error with its Jacobian j (n,) to g (n,) and to the upper half of h (n, n)."""
    for i in range(len(j)):
        jw = w * j[i]
        g[i] += jw * e
        for m in range(i, len(j)):
            h[i, m] += jw * j[m]


@kernel
def accumulate_shading(
    model: Surface,
    model_grey: ByteArray,
    model_calm: MaskArray,
    seen: Surface,
    seen_grey: ByteArray,
    seen_calm: MaskArray,
    seen_from_model: FloatArray,
    pinhole: tuple[float, float, float, float],
    motions: FloatArray,
    nuisances: FloatArray,
    h: FloatArray,
    g: FloatArray,
) -> tuple[float, int]:
    """Fill the normal equations h (n, n), g (n,) of the differences in grey between two views.

    The unknowns are steps along ``motions`` (k, 6), twists of the camera, and changes of the ``nuisances``
    (NUISANCES,). Return the sum of the weighted squares and how many cells were compared.
    """
    h[:] = 0.0
    g[:] = 0.0
    t = seen_from_model
    fx, fy, cx, cy = pinhole
    k = len(motions)
    n = k + NUISANCES
    j = np.empty(n)
    squares, count = 0.0, 0
    for row in range(model_grey.shape[0]):
        for column in range(model_grey.shape[1]):
            mx, my, mz = model[row, column, 0], model[row, column, 1], model[row, column, 2]
            if mz <= 0.0 or not model_calm[row, column]:
                continue
            x = t[0, 0] * mx + t[0, 1] * my + t[0, 2] * mz + t[0, 3]
            y = t[1, 0] * mx + t[1, 1] * my + t[1, 2] * mz + t[1, 3]
            z = t[2, 0] * mx + t[2, 1] * my + t[2, 2] * mz + t[2, 3]
            if z < 0.1:
                continue
            u, v = fx * x / z + cx, fy * y / z + cy
            is_seen, here, across, down = _grey_at(seen_grey, seen_calm, u, v)
            if not is_seen:
                continue
            depth = seen[int(v + 0.5), int(u + 0.5), 2]
            if depth <= 0.0 or abs(depth - z) > DEPTH_GATE_M + DEPTH_GATE_SHARE * z:
                continue
            there = float(model_grey[row, column])
            off, off_there = (x * x + y * y) / (z * z), (mx * mx + my * my) / (mz * mz)
            j[k], j[k + 1] = -there, -1.0
            j[k + 2], j[k + 3] = -there * (off - off_there), -there * (off * off - off_there * off_there)
            e = here
            for i in range(NUISANCES):
                e += nuisances[i] * j[k + i]
            for i in range(k):
                px = motions[i, 0] + motions[i, 4] * z - motions[i, 5] * y
                py = motions[i, 1] + motions[i, 5] * x - motions[i, 3] * z
                pz = motions[i, 2] + motions[i, 3] * y - motions[i, 4] * x
                j[i] = across * fx * (px - x * pz / z) / z + down * fy * (py - y * pz / z) / z
            w = 1.0 if abs(e) <= ROBUST_LEVELS else ROBUST_LEVELS / abs(e)
            squares += w * e * e
            count += 1
            _add_row(j, e, w, h, g)
    for i in range(n):
        for m in range(i):
            h[i, m] = h[m, i]
    return squares, count

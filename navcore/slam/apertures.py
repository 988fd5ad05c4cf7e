"""Which features lie on a straight edge: they look the same all along it, and say nothing of where along it they are.

A corner detector fires on the stairs of pixels along a slanted edge as well. Through the aperture of a descriptor such
a stair stays where it is in the image while the camera moves along the edge (the skirting boards of a corridor): many
of them agree that nobody moves. What an edge does tell is the distance across it. So each of these features gets the
direction in which it can slide, and its error along that direction does not count (Shi and Tomasi 1994 for the test).
"""

from __future__ import annotations

import math

import numpy as np

from navcore.compiled import kernel
from navcore.geometry import FloatArray
from navcore.slam.descriptors import SumArray
from navcore.slam.keyframes import IntArray
from navcore.types import DepthImage

RADIUS_PX = 8
"""Gradients are summed over squares that reach so far from a corner, in pixels of its pyramid level."""
ROW_STRIDE_PX = 3
"""Every third row is looked at; the image is smoothed."""
EDGE_RATIO = 0.03
"""Smaller over larger eigenvalue of the gradients' scatter, below which a corner is an edge: stairs 0.005–0.015, plain
corners 0.1–0.6, blurred ones from 0.03 on."""
REACH_PX = 5.0
"""How far along an edge its depth is looked at on both sides, in pixels of the pyramid level."""


@kernel
def edge_directions(sums: SumArray, corners: IntArray) -> FloatArray:
    """Return the unit direction (n, 2) of the edge on which each corner (n, ≥2) of a pyramid level lies, else 0.

    ``sums`` (h, w) are those of :func:`navcore.slam.descriptors.box_sums`.
    """
    directions = np.zeros((len(corners), 2))
    width = sums.shape[1]
    flat = sums.reshape(-1)
    for i in range(len(corners)):
        xx, xy, yy = 0.0, 0.0, 0.0
        for dy in range(-RADIUS_PX, RADIUS_PX, ROW_STRIDE_PX):
            first = (corners[i, 1] + dy) * width + corners[i, 0] - RADIUS_PX
            left, right = np.uintp(first - 1), np.uintp(first + 1)
            above, below = np.uintp(first - width), np.uintp(first + width)
            row_xx, row_xy, row_yy = np.int32(0), np.int32(0), np.int32(0)
            for k in range(np.uintp(2 * RADIUS_PX)):
                gx = np.int32(flat[right + k]) - np.int32(flat[left + k])
                gy = np.int32(flat[below + k]) - np.int32(flat[above + k])
                row_xx = np.int32(row_xx + gx * gx)
                row_xy = np.int32(row_xy + gx * gy)
                row_yy = np.int32(row_yy + gy * gy)
            xx += row_xx
            xy += row_xy
            yy += row_yy
        half, root = 0.5 * (xx + yy), math.sqrt(0.25 * (xx - yy) ** 2 + xy * xy)
        if half - root >= EDGE_RATIO * (half + root):
            continue
        # Across the edge lies the eigenvector of the larger eigenvalue; of two ways to write it the longer one.
        a, b = (half + root - yy, xy) if xx > yy else (xy, half + root - xx)
        length = math.sqrt(a * a + b * b)
        if length > 0.0:
            directions[i, 0], directions[i, 1] = -b / length, a / length
    return directions


@kernel
def slides_of(
    directions: FloatArray, raw_px: FloatArray, reach_px: FloatArray, depth_m: DepthImage, bf_px_m: float
) -> FloatArray:
    """Return the unit direction in u, v, u_r (n, 3) in which each feature can slide, 0 where it cannot.

    ``directions`` (n, 2) are those of edges at ``raw_px`` (n, 2); the depth ``reach_px`` (n,) on both sides tells how
    u_r changes along them.
    """
    slides = np.zeros((len(directions), 3))
    height, width = depth_m.shape
    for i in range(len(directions)):
        dx, dy = directions[i, 0], directions[i, 1]
        if dx == 0.0 and dy == 0.0:
            continue
        disparity = np.zeros(3)
        for side in range(3):
            step = (side - 1) * reach_px[i]
            x = math.floor(raw_px[i, 0] + step * dx + 0.5)
            y = math.floor(raw_px[i, 1] + step * dy + 0.5)
            inside = 0 <= x < width and 0 <= y < height
            disparity[side] = bf_px_m / depth_m[y, x] if inside else np.nan
        slope = 0.0
        if disparity[2] > 0.0 and disparity[0] > 0.0 and math.isfinite(disparity[2] - disparity[0]):
            slope = (disparity[2] - disparity[0]) / (2.0 * reach_px[i])
        dr = dx - slope if disparity[1] > 0.0 else 0.0
        length = math.sqrt(1.0 + dr * dr)
        slides[i, 0], slides[i, 1], slides[i, 2] = dx / length, dy / length, dr / length
    return slides

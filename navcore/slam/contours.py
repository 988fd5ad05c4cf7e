"""Which features lie on the contour of something nearer than what is behind it.

Where the end of a wall hides what lies behind, the picture has corners that are nowhere in the world: there the contour
crosses what it hides, and they move along with whoever looks. Their depth may be that of either side. Between blank
walls there are hardly any other features, and many of them agree on a pose that is wrong. So what lies on a contour
counts as not measured in depth; a landmark it becomes only where parallax from several places says the same.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from navcore.compiled import kernel
from navcore.geometry import FloatArray
from navcore.types import DepthImage

REACH_PX = 3.0
"""How far from a corner a contour is looked for, in pixels of its pyramid level: corners lie beside what they mark."""
MIN_JUMP = 0.2
"""Bend of the inverse depth, as a share of it, that is a contour: on a plane it changes evenly, however steep that is,
and where two walls meet it bends by less."""


@kernel
def _inverse_depth(depth_m: DepthImage, u: float, v: float) -> float:
    """Return the inverse depth of the pixel at a place, NaN where none was measured or outside the image."""
    x, y = math.floor(u + 0.5), math.floor(v + 0.5)
    height, width = depth_m.shape
    if 0 <= y < height and 0 <= x < width and depth_m[y, x] > 0.0:
        return float(1.0 / depth_m[y, x])
    return math.nan


@kernel
def on_contour(raw_px: FloatArray, reach_px: FloatArray, depth_m: DepthImage) -> NDArray[np.bool_]:
    """Return which places (n, 2) of a depth image (h, w) have a contour within ``reach_px`` (n,).

    On each of four lines through a place, both ends are compared with its middle.
    """
    found = np.zeros(len(raw_px), np.bool_)
    for i in range(len(raw_px)):
        u, v = raw_px[i, 0], raw_px[i, 1]
        here = _inverse_depth(depth_m, u, v)
        for line in range(4):
            du, dv = reach_px[i] * math.cos(line * math.pi / 4), reach_px[i] * math.sin(line * math.pi / 4)
            bend = _inverse_depth(depth_m, u - du, v - dv) + _inverse_depth(depth_m, u + du, v + dv) - 2.0 * here
            # Where something was not measured, this is false.
            if abs(bend) > MIN_JUMP * here:
                found[i] = True
    return found

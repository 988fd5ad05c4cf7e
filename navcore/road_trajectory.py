"""Roads as a trajectory (TUM format), for programs that show trajectories.

A road has no times: it is walked through at the usual speed, and between two roads the clock jumps, so that whoever
reads the file sees where one ends. The poses look along the road: x forward, z up.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import ArrayLike

from navcore.cues.announcements import USUAL_SPEED_M_S
from navcore.geometry import Transform
from navcore.planning.road_joining import SPACING_M, evenly_spaced

PAUSE_S = 10.0
"""Between the end of a road and the beginning of the next."""
COMMENT = (
    f"Roads have no times: stamps are metres along the road at {USUAL_SPEED_M_S:g} m/s, and {PAUSE_S:g} s pass between"
    f" two roads.\nPoints every {SPACING_M:g} m on the floor (z = 0), in metres of the map; x looks along the road."
)
"""What the file says of itself at its top."""


def road_poses(roads_m: Iterable[ArrayLike]) -> Iterator[tuple[float, Transform]]:
    """Return stamps (s) and poses along roads, polylines (n, 2) or (n, 3), one after the other."""
    stamp_s = 0.0
    for road in roads_m:
        line = evenly_spaced(np.asarray(road, dtype=np.float64)[:, :2], SPACING_M)
        steps = np.diff(line, axis=0)
        lengths_m = np.hypot(*steps.T)
        headings_rad = np.arctan2(steps[:, 1], steps[:, 0])
        arcs_m = np.concatenate([[0.0], np.cumsum(lengths_m)])
        for (x_m, y_m), arc_m, heading_rad in zip(line, arcs_m, [*headings_rad, headings_rad[-1]], strict=True):
            half_rad = 0.5 * float(heading_rad)
            quat_xyzw = np.array([0.0, 0.0, math.sin(half_rad), math.cos(half_rad)])
            yield (
                stamp_s + float(arc_m) / USUAL_SPEED_M_S,
                Transform.from_quat_xyzw(quat_xyzw, np.array([x_m, y_m, 0.0])),
            )
        stamp_s += float(arcs_m[-1]) / USUAL_SPEED_M_S + PAUSE_S

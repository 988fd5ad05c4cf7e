"""How fast the walker moves, from their last poses."""

from __future__ import annotations

import math

from device_agent.state import TrailPoint
from navcore.types import Pose2D

WINDOW_S = 1.0
_MIN_SPAN_S = 0.3


def extended_trail(trail: tuple[TrailPoint, ...], stamp_s: float, pose: Pose2D | None) -> tuple[TrailPoint, ...]:
    """Return the trail with the newest pose, and without what is older than a second; a lost pose ends it."""
    if pose is None:
        return ()
    recent = tuple(point for point in trail if stamp_s - WINDOW_S <= point[0] < stamp_s)
    return (*recent, (stamp_s, pose.x_m, pose.y_m))


def speed_m_s(trail: tuple[TrailPoint, ...]) -> float | None:
    """Return the speed over ground along the trail, or None where it is too short to say.

    From end to end, not summed step by step: the jitter of the poses would otherwise look like walking.
    """
    if len(trail) < 2 or trail[-1][0] - trail[0][0] < _MIN_SPAN_S:
        return None
    (begin_s, x0, y0), (end_s, x1, y1) = trail[0], trail[-1]
    return math.hypot(x1 - x0, y1 - y0) / (end_s - begin_s)

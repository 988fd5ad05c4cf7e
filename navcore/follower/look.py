"""Looking for a way round: the camera sees a third of what is ahead, so a way may lie just beside the picture.

Somebody who has stood for a while before what blocks the expected direction is turned to one side, then to the other,
then back. Turning on the spot needs no free space.
"""

from __future__ import annotations

import math

import numpy as np

from navcore.angles import RelativeAngle, WorldAngle, relative_angle, world_angle
from navcore.types import ObstacleScan

LOOK_RAD = math.radians(30.0)
"""How far to the side is looked: what was the edge of the picture is its middle then."""
LOOK_AFTER_S = 2.0
"""Time to wait first: people who stand in the way mostly walk on."""
SIDES = 2
LOOK_ROUND = relative_angle(math.radians(45.0))
"""Who is lost is turned by so much at a time, always to the same side."""
LOOK_ROUND_AFTER_S, LOOK_ROUND_FOR_S = 4.0, 40.0
"""Most are found again at once; and once round, with the time to hear each turn and to make it, is enough."""
_SEES_M = 3.0


def look_target(
    expected: WorldAngle, scan: ObstacleScan, last: WorldAngle | None, error: RelativeAngle, look_count: int
) -> WorldAngle:
    """Return the direction to look in: the more open side first, then the other one.

    Args:
        expected: θ_exp.
        scan: what is seen now.
        last: the direction that was just looked in; None for somebody who faces the expected direction.
        error: θ_exp relative to the heading.
        look_count: sides that have been looked at.
    """
    first_is_left = is_left_more_open(scan, error) == (look_count == 0)
    left = first_is_left if last is None else math.sin(last - expected) <= 0.0
    return world_angle(expected + LOOK_RAD if left else expected - LOOK_RAD)


def is_left_more_open(scan: ObstacleScan, error: RelativeAngle) -> bool:
    """Return whether there is more free space left of the expected direction than right of it."""
    open_m = np.nan_to_num(np.minimum(scan.nearest_m, _SEES_M), nan=0.0, posinf=_SEES_M)
    left = scan.bearing_rad > error
    return float(open_m[left].sum()) >= float(open_m[~left].sum())

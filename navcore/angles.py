"""Angles, in radians, counter-clockwise seen from above, so that left is positive.

Eq. 4 of the paper mixes angles in the world (θ_exp, θ_c) with angles relative to the heading (θ_i). They are
different types here, and only :func:`relative_to` and :func:`in_world` lead from one to the other.
"""

from __future__ import annotations

import math
from typing import NewType

WorldAngle = NewType("WorldAngle", float)
"""Direction in the world, radians from +x, in [0, 2π)."""

RelativeAngle = NewType("RelativeAngle", float)
"""Direction relative to the heading, radians, in (−π, π]; positive is to the left."""


def wrap_rad(angle_rad: float) -> float:
    """Return the same direction in (−π, π]."""
    wrapped = math.remainder(angle_rad, math.tau)
    return math.pi if wrapped <= -math.pi else wrapped


def world_angle(angle_rad: float) -> WorldAngle:
    """Return the direction as a world angle in [0, 2π)."""
    wrapped = angle_rad % math.tau
    # For a tiny negative angle the floating-point remainder is 2π itself.
    return WorldAngle(0.0 if wrapped >= math.tau else wrapped)


def relative_angle(angle_rad: float) -> RelativeAngle:
    """Return the direction as a relative angle in (−π, π]."""
    return RelativeAngle(wrap_rad(angle_rad))


def relative_to(direction: WorldAngle, heading: WorldAngle) -> RelativeAngle:
    """Return ``direction`` seen by somebody who heads towards ``heading``."""
    return relative_angle(direction - heading)


def in_world(direction: RelativeAngle, heading: WorldAngle) -> WorldAngle:
    """Return in the world what is ``direction`` for somebody who heads towards ``heading``."""
    return world_angle(heading + direction)

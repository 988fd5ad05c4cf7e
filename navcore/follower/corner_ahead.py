"""The next corner of the route, foreseen: what the walker is told of ahead, and sees coming. It decides nothing."""

from __future__ import annotations

import numpy as np

from navcore.angles import relative_angle
from navcore.follower.road_centred import next_corner, stopping_distance_m
from navcore.settings import FollowerSettings
from navcore.types import CornerAhead, Route, SubGoal

FORESEEN_M = 12.0
"""No corner farther ahead than this is told of."""
_ROUNDED_M = 1.0
"""A recorded corner is rounded: the other half of one that was passed is no other one."""
_EARLY_M = 0.5
"""Eq. 2 takes the beginning of a rounded corner for the turning point, which lies so far before its middle."""


def corner_ahead(
    route: Route, closest_index: int, goal: SubGoal, speed_m_s: float, settings: FollowerSettings
) -> CornerAhead | None:
    """Return the next corner at which the walker will be turned on the spot; None where none can be foreseen.

    Args:
        route: the paper's W.
        closest_index: P_cls.
        goal: P_G; it says which turning points have been passed.
        speed_m_s: how fast the walker has been walking lately.
        settings: the policy, and what counts as a corner.
    """
    arcs = route.arc_length_m
    at_m, begin = float(arcs[closest_index]), closest_index
    if goal.passed_index > 0:
        begin = max(begin, int(np.searchsorted(arcs, float(arcs[goal.passed_index]) + _ROUNDED_M)))
    corner = next_corner(route, begin, at_m + FORESEEN_M, settings)
    if corner is None:
        return None
    distance_m = float(arcs[corner.route_index]) - at_m
    if settings.policy == "paper":
        turn_m = settings.turning_reached_m + _EARLY_M
    else:
        turn_m = max(stopping_distance_m(speed_m_s, settings.reaction_s), settings.corner_reached_m)
    return CornerAhead(corner.route_index, distance_m, relative_angle(corner.bend_rad), turn_m)

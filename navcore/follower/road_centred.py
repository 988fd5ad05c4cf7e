"""The policy ``road_centred``: stay on the middle of the road, instead of only reaching the next sub-goal.

The paper's Eq. 4 says "straight ahead" until the walker is 1.0 m off the route or 30° off its direction, and a sub-goal
3 m ahead cuts corners. Here the walker is led all the time towards a point of the road a little ahead: as far as they
walk in the time in which an instruction takes effect (pure pursuit: R. Coulter, CMU-RI-TR-92-01, 1992). A shorter look
ahead would swing from side to side, for what is heard now is walked only after the reaction time.

A corner too sharp to be steered round is walked up to, and turned at, on the spot; the turn is announced ahead by the
distance that this walker needs to hear it and to come to a stand. Pure functions.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from navcore.angles import WorldAngle
from navcore.follower.direction import expected_direction
from navcore.geometry import FloatArray
from navcore.settings import FollowerSettings
from navcore.types import DecisionTrace, Pose2D, Route, SubGoal, SubGoalCase

BRAKING_M_S2 = 1.2
"""How people who walk come to a stand (K. Hase, R. Stein, J. Neurophysiology 80, 1998)."""
_ARM_M = 0.6
"""A corner is a bend between the directions of the road so far before and behind it: recorded corners are rounded."""
_SPEED_MEMORY_S = 0.5
_FASTEST_M_S = 2.0
_LONGEST_GAP_S = 1.0


@dataclass(frozen=True, slots=True)
class Corner:
    """A bend of the road too sharp to be steered round while walking."""

    route_index: int
    bend_rad: float
    """Left positive."""


def walking_speed_m_s(before: DecisionTrace, gap_s: float, pose: Pose2D) -> float:
    """Return how fast the walker has been walking lately, m/s, from the frame before, ``gap_s`` ago; 0 if unknown."""
    if before.position is None or not 0.0 < gap_s <= _LONGEST_GAP_S:
        return 0.0
    moved_m = math.hypot(pose.x_m - before.position[0], pose.y_m - before.position[1])
    share = 1.0 - math.exp(-gap_s / _SPEED_MEMORY_S)
    return before.speed_m_s + share * (min(moved_m / gap_s, _FASTEST_M_S) - before.speed_m_s)


def stopping_distance_m(speed_m_s: float, settings: FollowerSettings) -> float:
    """Return how far the walker goes on after an instruction to stop begins: reaction, then braking."""
    return speed_m_s * settings.reaction_s + speed_m_s**2 / (2.0 * BRAKING_M_S2)


def look_ahead_m(speed_m_s: float, settings: FollowerSettings) -> float:
    """Return how far ahead on the road the walker is led to."""
    return max(settings.min_look_ahead_m, speed_m_s * (settings.reaction_s + settings.lead_s))


def next_corner(route: Route, from_index: int, until_m: float, settings: FollowerSettings) -> Corner | None:
    """Return the first sharp corner of the route after a point, up to an arc length, or None.

    A corner lies where the bend, seen over a short piece of road before and behind, is sharpest.
    """
    arcs, points = route.arc_length_m, route.points_m
    last = int(np.searchsorted(arcs, min(until_m, route.length_m - _ARM_M), side="right"))
    middle = np.arange(max(1, from_index), last)
    if len(middle) == 0:
        return None
    bends = _bends_rad(points, arcs, middle)
    sharp = np.abs(bends) >= math.radians(settings.corner_angle_deg)
    if not bool(sharp.any()):
        return None
    first = int(np.argmax(sharp))
    after = np.flatnonzero(~sharp[first:])
    end = first + int(after[0]) if len(after) else len(sharp)
    apex = first + int(np.argmax(np.abs(bends[first:end])))
    return Corner(int(middle[apex]), float(bends[apex]))


def select_aim(
    route: Route,
    closest_index: int,
    speed_m_s: float,
    previous: SubGoal | None,
    settings: FollowerSettings,
) -> SubGoal:
    """Return the point of the road that the walker is led to now.

    A corner (case 2) holds the walker on the road before it, until they are as near as they need to come to a stand;
    from then on the road behind it counts. The paper's cases 1 and 3 are a point on the way, and the destination.
    """
    passed = 0 if previous is None else previous.passed_index
    arcs = route.arc_length_m
    ahead_m = look_ahead_m(speed_m_s, settings)
    needed_m = stopping_distance_m(speed_m_s, settings)
    begin = max(closest_index, passed)
    at_m = float(arcs[closest_index])
    while True:
        corner = next_corner(route, begin, at_m + max(ahead_m, needed_m) + _ARM_M, settings)
        if corner is None or float(arcs[corner.route_index]) - at_m > max(needed_m, settings.corner_reached_m):
            break
        passed = corner.route_index
        # The rounded corner's other half is not another corner.
        begin = int(np.searchsorted(arcs, float(arcs[passed]) + 2.0 * _ARM_M))
    start_m = max(at_m, float(arcs[passed]) if passed > closest_index else at_m)
    if corner is not None and float(arcs[corner.route_index]) < start_m + ahead_m:
        return _before_corner(route, corner, ahead_m, passed)
    index = int(np.searchsorted(arcs, start_m + ahead_m))
    case = SubGoalCase.STRAIGHT if index < len(arcs) - 1 else SubGoalCase.DESTINATION
    index = min(index, len(arcs) - 1)
    return SubGoal(float(route.points_m[index, 0]), float(route.points_m[index, 1]), case, index, passed)


def expected_from(
    goal: SubGoal, closest_index: int, pose: Pose2D, speed_m_s: float, settings: FollowerSettings
) -> WorldAngle:
    """Return θ_exp; at a corner, as it will be where the walker comes to a stand."""
    if goal.passed_index > closest_index:
        on_m = stopping_distance_m(speed_m_s, settings)
        pose = Pose2D(
            pose.x_m + on_m * math.cos(pose.heading), pose.y_m + on_m * math.sin(pose.heading), pose.heading
        )  # fmt: skip
    return expected_direction(goal, pose)


def _before_corner(route: Route, corner: Corner, ahead_m: float, passed: int) -> SubGoal:
    """Aim at the corner as if the road went straight on there: who is near to it would be turned by every sway."""
    apex = route.points_m[corner.route_index]
    before = route.points_m[int(np.searchsorted(route.arc_length_m, _arc(route, corner) - 2.0 * _ARM_M))]
    along = apex - before
    length_m = math.hypot(along[0], along[1])
    onward = apex + (along / length_m * ahead_m if length_m > 0.0 else 0.0)
    return SubGoal(float(onward[0]), float(onward[1]), SubGoalCase.TURNING_POINT, corner.route_index, passed)


def _arc(route: Route, corner: Corner) -> float:
    return float(route.arc_length_m[corner.route_index])


def _bends_rad(points: FloatArray, arcs: FloatArray, middle: np.ndarray) -> FloatArray:
    """Return the bend (n,) of the road at its points, left positive."""
    before = np.searchsorted(arcs, arcs[middle] - _ARM_M)
    behind = np.minimum(np.searchsorted(arcs, arcs[middle] + _ARM_M), len(points) - 1)
    into, out = points[middle] - points[before], points[behind] - points[middle]
    cross = into[:, 0] * out[:, 1] - into[:, 1] * out[:, 0]
    bends: FloatArray = np.arctan2(cross, (into * out).sum(axis=1))
    return bends

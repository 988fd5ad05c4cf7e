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
from dataclasses import dataclass, replace

import numpy as np

from navcore.angles import WorldAngle
from navcore.follower.direction import expected_direction
from navcore.geometry import FloatArray
from navcore.settings import FollowerSettings
from navcore.types import DecisionTrace, Pose2D, Route, SubGoal, SubGoalCase

BRAKING_M_S2 = 1.2
"""How people who walk come to a stand (K. Hase, R. Stein, J. Neurophysiology 80, 1998)."""
_ARM_M = 1.0
"""A corner is a bend between the directions of the road so far before and behind it: recorded corners are rounded."""
SPEED_MEMORY_S = 0.25
"""Time constant of the measured speed: of somebody who gains speed, it is the speed of so long ago."""
_FASTEST_M_S = 2.0
_LONGEST_GAP_S = 1.0
_STRAIGHT_M = 5.0


@dataclass(frozen=True, slots=True)
class Corner:
    """A bend of the road too sharp to be steered round while walking."""

    route_index: int
    bend_rad: float
    """Left positive."""


def walking_velocity_m_s(before: DecisionTrace, gap_s: float, pose: Pose2D) -> tuple[float, float]:
    """Return how the walker has been moving lately, m/s in the world, from the frame before; 0 where it is unknown.

    As a vector, so that a pose that trembles is not taken for a walk. ``gap_s`` is the time since that frame.
    """
    if before.position is None or not 0.0 < gap_s <= _LONGEST_GAP_S:
        return 0.0, 0.0
    moved_m = pose.x_m - before.position[0], pose.y_m - before.position[1]
    scale = min(1.0 / gap_s, _FASTEST_M_S / max(math.hypot(*moved_m), 1e-9))
    share = 1.0 - math.exp(-gap_s / SPEED_MEMORY_S)
    old_x, old_y = before.velocity_m_s
    return old_x + share * (scale * moved_m[0] - old_x), old_y + share * (scale * moved_m[1] - old_y)


def stopping_distance_m(speed_m_s: float, reaction_s: float) -> float:
    """Return how far the walker goes on after an instruction to stop begins: reaction, then braking."""
    return speed_m_s * reaction_s + speed_m_s**2 / (2.0 * BRAKING_M_S2)


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
    arcs = route.arc_length_m
    at_m = float(arcs[closest_index])
    ahead_m, needed_m = look_ahead_m(speed_m_s, settings), stopping_distance_m(speed_m_s, settings.reaction_s)
    passed = 0 if previous is None else previous.passed_index
    within_m = max(ahead_m, needed_m)
    corner = _upcoming(route, passed, closest_index, within_m, settings)
    while corner is not None and _arc(route, corner) - at_m <= max(needed_m, settings.corner_reached_m):
        passed = corner.route_index
        corner = _upcoming(route, passed, closest_index, within_m, settings)
    start_m = max(at_m, float(arcs[passed]))
    if corner is not None and _arc(route, corner) < start_m + ahead_m:
        return _goal(route, corner.route_index, SubGoalCase.TURNING_POINT, passed)
    last = len(arcs) - 1
    index = min(int(np.searchsorted(arcs, start_m + ahead_m)), last)
    return _goal(route, index, SubGoalCase.DESTINATION if index == last else SubGoalCase.STRAIGHT, passed)


def _upcoming(
    route: Route, passed: int, closest_index: int, within_m: float, settings: FollowerSettings
) -> Corner | None:
    """Return the next corner that an aim may meet: it is measured from the corner that was passed last, and so is this.

    The other end of a corner is looked at as well, or its middle would be taken for farther forward.
    """
    start_m = max(float(route.arc_length_m[closest_index]), float(route.arc_length_m[passed]))
    return next_corner(route, _behind(route, passed, closest_index), start_m + within_m + _ARM_M, settings)


def straight_until(route: Route, closest_index: int, goal: SubGoal, settings: FollowerSettings) -> int:
    """Return the index of the route's next sharp corner, or of its last point."""
    if goal.case is SubGoalCase.TURNING_POINT:
        return goal.route_index
    until_m = float(route.arc_length_m[closest_index]) + _STRAIGHT_M
    corner = next_corner(route, _behind(route, goal.passed_index, closest_index), until_m, settings)
    return len(route.arc_length_m) - 1 if corner is None else corner.route_index


def expected_to(
    route: Route, goal: SubGoal, closest_index: int, pose: Pose2D, speed_m_s: float, settings: FollowerSettings
) -> WorldAngle:
    """Return θ_exp, the direction in which to walk now.

    Before a corner it leads on as if the road went straight there: who is near to it would be turned by every sway.
    Behind one, it is the direction that will hold where the walker comes to a stand.
    """
    if goal.case is SubGoalCase.TURNING_POINT:
        goal = _straight_on(route, goal, look_ahead_m(speed_m_s, settings))
    elif goal.passed_index > closest_index:
        on_m = stopping_distance_m(speed_m_s, settings.reaction_s)
        c, s = math.cos(pose.heading), math.sin(pose.heading)
        pose = Pose2D(pose.x_m + on_m * c, pose.y_m + on_m * s, pose.heading)
        goal = _goal_from(route, goal, pose, on_m, look_ahead_m(speed_m_s, settings), settings)
    return expected_direction(goal, pose)


def _goal_from(
    route: Route, goal: SubGoal, stand: Pose2D, within_m: float, ahead_m: float, settings: FollowerSettings
) -> SubGoal:
    """Return the sub-goal of who will stand there, on the road behind the corner that ``goal`` has passed.

    Who cuts a corner walks along the road behind it already: they will be on from the corner, and a sub-goal that is
    measured from the corner itself would lie beside them.
    """
    arcs, passed = route.arc_length_m, goal.passed_index
    leg = route.points_m[passed : int(np.searchsorted(arcs, float(arcs[passed]) + within_m, side="right")) + 1]
    there = passed + int(np.argmin(np.hypot(leg[:, 0] - stand.x_m, leg[:, 1] - stand.y_m)))
    index = min(int(np.searchsorted(arcs, float(arcs[there]) + ahead_m)), len(arcs) - 1)
    corner_index = straight_until(route, there, goal, settings)
    if index <= corner_index:
        return _goal(route, index, goal.case, passed)
    return _straight_on(route, _goal(route, corner_index, SubGoalCase.TURNING_POINT, passed), ahead_m)


def reach_m(route: Route, closest_index: int, pose: Pose2D, direction: WorldAngle, half_width_m: float) -> float:
    """Return how far the road ahead follows a direction; it need not be free farther than that."""
    points = route.points_m[closest_index:]
    offsets = points - (pose.x_m, pose.y_m)
    c, s = math.cos(direction), math.sin(direction)
    along, aside = offsets @ (c, s), np.abs(offsets @ (-s, c))
    # Somebody beside the road is led to it first.
    joined = int(np.argmax(aside <= half_width_m)) if bool((aside <= half_width_m).any()) else len(points) - 1
    left = np.flatnonzero(aside[joined:] > half_width_m)
    end = joined + int(left[0]) - 1 if len(left) else len(points) - 1
    return max(0.0, float(along[max(end, joined)]))


def _behind(route: Route, passed: int, closest_index: int) -> int:
    """Return where to look for the next corner: the rounded other half of one that was passed is no other one."""
    if passed == 0:
        return closest_index
    arcs = route.arc_length_m
    return max(closest_index, int(np.searchsorted(arcs, float(arcs[passed]) + _ARM_M)))


def _straight_on(route: Route, corner: SubGoal, ahead_m: float) -> SubGoal:
    arcs = route.arc_length_m
    before = route.points_m[int(np.searchsorted(arcs, float(arcs[corner.route_index]) - _ARM_M))]
    along_x, along_y = corner.x_m - float(before[0]), corner.y_m - float(before[1])
    factor = ahead_m / max(math.hypot(along_x, along_y), 1e-9)
    return replace(corner, x_m=corner.x_m + factor * along_x, y_m=corner.y_m + factor * along_y)


def _goal(route: Route, index: int, case: SubGoalCase, passed_index: int) -> SubGoal:
    return SubGoal(float(route.points_m[index, 0]), float(route.points_m[index, 1]), case, index, passed_index)


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

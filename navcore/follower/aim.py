"""Where the walker is on the route, and where they are to go next, by the policy that is set: Eqs. 1 to 3."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from navcore.angles import WorldAngle, world_angle
from navcore.follower import road_centred
from navcore.follower.beside import Line, direction_rad, line_beside
from navcore.follower.direction import expected_direction
from navcore.follower.sub_goal import closest_point, closest_point_anywhere, distance_to, select_sub_goal
from navcore.settings import Settings
from navcore.types import DecisionTrace, ObstacleScan, Pose2D, Route, SubGoal

_TURNED_BACK_M = 0.5
"""So far before a corner they have passed somebody may be again by turning on the spot."""


@dataclass(frozen=True, slots=True)
class Aim:
    """What follows from the pose and the route alone, before anything is known of obstacles."""

    closest_index: int
    """P_cls (Eq. 1)."""
    deviation_m: float
    goal: SubGoal
    """P_G (Eq. 2)."""
    expected: WorldAngle
    """θ_exp (Eq. 3)."""
    reach_m: float
    """How far the walker is led in that direction: it need not be free much farther."""
    offset_m: float = 0.0
    """How far left of the road's middle that leads, round what stands on it."""


def aim(
    route: Route,
    pose: Pose2D,
    speed_m_s: float,
    before: DecisionTrace | None,
    scan: ObstacleScan | None,
    settings: Settings,
) -> Aim:
    """Return where to go next.

    Args:
        route: the paper's W.
        pose: where the walker is.
        speed_m_s: how fast they have been walking lately.
        before: the trace of the frame before on the same route; None at the start.
        scan: what is known to be in the way, to go round it; None where nobody is to be led beside the road. The
            paper's policy looks at it only later.
        settings: ``follower.policy`` chooses the policy.
    """
    follower = settings.follower
    if before is not None and before.lost_index is not None:
        closest_index, deviation_m = closest_point_anywhere(route, pose, before.lost_index)
    else:
        last_index = None if before is None else before.closest_index
        closest_index, deviation_m = closest_point(route, pose, last_index, follower.closest_window_m)
    last_goal = None if before is None else before.sub_goal
    if follower.policy == "paper":
        goal = select_sub_goal(route, closest_index, pose, last_goal, follower)
        reach_m = min(distance_to(goal, pose), _until_arrival_m(route, pose, settings))
        return Aim(closest_index, deviation_m, goal, expected_direction(goal, pose), reach_m)
    goal = road_centred.select_aim(route, closest_index, speed_m_s, last_goal, follower)
    line = None if scan is None else _line(route, closest_index, goal, pose, speed_m_s, before, scan, settings)
    if line is not None:
        reach_m = math.hypot(line.x_m - pose.x_m, line.y_m - pose.y_m)
        expected = world_angle(direction_rad(line, pose))
        return Aim(closest_index, deviation_m, goal, expected, reach_m, line.offset_m)
    expected = road_centred.expected_to(route, goal, closest_index, pose, speed_m_s, follower)
    half_width_m = settings.obstacle.person_width_m / 2.0
    reach_m = road_centred.reach_m(route, closest_index, pose, expected, half_width_m)
    reach_m = min(reach_m, _until_arrival_m(route, pose, settings))
    return Aim(closest_index, deviation_m, goal, expected, reach_m)


def to_road(there: Aim, route: Route, pose: Pose2D) -> Aim:
    """Return how to come to the road first, by the shortest way; the sub-goal remains what it is."""
    x_m, y_m = (float(each) for each in route.points_m[there.closest_index])
    expected = world_angle(math.atan2(y_m - pose.y_m, x_m - pose.x_m))
    return replace(there, expected=expected, reach_m=there.deviation_m, offset_m=0.0)


def _until_arrival_m(route: Route, pose: Pose2D, settings: Settings) -> float:
    """Return how far the walker goes at most: whoever has arrived is stopped, and comes to a stand before the end.

    A destination that was recorded at arm's length from a wall could never be reached otherwise.
    """
    end = route.points_m[-1]
    distance_m = math.hypot(float(end[0]) - pose.x_m, float(end[1]) - pose.y_m)
    return max(0.0, distance_m - settings.follower.arrival_distance_m / 2.0)


def _line(
    route: Route,
    closest_index: int,
    goal: SubGoal,
    pose: Pose2D,
    speed_m_s: float,
    before: DecisionTrace | None,
    scan: ObstacleScan,
    settings: Settings,
) -> Line | None:
    """Return the line round what stands on the road; none at a corner, which is turned at first."""
    follower, last_offset_m = settings.follower, 0.0 if before is None else before.offset_m
    last_goal = None if before is None else before.sub_goal
    begun = last_offset_m != 0.0 and last_goal is not None and last_goal.passed_index == goal.passed_index
    behind_index = max(closest_index, goal.passed_index)
    short_of_m = float(route.arc_length_m[behind_index] - route.arc_length_m[closest_index])
    # The camera moves as the head turns: who has begun such a line behind a corner would lose it by turning to it.
    if short_of_m > (_TURNED_BACK_M if begun else 0.0):
        return None
    until_index = road_centred.straight_until(route, behind_index, goal, follower)
    return line_beside(
        route, behind_index, until_index, pose, scan,
        road_centred.look_ahead_m(speed_m_s, follower),
        settings.obstacle.person_width_m / 2.0,
        last_offset_m,
    )  # fmt: skip

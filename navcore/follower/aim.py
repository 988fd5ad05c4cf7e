"""Where the walker is on the route, and where they are to go next, by the policy that is set: Eqs. 1 to 3."""

from __future__ import annotations

from dataclasses import dataclass

from navcore.angles import WorldAngle
from navcore.follower import road_centred
from navcore.follower.direction import expected_direction
from navcore.follower.sub_goal import closest_point, closest_point_anywhere, distance_to, select_sub_goal
from navcore.settings import Settings
from navcore.types import DecisionTrace, Pose2D, Route, SubGoal


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


def aim(route: Route, pose: Pose2D, speed_m_s: float, before: DecisionTrace | None, settings: Settings) -> Aim:
    """Return where to go next.

    Args:
        route: the paper's W.
        pose: where the walker is.
        speed_m_s: how fast they have been walking lately.
        before: the trace of the frame before on the same route; None at the start.
        settings: ``follower.policy`` chooses the policy.
    """
    follower = settings.follower
    last_goal = None if before is None else before.sub_goal
    if before is not None and before.lost_index is not None:
        closest_index, deviation_m = closest_point_anywhere(route, pose, before.lost_index)
    else:
        last_index = None if before is None else before.closest_index
        closest_index, deviation_m = closest_point(route, pose, last_index, follower.closest_window_m)
    if follower.policy == "paper":
        goal = select_sub_goal(route, closest_index, pose, last_goal, follower)
        return Aim(closest_index, deviation_m, goal, expected_direction(goal, pose), distance_to(goal, pose))
    goal = road_centred.select_aim(route, closest_index, speed_m_s, last_goal, follower)
    expected = road_centred.expected_to(route, goal, closest_index, pose, speed_m_s, follower)
    half_width_m = settings.obstacle.person_width_m / 2.0
    reach_m = road_centred.reach_m(route, closest_index, pose, expected, half_width_m)
    return Aim(closest_index, deviation_m, goal, expected, reach_m)

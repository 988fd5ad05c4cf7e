"""Where to walk: the expected direction, and the optimal one of those that are free (Eqs. 3 and 4)."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace

from navcore.angles import RelativeAngle, WorldAngle, relative_to, world_angle, wrap_rad
from navcore.settings import FollowerSettings, ObstacleSettings
from navcore.types import CandidateDirection, Pose2D, SubGoal

_ASIDE_RAD = math.radians(9.0)
_NARROW_GAIN_M = 0.3
_SIDE_CHANGE_RAD = math.radians(20.0)


def expected_direction(goal: SubGoal, pose: Pose2D) -> WorldAngle:
    """Return θ_exp, the direction in the world from the walker to the sub-goal, in [0, 2π) (Eq. 3, Fig. 6).

    As printed, a sub-goal due +x (Δy = 0) falls into the last case and reads as π, "turn around"; Δx = Δy = 0 has no
    direction at all. Here it is atan2; at the sub-goal itself the heading is kept.
    """
    dx_m, dy_m = goal.x_m - pose.x_m, goal.y_m - pose.y_m
    if dx_m == 0.0 and dy_m == 0.0:
        return pose.heading
    return world_angle(math.atan2(dy_m, dx_m))


def required_clearance_m(distance_to_goal_m: float, settings: ObstacleSettings, gate_clearance_m: float) -> float:
    """Return how far a direction must be free.

    That is δ of Eq. 5, but not farther than the sub-goal and a margin: a turning point 1.2 m before a wall could
    never be reached otherwise, since δ = 2 m would close every direction towards it. Never nearer than the distance
    at which the walker is stopped.
    """
    needed_m = distance_to_goal_m + settings.sub_goal_margin_m
    return min(max(needed_m, settings.stop_distance_m), gate_clearance_m)


def walkable(candidates: Iterable[CandidateDirection], required_m: float) -> tuple[CandidateDirection, ...]:
    """Return D: the candidates that are free as far as is required."""
    return tuple(candidate for candidate in candidates if candidate.clearance_m >= required_m)


def needs_correction(deviation_m: float, error: RelativeAngle, settings: FollowerSettings) -> bool:
    """Return whether Eq. 4 leads back to the route: off it by more than 1.0 m, or heading off by π/6 or more.

    The policy ``road_centred`` always does.
    """
    if settings.policy == "road_centred":
        return True
    return deviation_m > settings.off_road_distance_m or abs(error) >= math.radians(settings.heading_error_deg)


def optimal_direction(
    candidates: tuple[CandidateDirection, ...],
    expected: WorldAngle,
    heading: WorldAngle,
    deviation_m: float,
    settings: FollowerSettings,
    last: RelativeAngle | None = None,
) -> CandidateDirection | None:
    """Return θ_opt, or None where D is empty (Eq. 4).

    Where the walker needs correction, the candidate nearest to the expected direction; else the one nearest to
    straight ahead. As printed, the differences of angles are not wrapped: 350° against 10° reads as 340° off.
    Equal ones are told apart by the expected direction, so that the mirror image of a scene gives the mirror image.
    ``last`` is the direction of the frame before, as seen from the present heading: somebody who was sent round an
    obstacle on one side is not sent to the other one for a few degrees.
    """
    if not candidates:
        return None
    error = relative_to(expected, heading)
    correct = needs_correction(deviation_m, error, settings)

    def cost(candidate: CandidateDirection) -> tuple[float, float, float]:
        off_expected = abs(wrap_rad(error - candidate.angle))
        off = off_expected if correct else abs(candidate.angle)
        if last is not None and _changes_side(candidate.angle, last):
            off += _SIDE_CHANGE_RAD
        return off, off_expected, -candidate.clearance_m

    return min(candidates, key=cost)


def between_candidates(best: CandidateDirection, error: RelativeAngle, step_rad: float) -> CandidateDirection:
    """Return the expected direction itself where the best candidate is the sample next to it."""
    return replace(best, angle=error) if abs(wrap_rad(error - best.angle)) <= step_rad / 2.0 else best


def widest_direction(
    candidates: tuple[CandidateDirection, ...], expected: WorldAngle, heading: WorldAngle
) -> CandidateDirection | None:
    """Return the direction that is free farthest, where none is free for δ, or None where it leads round nothing.

    Going on towards what blocks the way, because that is straight ahead, would leave no room to go round it; and a
    direction that is hardly freer than the expected one only leads nearer to a wall.
    """
    error = relative_to(expected, heading)
    best = min(
        candidates, key=lambda each: (-round(each.clearance_m, 1), abs(wrap_rad(error - each.angle))), default=None
    )
    towards = [each.clearance_m for each in candidates if abs(wrap_rad(error - each.angle)) < _ASIDE_RAD]
    gains = best is not None and (not towards or best.clearance_m >= max(towards) + _NARROW_GAIN_M)
    return best if gains else None


def _changes_side(angle: RelativeAngle, last: RelativeAngle) -> bool:
    return abs(last) > _ASIDE_RAD and angle * last < 0.0

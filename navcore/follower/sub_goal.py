"""Where on the route the walker is, and which point of it comes next (paper IV-C, steps 1 and 2, Eqs. 1 and 2)."""

from __future__ import annotations

import math

import numpy as np

from navcore.geometry import FloatArray
from navcore.settings import FollowerSettings
from navcore.types import Pose2D, Route, SubGoal, SubGoalCase

_STEP_BACK_M = 1.0
"""The closest point may also lie this far behind the last one: people step back."""
_BEND_SPAN_M = 0.3
"""Eq. 2 compares the chord with the step from one point to the next; over 0.1 m that step would be noise."""
_UNLIKELY_M = 0.4
"""A leg against the heading counts as so much farther away, and one far from the last place on the route as well."""
_AWAY_M = 5.0
_DIRECTION_POINTS = 3


def closest_point(route: Route, pose: Pose2D, previous_index: int | None, window_m: float) -> tuple[int, float]:
    """Return the index of P_cls and the distance to it (Eq. 1).

    As printed, Eq. 1 searches all of W; where a route comes back beside itself, the closest point would jump to the
    other leg. Here it is searched from the last one forward within a window, and everywhere only where there is no
    last one: at the start, and after a new plan.
    """
    if previous_index is None or not 0 <= previous_index < len(route.points_m):
        return closest_point_anywhere(route, pose, 0)
    at_m = float(route.arc_length_m[previous_index])
    first = int(np.searchsorted(route.arc_length_m, at_m - _STEP_BACK_M))
    last = int(np.searchsorted(route.arc_length_m, at_m + window_m, side="right"))
    distances_m = _distances_m(route, pose, first, last)
    nearest = int(np.argmin(distances_m))
    return first + nearest, float(distances_m[nearest])


def closest_point_anywhere(route: Route, pose: Pose2D, last_index: int) -> tuple[int, float]:
    """Return the index of P_cls, searched over all of W, and the distance to it.

    Where legs of the route run side by side, the nearest one need not be the walker's: it is the one along their
    heading, and near to where they were on the route last (at its beginning, where they have just begun).
    """
    distances_m = _distances_m(route, pose, 0, len(route.points_m))
    padded = np.concatenate([[np.inf], distances_m, [np.inf]])
    is_valley = (distances_m <= padded[:-2]) & (distances_m < padded[2:])
    valleys = np.flatnonzero(is_valley)
    arcs, points, last = route.arc_length_m, route.points_m, len(distances_m) - 1
    along = points[np.minimum(valleys + _DIRECTION_POINTS, last)] - points[np.maximum(valleys - _DIRECTION_POINTS, 0)]
    off_rad = np.arctan2(along[:, 1], along[:, 0]) - pose.heading
    against = (1.0 - np.cos(off_rad)) / 2.0
    away = np.minimum(np.abs(arcs[valleys] - arcs[min(last_index, last)]) / _AWAY_M, 1.0)
    best = int(valleys[np.argmin(distances_m[valleys] + _UNLIKELY_M * (against + away))])
    return best, float(distances_m[best])


def select_sub_goal(
    route: Route, closest_index: int, pose: Pose2D, previous: SubGoal | None, settings: FollowerSettings
) -> SubGoal:
    """Return P_G (Eq. 2, Fig. 5).

    Case 2 holds its turning point until it is reached: nearer than ``turning_reached_m``, or the closest point has
    come to it, which is when the walker crosses the plane that halves the corner. Otherwise, from the closest point
    on, the first point that is a turning point (case 2) or at least d away (case 1), else the destination (case 3).
    """
    passed_index = 0 if previous is None else previous.passed_index
    if previous is not None and previous.case is SubGoalCase.TURNING_POINT:
        if not is_reached(previous, closest_index, pose, settings):
            return previous
        passed_index = previous.route_index
    while True:
        goal = _next_sub_goal(route, max(closest_index, passed_index), passed_index, settings)
        if goal.case is not SubGoalCase.TURNING_POINT or not is_reached(goal, closest_index, pose, settings):
            return goal
        passed_index = goal.route_index


def is_reached(goal: SubGoal, closest_index: int, pose: Pose2D, settings: FollowerSettings) -> bool:
    """Return whether the walker has come to a turning point, or gone round it."""
    return closest_index >= goal.route_index or distance_to(goal, pose) <= settings.turning_reached_m


def has_arrived(goal: SubGoal, pose: Pose2D, settings: FollowerSettings) -> bool:
    """Return whether the destination is reached (case 3)."""
    return goal.case is SubGoalCase.DESTINATION and distance_to(goal, pose) <= settings.arrival_distance_m


def distance_to(goal: SubGoal, pose: Pose2D) -> float:
    """Return the straight distance from the walker to the sub-goal, metres."""
    return math.hypot(goal.x_m - pose.x_m, goal.y_m - pose.y_m)


def bend_rad(chord: FloatArray, step: FloatArray) -> float:
    """Return the angle between P_cls P_G and P_G P_G+1, in [0, π]; 0 where one of them has no length."""
    cross = float(chord[0] * step[1] - chord[1] * step[0])
    return abs(math.atan2(cross, float(chord @ step))) if np.any(chord) and np.any(step) else 0.0


def _distances_m(route: Route, pose: Pose2D, first: int, last: int) -> FloatArray:
    """Return the distances (n,), those that differ by rounding alone made the same: the first point counts then."""
    offsets = route.points_m[first:last] - (pose.x_m, pose.y_m)
    distances_m: FloatArray = np.hypot(offsets[:, 0], offsets[:, 1])
    return distances_m.round(9)


def _next_sub_goal(route: Route, from_index: int, passed_index: int, settings: FollowerSettings) -> SubGoal:
    points, arcs = route.points_m, route.arc_length_m
    last = len(points) - 1
    threshold_rad = math.radians(settings.turning_angle_deg)
    for s in range(from_index + 1, last):
        chord = points[s] - points[from_index]
        if math.hypot(chord[0], chord[1]) >= settings.sub_goal_distance_m:
            return _goal(points, s, SubGoalCase.STRAIGHT, passed_index)
        onward = min(int(np.searchsorted(arcs, arcs[s] + _BEND_SPAN_M)), last)
        if bend_rad(chord, points[onward] - points[s]) >= threshold_rad:
            return _goal(points, s, SubGoalCase.TURNING_POINT, passed_index)
    return _goal(points, last, SubGoalCase.DESTINATION, passed_index)


def _goal(points: FloatArray, index: int, case: SubGoalCase, passed_index: int) -> SubGoal:
    return SubGoal(float(points[index, 0]), float(points[index, 1]), case, index, passed_index)

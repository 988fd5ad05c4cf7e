"""Eqs. 1–5 of the paper: as printed, as implemented, and where the two differ."""

from __future__ import annotations

import math

import numpy as np
import pytest
from closed_loop import route_along
from hypothesis import given, settings
from hypothesis import strategies as st

from navcore.angles import relative_angle, world_angle, wrap_rad
from navcore.follower.direction import (
    expected_direction,
    needs_correction,
    optimal_direction,
    required_clearance_m,
    walkable,
)
from navcore.follower.gate import FULL_RANGE_M, current_reading, is_open, walking_direction
from navcore.follower.sub_goal import closest_point, has_arrived, select_sub_goal
from navcore.settings import FollowerSettings, GateSettings, ObstacleSettings
from navcore.types import CandidateDirection, Pose2D, SonarReading, SonarState, SubGoal, SubGoalCase

FOLLOWER, GATE, OBSTACLE = FollowerSettings(policy="paper"), GateSettings(), ObstacleSettings()
angles = st.floats(-math.pi, math.pi)
places = st.floats(-50.0, 50.0)


def pose(x_m: float, y_m: float, heading_deg: float = 0.0) -> Pose2D:
    return Pose2D(x_m, y_m, world_angle(math.radians(heading_deg)))


def candidate(angle_deg: float, clearance_m: float = 6.0) -> CandidateDirection:
    return CandidateDirection(relative_angle(math.radians(angle_deg)), clearance_m, 1.0)


# --------------------------------------------------------------------------------------------------------- Eq. 1
def printed_eq1(points: np.ndarray, x_m: float, y_m: float) -> int:
    return int(np.argmin(np.hypot(*(points - (x_m, y_m)).T)))


def test_eq1_is_the_printed_one_where_nothing_is_remembered():
    route = route_along((0, 0), (10, 0), (10, 10))
    for place in ((3.02, 0.4), (9.0, 4.1), (-2.0, -1.0)):
        assert closest_point(route, pose(*place), None, 4.0)[0] == printed_eq1(route.points_m, *place)


def test_eq1_does_not_jump_to_a_leg_that_comes_back_beside():
    route = route_along((0, 0), (10, 0), (10, 0.8), (0, 0.8))
    near_the_other_leg = pose(3.0, 0.45)
    assert printed_eq1(route.points_m, 3.0, 0.45) > 150
    index, deviation_m = closest_point(route, near_the_other_leg, 28, 4.0)
    assert index == 30
    assert deviation_m == pytest.approx(0.45, abs=0.01)


# --------------------------------------------------------------------------------------------------------- Eq. 2
def printed_eq2_case1(points: np.ndarray, closest: int, d_m: float) -> int:
    """The sum of the distances of all points to P_cls, as printed."""
    distances = np.hypot(*(points[closest + 1 :] - points[closest]).T)
    return closest + 1 + int(np.argmax(np.cumsum(distances) >= d_m))


def test_eq2_case_1_is_a_point_d_away_not_a_sum_of_distances():
    route = route_along((0, 0), (20, 0))
    goal = select_sub_goal(route, 0, pose(0, 0), None, FOLLOWER)
    assert goal.case is SubGoalCase.STRAIGHT
    assert goal.x_m == pytest.approx(3.0, abs=0.11)
    assert route.points_m[printed_eq2_case1(route.points_m, 0, 3.0), 0] < 1.0


def test_eq2_case_2_holds_the_turning_point_until_it_is_reached():
    route = route_along((0, 0), (10, 0), (10, 10))
    goal, cases = None, []
    for x_m in np.arange(5.0, 10.0, 0.1):
        place = pose(float(x_m), 0.0)
        closest = closest_point(route, place, None if goal is None else round(x_m * 10) - 1, 4.0)[0]
        goal = select_sub_goal(route, closest, place, goal, FOLLOWER)
        cases.append(goal.case)
        if goal.case is SubGoalCase.TURNING_POINT:
            assert math.hypot(goal.x_m - 10.0, goal.y_m) < 0.35
            assert math.hypot(goal.x_m - x_m, goal.y_m) > FOLLOWER.turning_reached_m
    first, last = cases.index(SubGoalCase.TURNING_POINT), len(cases) - 1 - cases[::-1].index(SubGoalCase.TURNING_POINT)
    assert all(case is SubGoalCase.TURNING_POINT for case in cases[first : last + 1]), "held without a gap"
    assert goal is not None
    assert goal.y_m > 1.0, "after the corner the sub-goal lies on the other leg"


def test_eq2_a_turning_point_that_was_cut_off_counts_as_passed():
    route = route_along((0, 0), (10, 0), (10, 10))
    corner = SubGoal(10.0, 0.0, SubGoalCase.TURNING_POINT, 100)
    goal = select_sub_goal(route, 115, pose(9.0, 1.5), corner, FOLLOWER)
    assert goal.case is SubGoalCase.STRAIGHT
    assert goal.passed_index == 100


def test_eq2_case_3_tests_the_destination_and_never_reads_past_the_end():
    route = route_along((0, 0), (2, 0))
    for index in range(len(route.points_m)):
        assert select_sub_goal(route, index, pose(0, 0), None, FOLLOWER).case is SubGoalCase.DESTINATION
    goal = select_sub_goal(route, 0, pose(0, 0), None, FOLLOWER)
    assert not has_arrived(goal, pose(0.9, 0), FOLLOWER)
    assert has_arrived(goal, pose(1.1, 0), FOLLOWER)


@settings(deadline=None)
@given(places, places, angles)
def test_eq2_moves_and_turns_with_the_world(x_m: float, y_m: float, angle: float):
    route = route_along((0, 0), (4, 0), (4, 4), (9, 4))
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    moved = route_along(*(tuple(turn @ corner + (x_m, y_m)) for corner in ((0, 0), (4, 0), (4, 4), (9, 4))))
    for index in (0, 10, 30, 60, 100):
        goal = select_sub_goal(route, index, pose(-20, -20), None, FOLLOWER)
        other = select_sub_goal(moved, index, pose(-500, -500), None, FOLLOWER)
        assert abs(other.route_index - goal.route_index) <= 1


# --------------------------------------------------------------------------------------------------------- Eq. 3
def printed_eq3(dx: float, dy: float) -> float:
    if dx == 0 and dy > 0:
        return math.pi / 2
    if dx == 0 and dy < 0:
        return 3 * math.pi / 2
    if dx > 0 and dy > 0:
        return math.atan(dy / dx)
    if dx > 0 and dy < 0:
        return math.atan(dy / dx) + 2 * math.pi
    return math.atan(dy / dx) + math.pi


@pytest.mark.parametrize(
    ("dx", "dy", "implemented_deg", "printed_deg"),
    [
        (0, 1, 90, 90), (0, -1, 270, 270), (1, 1, 45, 45), (1, -1, 315, 315), (-1, 1, 135, 135), (-1, -1, 225, 225),
        (-1, 0, 180, 180), (1, 0, 0, 180),
    ],
)  # fmt: skip
def test_eq3_truth_table(dx: float, dy: float, implemented_deg: float, printed_deg: float):
    goal = SubGoal(3.0 + dx, 2.0 + dy, SubGoalCase.STRAIGHT, 0)
    assert math.degrees(expected_direction(goal, pose(3.0, 2.0))) == pytest.approx(implemented_deg)
    assert math.degrees(printed_eq3(dx, dy)) == pytest.approx(printed_deg), "due +x it says: turn around"


def test_eq3_at_the_sub_goal_itself_keeps_the_heading():
    assert expected_direction(SubGoal(1, 1, SubGoalCase.STRAIGHT, 0), pose(1, 1, 77)) == pose(1, 1, 77).heading


# --------------------------------------------------------------------------------------------------------- Eq. 4
FAN = tuple(candidate(angle) for angle in (-30, -20, -10, 0, 10, 20, 30))


@pytest.mark.parametrize(
    ("expected_deg", "heading_deg", "deviation_m", "optimal_deg"),
    [
        (0, 0, 0.0, 0),
        (29, 0, 0.0, 0),  # within π/6, on the road: nearest to straight ahead
        (30, 0, 0.0, 30),  # π/6: nearest to the expected direction
        (12, 0, 1.0, 0),  # 1.0 m is not farther than 1.0 m
        (12, 0, 1.01, 10),  # off the road
        (350, 10, 0.0, 0),  # 20° off; as printed 340° off
        (339, 10, 0.0, -30),  # 30° off to the right
        (180, 0, 0.0, 30),
    ],
)
def test_eq4_truth_table(expected_deg: float, heading_deg: float, deviation_m: float, optimal_deg: float):
    expected, heading = world_angle(math.radians(expected_deg)), world_angle(math.radians(heading_deg))
    best = optimal_direction(FAN, expected, heading, deviation_m, FOLLOWER)
    assert best is not None
    assert abs(math.degrees(best.angle)) == pytest.approx(abs(optimal_deg))
    assert optimal_deg == 30 or math.degrees(best.angle) == pytest.approx(optimal_deg)


def test_eq4_printed_differences_are_not_wrapped():
    expected, heading = math.radians(350), math.radians(10)
    assert abs(expected - heading) >= math.pi / 6, "as printed: correct by 340°"
    assert not needs_correction(0.0, relative_angle(expected - heading), FOLLOWER)


def test_eq4_null_where_nothing_is_walkable():
    assert optimal_direction((), world_angle(0), world_angle(0), 0.0, FOLLOWER) is None
    assert walkable((candidate(0, 1.9), candidate(10, 2.0)), 2.0) == (candidate(10, 2.0),)


@settings(deadline=None)
@given(angles, angles, st.floats(0, 3), st.lists(st.integers(-30, 30), min_size=1, max_size=9, unique=True), angles)
def test_eq4_turns_and_mirrors_with_the_world(
    expected: float, heading: float, deviation_m: float, fan_deg: list[int], turn: float
):
    fan = tuple(candidate(angle) for angle in fan_deg)
    best = optimal_direction(fan, world_angle(expected), world_angle(heading), deviation_m, FOLLOWER)
    turned = optimal_direction(fan, world_angle(expected + turn), world_angle(heading + turn), deviation_m, FOLLOWER)
    mirrored_fan = tuple(candidate(-angle) for angle in fan_deg)
    mirrored = optimal_direction(mirrored_fan, world_angle(-expected), world_angle(-heading), deviation_m, FOLLOWER)
    assert best is not None
    assert turned is not None
    assert mirrored is not None

    def cost(angle: float, error: float) -> float:
        return (
            abs(wrap_rad(error - angle))
            if needs_correction(deviation_m, relative_angle(error), FOLLOWER)
            else abs(angle)
        )

    error = wrap_rad(expected - heading)
    if abs(abs(error) - math.pi / 6) > 1e-6:
        assert cost(best.angle, error) == pytest.approx(cost(turned.angle, error), abs=1e-6)
        assert cost(-mirrored.angle, error) == pytest.approx(cost(best.angle, error), abs=1e-6)


def test_a_side_once_chosen_is_not_left_for_a_few_degrees():
    fan = (candidate(-18), candidate(21))
    last = relative_angle(math.radians(20))
    chosen = optimal_direction(fan, world_angle(0), world_angle(0), 0.0, FOLLOWER, last)
    assert chosen == candidate(21)
    assert optimal_direction(fan, world_angle(0), world_angle(0), 0.0, FOLLOWER) == candidate(-18)


def test_a_turning_point_before_a_wall_can_be_reached():
    """δ = 3 m would close every direction towards a turning point 1.2 m before a wall."""
    for distance_m in np.arange(0.0, 6.0, 0.1):
        required = required_clearance_m(float(distance_m), OBSTACLE, OBSTACLE.clearance_m)
        assert OBSTACLE.stop_distance_m <= required <= OBSTACLE.clearance_m
        assert required <= max(distance_m + 1.2, OBSTACLE.stop_distance_m)


# --------------------------------------------------------------------------------------------------------- Eq. 5
OK, NO_ECHO, STALE, ABSENT = SonarState.OK, SonarState.NO_ECHO, SonarState.STALE, SonarState.ABSENT


@pytest.mark.parametrize(
    ("optimal_deg", "state", "distance_m", "is_walked"),
    [
        (0, OK, 2.01, True), (0, OK, 2.0, False), (0, OK, 0.0, False), (7.5, OK, 1.0, False), (-7.5, OK, 1.0, False),
        (7.6, OK, 1.0, True), (-20, OK, 0.5, True), (0, NO_ECHO, None, True), (0, STALE, None, True),
        (0, ABSENT, None, True), (0, OK, None, False), (0, OK, math.nan, False), (0, OK, -1.0, False),
        (None, OK, 4.0, False), (math.nan, ABSENT, None, False),
    ],
)  # fmt: skip
def test_eq5_truth_table(optimal_deg: float | None, state: SonarState, distance_m: float | None, is_walked: bool):
    optimal = None if optimal_deg is None else relative_angle(math.radians(optimal_deg))
    if optimal_deg is not None and math.isnan(optimal_deg):
        optimal = math.nan  # type: ignore[assignment]
    walked = walking_direction(optimal, SonarReading(0.0, state, distance_m), 2.0, GATE)
    assert (walked is not None) == is_walked
    assert walked is None or walked == optimal


@pytest.mark.parametrize(
    ("optimal_deg", "bearing_deg", "is_walked"),
    [(6, 6, False), (-6, -6, False), (13, 6, False), (-1, 6, False), (-6, 6, True), (6, -6, True), (0, 8, True)],
)
def test_eq5_the_field_lies_where_the_rangefinder_looks(optimal_deg: float, bearing_deg: float, is_walked: bool):
    """A rangefinder that is mounted aside, as calibration found it."""
    optimal = relative_angle(math.radians(optimal_deg))
    reading = SonarReading(0.0, OK, 1.0, bearing_rad=math.radians(bearing_deg))
    assert (walking_direction(optimal, reading, 2.0, GATE) is not None) == is_walked


@settings(deadline=None)
@given(st.floats(-math.pi, math.pi), st.floats(0.0, 6.0), st.floats(0.5, 4.0), st.floats(0.0, 6.0))
def test_eq5_never_opens_what_a_farther_echo_closes(
    angle: float, distance_m: float, required_m: float, nearer_m: float
):
    def open_at(d_m: float) -> bool:
        return is_open(relative_angle(angle), SonarReading(0.0, OK, d_m), required_m, GATE)

    if abs(angle) <= math.radians(GATE.half_field_deg):
        assert open_at(distance_m) == (distance_m > required_m)
    assert not open_at(min(distance_m, nearer_m)) or open_at(max(distance_m, nearer_m))


def test_eq5_a_reading_has_an_age():
    fresh = SonarReading(10.0, OK, 1.0)
    assert current_reading(fresh, 10.2, GATE) is fresh
    assert current_reading(fresh, 10.3, GATE).state is STALE
    assert current_reading(fresh, 9.0, GATE).state is STALE, "from the future: two clocks disagree"
    assert current_reading(None, 10.0, GATE).state is ABSENT
    assert FULL_RANGE_M == 4.25

"""The policy ``road_centred`` part by part, and where to go by either policy: corners, aims, and how far they lead."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from navcore.angles import relative_angle, relative_to, world_angle, wrap_rad
from navcore.follower.aim import Aim, aim, to_road
from navcore.follower.road_centred import (
    SPEED_MEMORY_S,
    expected_to,
    look_ahead_m,
    next_corner,
    reach_m,
    select_aim,
    stopping_distance_m,
    straight_until,
    walking_velocity_m_s,
)
from navcore.settings import FollowerSettings, Settings
from navcore.types import DecisionTrace, ObstacleScan, Pose2D, Route, SubGoal, SubGoalCase

Place = tuple[float, float]

STEP_M = 0.125
"""Between points of the road here: a power of two, so that arc lengths are exact, and so is what begins at one."""
FOLLOWER = FollowerSettings(corner_reached_m=0.25, reaction_s=0.7, lead_s=0.8)
STRAIGHT, TURNING, DESTINATION = SubGoalCase.STRAIGHT, SubGoalCase.TURNING_POINT, SubGoalCase.DESTINATION
HALF_M = 0.35


def road(*corners_m: Place) -> Route:
    """A route through corners; each leg is a whole number of steps."""
    points = [np.array(corners_m[0], dtype=float)]
    for begin, end in itertools.pairwise(corners_m):
        count = round(math.dist(begin, end) / STEP_M)
        points += [np.array(begin) + (np.array(end) - begin) * k / count for k in range(1, count + 1)]
    return Route(np.array(points), np.arange(len(points)) * STEP_M)


def at(arc_m: float) -> int:
    """The index of the point of a road at an arc length."""
    index = arc_m / STEP_M
    assert index == int(index)
    return int(index)


def turned_road(bend_deg: float, *, rounded_m: float = 0.0, before_m: float = 4.0, behind_m: float = 4.0) -> Route:
    """A road that bends once, left positive: at one point, or over an arc of so many metres about it."""
    count = max(1, round(rounded_m / STEP_M))
    headings = np.concatenate(
        [
            np.zeros(round((before_m - rounded_m / 2) / STEP_M)),
            np.radians(bend_deg) * (np.arange(count) + 0.5) / count if rounded_m else np.zeros(0),
            np.full(round((behind_m - rounded_m / 2) / STEP_M), np.radians(bend_deg)),
        ]
    )
    steps = STEP_M * np.stack([np.cos(headings), np.sin(headings)], axis=1)
    points = np.vstack([np.zeros(2), np.cumsum(steps, axis=0)])
    return Route(points, np.arange(len(points)) * STEP_M)


def pose(x_m: float, y_m: float, heading_deg: float = 0.0) -> Pose2D:
    return Pose2D(x_m, y_m, world_angle(math.radians(heading_deg)))


def moved(route: Route, turn_rad: float, shift: Place, side: float) -> Route:
    """The same road in a world that is mirrored (``side`` −1), turned and shifted."""
    return Route(np.array([placed(tuple(each), turn_rad, shift, side) for each in route.points_m]), route.arc_length_m)


def placed(place: Place, turn_rad: float, shift: Place, side: float) -> Place:
    x, y = place[0], side * place[1]
    c, s = math.cos(turn_rad), math.sin(turn_rad)
    return c * x - s * y + shift[0], s * x + c * y + shift[1]


ROADS = (
    road((0, 0), (6, 0)),
    road((0, 0), (6, 0), (6, 5)),
    road((0, 0), (4, 0), (4, 0.75), (0, 0.75)),
    road((0, 0), (4, 0), (4, 2), (9, 2), (9, -3)),
    turned_road(60, rounded_m=1.0),
    turned_road(40),
    turned_road(-120, before_m=3),
)
CORNERS_OF = {0: 0, 1: 1, 2: 1, 3: 3, 4: 1, 5: 0, 6: 1}
"""How many corners each of them has."""
WORLDS = st.tuples(
    st.floats(-math.pi, math.pi), st.tuples(st.floats(-50, 50), st.floats(-50, 50)), st.sampled_from([1.0, -1.0])
)


# ------------------------------------------------------------------------------------------------- speed and room
@pytest.mark.parametrize(
    ("speed_m_s", "reaction_s", "goes_on_m"),
    [(0.0, 0.7, 0.0), (1.2, 0.0, 0.6), (1.2, 0.7, 1.44), (0.6, 1.0, 0.75), (2.4, 0.5, 3.6)],
)
def test_who_is_told_to_stop_goes_on_for_their_reaction_and_then_brakes(
    speed_m_s: float, reaction_s: float, goes_on_m: float
) -> None:
    assert stopping_distance_m(speed_m_s, reaction_s) == pytest.approx(goes_on_m)


@pytest.mark.parametrize(
    ("speed_m_s", "reaction_s", "lead_s", "ahead_m"),
    [(0.0, 0.7, 0.7, 1.0), (0.7, 0.7, 0.7, 1.0), (1.0, 0.7, 0.7, 1.4), (1.0, 0.9, 0.4, 1.3), (1.3, 0.5, 1.5, 2.6)],
)
def test_the_walker_is_led_to_where_an_instruction_takes_effect(
    speed_m_s: float, reaction_s: float, lead_s: float, ahead_m: float
) -> None:
    chosen = FollowerSettings(reaction_s=reaction_s, lead_s=lead_s)
    assert look_ahead_m(speed_m_s, chosen) == pytest.approx(ahead_m)


def test_who_is_farther_away_than_a_stop_takes_is_never_led_to_a_point_nearer_than_the_least() -> None:
    assert look_ahead_m(0.0, FollowerSettings(min_look_ahead_m=1.7)) == 1.7


@pytest.mark.parametrize("gap_s", [0.0, -0.1, 1.01, math.nan])
def test_over_no_time_and_over_a_long_one_no_speed_is_known(gap_s: float) -> None:
    before = DecisionTrace(position=(0.0, 0.0), velocity_m_s=(0.8, 0.1))
    assert walking_velocity_m_s(before, gap_s, pose(0.1, 0.0)) == (0.0, 0.0)


def test_where_no_place_was_known_no_speed_is() -> None:
    assert walking_velocity_m_s(DecisionTrace(velocity_m_s=(0.8, 0.1)), 0.1, pose(0.1, 0.0)) == (0.0, 0.0)


@pytest.mark.parametrize(
    ("moved_m", "gap_s", "measured_m_s"),
    [
        ((0.1, 0.0), 0.1, (1.0, 0.0)),
        ((0.03, -0.04), 0.1, (0.3, -0.4)),
        ((0.0, 0.0), 0.1, (0.0, 0.0)),
        ((0.6, 0.8), 1.0, (0.6, 0.8)),
        ((3.0, 4.0), 0.1, (1.2, 1.6)),  # the pose has jumped: nobody walks faster than 2 m/s
        ((-5.0, 0.0), 1.0, (-2.0, 0.0)),
        ((0.2, 0.0), 0.1, (2.0, 0.0)),
    ],
)
@pytest.mark.parametrize("old_m_s", [(0.0, 0.0), (0.7, 0.2)])
def test_the_speed_follows_what_is_measured_with_its_time_constant(
    moved_m: Place, gap_s: float, measured_m_s: Place, old_m_s: Place
) -> None:
    before = DecisionTrace(position=(4.0, -2.0), velocity_m_s=old_m_s)
    found = walking_velocity_m_s(before, gap_s, pose(4.0 + moved_m[0], -2.0 + moved_m[1]))
    left = math.exp(-gap_s / SPEED_MEMORY_S)
    wanted = [left * old + (1.0 - left) * new for old, new in zip(old_m_s, measured_m_s, strict=True)]
    assert found == pytest.approx(tuple(wanted))


def test_a_quarter_of_a_second_after_somebody_stands_a_third_of_their_speed_is_left() -> None:
    before = DecisionTrace(position=(0.0, 0.0), velocity_m_s=(1.0, 0.0))
    assert walking_velocity_m_s(before, 0.25, pose(0.0, 0.0)) == pytest.approx((math.exp(-1.0), 0.0))


@settings(deadline=None)
@given(speed_m_s=st.floats(0.0, 1.9), old_m_s=st.floats(-1.0, 1.0), gap_s=st.floats(0.02, 0.5))
def test_the_speed_does_not_hang_on_the_rate_of_the_camera(speed_m_s: float, old_m_s: float, gap_s: float) -> None:
    before = DecisionTrace(position=(0.0, 0.0), velocity_m_s=(old_m_s, 0.0))
    once = walking_velocity_m_s(before, 2 * gap_s, pose(2 * gap_s * speed_m_s, 0.0))
    half_way = pose(gap_s * speed_m_s, 0.0)
    first = walking_velocity_m_s(before, gap_s, half_way)
    then = DecisionTrace(position=(half_way.x_m, half_way.y_m), velocity_m_s=first)
    twice = walking_velocity_m_s(then, gap_s, pose(2 * gap_s * speed_m_s, 0.0))
    assert twice == pytest.approx(once, abs=1e-9)


def test_a_pose_that_trembles_is_no_walk() -> None:
    """Two centimetres to and fro, ten times a second, would be 0.4 m/s if lengths were added."""
    trace, fastest_m_s = DecisionTrace(position=(0.0, 0.0)), 0.0
    for step in range(1, 40):
        place = pose(0.02 * (step % 2), 0.0)
        velocity = walking_velocity_m_s(trace, 0.05, place)
        trace = DecisionTrace(position=(place.x_m, place.y_m), velocity_m_s=velocity)
        fastest_m_s = max(fastest_m_s, math.hypot(*velocity))
    assert fastest_m_s < 0.1


# ------------------------------------------------------------------------------------------------------- corners
@pytest.mark.parametrize(
    ("bend_deg", "setting_deg", "is_corner"),
    [
        (44, 45, False),
        (46, 45, True),
        (46, 50, False),
        (-44, 45, False),
        (-46, 45, True),
        (91, 90, True),
        (89, 90, False),
        (32, 31, True),
    ],
)
def test_a_bend_is_a_corner_from_the_setting_on(bend_deg: float, setting_deg: float, is_corner: bool) -> None:
    found = next_corner(turned_road(bend_deg), 0, 20.0, FollowerSettings(corner_angle_deg=setting_deg - 1e-9))
    assert (found is not None) is is_corner
    if found is not None:
        assert found.route_index == at(4.0)
        assert math.degrees(found.bend_rad) == pytest.approx(bend_deg)


@pytest.mark.parametrize(
    ("bend_deg", "rounded_m"),
    [(60.0, 0.5), (-60.0, 0.5), (-60.0, 1.0), (90.0, 0.5), (90.0, 1.0), (-90.0, 1.5), (-120.0, 1.0), (120.0, 2.0)],
)
def test_a_rounded_corner_is_one_corner_in_its_middle(bend_deg: float, rounded_m: float) -> None:
    route = turned_road(bend_deg, rounded_m=rounded_m)
    found = next_corner(route, 0, 20.0, FOLLOWER)
    assert found is not None
    assert found.route_index == pytest.approx(at(4.0), abs=1)
    assert found.bend_rad * bend_deg > 0.0
    assert abs(math.degrees(found.bend_rad)) <= abs(bend_deg) + 1e-6
    assert next_corner(route, found.route_index + at(1.0) + 1, 20.0, FOLLOWER) is None, "its other half is no other one"


def test_a_bend_of_just_the_setting_is_a_corner() -> None:
    chosen = FollowerSettings(corner_angle_deg=90.0)
    assert next_corner(road((0, 0), (4, 0), (4, 4)), 0, 20.0, chosen) is not None


def test_a_wide_curve_is_walked_and_no_corner() -> None:
    assert next_corner(turned_road(90, rounded_m=4.0), 0, 20.0, FOLLOWER) is None
    assert next_corner(turned_road(-60, rounded_m=2.0), 0, 20.0, FOLLOWER) is None
    assert next_corner(road((0, 0), (8, 0)), 0, 20.0, FOLLOWER) is None


@pytest.mark.parametrize(
    ("until_m", "found_m"),
    [(3.25, None), (3.5, 3.5), (3.75, 3.75), (3.875, 3.875), (4.0, 4.0), (4.125, 4.0), (20.0, 4.0)],
)
def test_up_to_where_is_looked_the_sharpest_place_is_the_corner(until_m: float, found_m: float | None) -> None:
    """45° are there half a metre before a right angle, whose own point is the sharpest."""
    chosen = FollowerSettings(corner_angle_deg=44.9)
    found = next_corner(road((0, 0), (4, 0), (4, 4)), 0, until_m, chosen)
    assert (None if found is None else found.route_index) == (None if found_m is None else at(found_m))


@pytest.mark.parametrize(
    ("from_m", "found_m"),
    [(0.0, 4.0), (3.0, 4.0), (4.0, 4.0), (4.125, 4.125), (4.25, 4.25), (4.625, None), (7.0, None)],
)
def test_corners_are_looked_for_from_a_point_on(from_m: float, found_m: float | None) -> None:
    found = next_corner(road((0, 0), (4, 0), (4, 4)), at(from_m), 20.0, FOLLOWER)
    assert (None if found is None else found.route_index) == (None if found_m is None else at(found_m))


def test_the_first_point_of_a_road_is_no_corner_and_the_second_may_be() -> None:
    assert next_corner(road((0, 0), (0.125, 0), (0.125, 4)), 0, 20.0, FOLLOWER) == next_corner(
        road((0, 0), (0.125, 0), (0.125, 4)), 1, 20.0, FOLLOWER
    )
    found = next_corner(road((0, 0), (0.125, 0), (0.125, 4)), 0, 20.0, FOLLOWER)
    assert found is not None
    assert found.route_index == 1
    assert math.degrees(found.bend_rad) == pytest.approx(90.0)


@pytest.mark.parametrize(("last_leg_m", "found_m"), [(0.375, None), (1.0, 4.0), (1.125, 4.0), (2.0, 4.0)])
def test_within_a_metre_of_the_end_nothing_is_a_corner(last_leg_m: float, found_m: float | None) -> None:
    found = next_corner(road((0, 0), (4, 0), (4, last_leg_m)), 0, 20.0, FOLLOWER)
    assert (None if found is None else found.route_index) == (None if found_m is None else at(found_m))


def test_up_to_the_last_point_the_bend_is_that_of_a_whole_metre() -> None:
    chosen = FollowerSettings(corner_angle_deg=44.9)
    found = next_corner(road((0, 0), (4, 0), (4, 0.5)), 0, 20.0, chosen)
    assert found is not None
    assert (found.route_index, math.degrees(found.bend_rad)) == (at(3.5), pytest.approx(45.0))


def test_the_only_point_that_is_looked_at_may_be_a_corner() -> None:
    found = next_corner(road((0, 0), (4, 0), (4, 4)), at(4.0), 4.0, FOLLOWER)
    assert found is not None
    assert found.route_index == at(4.0)


def test_a_road_shorter_than_a_metre_has_no_corner() -> None:
    assert next_corner(road((0, 0), (0.375, 0), (0.375, 0.375)), 0, 20.0, FOLLOWER) is None
    assert next_corner(Route(np.zeros((1, 2)), np.zeros(1)), 0, 20.0, FOLLOWER) is None


def test_two_corners_close_together_to_the_same_side_are_one_turn() -> None:
    """Out along one side of a door, back along the other."""
    route = road((0, 0), (4, 0), (4, 0.75), (0, 0.75))
    found = next_corner(route, 0, 20.0, FOLLOWER)
    assert found is not None
    assert 4.0 < route.arc_length_m[found.route_index] < 4.75
    assert math.degrees(found.bend_rad) > 90.0
    assert next_corner(route, found.route_index + at(1.0), 20.0, FOLLOWER) is None


@pytest.mark.parametrize("between_m", [1.0, 1.5, 3.0])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_two_corners_to_different_sides_are_two(between_m: float, side: float) -> None:
    route = road((0, 0), (4, 0), (4, side * between_m), (8, side * between_m))
    first = next_corner(route, 0, 20.0, FOLLOWER)
    assert first is not None
    second = next_corner(route, first.route_index + at(1.0), 20.0, FOLLOWER)
    assert second is not None
    assert (first.route_index, second.route_index) == (at(4.0), at(4.0 + between_m))
    assert math.degrees(first.bend_rad) == pytest.approx(side * 90.0)
    assert math.degrees(second.bend_rad) == pytest.approx(-side * 90.0)


def test_a_road_that_turns_back_on_itself_is_a_corner() -> None:
    route = road((0, 0), (4, 0), (0, 0))
    found = next_corner(route, 0, 20.0, FOLLOWER)
    assert found is not None
    assert 3.5 <= route.arc_length_m[found.route_index] <= 4.0
    assert abs(math.degrees(found.bend_rad)) == pytest.approx(180.0)


@settings(deadline=None)
@given(which=st.sampled_from(ROADS), world=WORLDS, from_index=st.integers(0, 60), until_m=st.floats(0.0, 15.0))
def test_corners_turn_and_mirror_with_the_world(
    which: Route, world: tuple[float, Place, float], from_index: int, until_m: float
) -> None:
    found, other = (next_corner(each, from_index, until_m, FOLLOWER) for each in (which, moved(which, *world)))
    assert (found is None) == (other is None)
    if found is not None and other is not None:
        assert abs(found.route_index - other.route_index) <= 1, "of two equal ones rounding decides"
        assert abs(wrap_rad(other.bend_rad - world[2] * found.bend_rad)) < 1e-6


# --------------------------------------------------------------------------------------------------------- aims
ELL = road((0, 0), (6, 0), (6, 6))
STAIRS = road((0, 0), (6, 0), (6, 1), (12, 1))
LONG = road((0, 0), (12, 0))


def passed(arc_m: float) -> SubGoal:
    """What was walked to in the frame before, when corners up to an arc length had been passed."""
    return SubGoal(0.0, 0.0, STRAIGHT, 0, at(arc_m))


@pytest.mark.parametrize(
    ("route", "here_m", "speed_m_s", "previous", "case", "goal_m", "passed_m"),
    [
        # Straight on: so far ahead as an instruction takes.
        (LONG, 2.0, 0.0, None, STRAIGHT, 3.0, 0.0),
        (LONG, 2.0, 1.25, None, STRAIGHT, 3.75, 0.0),
        (LONG, 0.0, 0.0, None, STRAIGHT, 1.0, 0.0),
        # The destination, from where it is no farther away than that.
        (LONG, 10.875, 0.0, None, STRAIGHT, 11.875, 0.0),
        (LONG, 11.0, 0.0, None, DESTINATION, 12.0, 0.0),
        (LONG, 12.0, 0.0, None, DESTINATION, 12.0, 0.0),
        (LONG, 10.25, 1.25, None, DESTINATION, 12.0, 0.0),
        # Before a corner.
        (ELL, 4.0, 0.0, None, STRAIGHT, 5.0, 0.0),
        (ELL, 5.0, 0.0, None, STRAIGHT, 6.0, 0.0),
        (ELL, 5.125, 0.0, None, TURNING, 6.0, 0.0),
        (ELL, 5.625, 0.0, None, TURNING, 6.0, 0.0),
        (ELL, 4.5, 1.0, None, STRAIGHT, 6.0, 0.0),
        (ELL, 4.625, 1.0, None, TURNING, 6.0, 0.0),
        # At it: as near as it takes to come to a stand, and no nearer than the setting.
        (ELL, 5.75, 0.0, None, STRAIGHT, 7.0, 6.0),
        (ELL, 6.0, 0.0, None, STRAIGHT, 7.0, 6.0),
        (ELL, 4.75, 1.0, None, TURNING, 6.0, 0.0),
        (ELL, 4.875, 1.0, None, TURNING, 6.0, 0.0),
        (ELL, 5.0, 1.0, None, STRAIGHT, 7.5, 6.0),
        # Behind it: what was passed stays so, also for who steps back, and its rounded other half is none.
        (ELL, 6.25, 0.0, None, STRAIGHT, 7.25, 6.25),
        (ELL, 6.25, 0.0, passed(6.0), STRAIGHT, 7.25, 6.0),
        (ELL, 5.0, 0.0, passed(6.0), STRAIGHT, 7.0, 6.0),
        (ELL, 3.0, 0.0, passed(6.0), STRAIGHT, 7.0, 6.0),
        (ELL, 9.0, 0.0, passed(6.0), STRAIGHT, 10.0, 6.0),
        (ELL, 11.5, 0.0, passed(6.0), DESTINATION, 12.0, 6.0),
        # Short legs: the corner behind the one that was passed holds the walker in its turn.
        (STAIRS, 5.25, 0.0, None, TURNING, 6.0, 0.0),
        (STAIRS, 6.0, 0.0, None, STRAIGHT, 7.0, 6.0),
        (STAIRS, 6.125, 0.0, passed(6.0), TURNING, 7.0, 6.0),
        (STAIRS, 6.625, 0.0, passed(6.0), TURNING, 7.0, 6.0),
        (STAIRS, 6.75, 0.0, passed(6.0), STRAIGHT, 8.0, 7.0),
        (STAIRS, 5.25, 1.375, None, STRAIGHT, 9.0, 7.0),  # who cannot stand before the second one either
        (STAIRS, 6.0, 0.0, passed(7.0), STRAIGHT, 8.0, 7.0),
    ],
)  # fmt: skip
def test_what_the_walker_is_led_to(
    route: Route, here_m: float, speed_m_s: float, previous: SubGoal | None, case: SubGoalCase, goal_m: float,
    passed_m: float,
) -> None:  # fmt: skip
    goal = select_aim(route, at(here_m), speed_m_s, previous, FOLLOWER)
    found = goal.case, route.arc_length_m[goal.route_index], route.arc_length_m[goal.passed_index]
    assert found == (case, pytest.approx(goal_m, abs=STEP_M + 1e-9), passed_m)
    if speed_m_s == 0.0:
        assert found[1] == goal_m
    assert (goal.x_m, goal.y_m) == tuple(route.points_m[goal.route_index])


def test_a_corner_just_behind_the_start_is_none_that_was_passed() -> None:
    route = road((0, 0), (0.5, 0), (0.5, 6))
    goal = select_aim(route, 0, 0.0, None, FOLLOWER)
    assert (goal.case, goal.route_index, goal.passed_index) == (TURNING, at(0.5), 0)
    # The road before it is shorter than what its direction is taken over.
    expected = expected_to(route, goal, 0, pose(0.125, 0.25), 0.0, FOLLOWER)
    assert math.degrees(wrap_rad(expected)) == pytest.approx(math.degrees(math.atan2(-0.25, 1.375)))


@pytest.mark.parametrize(
    ("here_m", "speed_m_s", "follower", "case"),
    [
        (3.875, 0.0, FollowerSettings(min_look_ahead_m=2.0), STRAIGHT),
        (4.125, 0.0, FollowerSettings(min_look_ahead_m=2.0), TURNING),
        (3.0, 1.25, FollowerSettings(reaction_s=1.5, lead_s=0.2), STRAIGHT),
        (3.625, 1.25, FollowerSettings(reaction_s=1.5, lead_s=0.2), STRAIGHT),
    ],
)
def test_as_far_as_is_led_or_as_a_stand_takes_corners_are_seen(
    here_m: float, speed_m_s: float, follower: FollowerSettings, case: SubGoalCase
) -> None:
    goal = select_aim(ELL, at(here_m), speed_m_s, None, follower)
    assert goal.case is case
    assert goal.passed_index == (at(6.0) if here_m == 3.625 else 0)


@settings(deadline=None)
@given(
    which=st.sampled_from(ROADS), here=st.integers(0, 120), speed_m_s=st.floats(0.0, 1.5), before=st.integers(0, 120)
)
def test_an_aim_lies_ahead_and_a_corner_holds_only_who_can_come_to_a_stand_before_it(
    which: Route, here: int, speed_m_s: float, before: int
) -> None:
    arcs, last = which.arc_length_m, len(which.points_m) - 1
    here, before = min(here, last), min(before, last)
    previous = SubGoal(0.0, 0.0, STRAIGHT, before, before)
    goal = select_aim(which, here, speed_m_s, previous, FOLLOWER)
    assert goal.passed_index >= before, "what was passed is not taken up again"
    assert here <= goal.route_index <= last
    assert (goal.case is DESTINATION) == (goal.route_index == last)
    ahead_m = look_ahead_m(speed_m_s, FOLLOWER)
    assert arcs[goal.route_index] <= max(arcs[here], arcs[goal.passed_index]) + ahead_m + STEP_M
    if goal.case is TURNING:
        needed_m = max(stopping_distance_m(speed_m_s, FOLLOWER.reaction_s), FOLLOWER.corner_reached_m)
        assert arcs[goal.route_index] - arcs[here] > needed_m
        assert goal.route_index > goal.passed_index
    again = select_aim(which, here, speed_m_s, goal, FOLLOWER)
    assert again == goal, "nothing changes where nothing has"


@settings(deadline=None)
@given(which=st.sampled_from(sorted(CORNERS_OF)), speed_m_s=st.floats(0.0, 1.4))
def test_along_the_road_aims_and_corners_passed_only_go_on(which: int, speed_m_s: float) -> None:
    route, goal, goals = ROADS[which], None, []
    for here in range(len(route.points_m)):
        goal = select_aim(route, here, speed_m_s, goal, FOLLOWER)
        goals.append(goal)
    indices = [each.route_index for each in goals]
    assert [each.passed_index for each in goals] == sorted(each.passed_index for each in goals)
    assert indices == sorted(indices)
    assert goals[-1].case is DESTINATION
    assert len({each.passed_index for each in goals}) - 1 == CORNERS_OF[which]


@settings(deadline=None)
@given(which=st.sampled_from((*ROADS[:4], ROADS[6])), world=WORLDS, here=st.integers(0, 60), speed=st.floats(0.0, 1.3))
def test_aims_turn_and_mirror_with_the_world(
    which: Route, world: tuple[float, Place, float], here: int, speed: float
) -> None:
    other_road = moved(which, *world)
    here = min(here, len(which.points_m) - 1)
    # Off the places at which rounding decides.
    speed += 0.000137
    one, other = (select_aim(each, here, speed, None, FOLLOWER) for each in (which, other_road))
    assert (one.case, one.passed_index) == (other.case, other.passed_index)
    assert one.route_index == other.route_index
    np.testing.assert_allclose((other.x_m, other.y_m), placed((one.x_m, one.y_m), *world), atol=1e-9)


@pytest.mark.parametrize(
    ("route", "here_m", "goal", "until_m"),
    [
        (LONG, 2.0, SubGoal(3.0, 0.0, STRAIGHT, at(3.0)), 12.0),
        (ELL, 4.0, SubGoal(6.0, 0.0, TURNING, at(6.0)), 6.0),
        (ELL, 2.0, SubGoal(3.0, 0.0, STRAIGHT, at(3.0)), 6.0),
        (ELL, 1.0, SubGoal(2.0, 0.0, STRAIGHT, at(2.0)), 6.0),
        (ELL, 0.375, SubGoal(1.0, 0.0, STRAIGHT, at(1.0)), 12.0),  # farther ahead than it is looked
        (ELL, 6.0, SubGoal(6.0, 1.0, STRAIGHT, at(7.0), at(6.0)), 12.0),
        (STAIRS, 6.0, SubGoal(6.0, 1.0, STRAIGHT, at(7.0), at(6.0)), 7.0),
        (STAIRS, 7.0, SubGoal(7.0, 1.0, STRAIGHT, at(8.0), at(7.0)), 13.0),
    ],
)  # fmt: skip
def test_up_to_where_the_road_goes_on_without_a_corner(
    route: Route, here_m: float, goal: SubGoal, until_m: float
) -> None:
    assert straight_until(route, at(here_m), goal, FOLLOWER) == at(until_m)


# ------------------------------------------------------------------------------------------- expected direction
@pytest.mark.parametrize(
    ("route", "here_m", "place", "expected_deg"),
    [
        (LONG, 2.0, (2.0, 0.0), 0.0),
        (LONG, 2.0, (2.0, 1.0), -45.0),
        (LONG, 2.0, (2.0, -1.0), 45.0),
        (LONG, 11.5, (11.5, 0.5), -45.0),
        # Before a corner as if the road went on: a point 1 m behind it, where who stands is led.
        (ELL, 5.5, (5.5, 0.0), 0.0),
        (ELL, 5.5, (5.5, 0.5), math.degrees(math.atan2(-0.5, 1.5))),
        (ELL, 5.5, (5.5, -0.5), math.degrees(math.atan2(0.5, 1.5))),
        # At it, along the leg behind.
        (ELL, 6.0, (6.0, 0.0), 90.0),
        (ELL, 5.75, (5.75, 0.0), math.degrees(math.atan2(1.0, 0.25))),
        (ELL, 6.0, (6.25, 0.0), math.degrees(math.atan2(1.0, -0.25))),
        (ELL, 8.0, (6.0, 2.0), 90.0),
    ],
)  # fmt: skip
def test_in_which_direction_who_stands_is_led(route: Route, here_m: float, place: Place, expected_deg: float) -> None:
    goal = select_aim(route, at(here_m), 0.0, None, FOLLOWER)
    expected = expected_to(route, goal, at(here_m), pose(*place), 0.0, FOLLOWER)
    assert math.degrees(wrap_rad(expected)) == pytest.approx(expected_deg)


def test_behind_a_corner_the_direction_is_the_one_that_holds_where_the_walker_comes_to_a_stand() -> None:
    goal = SubGoal(6.0, 2.0, STRAIGHT, at(8.0), at(6.0))
    early = pose(6.0 - stopping_distance_m(0.8, FOLLOWER.reaction_s), 0.0)
    assert expected_to(ELL, goal, at(5.25), early, 0.8, FOLLOWER) == pytest.approx(math.pi / 2)
    # At the corner itself, and from there on, from where they are.
    for here_m in (6.0, 6.5):
        here = pose(6.0, here_m - 6.0, 0.0)
        assert expected_to(ELL, goal, at(here_m), here, 0.8, FOLLOWER) == pytest.approx(math.pi / 2)


@pytest.mark.parametrize("sway_m", [-0.3, -0.1, 0.1, 0.3])
@pytest.mark.parametrize("before_m", [0.375, 0.5, 0.75])
def test_who_is_near_to_a_corner_is_not_turned_by_every_sway(sway_m: float, before_m: float) -> None:
    goal = select_aim(ELL, at(6.0 - before_m), 0.0, None, FOLLOWER)
    assert goal.case is TURNING
    expected = expected_to(ELL, goal, at(6.0 - before_m), pose(6.0 - before_m, sway_m), 0.0, FOLLOWER)
    assert abs(math.degrees(wrap_rad(expected))) < 15.0
    assert expected_to(ELL, goal, 0, pose(6.0 - before_m, 0.0), 1.0, FOLLOWER) == pytest.approx(0.0)


def test_a_corner_behind_a_slanting_leg_is_led_to_along_it() -> None:
    route = turned_road(90, before_m=4.0)
    turn = math.radians(30.0)
    slanting = moved(route, turn, (1.0, -2.0), 1.0)
    goal = select_aim(slanting, at(3.5), 0.0, None, FOLLOWER)
    assert goal.case is TURNING
    here = tuple(slanting.points_m[at(3.5)])
    assert expected_to(slanting, goal, at(3.5), pose(*here), 0.0, FOLLOWER) == pytest.approx(turn)


# ------------------------------------------------------------------------------------------- how far it is led
@pytest.mark.parametrize(
    ("route", "place", "direction_deg", "reach"),
    [
        (LONG, (2.0, 0.0), 0.0, 10.0),
        (LONG, (2.0, 0.25), 0.0, 10.0),
        (LONG, (2.0, -0.25), 0.0, 10.0),
        (LONG, (0.0, 0.0), 90.0, 0.0),
        (LONG, (12.0, 0.0), 0.0, 0.0),
        (LONG, (2.0, 0.0), 180.0, 0.0),  # the road leads the other way
        (ELL, (2.0, 0.0), 0.0, 4.0),  # up to the corner, and across the other leg
        (ELL, (6.0, 2.0), 90.0, 4.0),
        (ELL, (5.75, 0.0), 90.0, 6.0),
        (ELL, (5.0, 0.0), 45.0, 0.375 * math.sqrt(0.5)),
        (ELL, (5.0, 0.0), -45.0, 0.375 * math.sqrt(0.5)),
        (STAIRS, (2.0, 0.5), 0.0, 4.0),  # beside both legs: it is joined on the step between them, and left again
        (LONG, (2.0, 1.0), -45.0, 1.0 * math.sqrt(0.5) + 1.375 * math.sqrt(0.5)),
        (LONG, (2.0, -1.0), 45.0, 1.0 * math.sqrt(0.5) + 1.375 * math.sqrt(0.5)),
        (LONG, (2.0, 1.0), 0.0, 10.0),  # it is nowhere joined: as far as the road goes
        (ELL, (8.0, 4.0), 45.0, 0.0),  # nor here, and its end lies beside the walker
    ],
)
def test_how_far_the_road_follows_a_direction(route: Route, place: Place, direction_deg: float, reach: float) -> None:
    nearest = int(np.argmin(np.hypot(*(route.points_m - place).T)))
    chosen = world_angle(math.radians(direction_deg))
    found = reach_m(route, nearest, pose(*place, 77.0), chosen, HALF_M)
    assert found == pytest.approx(reach, abs=1e-9)


@pytest.mark.parametrize(("half_m", "reach"), [(0.25, 4.25), (0.249, 4.125), (0.375, 4.375), (0.0, 4.0)])
def test_a_road_is_left_where_it_is_farther_aside_than_half_a_person(half_m: float, reach: float) -> None:
    """A road that goes over to the left, one step aside for each step on."""
    points = [(STEP_M * k, STEP_M * max(0, k - at(6.0))) for k in range(at(8.0))]
    slanting = Route(np.array(points), np.arange(len(points)) * STEP_M)
    assert reach_m(slanting, at(2.0), pose(2.0, 0.0), world_angle(0.0), half_m) == reach


@pytest.mark.parametrize(("aside_m", "reach"), [(0.25, 1.875), (0.2505, 3.875)])
def test_who_is_beside_the_road_by_just_half_a_person_is_on_it(aside_m: float, reach: float) -> None:
    """A road that goes away after 2 m, comes to where it is joined by everybody at 3 m, and goes away again at 4 m."""
    asides = [aside_m] * at(2.0) + [0.5] * at(1.0) + [0.0] * at(1.0) + [9.0] * at(1.0)
    points = [(STEP_M * k, aside) for k, aside in enumerate(asides)]
    route = Route(np.array(points), np.arange(len(points)) * STEP_M)
    assert reach_m(route, 0, pose(0.0, 0.0), world_angle(0.0), 0.25) == reach


@settings(deadline=None)
@given(
    which=st.sampled_from(ROADS), world=WORLDS, here=st.integers(0, 60), aside=st.floats(-1.5, 1.5),
    direction=st.floats(-math.pi, math.pi), speed=st.floats(0.0, 1.3), heading=st.floats(-math.pi, math.pi),
)  # fmt: skip
def test_reach_and_direction_turn_and_mirror_with_the_world(
    which: Route, world: tuple[float, Place, float], here: int, aside: float, direction: float, speed: float,
    heading: float,
) -> None:  # fmt: skip
    other, (turn, _, side) = moved(which, *world), world
    here = min(here, len(which.points_m) - 1)
    x_m, y_m = which.points_m[here] + (0.00731, aside)
    there = Pose2D(*placed((x_m, y_m), *world), world_angle(turn + side * heading))
    one = Pose2D(x_m, y_m, world_angle(heading))
    there_rad = world_angle(turn + side * direction)
    reach = reach_m(which, here, one, world_angle(direction), 0.350173)
    assert reach_m(other, here, there, there_rad, 0.350173) == pytest.approx(reach, abs=1e-6)
    goal = select_aim(which, here, speed, None, FOLLOWER)
    x_goal, y_goal = other.points_m[goal.route_index]
    same = SubGoal(float(x_goal), float(y_goal), goal.case, goal.route_index, goal.passed_index)
    expected = expected_to(which, goal, here, one, speed, FOLLOWER)
    turned = expected_to(other, same, here, there, speed, FOLLOWER)
    assert abs(wrap_rad(turned - turn - side * expected)) < 1e-5


# ------------------------------------------------------------------------------------------ aim, by either policy
EITHER = ("paper", "road_centred")


def chosen(policy: str, **others: object) -> Settings:
    return Settings().changed(
        {"follower.policy": policy, **{f"follower.{name}": each for name, each in others.items()}}
    )


def scan_of(here: Pose2D, *places_m: Place) -> ObstacleScan:
    """A wide image that shows things at places, and nothing else."""
    offset = np.array(places_m).reshape(-1, 2) - (here.x_m, here.y_m)
    bearing = np.array([wrap_rad(each) for each in np.arctan2(offset[:, 1], offset[:, 0]) - here.heading])
    free = np.radians(np.arange(-60.0, 61.0))
    bearings = np.concatenate([free, bearing])
    nearest = np.concatenate([np.full(len(free), np.inf), np.hypot(offset[:, 0], offset[:, 1])])
    order = np.argsort(bearings, kind="stable")
    return ObstacleScan(bearings[order], nearest[order], np.isfinite(nearest[order]).astype(np.int8), (), 1.0)


def towards(dx_m: float, dy_m: float) -> float:
    return math.degrees(math.atan2(dy_m, dx_m))


@pytest.mark.parametrize(
    ("policy", "route", "place", "case", "goal_m", "expected_deg", "reach"),
    [
        # 3 m ahead by Eq. 2, of which as much must be free; or where an instruction takes effect, along the road.
        ("paper", LONG, (2.0, 0.0), STRAIGHT, 5.0, 0.0, 3.0),
        ("road_centred", LONG, (2.0, 0.0), STRAIGHT, 3.0, 0.0, 9.5),
        ("paper", LONG, (2.0, 0.75), STRAIGHT, 5.0, towards(3.0, -0.75), math.hypot(3.0, 0.75)),
        ("road_centred", LONG, (2.0, 0.75), STRAIGHT, 3.0, towards(1.0, -0.75), 1.65),
        ("road_centred", LONG, (2.0, -0.75), STRAIGHT, 3.0, towards(1.0, 0.75), 1.65),
        # Nobody is led nearer to the destination than where they come to a stand.
        ("paper", LONG, (10.0, 0.0), DESTINATION, 12.0, 0.0, 1.5),
        ("road_centred", LONG, (10.0, 0.0), STRAIGHT, 11.0, 0.0, 1.5),
        ("paper", LONG, (11.0, 0.0), DESTINATION, 12.0, 0.0, 0.5),
        ("road_centred", LONG, (11.0, 0.0), DESTINATION, 12.0, 0.0, 0.5),
        ("paper", LONG, (11.75, 0.0), DESTINATION, 12.0, 0.0, 0.0),
        ("road_centred", LONG, (11.75, 0.0), DESTINATION, 12.0, 0.0, 0.0),
        # Before a corner.
        ("paper", ELL, (4.0, 0.0), TURNING, 5.875, 0.0, 1.875),
        ("paper", ELL, (4.0, 0.25), TURNING, 5.875, towards(1.875, -0.25), math.hypot(1.875, 0.25)),
        ("road_centred", ELL, (4.0, 0.0), STRAIGHT, 5.0, 0.0, 2.0),
        ("road_centred", ELL, (5.25, 0.0), TURNING, 6.0, 0.0, 0.75),
        # At it, and behind.
        ("paper", ELL, (6.0, 0.0), STRAIGHT, 9.0, 90.0, 3.0),
        ("road_centred", ELL, (6.0, 0.0), STRAIGHT, 7.0, 90.0, 5.5),
        ("paper", ELL, (6.0, 2.0), STRAIGHT, 11.0, 90.0, 3.0),
        ("road_centred", ELL, (6.0, 2.0), STRAIGHT, 9.0, 90.0, 3.5),
        ("road_centred", ELL, (6.25, 2.0), STRAIGHT, 9.0, towards(-0.25, 1.0), None),
    ],
)  # fmt: skip
def test_where_who_stands_is_led_by_either_policy(
    policy: str, route: Route, place: Place, case: SubGoalCase, goal_m: float, expected_deg: float, reach: float | None
) -> None:
    there = aim(route, pose(*place, 10.0), 0.0, None, None, chosen(policy))
    assert (there.goal.case, there.goal.route_index) == (case, at(goal_m))
    assert math.degrees(wrap_rad(there.expected)) == pytest.approx(expected_deg)
    assert there.reach_m == pytest.approx(there.reach_m if reach is None else reach)
    nearest_m = np.hypot(*(route.points_m - place).T)
    assert (there.closest_index, there.deviation_m) == (int(nearest_m.argmin()), pytest.approx(nearest_m.min()))
    assert there.offset_m == 0.0


@pytest.mark.parametrize("policy", EITHER)
@pytest.mark.parametrize("arrival_m", [0.5, 1.0, 2.0])
def test_so_far_before_the_destination_somebody_stands_who_is_told_that_they_arrived(
    policy: str, arrival_m: float
) -> None:
    there = aim(LONG, pose(9.5, 0.0), 0.0, None, None, chosen(policy, arrival_distance_m=arrival_m))
    assert there.reach_m == pytest.approx(2.5 - arrival_m / 2.0)


def test_who_walks_faster_is_led_to_a_point_farther_ahead_and_turned_earlier() -> None:
    settings_ = chosen("road_centred")
    for speed_m_s, goal_m in ((0.0, 3.0), (1.0, 3.5), (1.25, 3.75)):
        assert aim(LONG, pose(2.0, 0.0), speed_m_s, None, None, settings_).goal.route_index == at(goal_m)
    assert aim(LONG, pose(2.0, 0.0), 1.25, None, None, chosen("paper")).goal.route_index == at(5.0)
    slow, fast = (aim(ELL, pose(5.0, 0.0), speed_m_s, None, None, settings_) for speed_m_s in (0.3, 1.0))
    assert math.degrees(slow.expected) == pytest.approx(0.0)
    assert math.degrees(fast.expected) > 60.0


OUT_AND_BACK = road((0, 0), (10, 0), (10, 0.75), (0, 0.75))


@pytest.mark.parametrize("policy", EITHER)
@pytest.mark.parametrize(
    ("x_m", "heading_deg", "last_m", "lost_m", "window_m", "closest_m"),
    [
        (3.0, 0.0, None, None, 4.0, 3.0),
        (3.0, 0.0, 2.75, None, 4.0, 3.0),
        (3.0, 180.0, 17.5, None, 4.0, 17.75),
        (3.0, 180.0, 2.75, None, 4.0, 3.0),  # on which leg they are is known, whichever way they face
        (8.0, 0.0, 3.0, None, 4.0, 7.0),  # nobody comes so far in a moment
        (8.0, 0.0, 3.0, None, 6.0, 8.0),
        (3.0, 180.0, 2.75, 17.5, 4.0, 17.75),  # who was lost is looked for everywhere
        (3.0, 0.0, 17.5, 2.75, 4.0, 3.0),
        (8.0, 0.0, 3.0, 7.75, 4.0, 8.0),
    ],
)
def test_the_place_on_the_route_is_looked_for_near_the_last_one_and_everywhere_by_who_was_lost(
    policy: str, x_m: float, heading_deg: float, last_m: float | None, lost_m: float | None, window_m: float,
    closest_m: float,
) -> None:  # fmt: skip
    before = DecisionTrace(
        closest_index=None if last_m is None else at(last_m), lost_index=None if lost_m is None else at(lost_m)
    )
    there = aim(
        OUT_AND_BACK, pose(x_m, 0.375, heading_deg), 0.0, before, None, chosen(policy, closest_window_m=window_m)
    )
    assert OUT_AND_BACK.arc_length_m[there.closest_index] == closest_m
    if closest_m != 7.0:
        assert there.deviation_m == pytest.approx(0.375)


@pytest.mark.parametrize("policy", EITHER)
def test_what_was_walked_to_is_remembered(policy: str) -> None:
    settings_ = chosen(policy)
    first = aim(ELL, pose(6.0, 0.0), 0.0, None, None, settings_)
    before = DecisionTrace(closest_index=first.closest_index, sub_goal=replace(first.goal, passed_index=at(6.0)))
    back = aim(ELL, pose(5.25, 0.0), 0.0, before, None, settings_)
    assert back.goal.passed_index == at(6.0)
    assert back.goal.route_index > at(6.0)
    assert aim(ELL, pose(5.25, 0.0), 0.0, None, None, settings_).goal.route_index == at(6.0)


BESIDE = ((4.0, -0.1), (4.0, 0.0), (4.0, 0.1))
"""Something on the road, 2 m ahead of who stands at 2 m."""


@pytest.mark.parametrize(
    ("policy", "route", "place", "things", "leads_beside"),
    [
        ("road_centred", LONG, (2.0, 0.0), BESIDE, True),
        ("road_centred", LONG, (2.0, 0.0), (), False),
        ("paper", LONG, (2.0, 0.0), BESIDE, False),
        ("road_centred", ELL, (4.0, 0.0), ((5.5, 0.0), (5.5, 0.1)), True),
        ("road_centred", ELL, (4.0, 0.0), ((6.0, 1.5),), False),  # behind the corner, which is turned at first
        ("road_centred", ELL, (5.75, 0.0), ((6.0, 1.5),), False),  # before it, and turning at it
        ("road_centred", ELL, (6.0, 0.0), ((6.0, 1.5), (6.1, 1.5)), True),
    ],
)
def test_round_what_stands_on_the_road_a_line_leads_beside_it(
    policy: str, route: Route, place: Place, things: tuple[Place, ...], leads_beside: bool
) -> None:
    here = pose(*place, 90.0 if place[0] >= 5.75 else 0.0)
    settings_ = chosen(policy, corner_reached_m=0.25)
    there = aim(route, here, 0.0, None, scan_of(here, *things), settings_)
    assert (there.offset_m != 0.0) is leads_beside
    unaware = aim(route, here, 0.0, None, None, settings_)
    assert unaware.offset_m == 0.0
    assert (there.goal, there.closest_index, there.deviation_m) == (
        unaware.goal, unaware.closest_index, unaware.deviation_m
    )  # fmt: skip
    if not leads_beside:
        assert there == unaware
        return
    # To the side of the line, by the point of it that is so far away.
    off = wrap_rad(there.expected - (math.pi / 2 if place[0] >= 6.0 else 0.0))
    assert off * there.offset_m > 0.0
    assert there.reach_m * abs(math.sin(off)) <= abs(there.offset_m) + 1e-9
    assert 0.4 <= there.reach_m <= 1.7


def test_a_line_that_was_begun_is_kept() -> None:
    here = pose(2.0, 0.0)
    settings_ = chosen("road_centred")
    goal = aim(LONG, here, 0.0, None, None, settings_).goal
    for side in (1.0, -1.0):
        before = DecisionTrace(closest_index=at(2.0), sub_goal=goal, offset_m=0.5 * side)
        assert aim(LONG, here, 0.0, before, scan_of(here, *BESIDE), settings_).offset_m * side > 0.0


@pytest.mark.parametrize(
    ("before_m", "offset_m", "passed_m", "is_kept"),
    [
        (0.0, 0.0, 6.0, True), (0.375, 0.6, 6.0, True), (0.375, 1.0, 6.0, True), (0.5, 0.6, 6.0, True),
        (0.375, 0.0, 6.0, False), (0.125, 0.0, 6.0, False), (0.625, 0.6, 6.0, False), (0.375, 0.6, 0.0, False),
    ],
)  # fmt: skip
def test_half_a_metre_before_a_corner_a_line_behind_it_is_kept_that_was_begun_there(
    before_m: float, offset_m: float, passed_m: float, is_kept: bool
) -> None:
    """Turning on the spot the camera comes before the corner again."""
    here = pose(6.0 - before_m, 0.0, 90.0)
    goal = replace(aim(ELL, pose(6.0, 0.0), 0.0, None, None, chosen("road_centred")).goal, passed_index=at(passed_m))
    before = DecisionTrace(closest_index=at(6.0 - before_m), sub_goal=goal, offset_m=offset_m)
    settings_ = chosen("road_centred", corner_reached_m=0.5)
    there = aim(ELL, here, 0.0, before, scan_of(here, (6.0, 1.5), (5.9, 1.5)), settings_)
    assert there.goal.passed_index == at(6.0) or before_m > 0.5
    assert (there.offset_m != 0.0) is is_kept


@pytest.mark.parametrize("shift", [(7.0, -3.0), (-5.0, 2.0)])
def test_the_way_to_a_line_is_as_long_wherever_it_is(shift: Place) -> None:
    here = pose(2.0, 0.2)
    there = pose(2.0 + shift[0], 0.2 + shift[1])
    one = aim(LONG, here, 0.0, None, scan_of(here, *BESIDE), chosen("road_centred"))
    places = [placed(each, 0.0, shift, 1.0) for each in BESIDE]
    other = aim(moved(LONG, 0.0, shift, 1.0), there, 0.0, None, scan_of(there, *places), chosen("road_centred"))
    assert one.offset_m == other.offset_m != 0.0
    assert (other.reach_m, other.expected) == (pytest.approx(one.reach_m), pytest.approx(one.expected))


@pytest.mark.parametrize("width_m", [0.6, 0.7, 0.9, 1.2])
def test_the_line_and_the_reach_leave_room_for_a_person(width_m: float) -> None:
    here = pose(2.0, 0.0)
    settings_ = Settings().changed({"obstacle.person_width_m": width_m})
    there = aim(LONG, here, 0.0, None, scan_of(here, (4.0, 0.05)), settings_)
    assert -there.offset_m >= width_m / 2 - 0.05 - 1e-9
    assert -there.offset_m < width_m / 2 + 0.25
    # From beside the road: where it is joined, and left on its other side.
    reach = aim(LONG, pose(2.0, 0.5), 0.0, None, None, settings_).reach_m
    off_rad = math.atan2(0.5, 1.0)
    assert reach * math.sin(off_rad) == pytest.approx(0.5 + width_m / 2 * math.cos(off_rad) - 0.1, abs=0.1)


@settings(deadline=None)
@given(
    which=st.sampled_from((*ROADS[:2], ROADS[3], ROADS[5])), world=WORLDS, here=st.integers(0, 60),
    aside=st.floats(-1.4, 1.4), heading=st.floats(-3.1, 3.1), speed=st.floats(0.0, 1.3),
    things=st.lists(st.tuples(st.floats(-1.0, 9.0), st.floats(-2.0, 4.0)), max_size=4),
    policy=st.sampled_from(EITHER),
)  # fmt: skip
def test_the_whole_aim_turns_and_mirrors_with_the_world(
    which: Route, world: tuple[float, Place, float], here: int, aside: float, heading: float, speed: float,
    things: list[Place], policy: str,
) -> None:  # fmt: skip
    other, (turn, _, side) = moved(which, *world), world
    x_m, y_m = which.points_m[min(here, len(which.points_m) - 1)] + (0.0173, aside + 0.0039)
    one = Pose2D(float(x_m), float(y_m), world_angle(heading))
    there = Pose2D(*placed((one.x_m, one.y_m), *world), world_angle(turn + side * heading))
    # Off the places at which rounding decides: points of the road, stations and lines.
    settings_ = chosen(policy, sub_goal_distance_m=3.05)
    things = [(x + 0.00371, y + 0.00173) for x, y in things]
    found = aim(which, one, speed + 0.000137, None, scan_of(one, *things), settings_)
    same_things = scan_of(there, *(placed(each, *world) for each in things))
    turned = aim(other, there, speed + 0.000137, None, same_things, settings_)
    assert turned.closest_index == found.closest_index
    assert (turned.goal.case, turned.goal.route_index) == (found.goal.case, found.goal.route_index)
    assert turned.offset_m == pytest.approx(side * found.offset_m)
    assert abs(wrap_rad(turned.expected - turn - side * found.expected)) < 1e-5
    assert turned.reach_m == pytest.approx(found.reach_m, abs=1e-5)


@pytest.mark.parametrize(
    ("place", "expected_deg"), [((4.0, 1.0), -90.0), ((4.0, -1.5), 90.0), ((7.0, 3.0), 180.0), ((5.0, 3.0), 0.0)]
)
def test_who_is_led_to_the_road_first_is_led_the_shortest_way(place: Place, expected_deg: float) -> None:
    here = pose(*place, 33.0)
    first = aim(ELL, here, 0.0, None, None, chosen("road_centred"))
    there = to_road(replace(first, offset_m=0.3), ELL, here)
    assert math.degrees(wrap_rad(there.expected)) == pytest.approx(expected_deg, abs=1e-6)
    assert there == Aim(first.closest_index, first.deviation_m, first.goal, there.expected, first.deviation_m, 0.0)
    assert relative_to(there.expected, here.heading) == pytest.approx(relative_angle(math.radians(expected_deg - 33.0)))

"""Turning to the route, and finding the walker's place on a route whose legs run side by side."""

from __future__ import annotations

import math

import numpy as np
import pytest
from closed_loop import route_along
from hypothesis import given, settings
from hypothesis import strategies as st

from navcore.angles import relative_angle, relative_to, world_angle
from navcore.follower.road_centred import expected_to, select_aim, stopping_distance_m
from navcore.follower.sub_goal import closest_point, closest_point_anywhere
from navcore.follower.turning import turn_to_route
from navcore.settings import FollowerSettings
from navcore.types import Pose2D, SubGoal, SubGoalCase, TurnKind

OUT_AND_BACK = route_along((0, 0), (10, 0), (10, 0.8), (0, 0.8))
WINDOW_M = 4.0


def rad(angle_deg: float):
    return relative_angle(math.radians(angle_deg))


def turned(turn_deg: float, place: tuple[float, float]):
    """The route, and a place by it, in a world that is turned and shifted."""
    turn = math.radians(turn_deg)
    rotation = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
    shift = (turn_deg, -turn_deg / 2)
    corners = ((0, 0), (10, 0), (10, 0.8), (0, 0.8))
    x_m, y_m = rotation @ place + shift
    return route_along(*(tuple(rotation @ corner + shift) for corner in corners)), (float(x_m), float(y_m))


def pose(x_m: float, y_m: float, heading_deg: float = 0.0) -> Pose2D:
    return Pose2D(x_m, y_m, world_angle(math.radians(heading_deg)))


# ------------------------------------------------------------------------------------------------------- turning
@pytest.mark.parametrize(
    ("error_deg", "before", "last_deg", "kind", "turn_deg"),
    [
        (90, None, None, TurnKind.ALONG, 90),
        (134, None, None, TurnKind.ALONG, 134),
        (135, None, None, TurnKind.AROUND, 135),
        (135.5, None, None, TurnKind.AROUND, 135.5),
        (-136, None, None, TurnKind.AROUND, -136),
        (178, TurnKind.AROUND, 175, TurnKind.AROUND, 178),
        (-178, TurnKind.AROUND, 175, TurnKind.AROUND, 179),  # a sway of the head does not change the side
        (178, TurnKind.AROUND, -175, TurnKind.AROUND, -179),
        (-149, TurnKind.AROUND, 175, TurnKind.AROUND, -149),  # the walker has turned by the other side
        (60, TurnKind.AROUND, 100, TurnKind.AROUND, 60),  # a U-turn that is nearly done is one still
        (-178, TurnKind.ALONG, 60, TurnKind.AROUND, 179),
        (178, TurnKind.AROUND, 10, TurnKind.AROUND, 178),
        (178, TurnKind.ALONG, 0, TurnKind.AROUND, 178),
        (-150, TurnKind.AROUND, 175, TurnKind.AROUND, -150),
        (-150.5, TurnKind.AROUND, 175, TurnKind.AROUND, 179),
    ],
)
def test_turns_to_the_route(error_deg: float, before: TurnKind | None, last_deg: float | None, kind, turn_deg: float):
    found, turn = turn_to_route(rad(error_deg), before, None if last_deg is None else rad(last_deg))
    assert found is kind
    assert math.degrees(turn) == pytest.approx(turn_deg)


@given(st.floats(-179.9, 179.9), st.sampled_from([None, TurnKind.ALONG, TurnKind.AROUND]), st.floats(-179.9, 179.9))
def test_a_turn_mirrored_is_the_mirrored_turn(error_deg: float, before: TurnKind | None, last_deg: float):
    kind, turn = turn_to_route(rad(error_deg), before, rad(last_deg))
    mirrored_kind, mirrored = turn_to_route(rad(-error_deg), before, rad(-last_deg))
    assert mirrored_kind is kind
    assert mirrored == pytest.approx(-turn)


@given(st.floats(-20, 20), st.booleans())
def test_the_side_of_a_turn_around_does_not_flicker(sway_deg: float, left: bool):
    kind, turn = turn_to_route(rad(179 if left else -179), None, None)
    for step in range(20):
        kind, turn = turn_to_route(rad(180 + sway_deg * math.sin(step)), kind, turn)
        assert kind is TurnKind.AROUND
        assert (turn > 0) == left


# ------------------------------------------------------------------------------------------- a place on the route
def test_a_walk_that_comes_back_beside_itself_is_begun_at_its_beginning():
    nearer_the_other_leg = pose(1.0, 0.45)
    index, deviation_m = closest_point(OUT_AND_BACK, nearer_the_other_leg, None, WINDOW_M)
    assert index == 10
    assert deviation_m == pytest.approx(0.45, abs=0.01)


@pytest.mark.parametrize(
    ("x_m", "y_m", "heading_deg", "last_m", "found_m"),
    [
        (3.0, 0.45, 0, 2.5, 3.0),  # where they were lost, and heads along that leg
        (3.0, 0.45, 180, 17.5, 17.8),
        (3.0, 0.35, 180, 17.0, 17.8),  # nearer to the other leg, but was lost on this one, and heads along it
        (3.0, 0.4, 180, 10.4, 17.8),  # lost half-way: the heading decides
        (3.0, 0.4, 0, 10.4, 3.0),
        (3.0, 0.4, 90, 17.0, 17.8),  # heads across: the place where they were lost decides
        (3.0, 0.4, 90, 2.0, 3.0),
        (3.0, 1.9, 0, 2.5, 17.8),  # far from the one leg, near the other: no doubt
        (3.0, 0.7, 0, 2.5, 3.0),  # much nearer to the other leg, but heading and memory speak for this one
        (3.0, 0.25, 180, 10.4, 17.8),
        (9.4, 0.47, 90, 9.4, 9.4),  # the farther along the route another leg is, the less likely
        (9.4, 0.5, 90, 9.4, 11.4),
    ],
)
@pytest.mark.parametrize("turn_deg", [0.0, 137.0])
def test_who_was_lost_is_found_on_the_leg_that_is_theirs(
    x_m: float, y_m: float, heading_deg: float, last_m: float, found_m: float, turn_deg: float
):
    route, (x_m, y_m) = turned(turn_deg, (x_m, y_m))
    last = int(np.argmin(np.abs(route.arc_length_m - last_m)))
    index, deviation_m = closest_point_anywhere(route, pose(x_m, y_m, heading_deg + turn_deg), last)
    assert route.arc_length_m[index] == pytest.approx(found_m, abs=0.11)
    assert deviation_m == pytest.approx(math.hypot(*(route.points_m[index] - (x_m, y_m))))


def test_who_is_known_to_be_on_one_leg_is_not_looked_for_on_the_other():
    beside_the_other = pose(1.0, 0.9, 180.0)
    assert closest_point(OUT_AND_BACK, beside_the_other, 0, WINDOW_M)[0] == 10
    assert closest_point(OUT_AND_BACK, beside_the_other, None, WINDOW_M)[0] > 150


def test_an_index_of_another_route_is_not_believed():
    count = len(OUT_AND_BACK.points_m)
    for index in (-1, count, count + 5):
        assert closest_point(OUT_AND_BACK, pose(2.0, 0.1), index, WINDOW_M)[0] == 20


@settings(deadline=None, max_examples=60)
@given(st.floats(-3, 13), st.floats(-3, 5), st.integers(0, 207), st.floats(0, 360))
def test_a_place_anywhere_is_a_valley_near_the_nearest_and_moves_with_the_world(
    x_m: float, y_m: float, last: int, turn_deg: float
):
    index, deviation_m = closest_point_anywhere(OUT_AND_BACK, pose(x_m, y_m, 40.0), last)
    distances = np.hypot(*(OUT_AND_BACK.points_m - (x_m, y_m)).T)
    assert deviation_m <= distances.min() + 1.0
    assert deviation_m <= distances[max(0, index - 1) : index + 2].min() + 1e-9
    route, place = turned(turn_deg, (x_m, y_m))
    moved = closest_point_anywhere(route, pose(*place, 40.0 + turn_deg), last)
    assert moved[1] == pytest.approx(deviation_m, abs=0.06)


def test_a_route_of_one_point_has_a_closest_point():
    assert closest_point(route_along((1, 1), (1, 1)), pose(4, 5), None, WINDOW_M)[1] == pytest.approx(5.0)


@pytest.mark.parametrize("error_deg", [90.5, 100.0, 133.0, 157.0, -90.5, -157.0])
@pytest.mark.parametrize("share", [0.1, 0.9, -0.1, -0.9])
def test_who_lost_the_place_on_one_side_turns_by_the_other_all_the_way(error_deg: float, share: float):
    left_deg, lost_deg, before, last = error_deg, share * error_deg, None, None
    side = -math.copysign(1.0, lost_deg)
    while abs(left_deg) > 5.0:
        before, last = turn_to_route(rad(left_deg), before, last, rad(lost_deg))
        assert last * side > 0.0 or abs(left_deg) < 90.0
        left_deg, lost_deg = ((angle - side * 10.0 + 180.0) % 360.0 - 180.0 for angle in (left_deg, lost_deg))


def test_what_was_lost_beyond_the_end_of_a_turn_is_not_in_its_way():
    for error_deg, lost_deg in ((100.0, 110.0), (-100.0, -170.0), (149.0, -160.0)):
        assert turn_to_route(rad(error_deg), None, None, rad(lost_deg))[1] == pytest.approx(rad(error_deg))


def test_a_short_turn_is_made_the_short_way_whatever_was_lost():
    for error_deg, lost_deg in ((60.0, 120.0), (60.0, 30.0), (89.5, 120.0), (89.5, 30.0), (-89.5, -30.0)):
        assert turn_to_route(rad(error_deg), None, None, rad(lost_deg))[1] == pytest.approx(rad(error_deg))


@pytest.mark.parametrize("speed_m_s", [0.0, 0.4, 0.7, 1.1])
@pytest.mark.parametrize("turn_deg", [0.0, 137.0])
def test_who_cuts_a_corner_is_not_turned_beside_the_road_behind_it_by_walking_fast(speed_m_s: float, turn_deg: float):
    """They walk along the road behind the corner already; the route has not come to the corner for them yet.

    Somewhat to its side, they are led back to it: gently, and less so the farther ahead they will be led to.
    """
    turn = math.radians(turn_deg)
    rotation = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
    route = route_along(*(tuple(rotation @ corner) for corner in ((0, 0), (10, 0), (10, 10))))
    x_m, y_m = rotation @ (9.7, 0.25)
    here = pose(float(x_m), float(y_m), 88.0 + turn_deg)
    settings_ = FollowerSettings()
    index, _ = closest_point(route, here, 95, WINDOW_M)
    goal = select_aim(route, index, speed_m_s, SubGoal(0.0, 0.0, SubGoalCase.STRAIGHT, 0, 100), settings_)
    assert goal.passed_index > index
    expected = expected_to(route, goal, index, here, speed_m_s, settings_)
    assert -math.radians(25.0) < relative_to(expected, here.heading) < 0.0


@pytest.mark.parametrize("short_m", [0.0, 0.1, 0.2, 0.3])
def test_who_comes_to_a_corner_is_told_the_turn_that_holds_where_they_stand(short_m: float):
    route = route_along((0, 0), (10, 0), (10, 10))
    here, settings_ = pose(10.0 - short_m, 0.0), FollowerSettings()
    index, _ = closest_point(route, here, 95, WINDOW_M)
    goal = select_aim(route, index, 0.3, SubGoal(0.0, 0.0, SubGoalCase.STRAIGHT, 0, 101), settings_)
    expected = expected_to(route, goal, index, here, 0.3, settings_)
    assert math.degrees(expected) == pytest.approx(90.0, abs=16.0)


def test_who_cuts_a_corner_is_not_led_beyond_the_next_one():
    """A short leg: who will stand on it by then is led on along it, as if it went straight on."""
    route = route_along((0, 0), (10, 0), (10, 1.6), (0, 1.6))
    here, settings_ = pose(9.7, 0.28, 90.0), FollowerSettings()
    index, _ = closest_point(route, here, 95, WINDOW_M)
    goal = select_aim(route, index, 0.7, SubGoal(0.0, 0.0, SubGoalCase.STRAIGHT, 0, 100), settings_)
    assert goal.passed_index > index
    expected = expected_to(route, goal, index, here, 0.7, settings_)
    assert -math.radians(25.0) < relative_to(expected, here.heading) <= 0.0


def test_who_cuts_the_last_corner_is_led_to_the_destination_and_not_beyond_it():
    route = route_along((0, 0), (10, 0), (10, 1.2))
    here, settings_ = pose(9.7, 0.25, 88.0), FollowerSettings()
    index, _ = closest_point(route, here, 95, WINDOW_M)
    goal = select_aim(route, index, 0.4, SubGoal(0.0, 0.0, SubGoalCase.STRAIGHT, 0, 100), settings_)
    assert goal.passed_index > index
    on_m = stopping_distance_m(0.4, settings_.reaction_s)
    x_m, y_m = 9.7 + on_m * math.cos(math.radians(88.0)), 0.25 + on_m * math.sin(math.radians(88.0))
    expected = expected_to(route, goal, index, here, 0.4, settings_)
    assert expected == pytest.approx(math.atan2(1.2 - y_m, 10.0 - x_m), abs=0.02)

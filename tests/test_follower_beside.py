"""Round what stands on the road, by a line beside its middle: the nearest free one, kept until it is passed."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from closed_loop import route_along
from hypothesis import given
from hypothesis import strategies as st

from navcore.angles import world_angle
from navcore.follower.aim import aim
from navcore.follower.beside import Line, direction_rad, known_places_m, line_beside
from navcore.settings import Settings
from navcore.types import DecisionTrace, ObstacleScan, Pose2D, Route

HALF_M, AHEAD_M = 0.35, 1.2
ROAD = route_along((0, 0), (10, 0))


IMAGE_RAD = np.radians(np.arange(-60.0, 61.0))
"""A wide image, so that where a line leads is in view."""


def scan_of(pose: Pose2D, places_m: np.ndarray, *, unseen: bool = False) -> ObstacleScan:
    """A scan that knows places (k, 2) of the world, in the image or beside it."""
    offset = np.asarray(places_m, float).reshape(-1, 2) - (pose.x_m, pose.y_m)
    bearing = np.arctan2(offset[:, 1], offset[:, 0]) - pose.heading
    distance, nothing = np.hypot(offset[:, 0], offset[:, 1]), np.zeros(0)
    seen = (nothing, nothing) if unseen else (bearing, distance)
    beside = (bearing, distance) if unseen else (nothing, nothing)
    bearings = np.concatenate([IMAGE_RAD, seen[0]])
    nearest = np.concatenate([np.full(len(IMAGE_RAD), np.inf), seen[1]])
    order = np.argsort(bearings, kind="stable")
    return ObstacleScan(
        bearings[order], nearest[order], np.isfinite(nearest[order]).astype(np.int8), (), 1.0,
        unseen_rad=beside[0], unseen_m=beside[1],
    )  # fmt: skip


def box_on(x_m: float, y_m: float, half_m: float = 0.25) -> np.ndarray:
    side = np.arange(-half_m, half_m + 0.01, 0.05)
    front = np.column_stack([np.full(len(side), x_m - half_m), y_m + side])
    sides = [np.column_stack([x_m + side, np.full(len(side), y_m + sign * half_m)]) for sign in (-1, 1)]
    return np.vstack([front, *sides])


def walls(aside_m: float = 1.2) -> np.ndarray:
    along = np.arange(0.0, 6.0, 0.1)
    return np.vstack([np.column_stack([along, np.full(len(along), sign * aside_m)]) for sign in (-1, 1)])


def line(
    places_m: np.ndarray, pose: Pose2D | None = None, *, last: float = 0.0, route: Route = ROAD, unseen: bool = False
) -> Line | None:
    pose = Pose2D(0.0, 0.0, world_angle(0.0)) if pose is None else pose
    closest = int(np.argmin(np.hypot(*(route.points_m - (pose.x_m, pose.y_m)).T)))
    scan = scan_of(pose, places_m, unseen=unseen)
    return line_beside(route, closest, len(route.points_m) - 1, pose, scan, AHEAD_M, HALF_M, last)


def test_a_free_road_is_followed_itself() -> None:
    assert line(np.zeros((0, 2))) is None
    assert line(walls()) is None
    assert line(box_on(5.0, 0.0)) is None, "what is far ahead is not gone round yet"
    assert line(box_on(2.5, 1.0)) is None, "what stands beside the road is in nobody's way"


@pytest.mark.parametrize("unseen", [False, True])
@pytest.mark.parametrize("aside_m", [0.15, -0.15])
def test_it_goes_round_on_the_side_with_the_smaller_detour(aside_m: float, unseen: bool) -> None:
    found = line(np.vstack([walls(), box_on(2.5, aside_m)]), unseen=unseen)
    assert found is not None
    assert found.offset_m * aside_m < 0.0
    edge_m = abs(abs(aside_m) - 0.25)
    assert edge_m + HALF_M - 0.05 <= abs(found.offset_m) <= 1.2 - HALF_M


def test_where_neither_side_is_wide_enough_there_is_no_line() -> None:
    assert line(np.vstack([walls(0.8), box_on(2.0, 0.0, 0.3)])) is None
    across = np.column_stack([np.full(30, 2.0), np.linspace(-1.4, 1.4, 30)])
    assert line(np.vstack([walls(), across])) is None


def test_the_side_that_was_begun_is_kept() -> None:
    """A box in the very middle: half a step to one side does not change the side of somebody who goes round it."""
    places = np.vstack([walls(), box_on(2.0, 0.0)])
    for last in (-0.6, 0.6):
        for y_m in (-0.1, 0.0, 0.1):
            found = line(places, Pose2D(0.3, y_m, world_angle(0.0)), last=last)
            assert found is not None
            assert found.offset_m * last > 0.0


def test_beside_the_box_nobody_is_led_back_into_it_and_behind_it_back_to_the_road() -> None:
    places = np.vstack([walls(), box_on(2.5, 0.0)])
    beside = line(places, Pose2D(2.2, 0.65, world_angle(0.0)), last=0.7, unseen=True)
    assert beside is not None
    assert beside.offset_m >= 0.45, "over the rest of the box the line is still at least half a person beside it"
    assert line(places, Pose2D(3.2, 0.6, world_angle(0.0)), last=0.7, unseen=True) is None


def test_it_ends_where_the_road_turns_sharply() -> None:
    places = box_on(2.0, 0.0)
    pose = Pose2D(0.0, 0.0, world_angle(0.0))
    assert line_beside(ROAD, 0, 1, pose, scan_of(pose, places), AHEAD_M, HALF_M, 0.0) is None
    assert line_beside(ROAD, 0, 12, pose, scan_of(pose, places), AHEAD_M, HALF_M, 0.0) is None
    assert line_beside(ROAD, 0, 40, pose, scan_of(pose, places), AHEAD_M, HALF_M, 0.0) is not None


def test_a_line_that_was_begun_behind_a_corner_is_kept_by_who_turns_to_it() -> None:
    """The camera is before the body's axis: turning on the spot it comes a little before the corner again."""
    route, settings = route_along((0, 0), (6, 0), (6, 8)), Settings()
    places = box_on(6.0, 1.2)
    pose = Pose2D(6.0, 0.2, world_angle(math.pi / 2))
    corner = aim(route, Pose2D(5.9, 0.0, pose.heading), 0.0, None, scan_of(pose, places), settings)
    assert corner.goal.passed_index > 0
    trace = DecisionTrace(sub_goal=corner.goal, closest_index=corner.closest_index)
    begun = aim(route, pose, 0.0, trace, scan_of(pose, places), settings)
    assert begun.closest_index >= corner.goal.passed_index
    assert begun.offset_m != 0.0
    turned = Pose2D(5.85, -0.02, world_angle(math.pi / 2 + 0.4))
    for offset_m, kept in ((begun.offset_m, True), (0.0, False)):
        before = replace(trace, closest_index=begun.closest_index, sub_goal=begun.goal, offset_m=offset_m)
        there = aim(route, turned, 0.0, before, scan_of(turned, places), settings)
        assert there.closest_index < there.goal.passed_index
        assert (there.offset_m * begun.offset_m > 0.0) is kept
    other_leg = replace(before, offset_m=begun.offset_m, sub_goal=replace(begun.goal, passed_index=0))
    assert aim(route, turned, 0.0, other_leg, scan_of(turned, places), settings).offset_m == 0.0
    far_back = Pose2D(5.2, 0.0, turned.heading)
    before = replace(before, offset_m=begun.offset_m)
    assert aim(route, far_back, 0.0, before, scan_of(far_back, places), settings).offset_m == 0.0


@given(
    places=st.lists(st.tuples(st.floats(0.5, 3.4), st.floats(-1.4, 1.4)), min_size=1, max_size=12),
    y_m=st.floats(0.0113, 0.3),
    turn_deg=st.floats(-180, 180),
    shift=st.tuples(st.floats(-50, 50), st.floats(-50, 50)),
)
def test_a_line_keeps_clear_of_everything_and_moves_with_the_world(
    places: list[tuple[float, float]], y_m: float, turn_deg: float, shift: tuple[float, float]
) -> None:
    pose = Pose2D(0.0, y_m, world_angle(0.1))
    # Off the grid of stations and lines, where rounding decides.
    table = np.array(places) + np.array([0.0371, 0.0173])
    found = line(table, pose)
    if found is not None:
        # As far as a line must be free: over the straight piece nothing is nearer to it than half a person.
        near = table[(table[:, 0] > 1.3) & (table[:, 0] < 1.5)]
        assert (np.abs(near[:, 1] - found.offset_m) >= HALF_M - 1e-9).all()
    turn = math.radians(turn_deg)
    rotation = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
    route = Route(ROAD.points_m @ rotation.T + shift, ROAD.arc_length_m, ROAD.stops)
    x, y = rotation @ (pose.x_m, pose.y_m) + shift
    moved = line(table @ rotation.T + shift, Pose2D(x, y, world_angle(pose.heading + turn)), route=route)
    assert (moved is None) == (found is None)
    if moved is not None and found is not None:
        assert moved.offset_m == found.offset_m
        np.testing.assert_allclose((moved.x_m, moved.y_m), rotation @ (found.x_m, found.y_m) + shift, atol=1e-6)


def test_what_is_known_is_where_it_is_whichever_way_one_faces() -> None:
    places = box_on(2.0, 0.4)
    for heading_deg in (-150.0, 0.0, 77.0):
        pose = Pose2D(1.0, -0.5, world_angle(math.radians(heading_deg)))
        for unseen in (False, True):
            known = known_places_m(scan_of(pose, places, unseen=unseen), pose)
            np.testing.assert_allclose(
                known[np.lexsort(known.T.round(6))], places[np.lexsort(places.T.round(6))], atol=1e-9
            )
    assert direction_rad(Line(0.0, 1.0, 0.5), Pose2D(1.0, -0.5, world_angle(0.0))) == pytest.approx(math.pi / 2)


def test_nobody_is_led_where_nobody_has_looked() -> None:
    """The image shows a box across all of it: past its edges nothing has been seen."""
    pose = Pose2D(0.0, 0.0, world_angle(0.0))
    wall = np.column_stack([np.full(21, 0.7), np.linspace(-0.5, 0.5, 21)])
    narrow = scan_of(pose, wall)
    inside = np.abs(narrow.bearing_rad) < np.radians(36.0)
    image = replace(
        narrow, bearing_rad=narrow.bearing_rad[inside], nearest_m=narrow.nearest_m[inside], state=narrow.state[inside]
    )
    assert line_beside(ROAD, 0, 90, pose, image, AHEAD_M, HALF_M, 0.0) is None

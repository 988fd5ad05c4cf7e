"""What was seen in the way stays in the way when it leaves the image, until the image shows that it has gone."""

from __future__ import annotations

import math

import numpy as np
import pytest
from closed_loop import CAMERA, EYE_M, PITCH_RAD, box, depth_image
from hypothesis import given
from hypothesis import strategies as st

from navcore.angles import world_angle
from navcore.geometry import world_from_camera_at
from navcore.obstacle.memory import CELL_M, ObstacleMemory, is_hidden_ahead, remember, remember_heard, with_memory
from navcore.obstacle.scan import nothing_known, scan
from navcore.settings import ObstacleSettings
from navcore.types import BearingState, ObstacleScan, Pose2D

SETTINGS = ObstacleSettings()
LOW_BOX = box(2.5, -0.2, 2.9, 0.2, 0.3)
TALL_BOX = box(2.5, -0.2, 2.9, 0.2, 1.7)


def seen(solids, x_m: float, heading_deg: float = 0.0) -> tuple[ObstacleScan, Pose2D]:
    heading = math.radians(heading_deg)
    camera = world_from_camera_at((x_m, 0.0, EYE_M), heading, PITCH_RAD)
    return scan(depth_image(solids, camera), CAMERA, camera, SETTINGS), Pose2D(x_m, 0.0, world_angle(heading))


def walked_up(solids, places_m, memory: ObstacleMemory | None = None, start_s: float = 0.0) -> ObstacleMemory:
    memory = ObstacleMemory() if memory is None else memory
    for k, x_m in enumerate(places_m):
        memory = remember(memory, *seen(solids, x_m), start_s + 0.1 * k)
    return memory


def test_a_low_box_is_still_in_the_way_when_it_is_below_the_image() -> None:
    memory = walked_up((LOW_BOX,), np.arange(0.0, 1.7, 0.1))
    now, pose = seen((LOW_BOX,), 1.9)
    assert now.nearest_ahead_m is None, "the image does not show it: 0.6 m away and 0.3 m high"
    known = with_memory(now, memory, pose, SETTINGS)
    assert known.nearest_ahead_m is not None
    assert abs(known.nearest_ahead_m - 0.6) < CELL_M
    assert not any(abs(each.angle) < math.radians(10) for each in known.candidates)
    assert any(abs(each.angle) < math.radians(10) for each in now.candidates), "the image alone would lead over it"


def test_what_is_beside_the_image_closes_the_directions_that_lead_into_it() -> None:
    memory = walked_up((LOW_BOX,), np.arange(0.0, 1.7, 0.1))
    now, pose = seen((LOW_BOX,), 1.7, heading_deg=40.0)
    free = {round(math.degrees(each.angle)) for each in now.candidates}
    known = {round(math.degrees(each.angle)) for each in with_memory(now, memory, pose, SETTINGS).candidates}
    assert known < free
    assert all(angle < 0 for angle in free - known), "it is to the right"


def test_it_is_forgotten_where_the_image_shows_that_it_has_gone() -> None:
    there = walked_up((TALL_BOX,), np.arange(0.0, 0.5, 0.1))
    gone = walked_up((), [0.5], there, start_s=0.5)
    now, pose = seen((), 0.5)
    assert with_memory(now, there, pose, SETTINGS).nearest_ahead_m is not None
    assert with_memory(now, gone, pose, SETTINGS).nearest_ahead_m is None


def test_a_low_thing_is_remembered_longer_than_somebody_who_may_have_walked_on() -> None:
    near, far = [0.6, 0.7, 0.8], [1.4, 1.5, 1.6]
    for solid, places_m, after_s, remembered in (
        (LOW_BOX, near, 15.0, True), (TALL_BOX, far, 3.0, False), (LOW_BOX, near, 25.0, False),
    ):  # fmt: skip
        memory = walked_up((solid,), places_m)
        # Seen from the other side nothing of it is in the image.
        away = Pose2D(1.7, 0.0, world_angle(math.pi))
        image, _ = seen((), 1.7, heading_deg=180.0)
        memory = remember(memory, image, away, 0.2 + after_s)
        assert bool(len(memory.cell)) is remembered


def is_in_the_way(memory: ObstacleMemory, image: ObstacleScan, pose: Pose2D) -> bool:
    return with_memory(image, memory, pose, SETTINGS).nearest_ahead_m is not None


@pytest.mark.parametrize("high_m", [0.3, 0.9, 1.0, 1.2])
@pytest.mark.parametrize("heading_deg", [0.0, 40.0, 180.0])
def test_something_low_that_no_image_can_show_is_in_the_way_however_long_the_walker_stands(
    heading_deg: float, high_m: float
) -> None:
    """A stack of cartons, 0.9 m high, was forgotten after 20 s by somebody who looked round beside it, and then met."""
    low = (box(2.5, -0.2, 2.55, 0.2, high_m),)
    memory = walked_up(low, np.arange(0.0, 2.2, 0.1))
    for second in range(2, 3602, 10):
        memory = remember(memory, *seen(low, 2.15, heading_deg), float(second))
    image, pose = seen(low, 2.15)
    assert image.nearest_ahead_m is None, "it is 0.35 m away"
    assert is_in_the_way(memory, image, pose)


def test_the_edges_of_something_low_are_seen_less_often_and_remembered_for_as_long() -> None:
    """Half of a box forgotten, somebody was led by what was left of it, and brushed the other half."""
    cell = np.array([[25, 0], [25, 1], [25, 2], [25, 3], [24, -2], [25, -1]])
    memory = ObstacleMemory(cell, np.full(6, 0.3), np.zeros(6), np.array([10, 3, 2, 5, 2, 1]))
    image, pose = seen((), 1.9)
    later = remember(memory, image, pose, 60.0)
    assert {(25, 0), (25, 1), (25, 2), (24, -2)} == {(int(x), int(y)) for x, y in later.cell}


def test_only_what_no_image_shows_is_hidden_ahead() -> None:
    """A low box at the feet is; a wall that is seen, or that has gone a little back, is not; nor what lies aside."""
    low, wall = (box(4.0, -0.5, 4.4, 0.5, high_m=0.3),), (box(4.0, -2.0, 4.2, 2.0),)
    at_the_box = walked_up(low, (0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 3.2))
    image, pose = seen((), 3.2)
    assert is_hidden_ahead(image, at_the_box, pose, SETTINGS)
    image, pose = seen((), 3.2, heading_deg=90.0)
    assert not is_hidden_ahead(image, at_the_box, pose, SETTINGS), "it is beside them now"
    image, pose = seen(low, 1.0)
    assert not is_hidden_ahead(image, walked_up(low, (0.2, 0.5, 1.0)), pose, SETTINGS), "it is in the image"
    before_it = walked_up(wall, (1.5, 2.0, 2.5))
    for back_m in (0.0, 0.15, 0.27):
        image, pose = seen((box(4.0 + back_m, -2.0, 4.4, 2.0),), 2.5)
        assert not is_hidden_ahead(image, before_it, pose, SETTINGS)


def test_neither_a_gap_in_the_poses_nor_an_image_without_depth_lets_it_be_forgotten() -> None:
    memory = walked_up((LOW_BOX,), np.arange(0.0, 1.7, 0.1))
    image, pose = seen((LOW_BOX,), 1.9)
    memory = remember(memory, image, pose, 1000.0)
    memory = remember(memory, nothing_known(np.full((120, 160), np.nan, np.float32)), pose, 2000.0)
    assert is_in_the_way(memory, image, pose)


def test_who_steps_back_from_something_low_sees_whether_it_has_gone() -> None:
    memory = walked_up((LOW_BOX,), np.arange(0.0, 1.7, 0.1))
    memory = remember(memory, *seen((LOW_BOX,), 1.9), 500.0)
    there = walked_up((LOW_BOX,), np.arange(1.8, 0.4, -0.1), memory, start_s=500.0)
    gone = walked_up((), np.arange(1.8, 0.4, -0.1), memory, start_s=500.0)
    image, pose = seen((), 1.9)
    assert is_in_the_way(there, image, pose)
    assert not is_in_the_way(gone, image, pose)


def test_who_is_far_from_something_low_has_it_seen_again_by_the_image() -> None:
    memory = walked_up((LOW_BOX,), np.arange(0.0, 1.7, 0.1))
    image, _ = seen((), 1.9)
    assert not len(remember(memory, image, Pose2D(6.0, 0.0, world_angle(0.0)), 20.0).cell)


def test_what_the_image_shows_a_little_farther_away_is_believed_in_time() -> None:
    """Poses tremble: places in front of a thing that was never there must not stay in the way of those who look on."""
    memory = walked_up((LOW_BOX,), [0.5] * 8)
    moved = (box(2.7, -0.2, 3.1, 0.2, 0.3),)
    for second, remembered in ((60.0, True), (130.0, False)):
        later = remember(memory, *seen(moved, 0.5), second)
        assert bool((later.places_m[:, 0] < 2.6).any()) is remembered


def test_what_was_seen_once_only_may_be_noise() -> None:
    memory = walked_up((LOW_BOX,), [0.8])
    now, pose = seen((), 1.7)
    assert with_memory(now, memory, pose, SETTINGS).candidates == now.candidates


def test_a_drop_is_remembered_as_a_drop_for_as_long_as_somebody_stands_before_it() -> None:
    bearing_rad = np.radians(np.arange(-20.0, 21.0))
    state = np.full(len(bearing_rad), BearingState.DROP, np.int8)
    edge = ObstacleScan(
        bearing_rad, 1.5 / np.cos(bearing_rad), state, (), 1.0,
        top_m=np.zeros(len(bearing_rad)), steepest=np.full(len(bearing_rad), 0.9), eye_m=EYE_M,
    )  # fmt: skip
    memory = ObstacleMemory()
    for k in range(8):
        memory = remember(memory, edge, Pose2D(0.0, 0.0, world_angle(0.0)), 0.1 * k)
    now, pose = seen((), 0.6)
    memory = remember(memory, now, pose, 600.0)
    known = with_memory(now, memory, pose, SETTINGS)
    ahead = np.abs(known.bearing_rad) < math.radians(5.0)
    assert BearingState.DROP in known.state[ahead]
    assert BearingState.OBSTACLE not in known.state[ahead]
    assert known.nearest_ahead_m is not None
    assert known.nearest_ahead_m < 1.0


@given(
    places=st.lists(st.tuples(st.floats(-3, 3), st.floats(-3, 3), st.floats(0, 1.9)), max_size=30),
    heading=st.floats(-180, 180),
)
def test_what_is_remembered_only_ever_closes(places: list[tuple[float, float, float]], heading: float) -> None:
    table = np.array(places).reshape(-1, 3)
    memory = ObstacleMemory(
        np.floor(table[:, :2] / CELL_M).astype(np.int64), table[:, 2],
        np.zeros(len(table)), np.full(len(table), 5, np.int64),
    )  # fmt: skip
    now, pose = seen((TALL_BOX,), 0.0, heading)
    known = with_memory(now, memory, pose, SETTINGS)
    free = {round(each.angle, 4): each for each in now.candidates}
    for each in known.candidates:
        assert each.clearance_m <= free[round(each.angle, 4)].clearance_m + 1e-9
    was_m, is_m = now.nearest_m, known.nearest_m
    assert (np.nan_to_num(is_m, nan=-1.0, posinf=99.0) <= np.nan_to_num(was_m, nan=99.0, posinf=99.0) + 1e-9).all()


def test_memory_stays_small_however_long_the_walk() -> None:
    memory = walked_up((LOW_BOX, box(0, 1.0, 60, 1.2)), np.arange(0.0, 40.0, 0.25))
    assert len(memory.cell) < 200


# ---------------------------------------------------------------------------------------------------------- echoes
HALF_FIELD_RAD = math.radians(7.5)


def heard(echo_m: float | None, pose: Pose2D, memory: ObstacleMemory | None = None, solids=(), now_s: float = 0.0):
    image, _ = seen(solids, pose.x_m, math.degrees(pose.heading))
    memory = ObstacleMemory() if memory is None else memory
    return remember_heard(memory, image, echo_m, HALF_FIELD_RAD, pose, now_s)


def test_a_pane_stays_in_the_way_of_somebody_who_has_turned_away_from_it() -> None:
    towards, away = Pose2D(0.0, 0.0, world_angle(0.0)), Pose2D(0.0, 0.0, world_angle(math.radians(25.0)))
    memory = heard(1.0, towards, heard(1.0, towards), now_s=0.1)
    memory = heard(4.25, away, memory, now_s=1.0)
    image, _ = seen((), 0.0, 25.0)
    known = with_memory(image, memory, away, SETTINGS)
    towards_pane = [each for each in known.candidates if abs(math.degrees(each.angle) + 25.0) < 10.0]
    assert all(each.clearance_m < 1.1 for each in towards_pane)
    assert any(each.clearance_m > 3.0 for each in known.candidates), "elsewhere the way is free"


def test_it_is_forgotten_when_the_rangefinder_hears_farther_there_or_in_time() -> None:
    pose = Pose2D(0.0, 0.0, world_angle(0.0))
    memory = heard(1.0, pose, heard(1.0, pose), now_s=0.1)
    assert len(memory.cell)
    assert len(heard(4.25, pose, memory, now_s=0.2).cell) == len(memory.cell), "one echo that fails says nothing"
    left = heard(4.25, pose, memory, now_s=0.8)
    bearings_rad = np.arctan2(left.places_m[:, 1], left.places_m[:, 0])
    assert (np.abs(bearings_rad) > HALF_FIELD_RAD).all(), "only beside the field, where nothing has listened"
    assert len(left.cell) < len(memory.cell)
    assert len(heard(None, pose, memory, now_s=5.0).cell), "a rangefinder that fails shows nothing to be free"
    assert not len(heard(None, pose, memory, now_s=20.0).cell)


def test_what_was_heard_often_is_remembered_for_as_long_as_going_round_it_takes() -> None:
    pose = Pose2D(0.0, 0.0, world_angle(0.0))
    memory = heard(1.0, pose)
    for k in range(1, 6):
        memory = heard(1.0, pose, memory, now_s=0.1 * k)
    assert len(heard(None, pose, memory, now_s=30.0).cell) == len(memory.cell)
    assert not len(heard(None, pose, memory, now_s=45.0).cell)


def test_what_is_heard_may_reach_beyond_the_field() -> None:
    """A pane has no edge that could be heard."""
    pose = Pose2D(0.0, 0.0, world_angle(0.0))
    aside_m = np.abs(heard(1.0, pose).places_m[:, 1]).max()
    assert aside_m > math.sin(HALF_FIELD_RAD) + 0.1


def test_what_the_image_shows_as_well_is_not_remembered_twice() -> None:
    pose = Pose2D(1.0, 0.0, world_angle(0.0))
    assert not len(heard(1.5, pose, solids=(TALL_BOX,)).cell)
    assert len(heard(0.8, pose, solids=(TALL_BOX,)).cell), "a pane before the box"
    assert not len(heard(3.0, pose).cell), "what is far will be heard again"

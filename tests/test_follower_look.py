"""Looking for a way round: the more open side first, then the other one, and no third."""

from __future__ import annotations

import math

import numpy as np
import pytest
from closed_loop import route_along
from hypothesis import given, settings
from hypothesis import strategies as st

from navcore.angles import relative_angle, world_angle, wrap_rad
from navcore.follower.look import LOOK_RAD, LOOK_ROUND, is_left_more_open, look_target
from navcore.geometry import world_from_camera_at
from navcore.guide import guide
from navcore.settings import Settings
from navcore.types import (
    Action,
    BearingState,
    DecisionTrace,
    Guidance,
    Localization,
    LocalizationQuality,
    ObstacleScan,
    Reason,
    TurnKind,
)

INF, NAN = math.inf, math.nan
BEARINGS_DEG = (-20.0, -10.0, 0.0, 10.0, 20.0)


def scan_of(*nearest_m: float) -> ObstacleScan:
    """What is nearest from right to left, 10° apart."""
    state = np.zeros(len(nearest_m), dtype=np.int8)
    return ObstacleScan(np.radians(BEARINGS_DEG[: len(nearest_m)]), np.array(nearest_m), state, (), 1.0)


def rad(angle_deg: float):
    return relative_angle(math.radians(angle_deg))


OPEN_LEFT, OPEN_RIGHT = scan_of(1, 1, 1, 2, 2), scan_of(2, 2, 1, 1, 0.5)


@pytest.mark.parametrize(
    ("nearest_m", "error_deg", "is_left"),
    [
        ((1, 1, 1, 2, 2), 0, True),
        ((2, 2, 1, 2, 2), 0, False),  # what is straight in the expected direction counts to the right
        ((2, 2, 1, 2, 3), 0, True),
        ((1, 1, INF, 2, 2), 5, False),
        ((1, 1, INF, 2, 2), -5, True),
        ((1, 1, 0, 1, 1), 0, True),  # as open: to the left
        ((1, 1, 0, 1, 0.99), 0, False),
        ((3, 3, 0, INF, INF), 0, True),  # nothing counts farther away than 3 m
        ((3, 3, 0, 8, 7.5), 0, True),
        ((3, 3, 0.5, INF, INF), 0, False),
        ((1, 1, 0, NAN, NAN), 0, False),  # what nobody has seen is not open
        ((NAN, NAN, NAN, 0.1, NAN), 0, True),
        ((), 0, True),
    ],
)
def test_which_side_is_more_open(nearest_m: tuple[float, ...], error_deg: float, is_left: bool):
    assert is_left_more_open(scan_of(*nearest_m), rad(error_deg)) is is_left


@pytest.mark.parametrize("expected_deg", [0.0, 40.0, 350.0])
@pytest.mark.parametrize(
    ("scan", "last_deg", "look_count", "target_deg"),
    [
        (OPEN_LEFT, None, 0, 30),
        (OPEN_RIGHT, None, 0, -30),
        (OPEN_LEFT, None, 1, -30),
        (OPEN_RIGHT, None, 1, 30),
        (OPEN_LEFT, 30, 1, -30),  # from the one side to the other, whatever is seen there
        (OPEN_RIGHT, 30, 1, -30),
        (OPEN_LEFT, -30, 1, 30),
        (OPEN_RIGHT, -30, 1, 30),
        (OPEN_LEFT, 5, 0, -30),
        (OPEN_LEFT, -5, 0, 30),
        (OPEN_RIGHT, 0, 0, 30),
    ],
)
def test_in_which_direction_is_looked(
    scan: ObstacleScan, last_deg: float | None, look_count: int, target_deg: float, expected_deg: float
):
    expected = world_angle(math.radians(expected_deg))
    last = None if last_deg is None else world_angle(math.radians(expected_deg + last_deg))
    target = look_target(expected, scan, last, rad(0), look_count)
    assert 0.0 <= target < math.tau
    # Within rounding: straight on is neither side.
    if last_deg != 0 or last == expected:
        assert math.degrees(wrap_rad(target - expected)) == pytest.approx(target_deg)


@settings(deadline=None)
@given(
    nearest_m=st.lists(st.floats(0.3, 5.0) | st.just(INF) | st.just(NAN), min_size=5, max_size=5),
    expected=st.floats(0.0, 6.28),
)
def test_both_sides_are_looked_at_whichever_is_first(nearest_m: list[float], expected: float):
    scan = scan_of(*nearest_m)
    first = look_target(world_angle(expected), scan, None, rad(0), 0)
    second = look_target(world_angle(expected), scan, first, rad(0), 1)
    offs = [wrap_rad(each - expected) for each in (first, second)]
    assert sorted(offs) == pytest.approx([-LOOK_RAD, LOOK_RAD])
    assert (offs[0] > 0.0) is is_left_more_open(scan, rad(0))


def test_who_is_lost_has_looked_everywhere_after_eight_turns():
    assert pytest.approx(math.tau / 8) == LOOK_ROUND


# ------------------------------------------------------------------------------------- when, in guidance as a whole
ROUTE, CHOSEN = route_along((0, 0), (10, 0)), Settings()
WALL = ObstacleScan(
    np.radians(np.arange(-29.5, 30.0)),
    np.full(60, 1.0),
    np.full(60, int(BearingState.OBSTACLE), dtype=np.int8),
    (),
    1.0,
    1.0,
)
"""A wall across all of the image."""


def after(stopped_s: float, look_count: int = 0, look: float | None = None) -> Guidance:
    """Guidance of who has stood before something for so long, and has looked at so many sides."""
    target = None if look is None else world_angle(look)
    trace = DecisionTrace(
        heading=world_angle(0.0), position=(0.0, 0.0), stopped_since_s=100.0 - stopped_s, look_count=look_count,
        look_target=target, closest_index=0, turn=None if look is None else TurnKind.LOOK,
    )  # fmt: skip
    action = Action.STOP if look is None else Action.TURN
    before = Guidance(99.9, action, None, Reason.OBSTACLE_DEPTH, trace)
    heading = 0.0 if look is None else look
    located = Localization(100.0, LocalizationQuality.LOCALIZED, world_from_camera_at((0.0, 0.0, 1.6), heading, 0.26))
    return guide(100.0, located, ROUTE, WALL, None, before, CHOSEN)


@pytest.mark.parametrize(
    ("stopped_s", "look_count", "look_rad", "looks"),
    [
        (1.9, 0, None, False),  # people who stand in the way mostly walk on
        (2.0, 0, None, True),
        (9.0, 0, None, True),
        (9.0, 1, None, True),
        (9.0, 2, None, False),  # both sides have been looked at
        (9.0, 1, LOOK_RAD, True),
        (2.5, 1, LOOK_RAD, True),
        (9.0, 2, -LOOK_RAD, False),
    ],
)
def test_who_has_stood_for_a_while_is_turned_to_one_side_and_to_the_other(
    stopped_s: float, look_count: int, look_rad: float | None, looks: bool
):
    found = after(stopped_s, look_count, look_rad)
    assert (found.trace.turn is TurnKind.LOOK) is looks
    assert found.action is not Action.WALK
    if looks:
        assert found.trace.look_count == look_count + 1
        assert found.trace.look_target is not None
        assert abs(wrap_rad(found.trace.look_target)) == pytest.approx(LOOK_RAD)


@pytest.mark.parametrize(
    ("lost_s", "turns"), [(0.0, False), (3.9, False), (4.0, True), (20.0, True), (43.9, True), (44.0, False)]
)
def test_who_stays_lost_is_turned_round_after_four_seconds_for_forty(lost_s: float, turns: bool):
    trace = DecisionTrace(lost_since_s=100.0 - lost_s, lost_index=0)
    before = Guidance(99.9, Action.STOP, None, Reason.POSE_LOST, trace)
    found = guide(100.0, Localization(100.0, LocalizationQuality.LOST, None), ROUTE, WALL, None, before, CHOSEN)
    assert (found.action, found.direction) == ((Action.TURN, LOOK_ROUND) if turns else (Action.STOP, None))

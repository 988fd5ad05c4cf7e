"""How much room somebody needs to be stopped now: by walking it step by step, as people react, gain speed and brake."""

from __future__ import annotations

import math

import numpy as np
import pytest
from closed_loop import route_along

from navcore.angles import world_angle
from navcore.geometry import world_from_camera_at
from navcore.guide import guide
from navcore.settings import Settings
from navcore.types import (
    Action,
    CandidateDirection,
    DecisionTrace,
    Guidance,
    Localization,
    LocalizationQuality,
    ObstacleScan,
    Reason,
)

ROUTE = route_along((0, 0), (20, 0))
BEARINGS = np.radians(np.arange(-30.0, 31.0))
FREE = ObstacleScan(
    BEARINGS, np.full(len(BEARINGS), np.inf), np.zeros(len(BEARINGS), dtype=np.int8),
    tuple(CandidateDirection(math.radians(angle), 6.0, 3.0) for angle in range(-27, 28, 3)), 1.0,  # type: ignore[arg-type]
)  # fmt: skip
BODY_M, GAINS_M_S2, BRAKES_M_S2, LAG_S, USUAL_M_S = 0.25, 0.6, 1.2, 0.25, 0.85


def room_m(speed_m_s: float, action: Action | None, fastest_m_s: float = 0.0, slow_s: float = 0.9) -> float | None:
    """The room that guidance asks for, of somebody who has been walking as fast as that."""
    before = None
    if action is not None:
        trace = DecisionTrace(
            heading=world_angle(0.0), position=(2.0 - 0.1 * speed_m_s, 0.0), velocity_m_s=(speed_m_s, 0.0),
            fastest_m_s=fastest_m_s, closest_index=20,
        )  # fmt: skip
        before = Guidance(0.9, action, None, Reason.OK, trace)
    located = Localization(1.0, LocalizationQuality.LOCALIZED, world_from_camera_at((2.0, 0.0, 1.6), 0.0, 0.26))
    settings = Settings().changed({"obstacle.slow_reaction_s": slow_s, "obstacle.stop_distance_m": 0.5})
    return guide(1.0, located, ROUTE, FREE, None, before, settings).trace.stop_m


def walked_m(speed_m_s: float, up_to_m_s: float, slow_s: float) -> float:
    """How far somebody comes who gains speed until they react, and then brakes."""
    step_s, gone_m, now_s = 1e-4, 0.0, 0.0
    while speed_m_s > 0.0:
        gone_m += speed_m_s * step_s
        if now_s >= slow_s:
            speed_m_s -= BRAKES_M_S2 * step_s
        elif speed_m_s < up_to_m_s:
            speed_m_s = min(up_to_m_s, speed_m_s + GAINS_M_S2 * step_s)
        now_s += step_s
    return gone_m


@pytest.mark.parametrize("slow_s", [0.4, 0.9, 1.5])
@pytest.mark.parametrize(("speed_m_s", "fastest_m_s"), [(0.3, 0.0), (0.5, 0.3), (0.8, 0.8), (0.5, 1.2), (1.2, 0.9)])
def test_who_was_told_to_walk_may_be_gaining_speed_up_to_their_own(speed_m_s: float, fastest_m_s: float, slow_s: float):
    up_to_m_s = max(USUAL_M_S, fastest_m_s, speed_m_s)
    # The measured speed is of a moment ago.
    now_m_s = min(speed_m_s + GAINS_M_S2 * LAG_S, up_to_m_s)
    expected_m = BODY_M + walked_m(now_m_s, up_to_m_s, slow_s)
    assert room_m(speed_m_s, Action.WALK, fastest_m_s, slow_s) == pytest.approx(max(0.5, expected_m), abs=2e-3)


@pytest.mark.parametrize("action", [Action.STOP, Action.TURN])
@pytest.mark.parametrize(("speed_m_s", "fastest_m_s"), [(0.4, 0.0), (0.8, 1.2), (1.2, 0.0)])
def test_who_was_told_to_stand_gains_no_more(speed_m_s: float, fastest_m_s: float, action: Action):
    expected_m = BODY_M + walked_m(speed_m_s, speed_m_s, 0.9)
    assert room_m(speed_m_s, action, fastest_m_s) == pytest.approx(expected_m, abs=2e-3)


def test_who_has_not_walked_needs_no_more_than_the_stop_distance():
    assert room_m(0.0, None) == room_m(0.0, Action.STOP) == 0.5


@pytest.mark.parametrize("slow_s", [0.4, 0.9])
def test_who_begins_to_walk_is_taken_for_one_who_does(slow_s: float):
    standing = BODY_M + walked_m(GAINS_M_S2 * LAG_S, USUAL_M_S, slow_s)
    assert room_m(0.0, Action.WALK, slow_s=slow_s) == pytest.approx(max(0.5, standing), abs=2e-3)

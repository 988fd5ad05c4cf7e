"""A camera, or a head, that looks aside of the way is told of; one that looks about, or turns with the way, is not."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from device_hall import Rig, pose_at
from device_room import END, START, small_room
from hypothesis import given, settings
from hypothesis import strategies as st

from device_agent.adapters.fakes import FakeLocalizer
from device_agent.simulation.building import Start
from device_agent.simulation.gait import USUAL_MOUNT
from device_agent.simulation.walker import drawn_walker
from device_agent.simulation.world import SimulatedWorld
from device_agent.state import DeviceState
from device_agent.walk import Moment, lead
from navcore.angles import world_angle
from navcore.modes import Mode
from navcore.obstacle.facing import LEG_M, FacingWatch, faced
from navcore.planning.poi_graph import Edge, Poi, PoiGraph
from navcore.settings import CalibrationSettings, Settings
from navcore.types import Action, Frame, Localization, LocalizationQuality, Pose2D

LIMITS = CalibrationSettings()
RATE_HZ = 10.0
SPEED_M_S = 0.8


def walked(
    watch: FacingWatch,
    length_m: float,
    offset_deg: float,
    *,
    course_rad: float = 0.0,
    bend_rad_m: float = 0.0,
    speed_m_s: float = SPEED_M_S,
    begin_s: float = 0.0,
    noise_m: float = 0.0,
    sway_deg: float = 0.0,
) -> FacingWatch:
    """Walk on from (0, 0), the camera looking so far to the left of the way."""
    rng = np.random.default_rng(1)
    x_m = y_m = 0.0
    for number in range(round(length_m / speed_m_s * RATE_HZ)):
        stamp_s, step_m = begin_s + number / RATE_HZ, speed_m_s / RATE_HZ
        course_rad += bend_rad_m * step_m
        x_m, y_m = x_m + step_m * math.cos(course_rad), y_m + step_m * math.sin(course_rad)
        heading = course_rad + math.radians(offset_deg + sway_deg * math.sin(5.0 * stamp_s))
        dx_m, dy_m = rng.normal(0.0, noise_m, 2) if noise_m else (0.0, 0.0)
        watch = faced(watch, stamp_s, Pose2D(x_m + dx_m, y_m + dy_m, world_angle(heading)), LIMITS)
    return watch


ENOUGH_M = LIMITS.turned_after_m + 2 * LEG_M


@settings(deadline=None)
@given(
    course_rad=st.floats(-math.pi, math.pi), offset_deg=st.floats(-80.0, 80.0), noise_m=st.floats(0.0, 0.02),
    sway_deg=st.floats(0.0, 4.0),
)  # fmt: skip
def test_whoever_looks_aside_on_a_straight_way_is_found_out_and_nobody_else(
    course_rad: float, offset_deg: float, noise_m: float, sway_deg: float
) -> None:
    watch = walked(
        FacingWatch(), ENOUGH_M, offset_deg, course_rad=course_rad, noise_m=noise_m, sway_deg=sway_deg
    )  # fmt: skip
    if abs(offset_deg) > LIMITS.yaw_tolerance_deg + 3.0:
        assert watch.turned
        assert math.degrees(watch.offset_rad) == pytest.approx(offset_deg, abs=3.0)
    elif abs(offset_deg) < LIMITS.yaw_tolerance_deg - 3.0:
        assert not watch.turned


@pytest.mark.parametrize(
    "walk",
    [
        pytest.param({"length_m": LIMITS.turned_after_m - LEG_M, "offset_deg": 40.0}, id="too short"),
        pytest.param({"length_m": 20.0, "offset_deg": 30.0, "bend_rad_m": 0.4}, id="in a bend"),
        pytest.param({"length_m": 3.0, "offset_deg": 40.0, "speed_m_s": 0.1}, id="hardly moving"),
        pytest.param({"length_m": 20.0, "offset_deg": 175.0}, id="backwards"),
        pytest.param({"length_m": 20.0, "offset_deg": 0.0, "sway_deg": 40.0}, id="looking about"),
    ],
)
def test_what_tells_nothing_is_not_believed(walk: dict[str, float]) -> None:
    assert not walked(FacingWatch(), **walk).turned


def test_unknown_neither_confirms_nor_ends_it() -> None:
    turned = walked(FacingWatch(), ENOUGH_M, 30.0)
    assert turned.turned
    for number in range(100):
        turned = faced(turned, 100.0 + number / RATE_HZ, None, LIMITS)
    assert turned.turned
    assert not walked(turned, 5.0, 0.0, begin_s=200.0).turned
    half = walked(FacingWatch(), LIMITS.turned_after_m / 2, 30.0)
    half = faced(half, 50.0, None, LIMITS)
    assert not walked(half, LIMITS.turned_after_m / 2 + LEG_M, 30.0, begin_s=51.0).turned


# ---------------------------------------------------------------------------------------------------- the agent
def test_the_walker_is_told_once_and_is_not_stopped_for_it() -> None:
    rig = Rig()
    rig.lead_to()
    actions = set()

    def go(begin_m: float, length_m: float, looks_left_deg: float) -> None:
        for number in range(round(length_m / SPEED_M_S * RATE_HZ)):
            rig.pose = pose_at(begin_m + number * SPEED_M_S / RATE_HZ, 0.0, math.radians(looks_left_deg))
            actions.add(rig.cycles(1)[0].guidance.action)

    go(0.5, ENOUGH_M, 25.0)
    said = [cue.text for cue in rig.output.cues if cue.text.startswith("The camera looks")]
    assert said == ["The camera looks to the left of where you walk. Look ahead, or straighten the glasses."]
    assert any("25° to the left of where the walker walks" in text for text in rig.events("sensor"))
    assert rig.agent.state.mode is Mode.GUIDING
    assert Action.STOP not in actions
    go(0.5 + ENOUGH_M, 5.0, 0.0)
    assert "The camera looks where you walk again." in [cue.text for cue in rig.output.cues]
    assert len(rig.events("sensor")) == 2


# ------------------------------------------------------------------------------------------------ the simulator
GRAPH = PoiGraph(
    1,
    {"a": Poi("a", START.name, "hall", START.x_m, START.y_m), "b": Poi("b", END.name, "bar", END.x_m, END.y_m)},
    {"ab": Edge("ab", "a", "b", ((START.x_m, START.y_m), (END.x_m, END.y_m)), END.x_m - START.x_m)},
)


@pytest.mark.parametrize(("yaw_left_deg", "key"), [(0.0, None), (-25.0, "right"), (25.0, "left")])
def test_in_the_simulator_the_camera_that_is_turned_is_told_of(yaw_left_deg: float, key: str | None) -> None:
    building = small_room()
    mount = replace(USUAL_MOUNT, yaw_left_deg=yaw_left_deg)
    world = SimulatedWorld(building, drawn_walker(2), Start(START.x_m, START.y_m, 0.0), 2, mount=mount)
    sides: list[str] = []

    def located(frame: Frame) -> Localization:
        return Localization(frame.stamp_s, LocalizationQuality.LOCALIZED, world.true_head(), np.eye(6) * 1e-4, 200)

    def meanwhile(moment: Moment) -> None:
        if moment.agent.state.facing.turned and not sides:
            sides.append("left" if moment.agent.state.facing.offset_rad > 0 else "right")

    state = DeviceState(Settings().changed({"calibration.turned_after_m": 4.0}), GRAPH, "room")
    lead(world, state, FakeLocalizer(located), "b", max_s=25.0, meanwhile=meanwhile)
    assert sides == ([] if key is None else [key])

"""What a device tells of its decisions and of itself: the same to the console and to the recording."""

from __future__ import annotations

import json
import math
import time
from pathlib import Path

import msgspec
import numpy as np
import pytest
from closed_loop import EYE_M, PITCH_RAD
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from recorded_walk import STORED_WALK, record

from device_agent.adapters.fakes import FakeHost
from device_agent.adapters.linux_host import LinuxHost, host_health
from device_agent.cycle import Cycle, walker_state
from device_agent.decision_view import wire_scan
from device_agent.ports import HostHealth
from device_agent.recording.walk_files import parts_in
from device_agent.state import DeviceState
from navcore.explain import explain
from navcore.planning.poi_graph import PoiGraph
from navcore.settings import Settings
from navcore.types import Action, BearingState, Frame, Guidance, ObstacleScan, Reason, Rule
from navcore.wire import WalkerState, decode_from_device, encode

COMPACT_BYTES = 3 << 10


def told_in(path: Path) -> list[WalkerState]:
    """Return the states of the channel /device."""
    with path.open("rb") as file:
        messages = list(make_reader(file).iter_messages(topics="/device"))
    return [msgspec.json.decode(message.data, type=WalkerState) for _, _, message in messages]


@pytest.fixture(scope="module")
def told(tmp_path_factory: pytest.TempPathFactory) -> list[WalkerState]:
    """A walk with a pause, an obstacle, and a second without a pose, as it stands in its recording."""
    folder = tmp_path_factory.mktemp("walk")
    record(folder, max_s=7.5, rate_hz=5.0)
    return told_in(parts_in(folder)[0])


def test_each_decision_of_a_recorded_walk_is_told_whole_and_explained(told: list[WalkerState]) -> None:
    decided = {state.trace.decided for state in told if state.trace is not None}
    assert {Rule.TO_EXPECTED.value, Rule.PAUSED.value, Rule.POSE_LOST.value, Rule.FREE_FRAMES.value} <= decided
    for state in told:
        assert state.trace is not None
        assert state.trace.scan is not None
        assert explain(state).sentence.lower().startswith(state.action)
        assert sum(step.decides for step in explain(state).steps) == 1
        assert decode_from_device(encode(state)) == state
        assert len(encode(state)) < COMPACT_BYTES
    walking = [state for state in told if state.action == "walk"]
    assert walking
    for state in walking:
        assert any(each.is_walkable for each in state.candidates), "θ_opt was one of them"
        assert state.trace is not None
        assert state.trace.limits.stop_m is not None
        assert state.trace.limits.stop_m >= Settings().obstacle.stop_distance_m
        assert state.eye_m == pytest.approx(EYE_M, abs=0.15)
        assert state.tilt_rad == pytest.approx(PITCH_RAD, abs=math.radians(4.0))


def test_a_recording_from_before_the_trace_is_still_read_and_explained() -> None:
    states = told_in(STORED_WALK)
    assert states
    for state in states:
        older = {
            name: value
            for name, value in json.loads(msgspec.json.encode(state)).items()
            if name not in ("trace", "eye_m", "tilt_rad", "battery_percent", "is_charging", "temperature_c")
        }
        read = msgspec.json.decode(json.dumps(older).encode(), type=WalkerState)
        assert read.trace is None
        assert explain(read).sentence.lower().startswith(read.action)


STATES = st.lists(st.sampled_from(list(BearingState)), min_size=1, max_size=90)


@settings(max_examples=50, deadline=None)
@given(STATES, st.floats(0.001, 800.0), st.data())
def test_unknown_is_told_apart_from_free_and_nothing_that_is_there_gets_lost(
    states: list[BearingState], near_m: float, data: st.DataObject
) -> None:
    is_something = [state not in (BearingState.FREE, BearingState.UNKNOWN) for state in states]
    nearest_m = np.select([is_something, np.array(states) == BearingState.UNKNOWN], [near_m, np.nan], np.inf)
    bearing_rad = np.radians(np.arange(len(states)) - 30.0)
    kept = np.ones(len(states), bool)
    if len(states) > 4:
        # One bearing that the scan does not have.
        missing = data.draw(st.integers(2, len(states) - 2))
        kept[missing] = False
    scan = ObstacleScan(bearing_rad[kept], nearest_m[kept], np.array(states, np.int8)[kept], (), 1.0)
    told = wire_scan(scan)
    expected = [int(state) if there else int(BearingState.UNKNOWN) for state, there in zip(states, kept, strict=True)]
    assert list(told.states) == expected
    for state, cm in zip(told.states, told.nearest_cm, strict=True):
        assert (cm > 0) == (state not in (BearingState.FREE, BearingState.UNKNOWN))
        assert cm == 0 or abs(cm / 100.0 - min(near_m, 655.35)) <= 0.01


def test_of_bearings_that_share_one_the_worst_is_told_and_the_nearest() -> None:
    bearing_rad = np.linspace(-0.7, 0.7, 400)
    state = np.full(400, BearingState.FREE, np.int8)
    nearest_m = np.full(400, np.inf)
    for index, (there, near_m) in enumerate(((BearingState.OBSTACLE, 1.0), (BearingState.DROP, 2.0))):
        state[index::4], nearest_m[index::4] = there, near_m
    state[2::8], nearest_m[2::8] = BearingState.UNKNOWN, np.nan
    told = wire_scan(ObstacleScan(bearing_rad, nearest_m, state, (), 1.0))
    step_rad = told.step_rad
    for bearing, its_state, its_m in zip(bearing_rad, state, nearest_m, strict=True):
        index = round((bearing - told.first_rad) / step_rad)
        if its_state == BearingState.FREE:
            continue
        assert told.states[index] != BearingState.FREE, "what is there, or not known, is never told as free"
        if its_state == BearingState.UNKNOWN:
            continue
        assert told.states[index] in (its_state, BearingState.DROP), "a drop is worse than an obstacle"
        assert 0 < told.nearest_cm[index] <= round(100 * its_m)


def test_gravity_tells_a_camera_on_its_side_where_no_floor_is_seen() -> None:
    blank = np.zeros((4, 4, 3), np.uint8), np.full((4, 4), np.nan, np.float32)
    frame = Frame(1.0, *blank, gravity=np.array([1.0, 0.0, 0.0]))
    seen = ObstacleScan(np.zeros(0), np.zeros(0), np.zeros(0, np.int8), (), 0.0)
    cycle = Cycle(1.0, Guidance(1.0, Action.STOP, None, Reason.DEPTH_INVALID), frame, scan=seen)
    health = FakeHost(HostHealth(41.0, True, 55.5)).read()
    state = walker_state(DeviceState(Settings(), PoiGraph()), cycle, None, 10.0, health=health)
    assert state.tilt_rad == pytest.approx(math.pi / 2)
    assert state.eye_m is None
    assert (state.battery_percent, state.is_charging, state.temperature_c) == (41.0, True, 55.5)


def files(folder: Path, **contents: str) -> None:
    folder.mkdir(parents=True)
    for name, text in contents.items():
        (folder / name).write_text(text)


def test_battery_and_temperature_are_read_as_linux_tells_them(tmp_path: Path) -> None:
    power, thermal = tmp_path / "power", tmp_path / "thermal"
    assert host_health(power, thermal) == HostHealth(), "a machine without either says nothing"
    files(power / "AC", type="Mains\n", online="1\n")
    files(power / "hid-mouse", type="Battery\n", scope="Device\n", capacity="3\n", status="Discharging\n")
    files(power / "BAT1", type="Battery\n", capacity="not now\n", status="Unknown\n")
    assert host_health(power, thermal) == HostHealth(), "neither a mouse's battery, nor one that does not tell"
    files(power / "BAT0", type="Battery\n", capacity="87\n", status="Charging\n")
    files(power / "BAT2", type="Battery\n", capacity="42\n", status="Discharging\n")
    files(thermal / "thermal_zone0", temp="48500\n")
    files(thermal / "thermal_zone1", temp="broken\n")
    files(thermal / "thermal_zone2", temp="61000\n")
    host = LinuxHost(power, thermal)
    host.close()
    assert host.read() == HostHealth(42.0, False, 61.0), "the emptiest battery, and the hottest zone"


def test_a_battery_that_cannot_be_read_any_more_is_not_known_and_is_found_again(tmp_path: Path) -> None:
    for name, percent in (("before", 80), ("after", 40)):
        files(tmp_path / name / "BAT0", type="Battery\n", capacity=f"{percent}\n", status="Discharging\n")

    def comes_under_power(target: str) -> None:
        """Let the folder be another one, at once."""
        (tmp_path / "next").symlink_to(target)
        (tmp_path / "next").replace(tmp_path / "power")

    comes_under_power("before")
    clock_s = [0.0]
    host = LinuxHost(tmp_path / "power", tmp_path / "thermal", every_s=0.001, now_s=lambda: clock_s[0])

    def until_told(percent: float | None, passing_s: float) -> None:
        deadline_s = time.monotonic() + 30.0
        while host.read().battery_percent != percent:
            clock_s[0] += passing_s
            assert time.monotonic() < deadline_s, f"it never told {percent} %"

    until_told(80.0, 0.0)
    comes_under_power("x" * 300)  # longer than a name may be: looking raises
    until_told(None, 0.001)
    comes_under_power("after")
    until_told(40.0, 0.0)
    host.close()

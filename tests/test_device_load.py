"""A device that is too slow does less by plan, says so, and its walk can still be replayed bit for bit."""

from __future__ import annotations

import logging
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from device_hall import Rig, pose_at

from device_agent.agent import LOAD_TEXTS
from device_agent.load_plan import CALM_COUNT, FEWER_FEATURES_FRACTION, LATE_COUNT, LoadLevel
from device_agent.loop_monitor import LoopMonitor
from device_agent.recording.options import RecordingOptions
from device_agent.recording.reading import RecordedPart
from device_agent.recording.recorder import WalkRecorder
from device_agent.recording.replay import replay
from device_agent.recording.tap import Tap
from device_agent.recording.walk_files import WalkFiles, parts_in
from navcore.settings import DeadlineSettings
from navcore.types import Action, LocalizationQuality
from navcore.wire import ApplySettings, SetDestination

BUDGET_S = DeadlineSettings().work_s
WALK_M_S = 0.8
FRAME_S = 0.1


class SlowProcessor:
    """Time that passes while a frame is located: as much as all features of it take."""

    def __init__(self) -> None:
        self.now_s = 0.0
        self.all_features_s = 0.0
        self.located_stamps_s: list[float] = []

    def rig(self, tap: Tap | None = None, *, plans: bool = True) -> Rig:
        """Return a device on this processor, on its way."""
        rig = Rig(timer_s=lambda: self.now_s, plans_load=plans, tap=tap or Tap())
        locate = rig.locate

        def slowly(frame):  # type: ignore[no-untyped-def]
            self.now_s += self.all_features_s * rig.localizer.feature_fraction
            self.located_stamps_s.append(frame.stamp_s)
            return locate(frame)

        rig.locate = slowly  # type: ignore[method-assign]
        rig.agent.submit(SetDestination("bar"))
        walk(rig, 20)
        return rig


def walk(rig: Rig, count: int) -> None:
    """Walk on while the device runs so many cycles."""
    for _ in range(count):
        x_m = rig.pose.translation[0] if rig.pose is not None else 0.5
        rig.pose = pose_at(float(x_m) + WALK_M_S * FRAME_S)
        rig.cycles(1)


def level(rig: Rig) -> LoadLevel:
    return rig.agent.state.load_level


def test_a_fast_device_leaves_nothing_out_and_tells_its_times() -> None:
    processor = SlowProcessor()
    processor.all_features_s = 0.02
    rig = processor.rig()
    walk(rig, 20)
    assert level(rig) is LoadLevel.FULL
    assert rig.localizer.feature_fraction == 1.0
    told = {each.stage: each for each in rig.uplink.states[-1].stages}
    assert told["localize"].p50_ms == pytest.approx(20.0, abs=0.01)
    assert told["localize"].missed_count == told["capture_to_cue"].missed_count == 0


def test_late_stages_are_counted_and_visible() -> None:
    processor = SlowProcessor()
    rig = processor.rig(plans=False)
    processor.all_features_s = DeadlineSettings().localize_s + 0.001
    walk(rig, 7)
    processor.all_features_s = 0.0
    walk(rig, 20)
    told = {each.stage: each for each in rig.uplink.states[-1].stages}
    assert told["localize"].missed_count == 7
    assert told["localize"].max_ms == pytest.approx(46.0, abs=0.01)
    assert told["guide"].missed_count == 0


def test_a_line_of_the_log_tells_once_a_minute_and_warns_where_something_was_late(
    caplog: pytest.LogCaptureFixture,
) -> None:
    caplog.set_level(logging.INFO, "device_agent.loop_monitor")
    monitor, deadlines = LoopMonitor(plans=False), DeadlineSettings()
    cycle = replace(Rig().lead_to(), stage_ms={})
    for number in range(1810):
        late_s = 1.0 if number == 700 else 0.0
        stamped = replace(cycle, stamp_s=100.0 + 0.1 * number)
        monitor.note(stamped, stamped.stamp_s + 0.03 + late_s, 0.001, deadlines)
    lines = [(record.levelname, record.message) for record in caplog.records]
    assert [level for level, _ in lines] == ["INFO", "WARNING", "INFO"]
    assert "capture_to_cue" in lines[1][1]
    assert "(1 late)" in lines[1][1]


def test_features_go_first_and_that_is_told() -> None:
    processor = SlowProcessor()
    rig = processor.rig()
    processor.all_features_s = 1.2 * BUDGET_S
    walk(rig, LATE_COUNT + 2)
    assert level(rig) is LoadLevel.FEWER_FEATURES
    assert rig.localizer.feature_fraction == FEWER_FEATURES_FRACTION
    assert rig.uplink.states[-1].load_level == "fewer_features"
    assert rig.events("mode").count(LOAD_TEXTS[LoadLevel.FEWER_FEATURES]) == 1
    walk(rig, 30)
    assert level(rig) is LoadLevel.FEWER_FEATURES, "with fewer features it is in time"


def test_then_every_second_frame_is_located_and_obstacles_are_looked_for_in_each() -> None:
    processor = SlowProcessor()
    rig = processor.rig()
    processor.all_features_s = 3 * BUDGET_S
    walk(rig, 2 * LATE_COUNT + 4)
    assert level(rig) is LoadLevel.HALF_RATE
    processor.located_stamps_s.clear()
    before = len(rig.uplink.states)
    scans = []
    for _ in range(20):
        x_m = float(rig.pose.translation[0]) if rig.pose is not None else 0.0
        rig.pose = pose_at(x_m + WALK_M_S * FRAME_S)
        (cycle,) = rig.cycles(1)
        scans.append(cycle.scan)
        assert cycle.localization is not None
        assert cycle.localization.pose is not None
        assert cycle.localization.pose.x_m == pytest.approx(x_m + WALK_M_S * FRAME_S, abs=1e-6)
    assert len(processor.located_stamps_s) == 10
    np.testing.assert_allclose(np.diff(processor.located_stamps_s), 2 * FRAME_S)
    assert all(scan is not None for scan in scans)
    states = rig.uplink.states[before:]
    assert {state.action for state in states} == {"walk"}
    assert {state.quality for state in states} == {"localized"}


def test_a_lost_place_is_looked_for_with_all_features_in_every_frame() -> None:
    processor = SlowProcessor()
    rig = processor.rig()
    processor.all_features_s = 3 * BUDGET_S
    walk(rig, 2 * LATE_COUNT + 4)
    rig.quality = LocalizationQuality.UNCERTAIN
    walk(rig, 3)
    processor.located_stamps_s.clear()
    walk(rig, 10)
    assert len(processor.located_stamps_s) == 10, "a doubtful pose is not carried on"
    rig.pose = None
    rig.cycles(2)
    assert rig.localizer.feature_fraction == 1.0


def test_after_a_calm_all_is_done_again() -> None:
    processor = SlowProcessor()
    rig = processor.rig()
    processor.all_features_s = 1.2 * BUDGET_S
    walk(rig, LATE_COUNT + 2)
    assert level(rig) is LoadLevel.FEWER_FEATURES
    processor.all_features_s = 0.0
    walk(rig, 2 * CALM_COUNT + 2)
    assert level(rig) is LoadLevel.FULL
    assert rig.localizer.feature_fraction == 1.0
    assert LOAD_TEXTS[LoadLevel.FULL] in rig.events("mode")


def test_nothing_is_left_out_where_that_is_not_wanted() -> None:
    processor = SlowProcessor()
    rig = processor.rig()
    rig.agent.submit(ApplySettings(1, {"deadlines.do_less": False}))
    processor.all_features_s = 3 * BUDGET_S
    walk(rig, 30)
    assert level(rig) is LoadLevel.FULL


def test_a_walk_with_every_level_is_replayed_bit_for_bit(tmp_path: Path) -> None:
    recorder = WalkRecorder(RecordingOptions(tmp_path, max_part_s=1e6, reserve_bytes=0))
    processor = SlowProcessor()
    rig = processor.rig(recorder)
    processor.all_features_s = 3 * BUDGET_S
    walk(rig, 40)
    recorder.close()
    (path,) = parts_in(tmp_path)
    cycles = list(replay([RecordedPart(path)]))
    assert {each.notes.load_level for each in cycles} == set(LoadLevel)
    assert any(each.notes.localization is None and each.cycle.localization is not None for each in cycles)
    assert [each.notes.number for each in cycles if each.differs_in] == []


def test_a_file_that_begins_at_half_rate_can_be_replayed_alone(tmp_path: Path) -> None:
    options, times = RecordingOptions(tmp_path, max_part_s=1.0, reserve_bytes=0), [50.0]
    files = WalkFiles(options, lambda text: recorder.told(text), monotonic_s=lambda: times[0], wall_s=lambda: times[0])
    recorder = WalkRecorder(options, files)
    processor = SlowProcessor()
    rig = processor.rig(recorder)
    processor.all_features_s = 3 * BUDGET_S
    for _ in range(60):
        walk(rig, 1)
        times[0] += FRAME_S
        recorder.check()
    recorder.close()
    parts = [RecordedPart(path) for path in parts_in(tmp_path)]
    begun_at_half_rate = [part for part in parts if part.opening.state.load_level is LoadLevel.HALF_RATE]
    assert len(begun_at_half_rate) > 1
    for part in begun_at_half_rate:
        assert [each.notes.number for each in replay([part]) if each.differs_in] == []


def test_a_device_that_is_too_slow_at_the_last_level_leads_nobody() -> None:
    """By the clock: each localization takes 0.7 s, whatever is left out."""
    processor = SlowProcessor()
    rig = processor.rig()
    locate = rig.locate

    def too_slowly(frame):  # type: ignore[no-untyped-def]
        rig.clock.sleep_until(rig.clock.now_s() + 0.7)
        processor.now_s += 0.7
        return locate(frame)

    rig.locate = too_slowly  # type: ignore[method-assign]
    walk(rig, 30)
    assert level(rig) is LoadLevel.HALF_RATE
    for _ in range(10):
        (cycle,) = rig.cycles(1)
        assert cycle.guidance.action is Action.STOP
    told = {each.stage: each for each in rig.uplink.states[-1].stages}
    assert told["capture_to_cue"].missed_count >= 25

"""A localizer that is slow, or hangs, does not hold up guidance: real threads, and a test that says when time is up.

No test waits for time to pass: a deadline has passed when the test says so, and what is slow is so until it is let go.
"""

from __future__ import annotations

import itertools
import threading
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from device_hall import GRAPH, INTRINSICS, Rig, empty_hall, pose_at

from device_agent.adapters.clocks import FakeClock
from device_agent.adapters.fakes import FakeCamera, FakeLocalizer, FakeOutput, FakeUplink, NoSonar
from device_agent.agent import HANGS_AFTER_S, DeviceAgent, DeviceParts
from device_agent.cycle import Cycle
from device_agent.load_plan import LATE_COUNT, LoadLevel
from device_agent.locating import Answer, Beside, InLine, Request
from device_agent.ports import LocalizerPort
from device_agent.recording.options import RecordingOptions
from device_agent.recording.reading import RecordedPart
from device_agent.recording.recorder import WalkRecorder
from device_agent.recording.replay import replay
from device_agent.recording.tap import Tap
from device_agent.recording.walk_files import parts_in
from device_agent.state import DeviceState, PreparedMap
from navcore.cues.table import CueKind
from navcore.geometry import Transform, world_from_camera_at
from navcore.settings import Settings
from navcore.site import Site
from navcore.types import Action, Frame, Localization, LocalizationQuality, Reason
from navcore.wire import ApplySettings, ClearDestination, SetDestination

LONG_S = 30.0
FRAME_S = 0.1
WALK_M_S = 0.8
BEGIN_S = 100.0
SURE, UNCERTAIN, LOST = LocalizationQuality.LOCALIZED, LocalizationQuality.UNCERTAIN, LocalizationQuality.LOST


def true_pose(stamp_s: float) -> Transform:
    """Where somebody is who walks down the hall's road."""
    return pose_at(0.5 + WALK_M_S * (stamp_s - BEGIN_S))


class Impatience:
    """The deadlines of a test: they pass at once, or not before the pose is there."""

    def __init__(self) -> None:
        self.is_up = False
        """Whether a deadline passes at once."""
        self.asked_s: list[float] = []
        self._owed: tuple[threading.Condition, Callable[[], bool]] | None = None

    def __call__(self, changed: threading.Condition, is_true: Callable[[], bool], timeout_s: float) -> None:
        """Wait as a locator waits for its thread."""
        self.asked_s.append(timeout_s)
        if self.is_up:
            self._owed = changed, is_true
        else:
            assert changed.wait_for(is_true, LONG_S), "the localizer does not answer"

    def until_answered(self) -> None:
        """Return when the pose is there for which a cycle did not wait, if there is one."""
        if self._owed is not None:
            (changed, is_true), self._owed = self._owed, None
            with changed:
                assert changed.wait_for(is_true, LONG_S)


class Gated:
    """A localizer that tells the truth, when it is let; what it says depends on all that it was asked before."""

    def __init__(self) -> None:
        self.may_answer = threading.Event()
        self.may_answer.set()
        self.began = threading.Semaphore(0)
        """Released once for each frame that it begins to work on."""
        self.located_s: list[float] = []
        self.fails = False
        self.feature_fraction = 1.0
        self.applied: list[Settings] = []

    def locate(self, frame: Frame) -> Localization:
        """Return the true pose of the frame's time, when that is let."""
        self.located_s.append(frame.stamp_s)
        self.began.release()
        assert self.may_answer.wait(LONG_S)
        if self.fails:
            raise RuntimeError("no such key frame")
        known = 1e-4 * (1.0 + 0.01 * len(self.located_s) + 0.001 * len(self.applied) + self.feature_fraction)
        return Localization(frame.stamp_s, SURE, true_pose(frame.stamp_s), np.eye(6) * known, 200)

    def use_features(self, fraction: float) -> None:
        """Keep it."""
        self.feature_fraction = fraction

    def apply(self, settings: Settings) -> None:
        """Keep it."""
        self.applied.append(settings)


class Walk:
    """Somebody walks down the hall, led by a device whose localizer runs beside."""

    def __init__(self, tap: Tap | None = None, *, plans: bool = False, frame_s: float = FRAME_S) -> None:
        self.time, self.localizer, self._tap = Impatience(), Gated(), tap or Tap()
        self.wall_m: float | None = None
        """Distance of something that stands in front of the whole picture."""
        self.nod_rad = 0.0
        """How much farther down the walker looks than usual."""
        rig = self.rig = Rig(
            tap=self._tap, plans_load=plans, spoil=self._spoiled,
            locating=lambda _: Beside(self.localizer, self.time), frame_s=frame_s,
            # The machine that runs the tests may be busy: nothing but poses is late here.
            timer_s=lambda: 0.0,
        )  # fmt: skip
        rig.agent.submit(SetDestination("bar"))
        self.on(20)

    def _spoiled(self, frame: Frame) -> Frame:
        if self.nod_rad:
            assert self.rig.pose is not None
            pitch_rad = np.radians(15.0) + self.nod_rad
            shown = world_from_camera_at(tuple(self.rig.pose.translation), 0.0, pitch_rad)
            return replace(frame, depth_m=empty_hall(shown))
        if self.wall_m is None:
            return frame
        return replace(frame, depth_m=np.full_like(frame.depth_m, self.wall_m))

    def on(self, count: int = 1) -> list[Cycle]:
        """Walk on while the device runs so many cycles."""
        cycles: list[Cycle] = []
        for _ in range(count):
            self.rig.pose = true_pose(self.rig.clock.now_s() + self.rig.frame_s)
            cycles += self.rig.cycles(1)
            self._tap.check()
        return cycles

    def late(self) -> Cycle:
        """Run a cycle whose pose comes only after it, but before the next one."""
        self.time.is_up = True
        self.localizer.may_answer.clear()
        (cycle,) = self.on()
        self.localizer.may_answer.set()
        self.time.until_answered()
        self.time.is_up = False
        return cycle

    def hang(self) -> None:
        """From now on the localizer does not answer."""
        self.time.is_up = True
        self.localizer.may_answer.clear()

    def answer(self) -> None:
        """It answers again."""
        self.localizer.may_answer.set()
        self.time.until_answered()
        self.time.is_up = False


# ----------------------------------------------------------------------------------------------------- the locator
def frame_at(stamp_s: float) -> Frame:
    return Frame(stamp_s, np.zeros((2, 2, 3), np.uint8), np.ones((2, 2), np.float32))


def asked(stamp_s: float, fraction: float | None = 1.0, *, rests: bool = False) -> Request:
    return Request(frame_at(stamp_s), fraction, rests, 0.04)


def stamps(answer: Answer) -> tuple[float | None, float | None]:
    return tuple(None if each is None else each.stamp_s for each in (answer.late, answer.own))  # type: ignore[return-value]


@pytest.fixture
def beside() -> Iterator[tuple[Beside, Gated, Impatience]]:
    localizer, time = Gated(), Impatience()
    locator = Beside(localizer, time)
    yield locator, localizer, time
    localizer.may_answer.set()
    locator.close()


def test_a_pose_in_time_is_that_of_the_frame(beside: tuple[Beside, Gated, Impatience]) -> None:
    locator, _, time = beside
    assert [stamps(locator.locate(asked(stamp_s))) for stamp_s in (1.0, 2.0)] == [(None, 1.0), (None, 2.0)]
    assert time.asked_s == [0.04, 0.04]


def test_while_one_frame_is_worked_on_none_is_given_and_the_newest_wins(
    beside: tuple[Beside, Gated, Impatience],
) -> None:
    locator, localizer, time = beside
    localizer.may_answer.clear()
    time.is_up = True
    assert [stamps(locator.locate(asked(stamp_s))) for stamp_s in (1.0, 2.0, 3.0)] == [(None, None)] * 3
    assert len(time.asked_s) == 1, "once it is late, nobody waits for it"
    localizer.may_answer.set()
    time.until_answered()
    time.is_up = False
    assert stamps(locator.locate(asked(4.0))) == (1.0, 4.0)
    assert stamps(locator.locate(asked(5.0))) == (None, 5.0)
    assert localizer.located_s == [1.0, 4.0, 5.0]


def test_a_frame_that_is_left_out_is_not_located_but_a_late_pose_is_given(
    beside: tuple[Beside, Gated, Impatience],
) -> None:
    locator, localizer, time = beside
    assert stamps(locator.locate(asked(1.0, None))) == (None, None)
    for fraction, rests in ((None, False), (1.0, True)):
        localizer.may_answer.clear()
        time.is_up = True
        locator.locate(asked(2.0))
        localizer.may_answer.set()
        time.until_answered()
        time.is_up = False
        assert stamps(locator.locate(asked(3.0, fraction, rests=rests))) == (2.0, None)
    assert localizer.located_s == [2.0, 2.0]
    assert stamps(locator.locate(asked(4.0, rests=True))) == (None, 4.0)


def test_what_is_raised_is_raised_once_and_the_thread_goes_on(beside: tuple[Beside, Gated, Impatience]) -> None:
    locator, localizer, _ = beside
    localizer.fails = True
    with pytest.raises(RuntimeError, match="key frame"):
        locator.locate(asked(1.0))
    localizer.fails = False
    assert stamps(locator.locate(asked(2.0))) == (None, 2.0)


def test_settings_are_applied_between_two_frames(beside: tuple[Beside, Gated, Impatience]) -> None:
    locator, localizer, time = beside
    localizer.may_answer.clear()
    time.is_up = True
    locator.locate(asked(1.0))
    assert localizer.began.acquire(timeout=LONG_S)
    changed = Settings().changed({"localization.feature_count": 800})
    locator.apply(changed)
    assert localizer.applied == [], "not while it works"
    localizer.may_answer.set()
    time.until_answered()
    time.is_up = False
    locator.locate(asked(2.0, 0.6))
    locator.locate(asked(3.0, 0.6))
    assert localizer.applied == [changed]
    assert localizer.feature_fraction == 0.6


def test_in_line_each_pose_is_waited_for() -> None:
    localizer = Gated()
    locator = InLine(localizer)
    assert stamps(locator.locate(asked(1.0))) == (None, 1.0)
    assert stamps(locator.locate(asked(2.0, None))) == (None, None)
    assert stamps(locator.locate(asked(3.0, 0.6, rests=True))) == (None, 3.0)
    assert localizer.located_s == [1.0, 3.0]


# -------------------------------------------------------------------------------------------------------- guidance
def off_m(cycle: Cycle) -> float:
    """How far the pose that was used is from the truth."""
    found = cycle.localization.world_from_camera
    return float(np.linalg.norm(found.translation - true_pose(cycle.stamp_s).translation))


def test_a_late_pose_is_taken_over_as_the_one_of_its_own_time() -> None:
    walk = Walk()
    for _ in range(10):
        cycle = walk.late()
        assert cycle.pose_late
        assert cycle.localization.quality is SURE
        assert cycle.guidance.action is Action.WALK
        assert off_m(cycle) < 1e-6
    assert walk.rig.agent.state.fixes[-1].stamp_s == pytest.approx(walk.rig.clock.now_s() - FRAME_S)
    (cycle,) = walk.on()
    assert not cycle.pose_late


def test_a_localizer_that_hangs_ends_in_stop_with_a_reason_and_it_goes_on_by_itself() -> None:
    walk = Walk()
    walk.hang()
    last_s = walk.rig.clock.now_s()
    cycles = walk.on(30)
    after_s = np.array([cycle.stamp_s - last_s for cycle in cycles])
    qualities = np.array([cycle.localization.quality for cycle in cycles])
    assert set(qualities[after_s < 0.14]) == {SURE}
    assert set(qualities[(after_s > 0.16) & (after_s < 0.49)]) == {UNCERTAIN}
    assert set(qualities[after_s > 0.51]) == {LOST}
    assert all(cycle.guidance.action is not Action.WALK for cycle in cycles if cycle.localization.quality is LOST)
    assert cycles[-1].guidance.reason is Reason.POSE_LOST
    stops = [cue for cue in walk.rig.output.cues if cue.kind is CueKind.STOP and cue.stamp_s > last_s]
    assert stops
    assert stops[0].text
    assert stops[0].stamp_s - last_s <= 0.5 + FRAME_S + 1e-6
    told = [text for text in walk.rig.events("localization") if "not answered" in text]
    assert len(told) == 1
    walk.answer()
    assert walk.on(15)[-1].guidance.action is Action.WALK


def test_who_walked_is_taken_to_walk_on_while_the_pose_is_held() -> None:
    """A held pose stands still; whoever were taken to stand as well would be stopped too late."""
    walk = Walk()
    before = walk.on()[0].guidance.trace
    assert before.speed_m_s == pytest.approx(WALK_M_S, abs=0.05)
    walk.hang()
    held = [cycle for cycle in walk.on(6) if cycle.localization is not None and cycle.localization.is_held]
    assert len(held) >= 3
    assert all(cycle.guidance.trace.speed_m_s >= before.speed_m_s - 0.05 for cycle in held)


def test_who_was_coming_is_not_forgotten_for_a_held_pose() -> None:
    walk = Walk()
    walk.hang()
    cycles = walk.on(3)
    assert cycles[-1].localization is not None
    assert cycles[-1].localization.is_held
    assert walk.rig.agent.state.recent_scans
    walk.on(30)
    assert not walk.rig.agent.state.recent_scans, "the place is lost"


def test_a_localizer_that_hangs_for_good_is_a_process_to_be_begun_anew() -> None:
    """Only the service can end it: it hears of no life any more, while the walker is stopped as before."""
    walk, lives = Walk(), list[float]()
    agent = walk.rig.agent
    agent._parts = replace(agent._parts, alive=lambda: lives.append(walk.rig.clock.now_s()))
    walk.hang()
    began_s = walk.rig.clock.now_s()
    walk.on(120)
    assert lives, "a hang of some seconds is none for good"
    assert lives[-1] - began_s == pytest.approx(HANGS_AFTER_S, abs=2.0 * FRAME_S)
    walk.answer()
    last_s = lives[-1]
    walk.on(3)
    assert lives[-1] > last_s


def test_obstacles_count_at_once_while_the_localizer_hangs() -> None:
    walk = Walk()
    walk.hang()
    assert walk.on()[0].guidance.action is Action.WALK
    walk.wall_m = 0.6
    (cycle,) = walk.on()
    assert cycle.pose_late
    assert cycle.guidance.action is not Action.WALK
    assert cycle.guidance.reason in (Reason.OBSTACLE_DEPTH, Reason.NO_CANDIDATE)
    assert cycle.scan is not None


@pytest.mark.parametrize("nod_rad", [-0.2, 0.15])
def test_a_head_that_nods_while_a_pose_is_held_is_levelled_by_the_floor(nod_rad: float) -> None:
    """By the pose of before the nod, the floor would seem to rise or to fall, and a box to stand in it."""
    walk = Walk()
    walk.hang()
    walk.on(1)
    walk.nod_rad = nod_rad
    for cycle in walk.on(3):
        assert cycle.localization is not None
        assert cycle.localization.quality is UNCERTAIN
        assert cycle.guidance.action is Action.WALK, cycle.guidance.trace.rule


def test_while_a_pose_is_held_nothing_remembered_is_forgotten_or_misplaced() -> None:
    walk = Walk()
    walk.wall_m = 2.5
    walk.on(3)
    remembered = walk.rig.agent.state.obstacles
    assert len(remembered.cell)
    walk.hang()
    walk.on(2)
    before, walk.wall_m = walk.rig.agent.state.obstacles, None
    for cycle in walk.on(2):
        assert cycle.localization is not None
        assert cycle.localization.quality is UNCERTAIN
        assert walk.rig.agent.state.obstacles is before
        assert cycle.scan is not None
        assert np.nanmin(cycle.scan.nearest_m) < 3.0, "what is remembered closes directions all the same"
    walk.answer()
    walk.on(2)
    assert walk.rig.agent.state.obstacles is not before


def test_the_depth_image_of_nothing_is_never_clear_while_the_localizer_hangs() -> None:
    walk = Walk()
    walk.hang()
    walk.wall_m = np.nan
    assert all(cycle.guidance.action is Action.STOP for cycle in walk.on(4))


def test_a_localizer_that_hangs_at_the_start_leads_nobody() -> None:
    time, localizer = Impatience(), Gated()
    time.is_up = True
    localizer.may_answer.clear()
    rig = Rig(locating=lambda _: Beside(localizer, time))
    rig.agent.submit(SetDestination("bar"))
    assert {cycle.guidance.action for cycle in rig.cycles(20)} == {Action.STOP}
    localizer.may_answer.set()


def test_a_localizer_that_raises_late_stops_at_once() -> None:
    walk = Walk()
    walk.localizer.fails = True
    walk.late()
    (cycle,) = walk.on()
    assert "localize failed" in cycle.fault
    walk.localizer.fails = False
    assert walk.on(15)[-1].guidance.action is Action.WALK


def test_a_late_pose_in_another_map_is_never_taken(tmp_path: Path) -> None:
    walk = Walk()
    old = walk.localizer
    walk.hang()
    walk.on()
    empty = np.zeros((0, 3))
    site = Site("new", "New", INTRINSICS, {}, (), empty.astype(np.float32), empty.astype(np.uint8), GRAPH)
    walk.rig.agent.submit(PreparedMap(tmp_path, "new-map", site, FakeLocalizer(walk.rig.locate)))
    walk.rig.agent.submit(ClearDestination())
    walk.localizer = Gated()
    walk.time.is_up = False
    walk.on()
    assert walk.rig.agent.state.map_checksum == "new-map"
    old.fails = True
    old.may_answer.set()
    assert all(cycle.fault == "" and cycle.localization.quality is SURE for cycle in walk.on(10))
    assert walk.localizer.located_s


# ------------------------------------------------------------------------------------------------------- load plan
def test_late_poses_are_overload_however_soon_the_cue_is_there() -> None:
    walk = Walk(plans=True)
    for _ in range(LATE_COUNT + 1):
        walk.late()
    assert walk.rig.agent.state.load_level is LoadLevel.FEWER_FEATURES
    for _ in range(LATE_COUNT):
        walk.late()
    walk.on()
    assert walk.rig.agent.state.load_level is LoadLevel.HALF_RATE
    walk.on(20)
    told = {each.stage: each for each in walk.rig.agent.monitor.summaries}
    assert told["localize"].missed_count >= 2 * LATE_COUNT


@pytest.mark.parametrize(("frame_s", "located"), [(0.05, 6), (0.1, 12)])
def test_at_half_rate_a_late_localizer_rests_after_each_pose_where_the_pose_can_be_carried_on(
    frame_s: float, located: int
) -> None:
    walk = Walk(plans=True, frame_s=frame_s)
    for _ in range(2 * LATE_COUNT + 2):
        walk.late()
    assert walk.rig.agent.state.load_level is LoadLevel.HALF_RATE
    walk.late()
    walk.late()
    walk.localizer.located_s.clear()
    # Whether it is given or not: each frame's pose would be late.
    cycles = [walk.late() for _ in range(12)]
    assert all(cycle.localization.quality is SURE for cycle in cycles)
    assert len(walk.localizer.located_s) == pytest.approx(located, abs=1)
    assert sum(cycle.pose_late for cycle in cycles) == len(walk.localizer.located_s), "what is left out is not late"


def test_looking_for_a_lost_place_is_no_overload() -> None:
    walk = Walk(plans=True)
    truth, walk.localizer.locate = walk.localizer.locate, lambda frame: Localization(frame.stamp_s, LOST, None)  # type: ignore[method-assign]
    walk.on(2)
    for _ in range(5 * LATE_COUNT):
        walk.time.is_up = True
        (cycle,) = walk.on()
        walk.time.until_answered()
        assert not cycle.pose_late
    assert walk.rig.agent.state.load_level is LoadLevel.FULL
    walk.localizer.locate = truth  # type: ignore[method-assign]


# ---------------------------------------------------------------------------------------------------------- replay
def unsteady_walk(tap: Tap, *, plans: bool) -> Walk:
    """A walk in which poses come in time, late, much later, and never; one is refused, and settings change."""
    rng = np.random.default_rng(5)
    walk = Walk(tap, plans=plans)
    for number in range(60):
        kind = rng.integers(0, 4)
        if number == 30:
            walk.rig.agent.submit(ApplySettings(3, {"localization.uncertain_position_m": 0.3}))
        if kind == 0:
            walk.late()
        elif kind == 1:
            walk.hang()
            walk.on(int(rng.integers(1, 8)))
            walk.answer()
        else:
            walk.on(int(rng.integers(1, 3)))
    return walk


@pytest.mark.parametrize("plans", [False, True])
def test_a_walk_with_late_poses_is_replayed_bit_for_bit(tmp_path: Path, plans: bool) -> None:
    recorder = WalkRecorder(RecordingOptions(tmp_path, max_part_s=1e6, reserve_bytes=0))
    walk = unsteady_walk(recorder, plans=plans)
    recorder.close()
    (path,) = parts_in(tmp_path)
    cycles = list(replay([RecordedPart(path)]))
    assert [each.notes.number for each in cycles if each.differs_in] == []
    late = [each.notes.late_localization for each in cycles if each.notes.late_localization is not None]
    assert len(late) > 10
    qualities = {each.cycle.localization.quality for each in cycles if each.cycle.localization is not None}
    assert qualities == {SURE, UNCERTAIN, LOST}
    assert [each.cycle.pose_late for each in cycles].count(True) > 20
    assert len(walk.localizer.located_s) < len(cycles)


@pytest.mark.parametrize("plans", [False, True])
def test_from_pictures_the_frames_are_located_that_were_located_then(tmp_path: Path, plans: bool) -> None:
    recorder = WalkRecorder(RecordingOptions(tmp_path, pictures=True, max_part_s=1e6, reserve_bytes=0))
    walk = unsteady_walk(recorder, plans=plans)
    recorder.close()
    assert recorder.pictures_dropped == 0
    again = Gated()

    def remade(*_: object) -> LocalizerPort:
        return again

    cycles = list(replay([RecordedPart(path) for path in parts_in(tmp_path)], remade))
    assert [(each.notes.number, each.differs_in) for each in cycles if each.differs_in] == []
    assert again.located_s == walk.localizer.located_s
    assert [each.values() for each in again.applied] == [each.values() for each in walk.localizer.applied]


def test_a_late_failure_is_replayed(tmp_path: Path) -> None:
    for pictures in (False, True):
        folder = tmp_path / str(pictures)
        recorder = WalkRecorder(RecordingOptions(folder, pictures=pictures, max_part_s=1e6, reserve_bytes=0))
        walk = Walk(recorder)
        walk.localizer.fails = True
        walk.late()
        walk.on()
        walk.localizer.fails = False
        walk.on(15)
        recorder.close()
        again = Gated()
        failing = iter(range(1, 100))

        def locate(frame: Frame, again: Gated = again, failing: Iterator[int] = failing) -> Localization:
            again.fails = next(failing) == 21
            return again.locate(frame)

        remade = (lambda *_: FakeLocalizer(locate)) if pictures else None
        cycles = list(replay([RecordedPart(path) for path in parts_in(folder)], remade))
        assert [
            each.notes.number for each in cycles if "guidance" in each.differs_in or "cues" in each.differs_in
        ] == []
        assert sum(bool(each.cycle.fault) for each in cycles) == 1


# ----------------------------------------------------------------------------------------------------- real time
def test_a_localizer_that_hangs_does_not_make_guidance_stale() -> None:
    """The live loop, its thread, the watchdog's and the localizer's, with the deadline of the settings."""
    clock, hangs, release, enough = FakeClock(BEGIN_S), threading.Event(), threading.Event(), threading.Event()
    here, black = pose_at(0.5), np.zeros((INTRINSICS.height_px, INTRINSICS.width_px, 3), np.uint8)
    free_m, count = empty_hall(here), itertools.count()
    stopped = threading.Event()
    after: list[float] = []
    hung_s: list[float] = []
    waits = itertools.count()

    def wait_for(changed: threading.Condition, holds: Callable[[], bool], wait_s: float) -> None:
        # Before it hangs, it is waited for however busy the machine is.
        changed.wait_for(holds, LONG_S if next(waits) < 30 else wait_s)

    def frames() -> Iterator[Frame]:
        while True:
            clock.advance(FRAME_S)
            if hangs.is_set():
                after.append(clock.now_s())
            if len(after) > 20:
                enough.set()
            yield Frame(clock.now_s(), black, free_m)

    def locate(frame: Frame) -> Localization:
        if next(count) == 30:
            hung_s.append(frame.stamp_s)
            hangs.set()
            assert release.wait(LONG_S)
        return Localization(frame.stamp_s, SURE, here, np.eye(6) * 1e-4, 200)

    localizer, output = FakeLocalizer(locate), FakeOutput()
    parts = DeviceParts(
        clock, FakeCamera(INTRINSICS, clock, frames()), NoSonar(clock), output, FakeUplink(), lambda *_: localizer,
        locating=lambda each: Beside(each, wait_for),
    )  # fmt: skip
    agent = DeviceAgent(parts, DeviceState(Settings(), GRAPH, "hall-site", "map"), localizer)
    agent.submit(SetDestination("bar"))
    loop = threading.Thread(target=agent.run, args=(stopped,), daemon=True)
    loop.start()
    assert enough.wait(LONG_S), "the loop waits for the localizer"
    stopped.set()
    loop.join(LONG_S)
    release.set()
    assert not loop.is_alive()
    stops = [cue.stamp_s for cue in output.cues if cue.kind is CueKind.STOP and cue.stamp_s > hung_s[0]]
    assert stops
    assert stops[0] - hung_s[0] <= 0.5 + 2.0 * FRAME_S + 1e-6
    clock.advance(1.0)

"""Stale or failed guidance is *Stop* within half a second by the clock, whatever happens to the loop.

The real agent on the shipped fakes, on a clock that is moved by hand: whoever sleeps lets time pass, and every look
that the watchdog's thread would take meanwhile is taken. One test has real threads.
"""

from __future__ import annotations

import itertools
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from test_device_agent import GRAPH, INTRINSICS, empty_hall, pose_at

from device_agent.adapters.clocks import FakeClock, SteppedClock
from device_agent.adapters.fakes import FakeCamera, FakeLocalizer, FakeOutput, FakeSonar, FakeUplink, NoSonar
from device_agent.agent import DeviceAgent, DeviceParts
from device_agent.cycle import Cycle
from device_agent.state import DeviceState
from device_agent.watchdog import CHECK_EVERY_S
from navcore.cues.table import Cue, CueKind
from navcore.errors import SensorError
from navcore.settings import Settings
from navcore.types import Action, Frame, Localization, LocalizationQuality, Reason, SonarReading
from navcore.wire import SetDestination

WITHIN_S = 0.5
FRAME_S = 0.1
SENDS_ON = frozenset({CueKind.WALK, CueKind.TICK, CueKind.STEER})
HERE = pose_at(0.5)
FREE_M = empty_hall(HERE)
BLACK = np.zeros((INTRINSICS.height_px, INTRINSICS.width_px, 3), np.uint8)


class WatchedClock(SteppedClock):
    """A clock on which time passes from one look of the watchdog to the next."""

    def __init__(self, now_s: float = 0.0) -> None:
        super().__init__(now_s)
        self.look: Callable[[], object] = lambda: None

    def sleep_until(self, stamp_s: float) -> None:
        while self.now_s() < stamp_s:
            super().sleep_until(min(stamp_s, self.now_s() + CHECK_EVERY_S))
            self.look()


@dataclass
class Walk:
    """Somebody is led through an empty hall; ``spoil`` changes or withholds frames, ``during_*`` is done in a stage."""

    clock: WatchedClock = field(default_factory=lambda: WatchedClock(100.0))
    spoil: Callable[[Frame], Frame | Exception] = lambda frame: frame
    during_localize: Callable[[], None] = lambda: None
    during_sonar: Callable[[], None] = lambda: None
    during_play: Callable[[], None] = lambda: None

    def __post_init__(self) -> None:
        self.output = FakeOutput(lambda cue: self.during_play())
        localizer = FakeLocalizer(self._locate)
        self.fake_sonar = FakeSonar(self.clock)
        parts = DeviceParts(
            self.clock, FakeCamera(INTRINSICS, self.clock, self._feed()), self, self.output, FakeUplink(),
            lambda *_: localizer,
        )  # fmt: skip
        self.agent = DeviceAgent(parts, DeviceState(Settings(), GRAPH, "hall-site", "map"), localizer)
        self.clock.look = self.agent.watchdog.check
        self.agent.submit(SetDestination("bar"))
        self.last_good_s = -np.inf

    def _feed(self) -> Iterator[Frame | Exception]:
        while True:
            yield self.spoil(Frame(self.clock.now_s() + FRAME_S, BLACK, FREE_M.copy()))

    def _locate(self, frame: Frame) -> Localization:
        self.during_localize()
        return Localization(frame.stamp_s, LocalizationQuality.LOCALIZED, HERE, np.eye(6) * 1e-4, 200)

    def read(self) -> SonarReading:
        self.during_sonar()
        self.fake_sonar.echo(None)
        return self.fake_sonar.read()

    def close(self) -> None:
        """Nothing is open."""

    def cycles(self, seconds: float) -> list[Cycle]:
        done, until_s = [], self.clock.now_s() + seconds
        while self.clock.now_s() < until_s:
            cycle = self.agent.run_cycle()
            if cycle.frame is None or cycle.fault:
                # The live loop pauses there; a camera that fails at once takes no time.
                self.clock.sleep_until(self.clock.now_s() + CHECK_EVERY_S)
            if cycle.guidance.action is Action.WALK:
                self.last_good_s = cycle.stamp_s
            done.append(cycle)
        return done

    def walking(self) -> Walk:
        assert self.cycles(2.0)[-1].guidance.action is Action.WALK
        return self

    def stop_after_s(self) -> float:
        """Return how long after the last good guidance *Stop* was heard."""
        stops = [
            cue.stamp_s for cue in self.output.cues if cue.kind is CueKind.STOP and cue.stamp_s >= self.last_good_s
        ]
        assert stops, "no Stop was heard"
        return stops[0] - self.last_good_s

    def sent_on_since(self, stamp_s: float) -> list[Cue]:
        return [cue for cue in self.output.cues if cue.stamp_s > stamp_s and cue.kind in SENDS_ON]


def assert_stopped_in_time_and_recovered(walk: Walk, failed_for_s: float = 4.0) -> None:
    """Let the failure last, mend it, and check what was heard."""
    walk.cycles(failed_for_s)
    assert walk.stop_after_s() <= WITHIN_S
    assert not walk.sent_on_since(walk.last_good_s + WITHIN_S), "nobody is sent on while it lasts"
    walk.spoil, walk.during_localize, walk.during_sonar = (lambda frame: frame), (lambda: None), (lambda: None)
    mended_s = walk.clock.now_s()
    assert walk.cycles(4.0)[-1].guidance.action is Action.WALK, "it goes on by itself"
    assert walk.sent_on_since(mended_s), "and is heard to"
    assert not any("Ultrasonic" in cue.text for cue in walk.output.cues), "what works is not said to have failed"


# -------------------------------------------------------------------------------------------- the loop is blocked
def blocking(clock: SteppedClock, seconds: float) -> Callable[[], None]:
    """Return something that takes so long, once."""
    left = [seconds]
    return lambda: clock.sleep_until(clock.now_s() + left.pop()) if left else None


@pytest.mark.parametrize("stage", ["during_localize", "during_sonar"])
@pytest.mark.parametrize("seconds", [0.51, 1.0, 30.0])
def test_a_stage_that_blocks(stage: str, seconds: float) -> None:
    walk = Walk().walking()
    setattr(walk, stage, blocking(walk.clock, seconds))
    assert_stopped_in_time_and_recovered(walk, seconds + 0.2)


def test_a_loop_that_is_slow_all_the_time_leads_nobody() -> None:
    walk = Walk().walking()
    walk.during_localize = lambda: walk.clock.sleep_until(walk.clock.now_s() + 0.7)
    assert_stopped_in_time_and_recovered(walk)


def test_a_localizer_that_raises() -> None:
    walk = Walk().walking()

    def fail() -> None:
        raise RuntimeError("no such key frame")

    walk.during_localize = fail
    walk.cycles(1.0)
    assert walk.stop_after_s() <= 2 * FRAME_S, "at once: nobody has to wait for what has failed"
    assert_stopped_in_time_and_recovered(walk)


def test_a_loop_that_blocks_in_a_thread_is_overruled_by_the_watchdogs_thread() -> None:
    """The same with real threads: the loop hangs for good, and only the watchdog can speak."""
    clock, hangs, release, heard = FakeClock(100.0), threading.Event(), threading.Event(), threading.Event()
    stamps: list[float] = []
    count = 0

    def frames() -> Iterator[Frame]:
        while True:
            clock.advance(FRAME_S)
            yield Frame(clock.now_s(), BLACK, FREE_M)

    def locate(frame: Frame) -> Localization:
        nonlocal count
        count += 1
        if count == 30:
            stamps.append(frame.stamp_s - FRAME_S)
            hangs.set()
            assert release.wait(30.0)
        return Localization(frame.stamp_s, LocalizationQuality.LOCALIZED, HERE, np.eye(6) * 1e-4, 200)

    def listen(cue: Cue) -> None:
        if cue.kind is CueKind.STOP and hangs.is_set() and not heard.is_set():
            stamps.append(cue.stamp_s)
            heard.set()

    localizer = FakeLocalizer(locate)
    parts = DeviceParts(
        clock, FakeCamera(INTRINSICS, clock, frames()), NoSonar(clock), FakeOutput(listen), FakeUplink(),
        lambda *_: localizer,
    )  # fmt: skip
    agent = DeviceAgent(parts, DeviceState(Settings(), GRAPH, "hall-site", "map"), localizer)
    agent.submit(SetDestination("bar"))
    stopped = threading.Event()
    loop = threading.Thread(target=agent.run, args=(stopped,), daemon=True)
    loop.start()
    assert hangs.wait(30.0)
    for _ in range(40):
        clock.wait_for_sleepers(1)
        if heard.is_set():
            break
        clock.advance(0.01)
    assert heard.wait(30.0)
    stopped.set()
    release.set()
    loop.join(30.0)
    clock.advance(1.0)
    last_good_s, stop_s = stamps
    assert stop_s - last_good_s <= WITHIN_S + 1e-6


# ------------------------------------------------------------------------------------------------ the camera dies
def old(frame: Frame) -> Frame:
    """Delivered now, captured long ago."""
    return Frame(frame.stamp_s - 0.8, frame.colour_rgb, frame.depth_m)


@pytest.mark.parametrize("error", [SensorError("The camera is gone."), OSError("usb"), RuntimeError("driver")])
def test_a_camera_that_raises(error: Exception) -> None:
    walk = Walk().walking()
    walk.spoil = lambda frame: error
    walk.cycles(1.0)
    assert walk.stop_after_s() <= 2 * FRAME_S
    assert_stopped_in_time_and_recovered(walk)


@pytest.mark.parametrize("seconds", [0.6, 5.0])
def test_a_camera_that_stalls(seconds: float) -> None:
    walk = Walk().walking()
    late = [seconds]
    walk.spoil = lambda frame: Frame(frame.stamp_s + (late.pop() if late else 0.0), frame.colour_rgb, frame.depth_m)
    assert_stopped_in_time_and_recovered(walk, seconds)


class CarelessCamera:
    """A driver that does not look at what it delivers."""

    intrinsics = INTRINSICS

    def __init__(self, clock: SteppedClock, feed: Iterator[Frame | Exception]) -> None:
        self._clock, self._feed = clock, feed

    def read(self) -> Frame:
        self._clock.sleep_until(self._clock.now_s() + FRAME_S)
        entry = next(self._feed)
        assert isinstance(entry, Frame)
        return entry

    def close(self) -> None:
        """Nothing is open."""


def careless(walk: Walk) -> Walk:
    """Give the walk a camera without any care for freshness."""
    parts = walk.agent._parts
    frames = (walk.spoil(Frame(walk.clock.now_s(), BLACK, FREE_M.copy())) for _ in itertools.count())
    changed = replace(parts, camera=CarelessCamera(walk.clock, frames))
    walk.agent = DeviceAgent(changed, DeviceState(Settings(), GRAPH, "hall-site", "map"), FakeLocalizer(walk._locate))
    walk.clock.look = walk.agent.watchdog.check
    walk.agent.submit(SetDestination("bar"))
    return walk.walking()


def test_a_camera_that_delivers_old_frames() -> None:
    walk = careless(Walk())
    walk.spoil = old  # type: ignore[assignment]
    assert_stopped_in_time_and_recovered(walk)


def test_a_camera_that_repeats_its_last_frame() -> None:
    walk = careless(Walk())
    frozen = Frame(walk.clock.now_s(), BLACK, FREE_M)
    walk.spoil = lambda frame: frozen
    assert_stopped_in_time_and_recovered(walk)


@pytest.mark.parametrize("stamp_s", [np.nan, np.inf, 1e6])
def test_a_stamp_that_is_no_time_of_the_past(stamp_s: float) -> None:
    walk = careless(Walk())
    walk.spoil = lambda frame: Frame(stamp_s, frame.colour_rgb, frame.depth_m)
    last_good_s = walk.clock.now_s()
    cycles = walk.cycles(2.0)
    assert all(cycle.guidance.action is Action.STOP for cycle in cycles[1:])
    stops = [cue.stamp_s for cue in walk.output.cues if cue.kind is CueKind.STOP and cue.stamp_s >= last_good_s]
    assert stops[0] - last_good_s <= WITHIN_S


# ----------------------------------------------------------------------------------------------------- bad depth
def filled(value: float) -> Callable[[Frame], Frame]:
    return lambda frame: Frame(frame.stamp_s, frame.colour_rgb, np.full_like(frame.depth_m, value))


def sprinkled(value: float, share: float) -> Callable[[Frame], Frame]:
    def spoil(frame: Frame) -> Frame:
        depth_m = frame.depth_m.copy()
        depth_m[np.random.default_rng(1).random(depth_m.shape) < share] = value
        return Frame(frame.stamp_s, frame.colour_rgb, depth_m)

    return spoil


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, -1.0, 0.0])
def test_a_depth_image_of_nothing(value: float) -> None:
    walk = Walk().walking()
    walk.spoil = filled(value)  # type: ignore[assignment]
    assert walk.cycles(0.5)[-1].guidance.action is Action.STOP
    assert_stopped_in_time_and_recovered(walk)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, -1.0, 0.0])
def test_a_depth_image_that_is_mostly_nothing(value: float) -> None:
    walk = Walk().walking()
    walk.spoil = sprinkled(value, 0.9)  # type: ignore[assignment]
    last = walk.cycles(0.5)[-1].guidance
    assert (last.action, last.reason) == (Action.STOP, Reason.DEPTH_INVALID)
    assert_stopped_in_time_and_recovered(walk)


@pytest.mark.parametrize("value", [np.nan, np.inf, -1.0])
def test_nobody_is_led_to_where_the_depth_image_shows_nothing(value: float) -> None:
    """The middle third of the image is missing: what is unknown is not clear."""
    walk = Walk().walking()

    def spoil(frame: Frame) -> Frame:
        depth_m = frame.depth_m.copy()
        depth_m[:, INTRINSICS.width_px // 3 : -INTRINSICS.width_px // 3] = value
        return Frame(frame.stamp_s, frame.colour_rgb, depth_m)

    walk.spoil = spoil  # type: ignore[assignment]
    for cycle in walk.cycles(3.0)[1:]:
        ahead = cycle.guidance.action is Action.WALK and abs(cycle.guidance.direction or 0.0) < np.radians(8.0)
        assert not ahead, cycle.guidance.trace.rule


def test_some_missing_pixels_stop_nobody() -> None:
    walk = Walk().walking()
    walk.spoil = sprinkled(np.nan, 0.2)  # type: ignore[assignment]
    assert all(cycle.guidance.action is Action.WALK for cycle in walk.cycles(2.0))

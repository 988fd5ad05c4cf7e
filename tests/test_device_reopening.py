"""What fails is an error with a reason, and comes back by itself: opened anew, and read beside the loop."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import pytest
from hardware_stand_ins import eventually
from hypothesis import given
from hypothesis import strategies as st

from device_agent.adapters.clocks import FakeClock, SteppedClock
from device_agent.adapters.fakes import FakeCamera, FakeLocalizer, FakeOutput, FakeUplink, NoSonar
from device_agent.adapters.newest import HANGS_AFTER_S, MAX_ABANDONED, NewestReader
from device_agent.adapters.newest_frame import NewestFrameCamera
from device_agent.adapters.reopened_camera import CameraSource, ReopenedCamera, check_live_frame
from device_agent.adapters.reopening import LONGEST_BACKOFF_S, TOLERATED_S, Reopening, backoff_s
from device_agent.agent import DeviceAgent, DeviceParts
from device_agent.state import DeviceState
from navcore.errors import MissingPackageError, SensorError
from navcore.planning.poi_graph import PoiGraph
from navcore.settings import Settings
from navcore.types import Action, CameraIntrinsics, Frame, Localization, LocalizationQuality, Reason

INTRINSICS = CameraIntrinsics(32, 24, 30.0, 30.0, 15.5, 11.5)


def frame(stamp_s: float) -> Frame:
    return Frame(stamp_s, np.full((24, 32, 3), 90, np.uint8), np.full((24, 32), 2.0, np.float32))


class Plug:
    """Where a camera is plugged in: each opening takes the next feed, or raises what stands in its place."""

    def __init__(self, clock: SteppedClock, *feeds: list[Frame | Exception] | Exception) -> None:
        self._clock = clock
        self._feeds = iter(feeds)
        self.opened_s: list[float] = []
        self.intrinsics = INTRINSICS

    def open(self) -> CameraSource:
        self.opened_s.append(self._clock.now_s())
        feed = next(self._feeds, SensorError("No camera is found: plug it in."))
        if isinstance(feed, Exception):
            raise feed
        return FakeCamera(self.intrinsics, self._clock, feed, fresh_for_s=1e9)


# ------------------------------------------------------------------------------------------------ opening anew
@given(st.integers(1, 10_000))
def test_patience_grows_up_to_a_bound(failure_count: int) -> None:
    assert 0.0 < backoff_s(failure_count) <= backoff_s(failure_count + 1) <= LONGEST_BACKOFF_S


def test_a_camera_that_disappears_is_an_error_with_its_reason_and_comes_back() -> None:
    clock = SteppedClock(100.0)
    plug = Plug(clock, [frame(100.0), OSError("gone")], SensorError("No camera: plug it in."), [frame(100.6)])
    camera = ReopenedCamera(plug.open, clock)
    assert camera.read().stamp_s == 100.0
    with pytest.raises(SensorError, match="gone"):
        camera.read()
    with pytest.raises(SensorError, match="gone"):
        camera.read()
    assert len(plug.opened_s) == 1, "it is not opened again at once"
    clock.sleep_until(100.0 + backoff_s(1))
    with pytest.raises(SensorError, match="plug it in"):
        camera.read()
    clock.sleep_until(clock.now_s() + backoff_s(2))
    assert camera.read().stamp_s == 100.6


def test_opening_is_tried_ever_more_patiently_and_for_ever() -> None:
    clock = SteppedClock(0.0)
    plug = Plug(clock, [SensorError("gone: plug it in")])
    camera = ReopenedCamera(plug.open, clock)
    while clock.now_s() < 120.0:
        with pytest.raises(SensorError):
            camera.read()
        clock.sleep_until(clock.now_s() + 0.05)
    pauses_s = np.diff(plug.opened_s)
    assert (np.diff(pauses_s[:6]) > -0.06).all()
    assert pauses_s[-1] == pytest.approx(LONGEST_BACKOFF_S, abs=0.1)


def test_what_is_missing_at_the_start_is_told_at_once() -> None:
    def missing() -> CameraSource:
        raise MissingPackageError("A camera needs a package: install it.")

    with pytest.raises(MissingPackageError):
        ReopenedCamera(missing, SteppedClock())
    with pytest.raises(SensorError, match="plug it in"):
        ReopenedCamera(Plug(SteppedClock()).open, SteppedClock())


def test_another_camera_in_its_place_is_refused() -> None:
    clock = SteppedClock(0.0)
    plug = Plug(clock, [SensorError("gone: plug it in")], [frame(1.0)], [frame(2.0)])
    camera = ReopenedCamera(plug.open, clock)
    with pytest.raises(SensorError, match="gone"):
        camera.read()
    plug.intrinsics = replace(INTRINSICS, fx_px=40.0)
    clock.sleep_until(1.0)
    with pytest.raises(SensorError, match="Another camera"):
        camera.read()
    plug.intrinsics = INTRINSICS
    clock.sleep_until(3.0)
    assert camera.read().stamp_s == 2.0


def test_a_camera_that_gives_nothing_of_use_is_opened_anew_after_a_while() -> None:
    clock = SteppedClock(100.0)
    blind = [replace(frame(100.1 + 0.1 * index), depth_m=np.full((24, 32), np.nan, np.float32)) for index in range(50)]
    plug = Plug(clock, [frame(100.0), *blind], [frame(110.0)])
    camera = ReopenedCamera(plug.open, clock, restart_after_s=2.0)
    camera.read()
    while len(plug.opened_s) == 1:
        with pytest.raises(SensorError, match="no distance at all"):
            camera.read()
        if clock.now_s() > 102.05:
            clock.sleep_until(clock.now_s() + backoff_s(1))
            break
    assert camera.read().stamp_s == 110.0


def test_a_closed_camera_is_not_opened_again() -> None:
    clock = SteppedClock(0.0)
    plug = Plug(clock, [frame(1.0)], [frame(2.0)])
    camera = ReopenedCamera(plug.open, clock)
    camera.close()
    clock.sleep_until(60.0)
    with pytest.raises(SensorError, match="closed"):
        camera.read()
    assert len(plug.opened_s) == 1


def test_a_camera_that_is_closed_while_it_is_being_opened_stays_closed() -> None:
    clock = SteppedClock(0.0)
    closed: list[str] = []

    class Slow(FakeCamera):
        def close(self) -> None:
            closed.append("closed")

    def opener() -> CameraSource:
        if closed or opener_calls:
            camera.close()
        opener_calls.append(1)
        return Slow(INTRINSICS, clock, [SensorError("gone: plug it in"), frame(1.0)])

    opener_calls: list[int] = []
    camera = ReopenedCamera(opener, clock)
    with pytest.raises(SensorError, match="gone"):
        camera.read()
    clock.sleep_until(1.0)
    with pytest.raises(SensorError, match="closed"):
        camera.read()
    assert len(closed) == 2, "both were closed"


# --------------------------------------------------------------------------------------------- what is refused
@pytest.mark.parametrize(
    ("bad", "reason"),
    [
        (frame(10.0), "old pictures"),
        (frame(9.5), "old pictures"),
        (frame(float("nan")), "does not say when"),
        (frame(float("inf")), "does not say when"),
        (replace(frame(11.0), depth_m=np.full((24, 32), np.nan, np.float32)), "no distance at all"),
        (replace(frame(11.0), depth_m=np.zeros((24, 32), np.float32)), "no distance at all"),
        (replace(frame(11.0), depth_m=np.zeros((0, 0), np.float32)), "another size"),
        (replace(frame(11.0), colour_rgb=np.zeros((0, 0, 3), np.uint8)), "another size"),
        (replace(frame(11.0), colour_rgb=np.zeros((24, 32), np.uint8)), "another size"),
        (replace(frame(11.0), depth_m=np.ones((48, 64), np.float32)), "another size"),
    ],
)
def test_a_frame_that_says_nothing_of_now_is_refused_with_the_reason(bad: Frame, reason: str) -> None:
    check_live_frame(frame(10.5), frame(10.0), INTRINSICS)
    check_live_frame(frame(10.5), None, INTRINSICS)
    with pytest.raises(SensorError, match=reason):
        check_live_frame(bad, frame(10.0), INTRINSICS)


def test_pictures_older_than_before_are_refused_even_after_opening_anew() -> None:
    clock = SteppedClock(100.0)
    old = [frame(99.0 + 0.01 * index) for index in range(3)]
    plug = Plug(clock, [frame(100.0), SensorError("gone: plug it in")], [*old, frame(101.0)])
    camera = ReopenedCamera(plug.open, clock)
    camera.read()
    with pytest.raises(SensorError, match="gone"):
        camera.read()
    clock.sleep_until(101.0)
    assert camera.read().stamp_s == 101.0, "the old ones were passed over"


def test_one_frame_of_no_use_stops_nobody_and_many_are_an_error() -> None:
    clock = SteppedClock(100.0)
    dark = [replace(frame(100.0 + at), depth_m=np.zeros((24, 32), np.float32)) for at in (0.1, 0.3, 0.4, 0.5)]
    camera = ReopenedCamera(Plug(clock, [frame(100.0), dark[0], frame(100.2), *dark[1:], frame(100.6)]).open, clock)
    assert [camera.read().stamp_s for _ in range(2)] == [100.0, 100.2]
    with pytest.raises(SensorError, match="no distance at all"):
        camera.read()
    assert clock.now_s() - 100.2 > TOLERATED_S
    assert camera.read().stamp_s == 100.6


# ---------------------------------------------------------------------------------------- a driver that hangs
class Hanging:
    """A driver of which the test says when, and whether, it returns."""

    intrinsics = INTRINSICS

    def __init__(self) -> None:
        self.let_go = threading.Event()
        self.asked = threading.Event()
        self.closed = threading.Event()
        self.gives: Frame | None = None

    def read(self) -> Frame:
        self.asked.set()
        assert self.let_go.wait(30.0)
        if self.gives is None:
            raise SensorError("it was let go: plug it in")
        return self.gives

    def close(self) -> None:
        self.closed.set()


@pytest.fixture
def drivers() -> Iterator[list[Hanging]]:
    made: list[Hanging] = []
    yield made
    for each in made:
        each.let_go.set()


def opener_of(made: list[Hanging], clock: FakeClock) -> Callable[[], CameraSource]:
    def opener() -> CameraSource:
        made.append(Hanging())
        return made[-1]

    return opener


def test_a_driver_that_hangs_does_not_hold_up_the_loop_and_is_left_behind(drivers: list[Hanging]) -> None:
    clock = FakeClock(100.0)
    real = ReopenedCamera(opener_of(drivers, clock), clock)
    camera = NewestFrameCamera(real, clock, timeout_s=0.01, abandon=real.abandon)
    assert drivers[0].asked.wait(10.0)
    with pytest.raises(SensorError, match="no pictures"):
        camera.read()
    assert len(drivers) == 1, "it is given time"
    clock.advance(HANGS_AFTER_S + 1.0)
    with pytest.raises(SensorError):
        camera.read()
    clock.advance(LONGEST_BACKOFF_S)
    eventually(lambda: len(drivers) == 2)
    assert drivers[1].asked.wait(10.0)
    # The old one returns after all: what it gives is not taken, and it is closed by its own thread.
    drivers[0].gives = frame(100.0)
    drivers[0].let_go.set()
    assert drivers[0].closed.wait(10.0)
    drivers[1].gives = frame(clock.now_s())
    drivers[1].let_go.set()
    got: list[Frame] = []

    def recovered() -> bool:
        try:
            got.append(camera.read())
        except SensorError:
            return False
        return True

    eventually(recovered)
    assert got[0].stamp_s == clock.now_s()
    camera.close()


def test_only_so_many_threads_are_left_behind(drivers: list[Hanging]) -> None:
    clock = FakeClock(0.0)
    reopening: Reopening[Frame] = Reopening("The camera", opener_of(drivers, clock), lambda item, last: None, clock)
    reader = NewestReader("camera", reopening, clock, reopening.abandon)

    def look() -> None:
        with contextlib.suppress(SensorError):
            reader.wait(0.0)

    for count in range(1, MAX_ABANDONED + 2):
        clock.advance(LONGEST_BACKOFF_S)
        eventually(lambda count=count: len(drivers) == count and drivers[-1].asked.is_set())
        look()
        clock.advance(HANGS_AFTER_S + 1.0)
        look()
    look()
    assert len(drivers) == MAX_ABANDONED + 1
    # One that returns after all makes room for another.
    drivers[0].let_go.set()
    assert drivers[0].closed.wait(10.0)

    def looked_again() -> bool:
        look()
        clock.advance(0.1)
        return len(drivers) == MAX_ABANDONED + 2

    eventually(looked_again)
    for driver in drivers:
        driver.let_go.set()
    reader.close()


# -------------------------------------------------------------------------------------------- in the whole loop
def nowhere(seen: Frame) -> Localization:
    return Localization(seen.stamp_s, LocalizationQuality.LOST, None)


def test_the_loop_stops_says_why_and_goes_on_when_the_camera_is_back() -> None:
    clock = SteppedClock(100.0)
    dark = replace(frame(100.4), depth_m=np.full((24, 32), np.nan, np.float32))
    plug = Plug(clock, [frame(100.1), dark, OSError("fell out")], [frame(103.0)])
    camera = ReopenedCamera(plug.open, clock)
    uplink = FakeUplink()
    parts = DeviceParts(
        clock, camera, NoSonar(clock), FakeOutput(), uplink, lambda site, lens, settings: FakeLocalizer(nowhere)
    )
    agent = DeviceAgent(parts, DeviceState(Settings(), PoiGraph(0, {}, {})), FakeLocalizer(nowhere))
    assert agent.run_cycle().frame is not None
    for reason in ("no distance at all", "fell out", "fell out"):
        cycle = agent.run_cycle()
        assert (cycle.guidance.action, cycle.guidance.reason) == (Action.STOP, Reason.SENSOR_STALE)
        assert reason in cycle.guidance.trace.rule
    clock.sleep_until(103.0)
    assert agent.run_cycle().frame is not None
    told = [text for _, kind, text in uplink.events if kind == "sensor"]
    assert [text.split(":")[0] for text in told] == [
        "The camera measures no distance at all",
        "The camera delivers again.",
    ]

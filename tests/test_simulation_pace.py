"""A live simulation waits for a slow loop, and only for a slow one."""

from __future__ import annotations

import threading
import time

import pytest

from device_agent.adapters.clocks import SteppedClock, SystemClock
from device_agent.simulation.pace import PATIENCE_S, PacedClock, RealTimeUplink
from navcore.wire import RouteChanged, WalkerState


@pytest.fixture
def real() -> SteppedClock:
    return SteppedClock(1000.0)


def pass_s(real: SteppedClock, seconds: float) -> None:
    real.sleep_until(real.now_s() + seconds)


def test_a_loop_that_keeps_up_has_real_time(real: SteppedClock) -> None:
    clock = PacedClock(real, 0.15)
    for _ in range(50):
        clock.sleep_until(clock.now_s() + 0.1)
        clock.step()
    assert clock.now_s() == pytest.approx(1005.0)
    assert clock.real_s(1005.0) == pytest.approx(1005.0)


def test_a_slow_loop_slows_the_world(real: SteppedClock) -> None:
    clock = PacedClock(real, 0.15)
    for _ in range(10):
        pass_s(real, 0.6)
        clock.step()
    assert clock.now_s() == pytest.approx(1001.5)
    assert real.now_s() == pytest.approx(1006.0)


def test_a_loop_that_is_gone_is_noticed(real: SteppedClock) -> None:
    clock = PacedClock(real, 0.15)
    pass_s(real, PATIENCE_S + 2.0)
    assert clock.now_s() == pytest.approx(1002.15)


def test_time_never_runs_backwards(real: SteppedClock) -> None:
    clock = PacedClock(real, 0.15)
    last_s = clock.now_s()
    for number in range(400):
        pass_s(real, 0.03)
        if number % 37 == 0:
            clock.step()
        assert clock.now_s() >= last_s
        last_s = clock.now_s()


class Kept:
    """An uplink that keeps what it is handed."""

    def __init__(self) -> None:
        self.stamps_s: list[float | None] = []

    def state(self, state: WalkerState) -> None:
        self.stamps_s += [state.stamp_s, state.last_cue_stamp_s]

    def depth_image(self, frame: object) -> None: ...

    def message(self, message: object) -> None:
        assert isinstance(message, RouteChanged)
        self.stamps_s.append(message.stamp_s)

    def event(self, stamp_s: float, kind: object, text: str) -> None:
        self.stamps_s.append(stamp_s)


def test_ages_on_the_console_are_true(real: SteppedClock) -> None:
    clock, kept = PacedClock(real, 0.15), Kept()
    uplink = RealTimeUplink(kept, clock)  # type: ignore[arg-type]
    pass_s(real, 1.0)
    clock.step()
    now_s = clock.now_s()
    uplink.state(WalkerState(now_s - 0.2, "lost", "stop", "pose_lost", last_cue_stamp_s=now_s - 0.5))
    uplink.message(RouteChanged(now_s))
    uplink.event(now_s - 0.1, "mode", "x")
    assert kept.stamps_s == pytest.approx([1000.8, 1000.5, 1001.0, 1000.9])


def test_sleeping_ends_in_real_time() -> None:
    clock = PacedClock(SystemClock(), 0.15)
    clock.step()
    began_s = time.monotonic()
    sleeper = threading.Thread(target=clock.sleep_until, args=(clock.now_s() + 0.1,))
    sleeper.start()
    sleeper.join(10.0)
    assert not sleeper.is_alive()
    assert time.monotonic() - began_s >= 0.1

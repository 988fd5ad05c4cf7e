"""The laws of the watchdog, look by look: when it speaks, what it says, and that nothing silences it.

Its clock is moved by hand; nothing sleeps.
"""

from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from device_agent.adapters.clocks import SteppedClock
from device_agent.adapters.fakes import FakeOutput
from device_agent.watchdog import (
    CHECK_EVERY_S,
    CLOCKS_DIFFER_S,
    REPEAT_AFTER_S,
    Heartbeat,
    Verdict,
    Vigil,
    Watchdog,
    is_fresh,
    keep_watch,
)
from navcore.cues.synthesis import stop_cue
from navcore.cues.table import Cue
from navcore.settings import spec_of
from navcore.types import Reason

# Powers of two, so that sums and differences are exact.
NOW_S = 64.0
TIMEOUT_S = 0.5


class Watched:
    """A watchdog, what it has played, and what it has reported."""

    def __init__(self, heard: Any = lambda cue: None, report: Any = lambda stamp_s, text: None, **options: Any) -> None:
        self.clock, self.output = SteppedClock(NOW_S), FakeOutput(heard)
        self.reports: list[tuple[float, str]] = []

        def told(stamp_s: float, text: str) -> None:
            self.reports.append((stamp_s, text))
            report(stamp_s, text)

        self.dog = Watchdog(self.clock, self.output, told, **options)

    def look_after(self, seconds: float) -> Verdict:
        """Let time pass, and look once."""
        self.clock.sleep_until(self.clock.now_s() + seconds)
        return self.dog.check()


# ------------------------------------------------------------------------------------------------ what is stale
@pytest.mark.parametrize(
    ("age_s", "fresh"),
    [
        (0.0, True), (TIMEOUT_S, True), (math.nextafter(TIMEOUT_S, 1.0), False), (math.inf, False), (math.nan, False),
        (-CLOCKS_DIFFER_S, True), (-math.nextafter(CLOCKS_DIFFER_S, 1.0), False), (-math.inf, False),
    ],
)  # fmt: skip
def test_fresh_is_from_a_moment_ago_until_now(age_s: float, fresh: bool) -> None:
    assert is_fresh(-age_s, 0.0, TIMEOUT_S) is fresh


def test_its_constants_leave_room_in_the_shortest_timeout() -> None:
    """Several looks within the shortest time that guidance may be old; repeats that leave the walker's ears free."""
    shortest_s = spec_of("watchdog.guidance_timeout_s").low
    assert shortest_s is not None
    assert shortest_s >= CHECK_EVERY_S * 4
    assert shortest_s >= CLOCKS_DIFFER_S * 2
    assert 1.0 < REPEAT_AFTER_S < 3.0


def test_a_heartbeat_that_says_nothing_leads_nobody_and_is_stale_after_half_a_second() -> None:
    silent = Heartbeat(NOW_S)
    assert (silent.leading, silent.fault, silent.timeout_s) == (False, "", TIMEOUT_S)
    assert Vigil() == Vigil(alarmed=False, last_stop_s=0.0)


@settings(deadline=None)
@given(
    alarmed=st.booleans(), since_s=st.sampled_from([0.0, 1.0, REPEAT_AFTER_S - 2**-20, REPEAT_AFTER_S, 9.0]),
    fault=st.sampled_from(["", "it broke"]), age_s=st.sampled_from([0.0, TIMEOUT_S, TIMEOUT_S + 2**-20, 9.0]),
)  # fmt: skip
def test_one_look(alarmed: bool, since_s: float, fault: str, age_s: float) -> None:
    before = Vigil(alarmed, NOW_S - since_s)
    after, verdict = keep_watch(before, Heartbeat(NOW_S - age_s, True, TIMEOUT_S, fault), NOW_S)
    if not fault and age_s <= TIMEOUT_S:
        assert (after, verdict) == (Vigil(), Verdict.RECOVERED if alarmed else Verdict.QUIET)
    elif not alarmed:
        assert (after, verdict) == (Vigil(True, NOW_S), Verdict.ALARM)
    elif since_s >= REPEAT_AFTER_S:
        assert (after, verdict) == (Vigil(True, NOW_S), Verdict.REPEAT)
    else:
        assert (after, verdict) == (before, Verdict.QUIET)


# ---------------------------------------------------------------------------------------------- what it says and when
def test_it_speaks_a_look_before_guidance_is_too_old() -> None:
    watched = Watched()
    watched.dog.beat(Heartbeat(NOW_S, leading=True, timeout_s=TIMEOUT_S))
    assert watched.look_after(TIMEOUT_S - CHECK_EVERY_S - 2**-20) is Verdict.QUIET
    assert watched.look_after(2**-19) is Verdict.ALARM
    assert watched.output.cues == [stop_cue(watched.clock.now_s(), Reason.SENSOR_STALE)]
    assert watched.dog.stop_count == 1


def test_it_is_stale_before_the_first_guidance_as_well() -> None:
    watched = Watched()
    assert watched.look_after(0.25) is Verdict.QUIET
    assert (watched.dog.alarmed, watched.dog.stale_s, watched.dog.stop_count) == (False, -math.inf, 0)
    assert watched.look_after(0.5) is Verdict.ALARM


def test_what_is_stale_is_so_until_a_fresh_beat_whoever_hears_it() -> None:
    watched = Watched()
    for leading in (False, True):
        watched.look_after(1.0)
        assert watched.dog.alarmed
        assert watched.dog.stale_s == watched.clock.now_s()
        watched.look_after(0.25)
        assert watched.dog.stale_s == watched.clock.now_s(), "it lasts"
        lasted_s = watched.clock.now_s()
        watched.dog.beat(Heartbeat(watched.clock.now_s(), leading=leading))
        assert watched.dog.check() is Verdict.RECOVERED
        assert not watched.dog.alarmed
        watched.look_after(0.125)
        assert watched.dog.stale_s == lasted_s
        assert watched.dog.check() is Verdict.QUIET


def test_each_incident_is_reported_once_with_its_end() -> None:
    watched = Watched()
    for _ in range(4):
        watched.look_after(1.0)
    assert watched.reports == [(NOW_S + 1.0, "No guidance for 1.0 s.")]
    watched.dog.beat(Heartbeat(watched.clock.now_s()))
    watched.dog.check()
    watched.dog.check()
    assert watched.reports[1:] == [(NOW_S + 4.0, "Guidance is fresh again.")]


def test_a_fault_is_said_at_once_keeps_who_is_led_and_names_no_sensor() -> None:
    watched = Watched(language=lambda: "zh")
    watched.dog.beat(Heartbeat(NOW_S, leading=True, timeout_s=0.25))
    watched.dog.fault("it broke")
    assert watched.output.cues == [stop_cue(NOW_S, Reason.OK, "zh")]
    assert watched.reports == [(NOW_S, "it broke")]
    assert watched.look_after(REPEAT_AFTER_S) is Verdict.REPEAT
    assert watched.dog.stop_count == 2
    watched.dog.beat(Heartbeat(watched.clock.now_s(), leading=True))
    assert watched.dog.check() is Verdict.RECOVERED
    assert len(watched.output.cues) == 2, "that all is well again is for guidance to say"


def test_by_itself_it_speaks_english() -> None:
    watched = Watched()
    watched.dog.beat(Heartbeat(NOW_S, leading=True))
    watched.dog.fault("it broke")
    assert watched.output.cues == [stop_cue(NOW_S, Reason.OK, "en")]


def test_an_output_that_fails_is_tried_again_and_does_not_count() -> None:
    fails = [True]

    def heard(cue: Cue) -> None:
        if fails:
            raise OSError("no sound card")

    watched = Watched(heard)
    watched.dog.beat(Heartbeat(NOW_S, leading=True))
    assert watched.look_after(1.0) is Verdict.ALARM
    assert watched.dog.stop_count == 0, "nobody heard it"
    assert len(watched.reports) == 1, "and it is reported all the same"
    fails.clear()
    assert watched.look_after(REPEAT_AFTER_S) is Verdict.REPEAT
    assert watched.dog.stop_count == 1


def test_a_report_that_fails_silences_nothing() -> None:
    def report(stamp_s: float, text: str) -> None:
        raise RuntimeError("the journal is closed")

    watched = Watched(report=report)
    watched.dog.beat(Heartbeat(NOW_S, leading=True))
    assert watched.look_after(1.0) is Verdict.ALARM
    assert watched.look_after(REPEAT_AFTER_S) is Verdict.REPEAT
    assert len(watched.output.cues) == 2


# ------------------------------------------------------------------------------------------------- its thread
class CountedClock(SteppedClock):
    """A clock that moves on for whoever sleeps, and calls somebody at each sleep."""

    def __init__(self, at_sleep: Any) -> None:
        super().__init__(NOW_S)
        self.slept_until_s: list[float] = []
        self._at_sleep = at_sleep

    def sleep_until(self, stamp_s: float) -> None:
        self.slept_until_s.append(stamp_s)
        super().sleep_until(stamp_s)
        self._at_sleep(len(self.slept_until_s))


def test_its_thread_looks_every_so_often_until_it_is_stopped_and_is_one_alone() -> None:
    stops: list[Cue] = []

    def at_sleep(count: int) -> None:
        # From within the thread: nobody has to wait for anything. A thread that does not stop ends by itself.
        if count == 30:
            dog.stop()
        if count > 40:
            raise SystemExit

    clock = CountedClock(at_sleep)
    dog = Watchdog(clock, FakeOutput(stops.append), lambda stamp_s, text: None)
    dog.beat(Heartbeat(NOW_S, leading=True, timeout_s=TIMEOUT_S))
    dog.start()
    thread = dog._thread
    dog.start()
    assert thread is not None
    assert dog._thread is thread
    assert thread.daemon, "a process whose loop has ended is not kept alive by it"
    thread.join(20.0)
    assert not thread.is_alive()
    assert clock.slept_until_s == pytest.approx([NOW_S + (i + 1) * CHECK_EVERY_S for i in range(30)])
    assert len(stops) == 1
    assert NOW_S + TIMEOUT_S - 2 * CHECK_EVERY_S < stops[0].stamp_s <= NOW_S + TIMEOUT_S

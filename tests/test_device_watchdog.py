"""The watchdog: stale guidance, a blocked loop or a fault is the cue Stop, in time, once per incident."""

from __future__ import annotations

import itertools
import math
import threading

from hypothesis import given, settings
from hypothesis import strategies as st

from device_agent.adapters.clocks import FakeClock, SteppedClock
from device_agent.adapters.fakes import FakeOutput
from device_agent.watchdog import CHECK_EVERY_S, REPEAT_AFTER_S, Heartbeat, Verdict, Vigil, Watchdog, keep_watch
from navcore.cues.table import Cue, CueKind, CuePriority


def watchdog(clock: SteppedClock, output: FakeOutput) -> tuple[Watchdog, list[str]]:
    reports: list[str] = []
    return Watchdog(clock, output, lambda stamp_s, text: reports.append(text)), reports


@settings(deadline=None)
@given(age_s=st.floats(0.0, 100.0), timeout_s=st.floats(0.2, 1.0), alarmed=st.booleans(), quiet_s=st.floats(0.0, 50.0))
def test_stale_guidance_is_never_taken_for_fresh(age_s: float, timeout_s: float, alarmed: bool, quiet_s: float) -> None:
    now_s = 1000.0
    before = Vigil(alarmed, now_s - quiet_s)
    after, verdict = keep_watch(before, Heartbeat(now_s - age_s, True, timeout_s), now_s)
    stale = now_s - (now_s - age_s) > timeout_s
    assert after.alarmed == stale
    assert (verdict in (Verdict.ALARM, Verdict.REPEAT)) == (stale and (not alarmed or quiet_s >= REPEAT_AFTER_S))


def test_one_stop_per_incident_repeated_while_it_lasts() -> None:
    clock, output = SteppedClock(10.0), FakeOutput()
    dog, reports = watchdog(clock, output)
    dog.beat(Heartbeat(10.0, leading=True, timeout_s=0.5))
    while clock.now_s() < 15.0:
        dog.check()
        clock.sleep_until(clock.now_s() + CHECK_EVERY_S)
    stamps = [cue.stamp_s for cue in output.cues]
    assert len(stamps) == 3
    assert 10.5 - 2 * CHECK_EVERY_S < stamps[0] <= 10.5
    assert all(later - earlier >= REPEAT_AFTER_S for earlier, later in itertools.pairwise(stamps))
    assert {(cue.kind, cue.priority) for cue in output.cues} == {(CueKind.STOP, CuePriority.STOP)}
    assert dog.stop_count == 3
    dog.beat(Heartbeat(clock.now_s(), leading=True))
    assert dog.check() is Verdict.RECOVERED
    assert len(reports) == 2


def test_a_fault_is_a_stop_at_once() -> None:
    clock, output = SteppedClock(10.0), FakeOutput()
    dog, reports = watchdog(clock, output)
    dog.beat(Heartbeat(10.0, leading=True))
    dog.fault("localization failed")
    assert [cue.kind for cue in output.cues] == [CueKind.STOP]
    assert reports == ["localization failed"]


def test_nobody_is_told_to_stop_who_is_not_being_led() -> None:
    clock, output = SteppedClock(10.0), FakeOutput()
    dog, reports = watchdog(clock, output)
    dog.beat(Heartbeat(10.0, leading=False))
    clock.sleep_until(20.0)
    assert dog.check() is Verdict.ALARM
    assert output.cues == []
    assert len(reports) == 1


def test_the_thread_stops_the_walker_while_the_loop_hangs_and_is_quiet_again_after() -> None:
    stopped = threading.Event()
    clock = FakeClock(10.0)

    def heard(cue: Cue) -> None:
        stopped.set()

    dog = Watchdog(clock, FakeOutput(heard), lambda stamp_s, text: None)
    dog.beat(Heartbeat(10.0, leading=True, timeout_s=0.5))
    dog.start()
    clock.wait_for_sleepers(1)
    for _ in range(8):
        advance_one_look(clock)
    assert not stopped.is_set()
    for _ in range(2):
        advance_one_look(clock)
    assert stopped.wait(10.0)
    dog.stop()
    clock.advance(1.0)


def advance_one_look(clock: FakeClock) -> None:
    """Let the watchdog look once more, and wait until it has."""
    clock.advance(CHECK_EVERY_S + 1e-6)
    clock.wait_for_sleepers(1)


def test_a_stamp_that_is_no_number_is_stale() -> None:
    assert keep_watch(Vigil(), Heartbeat(math.nan, True, 0.5), 10.0)[1] is Verdict.ALARM

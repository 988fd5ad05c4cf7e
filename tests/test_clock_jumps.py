"""Clocks that are set: by hours, by years, forwards and back. Nothing is lost, ended or let in by that alone."""

from __future__ import annotations

import inspect
import os
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from console_room import first_admin, serving, until
from hypothesis import given
from hypothesis import strategies as st
from sqlalchemy import select
from test_recorder import Times, recorded_rig, run
from walking_device import WalkingDevice

from console.accounts import LINK_VALID_S, SESSION_IDLE_S, Accounts
from console.errors import NotFoundError
from console.live import Freshness
from console.retention import DEFAULT_DAYS, EVERY_S, Retention
from console.store import Store
from console.tables import AuditRow
from device_agent.recording.options import RecordingOptions
from device_agent.recording.walk_files import WalkFiles, parts_in
from navcore.clock_trust import EVEN_FOR_S, LEAP_S, LONGEST_OFF_S, ClockTrust, looked_at
from navcore.machine_clock import since_boot_s
from navcore.modes import Mode
from navcore.site import Site, save_site

HOUR_S, DAY_S, YEAR_S = 3600.0, 86_400.0, 365.25 * 86_400.0
NOW_S = 1_795_000_000.0


# ------------------------------------------------------------------------------------------------- what is believed
@given(st.lists(st.tuples(st.floats(-20 * YEAR_S, 20 * YEAR_S), st.floats(0.0, 2 * HOUR_S)), max_size=20))
def test_no_more_time_is_believed_than_has_passed_before_a_clock_has_gone_on_evenly(
    leaps: list[tuple[float, float]],
) -> None:
    clock, now_s, latest_s = ClockTrust(NOW_S, NOW_S), NOW_S, NOW_S
    for leap_s, step_s in leaps:
        now_s += leap_s + step_s
        clock = looked_at(clock, now_s, step_s)
        assert clock.trusted_s <= now_s + 1e-3
        assert clock.trusted_s <= latest_s + step_s + LEAP_S + 1e-3
        latest_s = max(latest_s + step_s, clock.trusted_s)
        assert (clock.even_for_s is None) == (clock.trusted_s == now_s)


def test_a_clock_that_has_leapt_is_believed_after_a_day_and_a_second_leap_begins_the_day_anew() -> None:
    now_s = NOW_S + 10 * YEAR_S
    clock = looked_at(ClockTrust(NOW_S, NOW_S), now_s, 1.0)
    for _ in range(int(EVEN_FOR_S / EVERY_S) - 1):
        now_s += EVERY_S
        clock = looked_at(clock, now_s, EVERY_S)
    assert clock.even_for_s == EVEN_FOR_S - EVERY_S
    assert looked_at(clock, now_s + YEAR_S, EVERY_S).even_for_s == 0.0
    assert looked_at(clock, now_s + EVERY_S, EVERY_S) == ClockTrust(now_s + EVERY_S, now_s + EVERY_S)
    # Set right again: nothing has happened.
    assert looked_at(clock, NOW_S + DAY_S, EVERY_S) == ClockTrust(NOW_S + DAY_S, NOW_S + DAY_S)


def test_a_machine_that_was_off_for_a_night_is_believed_and_one_off_for_weeks_after_three_starts_at_most() -> None:
    trusted = ClockTrust(NOW_S, NOW_S)
    assert looked_at(trusted, NOW_S + LONGEST_OFF_S, None).even_for_s is None
    clock, now_s, starts = trusted, NOW_S, 0
    while starts == 0 or clock.even_for_s is not None:
        now_s, starts = now_s + 7 * DAY_S, starts + 1
        clock = looked_at(clock, now_s, None)
    assert starts == 3


BEGINS_AT_S = {"in 1970": lambda ended_s: 5.0, "where it ended": lambda ended_s: ended_s + 5.0}


@pytest.mark.parametrize("begins_at", BEGINS_AT_S)
@pytest.mark.parametrize(("off_s", "days"), [(DAY_S, 4), (10 * DAY_S, 40)], ids=["each day", "each ten days"])
def test_a_machine_without_a_clock_of_its_own_is_believed_after_some_starts_and_for_good(
    begins_at: str, off_s: float, days: float
) -> None:
    """Two hours at a time, and each time the network tells the time after ten seconds; nothing says that it did."""
    clock, now_s, ended_s = ClockTrust(5.0, 5.0), NOW_S, 0.0
    for start in range(30):
        clock = looked_at(clock, BEGINS_AT_S[begins_at](ended_s), None)
        assert clock.trusted_s <= clock.shown_s
        for passed_s in (10.0, *12 * [600.0]):
            now_s += passed_s
            clock = looked_at(clock, now_s, passed_s)
            assert clock.trusted_s <= now_s
            late_s = now_s - clock.trusted_s
            if start * off_s > days * DAY_S:
                assert late_s <= (0.0 if off_s <= LONGEST_OFF_S else 30 * DAY_S)
        ended_s, now_s = now_s, now_s + off_s - 2 * HOUR_S


def test_a_clock_that_is_set_back_keeps_what_was_known_and_is_believed_itself_after_a_day() -> None:
    clock = looked_at(ClockTrust(NOW_S, NOW_S), 1000.0, 60.0)
    assert clock.trusted_s == 1000.0, "nothing is older than the clock says"
    assert looked_at(clock, NOW_S + 120.0, 60.0).even_for_s is None, "set right again"
    assert looked_at(clock, NOW_S + YEAR_S, 60.0).trusted_s == NOW_S + 120.0
    now_s = 1000.0
    while clock.set_back is not None:
        now_s += EVERY_S
        clock = looked_at(clock, now_s, EVERY_S)
    assert now_s == 1000.0 + EVEN_FOR_S
    assert looked_at(clock, NOW_S + DAY_S, EVERY_S).even_for_s == 0.0, "what was shown a day ago was wrong, or this is"


def test_a_time_that_the_network_told_is_believed_at_once() -> None:
    leapt = looked_at(ClockTrust(5.0, 5.0), NOW_S, 10.0)
    assert leapt.trusted_s == 15.0
    assert looked_at(leapt, NOW_S + 10.0, 10.0, synchronised=True) == ClockTrust(NOW_S + 10.0, NOW_S + 10.0)


def test_the_kernel_tells_how_long_it_has_been_up_and_recordings_ask_for_that() -> None:
    before_s = time.clock_gettime(time.CLOCK_BOOTTIME)
    assert before_s <= since_boot_s() <= time.clock_gettime(time.CLOCK_BOOTTIME)
    assert inspect.signature(WalkFiles).parameters["monotonic_s"].default is since_boot_s


# ------------------------------------------------------------------------------------------------------- the console
class Clocks:
    """A wall clock that can be set, and one that nobody sets."""

    def __init__(self) -> None:
        self.wall_s, self.steady_s = NOW_S, 1000.0

    def pass_by(self, seconds: float) -> None:
        self.wall_s += seconds
        self.steady_s += seconds


@pytest.fixture
def clocks() -> Clocks:
    return Clocks()


@pytest.fixture
def store(tmp_path: Path, clocks: Clocks) -> Iterator[Store]:
    store = Store.open(tmp_path, lambda: clocks.wall_s)
    yield store
    store.close()


def test_a_leap_of_ten_years_deletes_nothing_is_told_and_can_be_confirmed(store: Store, clocks: Clocks) -> None:
    before: list[float] = []

    def delete_before(wall_s: float) -> int:
        before.append(wall_s)
        return 0

    def started() -> Retention:
        return Retention(store, {"Walks": delete_before}, lambda: clocks.steady_s)

    retention = started()
    assert retention.run().problems == ()
    clocks.wall_s += 10 * YEAR_S
    for _ in range(3):
        clocks.pass_by(EVERY_S)
        assert "shows 2036" in retention.run().problems[0]
        assert before[-1] == pytest.approx(NOW_S + clocks.steady_s - 1000.0 - DEFAULT_DAYS * DAY_S)
    # Starting anew is no confirmation.
    retention = started()
    assert "shows 2036" in retention.run().problems[0]
    assert before[-1] < NOW_S + DAY_S
    assert retention.delete_now("Ada").problems == ()
    assert before[-1] == clocks.wall_s - DEFAULT_DAYS * DAY_S
    clocks.wall_s -= 10 * YEAR_S
    assert retention.run().problems == ()
    assert before[-1] == clocks.wall_s - DEFAULT_DAYS * DAY_S


def test_a_session_lasts_no_longer_because_the_clock_was_ahead_and_ends_by_no_small_correction(
    store: Store, clocks: Clocks
) -> None:
    accounts = Accounts(store, lambda: clocks.steady_s)
    first = accounts.first_admin_link_token()
    assert first is not None
    ada = accounts.use_link(first, "Ada", "seven quiet corridors")
    session = accounts.start_session(ada.id)
    for change_s in (2 * HOUR_S, -4 * HOUR_S, 2 * HOUR_S):
        clocks.wall_s += change_s
        assert accounts.signed_in(session) is not None
    clocks.wall_s += 10 * YEAR_S
    assert accounts.signed_in(session) is None
    ahead, link = accounts.start_session(ada.id), accounts.new_admin_link_token("command line")
    assert accounts.signed_in(ahead) is not None
    assert accounts.link_name(link) is None
    clocks.wall_s -= 10 * YEAR_S
    assert accounts.signed_in(ahead) is None
    with pytest.raises(NotFoundError):
        accounts.link_name(link)
    again = accounts.start_session(ada.id)
    clocks.wall_s -= SESSION_IDLE_S - 60.0
    assert accounts.signed_in(again) is not None
    # Seen now, by the clock of now: it lasts from here.
    clocks.wall_s += SESSION_IDLE_S + 60.0
    assert accounts.signed_in(again) is None
    later = accounts.new_admin_link_token("command line")
    clocks.wall_s += LINK_VALID_S + 1.0
    with pytest.raises(NotFoundError):
        accounts.link_name(later)


@pytest.mark.parametrize("leap_s", [10 * YEAR_S, -NOW_S + 3600.0], ids=["ten years ahead", "back to 1970"])
def test_who_watches_sees_a_walker_as_live_as_before_and_hears_no_alert(
    tmp_path: Path, small_site: Site, leap_s: float
) -> None:
    save_site(small_site, tmp_path / "site")
    with serving(tmp_path / "site", tmp_path / "data") as server:
        services, hub = server.services, server.services.hub
        leapt_s = [0.0]
        wall_s = services.store.wall_s
        services.store.wall_s = hub._wall_s = lambda: wall_s() + leapt_s[0]
        admin = first_admin(server)
        device = WalkingDevice(server)
        device.send_state("b")
        until(hub, lambda each: each.state is not None and each.state.mode is Mode.GUIDING)
        admin.http.post("/api/devices/glasses/repeat").raise_for_status()
        leapt_s[0] = leap_s
        after_s = device.now_s()
        device.send_state("b")
        shown = until(hub, lambda each: each.state is not None and each.state.stamp_s >= after_s)
        assert shown.freshness(hub.now_s()) in (Freshness.LIVE, Freshness.DELAYED)
        for _ in range(3):
            services.alerts.check()
        assert services.alerts.active() == ()
        hub.repeat("glasses", "Ada")
        services.late_audit.write()
        with services.store.reading() as session:
            rows = session.scalars(select(AuditRow).where(AuditRow.action == "device_repeat")).all()
        assert [row.id for row in rows] == sorted(row.id for row in rows)
        assert (rows[1].at_s > rows[0].at_s) == (leap_s > 0)
        assert [row.id for row in services.store.latest_audit(2)] == [rows[1].id, rows[0].id]
        device.vanish()


# -------------------------------------------------------------------------------------------------------- the device
def test_recordings_are_not_removed_because_the_devices_clock_leapt_ahead(tmp_path: Path) -> None:
    times, told = Times(), list[str]()
    options = RecordingOptions(tmp_path, max_part_s=2.0, keep_s=7 * DAY_S)
    rig, recorder = recorded_rig(options, times)
    recorder.told = told.append  # type: ignore[method-assign]
    run(rig, recorder, times, 30)
    before = parts_in(tmp_path)
    times.wall_s += 10 * YEAR_S
    run(rig, recorder, times, 30)
    assert set(before) <= set(parts_in(tmp_path))
    assert len([text for text in told if "leapt ahead" in text]) == 1
    # What is really old by the time that is believed goes, as ever.
    long_ago_s = times.wall_s - 10 * YEAR_S - 8 * DAY_S
    os.utime(before[0], (long_ago_s, long_ago_s))
    run(rig, recorder, times, 30)
    recorder.close()
    assert before[0] not in parts_in(tmp_path)
    assert before[1] in parts_in(tmp_path)


def test_recordings_get_old_on_a_device_that_begins_in_1970_and_nobody_is_told_of_a_leap_each_time(
    tmp_path: Path,
) -> None:
    told, now_s, first = list[str](), NOW_S, None
    options = RecordingOptions(tmp_path, max_part_s=0.4, keep_s=3.5 * DAY_S)
    for day in range(5):
        times = Times()
        times.wall_s = 5.0 + day if day else now_s
        rig, recorder = recorded_rig(options, times)
        recorder.told = told.append  # type: ignore[method-assign]
        run(rig, recorder, times, 2)
        times.wall_s = now_s + 0.5
        run(rig, recorder, times, 4)
        recorder.close()
        if first is None:
            first = parts_in(tmp_path)[0]
            os.utime(first, (now_s, now_s))
        assert first.exists() == (day <= 3)
        now_s += DAY_S
    assert told == []
    # The network knows what no device can: that a year has gone by.
    kept = parts_in(tmp_path)[-1]
    os.utime(kept, (now_s, now_s))
    times.wall_s, times.synchronised = now_s + YEAR_S, True
    rig, recorder = recorded_rig(options, times)
    run(rig, recorder, times, 2)
    recorder.close()
    assert not kept.exists()

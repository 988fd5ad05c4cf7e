"""Long and odd outages between a real console and the device's link: what is kept, what is dropped, who waits."""

from __future__ import annotations

import asyncio
import errno
import gc
import json
import os
import sqlite3
import threading
import time
import weakref
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pytest
from console_room import serving, until
from device_hall import Rig
from link_proxy import Network
from test_device_link import Device

from console.live import LiveDevice
from console.server import ConsoleServer
from device_agent.adapters.clocks import FakeClock, SystemClock
from device_agent.device_store import DeviceStore
from device_agent.journal import EventJournal
from device_agent.link import ConsoleLink
from device_agent.link_settings import LinkSettings
from device_agent.link_state import LinkCondition, LinkState
from device_agent.ports import Clock
from device_agent.state_health import refuse_unwritable
from navcore.site import Site, load_site, map_checksum, save_site
from navcore.types import Action, Frame
from navcore.wire import ApplySettings, ClearDestination, RouteChanged, SettingsRunning, SharingRunning, WalkerState

CUT_S = 600


@dataclass
class States:
    """What a link has told of itself."""

    seen: list[LinkState] = field(default_factory=list)
    changed: threading.Condition = field(default_factory=threading.Condition)

    def note(self, state: LinkState) -> None:
        with self.changed:
            self.seen.append(state)
            self.changed.notify_all()

    def wait_for(self, holds: Callable[[LinkState], bool]) -> LinkState:
        with self.changed:
            assert self.changed.wait_for(lambda: any(map(holds, self.seen)), 60.0), "the link never stood so"
            return next(filter(holds, self.seen))

    def waiting_again(self, after: int) -> None:
        """Wait until the link has failed twice since it had told of itself so often."""
        with self.changed:
            assert self.changed.wait_for(
                lambda: sum(state.condition is LinkCondition.WAITING for state in self.seen[after:]) >= 2, 60.0
            )

    def joined(self, count: int = 1) -> None:
        with self.changed:
            assert self.changed.wait_for(
                lambda: sum(state.condition is LinkCondition.JOINED for state in self.seen) >= count, 60.0
            )


@dataclass
class Ends:
    """Console, network, and the device's end of the link."""

    console: ConsoleServer
    network: Network
    journal: EventJournal
    folder: Path
    token: str
    states: States = field(default_factory=States)

    def link(self, clock: Clock, wait: Callable[[float], object] = asyncio.sleep, **settings: object) -> ConsoleLink:
        times = {"first_pause_s": 0.02, "longest_pause_s": 0.1} | settings
        chosen = LinkSettings(
            f"ws://127.0.0.1:{self.network.port}", self.token, self.folder / "incoming",
            **times,  # type: ignore[arg-type]
        )  # fmt: skip
        link = ConsoleLink(chosen, self.journal, clock, wait)  # type: ignore[arg-type]
        link.on_link_state = self.states.note
        return link

    def cues(self) -> list[str]:
        """Return the texts of the cues that the console has stored, in the order of storing."""
        return [event.text for event in self.stored() if event.kind == "cue"]

    def stored(self) -> list:  # type: ignore[type-arg]
        return list(self.console.services.devices.latest_events("glasses", 100_000))

    def shown(self, holds: Callable[[LiveDevice], bool]) -> LiveDevice:
        return until(self.console.services.hub, holds)


@pytest.fixture
def ends(tmp_path: Path, small_site: Site) -> Iterator[Ends]:
    save_site(small_site, tmp_path / "site")
    with serving(tmp_path / "site", tmp_path / "data") as console:
        network = Network(int(console.ready.url.rsplit(":", 1)[1]))
        journal = EventJournal(tmp_path / "events.sqlite")
        token = console.services.devices.create_token("Glasses", "test")
        yield Ends(console, network, journal, tmp_path, token)
        journal.close()
        network.close()


def state_at(stamp_s: float) -> WalkerState:
    return WalkerState(stamp_s, "lost", "stop", "pose_lost")


def frame_at(stamp_s: float) -> Frame:
    return Frame(stamp_s, np.zeros((240, 320, 3), np.uint8), np.ones((240, 320), np.float32))


def test_after_ten_minutes_without_a_network_no_event_is_missing_and_only_now_is_shown(ends: Ends) -> None:
    clock = FakeClock(1000.0)
    over = threading.Event()

    async def wait(pause_s: float) -> None:
        # The ten minutes pass while the link waits between its attempts.
        clock.advance(pause_s)
        if clock.now_s() >= 1000.0 + CUT_S:
            await asyncio.to_thread(over.wait)

    link = ends.link(clock, wait, first_pause_s=0.5, longest_pause_s=30.0)
    device = Device()
    link.start(device)
    ends.states.joined()
    # A map that was still on its way would be asked for again, and let the same clock go on by its own pauses.
    device.wait_for(lambda: bool(device.maps))
    link.message(SharingRunning(silhouettes=True, walks=False))
    link.event(clock.now_s(), "cue", "before")
    ends.shown(lambda device: any(event.text == "before" for event in device.events))
    seen: list[LiveDevice] = []
    ends.console.services.hub.subscribe(seen.append)
    ends.network.cut()
    pictures = []
    for tenth in range(10 * CUT_S):
        now_s = 1000.0 + tenth / 10
        link.state(state_at(now_s))
        if tenth % 5 == 0:
            frame = frame_at(now_s)
            pictures.append(weakref.ref(frame.depth_m))
            link.depth_image(frame)
        if tenth % 10 == 0:
            link.event(now_s, "cue", f"second {tenth // 10}")
            link.message(RouteChanged(now_s, ((0.0, 0.0), (1.0, 0.0)), (), "b"))
    del frame
    # A link that has not noticed the cut yet may be sending one more.
    ends.states.wait_for(lambda state: state.failure_count >= 15)
    gc.collect()
    assert sum(picture() is not None for picture in pictures) == 1
    ends.network.mend()
    over.set()
    ends.states.joined(2)
    link.state(state_at(5000.0))
    last = f"second {CUT_S - 1}"
    shown = ends.shown(lambda d: d.state is not None and any(event.text == last for event in d.events))
    assert shown.state == state_at(5000.0)
    link.stop()
    assert ends.cues() == ["before", *(f"second {number}" for number in range(CUT_S))]
    numbers = [event.sequence for event in ends.stored()]
    assert numbers == list(range(1, len(numbers) + 1))
    assert {device.state.stamp_s for device in seen if device.state is not None} <= {5000.0}
    assert all(device.depth_image is None for device in seen)
    assert shown.route == RouteChanged(1000.0 + CUT_S - 1, ((0.0, 0.0), (1.0, 0.0)), (), "b")


def test_the_pause_doubles_up_to_its_longest_and_lies_in_its_upper_half_by_the_devices_seed(ends: Ends) -> None:
    ends.network.cut()

    def pauses(seed: int) -> list[float]:
        asked: list[float] = []
        enough = threading.Event()

        async def wait(pause_s: float) -> None:
            asked.append(pause_s)
            if len(asked) == 12:
                enough.set()
                await asyncio.Event().wait()

        link = ends.link(FakeClock(), wait, first_pause_s=0.5, longest_pause_s=30.0, seed=seed)
        link.start(Device())
        assert enough.wait(60.0)
        link.stop()
        return asked

    first = pauses(1)
    for count, pause_s in enumerate(first):
        longest_s = min(30.0, 0.5 * 2**count)
        assert longest_s / 2 <= pause_s <= longest_s
    assert pauses(1) == first
    assert pauses(2) != first


def test_after_a_link_that_held_the_pause_begins_small_again(ends: Ends) -> None:
    clock = FakeClock(1000.0)
    asked: list[float] = []
    mended = threading.Event()

    async def wait(pause_s: float) -> None:
        asked.append(pause_s)
        if len(asked) == 6:
            await asyncio.to_thread(mended.wait)

    ends.network.cut()
    link = ends.link(clock, wait, first_pause_s=0.5, longest_pause_s=30.0)
    link.start(Device())
    ends.states.wait_for(lambda state: state.failure_count == 6 and state.condition is LinkCondition.WAITING)
    ends.network.mend()
    mended.set()
    ends.states.joined()
    clock.advance(100.0)
    ends.network.cut()
    waiting = ends.states.wait_for(lambda state: state.failure_count == 1 and state.since_s >= 1100.0)
    link.stop()
    assert asked[5] >= 8.0
    assert waiting.pause_s <= 0.5


def test_a_network_that_swallows_everything_is_found_out_and_nothing_is_missing_afterwards(ends: Ends) -> None:
    link = ends.link(SystemClock(), answer_timeout_s=0.5)
    link.start(Device())
    ends.states.joined()
    before = len(ends.states.seen)
    ends.network.swallows = True
    for number in range(100):
        link.event(float(number), "cue", str(number))
    ends.states.waiting_again(before)
    ends.network.swallows = False
    ends.shown(lambda device: any(event.text == "99" for event in device.events))
    link.stop()
    assert ends.cues() == [str(number) for number in range(100)]


class SkewedClock(SystemClock):
    """A clock that is wrong by far more than the network could explain."""

    def now_s(self) -> float:
        return super().now_s() + 12_345.6


@pytest.mark.parametrize(("up_delay_s", "down_delay_s"), [(0.2, 0.0), (0.0, 0.2)])
def test_the_clocks_offset_is_wrong_by_no_more_than_it_says_over_a_lopsided_network(
    ends: Ends, up_delay_s: float, down_delay_s: float
) -> None:
    ends.network.up_delay_s, ends.network.down_delay_s = up_delay_s, down_delay_s
    clock, hub = SkewedClock(), ends.console.services.hub
    link = ends.link(clock)
    store = DeviceStore(ends.folder / "state", ends.folder / "site")
    refuse_unwritable(store.state_folder)

    def note(state: LinkState) -> None:
        store.save_link_state(state)
        ends.states.note(state)

    link.on_link_state = note
    link.start(Device())
    told = ends.states.wait_for(lambda state: state.clock_offset_s is not None)
    true_offset_s = clock.now_s() - hub.now_s()
    assert told.clock_offset_s is not None
    assert told.clock_uncertainty_s is not None
    assert told.clock_uncertainty_s >= 0.1
    # However long the two took: what one way takes longer than the other is half in the error.
    least_s = 0.2 - told.clock_uncertainty_s - 1e-3
    assert least_s <= abs(told.clock_offset_s - true_offset_s) <= told.clock_uncertainty_s
    captured_s, true_s = clock.now_s() - 3.0, hub.now_s() - 3.0
    link.state(state_at(captured_s))
    shown = ends.shown(lambda device: device.state is not None and device.state.stamp_s == captured_s)
    age_s, longest_s = shown.age_s(true_s + 4.0), shown.longest_age_s(true_s + 4.0)
    assert age_s is not None
    assert longest_s is not None
    assert shown.clock_uncertainty_s is not None
    assert abs(age_s - 4.0) <= shown.clock_uncertainty_s + 1e-3
    assert longest_s >= 4.0 - 1e-3
    link.stop()
    left = json.loads(store.link_state_path.read_text(encoding="utf-8"))
    assert left["condition"] == "stopped"
    assert abs(left["clock_offset_s"] - true_offset_s) <= left["clock_uncertainty_s"]


def walked(rig: Rig, cycles_count: int) -> list[Action]:
    """Let the loop go round; it may take its time, but it must come to an end while what holds the link still does."""
    done: list[Action] = []
    walking = threading.Thread(
        target=lambda: done.extend(cycle.guidance.action for cycle in rig.cycles(cycles_count)), daemon=True
    )
    walking.start()
    walking.join(120.0)
    assert not walking.is_alive(), "guidance waits"
    return done


def test_guidance_goes_on_while_the_socket_takes_nothing(ends: Ends) -> None:
    link = ends.link(SystemClock(), answer_timeout_s=60.0)
    link.start(Device())
    ends.states.joined()
    ends.network.stall(True)
    points = tuple((float(number), 0.0) for number in range(50_000))
    for _ in range(30):
        link.message(RouteChanged(0.0, points, (), "b"))
    rig = Rig(link=link)
    rig.lead_to()
    assert set(walked(rig, 100)) == {Action.WALK}
    ends.network.stall(False)
    ends.shown(lambda device: device.route is not None and device.state is not None)
    link.stop()


def test_guidance_goes_on_while_the_disk_takes_nothing_and_no_event_is_missing(ends: Ends) -> None:
    link = ends.link(SystemClock())
    link.start(Device())
    ends.states.joined()
    ends.journal.flush()
    rig = Rig(link=link)
    rig.lead_to()
    holder = sqlite3.connect(ends.folder / "events.sqlite", isolation_level=None)
    holder.execute("BEGIN IMMEDIATE")
    for number in range(100):
        link.event(float(number), "sensor", f"held {number}")
    assert set(walked(rig, 100)) == {Action.WALK}
    holder.execute("COMMIT")
    holder.close()
    link.event(100.0, "sensor", "held 100")
    ends.shown(lambda device: any(event.text == "held 100" for event in device.events))
    link.stop()
    held = [event.text for event in ends.stored() if event.text.startswith("held")]
    assert held == [f"held {number}" for number in range(101)]


def test_guidance_goes_on_while_the_disk_does_not_take_its_settings(
    tmp_path: Path, small_site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    save_site(small_site, tmp_path / "site")
    store = DeviceStore(tmp_path / "state", tmp_path / "site")
    refuse_unwritable(store.state_folder)
    gives_up = threading.Event()

    def hanging(_: int) -> None:
        """A disk that takes nothing for a while, and then fails."""
        assert gives_up.wait(60.0)
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    rig = Rig(store)
    rig.lead_to()
    with monkeypatch.context() as disk:
        disk.setattr(os, "fsync", hanging)
        rig.agent.submit(ApplySettings(3, {"cues.announce_m": 8.0}))
        assert set(walked(rig, 100)) == {Action.WALK}
        assert rig.messages(SettingsRunning)[-1].revision == 3
        gives_up.set()
        rig.agent.settle()
    assert any("could not be kept for the next start" in text for text in rig.events("mode"))
    rig.agent.submit(ApplySettings(4, {"cues.announce_m": 9.0}))
    rig.cycles(1)
    rig.agent.settle()
    assert store.load_settings()[1] == 4


def test_the_consoles_map_is_fetched_while_somebody_walks_taken_when_they_stop_and_acknowledged(
    ends: Ends, small_site: Site
) -> None:
    own = ends.folder / "own"
    save_site(replace(small_site, name="Older", roads_m=(small_site.roads_m[0] + 1.0,)), own)
    link, hub, offered = ends.link(SystemClock()), ends.console.services.hub, ends.console.services.package.checksum
    rig = Rig(DeviceStore(ends.folder / "state", own), link=link)
    rig.lead_to()

    def walk_until(holds: Callable[[LiveDevice], bool]) -> None:
        deadline_s = time.monotonic() + 60.0
        while not holds(hub.device("glasses")):
            rig.cycles(1)
            assert time.monotonic() < deadline_s, "the console was never told"

    link.start(rig.agent)
    ends.states.joined()
    walk_until(lambda device: device.map_waiting == offered)
    assert hub.device("glasses").map_checksum == "old-map"
    assert load_site(own).name == "Older"
    rig.agent.submit(ClearDestination())
    walk_until(lambda device: device.map_checksum == offered and not device.map_waiting)
    rig.agent.settle()
    assert map_checksum(own) == offered
    walk_until(lambda device: device.graph_version == ends.console.services.model.published.version)
    link.stop()

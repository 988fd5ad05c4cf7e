"""The link against a real WebSocket server, with outages."""

from __future__ import annotations

import asyncio
import contextlib
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
from device_console import TOKEN, Console
from websockets.sync.server import ServerConnection, serve

from device_agent.adapters.clocks import FakeClock
from device_agent.journal import EventJournal
from device_agent.link import ConsoleLink
from device_agent.link_settings import LinkSettings
from device_agent.sharing import LinkStands
from navcore.types import Frame
from navcore.wire import (
    PROTOCOL_VERSION,
    ConsoleMessage,
    Hello,
    MapAvailable,
    MapRunning,
    MapWalkRunning,
    Pause,
    Ping,
    Pong,
    Resume,
    RouteChanged,
    SetDestination,
    SettingsRunning,
    SharingRunning,
    WalkerState,
    decode_from_device,
    encode,
    tells_expired,
)


@dataclass
class Device:
    """The device's side of the link, as the link asks for it."""

    orders: list[ConsoleMessage] = field(default_factory=list)
    links: list[bool] = field(default_factory=list)
    maps: list[tuple[Path, str]] = field(default_factory=list)
    changed: threading.Condition = field(default_factory=threading.Condition)

    def hello(self) -> Hello:
        return Hello(PROTOCOL_VERSION, "glasses", "0.1.0", "small", "c0ffee", 3, 7, 100.0)

    def submit(self, order: ConsoleMessage | LinkStands, holds_s: float = np.inf) -> None:
        with self.changed:
            if isinstance(order, LinkStands):
                self.links.append(order.joined)
            else:
                self.orders.append(order)
            self.changed.notify_all()

    def map_arrived(self, staging: Path, checksum: str) -> None:
        with self.changed:
            self.maps.append((staging, checksum))
            self.changed.notify_all()

    def wait_for(self, condition: Callable[[], bool]) -> None:
        with self.changed:
            assert self.changed.wait_for(condition, 60.0), "the device waited in vain"


@pytest.fixture
def console() -> Iterator[Console]:
    console = Console()
    console.start()
    yield console
    console.close()


@pytest.fixture
def device() -> Device:
    return Device()


@pytest.fixture
def journal(tmp_path: Path) -> Iterator[EventJournal]:
    journal = EventJournal(tmp_path / "events.sqlite")
    yield journal
    journal.close()


@pytest.fixture
def link(console: Console, device: Device, journal: EventJournal, tmp_path: Path) -> Iterator[ConsoleLink]:
    link = make_link(f"ws://127.0.0.1:{console.port}", journal, tmp_path)
    link.start(device)
    yield link
    link.stop()


def make_link(url: str, journal: EventJournal, tmp_path: Path) -> ConsoleLink:
    settings = LinkSettings(
        url, TOKEN, tmp_path / ".site-incoming", first_pause_s=0.01, longest_pause_s=0.05, refused_pause_s=0.05
    )
    return ConsoleLink(settings, journal, FakeClock(100.0))


def cues(console: Console) -> list[str]:
    return [event.text for event in console.stored if event.kind == "cue"]


def test_joins_with_a_hello_and_answers_a_ping_with_both_clocks(console: Console, link: ConsoleLink) -> None:
    console.send(Ping(55.5))
    console.wait_for(lambda: bool(console.of_type(Pong)))
    assert console.seen[0] == Device().hello()
    assert console.of_type(Pong) == [Pong(55.5, 100.0, 100.0)]


def test_the_log_says_that_the_console_went_and_came_back(
    console: Console, link: ConsoleLink, device: Device, caplog: pytest.LogCaptureFixture
) -> None:
    def logged() -> list[str]:
        # As `vbr logs` has them: what is told the console, with its kind.
        return [record.getMessage() for record in caplog.records if getattr(record, "kind", "") == "link"]

    with caplog.at_level("INFO", logger="device_agent"):
        console.wait_for(lambda: "Joined the console." in [event.text for event in console.stored])
        caplog.clear()
        console.kill()
        console.start()
        console.wait_for(lambda: [event.text for event in console.stored].count("Joined the console.") == 2)
    assert logged() == ["The console is gone.", "Joined the console."]
    assert device.links == [True, False, True], "who may see pictures by a connection sees none without it"


def test_orders_reach_the_device_in_order(console: Console, link: ConsoleLink, device: Device) -> None:
    orders: list[ConsoleMessage] = [SetDestination("bar"), Pause(), Resume(), SetDestination("hall")]
    for order in orders:
        console.send(order)
    device.wait_for(lambda: len(device.orders) == 4)
    assert device.orders == orders


def test_an_order_that_comes_too_late_is_not_carried_out_and_the_console_is_told(
    console: Console, link: ConsoleLink, device: Device
) -> None:
    # The clock of the device stands at 100 s.
    console.send(Pause(order_id=4, expires_s=99.5))
    console.send(Resume(order_id=5, expires_s=101.0))
    device.wait_for(lambda: bool(device.orders))
    assert [type(order) for order in device.orders] == [Resume]
    console.wait_for(lambda: any(tells_expired(event, 4) for event in console.stored))
    assert not any(tells_expired(event, 5) for event in console.stored)


def test_a_refusal_is_never_the_answer_to_an_order_of_the_next_connection(console: Console, link: ConsoleLink) -> None:
    refusal = MapWalkRunning(False, "Somebody is being led.")
    console.wait_for(lambda: "Joined the console." in [event.text for event in console.stored])
    link.message(refusal)
    console.wait_for(lambda: bool(console.of_type(MapWalkRunning)))
    console.kill()
    console.start()
    console.wait_for(lambda: len(console.of_type(MapWalkRunning)) == 2)
    assert console.of_type(MapWalkRunning) == [refusal, MapWalkRunning(False)], "whether one is recorded is told again"
    console.kill()
    link.message(refusal)
    console.start()
    console.wait_for(lambda: len(console.of_type(MapWalkRunning)) == 3)
    assert console.of_type(MapWalkRunning)[-1] == MapWalkRunning(False), "nor is one that was still to be sent"


def test_events_are_complete_in_order_and_once_after_outages(console: Console, link: ConsoleLink) -> None:
    said = 0
    for _ in range(3):
        console.wait_for(lambda: console.joins >= 1)
        for _ in range(20):
            link.event(float(said), "cue", f"cue {said}")
            said += 1
        console.kill()
        for _ in range(20):
            link.event(float(said), "cue", f"cue {said}")
            said += 1
        joins = console.joins
        console.start()
        console.wait_for(lambda joins=joins: console.joins > joins)
    console.wait_for(lambda: len(cues(console)) == said)
    assert cues(console) == [f"cue {index}" for index in range(said)]
    sequences = [event.sequence for event in console.stored]
    assert sequences == sorted(set(sequences))


def test_events_that_were_not_confirmed_survive_a_restart_of_the_device(
    console: Console, device: Device, tmp_path: Path
) -> None:
    before = EventJournal(tmp_path / "events.sqlite")
    for index in range(5):
        before.append(float(index), "cue", f"cue {index}")
    before.close()
    after = EventJournal(tmp_path / "events.sqlite")
    after.append(9.0, "cue", "cue 5")
    link = make_link(f"ws://127.0.0.1:{console.port}", after, tmp_path)
    link.start(device)
    console.wait_for(lambda: len(cues(console)) == 6)
    link.stop()
    after.close()
    assert [event.sequence for event in console.stored][:6] == [1, 2, 3, 4, 5, 6]
    assert cues(console) == [f"cue {index}" for index in range(6)]


def test_what_runs_is_told_again_after_an_outage(console: Console, link: ConsoleLink) -> None:
    running = SettingsRunning(4, {"gate.clearance_m": 2.0})
    link.message(running)
    link.message(RouteChanged(1.0, ((0.0, 0.0), (1.0, 0.0)), (), "bar"))
    console.wait_for(lambda: bool(console.of_type(RouteChanged)))
    console.kill()
    link.message(RouteChanged(2.0, (), (), None))
    console.seen.clear()
    console.start()
    console.wait_for(lambda: bool(console.of_type(RouteChanged)) and bool(console.of_type(SettingsRunning)))
    assert console.of_type(SettingsRunning) == [running]
    assert console.of_type(RouteChanged)[-1].stamp_s == 2.0


def test_the_newest_state_wins_after_an_outage(console: Console, link: ConsoleLink) -> None:
    console.wait_for(lambda: "Joined the console." in [event.text for event in console.stored])
    console.kill()
    console.seen.clear()
    for index in range(1000):
        link.state(WalkerState(float(index), "lost", "stop", "pose_lost"))
    console.start()
    console.wait_for(lambda: [event.text for event in console.stored].count("Joined the console.") == 2)
    link.state(WalkerState(1000.0, "lost", "stop", "pose_lost"))
    console.wait_for(lambda: bool(console.of_type(WalkerState)))
    assert [state.stamp_s for state in console.of_type(WalkerState)] == [1000.0]


@pytest.mark.parametrize("bad", [b"\x00 not a message", "text", encode(Hello(1, "d", "v", "s", "c", 0, 0, 0.0))])
def test_a_message_that_cannot_be_read_closes_the_link_and_opens_it_anew(
    console: Console, link: ConsoleLink, device: Device, bad: bytes | str
) -> None:
    console.send_raw(bad)
    console.wait_for(lambda: console.joins >= 2)
    console.send(SetDestination("bar"))
    device.wait_for(lambda: SetDestination("bar") in device.orders)


def test_a_refused_token_is_said_once_and_tried_again(
    console: Console, device: Device, journal: EventJournal, tmp_path: Path
) -> None:
    console.token = "another"
    link = make_link(f"ws://127.0.0.1:{console.port}", journal, tmp_path)
    link.start(device)
    console.wait_for(lambda: console.refused)
    console.refused = False
    console.wait_for(lambda: console.refused)
    console.token = TOKEN
    console.wait_for(lambda: len(console.stored) >= 2)
    link.stop()
    texts = [event.text for event in console.stored if event.kind == "link"]
    assert "refuses this device's token" in texts[0]
    assert sum("token" in text for text in texts) == 1


@pytest.mark.parametrize(
    ("code", "reason", "told"),
    [
        (
            4401,
            "This token was revoked.",
            "token back: make a new one there and give it to the device.",
        ),
        (4403, "Use that one.", "The console refuses this device: Use that one."),
        (1008, "", "The console refuses this device: no reason given."),
    ],
)
def test_whoever_is_sent_away_is_told_why_and_what_to_do(
    code: int, reason: str, told: str, device: Device, journal: EventJournal, tmp_path: Path,
    caplog: pytest.LogCaptureFixture,
) -> None:  # fmt: skip
    called = threading.Event()

    def send_away(connection: ServerConnection) -> None:
        if called.is_set():
            # It has been told once it calls again.
            again.set()
        called.set()
        connection.close(code, reason)

    again = threading.Event()
    with serve(send_away, "127.0.0.1", 0) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        link = make_link(f"ws://127.0.0.1:{server.socket.getsockname()[1]}", journal, tmp_path)
        link.start(device)
        assert again.wait(30)
        link.stop()
    assert [record.message for record in caplog.records if record.message.endswith(told)]


def test_the_journal_numbers_on_after_a_console_that_knows_more(tmp_path: Path) -> None:
    journal = EventJournal(tmp_path / "events.sqlite")
    for index in range(3):
        journal.append(0.0, "cue", f"cue {index}")
    journal.flush()
    journal.agree(500)
    journal.append(0.0, "cue", "cue 3")
    journal.flush()
    assert [(event.sequence, event.text) for event in journal.pending(0)] == [
        (501, "cue 0"),
        (502, "cue 1"),
        (503, "cue 2"),
        (504, "cue 3"),
    ]
    journal.agree(502)
    assert [event.sequence for event in journal.pending(0)] == [503, 504]
    journal.close()


def journal_with(path: Path | None, texts: list[str]) -> EventJournal:
    journal = EventJournal(path)
    for text in texts:
        journal.append(0.0, "cue", text)
    journal.flush()
    return journal


def told(journal: EventJournal, last_stored: int) -> tuple[list[str], int]:
    """Let a console that has events up to a number take all that waits; return it, and the number of the last."""
    journal.agree(last_stored)
    events = journal.pending(last_stored, 1000)
    assert [event.sequence for event in journal.pending(0, 1000)] == [event.sequence for event in events]
    assert all(decode_from_device(encode(event)) == event for event in events)
    last_stored = max((event.sequence for event in events), default=last_stored)
    journal.confirm(last_stored)
    return [event.text for event in events], last_stored


@pytest.mark.parametrize("on_disk", [True, False])
def test_a_new_journal_takes_nothing_for_known_that_the_console_has_of_an_earlier_one(
    on_disk: bool, tmp_path: Path
) -> None:
    texts = [f"cue {index}" for index in range(10)]
    journal = journal_with(tmp_path / "events.sqlite" if on_disk else None, texts)
    journal.agree(5)
    waiting = journal.pending(5)
    assert [event.text for event in waiting] == texts
    journal.agree(waiting[3].sequence)
    assert [event.text for event in journal.pending(0)] == texts[4:], "from the second time on, they are its own"
    journal.close()


@pytest.mark.parametrize("before_it_was_kept", [False, True])
def test_a_journal_that_has_met_the_console_knows_its_numbers_again_after_a_restart(
    before_it_was_kept: bool, tmp_path: Path
) -> None:
    path = tmp_path / "events.sqlite"
    journal = journal_with(path, ["stored", "also stored", "untold"])
    journal.agree(0)
    if before_it_was_kept:
        journal._base.execute("DROP TABLE agreed")
    journal.close()
    journal = EventJournal(path)
    assert told(journal, 2) == (["untold"], 3)
    journal.close()


def test_events_that_wait_on_a_disk_outlive_starts_without_it(tmp_path: Path) -> None:
    path, last_stored = tmp_path / "events.sqlite", 0
    for start in range(60):
        on_disk = journal_with(path, [f"told {start}"])
        texts, last_stored = told(on_disk, last_stored)
        assert texts == [*([f"late {start - 1} {index}" for index in range(5)] if start else []), f"told {start}"]
        on_disk.close()
        journal_with(path, [f"late {start} {index}" for index in range(5)]).close()
        in_memory = journal_with(None, ["memory 0", "memory 1"])
        texts, last_stored = told(in_memory, last_stored)
        assert texts == ["memory 0", "memory 1"]
        in_memory.close()


@pytest.mark.parametrize("damage", [b"not a database" * 100, b""], ids=["another file", "pages overwritten"])
def test_a_damaged_journal_is_put_aside_and_the_device_starts_all_the_same(tmp_path: Path, damage: bytes) -> None:
    path = tmp_path / "events.sqlite"
    before = EventJournal(path)
    assert before.damaged is None
    for index in range(400):
        before.append(float(index), "cue", f"cue {index} " + "x" * 100)
    before.close()
    sound = path.read_bytes()
    path.write_bytes(damage or sound[:100] + bytes(255 - byte for byte in sound[100:]))
    broken = path.read_bytes()
    after = EventJournal(path)
    assert after.damaged is not None
    assert after.damaged.read_bytes() == broken
    after.append(1.0, "cue", "goes on")
    after.flush()
    assert [event.text for event in after.pending(0)] == ["goes on"]
    after.close()
    path.write_bytes(b"broken again" * 100)
    again = EventJournal(path)
    again.close()
    assert again.damaged not in (None, after.damaged)
    assert after.damaged.read_bytes() == broken


def test_a_map_that_cannot_be_had_is_answered_with_the_reason(
    console: Console, link: ConsoleLink, device: Device
) -> None:
    console.send(MapAvailable("/maps/new", "c0ffee", 10, "0" * 64))
    console.wait_for(lambda: bool(console.of_type(MapRunning)))
    assert console.of_type(MapRunning)[0] == MapRunning("c0ffee")
    console.send(MapAvailable("/maps/new", "another", 10, "0" * 64))
    console.wait_for(lambda: len(console.of_type(MapRunning)) == 2)
    assert "could not be fetched" in console.of_type(MapRunning)[1].refusal


def test_a_full_disk_or_a_text_that_cannot_be_stored_does_not_end_the_journal(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("device_agent.journal.MAX_EVENTS_IN_MEMORY", 200)
    journal = EventJournal(tmp_path / "events.sqlite")
    journal.append(0.0, "cue", "before")
    journal.append(0.0, "sensor", "a broken name \udcff")
    journal.flush()
    pages = journal._base.execute("PRAGMA page_count").fetchone()[0]
    journal._base.execute(f"PRAGMA max_page_count={pages}")
    for number in range(150):
        journal.append(1.0, "cue", f"{number} ".ljust(500, "x"))
        journal.flush()
    for time_s in (float("nan"), float("inf")):
        journal.append(time_s, "cue", "no time")
    journal.flush()
    for _ in range(100):
        journal.append(1.0, "cue", "too many")
        journal.flush()
    journal._base.execute("PRAGMA max_page_count=100000")
    journal.append(2.0, "cue", "after")
    journal.flush()
    texts = [event.text for event in journal.pending(0, 1000)]
    assert texts[:2] == ["before", "a broken name ?"]
    assert [text.split()[0] for text in texts[2:152]] == [str(number) for number in range(150)]
    assert texts[152:154] == ["no time", "no time"]
    kept_count = texts.count("too many")
    assert 0 < kept_count < 100
    gap = f"{100 - kept_count} events were too many for the disk and are missing."
    assert texts[154:] == ["too many"] * kept_count + ["after", gap]
    assert all(decode_from_device(encode(event)) == event for event in journal.pending(0, 1000))
    journal.close()


def test_of_too_many_events_the_oldest_give_way_to_one_that_says_how_many(tmp_path: Path) -> None:
    journal = EventJournal(tmp_path / "events.sqlite", max_count=10)

    def said(first: int, last: int) -> list[str]:
        for number in range(first, last):
            journal.append(float(number), "cue", str(number))
            journal.flush()
        return [event.text for event in journal.pending(0, 1000)]

    kept = [str(number) for number in range(10)]
    assert said(0, 10) == kept
    (gap, *rest) = said(10, 15)
    assert (gap.split()[0], rest) == ("5", [str(number) for number in range(5, 15)])
    (gap, *rest) = said(15, 32)
    assert (gap.split()[0], rest) == ("22", [str(number) for number in range(22, 32)])
    (told, *_) = journal.pending(0, 1)
    assert (told.sequence, told.kind, "missing" in told.text) == (22, "link", True)
    journal.confirm(told.sequence)
    (gap, *rest) = said(32, 35)
    assert (gap.split()[0], rest) == ("3", [str(number) for number in range(25, 35)])
    journal.close()


def test_a_network_that_takes_nothing_does_not_keep_the_machine_busy(journal: EventJournal, tmp_path: Path) -> None:
    asked = []

    class Stalled:
        """A socket whose buffer never empties."""

        @property
        def transport(self) -> Stalled:
            return self

        def get_write_buffer_size(self) -> int:
            asked.append(1)
            return 1

        async def send(self, data: bytes) -> None:
            """Keep it in the buffer."""

    async def send_for_a_while() -> None:
        link._loop = asyncio.get_running_loop()
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(link._send_all(Stalled()), 0.4)  # type: ignore[arg-type]

    link = make_link("ws://127.0.0.1:9", journal, tmp_path)
    own_loop = link._loop
    link.message(SharingRunning(True, False))
    link.depth_image(Frame(100.0, np.zeros((2, 2, 3), np.uint8), np.ones((2, 2), np.float32)))
    asyncio.run(send_for_a_while())
    own_loop.close()
    assert 1 <= len(asked) <= 30

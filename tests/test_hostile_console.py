"""A console that means harm, and the real link and loop of a device: guidance decides as it does without a console."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import pytest
from device_console import TOKEN, Console
from device_hall import GRAPH, Rig

from device_agent.adapters.clocks import SteppedClock
from device_agent.agent import MAX_WAITING_ORDERS, ORDERS_A_CYCLE
from device_agent.journal import MAX_AGREED_SEQUENCE, EventJournal
from device_agent.link import ConsoleLink
from device_agent.link_settings import LinkSettings
from device_agent.sharing import LinkStands
from navcore import wire
from navcore.cues.table import CueKind
from navcore.errors import VbrError, WireError
from navcore.planning.poi_graph import Edge, PoiGraph
from navcore.settings import Settings, setting_specs
from navcore.types import Action
from navcore.wire import (
    Accesses,
    ApplySettings,
    AskColour,
    EventConfirmed,
    KeepSettings,
    MapAvailable,
    Ping,
    PublishGraph,
    Say,
    Watchers,
    Welcome,
)
from navcore.wire_pace import BURST_S

WAIT_S = 30.0
CYCLES = 30


@dataclass
class Walk:
    """A device that leads somebody, and the console that it is joined to."""

    rig: Rig
    console: Console
    journal: EventJournal

    def decisions(self, count: int) -> list[tuple[object, ...]]:
        """Walk on; return what guidance decided in each cycle."""
        return [_decision(cycle.guidance) for cycle in self.rig.cycles(count)]

    def until(self, holds: Callable[[], object]) -> None:
        """Wait, in true time, for something to come to be; the walk stands still meanwhile."""
        self.console.wait_for(lambda: bool(holds()), WAIT_S)


def _decision(guidance: Any) -> tuple[object, ...]:
    return guidance.action, guidance.reason, guidance.direction, guidance.trace.rule, guidance.trace.sub_goal


@pytest.fixture
def walk(tmp_path: Path) -> Iterator[Walk]:
    with _joined(tmp_path) as walk:
        yield walk


@contextlib.contextmanager
def _joined(tmp_path: Path, counted_s: Callable[[], float] | None = None) -> Iterator[Walk]:
    console, clock = Console(), SteppedClock(100.0)
    console.start()
    journal = EventJournal(tmp_path / "events.sqlite")
    settings = LinkSettings(
        f"ws://127.0.0.1:{console.port}", TOKEN, tmp_path / "in", first_pause_s=0.01, longest_pause_s=0.02,
        refused_pause_s=0.02,
    )  # fmt: skip
    link = ConsoleLink(settings, journal, clock, counted_s=counted_s)
    rig = Rig(link=link, clock=clock)
    link.start(rig.agent)
    try:
        console.wait_for(lambda: console.joins >= 1, WAIT_S)
        yield Walk(rig, console, journal)
    finally:
        link.stop()
        journal.close()
        console.close()


def _alone() -> list[tuple[object, ...]]:
    rig = Rig()
    rig.lead_to()
    return [_decision(cycle.guidance) for cycle in rig.cycles(CYCLES)]


def _raw(message: wire.ConsoleMessage, **changes: object) -> bytes:
    return msgspec.msgpack.encode(msgspec.msgpack.decode(wire.encode(message)) | changes)


ENDS_THE_LINK: tuple[bytes | str, ...] = (
    b"\x00", "text", b"\x92" * 50_000, wire.encode(Welcome(wire.PROTOCOL_VERSION, 0)),
    _raw(Ping(0.0), console_sent_s=1e300),
    _raw(Say("x"), text="x" * 501), _raw(ApplySettings(1, {}), values={"gate.clearance_m": float("nan")}),
    _raw(ApplySettings(1, {}), revision=1 << 60), _raw(ApplySettings(1, {}), revert_after_s=-1.0),
    _raw(PublishGraph(GRAPH), graph={"version": 1 << 60}), _raw(Watchers(()), names=["x"] * 21),
    wire.encode(EventConfirmed(1 << 40)), wire.encode(wire.MapRunning("x")),
)  # fmt: skip
"""Each is refused, ends the link, and is joined anew."""
ORDERS: tuple[wire.ConsoleMessage, ...] = (
    *(ApplySettings(9, {spec.key: -1e12 if number % 2 else 1e12}, kept_before=number % 3 == 0) for number, spec in
      enumerate([spec for spec in setting_specs() if spec.safety][:40])),
    ApplySettings(9, {"no.such": 1.0}), ApplySettings(9, {"gate.clearance_m": "far"}),
    ApplySettings(9, {"cues.language": "xx"}), ApplySettings(9, {"gate.clearance_m": 2.5}, kept_before=True),
    ApplySettings(9, {"gate.clearance_m": 2.5}, override_reason="   "), KeepSettings(1 << 53),
    PublishGraph(PoiGraph(1 << 53)),
    PublishGraph(PoiGraph(7, GRAPH.pois, {"x": Edge("x", "hall", "gone", ((0.0, 0.0), (1.0, 0.0)), 1.0)})),
    MapAvailable("//elsewhere/map", "c0ffee", 10, "0" * 64), MapAvailable("/x", "../../etc", 10, "0" * 64),
    MapAvailable("/x", "c0ffee", 1 << 53, "0" * 64),
    Watchers(("\x1b[2J",) * 20), AskColour(request_id=1 << 53, who="\x00", why="x" * 120),
    Accesses((wire.Access("x", "watch", -1e12, 1e12, 1e12),) * 40, 1e12, 1e12),
    Ping(-1e12, 1e12, 1e12), Ping(1e12, -1e12, -1e12),
)  # fmt: skip
"""Each is well-formed, and is refused, or touches nothing that guidance decides by."""


def test_guidance_decides_the_same_whatever_a_console_sends(walk: Walk, caplog: pytest.LogCaptureFixture) -> None:
    alone = _alone()
    walk.rig.lead_to()
    before = walk.rig.agent.state.settings
    decided = list[tuple[object, ...]]()
    for data in ENDS_THE_LINK:
        joins = walk.console.joins
        walk.console.send_raw(data)
        walk.until(lambda joins=joins: walk.console.joins > joins)
        decided += walk.decisions(1)
    sent = iter(ORDERS)
    while len(decided) < CYCLES:
        for order in [order for order, _ in zip(sent, range(10), strict=False)]:
            walk.console.send(order)
        decided += walk.decisions(1)
    assert decided == alone
    assert list(sent) == [], "all of it was sent"
    # What was sent last has been taken as well.
    answered = len(walk.console.of_type(wire.Pong))
    walk.console.send(Ping(1.0))
    walk.until(lambda: len(walk.console.of_type(wire.Pong)) > answered)
    walk.rig.cycles(20)
    assert walk.rig.agent.state.settings == before == Settings()
    assert walk.rig.agent.state.graph == GRAPH
    assert CueKind.STOP not in walk.rig.heard
    assert walk.rig.agent.watchdog.stop_count == 0
    assert [record for record in caplog.records if record.exc_info] == []
    assert len(caplog.records) < 3 * len(ENDS_THE_LINK) + 60, "a sentence for a link that ends, none for each message"


def test_a_flood_of_orders_ends_the_link_and_reaches_the_walker_in_measure(tmp_path: Path) -> None:
    # No time passes while they come, so as many are too many on every machine.
    with _joined(tmp_path, counted_s=lambda: 0.0) as walk:
        walk.rig.lead_to()
        joins = walk.console.joins
        walk.console.flood(Say(f"Walk on, {number}.") for number in range(2000))
        walk.until(lambda: walk.console.joins > joins)
        before = len(walk.rig.output.cues)
        cycles = walk.rig.cycles(20)
        assert all(cycle.guidance.action is Action.WALK for cycle in cycles)
        said = [cue.text for cue in walk.rig.output.cues[before:] if cue.kind is CueKind.MESSAGE]
        rate_hz = wire.MESSAGES[Say].rate_hz
        assert rate_hz is not None
        assert said[-1] == f"Walk on, {int(BURST_S * rate_hz) - 1}.", (
            "of 2000, just as many as one connection may bring"
        )
        assert walk.rig.agent.watchdog.stop_count == 0


def test_guidance_goes_on_between_orders_however_many_come_from_however_many_threads() -> None:
    rig = Rig()
    rig.lead_to()
    stopped, refused = threading.Event(), list[VbrError]()

    def flood() -> None:
        while not stopped.is_set():
            try:
                rig.agent.submit(Watchers(("Anna",)))
            except VbrError as error:
                refused.append(error)
                # The loop is to be kept busy by orders, not by whoever gives them.
                time.sleep(0.0)

    threads = [threading.Thread(target=flood) for _ in range(2)]
    for thread in threads:
        thread.start()
    try:
        cycles = rig.cycles(CYCLES)
    finally:
        stopped.set()
        for thread in threads:
            thread.join()
    assert [_decision(cycle.guidance) for cycle in cycles] == _alone()
    assert refused
    assert rig.agent._orders.qsize() <= MAX_WAITING_ORDERS + len(threads)


def test_what_the_device_tells_itself_is_taken_however_many_orders_wait() -> None:
    rig = Rig()
    rig.agent.submit(Watchers(("Anna",)))
    rig.cycles(1)
    with pytest.raises(VbrError, match="too busy"):  # noqa: PT012
        for _ in range(MAX_WAITING_ORDERS + 1):
            rig.agent.submit(Watchers(("Anna",)))
    rig.agent.submit(LinkStands(False))
    rig.cycles(MAX_WAITING_ORDERS // ORDERS_A_CYCLE + 2)
    assert rig.agent.state.privacy.watchers is None, "without a link nobody knows who watches"


def test_no_console_can_take_events_that_it_was_not_sent_nor_the_numbers_of_those_to_come(walk: Walk) -> None:
    walk.until(lambda: walk.console.stored)
    walk.console.confirms = False
    joins = walk.console.joins
    walk.console.send(EventConfirmed(1 << 40))
    walk.until(lambda: walk.console.joins > joins)
    walk.rig.agent._parts.uplink.event(100.0, "cue", "not lost")
    walk.until(lambda: any(event.text == "not lost" for event in walk.console.of_type(wire.Event)))
    assert any(event.text == "not lost" for event in walk.journal.pending(0, 1000))


@pytest.mark.parametrize("claimed", [MAX_AGREED_SEQUENCE + 1, 1 << 53])
def test_a_console_that_claims_events_beyond_all_numbers_is_not_believed(tmp_path: Path, claimed: int) -> None:
    journal = EventJournal(tmp_path / "events.sqlite")
    journal.append(0.0, "cue", "first")
    journal.flush()
    with pytest.raises(WireError, match="no device can have told"):
        journal.agree(claimed)
    # One that claims as much as is believed leaves room; and it is believed again.
    for _ in range(2):
        journal.agree(MAX_AGREED_SEQUENCE)
        journal.append(0.0, "cue", "next")
        journal.flush()
    events = journal.pending(0)
    assert [event.text for event in events] == ["first", "next", "next"]
    assert all(wire.decode_from_device(wire.encode(event)) == event for event in events)
    journal.agree(events[-1].sequence)
    journal.agree(events[-1].sequence)
    journal.close()

"""The alerts of real devices on a real hub, kept in a real database, over restarts of the console."""

from __future__ import annotations

import io
import json
import threading
import zipfile
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import pytest
from console_room import PICTURE, DialledDevice, Person, hello_of, invited, until
from device_hall import Rig
from sqlalchemy import text
from sqlalchemy.exc import OperationalError

from console.alerts.alert_store import AlertStore
from console.alerts.alerts import Alerts
from console.alerts.incidents import AFTER_S, BEFORE_S, Cause, Incidents
from console.alerts.lifecycle import Change, Phase
from console.alerts.message_ring import KEPT_S, MAX_RING_BYTES, MessageRing
from console.alerts.rules import RULES, Priority
from console.errors import ConflictError, NoRoomError, NotFoundError
from console.hub import DeviceHub
from console.incident_timeline import incident_timeline
from console.message_log import WireRecord
from console.server import ConsoleServer
from console.store import Store
from console.timeline_view import instants_view
from device_agent.ports import Button, PressKind
from navcore.modes import Mode
from navcore.wire import (
    ConsoleMessage,
    DepthImage,
    DeviceMessage,
    Event,
    Hello,
    Pong,
    RouteChanged,
    SettingsRunning,
    WalkerState,
    encode,
)

DEADLINE_S = 10.0


class NoOutlet:
    def send(self, message: ConsoleMessage) -> None: ...

    def close(self, code: int, reason: str) -> None: ...


class Room:
    """A console without a network: hub, database, alerts and incidents on one clock, which can be started anew."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.now_s, self.free_bytes = folder, 1000.0, 100 << 30
        self.open()

    def open(self) -> None:
        self.store = Store.open(self.folder, lambda: self.now_s + 1e9)
        self.hub = DeviceHub(lambda: self.now_s, self.store.wall_s)
        self.incidents = Incidents(
            self.folder / "incidents", self.hub, self.store.wall_s, lambda _: self.free_bytes
        )  # fmt: skip
        self.alerts = Alerts(self.hub, AlertStore(self.store), self.incidents)

    def restart(self, away_s: float = 1.0) -> None:
        """Let the console die and come back."""
        self.store.close()
        self.now_s += away_s
        self.open()

    def call(self, name: str = "glasses") -> None:
        self.hub.connect(Hello(6, name, "0.1.0", "small", "m", 1, 0, self.now_s), name.title(), NoOutlet())
        self.send(Pong(self.now_s, self.now_s, self.now_s), name)

    def send(self, message: DeviceMessage, name: str = "glasses") -> None:
        self.hub.receive(name, message)
        self.incidents.heard(name, type(message), encode(message))

    def state(self, name: str = "glasses", **changes: Any) -> None:
        values: dict[str, Any] = {
            "stamp_s": self.now_s, "quality": "localized", "action": "walk", "reason": "ok", "mode": Mode.GUIDING,
            "sonar_state": "no_echo", "destination_id": "b", "speed_m_s": 0.8, "deviation_m": 0.1,
        }  # fmt: skip
        self.send(WalkerState(**(values | changes)), name)

    def walk(self, length_s: float, name: str = "glasses", **changes: Any) -> None:
        """Let time pass; twice a second the device tells its state, and the alerts are looked at."""
        for _ in range(int(2 * length_s)):
            self.now_s += 0.5
            self.state(name, **changes)
            self.look()

    def wait(self, length_s: float) -> None:
        """Let time pass in which nothing is heard."""
        for _ in range(int(2 * length_s)):
            self.now_s += 0.5
            self.look()

    def look(self) -> None:
        """Let the timers do their work once."""
        self.alerts.check()
        self.alerts.write()
        self.incidents.write()

    def standing(self) -> list[tuple[str, Phase]]:
        return [(alert.record.kind, alert.phase) for alert in self.alerts.active()]

    def only_id(self) -> str:
        (alert,) = self.alerts.active()
        return alert.record.alert_id


@pytest.fixture
def room(tmp_path: Path) -> Iterator[Room]:
    room = Room(tmp_path)
    room.call()
    yield room
    room.store.close()


FAULT = {"mode": Mode.FAULT, "action": "stop", "reason": "sensor_stale"}
NO_WAY = {"action": "stop", "reason": "no_candidate"}


def test_silence_while_somebody_is_led_is_an_alert_and_silence_of_a_device_at_rest_is_none(room: Room) -> None:
    room.walk(1.0, mode=Mode.READY, destination_id=None)
    room.wait(60.0)
    assert room.standing() == []
    room.walk(1.0)
    room.wait(4.5)
    assert room.standing() == []
    room.wait(1.0)
    assert room.standing() == [("link_lost", Phase.UNACKNOWLEDGED)]
    room.walk(2.5)
    assert room.standing() == [("link_lost", Phase.UNACKNOWLEDGED)]
    room.walk(2.0)
    assert room.standing() == [("link_lost", Phase.RETURNED)], "it stays until somebody has seen it"
    room.alerts.acknowledge(room.only_id(), "Ada")
    assert room.standing() == []


def test_what_stood_before_the_silence_is_not_ended_by_it(room: Room) -> None:
    room.walk(11.0, **NO_WAY)
    room.wait(60.0)
    assert room.standing()[0] == ("link_lost", Phase.UNACKNOWLEDGED)
    assert ("no_way", Phase.UNACKNOWLEDGED) in room.standing()
    room.hub.disconnect("glasses", room.hub.require_connected("glasses"))
    room.call()
    room.alerts.check()
    assert ("no_way", Phase.UNACKNOWLEDGED) in room.standing(), "a device that has joined again has said nothing yet"


def test_a_flood_does_not_bury_the_worst(room: Room) -> None:
    for number in range(40):
        room.call(f"device-{number}")
    for _ in range(40):
        room.now_s += 0.5
        room.state(**FAULT)
        for number in range(40):
            room.state(f"device-{number}", **NO_WAY)
        room.alerts.check()
    first, second = room.alerts.active()[:2]
    assert (first.record.kind, first.record.device_name) == ("device_fault", "Glasses")
    assert len(room.alerts.active()) == 41
    room.alerts.acknowledge(second.record.alert_id, "Ada")
    assert room.alerts.active()[-1].record == replace(
        second.record, acknowledged_at_s=room.now_s + 1e9, acknowledged_by="Ada"
    ), "what somebody has seen comes after what nobody has"


def test_a_console_that_is_started_anew_has_forgotten_nothing(room: Room) -> None:
    room.walk(11.0, **NO_WAY)
    room.walk(3.0, **FAULT)
    fault, no_way = (alert.record.alert_id for alert in room.alerts.active())
    room.alerts.acknowledge(fault, "Ada", "I am calling her.")
    room.alerts.shelve(no_way, 5, "Bea", "The door is being painted.")
    before = {alert.record.alert_id: alert for alert in room.alerts.active()}
    room.restart(60.0)
    after = {alert.record.alert_id: alert for alert in room.alerts.active()}
    assert {key: each.record for key, each in after.items()} == {key: each.record for key, each in before.items()}
    assert [each.phase for each in after.values()] == [Phase.ACKNOWLEDGED, Phase.SHELVED]
    room.wait(1.0)
    assert len(room.alerts.active()) == 2, "what is not known ends nothing"
    room.wait(5.0)
    assert ("link_lost", Phase.UNACKNOWLEDGED) in room.standing(), "somebody was being led, and does not come back"
    room.wait(240.0)
    assert ("no_way", Phase.RETURNED) in room.standing(), "its five minutes are up, and nobody has acknowledged it"
    steps = AlertStore(room.store).steps([no_way])
    assert [step.what for step in steps] == [Change.RAISED, Change.RETURNED, Change.SHELVED, Change.SHELF_ENDED]
    assert (steps[2].who, steps[2].detail) == ("Bea", "5 min: The door is being painted.")


def test_a_device_that_leads_nobody_when_the_console_ends_is_not_missed(room: Room) -> None:
    room.walk(1.0)
    room.walk(1.0, mode=Mode.ARRIVED)
    room.restart()
    room.wait(60.0)
    assert room.standing() == []


def test_what_cannot_be_written_is_shown_all_the_same_and_written_later(room: Room) -> None:
    def write(statement: str) -> None:
        with room.store.writing() as session:
            session.execute(text(statement))

    write("ALTER TABLE alerts RENAME TO gone")
    room.walk(11.0, **NO_WAY)
    assert room.standing() == [("no_way", Phase.UNACKNOWLEDGED)]
    alert_id = room.only_id()
    with pytest.raises(OperationalError):
        room.alerts.acknowledge(alert_id, "Ada")
    assert room.standing() == [("no_way", Phase.UNACKNOWLEDGED)], "what is answered is written"
    write("ALTER TABLE gone RENAME TO alerts")
    room.alerts.acknowledge(alert_id, "Ada")
    room.restart()
    assert room.standing() == [("no_way", Phase.ACKNOWLEDGED)]
    assert [step.what for step in AlertStore(room.store).steps([alert_id])] == [Change.RAISED, Change.ACKNOWLEDGED]


def test_only_what_is_open_can_be_acknowledged_and_only_once(room: Room) -> None:
    room.walk(11.0, **NO_WAY)
    alert_id = room.only_id()
    with pytest.raises(ConflictError, match="not shelved"):
        room.alerts.unshelve(alert_id, "Ada")
    with pytest.raises(ConflictError, match="5, 10 or 15"):
        room.alerts.shelve(alert_id, 60, "Ada", "no")
    room.alerts.acknowledge(alert_id, "Ada")
    with pytest.raises(ConflictError, match="Ada has acknowledged"):
        room.alerts.acknowledge(alert_id, "Bea")
    room.walk(3.0)
    with pytest.raises(NotFoundError):
        room.alerts.acknowledge(alert_id, "Bea")
    store = AlertStore(room.store)
    assert store.delete_before(room.now_s + 1e9 - 60.0) == 0
    assert store.delete_before(room.now_s + 1e9 + 60.0) == 1
    assert store.recent(None, 10) == []
    assert store.steps([alert_id]) == []


def test_what_goes_up_to_the_highest_priority_gets_an_incident(room: Room) -> None:
    room.walk(131.0, **NO_WAY)
    (alert,) = room.alerts.active()
    assert alert.record.priority is Priority.HIGH
    assert room.incidents.named(alert.record.incident_id).causes[0].kind == "no_way"


class Busy:
    """The database while somebody else writes to it, for as long as this is entered."""

    def __init__(self, room: Room) -> None:
        self._store = room.store
        self._begun, self._ends = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._write, daemon=True)

    def __enter__(self) -> None:
        self._thread.start()
        assert self._begun.wait(DEADLINE_S)

    def __exit__(self, *_: object) -> None:
        self._ends.set()
        self._thread.join(DEADLINE_S)

    def _write(self) -> None:
        with self._store.writing():
            self._begun.set()
            self._ends.wait(DEADLINE_S)


def in_thread(work: Callable[[], object]) -> threading.Thread:
    thread = threading.Thread(target=work, daemon=True)
    thread.start()
    return thread


def test_nothing_that_is_new_waits_for_the_disk_to_be_shown(room: Room) -> None:
    with Busy(room):

        def fail() -> None:
            for _ in range(6):
                room.now_s += 0.5
                room.state(**FAULT)
                room.alerts.check()

        looking = in_thread(fail)
        looking.join(DEADLINE_S)
        assert not looking.is_alive(), "it waits for the disk"
        assert room.standing() == [("device_fault", Phase.UNACKNOWLEDGED)]
    room.look()
    assert room.alerts.active()[0].record.incident_id
    room.restart()
    assert room.standing() == [("device_fault", Phase.UNACKNOWLEDGED)]


def test_what_the_device_does_while_somebody_waits_for_the_disk_is_not_lost(room: Room) -> None:
    room.walk(11.0, **NO_WAY)
    alert_id = room.only_id()
    with Busy(room):
        acknowledging = in_thread(lambda: room.alerts.acknowledge(alert_id, "Ada"))

        def go_on() -> None:
            for _ in range(6):
                room.now_s += 0.5
                room.state()
                room.alerts.check()

        going_on = in_thread(go_on)
        going_on.join(DEADLINE_S)
        assert not going_on.is_alive()
        assert room.standing() == [("no_way", Phase.RETURNED)]
        assert acknowledging.is_alive(), "what is answered is written"
    acknowledging.join(DEADLINE_S)
    assert room.standing() == []
    room.alerts.write()
    steps = {step.what for step in AlertStore(room.store).steps([alert_id])}
    assert steps == {Change.RAISED, Change.RETURNED, Change.ACKNOWLEDGED, Change.CLOSED}
    room.restart()
    assert room.standing() == []


def test_that_somebody_is_led_is_written_as_soon_as_it_can_be(room: Room) -> None:
    def rename(before: str, after: str) -> None:
        with room.store.writing() as session:
            session.execute(text(f"ALTER TABLE {before} RENAME TO {after}"))

    rename("devices_leading", "gone")
    room.walk(2.0)
    rename("gone", "devices_leading")
    room.walk(1.0)
    room.restart(60.0)
    room.wait(6.0)
    assert room.standing() == [("link_lost", Phase.UNACKNOWLEDGED)]
    assert "Nothing new from Glasses for 6" in room.alerts.active()[0].record.sentence, "more than a minute"


AT_REST = {"mode": Mode.LOCALIZING, "destination_id": None, "action": "stop", "reason": "no_route"}


def begin_anew(room: Room) -> None:
    """Let the device start anew, within two seconds, as after a crash."""
    room.hub.disconnect("glasses", room.hub.require_connected("glasses"))
    room.now_s += 2.0
    room.call()


def test_a_device_that_starts_anew_on_the_way_is_an_alert_until_somebody_has_seen_it(room: Room) -> None:
    room.send(Event(1, room.now_s, "arrived", "Arrived at Bar."))
    room.walk(5.0)
    begin_anew(room)
    room.walk(5.0, **AT_REST)
    assert room.standing() == [("broke_off", Phase.UNACKNOWLEDGED)]
    assert room.alerts.active()[0].record.priority is Priority.HIGH
    room.restart()
    room.wait(60.0)
    assert room.standing() == [("broke_off", Phase.UNACKNOWLEDGED)]
    room.call()
    room.alerts.acknowledge(room.only_id(), "Ada")
    room.walk(2.0, **AT_REST)
    assert room.standing() == []


def test_whoever_is_led_again_is_not_missed_but_what_was_is_told(room: Room) -> None:
    room.walk(5.0)
    begin_anew(room)
    room.walk(5.0, **AT_REST)
    room.walk(2.0)
    assert room.standing() == [("broke_off", Phase.RETURNED)]


def pressed_stop() -> str:
    """What a real device tells of a walker who ends guidance."""
    rig = Rig()
    rig.lead_to()
    rig.press(Button.MAIN, PressKind.LONG)
    return rig.events("button")[-1]


@pytest.mark.parametrize("how", ["arrived", "seen to arrive", "no way", "the walker", "the console", "told later"])
def test_guidance_that_ends_as_it_is_meant_to_is_no_alert(room: Room, how: str) -> None:
    room.walk(5.0)
    match how:
        case "arrived":
            room.send(Event(1, room.now_s, "arrived", "Arrived at Bar."))
        case "seen to arrive":
            room.walk(1.0, mode=Mode.ARRIVED, action="stop", reason="arrived")
        case "no way":
            room.send(Event(1, room.now_s, "route_refused", "No way leads there."))
        case "the walker":
            room.send(Event(1, room.now_s, "button", pressed_stop()))
        case "the console":
            room.hub.clear("glasses", "Ada")
        case "told later":
            room.walk(2.0, **AT_REST)
            room.send(Event(1, room.now_s, "arrived", "Arrived at Bar."))
    room.walk(10.0, **AT_REST)
    assert room.standing() == []


def test_an_order_that_the_device_never_got_ends_no_guidance(room: Room) -> None:
    room.hub.clear("glasses", "Ada")
    room.walk(5.0)
    begin_anew(room)
    room.walk(5.0, **AT_REST)
    assert room.standing() == [("broke_off", Phase.UNACKNOWLEDGED)]


def test_a_lost_device_is_one_alert_over_restarts_until_somebody_ends_the_watch(room: Room) -> None:
    room.walk(10.0)
    with pytest.raises(ConflictError, match="is connected"):
        room.alerts.end_watch("glasses", "Ada", "She is at home.")
    room.wait(10.0)
    alert_id = room.only_id()
    room.alerts.acknowledge(alert_id, "Ada")
    for _ in range(2):
        room.restart(60.0)
        room.wait(20.0)
        assert room.standing() == [("link_lost", Phase.ACKNOWLEDGED)]
    assert [step.what for step in AlertStore(room.store).steps([alert_id])] == [Change.RAISED, Change.ACKNOWLEDGED]
    room.alerts.end_watch("glasses", "Ada", "She is at home.")
    assert room.store.latest_audit(1)[0].detail == "Glasses She is at home."
    room.wait(5.0)
    assert room.standing() == []
    room.restart()
    room.wait(60.0)
    assert room.standing() == []
    room.call()
    room.walk(1.0)
    room.wait(6.0)
    assert room.standing() == [("link_lost", Phase.UNACKNOWLEDGED)], "whoever comes back is watched again"


def test_what_is_heard_of_a_device_that_may_call_no_more_leads_nobody(room: Room) -> None:
    room.walk(10.0)
    room.alerts.forget("glasses")
    room.state()
    room.wait(60.0)
    assert room.standing() == []


# ------------------------------------------------------------------------------------------------------- incidents
def test_an_incident_holds_half_a_minute_on_either_side_and_what_was_true_before(room: Room) -> None:
    room.send(RouteChanged(room.now_s, ((0.0, 0.0), (6.0, 0.0)), (("Bar", 6.0),), "b"))
    room.send(SettingsRunning(7, {"gate.clearance_m": 2.0}))
    room.walk(60.0)
    room.walk(3.0, **FAULT)
    room.send(DepthImage(room.now_s, b"jpeg"))
    incident_id = room.alerts.active()[0].record.incident_id
    cause_s = room.incidents.named(incident_id).causes[0].at_s - 1e9
    room.walk(AFTER_S + 5.0)
    incident = room.incidents.named(incident_id)
    assert incident.state == "complete"
    messages = list(room.incidents.messages(incident_id))
    assert incident.message_count == len(messages)
    assert [type(each.message) for each in messages[:3]] == [Hello, RouteChanged, SettingsRunning]
    times_s = [each.arrival_s for each in messages if isinstance(each.message, WalkerState)]
    assert min(times_s) == pytest.approx(cause_s - BEFORE_S)
    assert max(times_s) == pytest.approx(cause_s + AFTER_S)
    timeline = incident_timeline(incident, messages)
    assert timeline.ended_s - timeline.began_s == pytest.approx(BEFORE_S + AFTER_S)
    assert (timeline.troubles, timeline.depth_jpeg(timeline.ended_s)) == ((), b"jpeg")
    (alert,) = (mark for mark in timeline.marks() if mark.kind == "alert")
    assert (alert.at_s, alert.text) == (pytest.approx(BEFORE_S), incident.causes[0].sentence)
    shown = instants_view(timeline, 0.0, BEFORE_S + AFTER_S, 1.0)
    assert {each["view"]["route"]["destination_id"] for each in shown} == {"b"}
    assert {each["view"]["freshness"] for each in shown} == {"live"}
    modes = [each["view"]["state"]["mode"] for each in shown]
    assert (modes[0], modes[int(BEFORE_S)]) == (Mode.GUIDING, Mode.FAULT)
    assert (shown[0]["depth_at_s"], shown[-1]["depth_at_s"]) == (None, pytest.approx(BEFORE_S, abs=1.0))


def test_silence_is_part_of_an_incident_and_what_is_damaged_is_shown_up_to_there(room: Room) -> None:
    room.walk(40.0)
    room.wait(AFTER_S + 20.0)
    (incident,) = room.incidents.all()
    timeline = incident_timeline(incident, room.incidents.messages(incident.incident_id))
    length_s = timeline.ended_s - timeline.began_s
    assert length_s == pytest.approx(BEFORE_S + AFTER_S)
    first, last = instants_view(timeline, 0.0, length_s, length_s)
    assert (first["view"]["freshness"], last["view"]["freshness"]) == ("live", "lost"), "as it looked then"
    assert last["view"]["age_s"] > AFTER_S
    file = room.incidents.messages_file(incident.incident_id)
    whole = file.read_bytes()
    file.write_bytes(whole[: len(whole) // 2] + b"?" + whole[len(whole) // 2 + 1 :])
    half = incident_timeline(incident, room.incidents.messages(incident.incident_id))
    assert 0 < len(half.stamps_s) < len(timeline.stamps_s)
    assert any("is damaged at byte" in trouble for trouble in half.troubles)
    file.write_bytes(whole[:20])
    with pytest.raises(NotFoundError, match="nothing to play"):
        incident_timeline(incident, room.incidents.messages(incident.incident_id))


def test_what_happens_meanwhile_belongs_to_the_same_incident(room: Room) -> None:
    room.walk(3.0, **FAULT)
    first = room.incidents.all()[0]
    room.walk(20.0, **FAULT)
    again = room.incidents.keep("glasses", Cause(room.now_s, "asked", "Somebody has asked for it.", who="Ada"))
    assert again == first.incident_id
    assert len(room.incidents.all()) == 1
    assert room.incidents.named(again).ends_at_s == pytest.approx(first.ends_at_s + 20.5, abs=1.0)
    with pytest.raises(ConflictError, match="still being kept"):
        room.incidents.delete(again)
    room.walk(AFTER_S + 1.0, **FAULT)
    assert room.incidents.named(again).state == "complete"
    assert room.incidents.delete_before(room.now_s + 1e9 - 60.0) == 0
    assert room.incidents.delete_before(room.now_s + 1e9 + 60.0) == 1
    assert list((room.folder / "incidents").iterdir()) == []


def test_a_second_fall_gets_an_incident_of_its_own(room: Room) -> None:
    room.walk(3.0, **FAULT)
    first = room.alerts.active()[0].record.incident_id
    room.walk(600.0)
    room.walk(3.0, **FAULT)
    (alert,) = room.alerts.active()
    assert alert.record.times == 2
    assert {each.incident_id for each in room.incidents.all()} == {first, alert.record.incident_id}
    assert len(room.incidents.all()) == 2


def test_an_incident_that_could_not_be_kept_is_kept_as_soon_as_there_is_room(room: Room) -> None:
    room.free_bytes = 1
    room.walk(4.0, **FAULT)
    room.free_bytes = 100 << 30
    room.walk(6.0, **FAULT)
    (alert,) = room.alerts.active()
    assert room.incidents.named(alert.record.incident_id).causes[0].alert_id == alert.record.alert_id


def test_without_room_the_alert_is_raised_all_the_same(room: Room) -> None:
    room.free_bytes = 1
    room.walk(3.0, **FAULT)
    assert room.standing() == [("device_fault", Phase.UNACKNOWLEDGED)]
    assert room.alerts.active()[0].record.incident_id == ""
    with pytest.raises(NoRoomError):
        room.incidents.keep("glasses", Cause(0.0, "asked", "x"))


def test_a_ring_is_bounded_and_keeps_what_lasts() -> None:
    ring = MessageRing()
    ring.add(RouteChanged, WireRecord(0.0, 0.0, b"old"))
    ring.add(RouteChanged, WireRecord(1.0, 0.0, b"route"))
    ring.add(Pong, WireRecord(1.0, 0.0, b"no part of an incident"))
    for number in range(2000):
        ring.add(WalkerState, WireRecord(2.0 + 0.1 * number, 0.0, bytes(64 << 10)))
        assert ring.size_bytes <= MAX_RING_BYTES
    small = MessageRing()
    for number in range(2000):
        small.add(Event, WireRecord(0.1 * number, 0.0, b"state"))
    held, _ = small.since(0)
    assert held[-1].arrival_s - held[0].arrival_s == pytest.approx(KEPT_S, abs=0.2)
    assert ring.from_time(0.0)[0][0].data == b"route"


# ---------------------------------------------------------------------------------------------- over the real server
QUICK = MappingProxyType({kind: replace(rule, on_delay_s=0.0) for kind, rule in RULES.items()})


@pytest.fixture
def device(server: ConsoleServer, admin: Person) -> Iterator[DialledDevice]:
    token = server.services.devices.create_token("Lead glasses", "test")
    device = DialledDevice(server.ready.url, token, hello_of(server, now_s=server.services.hub.now_s()))
    yield device
    device.socket.close()


def test_a_device_whose_token_is_void_is_missed_no_more(
    server: ConsoleServer, admin: Person, device: DialledDevice
) -> None:
    services = server.services
    device.send(
        WalkerState(
            services.hub.now_s(),
            "localized",
            "walk",
            "ok",
            mode=Mode.GUIDING,
            destination_id="b",
            sonar_state="no_echo",
        )
    )
    until(services.hub, lambda known: known.state is not None)
    services.alerts.check()
    services.alerts.write()
    assert [each.device_id for each in services.alert_store.leading()] == ["glasses"]
    viewer = invited(admin, "Vera", "viewer")
    assert viewer.http.post("/api/devices/glasses/end_watch", json={"why": "x"}).status_code == 403
    assert admin.http.post("/api/devices/glasses/end_watch", json={"why": "x"}).status_code == 409
    admin.http.post("/api/tokens/revoke", json={"name": "Lead glasses"}).raise_for_status()
    services.alerts.check()
    services.alerts.write()
    with services.store.reading() as session:
        assert session.scalars(text("SELECT device_id FROM devices_leading")).all() == []


def next_of(stream: Any) -> dict[str, Any]:
    data: dict[str, Any] = json.loads(stream.recv(timeout=20))
    return data


def alerts_in(data: dict[str, Any]) -> list[dict[str, Any]]:
    """Return what a message tells of the alerts of the glasses; nothing where they are as they were."""
    told: dict[str, Any] = data.get("parts", {}).get("glasses", {}).get("alerts", {})
    return told.get("value", [])


def test_people_see_acknowledge_and_shelve_alerts_together(server: ConsoleServer, device: DialledDevice) -> None:
    services = server.services
    services.alerts.rules = QUICK
    admin = first_admin_again(server)
    viewer = invited(admin, "Vera", "viewer")
    with admin.live() as hers, viewer.live() as his:

        def both(is_so: Any) -> None:
            for stream in (hers, his):
                while not is_so(next_of(stream)):
                    pass

        old_s = services.hub.now_s() - 1.0
        device.send(WalkerState(old_s, "lost", "stop", "sensor_stale", mode=Mode.FAULT, destination_id="b"))
        until(services.hub, lambda known: known.state is not None)
        both(lambda data: any(each["kind"] == "device_fault" for each in alerts_in(data)))
        alert = next(each for each in services.alerts.views() if each["kind"] == "device_fault")
        path = f"/api/alerts/{alert['id']}"
        viewer.http.post(f"{path}/acknowledge", json={"note": "Calling."}).raise_for_status()
        both(lambda data: "Vera" in [each["acknowledged_by"] for each in alerts_in(data)])
        assert viewer.http.post(f"{path}/acknowledge").status_code == 409
        assert viewer.http.post(f"{path}/shelve", json={"minutes": 7, "reason": "x"}).status_code == 400
        viewer.http.post(f"{path}/shelve", json={"minutes": 5, "reason": "We know."}).raise_for_status()
        both(lambda data: "shelved" in [each["phase"] for each in alerts_in(data)])
        admin.http.post(f"{path}/unshelve").raise_for_status()
        both(lambda data: data["alerts"]["unacknowledged"] == data["alerts"]["total"])
    recent = viewer.http.get("/api/alerts", params={"device": "glasses"}).json()["recent"]
    row = next(each for each in recent if each["kind"] == "device_fault")
    assert [step["what"] for step in row["steps"]] == ["raised", "acknowledged", "shelved", "unshelved"]
    assert (row["acknowledged_by"], row["note"]) == ("Vera", "Calling.")
    assert row["acknowledged_after_s"] >= 0.0
    others = viewer.http.get("/api/alerts", params={"device": "another"}).json()
    assert (others["active"], others["recent"]) == ([], [])
    assert {"alert_acknowledged", "alert_shelved"} <= {deed.action for deed in services.store.latest_audit(20)}


def test_an_incident_is_asked_for_downloaded_and_deleted_by_an_admin_alone(
    server: ConsoleServer, device: DialledDevice
) -> None:
    admin = first_admin_again(server)
    viewer = invited(admin, "Vera", "viewer")
    hub = server.services.hub
    device.send(WalkerState(hub.now_s(), "localized", "stop", "no_route", mode=Mode.READY))
    device.send(DepthImage(hub.now_s(), PICTURE))
    until(hub, lambda known: known.depth_image is not None)
    incident_id = viewer.http.post("/api/devices/glasses/keep").raise_for_status().json()["incident_id"]
    server.services.incidents.close()
    (listed,) = viewer.http.get("/api/incidents").json()["incidents"]
    assert (listed["incident_id"], listed["causes"][0]["who"]) == (incident_id, "Vera")
    played = viewer.http.get(f"/api/incidents/{incident_id}").raise_for_status().json()
    assert (played["summary"]["device"], played["summary"]["has_pictures"]) == (listed["device_name"], True)
    query = {"from": played["length_s"], "to": played["length_s"]}
    (shown,) = viewer.http.get(f"/api/incidents/{incident_id}/instants", params=query).json()["instants"]
    assert shown["view"]["state"]["mode"] == "ready"
    at = {"at": shown["depth_at_s"]}
    assert viewer.http.get(f"/api/incidents/{incident_id}/depth.jpg", params=at).content == PICTURE
    looked = server.services.access.latest(10)
    assert ("Vera", "incident", incident_id) in [(each.who, each.what, each.detail) for each in looked]
    whole = viewer.http.get(f"/api/incidents/{incident_id}/bundle.zip").raise_for_status()
    with zipfile.ZipFile(io.BytesIO(whole.content)) as archive:
        assert archive.testzip() is None
        lines = [json.loads(line) for line in archive.read("messages.jsonl").splitlines()]
        assert [line["message"]["type"] for line in lines] == ["hello", "state", "depth_image"]
        assert archive.read(lines[2]["message"]["jpeg"]) == PICTURE
        assert json.loads(archive.read("manifest.json"))["versions"]["software"] == "0.1.0"
    assert viewer.http.delete(f"/api/incidents/{incident_id}").status_code == 403
    admin.http.delete(f"/api/incidents/{incident_id}").raise_for_status()
    assert viewer.http.get(f"/api/incidents/{incident_id}").status_code == 404
    assert viewer.http.get("/api/incidents/%2e%2e").status_code == 404
    for name in ("", "..", "../..", "0" * 15, "../incidents/" + incident_id):
        with pytest.raises(NotFoundError):
            server.services.incidents.named(name)


def first_admin_again(server: ConsoleServer) -> Person:
    person = Person(server.ready.url)
    person.sign_in("Ada").raise_for_status()
    return person

"""Who watches is told and written down, colour is kept nowhere, and what is too old is really gone."""

from __future__ import annotations

import contextlib
import errno
import hashlib
import json
import os
import sqlite3
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from console_room import PICTURE, WAIT_S, DialledDevice, Person, hello_of, invited, until
from device_hall import Rig
from sqlalchemy import event
from test_alerts_engine import Room
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection

from console.access import AccessLog
from console.alerts import incidents
from console.alerts.incidents import Cause
from console.device_store import DeviceStore
from console.errors import NoRoomError
from console.live import LiveDevice
from console.recordings import Recordings
from console.retention import DEFAULT_DAYS, Retention, UndeletedError
from console.server import ConsoleServer
from console.store import DATABASE_FILE, Store
from console.watching import AWAY_S, GRACE_S, SAYS_AT_LEAST_EVERY_S, Watching
from device_agent.adapters.clocks import SteppedClock
from device_agent.journal import EventJournal
from device_agent.link import ConsoleLink
from device_agent.link_settings import LinkSettings
from device_agent.ports import Button, PressKind
from navcore.recording_upload import RecordingOffer
from navcore.wire import (
    Accesses,
    AskColour,
    ColourImage,
    DepthImage,
    Event,
    EventConfirmed,
    SharingRunning,
    WalkerState,
    Watchers,
)

DAY_S = 86_400.0
NOW_S = 1_764_417_600.0


class Hands:
    """Clocks that a test moves, and devices that remember what they are told."""

    def __init__(self, folder: Path) -> None:
        self.now_s, self.wall_s = 1000.0, NOW_S
        self.connected: tuple[str, ...] = ("glasses", "spare")
        self.told: list[tuple[str, tuple[str, ...]]] = []
        self.store = Store.open(folder, lambda: self.wall_s)
        self.access = AccessLog(self.store, lambda _: 3600.0)
        self.watching = Watching(lambda: self.now_s, self.access, self)

    def connected_ids(self) -> tuple[str, ...]:
        return self.connected

    def set_watchers(self, device_id: str, names: tuple[str, ...]) -> None:
        if names != dict(self.told).get(device_id, ()):
            self.told.append((device_id, names))

    def pass_s(self, seconds: float) -> None:
        self.now_s += seconds
        self.wall_s += seconds
        self.watching.look()


@pytest.fixture
def hands(tmp_path: Path) -> Iterator[Hands]:
    made = Hands(tmp_path)
    yield made
    made.store.close()


# ----------------------------------------------------------------------------------------------------- who watches
def test_a_page_that_is_loaded_anew_says_nothing_and_one_that_is_gone_does(hands: Hands) -> None:
    hands.watching.opened("page", "Anna", says=True)
    hands.watching.look()
    assert hands.told == [], "a page that shows no device watches nobody"
    hands.watching.shows("page", frozenset({"glasses"}))
    hands.watching.look()
    hands.watching.closed("page")
    hands.pass_s(GRACE_S - 1.0)
    hands.watching.opened("page again", "Anna", says=True)
    hands.watching.shows("page again", frozenset({"glasses"}))
    hands.pass_s(1.0)
    assert hands.told == [("glasses", ("Anna",))]
    hands.watching.closed("page again")
    hands.pass_s(GRACE_S + 0.1)
    assert hands.told == [("glasses", ("Anna",)), ("glasses", ())]
    (entry,) = hands.access.latest(10)
    assert (entry.who, entry.what, entry.device_id) == ("Anna", "watch", "glasses")
    assert entry.ended_at_s - entry.began_at_s == pytest.approx(2.0 * GRACE_S + 0.1)


def test_a_page_that_says_no_more_shows_nothing_and_is_sent_nothing(hands: Hands) -> None:
    hands.watching.opened("page", "Anna", says=True)
    hands.watching.shows("page", frozenset({"glasses"}))
    assert not hands.watching.sees("page", "glasses"), "the walker has not been told yet"
    hands.watching.look()
    assert hands.watching.sees("page", "glasses")
    assert not hands.watching.sees("page", "spare")
    hands.pass_s(SAYS_AT_LEAST_EVERY_S + 0.1)
    assert not hands.watching.sees("page", "glasses")


def test_what_never_says_what_it_shows_counts_as_watching_everything(hands: Hands) -> None:
    hands.watching.opened("program", "Ben", says=False)
    hands.pass_s(100.0)
    assert dict(hands.told) == {"glasses": ("Ben",), "spare": ("Ben",)}


def test_whoever_still_shows_a_walker_whose_link_breaks_watches_on_but_not_for_ever(hands: Hands) -> None:
    hands.watching.opened("program", "Ben", says=False)
    hands.watching.look()
    told = list(hands.told)
    hands.connected = ("spare",)
    for _ in range(4):
        hands.pass_s(AWAY_S / 5.0)
    hands.connected = ("glasses", "spare")
    hands.pass_s(1.0)
    assert hands.told == told, "the link is back, and nothing is news"
    hands.connected = ("spare",)
    hands.pass_s(AWAY_S + 0.1)
    hands.pass_s(GRACE_S)
    assert hands.told == [*told, ("glasses", ())]


def test_a_scene_counts_only_where_its_person_has_no_page(hands: Hands) -> None:
    hands.watching.opened("scene", "Anna", says=True, counts_alone=True)
    hands.watching.shows("scene", frozenset({"glasses"}))
    assert not hands.watching.scene_sees("scene", "glasses"), "the walker has not been told yet"
    hands.watching.look()
    assert hands.watching.scene_sees("scene", "glasses")
    assert hands.told == [("glasses", ("Anna",))]
    hands.watching.opened("page", "Anna", says=True)
    assert not hands.watching.scene_sees("scene", "glasses"), "the page shows no device, so that the scene shows none"
    hands.pass_s(GRACE_S + 0.1)
    assert hands.told[-1] == ("glasses", ())


def test_the_walker_is_told_though_nothing_can_be_written_down_which_is_done_later(
    hands: Hands, tmp_path: Path
) -> None:
    """Another program holds the database; the devices hear of it all the same."""
    event.listen(hands.store._engine, "checkout", lambda found, *_: found.execute("PRAGMA busy_timeout=50"))
    other = sqlite3.connect(tmp_path / DATABASE_FILE, isolation_level=None)
    other.execute("BEGIN IMMEDIATE")
    hands.watching.opened("page", "Anna", says=False)
    hands.watching.look()
    assert dict(hands.told) == {"glasses": ("Anna",), "spare": ("Anna",)}
    assert hands.watching.sees("page", "spare")
    assert hands.access.latest(10) == []
    other.execute("ROLLBACK")
    other.close()
    hands.pass_s(1.0)
    assert {entry.device_id for entry in hands.access.latest(10)} == {"glasses", "spare"}


# ------------------------------------------------------------------------------------------------------ access log
def test_a_device_is_told_the_latest_of_its_own_and_of_what_concerns_every_one(hands: Hands) -> None:
    hands.access.note("Ben", "past_walk", "glasses", "walk 1", NOW_S - DAY_S)
    hands.access.note("Ben", "past_walk", "glasses", "walk 1", NOW_S - DAY_S)
    hands.access.note("Cem", "incident", "spare")
    hands.wall_s += 10.0
    for number in range(60):
        hands.access.note(f"P{number}", "export")
        hands.wall_s += 1.0
    told = hands.access.told_to("glasses")
    assert [entry.who for entry in told.entries] == [f"P{number}" for number in range(20, 60)]
    assert (told.now_s, told.utc_offset_s) == (hands.wall_s, 3600.0)
    about = [entry for entry in hands.access.latest(100) if entry.who == "Ben"]
    assert [entry.about_s for entry in about] == [NOW_S - DAY_S], "a page asks in pieces, and has looked once"


# ------------------------------------------------------------------------------------------------------- retention
SECRET = "the walker said that she is afraid of lifts"


def keep(recordings: Recordings, kind: str, data: bytes) -> str:
    sha256 = hashlib.sha256(data).hexdigest()
    recordings.offer(RecordingOffer(kind, "a walk", len(data), sha256), "Lead glasses")  # type: ignore[arg-type]
    recordings.add(sha256, 0, data)
    return sha256


def found_in(folder: Path, secret: str) -> list[str]:
    return [path.name for path in folder.rglob("*") if path.is_file() and secret.encode() in path.read_bytes()]


def test_what_is_too_old_is_gone_from_the_disk_and_what_is_not_stays(hands: Hands, tmp_path: Path) -> None:
    devices = DeviceStore(hands.store)
    devices.create_token("Lead glasses", "Ada")
    devices.take_in("glasses", "Lead glasses")
    recordings = Recordings(tmp_path / "recordings", lambda: hands.wall_s, lambda _: 1 << 40)
    for sequence in range(1, 200):
        devices.add_event("glasses", Event(sequence, 1.0, "cue", f"{SECRET} {sequence}"))
    hands.access.note("Anna", "past_walk", "glasses", SECRET)
    hands.store.audit("Ada", "device_set_destination", f"glasses {SECRET}")
    keep(recordings, "walk", f"old {SECRET}".encode() * 1000)
    recordings.offer(RecordingOffer("walk", SECRET, 100, "b" * 64), "Lead glasses")
    recordings.add("b" * 64, 0, SECRET.encode())
    of_the_map = keep(recordings, "recording", b"of a map walk")
    assert len(found_in(tmp_path, SECRET)) >= 3

    retention = Retention(
        hands.store,
        {
            "Walks": recordings.delete_before, "Events": devices.delete_before,
            "Access log": hands.access.delete_before, "Orders": hands.store.redact_audit_before,
        },
    )  # fmt: skip
    hands.wall_s += DEFAULT_DAYS * DAY_S - 60.0
    assert not any(retention.run().deleted.values()), "it is not old enough"
    young = keep(recordings, "walk", b"a walk of today")
    devices.add_event("glasses", Event(200, 2.0, "cue", "today"))
    hands.wall_s += 120.0
    run = retention.run()
    assert run.deleted == {"Walks": 2, "Events": 199, "Access log": 1, "Orders": 1}
    assert run.problems == ()
    assert found_in(tmp_path, SECRET) == [], "also from the database's pages and its log"
    assert {stored.entry.offer.sha256 for stored in recordings.all()} == {of_the_map, young}
    assert [event.text for event in devices.latest_events("glasses", 10)] == ["today"]
    assert any(row.detail == "glasses" for row in hands.store.latest_audit(10)), "who gave an order stays"


def test_a_device_goes_on_counting_where_all_its_events_are_deleted(hands: Hands) -> None:
    devices = DeviceStore(hands.store)
    devices.create_token("Lead glasses", "Ada")
    devices.take_in("glasses", "Lead glasses")
    for sequence in (1, 2, 3):
        devices.add_event("glasses", Event(sequence, 1.0, "cue", SECRET))
    hands.wall_s += 8 * DAY_S
    assert devices.delete_before(hands.wall_s - DAY_S) == 3
    assert devices.last_sequence("glasses") == 3
    assert devices.latest_events("glasses", 10) == ()
    assert not devices.add_event("glasses", Event(3, 1.0, "cue", SECRET)), "what comes once more is known"
    devices.add_event("glasses", Event(4, 1.0, "cue", "new"))
    assert devices.delete_before(hands.wall_s - DAY_S) == 0
    assert [event.sequence for event in devices.latest_events("glasses", 10)] == [4]


def test_a_file_that_cannot_be_deleted_is_told_and_hinders_nothing_else(hands: Hands, tmp_path: Path) -> None:
    recordings = Recordings(tmp_path / "recordings", lambda: hands.wall_s, lambda _: 1 << 40)
    stuck = recordings.named(keep(recordings, "walk", b"a walk that stays"))
    keep(recordings, "walk", b"a walk that goes")
    stuck.file.unlink()
    stuck.file.mkdir()
    (stuck.file / "in the way").touch()
    hands.access.note("Anna", "export")
    hands.wall_s += 30 * DAY_S
    retention = Retention(
        hands.store, {"Walks": recordings.delete_before, "Access log": hands.access.delete_before}
    )  # fmt: skip
    run = retention.run()
    assert run.deleted == {"Walks": 1, "Access log": 1}
    (problem,) = run.problems
    assert stuck.file.name in problem
    (stuck.file / "in the way").unlink()
    stuck.file.rmdir()
    assert retention.run().problems == (), "it is tried again"
    assert recordings.all() == ()


def test_whatever_is_wrong_with_one_kind_the_others_go_and_it_is_shown(hands: Hands) -> None:
    def torn(wall_s: float) -> int:
        raise ValueError("not a number")

    hands.access.note("Anna", "export")
    hands.wall_s += 30 * DAY_S
    retention = Retention(hands.store, {"Walks": torn, "Access log": hands.access.delete_before})
    run = retention.run()
    assert (run.deleted, run.problems) == ({"Access log": 1}, ("Walks: not a number",))
    assert retention.last_run == run


def test_what_a_reader_kept_from_being_wiped_is_wiped_at_the_next_run_also_by_another_console(
    hands: Hands, tmp_path: Path
) -> None:
    event.listen(hands.store._engine, "checkout", lambda found, *_: found.execute("PRAGMA busy_timeout=50"))
    hands.access.note("Anna", "past_walk", "glasses", SECRET)
    reader = sqlite3.connect(tmp_path / DATABASE_FILE)
    reader.execute("BEGIN")
    reader.execute("SELECT count(*) FROM sqlite_master").fetchall()
    hands.wall_s += 30 * DAY_S
    (problem,) = Retention(hands.store, {"Access log": hands.access.delete_before}).run().problems
    assert "wiped at the next run" in problem
    assert found_in(tmp_path, SECRET) != []
    reader.close()
    run = Retention(hands.store, {"Access log": hands.access.delete_before}).run()
    assert (run.deleted, run.problems) == ({"Access log": 0}, ())
    assert found_in(tmp_path, SECRET) == []


def test_what_nobody_describes_any_more_is_deleted_by_its_age_but_for_map_walks(hands: Hands, tmp_path: Path) -> None:
    recordings = Recordings(tmp_path / "recordings", lambda: hands.wall_s, lambda _: 1 << 40)
    keep(recordings, "walk", f"old {SECRET}".encode())
    of_the_map = keep(recordings, "recording", b"of a map walk")
    young = keep(recordings, "walk", b"a walk of today")
    for description in recordings.folder.glob("*.json"):
        description.write_bytes(b"{")
    for path in recordings.folder.iterdir():
        if young not in path.name:
            os.utime(path, (NOW_S, NOW_S))
        else:
            os.utime(path, (NOW_S + 10 * DAY_S, NOW_S + 10 * DAY_S))
    assert recordings.delete_before(NOW_S + DAY_S) == 1
    assert found_in(tmp_path, SECRET) == []
    left = {path.name for path in recordings.folder.iterdir()}
    assert {name for name in left if of_the_map in name or young in name} == left
    assert len(left) == 4


def test_an_incident_that_is_deleted_by_halves_or_damaged_is_deleted_at_the_next_run(tmp_path: Path) -> None:
    room = Room(tmp_path)
    room.call()
    folder = room.incidents.folder / room.incidents.keep("glasses", Cause(0.0, "asked", ""))
    room.incidents.close()
    stuck = folder / "in the way"
    stuck.mkdir()
    with pytest.raises(UndeletedError, match=folder.name):
        room.incidents.delete_before(2e9)
    assert len(room.incidents.all()) == 1, "it is still there to be seen"
    stuck.rmdir()
    (folder / "manifest.json").write_bytes(b"{")
    os.utime(folder / "manifest.json", (NOW_S, NOW_S))
    for path in (*folder.iterdir(), folder):
        os.utime(path, (NOW_S, NOW_S))
    assert room.incidents.delete_before(NOW_S - 1.0) == 0
    assert room.incidents.delete_before(NOW_S + 1.0) == 1
    assert list(room.incidents.folder.iterdir()) == []


def test_an_incident_that_could_not_be_begun_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    room = Room(tmp_path)
    room.call()

    def full(path: Path, data: bytes) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(incidents, "write_whole", full)
    with pytest.raises(NoRoomError):
        room.incidents.keep("glasses", Cause(0.0, "asked", ""))
    assert list(room.incidents.folder.iterdir()) == []


def test_a_colour_picture_is_forgotten_when_its_time_is_over_though_the_device_says_nothing(tmp_path: Path) -> None:
    room = Room(tmp_path)
    room.call()
    room.send(SharingRunning(True, False, ("Ben",), "Ben", room.now_s + 60.0))
    room.hub.receive("glasses", ColourImage(room.now_s, b"a kitchen"))
    room.hub.forget_colours()
    assert room.hub.colour_image("glasses", "Ben").jpeg == b"a kitchen"
    room.now_s += 60.1
    room.hub.forget_colours()
    assert room.hub._colours == {}
    assert room.hub.device("glasses").colour_stamp_s is None


# ------------------------------------------------------------------------------------------------- the whole of it
@pytest.fixture
def ada(admin: Person) -> Person:
    return admin


@pytest.fixture
def ben(ada: Person) -> Person:
    return invited(ada, "Ben", "viewer")


@pytest.fixture
def device(server: ConsoleServer, ada: Person) -> Iterator[DialledDevice]:
    token = ada.http.post("/api/tokens", json={"name": "Lead glasses"}).raise_for_status().json()["token"]
    dialled = DialledDevice(server.ready.url, token, hello_of(server))
    until(server.services.hub, lambda each: each.connected)
    yield dialled
    dialled.socket.close()
    until(server.services.hub, lambda each: not each.connected)


def stream_until(stream: ClientConnection, holds: str) -> dict:  # type: ignore[type-arg]
    """Read the live stream until its first device holds; ``holds`` is an expression over ``view``."""
    while True:
        view = json.loads(stream.recv(timeout=WAIT_S))["devices"][0]
        if eval(holds, {"view": view}):
            found: dict = view  # type: ignore[type-arg]
            return found


def test_a_browser_sees_the_walker_only_while_it_says_so_and_the_walker_is_told(
    server: ConsoleServer, ada: Person, device: DialledDevice
) -> None:
    assert device.next(Watchers).names == (), "told at each joining"
    device.next(Accesses)
    device.send(SharingRunning(True, False))
    device.send(WalkerState(1000.0, "lost", "stop", "pose_lost"))
    with ada.live(path="/live?says=1") as stream:
        stream_until(stream, "view['connected'] and view['mode'] and view['state'] is None")
        stream.send(json.dumps({"type": "watching", "watching": ["glasses"]}))
        assert device.next(Watchers).names == ("Ada",)
        view = stream_until(stream, "view['state'] and view['watchers']")
        assert view["watchers"] == [{"name": "Ada", "told": False}]
        device.send(SharingRunning(True, False, ("Ada",)))
        stream_until(stream, "view['watchers'] == [{'name': 'Ada', 'told': True}]")
        stream.send(json.dumps({"type": "watching", "watching": []}))
        stream_until(stream, "view['state'] is None")
    # Whoever has watched is written down a moment after they are sent it.
    server.services.watching.look()
    log = ada.http.get("/api/privacy").json()["accesses"]
    assert ("Ada", "watch", "Lead glasses") in {(each["who"], each["what"], each["device"]) for each in log}


def test_a_page_that_says_something_else_is_closed_and_nothing_else_happens(ada: Person) -> None:
    for said in (
        "",
        "[]",
        '{"type": "watching", "watching": 1}',
        '{"type": "watching", "watching": [], "x": 1}',
        "9" * 40_000,
    ):
        with ada.live(path="/live?says=1") as stream:
            stream.send(said)
            with contextlib.suppress(ConnectionClosed):
                while True:
                    stream.recv(timeout=WAIT_S)
            assert stream.protocol.close_rcvd is not None
    assert ada.http.get("/healthz").text == "ok"


def test_colour_is_seen_by_who_asked_while_it_is_allowed_and_kept_nowhere(
    server: ConsoleServer, ada: Person, ben: Person, device: DialledDevice
) -> None:
    jpeg = PICTURE + b"a colour picture of somebody's kitchen" * 20
    device.send(SharingRunning(True, False))
    device.send(ColourImage(1000.0, jpeg))
    answer = ben.http.post("/api/devices/glasses/colour", json={"why": "which  door"}).raise_for_status().json()
    asked = device.next(AskColour)
    assert (asked.who, asked.why, str(asked.request_id)) == ("Ben", "which door", answer["command"]["detail"])
    assert ben.http.get("/api/devices/glasses/colour.jpg").status_code == 404, "nobody has allowed it"
    device.send(SharingRunning(True, False, ("Ben",), "Ben", 1e6, asked.request_id))
    device.send(ColourImage(1000.5, jpeg))
    known = until(server.services.hub, lambda each: each.colour_stamp_s == 1000.5)
    assert [command.state for command in known.commands if command.kind == "ask_colour"] == ["running"]
    assert ben.http.get("/api/devices/glasses/colour.jpg").content == jpeg
    assert ada.http.get("/api/devices/glasses/colour.jpg").status_code == 404, "the walker has allowed it to Ben alone"
    assert found_in(server.services.config.data_folder, "somebody's kitchen") == []
    assert "somebody's kitchen" not in repr(known), "not with what others keep of a device"
    device.send(SharingRunning(True, False, ("Ben",), answered_id=asked.request_id))
    until(server.services.hub, lambda each: each.colour_stamp_s is None)
    assert ben.http.get("/api/devices/glasses/colour.jpg").status_code == 404
    log = ada.http.get("/api/privacy").json()["accesses"]
    assert ("Ben", "colour") in {(each["who"], each["what"]) for each in log}
    told = device.next(Accesses)
    assert ("Ben", "colour") in {(each.who, each.what) for each in told.entries}


def test_a_refusal_is_shown_and_silhouettes_that_are_not_shared_are_gone(
    server: ConsoleServer, ben: Person, device: DialledDevice
) -> None:
    device.send(SharingRunning(True, False))
    device.send(DepthImage(1000.0, PICTURE))
    until(server.services.hub, lambda each: each.depth_image is not None)
    ben.http.post("/api/devices/glasses/colour", json={}).raise_for_status()
    asked = device.next(AskColour)
    device.send(SharingRunning(False, False, answered_id=asked.request_id, refusal="The walker does not want it."))
    known = until(server.services.hub, lambda each: each.sharing is not None and not each.sharing.silhouettes)
    assert known.depth_image is None
    assert ben.http.get("/api/devices/glasses/depth.jpg").status_code == 404
    last = next(command for command in reversed(known.commands) if command.kind == "ask_colour")
    assert (last.state, last.refusal) == ("refused", "The walker does not want it.")


def test_admins_choose_how_long_things_are_kept_and_it_is_written_down(
    server: ConsoleServer, ada: Person, ben: Person
) -> None:
    assert ben.http.get("/api/privacy").json()["days"] == DEFAULT_DAYS
    for person, days, status in ((ben, 3, 403), (ada, 0, 400), (ada, 366, 400), (ada, 3, 200)):
        assert person.http.post("/api/privacy/days", json={"days": days}).status_code == status, (person, days)
    assert ben.http.post("/api/privacy/delete").status_code == 403
    assert ada.http.post("/api/privacy/delete").json()["last_run"]["problems"] == []
    assert server.services.retention.days == 3
    actions = [(row["action"], row["detail"]) for row in ada.http.get("/api/audit").json()["audit"]]
    assert ("retention", f"{DEFAULT_DAYS} → 3 days") in actions


def test_what_is_said_to_a_walker_is_not_in_the_audit_log(
    server: ConsoleServer, ada: Person, device: DialledDevice
) -> None:
    ada.http.post("/api/devices/glasses/say", json={"text": SECRET}).raise_for_status()
    device.send(Event(1, 1000.0, "cue", f"Message: {SECRET}"))
    device.next(EventConfirmed)
    rows = ada.http.get("/api/audit").json()["audit"]
    assert ("device_say", "glasses") in {(row["action"], row["detail"]) for row in rows}
    assert not any(SECRET in row["detail"] for row in rows)


def test_who_looks_at_lists_of_what_is_kept_has_looked(ada: Person, ben: Person) -> None:
    for path in ("walks", "alerts", "alerts?device=glasses", "incidents"):
        ben.http.get(f"/api/{path}").raise_for_status()
    ada.http.get("/api/what-if/walks").raise_for_status()
    log = ada.http.get("/api/privacy").json()["accesses"]
    assert {(each["who"], each["what"], each["device"], each["detail"]) for each in log} == {
        ("Ada", "past_walk", "", "the list of walks"),
        ("Ben", "past_walk", "", "the list of walks"),
        ("Ben", "incident", "", "earlier alerts"),
        ("Ben", "incident", "glasses", "earlier alerts"),
        ("Ben", "incident", "", "the list of incidents"),
    }


def test_it_is_deleted_as_the_console_starts(ada: Person) -> None:
    end_s = time.monotonic() + WAIT_S
    while ada.http.get("/api/privacy").json()["last_run"] is None:
        assert time.monotonic() < end_s, "nothing was looked through"


def test_from_a_browser_that_watches_to_the_walkers_ear_and_back(
    server: ConsoleServer, ada: Person, ben: Person, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A real console, the real link, and the real loop on fakes of the hardware."""
    # The device's clock runs many times quicker than the console's: between two pings an order would be too late.
    monkeypatch.setattr("console.hub.ORDER_HOLDS_S", 1e6)
    token = ada.http.post("/api/tokens", json={"name": "Lead glasses"}).raise_for_status().json()["token"]
    journal = EventJournal(tmp_path / "events.sqlite")
    clock = SteppedClock(100.0)
    # Once it is gone, the link stays away: what it is to the walker is looked at meanwhile.
    url = server.ready.url.replace("http", "ws")
    link = ConsoleLink(LinkSettings(url, token, tmp_path / "in", first_pause_s=WAIT_S), journal, clock)
    rig = Rig(link=link, clock=clock)
    rig.agent.state = replace(rig.agent.state, map_checksum=server.services.package.checksum)

    def walk_until(holds: Callable[[], object]) -> None:
        end_s = time.monotonic() + WAIT_S
        while not holds():
            rig.cycles(1)
            assert time.monotonic() < end_s, "it never came to be so"

    def heard(words: str) -> bool:
        return any(cue.text.startswith(words) for cue in rig.output.cues)

    def seen(question: Callable[[LiveDevice], object]) -> bool:
        return any(question(each) for each in server.services.hub.devices())

    rig.agent.announce()
    link.start(rig.agent)
    try:
        walk_until(lambda: seen(lambda each: each.connected and each.sharing))
        with ben.live(path="/live?says=1") as stream:
            stream.send(json.dumps({"type": "watching", "watching": ["glasses"]}))
            walk_until(lambda: heard("Ben is watching."))
            walk_until(lambda: seen(lambda each: each.sharing and each.sharing.told == ("Ben",)))
            ben.http.post("/api/devices/glasses/colour", json={"why": "which door"}).raise_for_status()
            walk_until(lambda: heard("Ben asks to see pictures: which door."))
            assert ben.http.get("/api/devices/glasses/colour.jpg").status_code == 404
            walk_until(lambda: (question := rig.agent.state.privacy.question) and question.heard)
            rig.press(Button.NEXT, PressKind.LONG)
            walk_until(lambda: seen(lambda each: each.colour_stamp_s is not None))
            picture = ben.http.get("/api/devices/glasses/colour.jpg").raise_for_status().content
            assert cv2.imdecode(np.frombuffer(picture, np.uint8), cv2.IMREAD_COLOR).shape == (120, 160, 3)
            rig.press(Button.PREVIOUS, PressKind.LONG)
            walk_until(lambda: seen(lambda each: each.sharing and not each.sharing.colour_for))
            assert ben.http.get("/api/devices/glasses/colour.jpg").status_code == 404
        walk_until(lambda: any("Ben" in event.text and event.kind == "privacy" for event in
                               server.services.devices.latest_events("glasses", 50)))  # fmt: skip
        server.services.device_sockets.close_all()
        walk_until(lambda: rig.agent.state.privacy.watchers is None)
        assert not heard("Nobody is watching any more."), "without a link nobody knows"
    finally:
        link.stop()
        journal.close()

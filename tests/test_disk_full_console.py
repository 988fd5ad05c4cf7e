"""A console whose disk is full, or can only be read: what was acknowledged stays, who watches goes on watching."""

from __future__ import annotations

import hashlib
import os
import sqlite3
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import pytest
from console_room import DialledDevice, Person, first_admin, hello_of, invited, serving, until
from small_disk import SmallDisk, failing_disk, small_disk
from sqlalchemy.exc import OperationalError

from console.device_link import REVOKED_CODE
from console.disk_reserve import RESERVE_BYTES
from console.recordings import Recordings
from console.server import ConsoleServer
from console.store import DATABASE_FILE, Store
from navcore.errors import InputError
from navcore.modes import Mode
from navcore.recording_upload import RecordingOffer
from navcore.site import Site, save_site
from navcore.wire import Event, EventConfirmed, Pause, WalkerState, Welcome

_MOST_LOGGED = 40


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[SmallDisk]:
    with small_disk(tmp_path / "disk") as disk:
        yield disk


@contextmanager
def console_on(disk: SmallDisk, tmp_path: Path, site: Site) -> Iterator[ConsoleServer]:
    """A console whose database is on the small disk, and its site elsewhere."""
    if not (tmp_path / "site").exists():
        save_site(site, tmp_path / "site")
    with serving(tmp_path / "site", disk.folder / "data") as server:
        yield server


def tell(server: ConsoleServer, device: DialledDevice, count: int, mode: Mode = Mode.GUIDING) -> None:
    """Let a device tell of its walker, and wait for the console to have heard of it."""
    state = WalkerState(
        server.services.hub.now_s(), "localized", "walk", "ok", mode=mode, destination_id="b", inlier_count=count
    )
    device.send(state)
    until(server.services.hub, lambda known: known.state is not None and known.state.inlier_count == count)


def assert_refused(admin: Person, status: int, words: str) -> None:
    """What people change is refused with what to do, and nothing of it is done."""
    before = admin.graph()
    for path, body in (
        ("/api/edits", {"edit": "update_poi", "poi_id": "b", "name": "Tea bar"}), ("/api/undo", None),
        ("/api/publish", {"confirmed": True, "version": before["version"]}), ("/api/versions", {"name": "A name"}),
        ("/api/users", {"name": "Vera", "role": "viewer"}), ("/api/tokens", {"name": "Another"}),
    ):  # fmt: skip
        answer = admin.http.post(path, json=body)
        assert (answer.status_code, words in answer.json()["error"]) == (status, True), (path, answer.text)
    assert admin.graph() == before


def assert_monitored(server: ConsoleServer, admin: Person, device: DialledDevice, token: str) -> DialledDevice:
    """Whoever watches a walker goes on watching, and stops them where need be; return the device, connected anew."""
    services = server.services
    device.send(Event(2, 2.0, "cue", "meanwhile"))
    device.send(Event(3, 3.0, "cue", "meanwhile, too"))
    tell(server, device, 2)
    assert until(services.hub, lambda known: bool(known.events) and known.events[-1].sequence == 3).connected
    services.alerts.check()
    services.alerts.write()
    with admin.live() as live:
        assert live.recv(timeout=20)
    admin.http.post("/api/devices/glasses/pause").raise_for_status()
    device.next(Pause)
    device.socket.close()
    device = DialledDevice(server.ready.url, token, hello_of(server, now_s=services.hub.now_s()))
    device.send(Event(2, 2.0, "cue", "meanwhile"))
    tell(server, device, 3)
    return device


def begun(server: ConsoleServer) -> tuple[Person, DialledDevice, str]:
    """An admin who has edited, and a device whose first event is stored."""
    admin, services = first_admin(server), server.services
    admin.edit("add_poi", name="Lift", kind="lift", x_m=3.0, y_m=0.0).raise_for_status()
    token = services.devices.create_token("Glasses", "test")
    device = DialledDevice(server.ready.url, token, hello_of(server, now_s=services.hub.now_s()))
    device.send(Event(1, 1.0, "cue", "before"))
    assert device.next(EventConfirmed).sequence == 1
    tell(server, device, 1)
    return admin, device, token


def id_of(server: ConsoleServer, name: str) -> int:
    return next(user.id for user in server.services.accounts.users() if user.name == name)


def long_ago_s() -> float:
    return time.time() - 30 * 86_400.0


def old_walk(folder: Path) -> Path:
    """A walk of some megabytes that came long ago; return its file."""
    recordings, data = Recordings(folder, long_ago_s, lambda _: 1 << 40), bytes(3 << 20)
    sha256 = hashlib.sha256(data).hexdigest()
    recordings.offer(RecordingOffer("walk", "a walk", len(data), sha256), "Glasses")
    for offset in range(0, len(data), 1 << 20):
        recordings.add(sha256, offset, data[offset : offset + (1 << 20)])
    return recordings.named(sha256).file


def shown_once(shown: list[int]) -> list[int]:
    """The newest event that was shown, each time that another one is."""
    return [number for number, before in zip(shown, [0, *shown], strict=False) if number != before]


def assert_whole(data: Path, events: list[tuple[int, str]]) -> None:
    with closing(sqlite3.connect(data / DATABASE_FILE)) as base:
        assert base.execute("PRAGMA integrity_check").fetchone() == ("ok",)
        assert base.execute("SELECT sequence, text FROM device_events ORDER BY id").fetchall() == events


def test_on_a_full_disk_nothing_is_lost_and_whoever_watches_goes_on(
    disk: SmallDisk, tmp_path: Path, small_site: Site, caplog: pytest.LogCaptureFixture
) -> None:
    with console_on(disk, tmp_path, small_site) as server:
        admin, device, token = begun(server)
        disk.fill()
        caplog.clear()
        assert_refused(admin, 507, "is full")
        device = assert_monitored(server, admin, device, token)
        assert len(caplog.records) < _MOST_LOGGED, "the log would fill what is left"
        disk.free()
        device.send(Event(3, 3.0, "cue", "meanwhile, too"))
        assert [device.next(EventConfirmed).sequence for _ in range(2)] == [2, 3]
        admin.edit("update_poi", poi_id="b", name="Tea bar").raise_for_status()
    assert_whole(disk.folder / "data", [(1, "before"), (2, "meanwhile"), (3, "meanwhile, too")])
    with console_on(disk, tmp_path, small_site) as server:
        deeds = [row.action for row in server.services.store.latest_audit(100)]
        assert deeds.count("device_pause") == 1, "written down as soon as there was room"


def test_what_is_too_old_is_deleted_from_a_full_disk_which_makes_room(
    disk: SmallDisk, tmp_path: Path, small_site: Site
) -> None:
    with console_on(disk, tmp_path, small_site) as server:
        (admin, device, _), services = begun(server), server.services
        device.socket.close()
        services.store.wall_s = long_ago_s
        services.devices.add_event("glasses", Event(2, 2.0, "cue", "long ago"))
        services.store.wall_s = time.time
        disk.fill()
        # Nothing lies in files: it goes by the room that was put by, which is put by again.
        run = admin.http.post("/api/privacy/delete").raise_for_status().json()["last_run"]
        assert (run["problems"], run["deleted"]["Events"]) == ([], 1)
        assert (disk.folder / "data" / "reserve").stat().st_blocks * 512 >= RESERVE_BYTES
        disk.free()
        walk = old_walk(disk.folder / "data" / "recordings")
        disk.fill()
        run = admin.http.post("/api/privacy/delete").raise_for_status().json()["last_run"]
        assert (run["problems"], run["deleted"]["Walks"], walk.exists()) == ([], 1, False)
        disk.fill()
        assert services.retention.run().problems == ()
        assert admin.http.post("/api/privacy/days", json={"days": 3}).raise_for_status().json()["days"] == 3
        audit = {row["action"] for row in admin.http.get("/api/audit").json()["audit"]}
        assert {"retention_run", "retention"} <= audit


def test_of_very_many_events_few_are_kept_in_memory_none_is_lost_and_none_is_shown_twice(
    disk: SmallDisk, tmp_path: Path, small_site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("console.event_intake.MAX_WAITING_COUNT", 16)
    with console_on(disk, tmp_path, small_site) as server:
        (_, device, token), hub, devices = begun(server), server.services.hub, server.services.devices
        shown: list[int] = []
        hub.subscribe(lambda known: shown.append(known.events[-1].sequence))
        events = [Event(number, float(number), "cue", f"event {number}") for number in range(2, 50)]
        disk.fill()
        for joins in (1, 2):
            for event in events:
                device.send(event)
            tell(server, device, 1 + joins)
            assert sorted(set(shown)) == shown_once(shown) == list(range(2, events[-1].sequence + 1)), joins
            if joins == 1:
                device.socket.close()
                device = DialledDevice(server.ready.url, token, hello_of(server, now_s=hub.now_s()))
        disk.free()
        # What was kept is stored; then the link ends, and what was not is sent again.
        device.close_code()
        assert devices.last_sequence("glasses") == 1 + 16
        device = DialledDevice(server.ready.url, token, hello_of(server, now_s=hub.now_s()))
        for event in events[device.next(Welcome).last_event_sequence - 1 :]:
            device.send(event)
        while device.next(EventConfirmed).sequence < events[-1].sequence:
            pass
        device.socket.close()
        assert shown_once(shown) == list(range(2, events[-1].sequence + 1))
    assert_whole(disk.folder / "data", [(1, "before"), *((event.sequence, event.text) for event in events)])


def test_on_a_full_disk_a_link_whose_token_is_void_ends_all_the_same(
    disk: SmallDisk, tmp_path: Path, small_site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("console.accounts.SEEN_STEP_S", -1.0)
    with console_on(disk, tmp_path, small_site) as server:
        (admin, device, _), services = begun(server), server.services
        looking = next(timer for timer in services.timers if timer._name == "signed in")
        looking.close()
        with admin.live() as live:
            assert live.recv(timeout=20)
            services.devices.revoke_token("Glasses", "another program")
            disk.fill()
            with pytest.raises(OperationalError):
                looking._work()
            assert device.close_code()[0] == REVOKED_CODE


def test_on_a_disk_that_fails_nothing_is_lost_and_whoever_watches_goes_on(tmp_path: Path, small_site: Site) -> None:
    with failing_disk(tmp_path / "disk") as disk:
        with console_on(disk, tmp_path, small_site) as server:
            admin, device, token = begun(server)
            kept = admin.graph()
            disk.fail()
            assert_refused(admin, 503, "just now")
            assert_monitored(server, admin, device, token)
        disk.repair()
        assert_whole(disk.folder / "data", [(1, "before")])
        with console_on(disk, tmp_path, small_site) as server:
            assert server.services.model.graph.version == kept["version"]


def test_a_console_starts_on_a_full_disk_and_says_what_is_wrong_on_a_read_only_one(
    disk: SmallDisk, tmp_path: Path, small_site: Site
) -> None:
    with console_on(disk, tmp_path, small_site) as server:
        admin = first_admin(server)
        graph = admin.graph()
        cookies = dict(admin.http.cookies)
    disk.fill()
    with console_on(disk, tmp_path, small_site) as server:
        again = Person(server.ready.url)
        port = server.ready.url.rsplit(":", 1)[1]
        again.http.cookies.set(f"vbr_session_{port}", next(iter(cookies.values())))
        assert again.graph() == graph, "who watches can watch"
        assert again.edit("update_poi", poi_id="b", name="Tea bar").is_success, "what was put by is there to work with"
    disk.free()
    disk.remount("ro")
    with pytest.raises(InputError, match="whether its folder is writable"):
        Store.open(disk.folder / "data")
    disk.remount("rw")
    Store.open(disk.folder / "data").close()


def test_a_disk_at_the_border_is_not_told_anew_again_and_again(
    disk: SmallDisk, caplog: pytest.LogCaptureFixture
) -> None:
    store = Store.open(disk.folder / "data")

    def told_with(free_bytes: int) -> bool:
        disk.fill()
        zeros = disk.folder / "zeros"
        os.truncate(zeros, zeros.stat().st_size - free_bytes)
        store.see_to_room()
        return store.is_short_of_room

    room_bytes = RESERVE_BYTES + (1 << 20)
    assert [told_with(each) for each in (room_bytes, 1 << 20, room_bytes, 1 << 20)] == [False, True, True, True]
    assert caplog.text.count("as good as full") == 1
    assert not told_with(2 * RESERVE_BYTES)
    store.close()


def test_on_a_full_disk_people_come_and_go_and_are_locked_out(
    disk: SmallDisk, tmp_path: Path, small_site: Site, caplog: pytest.LogCaptureFixture
) -> None:
    with console_on(disk, tmp_path, small_site) as server:
        admin, device, token = begun(server)
        services = server.services
        vera = invited(admin, "Vera", "viewer")
        links = {
            name: admin.http.post("/api/users", json={"name": name, "role": "viewer"}).raise_for_status().json()["link"]
            for name in ("Wes", "Wanda")
        }
        disk.fill()
        services.store.see_to_room()
        assert "as good as full" in caplog.text
        for _ in range(20):
            again = Person(server.ready.url)
            assert again.sign_in("Ada").is_success
            assert again.sign_in("Ada", "another password").status_code == 401
            assert again.http.get("/api/session").is_success
            left = Person(server.ready.url)
            left.http.cookies.update(again.http.cookies)
            assert again.http.post("/api/sign-out").is_success
            assert left.http.get("/api/session").status_code == 401
            # Who edits takes what room there is, but not the room that was put by.
            assert admin.edit("update_poi", poi_id="b", name="Tea bar").status_code in (200, 507)
        assert admin.http.patch(f"/api/users/{id_of(server, 'Vera')}", json={"disabled": True}).is_success
        assert vera.http.get("/api/session").status_code == 401
        assert admin.http.post("/api/tokens/revoke", json={"name": "Glasses"}).is_success
        assert services.devices.name_of(token) is None
        assert device.close_code()[0] == 4401
        # Whoever has no password yet, or has forgotten it, gets in all the same.
        for name in ("Wes", "Wanda"):
            wanted = Person(server.ready.url)
            assert wanted.open_link(links[name]).is_success
            assert wanted.http.get("/api/session").json()["name"] == name
            answer = admin.http.post(f"/api/users/{id_of(server, name)}/link").raise_for_status()
            forgetful = Person(server.ready.url)
            assert forgetful.open_link(answer.json()["link"], password="eight quiet lifts").is_success
            assert wanted.http.get("/api/session").status_code == 401
        disk.free()
        services.store.see_to_room()
        assert (disk.folder / "data" / "reserve").stat().st_size == RESERVE_BYTES, "for the next time"
    with console_on(disk, tmp_path, small_site) as server:
        assert server.services.devices.name_of(token) is None
        deeds = [row.action for row in server.services.store.latest_audit(100)]
        assert (deeds.count("sign_out"), deeds.count("token_revoked")) == (20, 1)

"""A console whose disk is full, or can only be read: what was acknowledged stays, who watches goes on watching."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import pytest
from console_room import DialledDevice, Person, first_admin, hello_of, invited, serving, until
from small_disk import SmallDisk, failing_disk, small_disk

from console.disk_reserve import RESERVE_BYTES
from console.server import ConsoleServer
from console.store import DATABASE_FILE, Store
from navcore.errors import InputError
from navcore.modes import Mode
from navcore.site import Site, save_site
from navcore.wire import Event, EventConfirmed, Pause, WalkerState

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
        ("/api/privacy/days", {"days": 3}),
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


def test_on_a_full_disk_people_come_and_go_and_are_locked_out(
    disk: SmallDisk, tmp_path: Path, small_site: Site, caplog: pytest.LogCaptureFixture
) -> None:
    with console_on(disk, tmp_path, small_site) as server:
        admin, device, token = begun(server)
        services = server.services
        vera = invited(admin, "Vera", "viewer")
        vera_id = next(user.id for user in services.accounts.users() if user.name == "Vera")
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
        assert admin.http.patch(f"/api/users/{vera_id}", json={"disabled": True}).is_success
        assert vera.http.get("/api/session").status_code == 401
        assert admin.http.post("/api/tokens/revoke", json={"name": "Glasses"}).is_success
        assert services.devices.name_of(token) is None
        assert device.close_code()[0] == 4401
        disk.free()
        services.store.see_to_room()
        assert (disk.folder / "data" / "reserve").stat().st_size == RESERVE_BYTES, "for the next time"
    with console_on(disk, tmp_path, small_site) as server:
        assert server.services.devices.name_of(token) is None
        deeds = [row.action for row in server.services.store.latest_audit(100)]
        assert (deeds.count("sign_out"), deeds.count("token_revoked")) == (20, 1)

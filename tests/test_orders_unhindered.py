"""A walker is stopped whatever else goes on at the console: a database that is held, a person who presses on."""

from __future__ import annotations

import sqlite3
import threading
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import pytest
from console_room import DialledDevice, Person, first_admin, hello_of, serving, until

from console.errors import TooManyError
from console.hub import STOPS_OF_PERSON_HZ
from console.server import ConsoleServer
from console.store import DATABASE_FILE
from navcore.site import Site, save_site
from navcore.wire import MESSAGES, AskColour, ClearDestination, ConsoleMessage, Order, Pause
from navcore.wire_pace import BURST_S, Allowances
from navcore.wire_row import Direction


@contextmanager
def held(server: ConsoleServer) -> Iterator[sqlite3.Connection]:
    """Somebody else writes in the console's database, and does not come to an end."""
    path = server.services.config.data_folder / DATABASE_FILE
    with closing(sqlite3.connect(path, isolation_level=None)) as other:
        other.execute("BEGIN IMMEDIATE")
        try:
            yield other
        finally:
            other.execute("ROLLBACK")


@pytest.fixture
def server(tmp_path: Path, small_site: Site, monkeypatch: pytest.MonkeyPatch) -> Iterator[ConsoleServer]:
    """A console that would wait for its database longer than any test does, and notes each use of a session."""
    monkeypatch.setattr("console.store._LOCK_WAIT_MS", 600_000)
    monkeypatch.setattr("console.accounts.SEEN_STEP_S", -1.0)
    save_site(small_site, tmp_path / "site")
    with serving(tmp_path / "site", tmp_path / "data") as server:
        yield server


@pytest.fixture
def admin(server: ConsoleServer) -> Person:
    return first_admin(server)


@pytest.fixture
def device(server: ConsoleServer) -> Iterator[DialledDevice]:
    token = server.services.devices.create_token("Glasses", "test")
    device = DialledDevice(server.ready.url, token, hello_of(server, now_s=server.services.hub.now_s()))
    until(server.services.hub, lambda known: known.connected)
    try:
        yield device
    finally:
        device.socket.close()


def ordered(admin: Person, what: str) -> int:
    return admin.http.post(f"/api/devices/glasses/{what}", json={}).status_code


def test_an_order_waits_for_no_database_and_is_written_down_once_that_is_free(
    server: ConsoleServer, admin: Person, device: DialledDevice
) -> None:
    with held(server):
        assert ordered(admin, "pause") == 202
        device.next(Pause)
        assert ordered(admin, "clear") == 202
        device.next(ClearDestination)
    deeds = [row["action"] for row in admin.http.get("/api/audit").json()["audit"]]
    assert (deeds.count("device_pause"), deeds.count("device_clear")) == (1, 1)


def test_a_walker_is_asked_for_a_picture_only_once_that_is_written_down(
    server: ConsoleServer, admin: Person, device: DialledDevice
) -> None:
    asking = threading.Thread(target=ordered, args=(admin, "colour"))
    with held(server):
        asking.start()
        until(server.services.hub, lambda known: [each.kind for each in known.commands] == ["ask_colour"])
        assert ordered(admin, "pause") == 202
        assert isinstance(device.next(Order), Pause)
    assert isinstance(device.next(Order), AskColour)
    asking.join()
    assert ("colour", "glasses") in [(entry.what, entry.device_id) for entry in server.services.access.latest(5)]


def test_whoever_presses_without_end_keeps_nobody_else_from_stopping_the_walker_and_the_link_holds(
    server: ConsoleServer, device: DialledDevice, monkeypatch: pytest.MonkeyPatch
) -> None:
    hub, sent = server.services.hub, list[type[ConsoleMessage]]()
    counted = Allowances(MESSAGES, Direction.DOWN, 0.0)
    pressed_s = hub.now_s()
    monkeypatch.setattr(hub, "now_s", lambda: pressed_s)
    for stop, kind in ((hub.pause, Pause), (hub.clear, ClearDestination)):
        with pytest.raises(TooManyError):  # noqa: PT012
            for _ in range(int(2 * BURST_S * STOPS_OF_PERSON_HZ)):
                stop("glasses", "Ada")
                sent.append(kind)
        stop("glasses", "Ben")
        sent.append(kind)
        with pytest.raises(TooManyError):
            stop("glasses", "Ada")
    for kind in sent:
        device.next(kind)
        assert counted.take(kind, 0.0), "a device that counts ends the link"

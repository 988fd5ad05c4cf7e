"""A device and a console in network namespaces of their own, with everything between them that a network can do.

Only addresses inside the namespaces are spoken to. Guidance decides the same whatever happens between them.
"""

from __future__ import annotations

import contextlib
import json
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from console_room import Person
from device_hall import GRAPH
from link_processes import WAIT_S, ConsoleProcess, Victim
from net_device import LockStepWalk
from network_rooms import CONSOLE_IP, DEVICE_IP, OTHER_DEVICE_IP, Names, Rooms, inside, why_impossible
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection

from navcore.site import Site, map_checksum, save_site

NAME = "console.vbr-test.example"
pytestmark = [pytest.mark.slow, pytest.mark.skipif(bool(why := why_impossible()), reason=why)]


@pytest.fixture(scope="module")
def rooms() -> Iterator[Rooms]:
    rooms = Rooms()
    yield rooms
    rooms.close()


@pytest.fixture
def console(rooms: Rooms, small_site: Site, tmp_path: Path) -> Iterator[ConsoleProcess]:
    """A console in its namespace, of the map that the lock-step walk is in."""
    rooms.mend()
    road = np.stack([np.linspace(0.0, 20.0, 201), np.zeros(201), np.full(201, 1.6)], axis=1)
    save_site(replace(small_site, site_id="hall-site", poi_graph=GRAPH, roads_m=(road,)), tmp_path / "site")
    console = ConsoleProcess(tmp_path / "site", tmp_path, CONSOLE_IP, ("ip", "netns", "exec", rooms.console))
    yield console
    console.kill()


def device_at(rooms: Rooms, host: str, console: ConsoleProcess, folder: Path, *within: str) -> Victim:
    url = f"ws://{host}:{console.port}"
    device = Victim(
        "net_device.py", url, console.token, folder / "device", map_checksum(folder / "site"),
        within=("ip", "netns", "exec", rooms.device, *within),
    )  # fmt: skip
    assert device.says() == "ready"
    return device


def asked(device: Victim, order: str) -> str:
    """Give an order, and return the answer; what is said of recordings in between is passed over."""
    device.tell(order)
    word = {"walk": "walked", "events": "kept"}.get(order.split()[0], order.split()[0])
    while not (answer := device.says()).startswith(word):
        pass
    return answer.partition(" ")[2]


def until(holds: Callable[[], bool]) -> None:
    """Wait for something in another process, which tells nobody that it has changed."""
    deadline_s = time.monotonic() + WAIT_S
    while not holds():
        assert time.monotonic() < deadline_s, "it never came to be so"
        time.sleep(0.05)


class Page:
    """A page that watches nobody, and shows how fresh the device is."""

    def __init__(self, rooms: Rooms, person: Person) -> None:
        with inside(rooms.console):
            self._socket: ClientConnection = person.live(path="/live?says=1")
        self.seen: list[str] = []
        """Each word that differs from the one before."""
        self._changed = threading.Condition()
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    def _read(self) -> None:
        with contextlib.suppress(ConnectionClosed):
            for text in self._socket:
                words = [device["freshness"] for device in json.loads(text)["devices"]]
                with self._changed:
                    self.seen += [word for word in words if self.seen[-1:] != [word]]
                    self._changed.notify_all()

    def wait_for(self, word: str) -> None:
        """Wait until the device is called that."""
        with self._changed:
            assert self._changed.wait_for(lambda: self.seen[-1:] == [word], WAIT_S), f"it is {self.seen}"

    def close(self) -> None:
        """Leave."""
        self._socket.close()
        self._thread.join()


def person_in(rooms: Rooms, console: ConsoleProcess) -> Person:
    person = Person(f"http://{CONSOLE_IP}:{console.port}")
    with inside(rooms.console):
        person.open_link(console.first_link, "Ada").raise_for_status()
    return person


def told(console: ConsoleProcess) -> list[int]:
    """Return the numbers of the events that were handed over for the test, as the console has stored them."""
    texts = [event.text for event in console.stored() if event.kind == "link"]
    return [int(text.split()[1]) for text in texts if text.startswith("told ")]


def test_guidance_is_the_same_through_all_that_a_network_does_and_afterwards_nothing_is_missing(
    rooms: Rooms, console: ConsoleProcess, tmp_path: Path
) -> None:
    alone, cycles = LockStepWalk(), 25
    device = device_at(rooms, CONSOLE_IP, console, tmp_path)

    def walks() -> None:
        assert asked(device, f"walk {cycles}") == alone.walk(cycles)

    def joined() -> bool:
        return asked(device, "link") == "joined"

    walks()
    until(joined)
    person = person_in(rooms, console)
    page = Page(rooms, person)
    walks()
    page.wait_for("live")
    asked(device, "events 20")
    until(lambda: len(told(console)) == 20)
    threads, files, _ = map(int, asked(device, "open").split())
    total = 20

    def through(events: int = 20) -> None:
        nonlocal total
        total += events
        assert asked(device, f"events {events}") == str(total)
        walks()
        walks()

    device.tell("record 400000")
    rooms.both(loss=0.2, delay_s=0.3, jitter_s=0.2, rate_bps=200_000.0)
    through()
    through()
    assert rooms.up.lost_count > 0
    rooms.both(is_cut=True)
    through()
    page.wait_for("lost")
    rooms.mend()
    walks()
    until(joined)
    walks()
    # Only what the device says is lost, then only what the console says.
    for up_is_cut in (True, False):
        (rooms.up if up_is_cut else rooms.down).is_cut = True
        through()
        until(lambda: not joined())
        rooms.mend()
        until(joined)
    # Large packets vanish: small ones arrive, and nobody says why the large ones do not.
    rooms.both(largest_bytes=600)
    through(200)
    rooms.mend()
    until(joined)
    rooms.move_device(DEVICE_IP, OTHER_DEVICE_IP)
    through()
    until(joined)
    rooms.move_device(OTHER_DEVICE_IP, DEVICE_IP)
    page.close()
    console.kill()
    through()
    console.start()
    until(joined)
    through()
    until(lambda: len(told(console)) >= total)
    page = Page(rooms, person)
    walks()
    page.wait_for("live")
    page.close()
    assert told(console) == list(range(total))
    assert [event.sequence for event in console.stored()] == list(range(1, len(console.stored()) + 1))
    kept = tmp_path / "data" / "recordings"
    until(lambda: len(list(kept.glob("*.tar"))) == 1 and not list(kept.glob("*.part")))
    until(lambda: int(asked(device, "open").split()[1]) <= files)
    assert int(asked(device, "open").split()[0]) <= threads + 1
    device.tell("stop")
    assert device.ended() == 0


def test_a_name_that_nobody_knows_or_a_name_server_that_is_silent_holds_up_nothing(
    rooms: Rooms, console: ConsoleProcess, tmp_path: Path
) -> None:
    resolver = tmp_path / "resolv.conf"
    resolver.write_text(f"nameserver {CONSOLE_IP}\noptions timeout:30 attempts:3\n")
    within = ("unshare", "--mount", "sh", "-c", f'mount --bind {resolver} /etc/resolv.conf && exec "$@"', "sh")
    alone, names = LockStepWalk(), Names(rooms)
    try:
        device = device_at(rooms, NAME, console, tmp_path, *within)
        assert asked(device, "walk 50") == alone.walk(50)
        until(lambda: names.asked_count > 0)
        # The link has asked again and again meanwhile; one look-up hangs, and no others behind it.
        until(lambda: asked(device, "open").split()[2] in ("1", "2"))
        device.tell("stop")
        # A resolver hangs for a minute and a half here.
        assert device.ended(30.0) == 0
        for answers in ("denied", "empty"):
            names.answers, before = answers, names.asked_count
            device = device_at(rooms, NAME, console, tmp_path, *within)
            until(lambda before=before: names.asked_count > before + 2)
            assert asked(device, "link") in ("waiting", "dialling")
            names.answers = "here"
            until(lambda device=device: asked(device, "link") == "joined")
            device.tell("stop")
            assert device.ended() == 0
    finally:
        names.close()

"""A device and a console in network namespaces of their own, with everything between them that a network can do.

Only addresses inside the namespaces are spoken to. Guidance decides the same whatever happens between them.
"""

from __future__ import annotations

import contextlib
import json
import threading
from pathlib import Path

import pytest
from console_room import Person
from link_processes import WAIT_S, ConsoleProcess
from namespace_fixtures import Dial, asked, console, dial, rooms, until, with_another_clock
from net_device import LockStepWalk
from network_rooms import CONSOLE_IP, DEVICE_IP, OTHER_DEVICE_IP, Rooms, inside, why_impossible
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection

__all__ = ["console", "dial", "rooms"]
pytestmark = [pytest.mark.slow, pytest.mark.skipif(bool(why := why_impossible()), reason=why)]


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
    rooms: Rooms, console: ConsoleProcess, dial: Dial, tmp_path: Path
) -> None:
    alone, cycles = LockStepWalk(), 25
    device = dial(CONSOLE_IP, *with_another_clock())

    def walks() -> None:
        assert asked(device, f"walk {cycles}") == alone.walk(cycles)

    def walks_live_on(page: Page) -> None:
        mark = max(0, len(page.seen) - 1)

        def is_live() -> bool:
            # The device tells of its walker while they walk.
            walks()
            return "live" in page.seen[mark:]

        until(is_live)

    def joined() -> bool:
        return asked(device, "link") == "joined"

    walks()
    until(joined)
    person = person_in(rooms, console)
    page = Page(rooms, person)
    walks_live_on(page)
    asked(device, "events 20")
    until(lambda: len(told(console)) == 20)
    threads, files, _ = map(int, asked(device, "open").split())
    total = 20

    def through(events: int = 20) -> None:
        nonlocal total
        total += events
        assert asked(device, f"events {events}") == str(total)
        walks()

    device.tell("record 400000")
    rooms.both(loss=0.2, delay_s=0.3, jitter_s=0.2, rate_bps=200_000.0)
    through()
    through()
    until(lambda: rooms.up.lost_count > 0)
    rooms.both(is_cut=True)
    through()
    page.wait_for("lost")
    rooms.mend()
    until(joined)
    walks_live_on(page)
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
    walks_live_on(page)
    page.close()
    assert told(console) == list(range(total))
    assert [event.sequence for event in console.stored()] == list(range(1, len(console.stored()) + 1))
    kept = tmp_path / "data" / "recordings"
    until(lambda: len(list(kept.glob("*.tar"))) == 1 and not list(kept.glob("*.part")))

    def has_grown() -> bool:
        threads_now, files_now, _ = map(int, asked(device, "open").split())
        return threads_now > threads or files_now > files

    until(lambda: not has_grown())
    device.tell("stop")
    assert device.ended() == 0

"""Kill -9 of the console: every event arrives, in order, once. Of the device: test_kill_device.py."""

from __future__ import annotations

import random
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from link_processes import WAIT_S, ConsoleProcess, Victim
from link_proxy import Network

from navcore.wire import Event

pytestmark = pytest.mark.slow


def device_on(network: Network, console: ConsoleProcess, folder: Path, run: int = 0) -> Victim:
    device = Victim("link_device_victim.py", f"ws://127.0.0.1:{network.port}", console.token, folder / "device", run)
    assert device.says() == "ready"
    return device


def cues(console: ConsoleProcess) -> list[tuple[int, int]]:
    """Return run and number of each event that a device handed over for the test, as the console has stored them."""
    return [tuple(map(int, event.text.split())) for event in console.stored() if event.kind == "cue"]  # type: ignore[misc]


def until(holds: Callable[[], bool]) -> None:
    """Wait for something in another process's files, which tell nobody that they have changed."""
    deadline_s = time.monotonic() + WAIT_S
    while not holds():
        assert time.monotonic() < deadline_s, "it never came to be so"
        time.sleep(0.02)


def assert_numbered_without_gaps(events: list[Event]) -> None:
    assert [event.sequence for event in events] == list(range(1, len(events) + 1))


def test_no_event_is_missing_or_doubled_though_the_console_is_killed_again_and_again(
    console: ConsoleProcess, network: Network, tmp_path: Path
) -> None:
    dice = random.Random(7)
    device = device_on(network, console, tmp_path)
    for _ in range(3):
        device.tell("100")
        # Somewhere among the confirmations of these events.
        until_bytes = network.down_bytes + dice.randrange(50, 2500)
        network.wait_for(lambda until_bytes=until_bytes: network.down_bytes > until_bytes)
        console.kill()
        device.tell("30")
        console.start()
    until(lambda: len(cues(console)) == 390)
    device.kill()
    assert cues(console) == [(0, number) for number in range(390)]
    assert_numbered_without_gaps(console.stored())

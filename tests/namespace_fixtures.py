"""A console and devices in network namespaces: fixtures of the tests that need them, and what is asked of a device."""

from __future__ import annotations

import subprocess
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from device_hall import GRAPH
from link_processes import WAIT_S, ConsoleProcess, Victim
from network_rooms import CONSOLE_IP, Rooms

from navcore.site import Site, map_checksum, save_site


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


def with_another_clock() -> tuple[str, ...]:
    """Return what runs a command on a machine that has been on for two months longer, where the kernel can do that."""
    command = ("unshare", "--time", "--monotonic", "5000000", "--boottime", "5000000")
    return command if subprocess.run([*command, "true"], check=False, capture_output=True).returncode == 0 else ()


Dial = Callable[..., Victim]


@pytest.fixture
def dial(rooms: Rooms, console: ConsoleProcess, tmp_path: Path) -> Iterator[Dial]:
    """What starts a device in its namespace; none is left behind."""
    devices: list[Victim] = []

    def dial(host: str, *within: str) -> Victim:
        devices.append(
            Victim(
                "net_device.py", f"ws://{host}:{console.port}", console.token, tmp_path / "device",
                map_checksum(tmp_path / "site"), within=("ip", "netns", "exec", rooms.device, *within),
            )
        )  # fmt: skip
        assert devices[-1].says() == "ready"
        return devices[-1]

    yield dial
    for device in devices:
        device.kill()


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

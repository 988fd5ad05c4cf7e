"""What a bad network costs the loop: time of a cycle with a good one, a bad one, and none, and when the device is back.

    sudo python -m benchmarks.bad_network [--rounds 6] [--cycles 150]

A device in lock step and a console, both real processes, in the network namespaces of the tests
(tests/network_rooms.py), which need root. Blocks of cycles under each network follow one another, so that a busy
machine is busy for all alike.
"""

from __future__ import annotations

import argparse
import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from navcore.site import Site, map_checksum, save_site
from navcore.types import CameraIntrinsics

TESTS = Path(__file__).resolve().parent.parent / "tests"
_PAUSE_MS = 20.0
"""So long the device rests between two cycles (tests/net_device.py)."""


def main() -> None:
    """Measure, and print."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--rounds", type=int, default=6)
    parser.add_argument("--cycles", type=int, default=150)
    arguments = parser.parse_args()
    # The two processes, and the line between them, are those of the tests.
    sys.path.insert(0, str(TESTS))
    from network_rooms import Rooms, why_impossible

    if why := why_impossible():
        sys.exit(f"Nothing is measured: {why}.")
    rooms = Rooms()
    try:
        with tempfile.TemporaryDirectory() as folder:
            measure(rooms, Path(folder), arguments.rounds, arguments.cycles)
    finally:
        rooms.close()


def measure(rooms: object, folder: Path, rounds: int, cycles: int) -> None:
    """Walk under each network in turn."""
    from link_processes import ConsoleProcess, Victim
    from network_rooms import CONSOLE_IP, Rooms

    assert isinstance(rooms, Rooms)
    save_site(_hall(), folder / "site")
    console = ConsoleProcess(folder / "site", folder, CONSOLE_IP, ("ip", "netns", "exec", rooms.console))
    device = Victim(
        "net_device.py", f"ws://{CONSOLE_IP}:{console.port}", console.token, folder / "device",
        map_checksum(folder / "site"), within=("ip", "netns", "exec", rooms.device),
    )  # fmt: skip
    try:
        networks: dict[str, Callable[[], None]] = {
            "good network": rooms.mend,
            "bad network": lambda: rooms.both(loss=0.2, delay_s=0.3, jitter_s=0.2, rate_bps=200_000.0),
            "no network": lambda: rooms.both(is_cut=True),
        }
        device.says()
        _cycle_ms(device, cycles)
        found: dict[str, list[float]] = {name: [] for name in networks}
        back_s: list[float] = []
        for _ in range(rounds):
            for name, begin in networks.items():
                begin()
                found[name].append(_cycle_ms(device, cycles))
            rooms.mend()
            back_s.append(_until_joined_s(device))
    finally:
        device.kill()
        console.kill()
    good_ms = statistics.median(found["good network"])
    for name, all_ms in found.items():
        median_ms = statistics.median(all_ms)
        print(
            f"{name} network: {median_ms:.1f} ms a cycle (median of {rounds} blocks), {median_ms / good_ms:.2f} times"
        )
    print(f"joined again {max(back_s):.1f} s after the network at the latest, with pauses of 0.5 s at most")


def _hall() -> Site:
    from device_hall import GRAPH

    road = np.stack([np.linspace(0.0, 20.0, 201), np.zeros(201), np.full(201, 1.6)], axis=1)
    return Site(
        "hall-site", "Hall", CameraIntrinsics(320, 240, 230.0, 230.0, 160.0, 120.0),
        {"keyframe_poses": np.tile(np.eye(4), (2, 1, 1)), "descriptors": np.zeros((5, 32), np.uint8)},
        (road,), np.zeros((50, 3), np.float32), np.zeros((50, 3), np.uint8), GRAPH, {"keyframes": 2},
    )  # fmt: skip


def _cycle_ms(device: object, cycles: int) -> float:
    began_s = time.perf_counter()
    _asked(device, f"walk {cycles}", "walked")
    return (time.perf_counter() - began_s) / cycles * 1000.0 - _PAUSE_MS


def _until_joined_s(device: object) -> float:
    began_s = time.perf_counter()
    while _asked(device, "link", "link") != "link joined":
        time.sleep(0.05)
    return time.perf_counter() - began_s


def _asked(device: object, order: str, word: str) -> str:
    from link_processes import Victim

    assert isinstance(device, Victim)
    device.tell(order)
    while not (answer := device.says()).startswith(word):
        pass
    return answer


if __name__ == "__main__":
    main()

"""A console in a process of its own, so that its CPU time and memory are its own; with people and devices let in."""

from __future__ import annotations

import json
import os
import signal
import sqlite3
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np

from console.config import ConsoleConfig
from console.opening import open_services
from console.store import DATABASE_FILE
from navcore.planning.poi_graph import Edge, Poi, PoiGraph
from navcore.site import Site, save_site
from navcore.types import CameraIntrinsics

_SITE, _DATA = "site", "data"
_START_WITHIN_S = 60.0
_TICK_S = 1.0 / os.sysconf("SC_CLK_TCK")
_PAGE_MB = os.sysconf("SC_PAGE_SIZE") / 2**20


@dataclass(slots=True)
class RunningConsole:
    """A console that serves, and who may come in."""

    folder: Path
    process: subprocess.Popen[bytes]
    url: str
    session: str
    """Of an admin who is signed in."""
    tokens: tuple[str, ...]
    """One of each device."""

    def kill_and_start_again(self) -> None:
        """End it without a warning (kill -9), and serve the same data at the same address."""
        self.process.kill()
        self.process.wait()
        self.process, url = _started(self.folder, urlsplit(self.url).port or 0)
        assert url == self.url

    @property
    def pid(self) -> int:
        """Of its process."""
        return self.process.pid

    @property
    def data_folder(self) -> Path:
        """Where it keeps what it keeps."""
        return self.folder / _DATA

    @property
    def cookie(self) -> str:
        """What a browser of that admin sends."""
        return f"vbr_session_{self.url.rsplit(':', 1)[1]}={self.session}"

    @property
    def socket_url(self) -> str:
        """The address for WebSockets."""
        return self.url.replace("http", "ws", 1)

    def cpu_s(self) -> float:
        """CPU time that it has taken so far."""
        fields = Path(f"/proc/{self.pid}/stat").read_text(encoding="ascii").rsplit(")", 1)[1].split()
        return (int(fields[11]) + int(fields[12])) * _TICK_S

    def rss_mb(self) -> float:
        """Memory that it holds."""
        return int(Path(f"/proc/{self.pid}/statm").read_text(encoding="ascii").split()[1]) * _PAGE_MB

    def stored_sequences(self, device_id: str) -> list[int]:
        """The numbers of a device's stored events, in the order in which they were stored."""
        base = sqlite3.connect(self.data_folder / DATABASE_FILE)
        rows = base.execute("SELECT sequence FROM device_events WHERE device_id = ? ORDER BY id", (device_id,))
        found = [sequence for (sequence,) in rows]
        base.close()
        return found


@contextmanager
def console_process(folder: Path, devices_count: int, profile: Path | None = None) -> Iterator[RunningConsole]:
    """Serve a small site until the block ends, with ``vbr console``; ``profile`` is for ``pstats``, of its loop."""
    save_site(corridor(), folder / _SITE)
    session, tokens = _let_in(ConsoleConfig(folder / _SITE, folder / _DATA), devices_count)
    process, url = _started(folder, 0, profile)
    console = RunningConsole(folder, process, url, session, tokens)
    try:
        yield console
    finally:
        console.process.send_signal(signal.SIGTERM)
        console.process.wait(30.0)


@contextmanager
def console_again(folder: Path, known: RunningConsole) -> Iterator[RunningConsole]:
    """Serve, until the block ends, a folder with a copy of what ``known`` serves: the same people are signed in."""
    process, url = _started(folder, 0)
    try:
        yield RunningConsole(folder, process, url, known.session, known.tokens)
    finally:
        process.send_signal(signal.SIGTERM)
        process.wait(30.0)


def _started(folder: Path, port: int, profile: Path | None = None) -> tuple[subprocess.Popen[bytes], str]:
    ready_file = folder / "ready.json"
    ready_file.unlink(missing_ok=True)
    command = (
        "console",
        "--site",
        folder / _SITE,
        "--data",
        folder / _DATA,
        "--port",
        port,
        "--ready-file",
        ready_file,
    )
    under = ["-m", "cProfile", "-o", str(profile)] if profile is not None else []
    process = subprocess.Popen([sys.executable, *under, "-m", "device_agent", *map(str, command)])
    return process, _ready(ready_file, process)["url"]


def _let_in(config: ConsoleConfig, devices_count: int) -> tuple[str, tuple[str, ...]]:
    services = open_services(config)
    link = services.accounts.first_admin_link_token()
    assert link is not None
    user = services.accounts.use_link(link, "Ada", "a long pass phrase 42")
    tokens = tuple(services.devices.create_token(f"Glasses {n}", "benchmark") for n in range(devices_count))
    session = services.accounts.start_session(user.id)
    services.store.close()
    return session, tokens


def _ready(path: Path, process: subprocess.Popen[bytes]) -> dict[str, str]:
    until_s = time.monotonic() + _START_WITHIN_S
    while not path.exists():
        assert process.poll() is None, "the console ended by itself"
        assert time.monotonic() < until_s, f"the console was not ready within {_START_WITHIN_S:g} s"
        time.sleep(0.05)
    found: dict[str, str] = json.loads(path.read_text(encoding="utf-8"))
    return found


def corridor() -> Site:
    """Return a small site: one road, two places, a cloud of 20,000 points."""
    rng = np.random.default_rng(3)
    road_m = np.stack([np.linspace(0.0, 30.0, 301), np.zeros(301), np.full(301, 1.6)], axis=1)
    graph = PoiGraph(
        1,
        {"hall": Poi("hall", "Hall", "hall", 0.0, 0.0), "bar": Poi("bar", "Bar", "bar", 30.0, 0.0)},
        {"way": Edge("way", "hall", "bar", ((0.0, 0.0), (30.0, 0.0)), 30.0)},
    )
    points_m = rng.uniform((-1.0, -1.0, 0.0), (31.0, 1.0, 2.6), (20_000, 3)).astype(np.float32)
    return Site(
        "corridor", "Corridor", CameraIntrinsics(320, 240, 262.5, 262.5, 159.5, 119.5), {}, (road_m,), points_m,
        rng.integers(60, 220, (20_000, 3), dtype=np.uint8), graph,
    )  # fmt: skip

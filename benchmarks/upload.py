"""What a recording on its way to the console costs: how long events wait beside it on a narrow link, and its pace.

    python -m benchmarks.upload [--kbit-s 1000] [--seconds 20] [--megabytes 50]

A real console and a real link of a device, in one process, with a bottleneck between them that all connections from the
device share. Events are handed over at 2 Hz, and timed until the console has confirmed them, first without and then
beside a recording. Then a recording is sent without the bottleneck.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import json
import os
import shutil
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from console.config import ConsoleConfig
from console.server import ConsoleServer
from device_agent.adapters.clocks import SystemClock
from device_agent.journal import EventJournal
from device_agent.link import ConsoleLink
from device_agent.link_settings import LinkSettings
from device_agent.link_state import LinkCondition
from device_agent.map_download import MapSource
from device_agent.map_walk.walk_folder import STATE_FILE, WalkState, new_walk, write_state
from device_agent.recording_upload import send_recording
from device_agent.state import MapWalkTold
from navcore.recording_archive import RecordingArchive
from navcore.recording_upload import RecordingOffer
from navcore.site import Site, save_site
from navcore.types import CameraIntrinsics
from navcore.wire import PROTOCOL_VERSION, ConsoleMessage, Hello

EVENT_EVERY_S = 0.5
PACKET_BYTES = 1500
PICTURE_BYTES = 90_000
LONGEST_RECORDING_S = 60
"""The recording beside which events are timed would take so long if it had the link to itself."""


@dataclass(frozen=True, slots=True)
class _Device:
    """What the link needs of a device."""

    server: ConsoleServer

    def hello(self) -> Hello:
        services = self.server.services
        site_id, version = services.model.site.site_id, services.model.published.version
        return Hello(PROTOCOL_VERSION, "glasses", "0", site_id, services.package.checksum, version, 0, 0.0)

    def submit(self, order: ConsoleMessage | MapWalkTold, holds_s: float = np.inf) -> None:
        """Nothing is done here."""

    def map_arrived(self, staging: Path, checksum: str) -> None:
        """No map comes."""


class Bottleneck:
    """Carries connections to a port, what goes up packet by packet at a rate that all of them share."""

    def __init__(self, to_port: int, bytes_s: float) -> None:
        self._to_port, self._bytes_s = to_port, bytes_s
        self._narrow = asyncio.Lock()
        self.up_bytes = 0
        self._loop = asyncio.new_event_loop()
        threading.Thread(target=self._loop.run_forever, daemon=True).start()
        listening = asyncio.run_coroutine_threadsafe(asyncio.start_server(self._carry, "127.0.0.1", 0), self._loop)
        self.port = int(listening.result().sockets[0].getsockname()[1])

    async def _carry(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        there_reader, there_writer = await asyncio.open_connection("127.0.0.1", self._to_port)
        with contextlib.suppress(OSError):
            await asyncio.gather(self._pump(reader, there_writer, up=True), self._pump(there_reader, writer, up=False))

    async def _pump(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, *, up: bool) -> None:
        while data := await reader.read(PACKET_BYTES):
            if up:
                async with self._narrow:
                    await asyncio.sleep(len(data) / self._bytes_s)
                self.up_bytes += len(data)
            writer.write(data)
            await writer.drain()
        writer.close()


@contextlib.contextmanager
def served(folder: Path) -> Iterator[ConsoleServer]:
    """Serve a site of nothing."""
    road = np.stack([np.linspace(0.0, 6.0, 61), np.zeros(61), np.zeros(61)], axis=1)
    camera = CameraIntrinsics(320, 240, 230.0, 230.0, 160.0, 120.0)
    cloud = np.zeros((4, 3), np.float32), np.zeros((4, 3), np.uint8)
    save_site(Site("upload", "Upload", camera, {}, (road,), *cloud), folder / "site")
    server = ConsoleServer(ConsoleConfig(folder / "site", folder / "data", port=0), with_scene=False)
    server.start()
    try:
        yield server
    finally:
        server.stop()


def recorded(folder: Path, size_bytes: int) -> Path:
    """Return a recording of pictures that cannot be compressed; what they show does not matter on the way."""
    walk = new_walk(folder, "")
    for number in range(max(1, size_bytes // PICTURE_BYTES)):
        (walk / f"{number}.png").write_bytes(os.urandom(PICTURE_BYTES))
    write_state(walk, WalkState("handed_over"))
    return walk


def confirmed_s(bytes_s: float, seconds: float, recording_bytes: int) -> tuple[list[float], float]:
    """Return how long each event took until it was confirmed, and what went over the link, bytes per second."""
    folder = Path(tempfile.mkdtemp())
    with served(folder) as server:
        token = server.services.devices.create_token("glasses", "benchmark")
        bottleneck = Bottleneck(int(server.ready.url.rsplit(":", 1)[1]), bytes_s)
        if recording_bytes:
            recorded(folder / "walks", recording_bytes)
        journal, clock = EventJournal(folder / "events.sqlite"), SystemClock()
        url = f"ws://127.0.0.1:{bottleneck.port}"
        link = ConsoleLink(LinkSettings(url, token, folder / "in", map_walks=folder / "walks"), journal, clock)
        link.start(_Device(server))
        while link.link_state.condition is not LinkCondition.JOINED or journal.pending(0):
            time.sleep(0.01)
        began_s, before_bytes, took_s = clock.now_s(), bottleneck.up_bytes, []
        while clock.now_s() - began_s < seconds:
            handed_s = clock.now_s()
            link.event(handed_s, "cue", "Somebody must hear of this.")
            journal.flush()
            while journal.pending(0):
                time.sleep(0.001)
            took_s.append(clock.now_s() - handed_s)
            clock.sleep_until(handed_s + EVENT_EVERY_S)
        went = (bottleneck.up_bytes - before_bytes) / (clock.now_s() - began_s)
        link.stop()
        journal.close()
    shutil.rmtree(folder)
    return took_s, went


def sending_s(size_bytes: int) -> float:
    """Return how long a recording takes where nothing is narrow."""
    folder = Path(tempfile.mkdtemp())
    with served(folder) as server:
        console = MapSource(
            server.ready.url.replace("http", "ws", 1), server.services.devices.create_token("glasses", "benchmark")
        )
        archive = RecordingArchive(recorded(folder / "walks", size_bytes), {STATE_FILE})
        offer = RecordingOffer("recording", "walk", archive.size_bytes, archive.sha256())

        async def at_once() -> None:
            return

        began_s = time.monotonic()
        asyncio.run(send_recording(archive, offer, console, at_once))
        took_s = time.monotonic() - began_s
    shutil.rmtree(folder)
    return took_s


def main() -> None:
    """Measure, and print JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kbit-s", type=float, default=1000.0, help="what the bottleneck lets through")
    parser.add_argument("--seconds", type=float, default=20.0, help="for how long events are timed")
    parser.add_argument("--megabytes", type=int, default=50, help="size of the recording that is sent freely")
    arguments = parser.parse_args()
    bytes_s = 125.0 * arguments.kbit_s
    answer: dict[str, float] = {"kbit_s": arguments.kbit_s}
    for name, size_bytes in (("alone", 0), ("beside_a_recording", int(LONGEST_RECORDING_S * bytes_s))):
        took_s, went = confirmed_s(bytes_s, arguments.seconds, size_bytes)
        ms = 1e3 * np.array(took_s)
        answer[f"event_ms_median_{name}"] = round(float(np.median(ms)), 1)
        answer[f"event_ms_max_{name}"] = round(float(ms.max()), 1)
        answer[f"share_of_the_link_{name}"] = round(went / bytes_s, 3)
    answer["mb_s_freely"] = round(arguments.megabytes / sending_s(arguments.megabytes * 1_000_000), 2)
    json.dump(answer, sys.stdout, indent=1)
    sys.stdout.write("\n")


if __name__ == "__main__":
    main()

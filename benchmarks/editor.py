"""What the map editor in the scene can carry: a large graph that is dragged, edits seen by others, a large cloud.

    python -m benchmarks.editor [--places 500] [--edges 800] [--points 5000000] [--windows 4]

A real console on loopback; the windows are processes with real WebSocket clients that read as a browser does, and draw
nothing. Dragging is timed in the scene's own loop: the message's handler, with preview, drawing and panel.
"""

from __future__ import annotations

import argparse
import asyncio
import gc
import json
import os
import queue
import statistics
import subprocess
import sys
import tempfile
import threading
import time
import urllib.request
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import zstandard
from websockets.sync.client import ClientConnection, connect

from console.config import ConsoleConfig
from console.edits import UpdatePoi
from console.server import ConsoleServer
from console.viewer.cloud import shown_cloud
from console.viewer.embedded import SUBPROTOCOL
from console.viewer.scene import Scene
from console.viewer.tag import HEAD_Z_M
from navcore.planning.edits import propose_edges
from navcore.planning.poi_graph import Poi, PoiGraph
from navcore.planning.road_edits import network_of, recorded_roads
from navcore.site import Site, save_site
from navcore.types import CameraIntrinsics

SPACING_M = 4.0
COLUMNS_COUNT = 25
CAMERA = {
    "type": "ViewerCameraMessage", "wxyz": (1.0, 0.0, 0.0, 0.0), "position": (40.0, -30.0, 60.0), "fov": 1.0,
    "near": 0.1, "far": 500.0, "image_height": 800, "image_width": 1200, "look_at": (40.0, 30.0, 0.0),
    "up_direction": (0.0, 0.0, 1.0),
}  # fmt: skip


# ------------------------------------------------------------------------------------------------------------ site
def street_grid(places_count: int, edges_count: int, points_count: int, seed: int = 0) -> Site:
    """A building of crossing corridors, a place at each crossing, and a cloud of floor and walls."""
    rows_count = -(-places_count // COLUMNS_COUNT)
    width_m, depth_m = (COLUMNS_COUNT - 1) * SPACING_M, (rows_count - 1) * SPACING_M
    along_x = np.arange(-0.5, width_m + 0.5, 0.1)
    along_y = np.arange(-0.5, depth_m + 0.5, 0.1)
    roads = [np.column_stack([along_x, np.full_like(along_x, row * SPACING_M)]) for row in range(rows_count)]
    roads += [np.column_stack([np.full_like(along_y, col * SPACING_M), along_y]) for col in range(COLUMNS_COUNT)]
    roads_m = tuple(np.column_stack([road, np.zeros(len(road))]) for road in roads)
    pois = {
        f"p{n}": Poi(f"p{n}", f"Room {n}", "room", n % COLUMNS_COUNT * SPACING_M, n // COLUMNS_COUNT * SPACING_M)
        for n in range(places_count)
    }
    network = network_of(recorded_roads(roads_m))
    graph = propose_edges(PoiGraph(1, pois), network)
    edges = dict(list(graph.edges.items())[:edges_count])
    rng = np.random.default_rng(seed)
    points = rng.uniform((-1.0, -1.0, 0.0), (width_m + 1.0, depth_m + 1.0, 2.6), (points_count, 3)).astype(np.float32)
    points[: points_count // 2, 2] = 0.0
    colours = rng.integers(60, 220, (points_count, 3), dtype=np.uint8)
    return Site(
        "grid", "Grid", CameraIntrinsics(320, 240, 262.5, 262.5, 159.5, 119.5), {}, roads_m, points, colours,
        PoiGraph(1, pois, edges),
    )  # fmt: skip


# --------------------------------------------------------------------------------------------------------- windows
def opened(url: str, cookie: str) -> ClientConnection:
    """Open the scene's WebSocket as a browser does."""
    socket = connect(
        url.replace("http", "ws", 1) + "/viewer/scene", additional_headers={"Cookie": cookie}, compression=None,
        origin=url, subprotocols=[SUBPROTOCOL], max_size=None, ping_interval=None,
    )  # type: ignore[arg-type] # fmt: skip
    socket.send(msgspec.msgpack.encode(CAMERA))
    return socket


def read(socket: ClientConnection) -> list[dict[str, Any]]:
    """Return the next messages."""
    data = socket.recv()
    assert isinstance(data, bytes)
    length, packed = int.from_bytes(data[:8], "little"), int.from_bytes(data[8:16], "little")
    inner = zstandard.ZstdDecompressor().decompress(data[16 : 16 + packed], max_output_size=length)
    messages: list[dict[str, Any]] = msgspec.msgpack.decode(inner)["messages"]
    return messages


def window_process(url: str, cookie: str, last_node: str) -> None:
    """Be a window: fetch the page, open the socket, say when the first and the last points were there, and stay."""
    begun_s = time.perf_counter()
    request = urllib.request.Request(f"{url}/viewer/scene/", headers={"Cookie": cookie, "Accept-Encoding": "gzip"})
    urllib.request.urlopen(request).read()
    socket = opened(url, cookie)
    first_s = None
    while True:
        names = {message.get("name") for message in read(socket)}
        now_s = time.perf_counter() - begun_s
        if first_s is None and "/map/cloud/points" in names:
            first_s = now_s
        if last_node in names:
            break
    sys.stdout.write(json.dumps({"first_s": first_s, "all_s": now_s}) + "\n")
    sys.stdout.flush()
    while True:
        read(socket)


@contextmanager
def windows(url: str, cookies: list[str], last_node: str) -> Iterator[list[dict[str, float]]]:
    """Open windows one after the other, each in a process of its own."""
    with ExitStack() as stack:
        times = []
        for cookie in cookies:
            command = [sys.executable, "-m", "benchmarks.editor", "--window", url, cookie, last_node]
            process = stack.enter_context(subprocess.Popen(command, stdout=subprocess.PIPE, text=True))
            stack.callback(process.kill)
            assert process.stdout is not None
            times.append(json.loads(process.stdout.readline()))
        yield times


# -------------------------------------------------------------------------------------------------------- measures
def dragging(scene: Scene, updates_count: int) -> list[float]:
    """Return how long each update of a drag takes in the scene's loop, of a place with four edges, seconds."""
    view = next(iter(scene.views.values()))
    poi = view.editor.graph.pois[f"p{COLUMNS_COUNT * 5 + 12}"]

    async def drag(phase: str, x_m: float) -> float:
        begun_s = time.perf_counter()
        await view._drag_poi(poi.id, _Event(phase, (x_m, poi.y_m + 0.3, HEAD_Z_M)))  # type: ignore[arg-type]
        scene.tick()
        return time.perf_counter() - begun_s

    places = poi.x_m + 1.2 * np.sin(np.linspace(0.0, 6.0, updates_count))
    phases = ["start", *["update"] * (updates_count - 2), "end"]
    return [_in_loop(scene, drag(phase, float(x_m))) for phase, x_m in zip(phases, places, strict=True)]


class _Event:
    """What is used of viser's event of a drag."""

    def __init__(self, phase: str, end_position: tuple[float, float, float]) -> None:
        self.phase, self.end_position = phase, end_position


def _in_loop(scene: Scene, action: Any) -> Any:
    return asyncio.run_coroutine_threadsafe(action, scene.embedded.loop).result(60)


def seen_elsewhere(server: ConsoleServer, socket: ClientConnection, edits_count: int) -> list[float]:
    """Return the times from an edit until a second window has it, seconds."""
    texts: queue.Queue[tuple[float, str]] = queue.Queue()

    def listen() -> None:
        try:
            while True:
                for message in read(socket):
                    text = message.get("updates", {}).get("text") if isinstance(message.get("updates"), dict) else None
                    if text:
                        texts.put((time.perf_counter(), text))
        except Exception:
            return

    threading.Thread(target=listen, daemon=True).start()
    times_s = []
    for number in range(edits_count):
        name = f"Renamed {number}"
        begun_s = time.perf_counter()
        server.services.model.apply(UpdatePoi("p30", name=name), "somebody")
        while True:
            at_s, text = texts.get(timeout=10)
            if text == name:
                break
        times_s.append(at_s - begun_s)
    return times_s


def rss_mb() -> float:
    """Return what memory this process holds."""
    gc.collect()
    return int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1]) * os.sysconf("SC_PAGE_SIZE") / 2**20


def measure(arguments: argparse.Namespace, folder: Path) -> None:
    """Measure, and print."""
    site = street_grid(arguments.places, arguments.edges, arguments.points)
    begun_s = time.perf_counter()
    shown_cloud(site.cloud_points_m, site.cloud_colours_rgb)
    print(f"cloud of {arguments.points:,} points thinned in {time.perf_counter() - begun_s:.1f} s")
    save_site(site, folder / "site")
    del site
    server = ConsoleServer(ConsoleConfig(folder / "site", folder / "data", port=0))
    accounts = server.services.accounts
    token = accounts.first_admin_link_token()
    assert token is not None
    user_id = accounts.use_link(token, "Ada", "a long pass phrase 42").id
    url = server.start().url
    scene: Scene = server._stop_scene.__self__  # type: ignore[attr-defined]
    graph = server.services.model.graph
    print(f"{len(graph.pois)} places, {len(graph.edges)} edges; {scene.cloud.sentence}")

    def cookie() -> str:
        return f"vbr_session_{url.rsplit(':', 1)[1]}={accounts.start_session(user_id)}"

    try:
        before_mb = rss_mb()
        last = (*scene.cloud.parts, *scene.cloud.ceiling_parts)[-1].name
        with windows(url, [cookie() for _ in range(arguments.windows)], last) as times:
            for each in times:
                print(f"window: first points after {each['first_s']:.2f} s, all after {each['all_s']:.2f} s")
            time.sleep(2.0)
            print(f"memory: {before_mb:.0f} MB, {(rss_mb() - before_mb) / len(times):.1f} MB more for each window")
            took_ms = [1e3 * t for t in dragging(scene, arguments.updates)]
            updates = took_ms[1:-1]
            print(
                f"drag with {len(times)} windows open: {statistics.median(updates):.1f} ms an update, the slowest"
                f" {max(updates):.1f} ms ({1e3 / max(updates):.0f}/s), put down in {took_ms[-1]:.1f} ms"
            )
            socket = opened(url, cookie())
            while not any(message.get("name") == "/graph/poi/p30/name" for message in read(socket)):
                pass
            seen_ms = [1e3 * t for t in seen_elsewhere(server, socket, 20)]
            print(f"an edit is in another window after {statistics.median(seen_ms):.0f} ms, at most {max(seen_ms):.0f}")
            socket.close()
    finally:
        server.stop()


def main() -> None:
    """Run it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--places", type=int, default=500)
    parser.add_argument("--edges", type=int, default=800)
    parser.add_argument("--points", type=int, default=5_000_000)
    parser.add_argument("--windows", type=int, default=4)
    parser.add_argument("--updates", type=int, default=100)
    parser.add_argument("--window", nargs=3, metavar=("URL", "COOKIE", "NODE"), help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.window:
        window_process(*arguments.window)
        return
    with tempfile.TemporaryDirectory() as folder:
        measure(arguments, Path(folder))


if __name__ == "__main__":
    main()

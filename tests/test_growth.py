"""What comes and goes leaves nothing behind: the same counts after a few rounds and after ten times as many.

Counts, not memory or time: those are measured by ``benchmarks/long_run.py``.
"""

from __future__ import annotations

import asyncio
import contextlib
import gc
import json
import os
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
import zstandard
from console_room import DEFAULTS, WAIT_S, DialledDevice, Person, first_admin, hello_of, until
from test_device_agent import Rig
from test_viewer_mount import CAMERA
from viewer_site import crossing_corridors
from websockets.sync.client import ClientConnection, connect

from benchmarks.growth import trend
from console.alerts.rules import RULES
from console.config import ConsoleConfig
from console.hub import FORGOTTEN_AFTER_S
from console.server import ConsoleServer
from console.viewer.embedded import SUBPROTOCOL
from console.viewer.scene import Scene
from device_agent.recording.options import RecordingOptions
from device_agent.recording.recorder import WalkRecorder
from device_agent.recording.walk_files import PartName, parts_in
from navcore.modes import Mode
from navcore.silhouette import silhouette_jpeg
from navcore.site import save_site
from navcore.wire import DepthImage, Event, EventConfirmed, SetDestination, SettingsRunning, WalkerState

FEW = 4
STATES_COUNT = 5
SILHOUETTE = silhouette_jpeg(np.ones((48, 64), np.float32))
MORE_CYCLES = 540
OURS = ("console.", "device_agent.", "navcore.", "viser.")


@dataclass
class Room:
    """A console with its scene, and somebody signed in."""

    server: ConsoleServer
    admin: Person
    token: str
    events_count: int = 0

    @property
    def scene(self) -> Scene:
        scene: Scene = self.server._stop_scene.__self__  # type: ignore[attr-defined]
        return scene

    def window(self) -> ClientConnection:
        """Open the 3D scene, and wait until what is of this window alone comes."""
        cookies = "; ".join(f"{name}={value}" for name, value in self.admin.http.cookies.items())
        socket = connect(
            f"{self.admin.url.replace('http', 'ws', 1)}/viewer/scene", additional_headers={"Cookie": cookies},
            compression=None, origin=self.admin.url, subprotocols=[SUBPROTOCOL], max_size=None, ping_interval=None,
        )  # type: ignore[arg-type] # fmt: skip
        socket.send(msgspec.msgpack.encode(CAMERA))
        while not any(message.get("name") == "/graph/halo" for message in _read(socket)):
            pass
        return socket

    def page(self, path: str, device_id: str) -> ClientConnection:
        """Open a page's stream, which says that it shows a device, and wait for its first message."""
        socket = self.admin.live(path=path)
        socket.send(json.dumps({"type": "watching", "watching": [device_id]}))
        socket.recv(timeout=WAIT_S)
        return socket

    def round(self, device_id: str = "glasses", *, leads: bool = True) -> None:
        """A device connects, pages and a window open, somebody is led and arrives, and all of them go."""
        now_s, hub = self.server.services.hub.now_s, self.server.services.hub
        device = DialledDevice(self.admin.url, self.token, hello_of(self.server, device_id))
        device.send(SettingsRunning(0, dict(DEFAULTS)))
        sockets = [
            self.page(f"/live?says=1&devices=one&device={device_id}", device_id),
            self.page("/live/overview?says=1", device_id), self.page("/live/alerts", device_id), self.window(),
        ]  # fmt: skip
        for number in range(STATES_COUNT):
            device.send(_state(now_s(), Mode.GUIDING if leads else Mode.READY, 0.1 * number))
        device.send(DepthImage(now_s(), SILHOUETTE))
        self.events_count += 1
        device.send(Event(self.events_count, now_s(), "cue", "Move forward."))
        device.next(EventConfirmed)
        last_s = now_s()
        device.send(_state(last_s, Mode.ARRIVED if leads else Mode.READY, 0.5))
        until(hub, lambda known: known.state is not None and known.state.stamp_s == last_s)
        for socket in (*sockets, device.socket):
            # What has come and nobody has read is not waited for.
            socket.close_timeout = 0.05
            socket.close()
            if socket.keepalive_thread is not None:
                socket.keepalive_thread.join(WAIT_S)
        until(hub, lambda known: known.device_id == device_id and not known.connected)

    def later(self, seconds: float) -> None:
        """Move the hub's clock forward."""
        hub, before = self.server.services.hub, self.server.services.hub.now_s
        hub.now_s = lambda: before() + seconds


@pytest.fixture
def room(tmp_path: Path) -> Iterator[Room]:
    save_site(crossing_corridors(1000), tmp_path / "site")
    server = ConsoleServer(ConsoleConfig(tmp_path / "site", tmp_path / "data", port=0))
    server.start()
    try:
        yield Room(server, first_admin(server), server.services.devices.create_token("Glasses", "test"))
    finally:
        server.stop()


def _read(socket: ClientConnection) -> list[dict[str, Any]]:
    data = socket.recv(timeout=WAIT_S)
    assert isinstance(data, bytes)
    length, packed = int.from_bytes(data[:8], "little"), int.from_bytes(data[8:16], "little")
    inner = zstandard.ZstdDecompressor().decompress(data[16 : 16 + packed], max_output_size=length)
    messages: list[dict[str, Any]] = msgspec.msgpack.decode(inner)["messages"]
    return messages


def _state(stamp_s: float, mode: Mode, x_m: float) -> WalkerState:
    action, reason = ("walk", "ok") if mode is Mode.GUIDING else ("stop", "no_route")
    where = (x_m, 0.0, 1.6, 0.0)
    return WalkerState(stamp_s, "localized", action, reason, pose=where, mode=mode, sonar_state="no_echo")  # type: ignore[arg-type]


def settled(holds: Callable[[], bool]) -> None:
    """Wait until what is on its way out has gone."""
    deadline_s = time.monotonic() + WAIT_S
    while not holds():
        assert time.monotonic() < deadline_s, "something never went"
        threading.Event().wait(0.02)


def objects_of_ours() -> Counter[str]:
    """Count the objects that are kept, of our own and viser's types: not those that a thread works with just now."""
    kept = objects_alive()
    for _ in range(3):
        threading.Event().wait(0.05)
        kept &= objects_alive()
    return kept


def objects_alive() -> Counter[str]:
    gc.collect()
    names = (f"{type(each).__module__}.{type(each).__qualname__}" for each in gc.get_objects())
    return Counter(name for name in names if name.startswith(OURS))


def handles_count(but_for: str) -> int:
    """Count this process's open files and sockets; the connections of a database's pool come as they are needed."""
    targets = []
    for handle in Path("/proc/self/fd").iterdir():
        with contextlib.suppress(FileNotFoundError):
            targets.append(os.readlink(handle))
    return sum(but_for not in target for target in targets)


def held_by(room: Room) -> dict[str, object]:
    """Return how much of everything there is, once nobody is there any more."""
    services, scene = room.server.services, room.scene
    websock = scene.embedded.server._websock_server
    shared = websock._broadcast_buffer
    settled(lambda: not (scene.views or services.watching._windows or services.sockets._closers))
    settled(lambda: not scene.embedded._running)
    services.watching.look()
    for ring in services.incidents._rings.values():
        # As if half a minute had passed since.
        ring.let_pass(services.hub.now_s() + 60.0)
    loops = [scene.embedded.loop]
    return {
        "objects": objects_of_ours(),
        "handles": handles_count(but_for="console.sqlite3"),
        "threads": sorted(_plain(thread.name) for thread in threading.enumerate()),
        "tasks": [len(asyncio.all_tasks(loop)) for loop in loops],
        "listeners": [
            len(each._listeners) for each in (services.hub, services.model, services.alerts, services.presence)
        ],
        "session's views": (len(services.views._listeners), len(scene._unsubscribe)),
        "viser's ids": shared.message_counter,
        "viser's messages": len(shared.message_from_id),
        "viser's windows": (len(websock._client_state_from_id), len(websock._live_connections)),
        "viser's cursors": len(shared.generator_cursors),
    }


def _plain(name: str) -> str:
    """A pool's threads come one by one, as they are needed, up to its size."""
    return "pool" if name.startswith(("AnyIO", "asyncio_", "ThreadPool")) else name


def test_ten_times_as_many_rounds_of_devices_pages_and_windows_leave_no_more_behind(room: Room) -> None:
    for _ in range(FEW):
        room.round()
    few = held_by(room)
    for _ in range(9 * FEW):
        room.round()
    many = held_by(room)
    grown = many.pop("objects") - few.pop("objects")  # type: ignore[operator]
    few_threads, many_threads = set(few.pop("threads")), set(many.pop("threads"))  # type: ignore[call-overload]
    assert many_threads <= few_threads | {"pool"}
    few_handles, many_handles = few.pop("handles"), many.pop("handles")
    assert many_handles <= few_handles + FEW, "some are on their way out"  # type: ignore[operator]
    assert many == few
    # A thread of a pool that came late keeps what it did last; a device is watched for each kind of alert from then on.
    late = max(FEW, len(RULES))
    assert {name: count for name, count in grown.items() if count > late} == {}


def test_devices_that_never_come_back_are_forgotten_but_for_one_that_is_missed(room: Room) -> None:
    services, scene = room.server.services, room.scene
    room.round(leads=False)
    missed = DialledDevice(room.admin.url, room.token, hello_of(room.server, "missed"))
    missed.send(_state(services.hub.now_s(), Mode.GUIDING, 0.0))
    until(services.hub, lambda known: known.device_id == "missed" and known.state is not None)
    services.alerts.check()
    missed.socket.close()
    until(services.hub, lambda known: known.device_id == "missed" and not known.connected)
    few = held_by(room)["objects"]
    for number in range(10):
        room.round(f"stranger-{number}", leads=False)
    services.alerts.check()
    assert len(services.hub.devices()) == 12
    room.later(FORGOTTEN_AFTER_S + 60.0)
    gone = services.hub.forget_away(but_for=services.alerts.concerned_ids())
    assert set(gone) == {"glasses", *(f"stranger-{number}" for number in range(10))}
    settled(lambda: set(scene._trails) == {"missed"})
    assert {device.device_id for device in services.hub.devices()} == {"missed"}
    services.alerts.check()
    assert {each.record.device_id for each in services.alerts.active()} >= {"missed"}
    assert set(services.alerts._watches) == {"missed"}
    grown = held_by(room)["objects"] - few  # type: ignore[operator]
    assert {name: count for name, count in grown.items() if count >= 5} == {}
    # Whoever comes back is met as after a restart of the console.
    room.round("stranger-3", leads=False)
    assert services.hub.device("stranger-3").events[-1].text == "Move forward."


def test_a_device_that_has_left_holds_no_messages_in_memory(room: Room) -> None:
    room.round()
    incidents = room.server.services.incidents
    (ring,) = incidents._rings.values()
    assert len(ring._records) > STATES_COUNT
    room.later(60.0)
    incidents.write()
    assert len(ring._records) == 0
    assert {record.data for record in ring.from_time(0.0)[0]}, "what stays true is still known"


def test_ten_times_as_many_cycles_and_files_of_a_device_leave_no_more_in_it(tmp_path: Path) -> None:
    options = RecordingOptions(tmp_path, max_part_bytes=150_000, max_total_bytes=600_000, keep_free_bytes=0)
    recorder = WalkRecorder(options)
    with ExitStack() as stack:
        stack.callback(recorder.close)
        rig = Rig(tap=recorder)

        def cycles(count: int) -> tuple[Counter[str], int, int]:
            for number in range(count):
                if number % 20 == 0:
                    rig.agent.submit(SetDestination("bar"))
                rig.cycles(1)
                recorder.check()
            rig.agent.settle()
            _forget_what_fakes_keep(rig)
            return objects_of_ours(), len(os.listdir("/proc/self/fd")), threading.active_count()

        few, many = cycles(60), cycles(MORE_CYCLES)
        grown = many[0] - few[0]
        # What the loop remembers of the last second is there at one time, and at another it is not.
        assert {name: count for name, count in grown.items() if count > MORE_CYCLES // 2} == {}
        assert many[1] <= few[1]
        newest = PartName.of(parts_in(tmp_path)[-1])
        assert newest is not None
        assert newest.part > 1, "files have turned over"
        assert sum(path.stat().st_size for path in parts_in(tmp_path)) <= options.max_total_bytes


def _forget_what_fakes_keep(rig: Rig) -> None:
    """The fakes of hardware and link write down all that they are given."""
    for fake in (rig.output, rig.uplink):
        for kept in vars(fake).values():
            if isinstance(kept, list):
                kept.clear()


def test_a_line_through_readings_heeds_no_outlier_and_tells_growth_from_none() -> None:
    hours = np.arange(1, 49) / 6.0
    rng = np.random.default_rng(1)
    flat = 300.0 + rng.normal(0.0, 0.5, 48)
    flat[::12] += 200.0
    grows = flat + 4.0 * hours
    for values, slope in ((flat, 0.0), (grows, 4.0)):
        found = trend("memory", list(hours), list(values))
        assert found.low_per_h <= slope <= found.high_per_h
        assert found.high_per_h - found.low_per_h < 1.0
    assert trend("nothing", list(hours), [0.0] * 48).ratio == 1.0

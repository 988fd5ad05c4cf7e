"""The parts of ``long_run`` about the console: hours of a walker's messages, of people, and of the 3D scene."""

from __future__ import annotations

import asyncio
import json
import os
import shutil
import sqlite3
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx
import numpy as np
from websockets.sync.client import connect

from benchmarks.console_process import RunningConsole, console_again, console_process, corridor
from benchmarks.editor import opened, read, windows
from benchmarks.growth import Machine, Reading, folder_mb, process_reading
from benchmarks.monitor_browsers import Page, Seen, console_page, look, overview_page
from benchmarks.monitor_devices import Told, burst_all
from console.config import ConsoleConfig
from console.server import ConsoleServer
from console.store import DATABASE_FILE
from console.viewer.scene import Scene
from navcore.geometry import FloatArray
from navcore.modes import Mode
from navcore.site import save_site
from navcore.wire import PROTOCOL_VERSION, ConsoleMessage, Hello, WalkerState

STEP_MINUTES = 10.0
STATES_HZ = 20.0
BROADCAST_HZ = 80.0
"""What a live scene would send to everybody, were it shared: the rate of design note 1.5."""
DAYS = (0, 1, 7, 30)
COMPARED_COUNT = 5
_WHOLE_SCENE = {"/map/cloud/points", "/graph/edges"}
_ALERTS = Page("/live/alerts", None)
_SILENT_S = 7.0
"""Of a device that leads somebody: an alert, and an incident."""
_DEVICE = "glasses-0"
Readings = tuple[list[float], list[Reading]]


@dataclass(frozen=True, slots=True)
class Plan:
    """How long a part goes on."""

    hours: float
    """Simulated."""
    until_s: float
    """And no longer than this (monotonic clock)."""

    def steps(self) -> Iterator[int]:
        """Yield the number of each ten minutes, from 1 on, until time is up."""
        for number in range(1, round(60.0 * self.hours / STEP_MINUTES) + 1):
            if time.monotonic() >= self.until_s:
                return
            yield number


class People:
    """Somebody at the console, who now and then does what people do there."""

    def __init__(self, console: RunningConsole) -> None:
        self._console = console
        self.http = httpx.Client(
            base_url=console.url, headers={"Origin": console.url, "Cookie": console.cookie}, trust_env=False,
            timeout=60.0,
        )  # fmt: skip
        self.refused: Counter[str] = Counter()
        """What was answered to what could not be done."""

    def do(self, number: int) -> None:
        """Edit, publish, try settings, speak, keep an incident, acknowledge alerts, delete what is too old."""
        name = {"edit": "add_poi", "name": f"Place {number}", "kind": "room", "x_m": 1.0 + number % 28, "y_m": 0.0}
        self._post("/api/edits", name)
        if number % 2:
            self._post("/api/undo", {})
        else:
            # The checker finds the corridor, a box of random points, in the way.
            version = self.http.get("/api/graph").json()["version"]
            self._post("/api/publish", {"version": version, "confirmed": True})
        self._post(f"/api/devices/{_DEVICE}/say", {"text": f"Sentence {number}."})
        self._post(f"/api/devices/{_DEVICE}/keep", {})
        revision = self.http.get(f"/api/devices/{_DEVICE}/settings").json().get("revision")
        changes = {"planning.route_spacing_m": 0.1 if number % 2 else 0.2}
        self._count(
            self.http.patch(f"/api/devices/{_DEVICE}/settings", json={"changes": changes, "seen_revision": revision})
        )
        for each in self.http.get("/api/alerts").json()["active"]:
            self._post(f"/api/alerts/{each['id']}/acknowledge", {"note": "seen"})
        if number % 6 == 0:
            self._post("/api/privacy/delete", {})

    def _post(self, path: str, body: dict[str, Any]) -> None:
        self._count(self.http.post(path, json=body))

    def _count(self, answer: httpx.Response) -> None:
        assert answer.status_code < 500, answer.text
        if answer.status_code >= 400:
            self.refused[f"{answer.request.url.path.rsplit('/', 1)[1]}: {answer.json()['error']}"] += 1


def whole_scene_s(url: str, cookie: str) -> float:
    """Return how long a new window waits until it has map and graph."""
    began_s, waited_for = time.perf_counter(), set(_WHOLE_SCENE)
    socket = opened(url, cookie)
    socket.close_timeout = 0.1
    while waited_for:
        waited_for -= {message.get("name") for message in read(socket)}
    took_s = time.perf_counter() - began_s
    socket.close()
    return took_s


def first_message_s(url: str, cookie: str) -> float:
    """Return how long a new page waits for the first message of its live stream."""
    began_s = time.perf_counter()
    with connect(
        f"{url.replace('http', 'ws', 1)}/live?says=1&devices=one&device={_DEVICE}", origin=url,  # type: ignore[arg-type]
        additional_headers={"Cookie": cookie}, compression=None, proxy=None, max_size=None, close_timeout=0.1,
    ) as socket:  # fmt: skip
        socket.recv()
        return time.perf_counter() - began_s


def joining(console: RunningConsole) -> dict[str, float]:
    """Return how long somebody who comes now waits: the middle of three."""
    cookie = console.cookie
    return {
        "console: new window until whole scene, ms": 1e3
        * float(np.median([whole_scene_s(console.url, cookie) for _ in range(3)])),
        "console: new page until /live's first message, ms": 1e3
        * float(np.median([first_message_s(console.url, cookie) for _ in range(3)])),
    }


def in_bursts(console: RunningConsole, devices: ProcessPoolExecutor, told: Told) -> tuple[Told, dict[str, float]]:
    """Let ten minutes of a walker's messages come in as fast as they are taken; return how old a page gets them."""

    async def seen_on_a_page() -> tuple[Told, Seen]:
        seen, until_s = Seen(), time.monotonic() + 86_400.0
        looking = asyncio.create_task(look(console.url, console.cookie, console_page(_DEVICE), until_s, seen))
        walked = await asyncio.get_running_loop().run_in_executor(
            devices, burst_all, console.socket_url, console.tokens[0], STEP_MINUTES, told
        )
        looking.cancel()
        await asyncio.gather(looking, return_exceptions=True)
        return walked, seen

    told, seen = asyncio.run(seen_on_a_page())
    return told, _delays(seen.delays_s(0.0, time.monotonic()))


def _delays(delays_s: FloatArray) -> dict[str, float]:
    return {
        "console: capture to page in a burst, median, ms": 1e3 * float(np.median(delays_s)),
        "console: capture to page in a burst, p99, ms": 1e3 * float(np.percentile(delays_s, 99)),
    }


def beside_a_fresh_one(aged: RunningConsole, folder: Path, devices: ProcessPoolExecutor, told: Told) -> list[str]:
    """Compare a console that has run for hours with one just begun, for who comes now and for who looks already.

    In turn, so that whatever else the machine does falls on both. The fresh one has a copy of the other's data.
    """
    copy = folder / "copy"
    copy.mkdir()
    with closing(sqlite3.connect(aged.data_folder / DATABASE_FILE)) as source:
        (copy / "data").mkdir()
        with closing(sqlite3.connect(copy / "data" / DATABASE_FILE)) as target:
            source.backup(target)
    shutil.copytree(folder / "site", copy / "site")
    compared: list[tuple[dict[str, float], dict[str, float]]] = []
    with console_again(copy, aged) as fresh:
        # The first time is not counted: a console just begun has to get going.
        for _ in range(1 + COMPARED_COUNT):
            both = []
            for each in (aged, fresh):
                told, delays = in_bursts(each, devices, told)
                both.append(joining(each) | delays)
            compared.append((both[0], both[1]))
    lines = [
        "| beside a console that has just begun, with the same data | aged | fresh | ratio |",
        "| --- | --- | --- | --- |",
    ]
    for name in compared[0][0]:
        old, new = (float(np.median([each[which][name] for each in compared[1:]])) for which in (0, 1))
        lines.append(f"| {name} | {old:.4g} | {new:.4g} | {old / new:.2f} |")
    return lines


def kept(console: RunningConsole) -> dict[str, float]:
    """Return how much the console keeps on its disk."""
    data = console.data_folder
    return {
        "console: database, MB": folder_mb(data, "console.sqlite3"),
        "console: its write-ahead log, MB": folder_mb(data, "console.sqlite3-wal"),
        "console: incidents, MB": folder_mb(data / "incidents"),
        "console: recordings received, MB": folder_mb(data / "recordings"),
    }


# ----------------------------------------------------------------------------------------------------- the device
def device(plan: Plan, size: str, rate_hz: float, seed: int, folder: Path) -> Readings:
    """Let a real device walk beside a real console; read both every ten minutes of the device's time."""
    at_h: list[float] = []
    readings: list[Reading] = []
    with console_process(folder / "console", 1) as console:
        people = People(console)
        with Machine() as machine, _walking(folder / "device", console, plan.hours, size, rate_hz, seed) as process:
            assert process.stdin is not None
            assert process.stdout is not None
            for line in process.stdout:
                told = json.loads(line)
                held = process_reading(process.pid, "device") | process_reading(console.pid, "console")
                at_h.append(told["hours"])
                readings.append(held | told["figures"] | kept(console) | machine.reading())
                people.http.post(f"/api/devices/{_DEVICE}/say", json={"text": f"Sentence {len(at_h)}."})
                _progress("device", told["hours"], plan, told["took_s"])
                if time.monotonic() >= plan.until_s:
                    # It walks on when it has read a line, and ends where there is none to come.
                    break
                process.stdin.write("\n")
                process.stdin.flush()
        stored = len(console.stored_sequences(_DEVICE))
    print(
        f"device: {told['cycles']:,} cycles in {told['took_s']:.0f} s of real time, {told['spoken']:,} sentences"
        f" spoken, {stored:,} events stored by the console; decisions: {told['actions']}; the link: {told['link']}"
    )
    return at_h, readings


@contextmanager
def _walking(
    folder: Path, console: RunningConsole, hours: float, size: str, rate_hz: float, seed: int
) -> Iterator[subprocess.Popen[str]]:
    folder.mkdir()
    arguments = map(str, (folder, console.socket_url, console.tokens[0], hours, size, rate_hz, seed))
    command = [sys.executable, "-m", "benchmarks.long_run_device", *arguments]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        try:
            yield process
            assert process.stdin is not None
            process.stdin.close()
            assert process.wait() == 0
        finally:
            process.kill()


# ---------------------------------------------------------------------------------------------------- the console
def console(plan: Plan, folder: Path, devices: ProcessPoolExecutor) -> tuple[Readings, list[str]]:
    """Let so many hours of a walker's messages come in as fast as they are taken, while people watch and work."""
    at_h: list[float] = []
    readings: list[Reading] = []
    with console_process(folder, 1) as running, Machine() as machine:
        people, told = People(running), Told(_DEVICE)
        pages = (console_page(_DEVICE), overview_page([_DEVICE]), _ALERTS)

        async def all_of_it() -> Told:
            nonlocal told
            until_s, loop, began_s = time.monotonic() + 86_400.0, asyncio.get_running_loop(), time.monotonic()
            seen = [Seen() for _ in pages]
            looking = [
                asyncio.create_task(look(running.url, running.cookie, page, until_s, each))
                for page, each in zip(pages, seen, strict=True)
            ]
            for number in plan.steps():
                from_s = time.monotonic()
                bursts = loop.run_in_executor(
                    devices, burst_all, running.socket_url, running.tokens[0], STEP_MINUTES, told
                )
                # In the middle of it, while the device is there.
                await asyncio.to_thread(people.do, number)
                told = await bursts
                delays_s = seen[0].delays_s(from_s, time.monotonic())
                if number % 6 == 0:
                    await asyncio.sleep(_SILENT_S)
                held = process_reading(running.pid, "console") | kept(running)
                held |= _delays(delays_s)
                readings.append(held | await asyncio.to_thread(joining, running) | machine.reading())
                at_h.append(number * STEP_MINUTES / 60.0)
                _progress("console", at_h[-1], plan, time.monotonic() - began_s)
            for task in looking:
                task.cancel()
            await asyncio.gather(*looking, return_exceptions=True)
            counts = [f"{page.path} {each.messages_count:,}" for page, each in zip(pages, seen, strict=True)]
            print(f"messages to pages: {', '.join(counts)}")
            return told

        told = asyncio.run(all_of_it())
        events_count, links_count = told.events_count, told.links_count
        compared = beside_a_fresh_one(running, folder, devices, told)
        stored = running.stored_sequences(_DEVICE)
        incidents = len(list((running.data_folder / "incidents").iterdir()))
    lost = len(set(range(1, events_count + 1)) - set(stored))
    print(
        f"console: {round(at_h[-1] * 3600 * STATES_HZ):,} states over {links_count:,} links, {events_count:,}"
        f" events ({lost} not stored), {incidents} incidents"
    )
    print(f"of what people asked for, was refused: {dict(people.refused) or 'nothing'}")
    return (at_h, readings), compared


# ----------------------------------------------------------------------------------------------------- the viewer
class _Nowhere:
    """The way to a device that hears nothing."""

    def send(self, message: ConsoleMessage) -> None:
        """Drop it."""

    def close(self, code: int, reason: str) -> None:
        """Nothing to close."""


def viewer(plan: Plan, folder: Path) -> tuple[Readings, list[str]]:
    """Let the scene look as often as in so many hours, with a window that stays and others that come and go."""
    save_site(corridor(), folder / "site")
    server = ConsoleServer(ConsoleConfig(folder / "site", folder / "data", port=0))
    accounts, hub = server.services.accounts, server.services.hub
    token = accounts.first_admin_link_token()
    assert token is not None
    user_id = accounts.use_link(token, "Ada", "a long pass phrase 42").id
    url = server.start().url
    cookie = f"vbr_session_{url.rsplit(':', 1)[1]}={accounts.start_session(user_id)}"
    scene: Scene = server._stop_scene.__self__  # type: ignore[attr-defined]
    hub.connect(Hello(PROTOCOL_VERSION, _DEVICE, "benchmark", "corridor", "none", 1, 0, hub.now_s()), "G", _Nowhere())
    at_h: list[float] = []
    readings: list[Reading] = []
    ticks_count, began_s = round(60.0 * STEP_MINUTES * STATES_HZ), time.monotonic()
    try:
        with windows(url, [cookie], "/graph/edges"):
            for number in plan.steps():
                asyncio.run_coroutine_threadsafe(_ticks(scene, ticks_count), scene.embedded.loop).result()
                joined_s = [whole_scene_s(url, cookie) for _ in range(3)]
                held = process_reading(os.getpid(), "viewer's console") | _buffered(scene)
                readings.append(held | {"viewer: new window until whole scene, ms": 1e3 * float(np.median(joined_s))})
                at_h.append(number * STEP_MINUTES / 60.0)
                _progress("viewer", at_h[-1], plan, time.monotonic() - began_s)
        return (at_h, readings), _after_days(scene, url, cookie)
    finally:
        server.stop()


async def _ticks(scene: Scene, count: int) -> None:
    hub = scene._services.hub
    for number in range(count):
        x_m = 15.0 + 14.0 * np.sin(number / 200.0)
        now_s = hub.now_s()
        hub.receive(
            _DEVICE,
            WalkerState(
                now_s, "localized", "walk", "ok", pose=(x_m, 0.1, 1.6, 0.01 * (number % 600)), position_std_m=0.03,
                direction_rad=0.05, sub_goal=(x_m + 2.0, 0.0), deviation_m=0.1, speed_m_s=0.8, mode=Mode.GUIDING,
                destination_id="bar", last_cue=f"Move forward, {number}.", last_cue_stamp_s=now_s,
            ),
        )  # fmt: skip
        scene.tick()
        await asyncio.sleep(0.0)


def _buffered(scene: Scene) -> dict[str, float]:
    websock = scene.embedded.server._websock_server
    shared, states = websock._broadcast_buffer, websock._client_state_from_id
    return {
        "viewer: ids of shared messages ever given": shared.message_counter,
        "viewer: shared messages kept for newcomers": len(shared.message_from_id),
        "viewer: messages waiting for windows": sum(
            len(each.message_buffer.message_from_id) for each in states.values()
        ),
        "viewer: messages sent to the window that stays": next(iter(states.values())).message_buffer.message_counter,
        "viewer: windows known": len(scene.views),
        "viewer: tasks in the scene's loop": len(asyncio.all_tasks(scene.embedded.loop)),
    }


def _after_days(scene: Scene, url: str, cookie: str) -> list[str]:
    """Measure how long a newcomer waits as it is, and as it would be had a live scene been shared for so long."""
    shared = scene.embedded.server._websock_server._broadcast_buffer
    as_it_is = shared.message_counter
    lines = [
        f"Shared message ids after the run: {as_it_is}, as at its start: after 1, 7 or 30 days as well. Had the live"
        f" scene been shared ({BROADCAST_HZ:g} messages a second), a new window would wait:",
        "",
        "| days | ids | until the whole scene, s |",
        "| --- | --- | --- |",
    ]
    for days in DAYS:
        shared.message_counter = as_it_is + round(BROADCAST_HZ * 86_400 * days)
        lines.append(f"| {days} | {shared.message_counter:,} | {whole_scene_s(url, cookie):.2f} |")
    shared.message_counter = as_it_is
    return lines


def _progress(what: str, at_h: float, plan: Plan, took_s: float) -> None:
    sys.stderr.write(f"{what}: {at_h:.2f} of {plan.hours:g} h after {took_s:.0f} s\n")
    sys.stderr.flush()

"""A map walk ordered in a real Chromium: begun, watched, ended, its recording arrives, and a map is built of it."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import pytest
from browser import become_admin, chromium, until
from console_room import DialledDevice, Person, hello_of, serving
from map_walk_rig import walk_frames
from playwright.sync_api import Page

from console.server import ConsoleServer
from device_agent.adapters.clocks import SystemClock
from device_agent.adapters.fakes import FakeLocalizer, FakeOutput, FakeSonar
from device_agent.agent import DeviceAgent, DeviceParts
from device_agent.journal import EventJournal
from device_agent.link import ConsoleLink
from device_agent.link_settings import LinkSettings
from device_agent.map_walk.map_walks import DeviceMapWalks, WalkPlan
from device_agent.simulation.sensors import head_camera
from device_agent.state import DeviceState
from navcore.modes import Mode
from navcore.settings import Settings
from navcore.site import Site, load_site, map_checksum, save_site
from navcore.types import CameraIntrinsics, Frame, Localization, LocalizationQuality
from navcore.wire import BeginMapWalk, WalkerState

pytestmark = pytest.mark.browser
BUILD_S = 180.0


class WalkingCamera:
    """A camera that is carried to and fro through the simulated room, in real time."""

    def __init__(self, clock: SystemClock) -> None:
        self._clock, self._count = clock, 0
        there = walk_frames(max_length_m=3.0)
        self._frames = [*there, *reversed(there)]
        self.intrinsics: CameraIntrinsics = head_camera(320, 240)

    def read(self) -> Frame:
        """Return the next picture, a tenth of a second after the last one."""
        self._clock.sleep_until(self._clock.now_s() + 0.1)
        self._count += 1
        return replace(self._frames[self._count % len(self._frames)], stamp_s=self._clock.now_s())

    def close(self) -> None:
        """Nothing to close."""


@contextmanager
def glasses_on(server: ConsoleServer, token: str, folder: Path) -> Iterator[DeviceAgent]:
    """A device that is joined to the console, everything in it real but its sensors."""
    clock, stopped = SystemClock(), threading.Event()
    camera = WalkingCamera(clock)
    url = server.ready.url.replace("http", "ws", 1)
    journal = EventJournal(folder / "events.sqlite")
    settings = LinkSettings(url, token, folder / "incoming", map_walks=folder / "map-walks")
    link = ConsoleLink(settings, journal, clock)
    plan = WalkPlan(folder / "map-walks", folder / "site", owns_map=False)
    walks = DeviceMapWalks(
        plan, camera.intrinsics, lambda *_: FakeLocalizer(_lost), lambda order: agent.submit(order),
        show=link.map_walk, handed_over=link.recording_waits,
    )  # fmt: skip
    parts = DeviceParts(
        clock, camera, FakeSonar(clock), FakeOutput(), link, lambda *_: FakeLocalizer(_lost), map_walks=walks
    )
    site = server.services.model.site
    state = DeviceState(Settings(), site.poi_graph, site.site_id, server.services.package.checksum)
    agent = DeviceAgent(parts, state, FakeLocalizer(_lost))
    agent.announce()
    link.start(agent)
    loop = threading.Thread(target=agent.run, args=(stopped,), daemon=True)
    loop.start()
    try:
        yield agent
    finally:
        stopped.set()
        loop.join()
        walks.close()
        link.stop()
        journal.close()


def _lost(frame: Frame) -> Localization:
    return Localization(frame.stamp_s, LocalizationQuality.LOST, None, None, 0)


@pytest.fixture
def page() -> Iterator[Page]:
    with chromium() as browser:
        context = browser.new_context(viewport={"width": 1100, "height": 1000})
        page = context.new_page()
        page.set_default_timeout(60_000)
        yield page
        context.close()


def test_a_map_walk_is_begun_watched_and_ended_and_a_map_is_built_of_its_recording(
    tmp_path: Path, small_site: Site, page: Page
) -> None:
    save_site(small_site, tmp_path / "site")
    before = map_checksum(tmp_path / "site")
    with serving(tmp_path / "site", tmp_path / "data") as server:
        assert server.ready.first_link is not None
        become_admin(page, server.ready.first_link)
        token = _token(server, page)
        page.goto(f"{server.ready.url}/map-walks")
        until(page, lambda: "The device is not connected" in page.inner_text("#hint"), "no device")
        assert page.locator("#begin").is_disabled()
        with glasses_on(server, token, tmp_path / "device") as agent:
            page.locator("#begin:enabled").click()
            assert agent.state.mode is not Mode.MAPPING, "nothing is begun before somebody says who wears the glasses"
            page.get_by_role("button", name="Yes, begin").click()
            until(page, lambda: "A map walk is being recorded" in page.inner_text("#now"), "the walk")
            until(page, lambda: "accepted" in page.inner_text("#commands"), "the device's answer")
            until(page, lambda: "seen well" in page.inner_text("#advice"), "what is seen")
            until(page, lambda: _recorded_s(page) >= 4, "four seconds of it")
            _shot(page, "map-walk-recording")
            page.locator("#end").click()
            until(page, lambda: "No map walk is being recorded" in page.inner_text("#now"), "the end")
            until(page, lambda: "whole" in page.inner_text("#recordings"), "the recording")
        page.get_by_role("button", name="Build a map: walk-0001").click()
        until(page, lambda: "m of road" in page.inner_text("#recordings"), "a map", BUILD_S)
        _shot(page, "map-walk-built")
        (built,) = server.services.recordings.all()
        assert built.entry.map.stage == "built", built.entry.map.reason
        made = load_site(server.services.builds.folder / built.entry.map.folder)
        assert f"{made.report['road_m']:.0f} m of road" in page.inner_text("#recordings")
        assert "vbr console --site" in page.inner_text("#recordings")
    assert map_checksum(tmp_path / "site") == before, "the map in use is left alone"


def test_the_walk_begins_on_the_device_that_was_asked_about_whichever_is_shown_by_then(
    tmp_path: Path, small_site: Site, page: Page
) -> None:
    save_site(small_site, tmp_path / "site")
    with serving(tmp_path / "site", tmp_path / "data") as server:
        assert server.ready.first_link is not None
        become_admin(page, server.ready.first_link)
        asked_about = _dialled(server, page, "Glasses")
        page.goto(f"{server.ready.url}/map-walks")
        page.locator("#begin:enabled").click()
        assert page.inner_text("#confirm-device") == "Glasses"
        anna = _dialled(server, page, "Anna")
        until(page, lambda: page.input_value("#device-select") == "Anna", "another device, first by its name")
        page.get_by_role("button", name="Yes, begin").click()
        assert isinstance(asked_about.next(BeginMapWalk), BeginMapWalk)
        assert server.services.hub.device("Anna").commands == ()
        # Where that device has gone, nothing is begun anywhere.
        page.reload()
        page.select_option("#device-select", "Glasses")
        page.locator("#begin:enabled").click()
        assert page.inner_text("#confirm-device") == "Glasses", "chosen a moment ago"
        asked_about.socket.close()
        until(page, lambda: page.locator("#begin").is_disabled(), "the device's end")
        page.get_by_role("button", name="Yes, begin").click()
        until(page, lambda: "Glasses is not connected" in page.inner_text("#toasts"), "the refusal")
        assert server.services.hub.device("Anna").commands == ()
        anna.socket.close()


def test_the_page_shows_by_a_sign_what_the_device_does_also_while_somebody_is_led(
    tmp_path: Path, small_site: Site, page: Page
) -> None:
    save_site(small_site, tmp_path / "site")
    with serving(tmp_path / "site", tmp_path / "data") as server:
        assert server.ready.first_link is not None
        become_admin(page, server.ready.first_link)
        device = _dialled(server, page, "Glasses")
        page.goto(f"{server.ready.url}/map-walks")
        for mode in Mode:
            device.send(WalkerState(1000.0, "localized", "walk", "ok", mode=mode))
            until(page, lambda mode=mode: page.get_attribute("#now", "data-mode") == mode.value, mode.value)
            length = page.locator("#now-sign path").evaluate("(path) => path.getTotalLength()")
            assert length > 0.0, f"no sign for {mode.value}"
        device.socket.close()


def _dialled(server: ConsoleServer, page: Page, name: str) -> DialledDevice:
    """Return a device that could begin a map walk."""
    device = DialledDevice(server.ready.url, _token(server, page, name), hello_of(server, device_id=name))
    device.send(WalkerState(1000.0, "lost", "stop", "pose_lost"))
    return device


def _token(server: ConsoleServer, page: Page, name: str = "Glasses") -> str:
    admin = Person(server.ready.url)
    admin.http.cookies.update({cookie["name"]: cookie["value"] for cookie in page.context.cookies()})
    return str(admin.http.post("/api/tokens", json={"name": name}).raise_for_status().json()["token"])


def _recorded_s(page: Page) -> int:
    minutes, seconds = page.locator("#seen dd").first.inner_text().split()[0].split(":")
    return 60 * int(minutes) + int(seconds)


def _shot(page: Page, name: str) -> None:
    """Keep a picture where VBR_SHOTS names a folder: for whoever wants to look."""
    folder = os.environ.get("VBR_SHOTS")
    if folder:
        page.screenshot(path=str(Path(folder) / f"{name}.png"), full_page=True)

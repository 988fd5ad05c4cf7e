"""The page Settings in a real Chromium, with a device that dials: changed, tried out, kept; refused; what-if."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from accessibility import in_both_themes
from browser import become_admin, chromium, until
from console_room import DialledDevice, hello_of, serving
from playwright.sync_api import APIResponse, Page, Route, expect
from recorded_walk import STORED_WALK
from test_past_walks import take

from console.server import ConsoleServer
from device_agent.orders import carry_out
from device_agent.settings_trial import after_trial, running
from device_agent.state import DeviceState
from navcore.modes import Mode
from navcore.planning.poi_graph import PoiGraph
from navcore.settings import Settings
from navcore.site import Site, save_site
from navcore.wire import ApplySettings, KeepSettings, SettingsRunning, WalkerState, decode_from_console

pytestmark = pytest.mark.browser


class Glasses:
    """A device on a real link that carries out orders about its settings as the real one does, in a thread."""

    def __init__(self, server: ConsoleServer) -> None:
        token = server.services.devices.create_token("Glasses", "test")
        self.state = DeviceState(Settings(), PoiGraph(), mode=Mode.READY)
        self.link = DialledDevice(server.ready.url, token, hello_of(server, now_s=time.monotonic()))
        self.link.send(running(self.state))
        self.listens = threading.Event()
        self.listens.set()
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        while not self._ended.is_set():
            try:
                order = decode_from_console(bytes(self.link.socket.recv(timeout=0.1)))  # type: ignore[arg-type]
            except TimeoutError:
                order = None
            self.listens.wait()
            if isinstance(order, (ApplySettings, KeepSettings)):
                self._do(carry_out(self.state, order, time.monotonic()))
            self._do(after_trial(self.state, time.monotonic()))

    def _do(self, step: tuple[DeviceState, tuple[object, ...]]) -> None:
        self.state, effects = step
        for effect in effects:
            if isinstance(effect, SettingsRunning):
                self.link.send(effect)

    def end(self) -> None:
        """Hang up."""
        self.listens.set()
        self._ended.set()
        self._thread.join()
        self.link.socket.close()


@contextmanager
def room(folder: Path, site: Site) -> Iterator[tuple[ConsoleServer, Glasses]]:
    """Serve a console with a recorded walk and a device."""
    save_site(site, folder / "site")
    with serving(folder / "site", folder / "data") as server:
        take(server.services.recordings, STORED_WALK.read_bytes())
        glasses = Glasses(server)
        try:
            yield server, glasses
        finally:
            glasses.end()


@pytest.fixture
def page() -> Iterator[Page]:
    with chromium() as browser:
        context = browser.new_context(viewport={"width": 1280, "height": 900})
        page = context.new_page()
        page.set_default_timeout(60_000)
        yield page
        context.close()


def to_settings(page: Page, server: ConsoleServer) -> None:
    """Come in for the first time, and open the page once the device's settings are on it."""
    assert server.ready.first_link is not None
    become_admin(page, server.ready.first_link)
    page.goto(server.ready.url + "/settings")
    page.locator("#gate-clearance_m:enabled").wait_for()


def put(page: Page, key: str, value: str) -> None:
    """Type a number, and leave the field."""
    page.locator(f"#setting-{key.replace('.', '-')} input[type=number]").fill(value)
    page.keyboard.press("Tab")


def test_settings_are_drafted_judged_tried_out_and_kept(tmp_path: Path, small_site: Site, page: Page) -> None:
    with room(tmp_path, small_site) as (server, glasses):
        to_settings(page, server)
        # Out of range, and out of order with another one: said beside the field, and nothing can be applied.
        put(page, "gate.clearance_m", "99")
        assert "from 0.5 to 4" in page.locator("#gate-clearance_m-problem").inner_text()
        assert page.locator("#draft-apply").is_disabled()
        put(page, "gate.clearance_m", "0.6")
        assert "must be less than" in page.locator("#gate-clearance_m-problem").inner_text()
        put(page, "gate.clearance_m", "1.5")
        put(page, "follower.sub_goal_distance_m", "1.5")
        page.locator("#follower-policy").select_option("paper")
        assert page.locator("#draft-count").inner_text() == "3 changes, 1 of them for safety"
        assert page.locator("#compared tbody tr").count() == 3, "the defaults beside the draft, as it is now"
        # What if: the recorded walk, guided again.
        page.locator("#draft-what-if").click()
        page.locator(".what-if-figures").wait_for(timeout=120_000)
        assert "Different for" in page.locator("#what-if [role=status]").inner_text()
        page.get_by_role("button", name="Next difference").focus()
        page.keyboard.press("Enter")
        assert "Then:" in page.locator(".instant").inner_text()
        assert in_both_themes(page, "a draft and what it would have changed") == []
        # Applied: asked first, tried out, effective on the device, kept.
        page.locator("#draft-apply").click()
        dialog = page.get_by_role("dialog")
        assert "People’s safety hangs on this." in dialog.inner_text()
        assert in_both_themes(page, "asked before it is applied") == []
        dialog.get_by_label("Why? (kept in the log)").fill("Glass doors")
        dialog.get_by_role("button", name="Try it out").click()
        page.get_by_role("button", name="Keep it").wait_for()
        until(page, lambda: glasses.state.settings.gate.clearance_m == 1.5, "the device runs it")
        assert glasses.state.trial is not None
        assert "s left" in page.locator("#trial-left").inner_text()
        assert in_both_themes(page, "being tried out") == []
        page.get_by_role("button", name="Keep it").click()
        until(page, lambda: glasses.state.trial is None, "it is kept")
        page.locator("#trial").wait_for(state="hidden")
        assert glasses.state.settings.follower.policy == "paper"
        row = page.locator("#revisions tr").first
        until(page, lambda: "runs" in row.inner_text() and "Glass doors" in row.inner_text(), "the history tells")
        # Locked while somebody is led, unless it is said why.
        glasses.state = DeviceState(glasses.state.settings, PoiGraph(), settings_revision=1, mode=Mode.GUIDING)
        glasses.link.send(WalkerState(time.monotonic(), "localized", "walk", "ok", mode=Mode.GUIDING))
        until(page, lambda: server.services.hub.device("glasses").leads_somebody, "somebody is led")
        put(page, "gate.clearance_m", "2.0")
        expect(page.locator("#status")).to_contain_text("Somebody is being led: what safety hangs on is locked.")
        page.locator("#draft-apply").click()
        assert "Somebody is being led." in page.get_by_role("dialog").inner_text()
        page.get_by_role("dialog").get_by_label("Why must it be changed now?").fill("Rain")
        page.get_by_role("button", name="Try it out").click()
        page.get_by_role("button", name="Go back now").click()
        until(page, lambda: glasses.state.trial is None and glasses.state.settings_revision == 1, "it went back")
        assert glasses.state.settings.gate.clearance_m == 1.5


def test_an_answer_that_comes_late_or_not_at_all_does_not_stay_on_the_page(
    tmp_path: Path, small_site: Site, page: Page
) -> None:
    with room(tmp_path, small_site) as (server, glasses):
        to_settings(page, server)
        put(page, "gate.clearance_m", "1.5")
        page.locator("#draft-apply").click()
        page.get_by_role("dialog").get_by_role("button", name="Try it out").click()
        runs = page.locator("#revisions tr").first
        expect(runs).to_contain_text("tried out")
        held: list[tuple[Route, APIResponse]] = []

        def hold(route: Route) -> None:
            """Keep back the first answer, lose the second, and let the others pass."""
            asked.append(route.request.url)
            if len(asked) == 1:
                held.append((route, route.fetch()))
            elif len(asked) == 2:
                route.abort()
            else:
                route.continue_()

        asked: list[str] = []
        page.route("**/api/devices/glasses/settings", hold)
        # While the device has not heard yet that it is kept, the page asks; the answer is old when it comes.
        glasses.listens.clear()
        page.get_by_role("button", name="Keep it").click(no_wait_after=True)
        until(page, lambda: held, "the first answer is there")
        glasses.listens.set()
        until(page, lambda: glasses.state.trial is None, "it is kept")
        page.locator("#trial").wait_for(state="hidden")
        route, answer = held[0]
        route.fulfill(response=answer)
        expect(runs.locator(".badge.good")).to_contain_text("runs", timeout=60_000)
        assert len(asked) >= 3, "the second answer was lost, and asked for again"

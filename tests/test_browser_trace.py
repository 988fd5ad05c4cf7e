"""The tab Decision in a real Chromium: a stop by the rangefinder is said, drawn, laid open step by step, and copied."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator

import cv2
import msgspec
import numpy as np
import pytest
from axe_playwright_python.sync_playwright import Axe
from browser import become_admin, chromium, without_tour
from console_room import DialledDevice, hello_of, until
from playwright.sync_api import Page, expect

from console.server import ConsoleServer
from navcore.modes import Mode
from navcore.types import Rule
from navcore.wire import DepthImage, WalkerState
from navcore.wire_trace import DecisionLimits, DecisionTraceView, WireCandidate, WireScan

pytestmark = pytest.mark.browser
LIMITS = DecisionLimits(0.9, 2.0, 3.0, 0.7, math.radians(7.5), 1.0, 0.52, 0.7, 0.17, 1.0, 3.0, 0.3, 3)
STATES = (*(1,) * 10, *(0,) * 41, *(3,) * 10)
"""Right to left: something, free, unknown."""
SCAN = WireScan(math.radians(-30.0), math.radians(1.0), STATES, tuple(150 * (each == 1) for each in STATES))
TRACE = DecisionTraceView(Rule.GATE_CLOSED.value, optimal_rad=0.05, required_m=3.0, limits=LIMITS, scan=SCAN)
GLASS = WalkerState(
    1000.0, "localized", "stop", "obstacle_sonar", "Eq. 5", pose=(1.0, 0.0, 1.6, 0.0), expected_rad=0.05,
    sub_goal=(3.0, 0.1), sub_goal_case=1, candidates=(WireCandidate(0.05, 4.0, True), WireCandidate(-0.4, 1.5)),
    sonar_state="ok", sonar_m=1.4, mode=Mode.GUIDING, trace=TRACE,
)  # fmt: skip
SENTENCE = "Stop: the sonar hears something at 1.4 m where the depth camera sees free: glass?"
LABELS_OVER_EACH_OTHER = """
() => {
  const labels = [...document.querySelectorAll('.polar text.label')].filter((e) => e.textContent);
  const least = 3;  // CSS pixels: boxes are a little larger than letters
  return labels.flatMap((one, index) => labels.slice(index + 1).filter((other) => {
    const [a, b] = [one.getBoundingClientRect(), other.getBoundingClientRect()];
    const wide = Math.min(a.right, b.right) - Math.max(a.left, b.left);
    return wide > least && Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top) > least;
  }).map((other) => `${one.textContent} / ${other.textContent}`));
}
"""
APART = """
async () => {
  const { apart } = await import('/static/trace.js');
  const box = (top, left) => ({ top, left, right: left + 50 });
  return apart([box(0, 0), box(4, 10), box(20, 20), box(5, 200)]);
}
"""
COUNT_NODES = "() => document.querySelectorAll('#panel-trace *').length"


@pytest.fixture
def page(server: ConsoleServer) -> Iterator[Page]:
    with chromium() as browser:
        context = browser.new_context(base_url=server.ready.url, viewport={"width": 1100, "height": 900})
        context.grant_permissions(["clipboard-read", "clipboard-write"], origin=server.ready.url)
        without_tour(context, "Ada")
        opened = context.new_page()
        opened.set_default_timeout(60_000)
        failures: list[str] = []
        opened.on("pageerror", lambda error: failures.append(str(error)))
        assert server.ready.first_link is not None
        become_admin(opened, server.ready.first_link)
        yield opened
        context.close()
        assert failures == []


def drawn(page: Page, name: str) -> str:
    return page.locator(f".polar path.{name}").get_attribute("d") or ""


def test_a_stop_by_the_rangefinder_is_said_drawn_and_copied(page: Page, server: ConsoleServer) -> None:
    token = server.services.devices.create_token("Glasses of Ada", "test")
    device = DialledDevice(server.ready.url, token, hello_of(server))
    device.send(DepthImage(999.2, cv2.imencode(".jpg", np.full((60, 80), 90, np.uint8))[1].tobytes()))
    device.send(GLASS)
    page.get_by_role("tab", name="Decision").click()
    panel = page.locator("#panel-trace")
    expect(panel.locator(".trace-sentence")).to_have_text(SENTENCE)
    picture = page.get_by_role("img", name="What is round the walker, seen from above; ahead is up")
    expect(picture).to_be_visible()
    for name in ("free", "unknown", "edge", "cone", "echo", "gate", "required", "stop-ring", "corridor", "expected",
                 "optimal", "walkable", "narrow"):  # fmt: skip
        assert drawn(page, name), f"{name} is to be seen"
    assert "θ_opt 3° left" in picture.text_content()
    assert "sonar 1.4 m" in picture.text_content()
    assert page.evaluate(LABELS_OVER_EACH_OTHER) == []
    assert page.evaluate(APART) == [0, 13, 26, 5]
    assert not drawn(page, "chosen"), "nobody is told to go anywhere"
    expect(panel.locator("figcaption")).to_have_text("0.8 s before this decision")
    page.get_by_text("Step by step, with figures").click()
    gate = page.get_by_role("row", name="Ultrasonic gate (Eq. 5)")
    expect(gate).to_contain_text("d_sonar 1.4 m, must exceed 2.0 m within 7.5° of straight ahead")
    expect(gate).to_contain_text("decides: stop")
    page.get_by_text("What the marks mean").click()
    for theme in ("light", "dark"):
        page.emulate_media(color_scheme=theme, reduced_motion="reduce")
        found = Axe().run(page, context={"include": [["#panel-trace"]]}).response["violations"]
        assert [(fault["id"], fault["nodes"][0]["html"]) for fault in found] == []
    page.get_by_role("button", name="Copy as text").click()
    expect(page.get_by_text("The decision is copied.")).to_be_visible()
    copied = page.evaluate("navigator.clipboard.readText()")
    assert SENTENCE in copied
    assert "Ultrasonic gate (Eq. 5)" in copied

    nodes = page.evaluate(COUNT_NODES)
    walk = {"action": "walk", "reason": "ok", "direction_rad": -0.4, "sonar_m": None, "sonar_state": "absent"}
    device.send(msgspec.structs.replace(GLASS, stamp_s=1000.1, **walk))
    expect(panel.locator(".trace-sentence")).to_contain_text("Walk 23° right")
    assert drawn(page, "chosen")
    assert not drawn(page, "cone")
    device.send(WalkerState(1000.2, "lost", "stop", "pose_lost"))
    expect(panel.locator(".trace-sentence")).to_have_text("Stop: the place in the map has been unknown.")
    assert not drawn(page, "free"), "nothing of the state before"
    assert "Z" in drawn(page, "unknown"), "nobody looked: that is hatched, and not left blank as if it were free"
    assert page.evaluate(COUNT_NODES) == nodes, "what changes are attributes"
    page.set_viewport_size({"width": 390, "height": 800})
    assert page.evaluate("() => document.documentElement.scrollWidth <= innerWidth"), "nothing juts out on a phone"
    device.socket.close()
    until(server.services.hub, lambda each: not each.connected)
    expect(panel.locator(".trace")).to_have_attribute("data-freshness", "lost")
    assert "grayscale" in panel.locator(".trace-pictures").evaluate("(e) => getComputedStyle(e).filter")


def test_a_wall_that_comes_in_from_beyond_the_picture_is_drawn(page: Page, server: ConsoleServer) -> None:
    token = server.services.devices.create_token("Glasses of Ada", "test")
    device = DialledDevice(server.ready.url, token, hello_of(server))
    # A wall that runs on steadily: the first of it is farther away than the picture shows.
    wall = WireScan(math.radians(-30.0), math.radians(1.0), (1,) * 40, tuple(450 - 4 * index for index in range(40)))
    device.send(msgspec.structs.replace(GLASS, trace=msgspec.structs.replace(TRACE, scan=wall)))
    page.get_by_role("tab", name="Decision").click()
    edge = page.locator(".polar path.edge")
    expect(edge).to_have_attribute("d", re.compile("L"))
    assert edge.evaluate("(path) => path.getTotalLength()") > 0.0, "the browser draws nothing of it"

"""A real Chromium for the tests of the console, and hands for its 3D scene. Skips, with a reason, where there is none.

Software rendering draws few frames: everything here waits for a state, never for a frame or a time.
"""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from console_room import Person
from playwright.sync_api import Browser, BrowserContext, Error, Frame, Page, expect, sync_playwright

ARGUMENTS = (
    "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--disable-background-networking",
    "--disable-component-update", "--disable-sync", "--no-first-run",
    # Where there is no graphics card, putting a page together in software is far less work than emulating one for it.
    "--disable-gpu-compositing",
)  # fmt: skip
# Scenes are drawn in software as often as a machine can, and would leave little of it to what is tested: a few frames
# a second do here. How smooth a scene is, is measured in benchmarks.
# Keys are heard once viser has drawn the panel and its page listens; nothing else tells that it does.
_IN_SCENES = """
if (location.pathname.startsWith('/viewer/scene')) {
  const draw = window.requestAnimationFrame.bind(window);
  const given_up = new Set();
  let drawn_ms = 0;
  window.requestAnimationFrame = (frame) => {
    const id = setTimeout(() => draw((now_ms) => {
      if (given_up.delete(id)) return;
      drawn_ms = performance.now();
      frame(now_ms);
    }), Math.max(0, drawn_ms + 120 - performance.now()));
    return id;
  };
  window.cancelAnimationFrame = (id) => { clearTimeout(id); given_up.add(id); };
  const listen = EventTarget.prototype.addEventListener;
  EventTarget.prototype.addEventListener = function (kind, ...rest) {
    if (this === document.documentElement && kind === 'keydown') window.listensSince_ms = performance.now();
    return listen.call(this, kind, ...rest);
  };
}
"""
WAIT_S = 60.0
expect.set_options(timeout=1e3 * WAIT_S)
POLL_MS = 100
_PROJECT = """
(name) => {
  const viewer = window.__viserMutable;
  const node = viewer && viewer.nodeRefFromName && viewer.nodeRefFromName[name];
  if (!node || !viewer.camera || !viewer.canvas) return null;
  // A pose that was told is applied when the next frame is drawn: until then the node stands somewhere else.
  const parts = name.split('/').slice(1);
  for (let count = 0; count <= parts.length; count++) {
    const pose = viewer.nodePoseData[count ? '/' + parts.slice(0, count).join('/') : ''];
    if (pose && pose.poseUpdateState !== 'updated') return null;
  }
  node.updateWorldMatrix(true, false);
  viewer.camera.updateMatrixWorld();
  const place = node.getWorldPosition(node.position.clone()).project(viewer.camera);
  const box = viewer.canvas.getBoundingClientRect();
  return [box.x + (place.x + 1) / 2 * box.width, box.y + (1 - place.y) / 2 * box.height];
}
"""
_PROJECT_POINT = """
([x, y, z]) => {
  const viewer = window.__viserMutable;
  const map = viewer && viewer.nodeRefFromName && viewer.nodeRefFromName['/map'];
  if (!map || !viewer.camera || !viewer.canvas) return null;
  map.updateWorldMatrix(true, false);
  viewer.camera.updateMatrixWorld();
  const place = map.localToWorld(map.position.clone().set(x, y, z)).project(viewer.camera);
  const box = viewer.canvas.getBoundingClientRect();
  return [box.x + (place.x + 1) / 2 * box.width, box.y + (1 - place.y) / 2 * box.height];
}
"""
_BUTTON = """
([kind, text]) => {
  const found = [...document.querySelectorAll(kind)].find(
    (e) => (e.title || e.textContent || '').includes(text) && e.getClientRects().length);
  if (!found) return null;
  found.scrollIntoView({ block: 'nearest' });
  const box = found.getBoundingClientRect();
  const middle = [box.x + box.width / 2, box.y + box.height / 2];
  // What lies over it would be pressed in its place.
  return found.contains(document.elementFromPoint(...middle)) ? middle : null;
}
"""


_LISTENS = "() => performance.now() - window.listensSince_ms > 500"


def chromium_path() -> Path:
    """Where Chromium is (VBR_CHROMIUM, or the usual names). Skips the test where it is not."""
    named = os.environ.get("VBR_CHROMIUM")
    found = named or shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if not found or not Path(found).exists():
        pytest.skip("there is no Chromium here (apt-get install chromium): the browser tests are left out")
    return Path(found)


@contextmanager
def chromium() -> Iterator[Browser]:
    """Run Chromium until the block ends."""
    path = chromium_path()
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=str(path), args=list(ARGUMENTS))
        new_context = browser.new_context

        def for_tests(**options: Any) -> BrowserContext:
            context = new_context(**options)
            context.add_init_script(_IN_SCENES)
            return context

        browser.new_context = for_tests  # type: ignore[method-assign]
        try:
            yield browser
        finally:
            browser.close()


def until(page: Page, state: Callable[[], Any], what: str, wait_s: float = WAIT_S) -> Any:
    """Wait until a state holds, and return it; fails with what was waited for."""
    end_s = time.monotonic() + wait_s
    while True:
        value = state()
        if value:
            return value
        assert time.monotonic() < end_s, f"waited {wait_s:g} s for: {what}"
        page.wait_for_timeout(POLL_MS)


def opened(page: Page, path: str) -> None:
    """Go to a page of the console, and wait until something can be pressed on it."""
    page.goto(path)
    expect(page.locator("body:not([inert])")).to_be_attached(timeout=1e3 * WAIT_S)


def without_tour(context: BrowserContext, *names: str) -> None:
    """Let people be those who have seen the tour of a first visit in this browser."""
    seen = "".join(f"localStorage['tour-seen-{name}'] = '1';" for name in names)
    context.add_init_script(f"if (self === top && location.protocol.startsWith('http')) {{ {seen} }}")


def become(context: BrowserContext, person: Person, name: str) -> None:
    """Let somebody who is signed in already be who uses this browser: no page is loaded for it."""
    without_tour(context, name)
    ((cookie, value),) = person.http.cookies.items()
    context.add_cookies([{"name": cookie, "value": value, "url": person.url}])


def become_admin(
    page: Page, first_link: str, name: str = "Ada", password: str = "seven quiet corridors", *, sees_tour: bool = False
) -> None:
    """Open the one-time link of a first start, choose name and password, and arrive at the console."""
    if not sees_tour:
        without_tour(page.context, name)
    page.goto(first_link)
    page.get_by_label("Your name").fill(name)
    page.get_by_label("Password", exact=True).fill(password)
    page.get_by_role("button", name="Save and sign in").click()
    page.wait_for_url(lambda url: url.rstrip("/").count("/") == 2)


class SceneHands:
    """Hands on the 3D scene of a page: either the scene's own page, or the frame in the console's."""

    def __init__(self, page: Page) -> None:
        self.page = page

    @property
    def frame(self) -> Frame:
        """The frame that viser runs in."""
        frames = [frame for frame in self.page.frames if "/viewer/scene" in frame.url]
        assert frames, "this page has no scene"
        return frames[0]

    def wait_for_node(self, name: str) -> None:
        """Wait until a node is in the scene."""
        until(self.page, lambda: self.pixel_of(name), f"the node {name}")

    def pixel_of(self, name: str) -> tuple[float, float] | None:
        """Where the middle of a node is on the page, in CSS pixels; None while it is not in the scene."""
        return self._on_page(self._evaluate(_PROJECT, name))

    def steady_pixel_of(self, name: str) -> tuple[float, float]:
        """Where a node is once camera and node have come to rest."""
        seen: list[tuple[float, float] | None] = []

        def rests() -> tuple[float, float] | None:
            # Between two looks there may be no frame, and nothing moves: several frames are waited for.
            seen.append(self.pixel_of(name))
            last = [place for place in seen[-4:] if place is not None]
            near = all(abs(x - last[-1][0]) + abs(y - last[-1][1]) < 0.5 for x, y in last)
            return last[-1] if len(last) == 4 and near else None

        found: tuple[float, float] = until(self.page, rests, f"{name} at rest")
        return found

    def click_node(self, name: str) -> None:
        """Click on a node."""
        self._press_at(*self.steady_pixel_of(name))
        self.page.mouse.up()

    def drag_node(self, name: str, target: tuple[float, float], steps: int = 12) -> None:
        """Drag a node with the left button to a place on the page."""
        x, y = self.steady_pixel_of(name)
        self._press_at(x, y)
        for step in range(1, steps + 1):
            share = step / steps
            self.page.mouse.move(x + share * (target[0] - x), y + share * (target[1] - y))
            self.page.wait_for_timeout(60)
        self.page.wait_for_timeout(400)
        self.page.mouse.up()

    def click_floor(self, x_m: float, y_m: float, z_m: float = 0.0) -> None:
        """Click where a point of the map is seen, whatever is there."""
        place = self._on_page(until(self.page, lambda: self._evaluate(_PROJECT_POINT, [x_m, y_m, z_m]), "the map"))
        assert place is not None
        self._press_at(*place)
        self.page.mouse.up()

    def _press_at(self, x: float, y: float) -> None:
        # Viser finds what lies under the pointer when it moves: it needs a moment before the press.
        self.page.mouse.move(x + 3, y + 3)
        self.page.mouse.move(x, y)
        self.page.wait_for_timeout(400)
        self.page.mouse.down()

    def press_button(self, text: str, kind: str = "button") -> None:
        """Press a button of the scene's panel (``kind="[role=tab]"`` for a tab)."""
        seen: list[Any] = []

        def rests() -> Any:
            # A tab that has just been opened, or a form that comes, still moves what is on the panel.
            seen.append(self._evaluate(_BUTTON, [kind, text]))
            return seen[-1] if len(seen) > 3 and all(each == seen[-1] for each in seen[-4:]) else None

        on_page = self._on_page(until(self.page, rests, f"the button {text!r}"))
        assert on_page is not None
        self.page.mouse.click(*on_page)

    def press_key(self, key: str) -> None:
        """Press a key while the scene has the focus, once its keys are known to it."""
        until(self.page, lambda: self._evaluate(_LISTENS, None), "the keys of the scene")
        self.frame.evaluate("() => { document.activeElement && document.activeElement.blur(); window.focus(); }")
        self.page.keyboard.press(key)

    def _evaluate(self, script: str, argument: Any) -> Any:
        try:
            return self.frame.evaluate(script, argument)
        except Error:
            # The frame is just being loaded.
            return None

    def _on_page(self, place: list[float] | None) -> tuple[float, float] | None:
        if place is None:
            return None
        if self.frame.parent_frame is None:
            return place[0], place[1]
        box = self.frame.frame_element().bounding_box()
        return (place[0] + box["x"], place[1] + box["y"]) if box is not None else None

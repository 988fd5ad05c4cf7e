"""A real Chromium with the page Console: how old a state is once it is drawn, as the page itself tells.

It draws in software: its frames, and the work of drawing the scene, share the cores with the console.
"""

from __future__ import annotations

import asyncio
import shutil
import time

import numpy as np
from playwright.async_api import async_playwright

from navcore.geometry import FloatArray

_ARGUMENTS = (
    "--no-sandbox",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-background-networking",
)
_NOTE_MS = """
() => {
  const panel = document.getElementById("panel");
  window.capturedToScreenMs = [];
  new MutationObserver(() => window.capturedToScreenMs.push(Number(panel.dataset.captureToScreenMs)))
    .observe(panel, { attributes: true, attributeFilter: ["data-capture-to-screen-ms"] });
}
"""


def chromium_path() -> str:
    """Where Chromium is."""
    path = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    assert path is not None, "there is no Chromium here: apt-get install chromium"
    return path


async def look_with_chromium(
    url: str, cookie: str, device_id: str, from_s: float, until_s: float, *, with_scene: bool
) -> FloatArray:
    """Return, of each state drawn between two times (monotonic clock), the seconds from its capture to the screen."""
    name, value = cookie.split("=", 1)
    async with async_playwright() as playwright:
        browser = await playwright.chromium.launch(executable_path=chromium_path(), args=list(_ARGUMENTS))
        context = await browser.new_context(viewport={"width": 1280, "height": 800})
        await context.add_cookies([{"name": name, "value": value, "url": url}])
        page = await context.new_page()
        if not with_scene:
            await page.route("**/scene/**", lambda route: route.abort())
        await page.goto(f"{url}/?device={device_id}", wait_until="commit")
        # By the clock: Playwright's own waiting counts frames, and these are rare here.
        while not await page.locator("#panel[data-capture-to-screen-ms]").count():
            assert time.monotonic() < until_s, "the page drew no state in all that time: the machine has no time for it"
            await asyncio.sleep(0.1)
        await asyncio.sleep(max(0.0, from_s - time.monotonic()))
        await page.evaluate(_NOTE_MS)
        await asyncio.sleep(max(0.0, until_s - time.monotonic()))
        found_ms = await page.evaluate("window.capturedToScreenMs")
        await browser.close()
    return 1e-3 * np.array(found_ms, dtype=np.float64)

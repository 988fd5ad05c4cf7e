"""The scene in a real Chromium that draws in software: how soon it can be used, and what it takes of a processor.

    python -m benchmarks.scene_chromium [--rounds 3] [--points 5000] [--places 6]

Each round opens it twice, in turn: as it is, and with a picture of surroundings that things mirror, as viser has one
unless told otherwise. The processor time is that of Chromium's process that draws; the windows are 1000 × 600 px, at
half resolution.
"""

from __future__ import annotations

import argparse
import os
import statistics
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from playwright.sync_api import Browser, Page, sync_playwright

from benchmarks.editor import street_grid
from benchmarks.monitor_chromium import chromium_path
from console.config import ConsoleConfig
from console.server import ConsoleServer
from console.viewer.scene import Scene
from navcore.site import save_site

_ARGUMENTS = ("--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--disable-gpu-compositing")
_IS_DRAWN = "() => Boolean(window.__viserMutable?.nodeRefFromName?.['/graph/poi/p0/head'])"
_FRAMES = """
(during_ms) => new Promise((done) => {
  let count = 0;
  const next = () => { count += 1; requestAnimationFrame(next); };
  next();
  setTimeout(() => done(count), during_ms);
})
"""
_SETTLED_S, _WATCHED_S, _WITHIN_S = 8.0, 6.0, 120.0
_TICK_S = 1.0 / os.sysconf("SC_CLK_TCK")


@dataclass(frozen=True, slots=True)
class Opened:
    """One window, from the request for its page on."""

    drawn_s: float
    """Until the first place is in the scene."""
    opening_cpu_s: float
    """What the drawing took until the scene had been there for some seconds."""
    frames_hz: float
    frame_cpu_s: float


def drawing_cpu_s() -> float:
    """Return the processor time of all of Chromium's drawing processes, seconds."""
    total = 0
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            if b"--type=gpu-process" not in (folder / "cmdline").read_bytes():
                continue
            fields = (folder / "stat").read_text(encoding="ascii").rsplit(")", 1)[1].split()
        except OSError:
            continue
        total += int(fields[11]) + int(fields[12])
    return total * _TICK_S


def look(browser: Browser, url: str, session: tuple[str, str]) -> Opened:
    """Open the scene in a new window, and watch it for a while."""
    context = browser.new_context(viewport={"width": 1000, "height": 600})
    context.add_cookies([{"name": session[0], "value": session[1], "url": url}])
    page = context.new_page()
    begun_s, before_s = time.perf_counter(), drawing_cpu_s()
    page.goto(f"{url}/viewer/scene/?fixedDpr=0.5")
    _wait_until_drawn(page)
    drawn_s = time.perf_counter() - begun_s
    page.wait_for_timeout(1e3 * _SETTLED_S)
    opened_s = drawing_cpu_s()
    frames = int(page.evaluate(_FRAMES, 1e3 * _WATCHED_S))
    frame_cpu_s = (drawing_cpu_s() - opened_s) / max(1, frames)
    context.close()
    return Opened(drawn_s, opened_s - before_s, frames / _WATCHED_S, frame_cpu_s)


def _wait_until_drawn(page: Page) -> None:
    end_s = time.perf_counter() + _WITHIN_S
    while not page.evaluate(_IS_DRAWN):
        assert time.perf_counter() < end_s, "the scene was not drawn in all that time: the machine has no time for it"
        page.wait_for_timeout(50)


def measure(arguments: argparse.Namespace, folder: Path) -> None:
    """Measure, and print."""
    save_site(street_grid(arguments.places, 2 * arguments.places, arguments.points), folder / "site")
    server = ConsoleServer(ConsoleConfig(folder / "site", folder / "data", port=0))
    accounts = server.services.accounts
    token = accounts.first_admin_link_token()
    assert token is not None
    session_id = accounts.start_session(accounts.use_link(token, "Ada", "a long pass phrase 42").id)
    url = server.start().url
    scene: Scene = server._stop_scene.__self__  # type: ignore[attr-defined]
    surroundings = scene.embedded.server.scene.configure_environment_map
    ways: dict[str, Callable[[], None]] = {
        "as it is": lambda: surroundings(None), "with surroundings": lambda: surroundings("warehouse"),
    }  # fmt: skip
    found: dict[str, list[Opened]] = {name: [] for name in ways}
    try:
        for _ in range(arguments.rounds):
            for name, choose in ways.items():
                choose()
                # A browser of its own: what it has worked out for one window it keeps for the next.
                with sync_playwright() as playwright:
                    browser = playwright.chromium.launch(executable_path=chromium_path(), args=list(_ARGUMENTS))
                    session = (f"vbr_session_{url.rsplit(':', 1)[1]}", session_id)
                    found[name].append(look(browser, url, session))
                    browser.close()
    finally:
        server.stop()
    for name, windows in found.items():
        middle = [statistics.median(getattr(each, field) for each in windows) for field in Opened.__slots__]
        print(
            f"{name}: the first place after {middle[0]:.1f} s; {middle[1]:.1f} s of a processor until it had been there"
            f" for {_SETTLED_S:g} s; then {middle[2]:.0f} frames a second, {1e3 * middle[3]:.0f} ms of a processor each"
        )


def main() -> None:
    """Run it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--points", type=int, default=5_000)
    parser.add_argument("--places", type=int, default=6)
    with tempfile.TemporaryDirectory() as folder:
        measure(parser.parse_args(), Path(folder))


if __name__ == "__main__":
    main()

"""The product as its users meet it: console and device as two processes, a person at a real browser, a walk."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from browser import SceneHands, become_admin, chromium, until
from playwright.sync_api import Browser, Page

from navcore.site import load_site, save_site

pytestmark = pytest.mark.browser
WALK_S = 240.0
"""The walk takes about 40 s; a machine that is busy drawing makes it slower."""
MAX_POINTS = 8_000


@contextmanager
def vbr(*arguments: str) -> Iterator[subprocess.Popen[bytes]]:
    process = subprocess.Popen([sys.executable, "-m", "device_agent", *arguments], stdin=subprocess.DEVNULL)
    try:
        yield process
    finally:
        process.terminate()
        process.wait(20.0)


def wait_for_file(path: Path, process: subprocess.Popen[bytes]) -> dict[str, Any]:
    end_s = time.monotonic() + 60.0
    while not path.exists():
        assert process.poll() is None, "the console ended by itself"
        assert time.monotonic() < end_s, "the console was not ready within a minute"
        time.sleep(0.05)  # between two looks at a file; another process has no other way to say that it is ready
    ready: dict[str, Any] = json.loads(path.read_text())
    return ready


@pytest.fixture
def site(office_site: Path, tmp_path: Path) -> Path:
    """The office with fewer points in its cloud: a browser that draws in software takes seconds for the rest."""
    whole = load_site(office_site)
    step = max(1, len(whole.cloud_points_m) // MAX_POINTS)
    thin = replace(
        whole,
        cloud_points_m=whole.cloud_points_m[::step],
        cloud_colours_rgb=whole.cloud_colours_rgb[::step],
        cloud_weights=whole.cloud_weights[::step],
        cloud_view_counts=whole.cloud_view_counts[::step],
        cloud_sessions=whole.cloud_sessions[::step],
    )
    for name in ("console-site", "device-site"):
        save_site(thin, tmp_path / name)
    return tmp_path


@pytest.fixture
def browser() -> Iterator[Browser]:
    with chromium() as browser:
        yield browser


@pytest.fixture
def page(browser: Browser) -> Iterator[Page]:
    context = browser.new_context(viewport={"width": 1000, "height": 640})
    page = context.new_page()
    page.set_default_timeout(60_000)
    yield page
    context.close()


def test_a_caregiver_signs_in_picks_a_destination_and_sees_the_walker_arrive(site: Path, page: Page) -> None:
    ready_file, token_file = site / "ready.json", site / "glasses.token"
    console = vbr(
        "console", "--site", str(site / "console-site"), "--data", str(site / "data"), "--port", "0",
        "--ready-file", str(ready_file), "--device-token-file", str(token_file),
    )  # fmt: skip
    with console as process:
        ready = wait_for_file(ready_file, process)
        device = vbr(
            "device", "--site", str(site / "device-site"), "--state", str(site / "state"), "--quiet",
            "--console", ready["url"].replace("http", "ws", 1), "--token-file", str(token_file), "--simulated",
        )  # fmt: skip
        with device as glasses:
            become_admin(page, ready["first_link"])
            _see_the_place_in_the_scene(page)
            _walk_to(page, "Wash room")
            assert glasses.poll() is None


def _see_the_place_in_the_scene(page: Page) -> None:
    hands = SceneHands(page)
    until(page, lambda: any("/viewer/scene" in frame.url for frame in page.frames), "the scene's frame")
    hands.wait_for_node("/graph/poi/wash-room/head")


def _walk_to(page: Page, name: str) -> None:
    destination = page.get_by_label("Destination")
    until(page, lambda: name in destination.inner_text(), "the destinations")
    destination.select_option(label=name)
    page.locator("#guide").click()
    until(page, lambda: "Walking to" in page.inner_text("body"), "the walk")
    until(page, lambda: f"Arrived at {name}" in page.inner_text("body"), "the arrival", WALK_S)
    assert "You have arrived" in page.inner_text("body")

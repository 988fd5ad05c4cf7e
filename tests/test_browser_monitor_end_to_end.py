"""The product as its users meet it: console and device as processes, a network between them that can fail, a walk.

A viewer, an editor and a technician each have a browser window of their own; the walk is seen from its start to the
arrival, through a dead stretch of the link, becomes a recorded walk by itself, and is asked what other settings would
have changed.
"""

from __future__ import annotations

import json
import re
import shutil
import sqlite3
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pytest
from accessibility import in_both_themes
from browser import SceneHands, become, chromium, until
from console_room import Person, invited
from link_processes import surroundings
from link_proxy import Network
from playwright.sync_api import Browser, Page, expect

from console.live import DELAYED_AFTER_S, LOST_AFTER_S, STALE_AFTER_S
from console.store import DATABASE_FILE
from device_agent.device_store import DeviceStore
from device_agent.logs import FILE_NAME
from navcore.site import load_site, save_site

pytestmark = pytest.mark.browser
WALK_S = 480.0
"""The walk takes about 40 s; a machine that is busy drawing makes it slower."""
REDIAL_S = 120.0
FIRST_START_S = 300.0
"""Where nothing has run yet, the device compiles first."""
MAX_POINTS = 8_000
TARGET_PX = 44
ROLES = {"Vera": "viewer", "Edda": "editor", "Tess": "technician"}

NOTE_FRESHNESS = """
() => {
  window.freshness = [];
  const badge = document.getElementById("freshness");
  new MutationObserver(() => window.freshness.push(badge.textContent))
    .observe(badge, { childList: true, characterData: true, subtree: true });
}
"""
WALKER_PLACE = "() => window.__viserMutable?.nodeRefFromName?.['/walker']?.position?.toArray() ?? null"
FILTER = "e => getComputedStyle(e).filter"
SIDEWAYS_PX = "document.documentElement.scrollWidth - document.documentElement.clientWidth"
SMALL_TARGETS = """
(least) => [...document.querySelectorAll("button, select, input, summary, a.button, a.badge")]
  .filter((e) => e.checkVisibility({ visibilityProperty: true }))
  .map((e) => [e.closest("label") ?? e, e])
  .filter(([target]) => { const box = target.getBoundingClientRect(); return box.width > 1 && box.height < least; })
  .map(([target, e]) => `${Math.round(target.getBoundingClientRect().height)} px: ${e.outerHTML.slice(0, 110)}`)
"""
SAME_NAMES = """
() => {
  const names = [...document.querySelectorAll("[id]")].map((e) => e.id);
  return [...new Set(names.filter((name, index) => names.indexOf(name) !== index))];
}
"""


@dataclass
class Stage:
    """Two processes, the network between them, and people with browsers."""

    folder: Path
    url: str
    network: Network
    glasses: subprocess.Popen[bytes]
    people: dict[str, Person]
    pages: dict[str, Page]
    broken: list[str]
    """Errors that nobody caught, on anybody's pages."""

    def on(self, name: str, path: str) -> Page:
        """Somebody's window, on a page of the console."""
        page = self.pages[name]
        page.goto(f"{self.url}{path}")
        expect(page.locator("body:not([inert])")).to_be_attached()
        return page

    def happened(self) -> list[tuple[str, str]]:
        """Kind and text of everything that has happened, as the device's own log has it."""
        lines = (self.folder / "state" / "logs" / FILE_NAME).read_text(encoding="utf-8").splitlines()
        entries = [entry for entry in map(json.loads, lines) if "kind" in entry and "stamp_s" in entry]
        return [(entry["kind"], entry["text"]) for entry in entries]

    def told(self) -> list[tuple[str, str]]:
        """The same as the console has stored it, in the device's order."""
        with sqlite3.connect(f"file:{self.folder / 'data' / DATABASE_FILE}?mode=ro", uri=True) as base:
            rows = base.execute("SELECT kind, text FROM device_events ORDER BY sequence").fetchall()
        base.close()
        return rows

    def walks(self) -> list[dict[str, Any]]:
        """The walks that have come to the console and were read."""
        found = self.people["Edda"].http.get("/api/walks").raise_for_status().json()["walks"]
        return [walk for walk in found if walk["figures"]]

    def walked(self) -> str:
        """The id of a walk that ended at its destination; one is walked where there is none yet."""
        if not self.walks() and not any(kind == "arrived" for kind, _ in self.happened()):
            edda = self.people["Edda"].http
            lead = lambda: edda.post("/api/devices/glasses/destination", json={"poi_id": "wash-room"})  # noqa: E731
            until(self.pages["Edda"], lambda: lead().is_success, "an order that is taken")
        arrived = lambda: [walk["walk_id"] for walk in self.walks() if walk["figures"]["arrived"]]  # noqa: E731
        walk_ids: list[str] = until(self.pages["Edda"], arrived, "a walk that has come by itself", WALK_S)
        return walk_ids[0]


@contextmanager
def vbr(*arguments: object) -> Iterator[subprocess.Popen[bytes]]:
    """Run a command of the product until the block ends."""
    command = [sys.executable, "-m", "device_agent", *map(str, arguments)]
    process = subprocess.Popen(command, stdin=subprocess.DEVNULL, env=surroundings())
    try:
        yield process
    finally:
        process.terminate()
        try:
            process.wait(60.0)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def wait_for_file(path: Path, process: subprocess.Popen[bytes]) -> dict[str, Any]:
    """What a process writes once it is ready."""
    end_s = time.monotonic() + 60.0
    while not path.exists():
        assert process.poll() is None, "the console ended by itself"
        assert time.monotonic() < end_s, "the console was not ready within a minute"
        time.sleep(0.05)  # between two looks at a file; another process has no other way to say that it is ready
    ready: dict[str, Any] = json.loads(path.read_text())
    return ready


def put_thin_site(office_site: Path, folder: Path) -> None:
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
    save_site(thin, folder / "console-site")
    shutil.copytree(folder / "console-site", folder / "device-site")


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with chromium() as running:
        yield running


@pytest.fixture(scope="module")
def stage(browser: Browser, office_site: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stage]:
    folder = tmp_path_factory.mktemp("end-to-end")
    put_thin_site(office_site, folder)
    ready_file, token_file = folder / "ready.json", folder / "glasses.token"
    with ExitStack() as stack:
        console = stack.enter_context(
            vbr(
                "console", "--site", folder / "console-site", "--data", folder / "data", "--port", 0,
                "--ready-file", ready_file, "--device-token-file", token_file,
            )
        )  # fmt: skip
        ready = wait_for_file(ready_file, console)
        network = Network(urlsplit(ready["url"]).port or 0)
        stack.callback(network.close)
        glasses = stack.enter_context(
            vbr(
                "device", "--site", folder / "device-site", "--state", folder / "state", "--quiet", "--simulated",
                "--console", f"ws://127.0.0.1:{network.port}", "--token-file", token_file,
                "--record", folder / "recordings", "--share-walks",
            )
        )  # fmt: skip
        admin = Person(ready["url"])
        admin.open_link(ready["first_link"], "Ada").raise_for_status()
        people = {name: invited(admin, name, role) for name, role in ROLES.items()}
        broken: list[str] = []
        pages = {name: window(browser, person, name, broken) for name, person in people.items()}
        made = Stage(folder, ready["url"], network, glasses, people, pages, broken)
        until(pages["Edda"], made.told, "the device's first word", FIRST_START_S)
        yield made
        assert glasses.poll() is None, "the device ended by itself"
        for page in pages.values():
            page.context.close()


def window(browser: Browser, person: Person, name: str, broken: list[str]) -> Page:
    """A window of somebody who is signed in; what breaks on its pages is noted."""
    context = browser.new_context(viewport={"width": 1000, "height": 640})
    become(context, person, name)
    page = context.new_page()
    page.set_default_timeout(60_000)
    # Viser's client in the scene's frame has errors of its own, and goes on.
    page.on("pageerror", lambda error: broken.append(f"{name}: {error}") if "/static/" in (error.stack or "") else None)
    return page


@pytest.fixture(autouse=True)
def nothing_breaks(stage: Stage) -> Iterator[None]:
    yield
    found, stage.broken[:] = list(stage.broken), []
    assert found == []


# ------------------------------------------------------------------------------------------------------------ a walk
def test_a_walk_is_seen_to_its_end_through_a_dead_link_with_an_alert_that_is_heard_and_acknowledged(
    stage: Stage,
) -> None:
    vera, edda = stage.on("Vera", "/"), stage.on("Edda", "/")
    expect(vera.locator("#guide")).to_be_hidden()
    vera.locator("#alert-sound").click()
    expect(vera.locator("#alert-sound")).to_have_attribute("data-state", "on")
    _the_walk_begins(vera, edda)
    edda.goto(f"{stage.url}/overview")
    _the_walk_goes_on(stage, vera)
    happened_before = len(stage.happened())
    with _a_dead_link(stage, vera):
        _the_alert_is_acknowledged(vera, edda)
        _nothing_old_looks_live(stage, vera, happened_before)
    _the_link_is_back(vera, edda)
    expect(vera.locator("#now-action")).to_have_text("Arrived at Wash room", timeout=1000 * WALK_S)
    _nothing_is_missing(stage, vera)
    assert "Nobody is watching any more." not in {text for _, text in stage.happened()[happened_before:]}


def _the_walk_begins(vera: Page, edda: Page) -> None:
    expect(edda.locator("#freshness")).to_have_text("LIVE")
    edda.get_by_label("Destination").select_option(label="Wash room")
    edda.get_by_role("button", name="Guide to Wash room").click()
    expect(edda.locator("#commands")).to_contain_text("Guide to Wash room after")
    expect(vera.locator("#freshness")).to_have_text("LIVE")
    expect(vera.locator("#now-state")).to_have_text("Guiding")
    expect(vera.locator("#now-action")).to_have_text(re.compile("Walking to Wash room|Turning"))
    expect(vera.locator("#progress-text")).to_contain_text("left to Wash room")
    expect(vera.locator("#watchers")).to_contain_text("You are watching")
    expect(vera.locator("#watchers")).to_contain_text("The walker has been told.")


def left_m(page: Page) -> float:
    """How far it is to the destination, as the page says."""
    words = page.locator("#progress-text").inner_text()
    found = re.match(r"([\d.]+) m of [\d.]+ m left to Wash room", words)
    assert found, words
    return float(found[1])


def _the_walk_goes_on(stage: Stage, vera: Page) -> None:
    scene = SceneHands(vera)
    until(vera, lambda: scene.pixel_of("/walker/figure/head"), "the walker in the scene")
    place = lambda: scene.frame.evaluate(WALKER_PLACE)  # noqa: E731
    from_m, before_m = place(), left_m(vera)
    vera.get_by_role("tab", name="Decision").click()
    expect(vera.locator(".trace-sentence")).to_have_text(re.compile("^(Walk|Turn|Stop)"))
    vera.get_by_role("tab", name="Walk", exact=True).click()
    until(vera, lambda: left_m(vera) < before_m - 0.5, "the distance to count down")
    until(vera, lambda: sum(abs(a - b) for a, b in zip(place(), from_m, strict=True)) > 0.5, "the walker to move")
    assert any("Vera" in text for kind, text in stage.happened() if kind == "cue"), "the walker heard who watches"


@contextmanager
def _a_dead_link(stage: Stage, vera: Page) -> Iterator[None]:
    """First nothing comes through any more and nobody is told; then the connection breaks, and can be made anew."""
    expect(vera.locator("#freshness")).to_have_text("LIVE")
    vera.evaluate(NOTE_FRESHNESS)
    stage.network.swallows = True
    try:
        yield
        stage.network.cut()
        expect(vera.locator("#dated")).to_contain_text("Not connected. What is shown is from")
        expect(vera.locator("#dated")).to_contain_text("Whether guidance goes on is not known.")
    finally:
        stage.network.cut()
        stage.network.swallows = False
        stage.network.mend()


def _the_alert_is_acknowledged(vera: Page, edda: Page) -> None:
    alert, same = (page.locator(".alert", has_text="Nothing new from") for page in (vera, edda))
    expect(alert).to_contain_text("somebody was being led")
    expect(vera.locator("#alert-sound")).to_have_attribute("data-last", "high")
    expect(same).to_contain_text("not seen")
    alert.get_by_role("button", name="Acknowledge").click()
    expect(same).to_contain_text("seen by Vera")


def _nothing_old_looks_live(stage: Stage, vera: Page, happened_before: int) -> None:
    expect(vera.locator("#freshness")).to_contain_text("LOST, ")
    lost_at = len(stage.happened())
    expect(vera.locator("#dated")).to_contain_text("What is shown is from")
    expect(vera.locator("#depth-age")).to_contain_text("Old picture, ")
    expect(vera.locator("#scene-freshness")).to_contain_text("LOST, ")
    for grey in ("#now-action", "#depth"):
        until(vera, lambda grey=grey: "grayscale" in vera.locator(grey).evaluate(FILTER), f"{grey} to be grey")  # type: ignore[misc]
    _came_as_promised(vera.evaluate("window.freshness"))
    until(
        vera, lambda: _is_led_on(stage, happened_before, lost_at), "guidance that goes on without the console", WALK_S
    )


def _is_led_on(stage: Stage, dead_at: int, lost_at: int) -> bool:
    """The walker was told something since the page has lost sight of them, or has arrived since the link is dead."""
    happened = stage.happened()
    return any(kind == "cue" for kind, _ in happened[lost_at:]) or any(
        kind == "arrived" for kind, _ in happened[dead_at:]
    )


def _came_as_promised(badges: list[str]) -> None:
    """What the badge has said since the last moment that was live: each word in its turn, and at its age."""
    since = badges[max((i for i, text in enumerate(badges) if text == "LIVE"), default=-1) + 1 :]
    said = [(text.split(",")[0], int(age[0])) for text in since if (age := re.findall(r"\d+", text))]
    assert list(dict.fromkeys(word for word, _ in said)) == ["DELAYED", "STALE", "LOST"], since
    limits_s = {"DELAYED": (DELAYED_AFTER_S, STALE_AFTER_S), "STALE": (STALE_AFTER_S, LOST_AFTER_S)}
    for word, age_s in said:
        # Ages are rounded to the second; the device hangs up by itself after about 10 s, and is lost then.
        least_s, most_s = limits_s.get(word, (STALE_AFTER_S, float("inf")))
        assert least_s - 1.0 <= age_s <= most_s + 1.0, f"{word} at {age_s} s"


def _the_link_is_back(vera: Page, edda: Page) -> None:
    expect(vera.locator("#freshness")).to_have_text("LIVE", timeout=1000 * REDIAL_S)
    expect(vera.locator("#dated")).to_be_hidden()
    for page in (vera, edda):
        expect(page.locator(".alert", has_text="Nothing new from")).to_have_count(0)


def _nothing_is_missing(stage: Stage, vera: Page) -> None:
    vera.get_by_role("tab", name="Events").click()
    expect(vera.locator("#events")).to_contain_text("You have arrived")
    # Threads write to the log and to the journal, and one may overtake another between the two.
    until(vera, lambda: sorted(stage.told()) == sorted(stage.happened()), "the console to know all that has happened")


# ---------------------------------------------------------------------------------------------------------- settings
def put(page: Page, key: str, value: str) -> None:
    """Type a number, and leave the field."""
    page.locator(f"#setting-{key.replace('.', '-')} input[type=number]").fill(value)
    page.keyboard.press("Tab")


def test_a_threshold_is_refused_out_of_range_judged_by_the_walk_and_then_runs_on_the_device(stage: Stage) -> None:
    stage.walked()
    tess = stage.on("Tess", "/settings")
    tess.locator("#gate-clearance_m:enabled").wait_for()
    put(tess, "gate.clearance_m", "99")
    expect(tess.locator("#gate-clearance_m-problem")).to_contain_text("from 0.5 to 4")
    expect(tess.locator("#draft-apply")).to_be_disabled()
    changes = {"changes": {"gate.clearance_m": 99}, "confirmed": True}
    answers = {
        name: stage.people[name].http.patch("/api/devices/glasses/settings", json=changes) for name in ("Tess", "Vera")
    }
    assert answers["Tess"].status_code == 400, "the console refuses it, whatever the page lets through"
    assert "0.5 to 4" in answers["Tess"].text
    assert answers["Vera"].status_code == 403

    put(tess, "gate.clearance_m", "1.5")
    tess.locator("#follower-policy").select_option("paper")
    tess.locator("#draft-what-if").click()
    tess.locator(".what-if-figures").wait_for(timeout=1000 * WALK_S)
    expect(tess.locator("#what-if [role=status]")).to_contain_text("Different for")
    expect(tess.locator(".instant")).to_contain_text("Then: ")
    found = in_both_themes(tess, "what other settings would have changed")

    tess.locator("#draft-apply").click()
    tess.get_by_role("dialog").get_by_role("button", name="Try it out").click()
    tess.get_by_role("button", name="Keep it").click()
    tess.locator("#trial").wait_for(state="hidden")
    own = DeviceStore(stage.folder / "state", stage.folder / "device-site")
    until(tess, lambda: own.load_settings()[0].gate.clearance_m == 1.5, "the device to keep it")
    assert own.load_settings()[0].follower.policy == "paper"
    expect(tess.locator("#revisions tr").first).to_contain_text("runs")
    assert found == []


# ---------------------------------------------------------------------------------------------------------- past walk
def test_the_walk_has_come_by_itself_and_is_scrubbed_and_played(stage: Stage) -> None:
    walk_id = stage.walked()
    vera = stage.on("Vera", "/walks")
    row = vera.locator("#walks tr", has_text="Hall → Wash room")
    expect(row).to_contain_text("✓ Arrived")
    row.get_by_role("link").click()
    assert walk_id in vera.url
    action, state, figures = (vera.locator(f"#past-{part}") for part in ("now-action", "now-state", "figures"))
    expect(state).to_have_text("Guiding")
    walker = vera.locator(".plan-walker")
    place, before = walker.get_attribute("transform"), figures.text_content() or ""

    vera.locator("#position").fill("12.0")
    expect(vera.locator("#past-mark")).to_contain_text(re.compile("0:1[12]"))
    expect(state).to_have_text("Guiding")
    expect(figures).not_to_have_text(before)
    assert walker.get_attribute("transform") != place, "the walker stands elsewhere on the plan"

    vera.locator("#speed").select_option("10")
    vera.locator("#play").click()
    expect(vera.locator("#play")).to_have_text("Pause")
    expect(action).to_have_text("Arrived at Wash room")
    expect(vera.locator(".trace-sentence")).to_have_text(re.compile("^Stop"))
    expect(vera.locator("#play")).to_have_text("Play")
    expect(vera.locator("#walk-figures")).to_contain_text("Deviation, mean")


# -------------------------------------------------------------------------------------------------------------- phone
def test_every_page_of_the_monitor_will_do_on_a_phone_and_in_both_themes(stage: Stage) -> None:
    walk_id = stage.walked()
    wrong = []
    for name, path in (
        ("Vera", "/"), ("Vera", "/overview"), ("Vera", "/alerts"), ("Vera", "/walks"),
        ("Vera", f"/walks?walk={walk_id}"), ("Tess", "/privacy"), ("Tess", "/settings"),
    ):  # fmt: skip
        page = stage.pages[name]
        page.set_viewport_size({"width": 390, "height": 844})
        stage.on(name, path)
        if (sideways_px := page.evaluate(SIDEWAYS_PX)) > 0:
            wrong.append(f"{path} is {sideways_px} px too wide")
        wrong += [f"{path}: {target}" for target in page.evaluate(SMALL_TARGETS, TARGET_PX)]
        wrong += [f"{path}: two are called {same}" for same in page.evaluate(SAME_NAMES)]
        wrong += in_both_themes(page, path)
        page.set_viewport_size({"width": 1000, "height": 640})
    assert wrong == []

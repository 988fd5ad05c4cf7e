"""The map editor in a real Chromium: with mouse and keyboard, and after a reload."""

from __future__ import annotations

import math
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest
from browser import SceneHands, become, chromium, opened, until
from console_room import first_admin
from playwright.sync_api import Browser, Page
from viewer_site import crossing_corridors

from console.config import ConsoleConfig
from console.edits import AddEdge, AddPoi, UpdatePoi
from console.server import ConsoleServer
from navcore.site import save_site

pytestmark = pytest.mark.browser


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with chromium() as browser:
        yield browser


@pytest.fixture
def console(tmp_path: Path) -> Iterator[ConsoleServer]:
    save_site(crossing_corridors(2500), tmp_path / "site")
    server = ConsoleServer(ConsoleConfig(tmp_path / "site", tmp_path / "data", port=0))
    for name, kind, x_m, y_m in (
        ("Hall", "hall", 3.0, 0.0), ("Junction", "junction", 10.0, 0.0), ("Bar", "bar", 10.0, -6.0),
    ):  # fmt: skip
        server.services.model.apply(AddPoi(name, kind, x_m, y_m), "setup")  # type: ignore[arg-type]
    server.services.model.apply(AddEdge("hall", "junction"), "setup")
    server.start()
    try:
        yield server
    finally:
        server.stop()


@pytest.fixture
def page(browser: Browser, console: ConsoleServer) -> Iterator[Page]:
    context = browser.new_context(viewport={"width": 1000, "height": 600})
    become(context, first_admin(console), "Ada")
    yield context.new_page()
    context.close()


@dataclass
class EvilServer:
    """Somebody else's server on this machine; it writes down who comes."""

    address: str
    visits: list[str]


@contextmanager
def evil_server() -> Iterator[EvilServer]:
    """Serve until the block ends."""
    visits: list[str] = []

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            visits.append(self.path)
            self.send_error(404)

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    try:
        yield EvilServer(f"127.0.0.1:{server.server_port}", visits)
    finally:
        server.shutdown()
        thread.join()
        server.server_close()


def open_scene(page: Page, console: ConsoleServer) -> SceneHands:
    page.goto(f"{console.ready.url}/viewer/scene/?fixedDpr=0.5")
    hands = SceneHands(page)
    hands.wait_for_node("/graph/poi/bar/head")
    hands.wait_for_node("/map/cloud/points")
    return hands


@pytest.mark.slow
def test_places_are_dragged_and_connected_with_mouse_and_keys_and_are_still_there_after_a_reload(
    page: Page, console: ConsoleServer
) -> None:
    model = console.services.model
    hands = open_scene(page, console)

    # Drag the hall along the road, half-way to the junction.
    hall, junction = hands.steady_pixel_of("/graph/poi/hall/head"), hands.steady_pixel_of("/graph/poi/junction/head")
    version = model.graph.version
    hands.drag_node("/graph/poi/hall/head", ((hall[0] + junction[0]) / 2, (hall[1] + junction[1]) / 2))
    until(page, lambda: model.graph.version > version, "the drag to be committed")
    moved = model.graph.pois["hall"]
    assert 5.0 < moved.x_m < 8.0
    assert abs(moved.y_m) < 0.01
    (edge,) = model.graph.edges.values()
    assert edge.length_m == pytest.approx(10.0 - moved.x_m, abs=0.05)

    # Connect junction and bar: two clicks show the piece of road, Enter accepts it.
    hands.press_key("3")
    hands.click_node("/graph/poi/junction/head")
    until(page, lambda: "From Junction" in hands.frame.content(), "the hint to ask for the other place")
    hands.click_node("/graph/poi/bar/head")
    until(page, lambda: "6.0 m along the road" in hands.frame.content(), "the length of the piece of road")
    assert len(model.graph.edges) == 1
    hands.press_key("Enter")
    until(page, lambda: len(model.graph.edges) == 2, "the edge")

    # Undo takes the edge back, redo makes it again.
    hands.press_key("Control+z")
    until(page, lambda: len(model.graph.edges) == 1, "the undo")
    hands.press_key("Control+Shift+z")
    until(page, lambda: len(model.graph.edges) == 2, "the redo")

    after = model.graph
    page.reload()
    hands = SceneHands(page)
    hands.wait_for_node("/graph/poi/hall/head")
    assert model.graph == after
    redrawn = hands.steady_pixel_of("/graph/poi/hall/head")
    assert abs(redrawn[0] - (hall[0] + junction[0]) / 2) < 25, "the place is drawn where it was dragged to"


@pytest.mark.slow
def test_a_place_is_tagged_by_a_click_on_the_road_its_name_and_enter(page: Page, console: ConsoleServer) -> None:
    model = console.services.model
    hands = open_scene(page, console)
    hall, junction = hands.steady_pixel_of("/graph/poi/hall"), hands.steady_pixel_of("/graph/poi/junction")
    hands.press_key("2")
    until(page, lambda: "Click on the road" in hands.frame.inner_text("body"), "the mode for tagging")
    page.mouse.click((hall[0] + junction[0]) / 2, (hall[1] + junction[1]) / 2)
    until(page, lambda: "Add place" in hands.frame.inner_text("body"), "the form of the new place")

    # Digits and letters that are shortcuts elsewhere are letters here.
    until(page, lambda: hands.frame.evaluate("document.activeElement.tagName") == "INPUT", "the cursor in the name")
    page.keyboard.type("Room 123")
    page.keyboard.press("Enter")
    until(page, lambda: len(model.graph.pois) == 4, "the place")
    (place,) = [poi for poi in model.graph.pois.values() if poi.name == "Room 123"]
    assert place.on_road
    assert 4.0 < place.x_m < 9.0


@pytest.mark.slow
def test_roads_places_and_connections_are_worked_on_with_the_mouse_alone(page: Page, console: ConsoleServer) -> None:
    model = console.services.model
    hands = open_scene(page, console)
    hands.steady_pixel_of("/graph/poi/hall/head")

    # All neighbours at one stroke: shown first, then accepted.
    hands.press_button("Propose")
    until(page, lambda: "1 new connection, 6.0 m" in hands.frame.inner_text("body"), "what would be added")
    hands.press_button("Accept")
    until(page, lambda: len(model.graph.edges) == 2, "the proposed connection")

    # A place on a connection cuts it in two; a place is merged into another.
    hands.press_button("Select (1)")
    hands.click_floor(6.0, 0.0, 0.12)
    until(page, lambda: "Place on it" in hands.frame.inner_text("body"), "the connection's form")
    hands.press_button("Place on it")
    hands.click_floor(6.0, 0.0)
    hands.press_button("Add place")
    until(page, lambda: len(model.graph.edges) == 3, "the connection in two")
    (middle,) = model.graph.pois.keys() - {"hall", "junction", "bar"}
    hands.click_node(f"/graph/poi/{middle}/head")
    hands.press_button("Merge into")
    hands.click_node("/graph/poi/hall/head")
    until(page, lambda: middle not in model.graph.pois, "one place in place of two")

    # A road is drawn by clicks, cut, joined, smoothed, trimmed and deleted.
    hands.press_button("Draw a road")
    hands.click_floor(14.0, 0.0)
    hands.click_floor(14.0, 5.0)
    hands.click_floor(16.0, 5.0)
    until(page, lambda: "7.0 m drawn" in hands.frame.inner_text("body"), "the line so far")
    hands.press_button("Accept")
    until(page, lambda: "r3" in model.graph.roads, "the drawn road")
    hands.press_button("Select (1)")
    hands.click_floor(14.0, 3.8, 0.05)
    hands.press_button("Split here")
    hands.click_floor(14.0, 2.5)
    until(page, lambda: "r4" in model.graph.roads, "the road in two")
    hands.click_floor(14.0, 1.2, 0.05)
    until(page, lambda: selected(console) == ("road", "r3"), "one part to be selected")
    hands.press_button("Join")
    hands.click_floor(14.0, 3.8, 0.05)
    until(page, lambda: "r4" not in model.graph.roads, "the two parts joined")
    line = model.graph.roads["r3"].points_m
    hands.press_button("Smooth")
    until(page, lambda: model.graph.roads["r3"].points_m != line, "the corner to be rounded")
    hands.press_button("Trim")
    hands.click_floor(14.0, 1.5)
    hands.click_floor(15.5, 5.0)
    until(page, lambda: model.graph.roads["r3"].points_m[0][1] > 1.0, "the beginning to be cut off")
    hands.press_button("Delete road")
    until(page, lambda: model.graph.roads.keys() == {"r1", "r2"}, "the road to be gone")
    hands.press_button("Undo")
    until(page, lambda: "r3" in model.graph.roads, "the road to be back")

    # A place is deleted with its connection, and both come back.
    hands.press_button("Select (1)")
    hands.click_node("/graph/poi/bar/head")
    hands.press_button("Delete place")
    until(page, lambda: "bar" not in model.graph.pois, "the place to be gone")
    hands.press_button("Undo")
    until(page, lambda: "bar" in model.graph.pois and len(model.graph.edges) == 2, "the place and its connection")


@pytest.mark.slow
def test_the_keyboard_selects_nudges_draws_and_helps_and_the_camera_stays(page: Page, console: ConsoleServer) -> None:
    model = console.services.model
    hands = open_scene(page, console)
    bar = hands.steady_pixel_of("/graph/poi/bar")
    hands.press_key("n")
    until(page, lambda: "Merge into" in hands.frame.inner_text("body"), "the form of the first place")
    version = model.graph.version
    for _ in range(5):
        hands.press_key("ArrowUp")
    moved_m = lambda: math.dist((model.graph.pois["bar"].x_m, model.graph.pois["bar"].y_m), (10.0, -6.0))  # noqa: E731
    # They are one edit where the browser keeps up; where it is slow, a pause between two presses ends one.
    until(page, lambda: abs(moved_m() - 0.5) < 0.02, "five steps along the road")
    assert version < model.graph.version <= version + 5
    for _ in range(model.graph.version - version):
        before = model.graph.version
        hands.press_key("Control+z")
        until(page, lambda before=before: model.graph.version > before, "the undo")  # type: ignore[misc]
    assert model.graph.pois["bar"].y_m == pytest.approx(-6.0)
    still = lambda: math.dist(bar, hands.steady_pixel_of("/graph/poi/bar")) < 2.0  # noqa: E731
    until(page, still, "the place where it was: the arrows have not turned the camera")

    # A road drawn with the cross: from the selected place on, two steps of a metre.
    hands.press_key("4")
    hands.press_key("Space")
    hands.press_key("Space")
    for _ in range(2):
        hands.press_key("Shift+ArrowRight")
    hands.press_key("Space")
    until(page, lambda: "2.0 m drawn" in hands.frame.inner_text("body"), "the drawn line")
    hands.press_key("Enter")
    until(page, lambda: [r for r in model.graph.roads.values() if r.origin == "drawn"], "the drawn road")

    hands.press_key("?")
    until(page, lambda: "Without the mouse" in hands.frame.inner_text("body"), "the help")
    hands.press_key("h")
    until(page, lambda: "Without the mouse" not in hands.frame.inner_text("body"), "the help to close")


@pytest.mark.slow
def test_a_reload_in_the_middle_of_a_drag_changes_nothing_and_another_window_sees_what_is_edited(
    page: Page, console: ConsoleServer
) -> None:
    model = console.services.model
    hands = open_scene(page, console)
    before = model.graph
    x, y = hands.steady_pixel_of("/graph/poi/hall/head")
    hands._press_at(x, y)
    for step in range(1, 9):
        page.mouse.move(x + 6 * step, y)
        page.wait_for_timeout(60)
    until(page, lambda: console_moves(console), "the drag to begin")
    page.reload()
    SceneHands(page).wait_for_node("/graph/poi/hall/head")
    page.mouse.up()
    assert model.graph == before, "nobody has let go of the place"

    other_page = page.context.new_page()
    other = open_scene(other_page, console)
    other.press_key("n")
    field = other.frame.locator("input:visible").first
    until(other_page, lambda: field.is_visible() and field.input_value() == "Bar", "the form of the bar")
    model.apply(UpdatePoi("bar", name="Tea bar"), "setup")
    until(other_page, lambda: field.input_value() == "Tea bar", "what was edited elsewhere")
    other_page.close()


def selected(console: ConsoleServer) -> object:
    """What the one window that is open has selected."""
    (present,) = console.services.presence.windows()
    return present.thing


def console_moves(console: ConsoleServer) -> bool:
    """Whether somebody is moving something."""
    return any(present.doing == "dragging" for present in console.services.presence.windows())


@pytest.mark.slow
def test_a_finding_is_shown_in_the_console_s_own_scene_where_none_is_open(page: Page, console: ConsoleServer) -> None:
    finding = {
        "code": "narrow", "severity": "warning", "text": "The bar is narrow.", "action": "Measure it.", "x_m": 10.0,
        "y_m": -6.0, "poi_ids": ["bar"], "edge_ids": [], "road_ids": [],
    }  # fmt: skip
    checked = {"stage": "done", "draft_version": 5, "percent": 100, "version": 5, "is_stale": False, "sentence": ""}
    page.route("**/api/check", lambda route: route.fulfill(json={**checked, "findings": [finding]}))
    opened(page, f"{console.ready.url}/checks")
    page.get_by_role("button", name="Show in the scene: The bar is narrow.").press("Enter")
    page.wait_for_url(lambda url: url.rstrip("/").count("/") == 2)
    until(page, lambda: "bar" in selected_ids(console), "the scene to show the bar")
    assert page.evaluate("sessionStorage['show-in-scene']") is None


def selected_ids(console: ConsoleServer) -> set[str]:
    """The identifiers of what somebody has selected in a scene."""
    return {present.thing[1] for present in console.services.presence.windows() if present.thing is not None}


@pytest.mark.slow
def test_the_scene_is_light_where_the_browser_asks_for_it(browser: Browser, console: ConsoleServer) -> None:
    context = browser.new_context(viewport={"width": 1000, "height": 600}, color_scheme="light")
    become(context, first_admin(console), "Ada")
    page = context.new_page()
    hands = open_scene(page, console)
    light = """() => document.documentElement.getAttribute('data-mantine-color-scheme')"""
    until(page, lambda: hands.frame.evaluate(light) == "light", "the light theme")
    hands.press_button("View", "[role=tab]")
    hands.frame.get_by_role("button", name="Dark", exact=True).dispatch_event("click")
    until(page, lambda: hands.frame.evaluate(light) == "dark", "the dark theme")
    context.close()


@pytest.mark.slow
def test_the_page_in_the_console_runs_no_foreign_code_and_ends_with_the_session(
    page: Page, console: ConsoleServer
) -> None:
    url = console.ready.url
    with evil_server() as evil:
        # Viser's client would connect to, and obey, any address in its query; or play what the query holds.
        sources = f"websocket=ws://{evil.address}/&playbackPath=http://{evil.address}/x.viser"
        page.goto(f"{url}/viewer/scene/?{sources}&playbackPath=data:,x&fixedDpr=0.5")
        hands = SceneHands(page)
        hands.wait_for_node("/graph/poi/bar/head")
        assert "evil" not in page.url
        assert "playbackPath" not in page.url
        # Whatever else leads it there, the browser does not go.
        for attempt in ("new WebSocket('ws://EVIL/')", "fetch('http://EVIL/')", "new Function('1')()"):
            blocked = page.evaluate(
                """() => new Promise((done) => {
                  document.addEventListener('securitypolicyviolation', (e) => done(e.effectiveDirective), {once: true});
                  // Not in this turn, in which the browser lets a test do more than a page may.
                  setTimeout(() => { ATTEMPT; }, 0);
                  setTimeout(() => done('not blocked'), 5000);
                })""".replace("ATTEMPT", attempt.replace("EVIL", evil.address))
            )
            assert blocked in ("connect-src", "script-src"), attempt
        assert evil.visits == []
    page.evaluate(f"fetch('{url}/api/sign-out', {{method: 'POST'}})")
    until(page, lambda: "/signin" in page.url, "the way to the sign-in page", 30.0)

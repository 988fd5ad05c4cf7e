"""axe looks at every page, in both themes, with data and empty, and with each dialog open: WCAG 2.2 A and AA."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from accessibility import in_both_themes
from browser import become_admin, chromium, opened, until
from console_room import serving
from playwright.sync_api import Browser, Page, expect

from console.edits import UpdatePoi
from console.server import ConsoleServer
from navcore.planning.poi_graph import PoiGraph
from navcore.site import Site, save_site

pytestmark = pytest.mark.browser
FOCUS_IS_IN_TOUR = """
() => document.activeElement === document.body || document.querySelector('dialog.tour').contains(document.activeElement)
"""
PAGES = (
    "/", "/overview", "/walks", "/alerts", "/pois", "/pois#connections", "/pois#roads", "/versions", "/checks",
    "/rehearse", "/exchange", "/map-walks", "/settings", "/privacy", "/admin",
)  # fmt: skip


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with chromium() as running:
        yield running


def signed_in(browser: Browser, server: ConsoleServer, *, sees_tour: bool = False) -> Page:
    context = browser.new_context(base_url=server.ready.url, viewport={"width": 1100, "height": 800})
    page = context.new_page()
    page.set_default_timeout(60_000)
    assert server.ready.first_link is not None
    become_admin(page, server.ready.first_link, sees_tour=sees_tour)
    return page


def opened_anew(page: Page, path: str) -> None:
    page.goto("about:blank")
    opened(page, path)


def test_themes_differ_in_colours_alone() -> None:
    """``light-dark()`` takes nothing but colours."""
    static = Path(__file__).resolve().parent.parent / "static"
    styled = [path for path in static.iterdir() if path.suffix in (".css", ".html")]
    assert len(styled) > 5
    assert [path.name for path in styled if "prefers-color-scheme" in path.read_text(encoding="utf-8")] == []


def test_no_block_of_the_style_sheet_is_left_open() -> None:
    """What follows would hold on phones alone, or nowhere."""
    depth, text = 0, (Path(__file__).resolve().parent.parent / "static" / "style.css").read_text(encoding="utf-8")
    for line in text.splitlines():
        assert depth == 0 or not line.startswith("/* ----"), line
        depth += line.count("{") - line.count("}")
    assert depth == 0


@pytest.mark.slow
def test_no_page_has_a_fault_with_data_or_empty(
    browser: Browser, server: ConsoleServer, tmp_path: Path, small_site: Site
) -> None:
    empty = replace(small_site, poi_graph=PoiGraph(version=1))
    save_site(empty, tmp_path / "empty")
    found = []
    with serving(tmp_path / "empty", tmp_path / "empty-data") as bare:
        for name, one in (("with data", server), ("empty", bare)):
            page = signed_in(browser, one)
            for path in PAGES:
                opened_anew(page, path)
                found += in_both_themes(page, f"{path} {name}")
            page.context.close()
    assert found == []


def press(name: str, exact: bool = False) -> Callable[[Page], None]:
    # By a key: between the two halves of a click a page may move.
    return lambda page: page.get_by_role("button", name=name, exact=exact).first.press("Enter")


DIALOGS: tuple[tuple[str, Callable[[Page], None]], ...] = (
    ("/pois", press("Help")),
    ("/pois", press("Add a place…")),
    ("/pois", press("Edit Hall")),
    ("/pois", press("Move Hall")),
    ("/pois", press("Merge Hall")),
    ("/pois#connections", press("Connect two places…")),
    ("/pois#connections", press("Change the connection Hall to Bar")),
    ("/pois#connections", press("Split the connection Hall to Bar")),
    ("/pois#roads", press("Draw a road…")),
    ("/pois#roads", press("Trim Road 1")),
    ("/pois#roads", press("Smooth Road 1")),
    ("/pois#roads", press("Split Road 1")),
    ("/pois#roads", press("Join Road 1")),
    ("/versions", press("Name the draft…")),
)


@pytest.mark.slow
def test_no_dialog_has_a_fault_and_each_is_left_with_escape(browser: Browser, server: ConsoleServer) -> None:
    page = signed_in(browser, server, sees_tour=True)
    tour = page.get_by_role("dialog", name="The map is a road")
    expect(tour).to_be_visible()
    found = in_both_themes(page, "the tour")
    page.keyboard.press("Escape")
    shown = ""
    for path, open_it in DIALOGS:
        if path != shown:
            opened_anew(page, path)
            shown = path
        open_it(page)
        dialog = page.get_by_role("dialog")
        expect(dialog).to_be_visible()
        if dialog.locator("button[type=submit]").count():
            # With all that an empty form is told.
            for box in dialog.locator("input:not([type=checkbox]):visible").all():
                box.fill("")
            dialog.locator("button[type=submit]").click()
            expect(dialog.locator("[aria-invalid]").first).to_be_visible()
        found += in_both_themes(page, f"a dialog of {path}: {dialog.locator('h2').inner_text()}")
        page.keyboard.press("Escape")
        expect(page.get_by_role("dialog")).to_have_count(0)
    found += in_both_themes(page, "a page")
    opened_anew(page, "/pois")
    press("Edit Hall")(page)
    page.get_by_role("dialog").get_by_label("Name").fill("Great hall")
    server.services.model.apply(UpdatePoi("a", name="Lobby"), "Bea")
    page.keyboard.press("Enter")
    expect(page.get_by_role("dialog", name="Two versions")).to_be_visible()
    found += in_both_themes(page, "a conflict")
    assert found == []
    page.context.close()


def test_the_tour_keeps_the_focus_goes_by_keys_and_comes_once(browser: Browser, server: ConsoleServer) -> None:
    page = signed_in(browser, server, sees_tour=True)
    tour = page.locator("dialog.tour")
    for title in (
        "The map is a road", "Tag places", "Connect them", "Check and rehearse", "Publish", "Watch a walker", "Alerts",
        "Ask why", "Lead and pause", "Settings", "Try before you change",
    ):  # fmt: skip
        expect(tour.get_by_role("heading", name=title)).to_be_focused()
        for _ in range(6):
            page.keyboard.press("Tab")
            assert page.evaluate(FOCUS_IS_IN_TOUR)
        tour.get_by_role("button", name="Next").or_(tour.get_by_role("button", name="Done")).press("Enter")
    expect(tour).to_have_count(0)
    opened_anew(page, "/pois")
    expect(page.locator("#places tr")).to_have_count(2)
    assert page.locator("dialog.tour").count() == 0
    page.keyboard.press("?")
    page.get_by_role("button", name="Show the tour").press("Enter")
    until(page, lambda: page.locator("dialog.tour").is_visible(), "the tour again")
    page.context.close()

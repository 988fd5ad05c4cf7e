"""A console whose disk is full, in a real Chromium: every page says so by itself, and no longer when there is room."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from accessibility import in_both_themes
from browser import become, chromium, opened
from console_room import Person, first_admin, invited
from playwright.sync_api import Browser, Page, expect
from small_disk import SmallDisk
from test_disk_full_console import console_on, disk

from console.pages import pages_for
from navcore.site import Site

__all__ = ["disk"]
pytestmark = pytest.mark.browser


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with chromium() as running:
        yield running


def page_of(browser: Browser, person: Person, name: str) -> Page:
    context = browser.new_context(base_url=person.url, viewport={"width": 1100, "height": 800})
    become(context, person, name)
    return context.new_page()


def marked(page: Page, path: str) -> None:
    """Go to a page, and mark it: whether it is still this one can be asked."""
    opened(page, path)
    page.evaluate("window.isNotLoadedAnew = true")


def test_every_page_tells_of_a_full_disk_while_it_lasts(
    browser: Browser, disk: SmallDisk, tmp_path: Path, small_site: Site
) -> None:
    with console_on(disk, tmp_path, small_site) as server:
        ada = first_admin(server)
        pages = {"Ada": page_of(browser, ada, "Ada"), "Vera": page_of(browser, invited(ada, "Vera", "viewer"), "Vera")}
        lines = {name: page.get_by_role("status").filter(has_text="is full, or nearly") for name, page in pages.items()}
        for name, page in pages.items():
            marked(page, "/overview")
            expect(page.locator("#alert-count")).to_have_text("No alerts")
            expect(lines[name]).to_have_count(0)
        disk.fill()
        expect(lines["Ada"]).to_contain_text(f"Free room on the disk of {disk.folder / 'data'}")
        expect(lines["Vera"]).to_contain_text("Tell whoever looks after the console.")
        assert str(disk.folder) not in pages["Vera"].content()
        assert in_both_themes(pages["Ada"], "a full disk") == []
        for path in pages_for("admin"):
            marked(pages["Ada"], path)
            expect(lines["Ada"]).to_be_visible()
        lines["Ada"].get_by_role("link", name="Privacy").click()
        marked(pages["Ada"], "/privacy")
        expect(lines["Ada"]).to_be_visible()
        disk.free()
        for name, page in pages.items():
            expect(lines[name]).to_have_count(0)
            assert page.evaluate("window.isNotLoadedAnew"), name

"""Markup in whatever people and devices may call things, on the pages that show it, in a real Chromium."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from browser import become, chromium, until
from console_room import DialledDevice, Person, first_admin, hello_of, invited, serving
from playwright.sync_api import Browser, Page

from console.server import ConsoleServer
from navcore.modes import Mode
from navcore.site import Site, save_site
from navcore.wire import Event, EventConfirmed, WalkerState, Welcome

pytestmark = pytest.mark.browser
MARKUP = "<img src=x onerror='window.hacked=1'>"
PLANTED = "() => document.querySelectorAll('[onerror], img[src=x]').length + Number(window.hacked ?? 0)"
TEXT = (
    "(text) => document.body.innerText.includes(text)"
    " || [...document.querySelectorAll('input, option')].some((each) => (each.value + each.label).includes(text))"
)


@pytest.fixture
def browser() -> Iterator[Browser]:
    with chromium() as browser:
        yield browser


@pytest.fixture
def server(tmp_path: Path, small_site: Site) -> Iterator[ConsoleServer]:
    save_site(small_site, tmp_path / "site")
    with serving(tmp_path / "site", tmp_path / "data") as server:
        yield server


def plant(admin: Person) -> None:
    """Call everything that people name by markup."""
    admin.edit("add_poi", name=MARKUP, kind="room", x_m=3.0, y_m=0.0).raise_for_status()
    admin.http.post("/api/versions", json={"name": MARKUP}).raise_for_status()
    preset = {"name": MARKUP, "values": {"follower.lead_s": 0.8}}
    admin.http.post("/api/settings/presets", json=preset).raise_for_status()
    invited(admin, MARKUP, "editor").http.get("/api/walks").raise_for_status()


def shown_as_text(page: Page, path: str) -> None:
    page.goto(path)
    until(page, lambda: page.evaluate(TEXT, MARKUP), f"the name on {path}", 30.0)
    assert page.evaluate(PLANTED) == 0, path


def test_a_name_is_a_text_on_every_page(browser: Browser, server: ConsoleServer) -> None:
    admin = first_admin(server)
    plant(admin)
    token = str(admin.http.post("/api/tokens", json={"name": "Glasses"}).json()["token"])
    device = DialledDevice(server.ready.url, token, hello_of(server, MARKUP))
    context = browser.new_context(base_url=server.ready.url)
    become(context, admin, "Ada")
    page = context.new_page()
    with device.socket:
        device.next(Welcome)
        device.send(Event(1, 1000.0, "cue", MARKUP))
        device.next(EventConfirmed)
        device.send(WalkerState(1000.0, "localized", "walk", "ok", last_cue=MARKUP, mode=Mode.GUIDING))
        for path in ("/", "/pois", "/versions", "/admin", "/privacy", "/settings"):
            shown_as_text(page, path)
    context.close()

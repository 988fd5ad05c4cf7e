"""The pages in a real Chromium: forms, live state, settings, roles; by mouse and by keyboard."""

from __future__ import annotations

import re
from collections.abc import Iterator

import pytest
from browser import become, chromium, until
from console_room import PASSWORD, first_admin, invited
from playwright.sync_api import Browser, Page, Route, TimeoutError, expect
from walking_device import WalkingDevice

from console.edits import UpdatePoi
from console.server import ConsoleServer
from navcore.modes import Mode

pytestmark = pytest.mark.browser
NAMELESS = """
() => [...document.querySelectorAll('input, select, textarea, button, a[href], iframe, dialog')]
  .filter((e) => e.checkVisibility())
  .filter((e) => !(e.labels && e.labels.length) && !e.getAttribute('aria-label') && !e.getAttribute('aria-labelledby')
    && !e.title && !e.textContent.trim())
  .map((e) => e.outerHTML.slice(0, 120))
"""


BROKEN_WORDS = """
() => {
  const range = document.createRange();
  const lines = (node, word) => {
    range.setStart(node, word.index);
    range.setEnd(node, word.index + word[0].length);
    return new Set([...range.getClientRects()].map((box) => Math.round(box.top))).size;
  };
  const texts = [...document.querySelectorAll('main button, main .badge')].filter((e) => e.checkVisibility())
    .flatMap((e) => [...e.childNodes].filter((node) => node.nodeType === Node.TEXT_NODE));
  return texts.flatMap((node) => [...node.data.matchAll(/\\S+/g)].filter((word) => lines(node, word) > 1))
    .map(([word]) => word);
}
"""
"""Words on buttons that go on in the next line."""


PAGES = (
    "/", "/overview", "/pois", "/versions", "/checks", "/rehearse", "/exchange", "/map-walks", "/settings",
    "/alerts", "/admin",
)  # fmt: skip


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with chromium() as running:
        yield running


@pytest.fixture
def page(browser: Browser, server: ConsoleServer) -> Iterator[Page]:
    context = browser.new_context(base_url=server.ready.url, viewport={"width": 1100, "height": 700})
    opened = context.new_page()
    opened.set_default_timeout(60_000)
    failures: list[str] = []
    opened.on("pageerror", lambda error: failures.append(str(error)))
    become(context, first_admin(server), "Ada")
    yield opened
    context.close()
    assert failures == []


def test_signing_out_and_in_leads_back_to_the_page_that_was_asked_for(page: Page) -> None:
    page.goto("/settings")
    page.get_by_role("button", name="Sign out").click()
    page.wait_for_url("**/signin")
    page.goto("/pois")
    page.get_by_label("Name").fill("ada")
    page.get_by_label("Password").fill("not the password")
    page.keyboard.press("Enter")
    expect(page.get_by_role("alert")).to_have_text("Name and password do not match.")
    page.get_by_label("Password").fill(PASSWORD)
    page.keyboard.press("Enter")
    page.wait_for_url("**/pois")
    expect(page.get_by_role("heading", name="Places and ways")).to_be_visible()


def test_places_are_made_joined_and_taken_back_without_any_dragging(page: Page, server: ConsoleServer) -> None:
    page.goto("/pois")
    page.get_by_role("button", name="Add a place…").click()
    dialog = page.get_by_role("dialog")
    dialog.get_by_label("Name").fill("<img src=x onerror=alert(1)> Lift")
    dialog.get_by_label("Kind").select_option("lift")
    dialog.get_by_label("Position", exact=True).select_option("xy")
    dialog.get_by_label("x (metres)").fill("3")
    dialog.get_by_label("y (metres)").fill("40")
    dialog.get_by_role("button", name="Add it").click()
    expect(dialog.get_by_role("alert")).to_contain_text("40.0 m from the road")
    dialog.get_by_label("y (metres)").fill("0.5")
    page.keyboard.press("Enter")
    lift = page.locator("#places tr", has_text="<img src=x onerror=alert(1)> Lift")
    expect(lift).to_be_visible()
    page.get_by_role("tab", name="Connections").click()
    page.get_by_role("button", name="Propose connections…").click()
    page.get_by_role("button", name="Accept all").click()
    expect(page.locator("#edges tr")).to_have_count(3)
    page.get_by_role("tab", name="Places").click()
    lift.get_by_role("button", name="Delete").click()
    expect(page.locator("#edges tr")).to_have_count(1)
    page.locator("h1").click()
    page.keyboard.press("Control+z")
    expect(page.locator("#edges tr")).to_have_count(3)
    page.get_by_role("tab", name="Connections").click()
    page.get_by_label("Closed: Hall to Bar").check()
    until(page, lambda: server.services.model.graph.edges["a-b"].closed, "the connection to be closed")
    page.goto("/pois#connections")
    page.reload()
    expect(page.get_by_label("Closed: Hall to Bar")).to_be_checked()
    page.get_by_role("button", name="Publish").click()
    expect(page.locator("#version")).to_contain_text("is published")
    assert server.services.model.published == server.services.model.graph


def test_a_page_takes_no_click_before_it_can_answer_it(page: Page) -> None:
    held: list[Route] = []
    page.route("**/api/graph", lambda route: held.append(route))
    page.goto("/pois")
    add = page.get_by_role("button", name="Add a place…", include_hidden=True)
    assert page.evaluate("document.body.inert")
    with pytest.raises(TimeoutError):
        add.click(timeout=500)
    until(page, lambda: bool(held), "the question for the graph")
    held.pop().continue_()
    add.click()
    expect(page.get_by_role("dialog").get_by_label("Name")).to_be_visible()


def test_a_page_that_cannot_start_says_so_and_offers_to_try_again(page: Page) -> None:
    page = page.context.new_page()
    page.set_default_timeout(60_000)
    page.route("**/api/settings", lambda route: route.fulfill(status=500, json={"error": "The disk is full."}))
    page.goto("/settings")
    expect(page.locator("main").get_by_role("alert")).to_contain_text(
        "This page could not be started. The disk is full."
    )
    page.unroute("**/api/settings")
    page.get_by_role("button", name="Load it again").click()
    expect(page.get_by_label("Sub goal distance, as a number")).to_be_visible()


def test_an_edit_of_somebody_else_is_seen(page: Page, server: ConsoleServer) -> None:
    page.goto("/")
    page.get_by_role("tab", name="Places").click()
    expect(page.locator("#places")).to_contain_text("Bar")
    server.services.model.apply(UpdatePoi("b", name="Tea bar"), "Somebody")
    expect(page.locator("#places")).to_contain_text("Tea bar")


def test_a_walk_is_started_and_seen_and_a_lost_device_never_looks_live(page: Page, server: ConsoleServer) -> None:
    page.goto("/")
    expect(page.locator("#no-device")).to_be_visible()
    device = WalkingDevice(server)
    until(page, lambda: device.send_state() or page.locator("#freshness").text_content() == "LIVE", "a live device")
    page.get_by_label("Destination").select_option(label="Bar")
    page.get_by_role("button", name="Guide to Bar").click()
    expect(page.locator("#now-action")).to_have_text("Walking to Bar")
    expect(page.locator("#commands")).to_contain_text("accepted")
    page.get_by_label("Destination").select_option(label="Hall")
    page.get_by_role("button", name="Guide to Hall").click()
    question = page.get_by_role("dialog", name="Lead Glasses of Ada elsewhere?")
    question.get_by_role("button", name="Keep Bar").click()
    expect(page.locator("#now-action")).to_have_text("Walking to Bar")
    page.get_by_role("button", name="Guide to Hall").click()
    question.get_by_role("button", name="Guide to Hall").click()
    expect(page.locator("#now-action")).to_have_text("Walking to Hall")
    page.get_by_label("Destination").select_option(label="Bar")
    device.vanish()
    expect(page.locator("#freshness")).to_contain_text("LOST")
    expect(page.locator("#dated")).to_contain_text("Not connected")
    expect(page.get_by_role("button", name="Guide to Bar")).to_be_disabled()


def test_every_state_of_a_device_has_a_clear_label(page: Page, server: ConsoleServer) -> None:
    device = WalkingDevice(server)
    page.goto("/")
    for mode in Mode:
        led = mode in (Mode.GUIDING, Mode.PAUSED, Mode.LOST, Mode.ARRIVED, Mode.FAULT)
        device.send_state("b" if led else None, mode)
        expect(page.locator("#now-state")).to_have_text(mode.label)
        expect(page.locator("#now-sign svg path")).to_have_attribute("d", re.compile("M"))
        expect(page.locator("#now-said")).to_contain_text(f"{mode.label}.")
        enabled = {name: page.locator(f"#{name}").is_enabled() for name in ("pause", "resume", "clear")}
        assert enabled["pause"] == (mode in (Mode.GUIDING, Mode.LOST))
        assert enabled["clear"] == (led and mode is not Mode.ARRIVED)
        assert page.locator("#resume").is_visible() == (mode is Mode.PAUSED)
    page.get_by_role("button", name="Have the last sentence said again").click()
    expect(page.locator("#commands")).to_contain_text("Repeat")
    expect(page.locator("#commands")).to_contain_text("accepted")
    device.vanish()


def test_a_device_is_cut_off_only_by_who_means_it(page: Page, server: ConsoleServer) -> None:
    token = server.services.devices.create_token("Glasses of Ada", "test")
    page.goto("/admin")
    for answer, name in (("Leave it as it is", "Glasses of Ada"), ("Revoke", None)):
        page.get_by_role("button", name="Revoke the token of Glasses of Ada").click()
        dialog = page.get_by_role("dialog", name="Revoke the token of Glasses of Ada?")
        dialog.get_by_role("button", name=answer).click()
        expect(dialog).to_have_count(0)
        until(page, lambda name=name: server.services.devices.name_of(token) == name, f"the answer {answer}")  # type: ignore[misc]


def test_a_viewer_finds_no_button_that_would_be_refused(browser: Browser, server: ConsoleServer) -> None:
    viewer = invited(first_admin(server), "Vera", "viewer")
    context = browser.new_context(base_url=server.ready.url)
    become(context, viewer, "Vera")
    page = context.new_page()
    page.goto("/pois")
    expect(page.locator("#places tr")).to_have_count(2)
    for button in ("Add a place…", "Publish", "Undo", "Delete Bar"):
        expect(page.get_by_role("button", name=button)).to_have_count(0)
    expect(page.get_by_role("link", name="Admin")).to_have_count(0)
    page.goto("/admin")
    expect(page.get_by_role("heading", name="This page is not for your role")).to_be_visible()
    expect(page.locator("#why")).to_contain_text("You are signed in as viewer")
    context.close()


def test_every_page_can_be_operated_by_name_and_fits_a_phone(page: Page, server: ConsoleServer) -> None:
    server.services.devices.create_token("Glasses of Ada", "test")
    page.set_viewport_size({"width": 360, "height": 740})
    for path in PAGES:
        page.goto(path)
        expect(page.locator("#user-name")).to_have_text("Ada")
        expect(page.locator("body:not([inert])")).to_be_attached()
        assert page.evaluate(NAMELESS) == [], path
        assert page.locator("h1").count() == 1
        assert page.locator("main").count() == 1
        overflow = page.evaluate("document.documentElement.scrollWidth - document.documentElement.clientWidth")
        assert overflow <= 0, f"{path} is {overflow} px wider than a phone"
        assert page.evaluate(BROKEN_WORDS) == [], path
        page.keyboard.press("Tab")
        assert page.evaluate("document.activeElement.className") == "skip"

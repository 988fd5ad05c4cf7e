"""The pages Checks, Rehearse and Versions with what the checker, the rehearsal and a refused publication answer.

What the console answers is laid down here: the pages show it, whatever a map gives.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from browser import become, chromium, opened, until
from console_room import first_admin
from playwright.sync_api import Browser, Page, Route, expect

from console.api_accounts import AUDIT_SHOWN_COUNT
from console.edits import AddPoi, SetEdge, UpdatePoi
from console.server import ConsoleServer

pytestmark = pytest.mark.browser
FINDINGS = [
    {
        "code": "unreachable_poi", "severity": "error", "text": "Bar cannot be reached.", "action": "Connect it.",
        "x_m": 6.0, "y_m": 0.0, "poi_ids": ["b"], "edge_ids": [], "road_ids": [],
    },
    {
        "code": "narrow", "severity": "warning", "text": "Hall – Bar is 0.5 m wide.", "action": "Measure it.",
        "x_m": 3.0, "y_m": 0.0, "poi_ids": [], "edge_ids": ["a-b"], "road_ids": [],
    },
]  # fmt: skip

OUT_OF_REACH = """() => [...document.querySelectorAll(".table-wrap :is(button, select, td)")].filter((node) => {
  const box = node.getBoundingClientRect();
  return box.width > 0 && (box.right > innerWidth || (node.tagName === "SELECT" && box.width < 90));
}).map((node) => node.textContent)"""
"""What of the tables lies beyond the edge of the page, or is a choice that shows nothing of what is chosen."""


def state(stage: str, version: int | None = None, percent: int = 0, findings: tuple[Any, ...] = ()) -> dict[str, Any]:
    return {"stage": stage, "draft_version": 1, "percent": percent, "version": version, "is_stale": False,
            "findings": list(findings), "sentence": ""}  # fmt: skip


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with chromium() as running:
        yield running


@pytest.fixture
def page(browser: Browser, server: ConsoleServer) -> Iterator[Page]:
    context = browser.new_context(base_url=server.ready.url, viewport={"width": 1100, "height": 800})
    context.set_default_timeout(30_000)
    opened = context.new_page()
    failures: list[str] = []
    opened.on("pageerror", lambda error: failures.append(str(error)))
    become(context, first_admin(server), "Ada")
    yield opened
    context.close()
    assert failures == []


def answering(page: Page, path: str, answer: Callable[[str, Any], Any]) -> list[Any]:
    """Let ``answer(method, body)`` answer for a path; return the list of what was sent there."""
    sent: list[Any] = []

    def fulfil(route: Route) -> None:
        body = json.loads(route.request.post_data or "null")
        if route.request.method != "GET":
            sent.append(body)
        route.fulfill(**answer(route.request.method, body))

    page.route(f"**{path}", fulfil)
    return sent


def test_a_check_is_run_its_findings_are_filtered_shown_in_the_scene_and_grow_old(
    page: Page, server: ConsoleServer
) -> None:
    states = iter([state("none"), state("running", percent=40), state("running", percent=80)])
    done = state("done", 1, findings=tuple(FINDINGS))
    begun = answering(page, "/api/check", lambda *_: {"json": next(states, done)})
    viewed = answering(page, "/api/view", lambda *_: {"json": {"scenes": 1}})
    opened(page, "/checks")
    expect(page.locator("#state")).to_contain_text("Nobody has checked this draft yet")
    page.get_by_role("button", name="Check the draft").press("Enter")
    expect(page.locator("#state")).to_have_text("Version 1 has 1 error, 1 warning.")
    assert len(begun) == 1
    expect(page.locator("#findings h3")).to_have_count(2)
    expect(page.locator("#findings li").first).to_contain_text("at Bar (6.0, 0.0)")
    expect(page.locator(".plan-mark")).to_have_count(2)

    page.get_by_label("Severity").select_option("warning")
    expect(page.locator("#findings li")).to_have_count(1)
    expect(page.locator(".plan-mark text")).to_have_text("2")
    page.get_by_role("button", name="Show in the scene: Hall – Bar is 0.5 m wide.").press("Enter")
    expect(page.locator("#toasts")).to_contain_text("The scene shows it.")
    assert viewed == [{"point": [3.0, 0.0], "kind": "edge", "id": "a-b"}]

    server.services.model.apply(UpdatePoi("b", name="Tea bar"), "Bea")
    expect(page.locator("#state")).to_contain_text("The draft is version 2 by now: check it again.")


def test_publishing_what_has_errors_is_asked_again_and_only_then_done(page: Page, server: ConsoleServer) -> None:
    model = server.services.model
    model.apply(UpdatePoi("b", name="Tea bar"), "Bea")
    published = model.published

    def answer(_: str, body: Any) -> Any:
        if body != {"confirmed": True, "version": 2}:
            return refused_publication(2, FINDINGS[:1])
        model.publish("Ada")
        return {"json": page.request.get("/api/graph").json()}

    answering(page, "/api/check", lambda *_: {"json": state("done", 2, findings=tuple(FINDINGS))})
    sent = answering(page, "/api/publish", answer)
    opened(page, "/versions")
    expect(page.locator("#steps")).to_contain_text("Found: 1 error, 1 warning.")
    page.get_by_role("button", name="Publish").press("Enter")
    asked = page.get_by_role("dialog")
    expect(asked).to_contain_text("as it is. The check says:Bar cannot be reached. Connect it.")
    asked.get_by_role("button", name="Not yet").press("Enter")
    assert (sent, model.published) == ([{}], published)
    page.get_by_role("button", name="Publish").press("Enter")
    asked.get_by_role("button", name="Publish it").press("Enter")
    expect(page.locator("#steps")).to_contain_text("Version 2 is what is published.")
    assert sent == [{}, {}, {"confirmed": True, "version": 2}]


def refused_publication(version: int, findings: list[dict[str, Any]]) -> dict[str, Any]:
    return {"status": 409, "json": {"error": "The draft has errors.", "findings": findings, "version": version}}


def test_what_was_confirmed_is_published_and_not_what_the_draft_has_become_meanwhile(
    page: Page, server: ConsoleServer
) -> None:
    model = server.services.model
    model.apply(UpdatePoi("b", name="Tea bar"), "Bea")

    def answer(_: str, body: Any) -> Any:
        if body == {"confirmed": True, "version": 2}:
            # Somebody edits while the errors of version 2 are being read.
            model.apply(UpdatePoi("b", name="Coffee bar"), "Bea")
            return {"status": 409, "json": {"error": "The draft has been changed meanwhile: look at it again."}}
        if body != {"confirmed": True, "version": 3}:
            return refused_publication(model.graph.version, FINDINGS[model.graph.version - 2 :])
        model.publish("Ada", 3)
        return {"json": page.request.get("/api/graph").json()}

    answering(page, "/api/check", lambda *_: {"json": state("none")})
    sent = answering(page, "/api/publish", answer)
    opened(page, "/versions")
    expect(page.locator("#steps")).to_contain_text("Version 2;")
    page.get_by_role("button", name="Publish").press("Enter")
    page.get_by_role("dialog", name="Publish all the same?").get_by_role("button", name="Publish it").press("Enter")
    again = page.get_by_role("dialog", name="Publish what it is now?")
    expect(again).to_contain_text("The draft has been changed meanwhile, it is version 3 by now.")
    expect(again).to_contain_text("Hall – Bar is 0.5 m wide.")
    expect(again.get_by_role("button", name="Not yet")).to_be_focused()
    assert model.published.version == 1
    again.get_by_role("button", name="Publish it").press("Enter")
    expect(page.locator("#steps")).to_contain_text("Version 3 is what is published.")
    assert sent == [{}, {"confirmed": True, "version": 2}, {}, {"confirmed": True, "version": 3}]


def test_going_back_over_what_somebody_did_meanwhile_is_asked_again_and_only_then_done(
    page: Page, server: ConsoleServer
) -> None:
    model = server.services.model
    model.apply(UpdatePoi("b", name="Tea bar"), "Ada")
    sent: list[Any] = []

    def judge(route: Route) -> None:
        sent.append(json.loads(route.request.post_data or "null"))
        if len(sent) <= 2:
            model.apply(SetEdge("a-b", closed=len(sent) == 1), "Bea")
        if sent[-1] == {"base_version": model.graph.version}:
            return route.continue_()
        return route.fulfill(status=409, json={"error": "The draft has been changed meanwhile."})

    page.route("**/roll-back", judge)
    opened(page, "/versions")
    back = page.get_by_role("button", name="Go back to version 1").first
    asked = page.get_by_role("dialog", name="Go back to version 1 all the same?")
    back.press("Enter")
    expect(asked.get_by_role("listitem")).to_have_count(1)
    expect(asked.get_by_role("listitem")).to_contain_text("Bea Changed a connection")
    asked.get_by_role("button", name="Leave it as it is").press("Enter")
    expect(asked).to_have_count(0)
    assert (model.graph.version, model.graph.edges["a-b"].closed) == (3, True)

    expect(page.locator("#history")).to_contain_text("Changed a connection")
    back.press("Enter")
    expect(asked.get_by_role("listitem")).to_have_count(1)
    asked.get_by_role("button", name="Go back").press("Enter")
    until(page, lambda: model.graph.pois["b"].name == "Bar", "the version to be back")
    expect(page.locator("#toasts")).to_contain_text("The draft is as it was in version 1.")
    assert sent == [{"base_version": 2}, {"base_version": 3}, {"base_version": 4}]


def test_the_page_admin_lists_the_people(page: Page, server: ConsoleServer) -> None:
    invited = page.request.post(
        "/api/users", data={"name": "Bea", "role": "editor"}, headers={"Origin": server.ready.url}
    )
    assert invited.status == 201
    opened(page, "/admin")
    people = page.get_by_role("region", name="People").get_by_role("row")
    expect(people).to_have_count(3)
    expect(people.filter(has_text="Ada")).to_contain_text("active")
    expect(people.filter(has_text="Bea")).to_contain_text("invited")
    expect(page.get_by_label("Role of Bea")).to_have_value("editor")
    ids = page.evaluate("[...document.querySelectorAll('[id]')].map(({ id }) => id)")
    assert len(ids) == len(set(ids))
    store = server.services.store
    with store.writing() as session:
        for number in range(AUDIT_SHOWN_COUNT + 3):
            store.add_audit(session, "Bea", "sign_in_failed", f"number {number}")
    page.get_by_label("Who", exact=True).fill("bea")
    page.get_by_role("button", name="Find").click()
    deeds = page.locator("#audit tr")
    expect(deeds).to_have_count(AUDIT_SHOWN_COUNT)
    page.get_by_role("button", name="Show older").click()
    expect(deeds).to_have_count(AUDIT_SHOWN_COUNT + 3)
    expect(deeds.last).to_contain_text("number 0")
    server.services.model.apply(AddPoi("Lift beside the stairs", "lift", 2.0, 0.0), "Bea")
    server.services.devices.create_token("Glasses of Ada", "Ada")
    # On a phone nothing of a table is out of reach.
    page.set_viewport_size({"width": 390, "height": 844})
    for path in ("/admin", "/versions"):
        page.goto(path)
        expect(page.locator("td.actions button").first).to_be_visible()
        assert page.evaluate(OUT_OF_REACH) == [], path


@pytest.mark.parametrize(("away_m", "words"), [(0.9, "0.9 m from Ward (0.0, 0.0)"), (3.0, "at K (0.0, 0.0)")])
def test_where_something_is_is_said_by_a_place_that_people_know(page: Page, away_m: float, words: str) -> None:
    places = [
        {"name": "K", "kind": "junction", "x_m": 0.0, "y_m": 0.0},
        {"name": "Ward", "kind": "room", "x_m": away_m, "y_m": 0.0},
    ]
    page.goto("/static/plan.js")
    script = "async (pois) => (await import('/static/plan.js')).whereWords({ data: { pois } }, -0.01, 0)"
    assert page.evaluate(script, places) == words


def test_a_rehearsal_lists_what_is_heard_and_says_when_it_is_old(page: Page, server: ConsoleServer) -> None:
    heard = {"lasts_s": 1.0, "edge_id": "a-b", "poi_id": None, "sound": None}
    utterances = [
        {"stamp_s": 0.0, "x_m": 0.0, "y_m": 0.0, "along_m": 0.0, "kind": "route", "text": "To Bar.", **heard},
        {"stamp_s": 65.0, "x_m": 6.0, "y_m": 0.0, "along_m": 6.0, "kind": "arrived", "text": "You are there.", **heard},
    ]  # fmt: skip
    result = {
        "graph_version": 1, "start": "a", "destination": "b", "language": "en", "voice": "browser", "arrived": True,
        "refusal": "", "total_s": 65.0, "length_m": 6.0, "utterances": utterances,
    }  # fmt: skip
    sent = answering(page, "/api/rehearsals", lambda *_: {"json": result})
    opened(page, "/rehearse")
    page.get_by_role("button", name="Rehearse", exact=True).press("Enter")
    expect(page.get_by_role("alert").filter(has_text="Choose both places.")).to_be_visible()
    expect(page.get_by_label("From")).to_be_focused()
    page.get_by_label("From").select_option(label="Hall")
    page.get_by_label("To", exact=True).select_option(label="Bar")
    page.get_by_role("button", name="Rehearse", exact=True).press("Enter")
    expect(page.get_by_role("heading", name="Hall to Bar")).to_be_focused()
    assert sent == [{"start": "a", "destination": "b", "language": "en"}]
    expect(page.locator("#summary")).to_contain_text("6.0 m, 1:05, 2 sentences, 0 tones.")
    expect(page.locator("#utterances tr")).to_have_count(2)
    expect(page.locator("#utterances tr").last).to_contain_text("1:05")
    expect(page.locator("#utterances tr").last).to_contain_text("at Bar")
    page.get_by_role("button", name="Play 2: You are there.").press("Enter")
    until(page, lambda: page.locator(".plan-mark.chosen text").text_content() == "2", "the place on the plan")
    server.services.model.apply(UpdatePoi("b", name="Tea bar"), "Bea")
    expect(page.locator("#summary")).to_contain_text("of version 1; the draft is 2")

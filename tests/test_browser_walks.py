"""Past walks in a real Chromium: played, scrubbed, stepped by the keyboard; the panels are those of the instant."""

from __future__ import annotations

from pathlib import Path

import pytest
from accessibility import faults
from browser import become_admin, chromium, until
from console_room import serving
from playwright.sync_api import expect
from recorded_walk import STORED_WALK
from test_past_walks import take

from console.view_requests import EndPast, ShowPast, ViewRequest
from navcore.site import Site, save_site

pytestmark = pytest.mark.browser


def test_a_past_walk_is_played_scrubbed_and_stepped(small_site: Site, tmp_path: Path) -> None:
    save_site(small_site, tmp_path / "site")
    with serving(tmp_path / "site", tmp_path / "data") as server, chromium() as browser:
        take(server.services.recordings, STORED_WALK.read_bytes())
        page = browser.new_context(base_url=server.ready.url, viewport={"width": 1200, "height": 900}).new_page()
        page.set_default_timeout(60_000)
        broken: list[str] = []
        page.on("pageerror", lambda error: broken.append(str(error)))
        assert server.ready.first_link is not None
        become_admin(page, server.ready.first_link)

        page.goto("/walks")
        row = page.locator("#walks tr")
        expect(row).to_contain_text("Door → Window")
        expect(row).to_contain_text("✓ Arrived")
        expect(page.locator("#overlay-plan .layer-deviation rect").first).to_be_attached()
        page.locator("#overlay-deviation").uncheck()
        expect(page.locator("#overlay-plan .layer-deviation")).to_have_count(0)

        row.get_by_role("link").click()
        state, action = page.locator("#past-now-state"), page.locator("#past-now-action")
        expect(page.locator("#past-banner")).to_contain_text("Past walk, recorded")
        expect(page.locator("#past-now-said")).to_contain_text("Guiding")
        mark = page.locator("#past-mark")

        # The arrows go a second, the point and the comma a single cycle of this walk (5 Hz).
        for _ in range(3):
            page.keyboard.press("ArrowRight")
        expect(mark).to_have_text("Past walk: 0:03.0")
        page.keyboard.press(".")
        expect(mark).to_have_text("Past walk: 0:03.2")
        page.keyboard.press(",")
        page.keyboard.press(",")
        expect(mark).to_have_text("Past walk: 0:02.8")
        page.locator("#position").fill("2.4")
        expect(state).to_have_text("Paused")
        page.keyboard.press("End")
        expect(action).to_contain_text("Arrived")
        before = page.locator(".plan-walker").get_attribute("transform")
        page.keyboard.press("Home")
        expect(state).to_have_text("Guiding")
        assert page.locator(".plan-walker").get_attribute("transform") != before, (
            "the walker stands elsewhere on the plan"
        )

        # In the scene of this person, for as long as the page goes on; without one, it says so.
        button = page.locator("#in-scene")
        button.click()
        expect(page.locator(".toast").last).to_contain_text("No scene is open")
        expect(button).to_have_text("Show in the scene")
        heard: list[ViewRequest] = []
        tokens = [cookie.get("value", "") for cookie in page.context.cookies()]
        person = next(found for token in tokens if (found := server.services.accounts.signed_in(token)) is not None)
        server.services.views.subscribe(person.session_id, heard.append)
        button.click()
        expect(button).to_have_attribute("aria-pressed", "true")
        page.keyboard.press("End")
        until(
            page,
            lambda: any(isinstance(each, ShowPast) and each.at_s > 15.0 for each in heard),
            "the end of the walk in the scene",
        )
        page.keyboard.press("Home")
        button.click()
        until(page, lambda: isinstance(heard[-1], EndPast), "the end of the past in the scene")

        # Marks: the list and the keys go to the same instants.
        page.locator("#marks li", has_text="The console paused guidance.").get_by_role("button").first.click()
        expect(state).to_have_text("Paused")
        page.keyboard.press("End")
        page.keyboard.press("p")
        expect(mark).not_to_have_text("Past walk: 0:16.4")

        # Played ten times as fast, it comes to its end by itself.
        page.keyboard.press("Home")
        page.locator("#speed").select_option("10")
        page.locator("#play").click()
        expect(page.locator("#play")).to_have_text("Pause")
        expect(action).to_contain_text("Arrived")
        expect(page.locator("#play")).to_have_text("Play")
        expect(page.locator("#player-time")).to_have_text("0:16.4 of 0:16")
        expect(page.locator("#walk-figures")).to_contain_text("Deviation, mean")
        expect(page.locator("#legs tr")).to_have_count(1)
        assert faults(page) == []
        assert broken == []

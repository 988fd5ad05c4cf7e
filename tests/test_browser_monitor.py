"""The pages Console and Overview in a real Chromium: nothing old looks live, orders are answered, a phone will do."""

from __future__ import annotations

import re
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import pytest
from accessibility import in_both_themes
from browser import become_admin, chromium, until
from playwright.sync_api import Browser, Page, WebSocketRoute, expect
from walking_device import WalkingDevice

from console.live import CommandKind
from console.server import ConsoleServer
from navcore.modes import Mode
from navcore.wire import WalkerState

pytestmark = pytest.mark.browser
TARGET_PX = 44
SMALL_TARGETS = """
(least) => [...document.querySelectorAll('main button, main select, main input, .top .menu')]
  .filter((e) => e.checkVisibility() && e.getBoundingClientRect().height < least).map((e) => e.outerHTML.slice(0, 90))
"""
TOO_HIGH_PX = "document.documentElement.scrollHeight - document.documentElement.clientHeight"
OVERFLOW_PX = "document.documentElement.scrollWidth - document.documentElement.clientWidth"
WATCH_BANNER = """
() => {
  const banner = document.getElementById("link-banner"), toasts = document.getElementById("toasts");
  const seen = window.bannerSeen = { shown_ms: 0, said: false };
  let since_ms = null;
  new MutationObserver(() => {
    if (!banner.hidden) since_ms ??= performance.now();
    else if (since_ms !== null) [seen.shown_ms, since_ms] = [performance.now() - since_ms, null];
  }).observe(banner, { attributes: true, attributeFilter: ["hidden"] });
  new MutationObserver(() => { seen.said ||= toasts.textContent.includes("The console is there again"); })
    .observe(toasts, { childList: true, subtree: true, characterData: true });
}
"""
SHOWN = """
() => {
  const id = (name) => document.getElementById(name);
  return {
    word: id('freshness').textContent.split(',')[0], isDated: id('dated').checkVisibility(),
    isNoted: id('act-note').checkVisibility(), action: id('now-action').textContent,
    filter: getComputedStyle(id('now-action')).filter,
  };
}
"""
GAPS = """
async () => {
  const { History, lines } = await import('/static/history.js');
  const history = new History();
  for (let s = 0; s < 300; s += 0.1) if (s < 250 || s > 270) history.add('a', s, { v: s > 260 && s < 285 ? null : s });
  const found = lines(history.samples, 'v', 300);
  const other = history.add('b', 1, { v: 1 });
  return [found.map((line) => [line[0][0], line.at(-1)[0]]), history.samples.length, other.at_s];
}
"""
CLOCKS = """
async () => {
  const { PageClock, ConsoleClock } = await import('/static/page_clock.js');
  let steady = 0, wall = 0;  // milliseconds
  const page = new PageClock(() => steady, () => wall);
  const console = new ConsoleClock(page);
  const answered = (trip_ms, ahead_s) => {
    const sent = page.now_s();
    steady += trip_ms; wall += trip_ms;
    console.add(sent, sent + trip_ms / 2000 + ahead_s, sent + trip_ms / 2000 + ahead_s, page.now_s());
  };
  const unknown = console.now();
  answered(400, 1000.05); answered(20, 1000); answered(300, 999.9);
  const best = console.now(), ahead = best.now_s - page.now_s();
  wall += 60_000; // the computer slept: its steady clock stood still
  const woken = [page.now_s() - steady / 1000, console.now()];
  answered(20, 1000); answered(20, 1300); // another console answers
  const jumped = console.now().now_s - page.now_s();
  return { unknown, best: [ahead, best.uncertainty_s], woken, jumped };
}
"""
NEED = """
async () => {
  const { attention, byNeed } = await import('/static/attention.js');
  const row = (mode, action = 'walk', quality = 'localized', connected = true) => (
    { connected, mode, action, quality, reason: 'why', leads_somebody: !['ready', 'off_duty'].includes(mode) });
  const all = {
    walks: [row('guiding'), 'live'], ready: [row('ready'), 'live'], silent: [row('guiding'), 'stale'],
    stands: [row('guiding', 'stop'), 'live'], lost: [row('lost', 'stop', 'lost'), 'live'],
    fault: [row('fault', 'stop'), 'live'], unsure: [row('guiding', 'walk', 'uncertain'), 'live'],
    pauses: [row('paused', 'stop'), 'live'], gone: [row('guiding', 'walk', 'localized', false), 'lost'],
    away: [row('off_duty', 'stop', 'localized', false), 'lost'],
  };
  const rank = ([one, fresh]) => attention(one, fresh)[0];
  const listed = Object.entries(all).map(([name, seen]) => ({ id: name, name, rank: rank(seen) }));
  return listed.sort(byNeed).map(({ name }) => name);
}
"""


@dataclass
class Skewed:
    """The console's clock, which the test puts forward: what was seen is then so much older."""

    ahead_s: float = 0.0

    def __call__(self) -> float:
        return time.monotonic() + self.ahead_s


@dataclass
class Stream:
    """The way from the console to the page, which can be stopped without being closed."""

    is_frozen: bool = False
    routes: list[WebSocketRoute] = field(default_factory=list)

    def route(self, page: WebSocketRoute) -> None:
        """Pass on what comes, until it is frozen."""
        console = page.connect_to_server()
        self.routes.append(console)
        console.on_message(lambda message: None if self.is_frozen else page.send(message))


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with chromium() as running:
        yield running


@pytest.fixture
def clock(server: ConsoleServer) -> Skewed:
    skewed = Skewed()
    server.services.hub.now_s = skewed
    return skewed


@pytest.fixture
def stream() -> Stream:
    return Stream()


@pytest.fixture
def page(browser: Browser, server: ConsoleServer, clock: Skewed, stream: Stream) -> Iterator[Page]:
    context = browser.new_context(base_url=server.ready.url, viewport={"width": 1100, "height": 800})
    opened = context.new_page()
    opened.set_default_timeout(60_000)
    failures: list[str] = []
    opened.on("pageerror", lambda error: failures.append(str(error)))
    opened.clock.install()
    opened.route_web_socket(re.compile(r"/live(/overview)?\?"), stream.route)
    assert server.ready.first_link is not None
    become_admin(opened, server.ready.first_link)
    yield opened
    context.close()
    assert failures == []


def test_the_console_from_live_to_lost_and_back_and_what_is_asked_of_the_walker(
    page: Page, server: ConsoleServer, clock: Skewed, stream: Stream
) -> None:
    freshness = page.locator("#freshness")
    with server.services.watching._looking:  # nobody tells the walker yet who watches
        device = WalkingDevice(server)
        expect(freshness).to_have_text("…")
        expect(page.locator("#dated")).to_be_hidden()
    be_live(page, device)
    _what_the_watchdog_has_told_is_shown(page, device)
    _orders_go_once_are_confirmed_and_answered(page, server)
    _ages_are_those_of_the_capture(page, server, device, clock)
    _a_silent_console_makes_nothing_look_live(page, device, stream)
    _a_page_that_stood_still_does_not_say_that_the_console_was_gone(page, device, stream)
    _a_phone_will_do(page)
    assert in_both_themes(page, "the Console with a walker") == []
    device.vanish()


def be_live(page: Page, device: WalkingDevice) -> None:
    freshness = page.locator("#freshness")
    until(page, lambda: device.send_state("b") or freshness.text_content() == "LIVE", "a live device")
    assert float(page.locator("#panel").get_attribute("data-capture-to-screen-ms") or "0") >= 0.0


def _what_the_watchdog_has_told_is_shown(page: Page, device: WalkingDevice) -> None:
    device.tell("watchdog", "No guidance for 0.5 s.")
    expect(page.locator("#now-action")).to_have_text("Stop")
    expect(page.locator("#now-reason")).to_contain_text("the watchdog has told the walker to stand")
    be_live(page, device)
    expect(page.locator("#now-action")).to_contain_text("Walking")


def asked(server: ConsoleServer, kind: CommandKind) -> int:
    return sum(command.kind == kind for command in server.services.hub.device("glasses").commands)


def _orders_go_once_are_confirmed_and_answered(page: Page, server: ConsoleServer) -> None:
    commands = page.locator("#commands")
    page.get_by_role("button", name="Repeat").dblclick()
    expect(commands.locator("li", has_text="Repeat after")).to_contain_text("accepted")
    page.get_by_role("button", name="Say “Please wait, I am coming.”").click()
    expect(commands.locator("li", has_text="coming")).to_contain_text("accepted")
    assert (asked(server, "repeat"), asked(server, "say")) == (1, 1)
    for answer, count in (("Go on guiding", 0), ("Stop guiding", 1)):
        page.locator("#clear").click()
        dialog = page.get_by_role("dialog", name="Stop guiding?")
        dialog.get_by_role("button", name=answer).click()
        expect(dialog).to_have_count(0)
        until(page, lambda count=count: asked(server, "clear") == count, f"{count} orders to stop")  # type: ignore[misc]
    expect(commands.locator("li", has_text="Stop guiding after")).to_contain_text("accepted")


def _ages_are_those_of_the_capture(page: Page, server: ConsoleServer, device: WalkingDevice, clock: Skewed) -> None:
    be_live(page, device)
    server.services.alerts.check()  # it has seen that somebody is led, before the clock leaps
    pieces = lambda: (page.locator("[data-plot=inliers] .plot-line").get_attribute("d") or "").count("M")  # noqa: E731
    seen_count = until(page, pieces, "a plot")
    note = page.locator("#act-note")
    for older_s, word in ((2.0, "DELAYED"), (7.0, "STALE"), (20.0, "LOST")):
        shown = _shown_at_age(page, device, clock, older_s, word)
        is_past = word != "DELAYED"
        assert shown["isDated"] is is_past, "what is stale is dated"
        assert shown["isNoted"] is is_past, "and nothing is asked of it without a word"
        assert shown["action"][:4] == ("Was " if is_past else "Walk")
        assert ("grayscale" in shown["filter"]) is is_past
    expect(note).to_contain_text("may reach the walker late, or not at all")
    expect(page.locator("#now-reason")).not_to_contain_text("free")
    _walker_and_actions_stay_in_view(page)
    be_live(page, device)
    until(page, lambda: pieces() > seen_count, "a gap in the plot, where nothing was seen")


def _shown_at_age(page: Page, device: WalkingDevice, clock: Skewed, older_s: float, word: str) -> dict[str, Any]:
    """Let what is shown be so much older at once; return what the page shows of it, all of one instant.

    Where this machine is so busy that it is older still before it is drawn, it begins anew.
    """
    words = ["LIVE", "DELAYED", "STALE", "LOST"]

    def of_that_age() -> dict[str, Any] | None:
        shown: dict[str, Any] = page.evaluate(SHOWN)
        return shown if words.index(shown["word"]) >= words.index(word) else None

    while True:
        be_live(page, device)
        clock.ahead_s += older_s
        shown: dict[str, Any] = until(page, of_that_age, f"what is {word}")
        if shown["word"] == word:
            return shown


def _walker_and_actions_stay_in_view(page: Page) -> None:
    """With an alert, what to know before anything is asked, and three answers."""
    page.get_by_role("button", name="Repeat").click()
    for count, sentence in enumerate(("Can you hear me?", "Please wait where you are, I am on my way to you."), 2):
        page.get_by_label("Say to the walker").fill(sentence)
        page.locator("#say-send").click()
        expect(page.locator("#commands li")).to_have_count(count)
    expect(page.locator("#alerts .alert")).to_have_count(1)
    desk = page.viewport_size
    assert desk is not None
    for width, height in ((1280, 800), (390, 844)):
        page.set_viewport_size({"width": width, "height": height})
        for y_px in (0, 10_000):
            page.evaluate("y => scrollTo(0, y)", y_px)
            for part in ("#now", ".act-bar"):
                box = page.locator(part).bounding_box()
                assert box is not None
                assert box["y"] >= 0.0, (part, width, y_px)
                assert box["y"] + box["height"] <= height, (part, width, y_px)
        page.evaluate("scrollTo(0, 0)")
    page.set_viewport_size(desk)
    assert page.evaluate(TOO_HIGH_PX) <= 0, "nothing scrolls the whole page away"


def _a_silent_console_makes_nothing_look_live(page: Page, device: WalkingDevice, stream: Stream) -> None:
    stream.is_frozen = True
    words = []

    def is_lost_half_a_second_later() -> bool:
        page.clock.fast_forward(500)
        words.append(page.evaluate(SHOWN)["word"])
        return words[-1] == "LOST"

    until(page, is_lost_half_a_second_later, "what is lost")
    assert [word for word in dict.fromkeys(words) if word != "LIVE"] == ["DELAYED", "STALE", "LOST"]
    expect(page.locator("#link-banner")).to_contain_text("No connection to the console")
    expect(page.locator("#repeat")).to_be_disabled()
    expect(page.locator("#act-note")).to_contain_text("The console does not answer")
    stream.is_frozen = False
    be_live(page, device)
    expect(page.locator("#act-note")).to_be_hidden()


def _a_page_that_stood_still_does_not_say_that_the_console_was_gone(
    page: Page, device: WalkingDevice, stream: Stream
) -> None:
    for is_gone in (False, True):
        page.evaluate(WATCH_BANNER)
        stream.is_frozen = is_gone
        page.clock.fast_forward(10_000)
        if is_gone:
            expect(page.locator("#link-banner")).to_be_visible()
            page.clock.fast_forward(2_000)
            stream.is_frozen = False
        be_live(page, device)
        expect(page.locator("#link-banner")).to_be_hidden()
        seen = page.evaluate("window.bannerSeen")
        # Where the first message is long on its way through a busy machine, it was silent for the page as well.
        assert seen["said"] is (seen["shown_ms"] > 1000.0)
        assert seen["said"] or not is_gone


def _a_phone_will_do(page: Page) -> None:
    for width, height in ((390, 844), (844, 390)):
        page.set_viewport_size({"width": width, "height": height})
        assert page.evaluate(OVERFLOW_PX) <= 0, f"wider than {width} px"
        assert page.evaluate(SMALL_TARGETS, TARGET_PX) == []
        for name in ("pause", "clear", "repeat"):
            box = page.locator(f"#{name}").bounding_box()
            assert box is not None
            assert box["y"] + box["height"] <= height, f"{name} is out of a thumb's reach"


def _sound_is_asked_for_where_nobody_has_pressed_anything(page: Page) -> None:
    """In a tab of its own: whether a page may sound that comes after one where something was pressed, who knows."""
    another = page.context.new_page()
    another.goto("/overview")
    another.get_by_role("button", name="Let alerts sound").click()
    expect(another.locator("#sound-line")).to_be_hidden()
    expect(another.locator("#alert-sound")).to_have_text("Sound on")
    another.close()


def test_the_overview_shows_who_needs_somebody_and_leads_to_them(
    page: Page, server: ConsoleServer, stream: Stream
) -> None:
    card = page.locator(".walker")

    def stand() -> None:
        device.link.send(
            WalkerState(
                device.now_s(), "localized", "stop", "no_way", pose=(3.0, 0.0, 1.6, 0.0), remaining_m=3.0,
                mode=Mode.GUIDING, destination_id="b", sonar_state="no_echo",
            )
        )  # fmt: skip

    with server.services.watching._looking:  # nobody tells the walker yet who watches
        device = WalkingDevice(server)
        page.evaluate("localStorage.setItem('alert-sound', 'on')")
        page.goto("/overview")
        expect(page.locator("#counts")).to_have_text("1 walker, …")
        expect(card.locator(".badge").first).to_have_text("…")
        expect(card.locator(".action")).to_have_text("…")
    _sound_is_asked_for_where_nobody_has_pressed_anything(page)
    expect(card).to_contain_text("Glasses of Ada")
    until(page, lambda: stand() or card.get_attribute("data-need") == "warn", "one who stands on the way")
    assert page.evaluate(NEED) == [
        "fault", "gone", "silent", "lost", "stands", "unsure", "pauses", "walks", "ready", "away",
    ]  # fmt: skip
    lines, kept_count, _ = page.evaluate(GAPS)
    ends_s = [end for line in lines for end in line]
    assert ends_s == pytest.approx([120.0, 50.0, 15.0, 0.1], abs=0.6), "two lines, and nothing between them"
    assert kept_count == 1, "another device begins anew"
    clocks: dict[str, Any] = page.evaluate(CLOCKS)
    assert clocks["unknown"] is None
    assert clocks["best"] == [pytest.approx(1000.0), pytest.approx(0.01, abs=1e-3)], (
        "the answer least on the way counts"
    )
    assert clocks["woken"] == [pytest.approx(60.0), None], "after a sleep the console's time is not known"
    assert clocks["jumped"] == pytest.approx(1300.0)
    assert in_both_themes(page, "the overview with a walker") == []
    until(page, lambda: stand() or "between Hall and Bar" in (card.text_content() or ""), "where they are")
    expect(page.locator("#counts")).to_have_text("1 walker, 1 guided, 1 to look after")
    stream.is_frozen = True
    page.clock.fast_forward(10_000)
    expect(page.locator("#counts")).to_contain_text("all to look after")
    expect(card).to_contain_text("Was told to stand")
    stream.is_frozen = False
    # The alert, and what is drawn anew, move the card: by a key it is chosen all the same.
    expect(page.locator("#counts")).to_have_text("1 walker, 1 guided, 1 to look after")
    expect(page.locator("#alerts")).to_contain_text("Nothing heard while leading")
    card.get_by_role("link").press("Enter")
    expect(page.locator("#device-name")).to_have_text("Glasses of Ada")
    assert page.url.endswith("/?device=glasses")
    device.vanish()

"""Alerts in a real Chromium: raised, heard, said once, acknowledged by the keyboard, seen by somebody else, over."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from dataclasses import replace

import pytest
from accessibility import in_both_themes
from browser import become_admin, chromium, until
from console_room import PASSWORD, DialledDevice, hello_of, invited
from playwright.sync_api import Browser, Page, expect
from test_alerts_engine import first_admin_again
from websockets.exceptions import ConnectionClosed

from console.alerts.rules import RULES
from console.overview_socket import messages
from console.server import ConsoleServer
from navcore.modes import Mode
from navcore.wire import Ping, Pong, WalkerState, decode_from_console

pytestmark = pytest.mark.browser
AT_ONCE = {kind: replace(rule, on_delay_s=0.0, off_delay_s=0.0) for kind, rule in RULES.items()}
COUNT_WHAT_IS_SAID = """
() => {
  window.said = [];
  new MutationObserver(() => window.said.push(document.getElementById("alert-said").textContent))
    .observe(document.getElementById("alert-said"), { childList: true, characterData: true, subtree: true });
}
"""
WHEN_IT_SOUNDS = """
async () => {
  const { SoundSchedule } = await import("/static/alert-sound.js");
  const alert = (priority, phase = "unacknowledged", id = priority) => ({ id, priority, phase, times: 1 });
  const schedule = new SoundSchedule();
  const low = alert("low"), high = alert("high");
  return [
    schedule.next([low], 0), schedule.next([low], 100), schedule.next([high, low], 101),
    schedule.next([high, low], 110),
    schedule.next([high, low], 111), schedule.next([alert("high", "acknowledged"), low], 130),
    schedule.next([alert("high", "shelved")], 200), schedule.next([high], 201),
  ];
}
"""


WHAT_SOUNDS_AMONG_THE_LESS_URGENT = """
async () => {
  const { SoundSchedule } = await import("/static/alert-sound.js");
  const schedule = new SoundSchedule(), phase = "unacknowledged", heard = { high: [], low: 0 };
  for (let now_s = 0; now_s < 60; now_s += 0.5) {
    const low = { id: "low", priority: "low", phase, times: 1 + Math.floor(now_s / 6) };
    const priority = schedule.next([{ id: "high", priority: "high", phase, times: 1 }, low], now_s);
    if (priority === "high") heard.high.push(now_s);
    if (priority === "low") heard.low += 1;
  }
  return heard;
}
"""
WHAT_IS_KNOWN_AFTER_A_SLEEP = """
async () => {
  const { onAlerts } = await import("/static/alert-feed.js");
  const awake = Date.now;
  Date.now = () => awake() + 3600e3;
  try {
    return await new Promise((resolve) => onAlerts((alerts, elapsed_s, known) => resolve([elapsed_s > 3590, known])));
  } finally {
    Date.now = awake;
  }
}
"""
ROWS_AFTER_A_NEW_STREAM = """
async ([before, after]) => {
  const { OverviewRows } = await import("/static/overview-rows.js");
  const known = new OverviewRows(), counts = [];
  for (const message of before) known.take(message);
  for (const message of after) {
    known.take(message);
    counts.push(known.rows.size);
  }
  return [counts, [...known.rows.keys()].sort()];
}
"""


class FaultyDevice:
    """A device on a real link that tells its state five times a second, and is at fault as long as it is told to be."""

    def __init__(self, server: ConsoleServer) -> None:
        token = server.services.devices.create_token("Glasses of Ada", "test")
        self.now_s = server.services.hub.now_s
        self.link = DialledDevice(server.ready.url, token, hello_of(server, now_s=self.now_s()))
        self.is_faulty = threading.Event()
        self._ends = threading.Event()
        self._threads = [threading.Thread(target=work, daemon=True) for work in (self._tell, self._answer)]
        for thread in self._threads:
            thread.start()

    def close(self) -> None:
        """Vanish."""
        self._ends.set()
        self.link.socket.close()
        for thread in self._threads:
            thread.join()

    def _tell(self) -> None:
        while not self._ends.wait(0.2):
            mode, reason = (Mode.FAULT, "sensor_stale") if self.is_faulty.is_set() else (Mode.READY, "no_route")
            try:
                self.link.send(WalkerState(self.now_s(), "localized", "stop", reason, mode=mode))
            except ConnectionClosed:
                return

    def _answer(self) -> None:
        try:
            for data in self.link.socket:
                message = decode_from_console(bytes(data))  # type: ignore[arg-type]
                if isinstance(message, Ping):
                    self.link.send(Pong(message.console_sent_s, self.now_s(), self.now_s()))
        except ConnectionClosed:
            return


@pytest.fixture
def browser() -> Iterator[Browser]:
    with chromium() as running:
        yield running


@pytest.fixture
def device(server: ConsoleServer) -> Iterator[FaultyDevice]:
    device = FaultyDevice(server)
    yield device
    device.close()


def on_alerts(page: Page) -> Page:
    page.goto("/alerts")
    expect(page.locator("body:not([inert])")).to_be_attached()
    expect(page.locator("#alert-count")).to_have_text("No alerts")
    return page


def test_an_alert_is_raised_heard_said_once_acknowledged_and_over_for_everybody(
    browser: Browser, server: ConsoleServer, device: FaultyDevice
) -> None:
    server.services.alerts.rules = AT_ONCE
    hers, his = (browser.new_context(base_url=server.ready.url).new_page() for _ in range(2))
    assert server.ready.first_link is not None
    become_admin(hers, server.ready.first_link)
    invited(first_admin_again(server), "Vera", "viewer")
    his.context.request.post(
        "/api/sign-in", data={"name": "Vera", "password": PASSWORD}, headers={"Origin": server.ready.url}
    )
    for page in (hers, his):
        on_alerts(page)
    hers.evaluate(COUNT_WHAT_IS_SAID)
    sound = hers.locator("#alert-sound")
    expect(sound).to_have_attribute("data-state", "off")
    sound.press("Enter")
    expect(sound).to_have_attribute("data-state", "on")

    device.is_faulty.set()
    alert = hers.locator(".alert")
    expect(alert).to_contain_text("Glasses of Ada has stopped the walker: A sensor has stopped delivering.")
    expect(alert).to_contain_text("high")
    expect(hers.locator("#alert-count")).to_have_text("1 alert")
    expect(hers).to_have_title("(1) Alerts · Virtual blind road")
    expect(sound).to_have_attribute("data-last", "high")
    expect(his.locator("#alert-sound")).to_have_attribute("data-state", "off")
    until(hers, lambda: hers.evaluate("window.said.length"), "what a screen reader hears")
    found = in_both_themes(hers, "an alert")

    hers.get_by_role("button", name="Shelve…: The device has failed").press("Enter")
    dialog = hers.get_by_role("dialog", name="Shelve this alert")
    dialog.get_by_label("Why?").fill("We are with her.")
    hers.keyboard.press("Enter")
    expect(his.locator(".alert")).to_contain_text("shelved by Ada: “We are with her.”")
    expect(his.locator("#alert-count")).to_have_text("No new alerts, 1 seen")
    his.get_by_role("button", name="Take off the shelf").press("Enter")
    expect(hers.locator("#alert-count")).to_have_text("1 alert")

    hers.get_by_role("button", name="Acknowledge: The device has failed").press("Enter")
    expect(his.locator(".alert")).to_contain_text("seen by Ada")
    expect(hers.get_by_role("button", name="Shelve…")).to_be_focused()
    device.is_faulty.clear()
    for page in (hers, his):
        expect(page.locator(".alert")).to_have_count(0)
        expect(page.locator("#alert-count")).to_have_text("No alerts")
    row = hers.locator("#history tr")
    expect(row).to_contain_text("Ada")
    row.locator("summary").press("Enter")
    expect(row).to_contain_text("shelved by Ada (5 min: We are with her.)")
    expect(hers.locator("#incidents tr")).to_contain_text("A sensor has stopped delivering.")
    said = hers.evaluate("window.said.length")
    # What it looked like then: the player of past walks, over the incident's messages.
    server.services.incidents.close()
    hers.get_by_role("link", name="Look at it: the incident of").click()
    expect(hers.locator("#walk-title")).to_contain_text("Incident of")
    expect(hers.locator("#past-banner")).to_contain_text("Nothing on this page is happening now.")
    hers.locator("#marks li", has_text="Alert").get_by_role("button").click()
    expect(hers.locator("#past-now-state")).to_have_text("Fault")
    expect(hers.locator("#past-mark")).to_contain_text("Incident: 0:")
    expect(hers.locator("#past-trace .trace-sentence")).to_contain_text("Stop: ")
    found += in_both_themes(hers, "an incident")
    assert found == []
    assert said == 1, "a screen reader hears a new alert once, not at every refresh"
    assert hers.evaluate(WHEN_IT_SOUNDS) == ["low", None, "high", None, "high", None, None, "high"]
    heard = hers.evaluate(WHAT_SOUNDS_AMONG_THE_LESS_URGENT)
    assert heard == {"high": [0, 10, 20, 30, 40, 50], "low": 10}, "each as if it were alone"
    assert hers.evaluate(WHAT_IS_KNOWN_AFTER_A_SLEEP) == [True, False]
    names = [f"glasses-{number:02}" for number in range(60)]
    streams = [list(messages({}, {name: {"name": name} for name in some})) for some in (names, [*names[1:], "new"])]
    counts, shown = hers.evaluate(ROWS_AFTER_A_NEW_STREAM, streams)
    assert (counts, shown) == ([60, 60], [*names[1:], "new"]), "nobody vanishes while the rest is still to be told"

    server.stop()
    expect(his.locator("#alert-count")).to_have_text("Alerts not known")

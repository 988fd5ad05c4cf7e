"""The parts of the monitor's benchmark: ages are of what a screen shows, and a device keeps what is not confirmed."""

from __future__ import annotations

import asyncio
import json
import time

import numpy as np
import pytest
from console_room import Person

from benchmarks.monitor_browsers import Seen, console_page, look
from benchmarks.monitor_devices import CAPTURED, Told, captured_s, walk_all
from console.server import ConsoleServer


def panel(at_s: float) -> str:
    return json.dumps({"devices": [{"id": "g", "freshness": "live", "state": {"last_cue": f"{CAPTURED}{at_s}"}}]})


def test_what_stays_on_the_screen_grows_old_and_what_is_sent_again_is_not_new() -> None:
    seen = Seen()
    for came_s, at_s in ((10.0, 9.9), (10.5, 9.9), (11.0, 10.8)):
        seen.take(panel(at_s), came_s)
    assert seen.delays_s(0.0, 20.0) == pytest.approx([0.1, 0.2])
    ages_s = seen.ages_s(9.0, 12.0)
    assert ages_s.max() == pytest.approx(1.2, abs=0.02), "just before the end"
    assert np.mean(ages_s) == pytest.approx(0.65, abs=0.02)
    assert len(ages_s) == pytest.approx(120, abs=1), "before the first there is nothing to be old"


def test_a_device_tells_again_what_was_not_confirmed() -> None:
    told = Told("g")
    events = [told.next_event() for _ in range(3)]
    told.confirmed(2)
    told.confirmed(1)
    assert (told.confirmed_sequence, told.unconfirmed()) == (2, events[2:])


def test_a_simulated_device_is_seen_by_a_browser_of_few_words(server: ConsoleServer, admin: Person) -> None:
    token = server.services.devices.create_token("Glasses", "test")
    cookie = "; ".join(f"{name}={value}" for name, value in admin.http.cookies.items())
    url, seen = server.ready.url, Seen()

    async def watched() -> Told:
        browser = asyncio.create_task(look(url, cookie, console_page("glasses-0"), time.monotonic() + 60.0, seen))
        (told,) = await asyncio.to_thread(walk_all, url.replace("http", "ws"), [token], 1.0, 20.0)
        state = server.services.hub.device("glasses-0").state
        assert state is not None
        while not browser.done() and last_captured_s(seen) != captured_s(state.last_cue):
            await asyncio.sleep(0.01)
        assert last_captured_s(seen) == captured_s(state.last_cue)
        browser.cancel()
        return told

    told = asyncio.run(watched())
    assert told.events_count == told.confirmed_sequence > 0
    assert np.all(seen.delays_s(-np.inf, np.inf) >= 0.0)


def last_captured_s(seen: Seen) -> float | None:
    """When what a browser shows last was captured."""
    return seen.arrivals["glasses-0"][-1][1] if "glasses-0" in seen.arrivals else None

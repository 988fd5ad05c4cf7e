"""Where the watchdog of a device has told *Stop*, no page goes on to say *Walk*; who is awaited is not called lost."""

from __future__ import annotations

import msgspec
import pytest
from test_alerts_engine import NoOutlet

from console.hub import DeviceHub
from console.live import STALE_AFTER_S
from console.live_panel import changing_view, device_view
from console.viewer.live_view import LiveView
from console.viewer.walker_panel import status
from device_agent.adapters.clocks import SteppedClock
from device_agent.adapters.fakes import FakeOutput
from device_agent.watchdog import Heartbeat, Watchdog
from navcore.modes import Mode
from navcore.planning.poi_graph import PoiGraph
from navcore.wire import PROTOCOL_VERSION, Event, Hello, WalkerState

BEGAN_S = 100.0
HELLO = Hello(PROTOCOL_VERSION, "glasses", "0.1", "small", "x", 1, 0, BEGAN_S)
WALKS = WalkerState(BEGAN_S, "localized", "walk", "ok", direction_rad=0.1, mode=Mode.GUIDING, destination_id="b")


class Told:
    """A real watchdog over a loop that stands still, whose events a console hears; both have the same clock."""

    def __init__(self) -> None:
        self.clock = SteppedClock(BEGAN_S)
        self.hub = DeviceHub(now_s=self.clock.now_s)
        self.hub.connect(HELLO, "Glasses", NoOutlet())
        self.count = 0
        self.watchdog = Watchdog(self.clock, FakeOutput(), self.event)

    def event(self, stamp_s: float, text: str) -> None:
        """Hear of something from the watchdog."""
        self.count += 1
        self.hub.receive("glasses", Event(self.count, stamp_s, "watchdog", text))

    def cycle(self, state: WalkerState) -> None:
        """Let the loop decide."""
        now_s = self.clock.now_s()
        self.watchdog.beat(Heartbeat(now_s, leading=True))
        self.watchdog.check()
        self.hub.receive("glasses", msgspec.structs.replace(state, stamp_s=now_s))

    @property
    def shown(self) -> tuple[str, str]:
        """What a page says that the walker is told, and why."""
        view = device_view(self.hub.device("glasses"), self.clock.now_s())["state"]
        assert view["direction_rad"] is None or view["action"] != "stop"
        return view["action"], view["trace"]["sentence"]


@pytest.fixture
def told() -> Told:
    return Told()


def test_what_the_watchdog_has_told_is_shown_with_its_sentence_until_the_loop_decides_again(told: Told) -> None:
    told.cycle(WALKS)
    assert told.shown[0] == "walk"
    told.clock.sleep_until(BEGAN_S + 0.6)
    told.watchdog.check()
    action, sentence = told.shown
    assert action == "stop"
    assert sentence == (
        "Stop: no decision came in time, so the watchdog has told the walker to stand (No guidance for 0.6 s)."
    )
    assert "Stop" in status(LiveView(told.hub.device("glasses"), told.clock.now_s()), PoiGraph(), is_there=True)
    told.hub.receive("glasses", WALKS)
    assert told.shown[0] == "stop", "a decision of before comes late"
    told.cycle(WALKS)
    assert told.shown[0] == "walk"
    told.watchdog.fault("scan failed")
    told.clock.sleep_until(told.clock.now_s() + 0.1)
    told.hub.receive("glasses", msgspec.structs.replace(WALKS, stamp_s=told.clock.now_s()))
    assert told.shown[0] == "walk", "what was decided since counts"


def test_who_stands_for_another_reason_still_does_and_events_of_before_a_start_overrule_nothing(told: Told) -> None:
    paused = msgspec.structs.replace(WALKS, action="stop", reason="paused", direction_rad=None, mode=Mode.PAUSED)
    told.cycle(paused)
    told.event(told.clock.now_s() + 0.5, "No guidance for 0.5 s.")
    assert "watchdog" not in told.shown[1]
    told.event(told.clock.now_s() + STALE_AFTER_S + 1.0, "No guidance for 0.5 s.")
    told.hub.receive("glasses", WALKS)
    assert told.shown[0] == "walk", "the device has started its clock anew since"


def test_a_device_that_has_just_connected_is_awaited_and_then_lost(told: Told) -> None:
    def is_told(*, is_watched: bool) -> bool:
        shown = changing_view(told.hub.device("glasses"), told.clock.now_s(), is_watched=is_watched)["is_told"]
        return bool(shown)

    def words(*, is_shown: bool = True) -> str:
        device = told.hub.device("glasses")
        return status(LiveView(device if is_shown else None, told.clock.now_s()), PoiGraph(), is_there=True)

    assert not is_told(is_watched=True)
    assert "Not told yet" in words()
    told.clock.sleep_until(BEGAN_S + STALE_AFTER_S + 0.1)
    assert is_told(is_watched=True), "now it is said that it has sent nothing"
    assert "has sent no position" in words()
    told.cycle(WALKS)
    assert is_told(is_watched=True)
    assert not is_told(is_watched=False), "the walker hears first that somebody watches"
    assert "Not told yet" in words(is_shown=False)
    assert "No device has connected" in status(LiveView(None, 0.0), PoiGraph(), is_there=False)

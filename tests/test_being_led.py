"""Whether somebody is being led: device, console, alerts and past walks say the same of every state."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from recorded_walk import STORED_WALK
from test_alerts_engine import NoOutlet
from test_device_states import state_in
from test_past_walks import take

from console.alerts.rules import observe
from console.hub import DeviceHub
from console.live_panel import device_view
from console.overview import overview_row
from console.past_walks import PastWalks
from console.place_words import PlaceWords
from console.recordings import Recordings
from console.walk_marks import led
from console.walk_reading import read_walk
from console.walk_timeline import WalkTimeline
from device_agent.cycle import Cycle, walker_state
from navcore.modes import Mode
from navcore.planning.poi_graph import PoiGraph
from navcore.types import Action, Guidance, Reason
from navcore.wire import PROTOCOL_VERSION, Hello, Pong, WalkerState

STATES = [*((mode, None) for mode in Mode if mode is not Mode.FAULT), *((Mode.FAULT, mode) for mode in Mode)]


@pytest.fixture(scope="module")
def timeline(tmp_path_factory: pytest.TempPathFactory) -> WalkTimeline:
    recordings = Recordings(tmp_path_factory.mktemp("recordings"), lambda: 1_800_000_000.0)
    take(recordings, STORED_WALK.read_bytes())
    (walk,) = PastWalks(recordings).all()
    return read_walk(walk)


def of_one_state(timeline: WalkTimeline, state: WalkerState) -> WalkTimeline:
    """Return a past walk that was in this state all the time."""
    words = (state.mode.value, state.destination_id or "")
    codes = timeline.columns.codes | {
        name: np.full_like(timeline.columns.codes[name], index) for index, name in enumerate(("mode", "destination_id"))
    }
    return replace(timeline, columns=replace(timeline.columns, words=words, codes=codes))


@pytest.mark.parametrize(("mode", "beneath"), [pair for pair in STATES if pair[1] is not Mode.FAULT])
def test_all_say_the_same_of_who_is_being_led(timeline: WalkTimeline, mode: Mode, beneath: Mode | None) -> None:
    device = state_in(mode, beneath)
    told = walker_state(device, Cycle(100.0, Guidance(100.0, Action.STOP, None, Reason.NO_ROUTE)), None, 10.0)
    hub = DeviceHub(now_s=lambda: 100.0)
    hub.connect(Hello(PROTOCOL_VERSION, "glasses", "0", "s", "m", 1, 0, 100.0), "Glasses", NoOutlet())
    hub.receive("glasses", Pong(100.0, 100.0, 100.0))
    hub.receive("glasses", told)
    shown = hub.device("glasses")
    graph = PoiGraph()
    said = {
        "console": shown.leads_somebody,
        "page": device_view(shown, 100.0)["leads_somebody"],
        "overview": overview_row(shown, graph, PlaceWords(graph))["leads_somebody"],
        "alerts": observe(shown, 100.0, 100.0, was_led=not device.leading).was_led,
        "past walks": bool(led(of_one_state(timeline, told)).all()),
    }
    assert said == dict.fromkeys(said, device.leading)
    assert device.leading == ((beneath or mode) in {Mode.GUIDING, Mode.LOST, Mode.PAUSED})

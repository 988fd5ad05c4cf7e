"""What the console's orders do: pure steps from state to state."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from device_agent.adapters.fakes import FakeLocalizer
from device_agent.orders import at_rest, carry_out
from device_agent.state import (
    DeviceState,
    Happened,
    Notice,
    Outdated,
    PreparedMap,
    RunSettings,
    StoreGraph,
    StoreSettings,
    SwapMap,
)
from navcore.modes import Mode
from navcore.planning.poi_graph import Edge, PoiGraph
from navcore.settings import Settings
from navcore.site import Site
from navcore.types import Localization, LocalizationQuality, Route
from navcore.wire import (
    ApplySettings,
    ClearDestination,
    GraphRunning,
    MapRunning,
    Pause,
    PublishGraph,
    Resume,
    Say,
    SetDestination,
    SettingsRunning,
)


@pytest.fixture
def ready(small_site: Site) -> DeviceState:
    return DeviceState(Settings(), small_site.poi_graph, "small", "old", mode=Mode.READY)


@pytest.fixture
def guiding(ready: DeviceState) -> DeviceState:
    route = Route(np.zeros((1, 2)), np.zeros(1))
    return replace(ready, mode=Mode.GUIDING, destination_id="b", route=route, route_version=1)


def test_a_settings_change_runs_whole_or_not_at_all(ready: DeviceState) -> None:
    state, effects = carry_out(ready, ApplySettings(8, {"follower.sub_goal_distance_m": 2.5}), 0.0)
    assert state.settings.follower.sub_goal_distance_m == 2.5
    assert [type(effect) for effect in effects] == [RunSettings, StoreSettings, SettingsRunning]
    assert effects[2] == SettingsRunning(8, state.settings.values())
    refused, answers = carry_out(
        state, ApplySettings(9, {"follower.sub_goal_distance_m": 1.5, "gate.clearance_m": 99.0}), 0.0
    )
    assert refused is state
    (answer,) = answers
    assert isinstance(answer, SettingsRunning)
    assert (answer.revision, answer.refused_revision) == (8, 9)
    assert "gate.clearance_m cannot be 99.0" in answer.refusal


def test_a_graph_is_taken_at_once_only_when_nobody_is_led(ready: DeviceState, guiding: DeviceState) -> None:
    graph = PoiGraph(version=5, pois=ready.graph.pois)
    state, effects = at_rest(carry_out(ready, PublishGraph(graph), 0.0)[0])
    assert state.graph is graph
    assert [type(effect) for effect in effects] == [StoreGraph, GraphRunning]
    for leading in (guiding, replace(guiding, mode=Mode.PAUSED)):
        waiting, effects = at_rest(carry_out(leading, PublishGraph(graph), 0.0)[0])
        assert waiting.graph is guiding.graph
        assert effects == ()
        cleared = carry_out(waiting, ClearDestination(), 0.0)[0]
        taken, effects = at_rest(cleared)
        assert taken.graph is graph
        assert effects[-1] == GraphRunning(5)
        assert at_rest(replace(waiting, mode=Mode.ARRIVED))[0].graph is graph


def test_an_unsound_graph_is_refused(ready: DeviceState) -> None:
    graph = PoiGraph(2, ready.graph.pois, {"x": Edge("x", "a", "gone", ((0.0, 0.0), (1.0, 0.0)), 1.0)})
    state, (answer,) = carry_out(ready, PublishGraph(graph), 0.0)
    assert state is ready
    assert isinstance(answer, GraphRunning)
    assert (answer.version, "edge x" in answer.refusal) == (1, True)


def test_a_map_is_swapped_only_at_rest_and_forgets_the_old_frame_of_reference(
    guiding: DeviceState, small_site: Site
) -> None:
    lost = FakeLocalizer(lambda frame: Localization(frame.stamp_s, LocalizationQuality.LOST, None))
    prepared = PreparedMap(Path("staging"), "new", small_site, lost)
    waiting, told = carry_out(guiding, prepared, 0.0)
    assert told == (MapRunning(guiding.map_checksum, waiting_checksum="new"),)
    assert at_rest(waiting) == (waiting, ())
    rested, effects = at_rest(carry_out(replace(waiting, trail=((0.0, 1.0, 1.0),)), ClearDestination(), 0.0)[0])
    assert (rested.map_checksum, rested.route, rested.trail, rested.waiting_map) == ("new", None, (), None)
    assert isinstance(effects[0], Outdated), "before anything is said of the new map"
    assert isinstance(effects[1], SwapMap)
    assert effects[1].prepared is prepared
    assert effects[2:] == (MapRunning("new"), GraphRunning(1))


@pytest.mark.parametrize(
    ("mode", "taken"),
    [
        (Mode.OFF_DUTY, True), (Mode.LOCALIZING, True), (Mode.READY, True), (Mode.ARRIVED, True),
        (Mode.MAPPING, False), (Mode.GUIDING, False), (Mode.PAUSED, False), (Mode.LOST, False),
    ],
)  # fmt: skip
@pytest.mark.parametrize("faulty", [False, True])
def test_a_map_is_taken_between_walks_alone(
    guiding: DeviceState, small_site: Site, mode: Mode, taken: bool, faulty: bool
) -> None:
    lost = FakeLocalizer(lambda frame: Localization(frame.stamp_s, LocalizationQuality.LOST, None))
    state = replace(guiding, mode=Mode.FAULT, beneath=mode) if faulty else replace(guiding, mode=mode)
    waiting, told = carry_out(state, PreparedMap(Path("staging"), "new", small_site, lost), 0.0)
    assert bool(told) is not taken
    assert (at_rest(waiting)[0].map_checksum == "new") is taken


def test_pause_and_resume_only_where_they_make_sense(ready: DeviceState, guiding: DeviceState) -> None:
    for order in (Pause(), Resume()):
        state, (told, for_the_record) = carry_out(ready, order, 0.0)
        assert state.mode is Mode.READY
        assert told == Notice("You are not being led.", answers=True)
        assert isinstance(for_the_record, Happened)
    paused = carry_out(guiding, Pause(), 0.0)[0]
    assert paused.mode is Mode.PAUSED
    resumed = carry_out(paused, Resume(), 0.0)[0]
    assert (resumed.mode, resumed.wanted_id) == (Mode.GUIDING, "b")


def test_whoever_is_on_their_way_is_led_on_until_the_new_way_exists(guiding: DeviceState) -> None:
    state, effects = carry_out(guiding, SetDestination("elsewhere"), 0.0)
    assert (state.route, state.destination_id, state.wanted_id) == (guiding.route, "b", "elsewhere")
    assert effects[0] == Notice("The console leads you to elsewhere. Hold previous to keep Bar.")


def test_a_message_is_spoken(ready: DeviceState) -> None:
    state, effects = carry_out(ready, Say("Lunch is ready."), 0.0)
    assert state is ready
    assert effects[0] == Notice("Lunch is ready.")

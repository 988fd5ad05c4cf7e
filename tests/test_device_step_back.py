"""Who stands before something low that no image shows is led back a little, to look from there."""

from __future__ import annotations

from dataclasses import replace

import msgspec
import numpy as np
import pytest
from test_device_way import HOLD_S, SETTINGS, at, heard, leading, ring, standing, stops

from device_agent import step_back
from device_agent.orders import carry_out
from device_agent.state import BlockedPlace, DeviceState, Notice
from device_agent.way import plan_if_needed
from navcore.geometry import world_from_camera_at
from navcore.guide import guide
from navcore.planning.poi_graph import PoiGraph
from navcore.planning.way_finding import Blockage
from navcore.types import (
    Action,
    BearingState,
    DecisionTrace,
    Localization,
    LocalizationQuality,
    ObstacleScan,
    Pose2D,
    Reason,
    Route,
    TurnKind,
)
from navcore.wire import PublishGraph, SetDestination

TOLD = "Looking again from farther back."


def at_the_feet(graph: PoiGraph | None = None, x_m: float = 6.0, **trace: object) -> DeviceState:
    """Somebody who walked from (2, 0) towards B and has come to a stand at ``x_m``, before what no image shows."""
    state = leading(graph or ring("ab"))
    state = standing(
        state, Action.STOP, Reason.OBSTACLE_DEPTH, 0.0, nearest_ahead_m=0.5,
        closest_index=round((x_m - 2.0) * 10), position=(x_m, 0.0), **trace,
    )  # fmt: skip
    return replace(state, is_hidden_ahead=True)


def ends_m(route: Route | None) -> list[tuple[float, float]]:
    assert route is not None
    return [(round(float(x), 1) + 0.0, round(float(y), 1) + 0.0) for x, y in route.points_m[[0, -1]]]


def test_who_stands_before_what_no_image_shows_is_led_back_along_the_road_and_told_so():
    state = at_the_feet()
    assert plan_if_needed(state, at(6.0), HOLD_S - 0.1)[0].route is state.route, "it may go away by itself"
    step = plan_if_needed(state, at(6.0), HOLD_S)
    assert heard(step) == [TOLD]
    assert ends_m(step[0].route) == [(6.0, 0.0), (1.0, 0.0)], "the road goes on behind the place where the way began"
    assert step_back.is_under_way(step[0])
    assert step[0].destination_id == "b"
    assert all(effect.answers for effect in step[1] if isinstance(effect, Notice)), "it is not said late"


def test_what_the_image_shows_is_gone_round_or_waited_before_as_ever():
    step = plan_if_needed(replace(at_the_feet(), is_hidden_ahead=False), at(6.0), HOLD_S)
    assert heard(step) == ["The way is blocked, and there is no other. Wait, or ask for help."]


def test_turning_to_and_fro_before_it_leads_back_too_but_later():
    state = at_the_feet()
    assert state.guidance is not None
    trace = replace(state.guidance.trace, turn=TurnKind.ASIDE)
    state = replace(state, guidance=replace(state.guidance, action=Action.TURN, reason=Reason.OK, trace=trace))
    assert not heard(plan_if_needed(state, at(6.0), HOLD_S))
    assert heard(plan_if_needed(state, at(6.0), 2 * HOLD_S)) == [TOLD]


def led_back(graph: PoiGraph | None = None) -> DeviceState:
    state, _ = plan_if_needed(at_the_feet(graph), at(6.0), HOLD_S)
    return standing(state, Action.WALK, Reason.OK, HOLD_S)


def test_far_enough_away_the_way_leads_on_to_the_destination():
    state = led_back()
    near = at(6.0 - step_back.BACK_M + 0.1, heading_deg=180.0)
    assert plan_if_needed(state, near, HOLD_S + 4.0)[0].route is state.route
    far = at(6.0 - step_back.BACK_M, heading_deg=180.0)
    step = plan_if_needed(state, far, HOLD_S + 5.0)
    assert ends_m(step[0].route) == [(6.0 - step_back.BACK_M, 0.0), (10.0, 0.0)]
    assert not step_back.is_under_way(step[0])
    assert heard(step) == []


def test_whoever_is_stopped_on_the_way_back_looks_again_from_there():
    state = standing(led_back(), Action.STOP, Reason.OBSTACLE_DEPTH, HOLD_S, nearest_ahead_m=0.6)
    step = plan_if_needed(state, at(5.5, heading_deg=180.0), 2 * HOLD_S)
    assert ends_m(step[0].route) == [(5.5, 0.0), (10.0, 0.0)]


def test_nobody_is_sent_back_from_the_same_place_twice():
    state, _ = plan_if_needed(led_back(), at(4.5), HOLD_S + 5.0)
    again = replace(at_the_feet(), step_back=state.step_back, route=state.route, route_version=state.route_version)
    assert not step_back.helps(again, HOLD_S + 30.0)
    assert step_back.helps(again, HOLD_S + SETTINGS.planning.blocked_memory_s + 1.0), "it may have gone by then"
    assert again.guidance is not None
    elsewhere = replace(again.guidance, trace=replace(again.guidance.trace, position=(9.5, 0.0)))
    assert step_back.helps(replace(again, guidance=elsewhere), HOLD_S + 30.0)


@pytest.mark.parametrize(
    ("why", "x_m", "one_way"), [("the road begins here", 1.9, False), ("nobody walks it this way", 6.0, True)]
)
def test_where_no_way_leads_back_it_is_waited(why: str, x_m: float, one_way: bool):
    graph = ring("ab")
    edge = msgspec.structs.replace(graph.edges["ab"], one_way=one_way)
    graph = PoiGraph(1, graph.pois, {"ab": edge})
    state, _ = carry_out(DeviceState(SETTINGS, graph), SetDestination("b"), 0.0)
    state, _ = plan_if_needed(state, at(x_m), 0.0)
    state = standing(state, Action.STOP, Reason.OBSTACLE_DEPTH, 0.0, nearest_ahead_m=0.5, position=(x_m, 0.0))
    step = plan_if_needed(replace(state, is_hidden_ahead=True), at(x_m), HOLD_S)
    assert heard(step) == ["The way is blocked, and there is no other. Wait, or ask for help."], why


def stood_at(graph: PoiGraph, start_m: tuple[float, float], goal: str, index: int) -> DeviceState:
    """Somebody on their way from a place, who has come to a stand at a point of their route."""
    state, _ = carry_out(DeviceState(SETTINGS, graph), SetDestination(goal), 0.0)
    state, _ = plan_if_needed(state, at(*start_m), 0.0)
    assert state.route is not None
    position = tuple(state.route.points_m[index].tolist())
    state = standing(state, Action.STOP, Reason.OBSTACLE_DEPTH, 0.0, closest_index=index, position=position)
    return replace(state, is_hidden_ahead=True)


def with_edge(graph: PoiGraph, key: str, **changes: object) -> PoiGraph:
    return PoiGraph(1, graph.pois, {**graph.edges, key: msgspec.structs.replace(graph.edges[key], **changes)})


def test_an_edge_that_is_walked_from_its_end_is_walked_back_to_its_end() -> None:
    state = stood_at(ring("ab"), (8.0, 0.0), "a", 40)
    assert ends_m(step_back.way_back(state)) == [(4.0, 0.0), (9.0, 0.0)]


def test_the_way_back_goes_on_round_the_corner_that_was_walked() -> None:
    state = stood_at(ring("ab", "bc"), (6.0, 0.0), "c", 55)
    back = step_back.way_back(state)
    assert ends_m(back) == [(10.0, 1.5), (6.5, 0.0)]
    assert back is not None
    assert [piece.edge_id for piece in back.pieces] == ["bc", "ab"], "who is asked where they are knows it still"


@pytest.mark.parametrize("changes", [{"one_way": True}, {"closed": True}])
def test_it_ends_before_an_edge_that_may_not_be_walked(changes: dict[str, bool]) -> None:
    state = stood_at(ring("ab", "bc"), (6.0, 0.0), "c", 72)
    assert ends_m(step_back.way_back(replace(state, graph=with_edge(state.graph, "ab", **changes)))) == [
        (10.0, 3.2), (10.0, 0.0)
    ]  # fmt: skip
    near = stood_at(ring("ab", "bc"), (6.0, 0.0), "c", 55)
    assert step_back.way_back(replace(near, graph=with_edge(near.graph, "ab", **changes))) is None, "too short"


def test_it_ends_before_what_is_known_to_block_it_and_before_stairs() -> None:
    state = at_the_feet()
    behind = BlockedPlace(0.0, Blockage("ab", 2.5))
    assert ends_m(step_back.way_back(replace(state, blocked=(behind,)))) == [(6.0, 0.0), (3.2, 0.0)]
    assert step_back.way_back(replace(state, blocked=(BlockedPlace(0.0, Blockage("ab", 4.0)),))) is None
    ahead = BlockedPlace(0.0, Blockage("ab", 6.5))
    assert ends_m(step_back.way_back(replace(state, blocked=(ahead,)))) == [(6.0, 0.0), (1.0, 0.0)]
    stairs = msgspec.structs.replace(state.graph.pois["a"], kind="stairs")
    graph = PoiGraph(1, {**state.graph.pois, "a": stairs}, state.graph.edges)
    near = at_the_feet(graph, x_m=4.5)
    assert ends_m(step_back.way_back(near)) == [(4.5, 0.0), (1.0, 0.0)], "a metre before them"


def test_an_edge_that_is_closed_meanwhile_is_not_walked_on() -> None:
    state = led_back(ring())
    closed = with_edge(state.graph, "ab", closed=True)
    closed = PoiGraph(2, closed.pois, closed.edges)
    state, effects = carry_out(state, PublishGraph(closed), HOLD_S + 1.0)
    assert [effect.text for effect in effects if isinstance(effect, Notice)] == ["The way ahead has been closed."]
    state, _ = plan_if_needed(state, at(5.5, heading_deg=180.0), HOLD_S + 1.0)
    assert not step_back.is_under_way(state)
    assert stops(state) == ["a", "d", "c", "b"]


def test_another_destination_ends_it():
    state, _ = carry_out(led_back(), SetDestination("a"), HOLD_S + 1.0)
    state, _ = plan_if_needed(state, at(5.5), HOLD_S + 1.0)
    assert not step_back.is_under_way(state)
    assert ends_m(state.route)[-1] == (0.0, 0.0)


def test_nobody_arrives_at_the_end_of_the_way_back():
    state = led_back()
    bearing_rad = np.radians(np.arange(-30.0, 31.0))
    free = np.full(61, BearingState.FREE, np.int8)
    scan = ObstacleScan(bearing_rad, np.full(61, np.inf), free, (), 1.0)
    pose = Pose2D(1.2, 0.0, at(0.0, heading_deg=180.0).heading)
    located = Localization(
        50.0, LocalizationQuality.LOCALIZED, world_from_camera_at((pose.x_m, pose.y_m, 1.6), pose.heading, 0.26)
    )
    assert state.route is not None
    assert state.guidance is not None
    before = DecisionTrace(closest_index=len(state.route.points_m) - 3)
    previous = replace(state.guidance, trace=before)
    said = guide(50.0, located, state.route, scan, None, previous, SETTINGS, route_version=state.route_version)
    assert (said.action, said.reason) == (Action.STOP, Reason.NO_CANDIDATE)
    assert said.trace.remaining_m is None, "nobody is told that it is five metres to go"
    arrived = guide(
        50.0, located, replace(state.route, leads_to_destination=True), scan, None, previous, SETTINGS,
        route_version=state.route_version,
    )  # fmt: skip
    assert arrived.reason is Reason.ARRIVED

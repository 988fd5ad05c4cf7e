"""When the device plans anew, and what the walker hears of it."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from closed_loop import box, walk

from device_agent.orders import at_rest, carry_out
from device_agent.state import DeviceState, Happened, Notice, Step
from device_agent.way import plan_if_needed
from navcore.angles import world_angle
from navcore.cues.table import NO_WAY
from navcore.cues.texts import TEXTS
from navcore.modes import Mode
from navcore.planning import edits
from navcore.planning.poi_graph import Edge, Poi, PoiGraph
from navcore.settings import Settings
from navcore.types import Action, DecisionTrace, Guidance, Localization, Pose2D, Reason, TurnKind
from navcore.wire import GraphRunning, PublishGraph, RouteChanged, SetDestination

PLACES = {"a": (0.0, 0.0), "b": (10.0, 0.0), "c": (10.0, 6.0), "d": (0.0, 6.0)}
SETTINGS = Settings()
HOLD_S = SETTINGS.planning.blocked_hold_s


def ring(*pairs: str) -> PoiGraph:
    """A corridor round four corners, or the named parts of it."""
    pois = {key: Poi(key, key.upper(), "other", *xy) for key, xy in PLACES.items()}
    edges = {
        pair: Edge(pair, *pair, (PLACES[pair[0]], PLACES[pair[1]]), math.dist(PLACES[pair[0]], PLACES[pair[1]]))
        for pair in pairs or ("ab", "bc", "cd", "da")
    }
    return PoiGraph(1, pois, edges)


def at(x_m: float, y_m: float = 0.0, heading_deg: float = 0.0) -> Pose2D:
    return Pose2D(x_m, y_m, world_angle(math.radians(heading_deg)))


def leading(graph: PoiGraph | None = None, pose: Pose2D | None = None, goal: str = "b") -> DeviceState:
    """Somebody on their way from (2, 0) to B, who has just heard *walk*."""
    state, _ = carry_out(DeviceState(SETTINGS, graph or ring()), SetDestination(goal), 0.0)
    state, _ = plan_if_needed(state, pose or at(2.0), 0.0)
    return standing(state, Action.WALK, Reason.OK, 0.0)


def standing(state: DeviceState, action: Action, reason: Reason, stopped_since_s: float, **trace) -> DeviceState:
    trace = {"closest_index": 0, "deviation_m": 0.0, **trace}
    decision = DecisionTrace(stopped_since_s=stopped_since_s, **trace)
    return replace(state, guidance=Guidance(stopped_since_s, action, None, reason, decision, state.route_version))


def blocked(state: DeviceState, since_s: float = 0.0, ahead_m: float = 0.7) -> DeviceState:
    return standing(state, Action.STOP, Reason.OBSTACLE_DEPTH, since_s, nearest_ahead_m=ahead_m)


def stops(state: DeviceState) -> list[str]:
    assert state.route is not None
    return [stop.poi_id for stop in state.route.stops]


def heard(step: Step) -> list[str]:
    return [effect.text for effect in step[1] if isinstance(effect, Notice)]


# ------------------------------------------------------------------------------------------------- a blocked way
def test_a_blocked_way_is_waited_before_then_gone_round():
    state = blocked(leading())
    assert plan_if_needed(state, at(2.0), HOLD_S - 0.1) == (state, ()), "people in the way mostly walk on"
    step = plan_if_needed(state, at(2.0), HOLD_S)
    assert stops(step[0]) == ["a", "d", "c", "b"]
    assert step[0].route_version == state.route_version + 1
    assert heard(step) == ["The way is blocked. Another way: 24 metres."]
    assert any(isinstance(effect, RouteChanged) and effect.points_m for effect in step[1])


@pytest.mark.parametrize("action", [Action.WALK, Action.TURN])
def test_nobody_who_moves_is_held_for_blocked(action: Action):
    state = standing(leading(), action, Reason.OBSTACLE_DEPTH, 0.0)
    assert plan_if_needed(state, at(2.0), 10 * HOLD_S) == (state, ())


@pytest.mark.parametrize("turn", [TurnKind.ASIDE, TurnKind.LOOK])
def test_who_is_turned_to_and_fro_before_something_is_led_another_way_at_last(turn: TurnKind):
    state = standing(leading(), Action.TURN, Reason.OK, 0.0, turn=turn, nearest_ahead_m=0.7)
    assert plan_if_needed(state, at(2.0), 2 * HOLD_S - 0.1) == (state, ())
    assert stops(plan_if_needed(state, at(2.0), 2 * HOLD_S)[0]) == ["a", "d", "c", "b"]
    lost = standing(leading(), Action.TURN, Reason.POSE_LOST, 0.0, turn=turn)
    assert plan_if_needed(lost, at(2.0), 10 * HOLD_S) == (lost, ()), "who looks round for a known place is not blocked"


def test_who_is_turned_to_and_fro_to_the_route_is_led_another_way_at_last():
    told = {"turn": TurnKind.ALONG, "nearest_ahead_m": 0.7}
    state = standing(leading(), Action.TURN, Reason.OK, 0.0, reversals_count=4, **told)
    assert plan_if_needed(state, at(2.0), 2 * HOLD_S - 0.1) == (state, ())
    assert stops(plan_if_needed(state, at(2.0), 2 * HOLD_S)[0]) == ["a", "d", "c", "b"]
    slow = standing(leading(), Action.TURN, Reason.OK, 0.0, reversals_count=1, **told)
    assert plan_if_needed(slow, at(2.0), 10 * HOLD_S) == (slow, ()), "who takes their time is not blocked"


@pytest.mark.parametrize("reason", [Reason.POSE_LOST, Reason.PAUSED, Reason.DEPTH_INVALID, Reason.SENSOR_STALE])
def test_a_stop_for_another_reason_is_no_blocked_way(reason: Reason):
    state = standing(leading(), Action.STOP, reason, 0.0)
    assert plan_if_needed(state, at(2.0), 10 * HOLD_S) == (state, ())


def test_where_there_is_no_other_way_it_says_so_once_and_goes_on_waiting():
    state = blocked(leading(ring("ab")))
    step = plan_if_needed(state, at(2.0), HOLD_S)
    assert heard(step) == ["The way is blocked, and there is no other. Wait, or ask for help."]
    state = step[0]
    assert stops(state) == ["b"], "the old way is kept: what blocks it may go away"
    assert state.mode is Mode.GUIDING
    assert plan_if_needed(state, at(2.0), HOLD_S + 1.0)[1] == ()
    assert heard(plan_if_needed(state, at(2.0), HOLD_S + SETTINGS.planning.blocked_memory_s)), "said again at last"
    walking, _ = plan_if_needed(standing(state, Action.WALK, Reason.OK, 0.0), at(2.0), HOLD_S + 2.0)
    again = plan_if_needed(blocked(walking, HOLD_S + 3.0), at(2.0), 2 * HOLD_S + 3.0)
    assert heard(again) == heard(step), "who has walked in between hears it again"


def test_what_blocked_the_way_is_remembered_for_a_while():
    state, _ = plan_if_needed(blocked(leading()), at(2.0), HOLD_S)
    wanted, _ = carry_out(state, SetDestination("b"), HOLD_S + 1.0)
    assert stops(plan_if_needed(wanted, at(2.0), HOLD_S + 1.0)[0]) == ["a", "d", "c", "b"]
    later_s = HOLD_S + SETTINGS.planning.blocked_memory_s + 1.0
    assert stops(plan_if_needed(wanted, at(2.0), later_s)[0]) == ["b"]


def test_a_new_destination_behind_what_was_in_the_way_is_not_refused():
    state, _ = plan_if_needed(blocked(leading(ring("ab", "bc"))), at(2.0), HOLD_S)
    wanted, _ = carry_out(state, SetDestination("c"), HOLD_S + 1.0)
    assert stops(plan_if_needed(wanted, at(2.0), HOLD_S + 1.0)[0]) == ["b", "c"], "it may be gone by now"


def test_glass_before_the_walker_is_gone_round_as_well():
    state = standing(leading(), Action.STOP, Reason.OBSTACLE_SONAR, 0.0, sonar_m=1.2)
    state, _ = plan_if_needed(state, at(2.0), HOLD_S)
    assert stops(state) == ["a", "d", "c", "b"]
    assert state.blocked[0].place.edge_id == "ab"
    assert state.blocked[0].place.arc_m == pytest.approx(3.2, abs=0.01)


# ------------------------------------------------------------------------------------------------ a closed edge
def published(state: DeviceState, graph: PoiGraph) -> Step:
    return carry_out(state, PublishGraph(graph), 5.0)


def test_an_edge_that_is_closed_under_way_is_not_walked_any_more():
    state = leading(goal="c")
    assert stops(state) == ["b", "c"]
    closed = edits.set_edge(ring(), "bc", closed=True)
    step = published(state, closed)
    assert heard(step) == ["The way ahead has been closed."]
    assert step[0].waiting_graph is closed, "all else of it is taken when nobody is led"
    assert step[0].graph.version == 1
    state, effects = plan_if_needed(step[0], at(2.0), 5.1)
    assert stops(state) == ["a", "d", "c"]
    assert any(isinstance(effect, RouteChanged) for effect in effects)
    rested, effects = at_rest(replace(state, mode=Mode.ARRIVED))
    assert rested.graph is closed
    assert any(isinstance(effect, GraphRunning) and effect.version == closed.version for effect in effects)


def test_whoever_is_on_the_edge_that_is_closed_goes_back():
    state, _ = published(leading(goal="c"), edits.set_edge(ring(), "ab", closed=True))
    state, _ = plan_if_needed(state, at(2.0), 5.1)
    assert stops(state) == ["a", "d", "c"], "2 m back and round, not 8 m through what is closed"
    assert state.route is not None
    assert state.route.points_m[10, 0] < 2.0


def test_where_the_closed_edge_was_the_only_way_it_says_so_and_stops():
    state, _ = published(leading(ring("ab", "bc"), goal="c"), edits.set_edge(ring("ab", "bc"), "bc", closed=True))
    step = plan_if_needed(state, at(2.0), 5.1)
    assert step[0].mode is Mode.READY
    assert heard(step) == ["C cannot be reached. The way between B and C is closed."]
    on_it, _ = published(leading(ring("ab", "bc"), goal="c"), edits.set_edge(ring("ab", "bc"), "ab", closed=True))
    assert plan_if_needed(on_it, at(2.0), 5.1)[0].mode is Mode.READY, "nor is the walker led through it"


REFUSED = (
    ("closed", edits.set_edge(ring("ab", "bc"), "bc", closed=True), "c", 2.0),
    ("one way", edits.set_edge(ring("ab", "cb"), "cb", one_way=True), "c", 2.0),
    ("apart", ring("ab", "cd"), "c", 2.0),
    ("unknown", ring("ab"), "z", 2.0),
    ("unjoined", ring("ab"), "c", 2.0),
    ("far", ring("ab"), "b", -30.0),
    ("no ways", PoiGraph(1, ring().pois, {}), "b", 2.0),
)


@pytest.mark.parametrize(("graph", "goal", "x_m"), [each[1:] for each in REFUSED], ids=[each[0] for each in REFUSED])
@pytest.mark.parametrize("language", ["en", "zh"])
def test_a_refusal_is_heard_in_the_walkers_language_and_tells_the_console_what_to_do(
    graph: PoiGraph, goal: str, x_m: float, language: str
):
    settings = SETTINGS.changed({"cues.language": language})
    state, _ = carry_out(DeviceState(settings, graph), SetDestination(goal), 0.0)
    step = plan_if_needed(state, at(x_m), 0.0)
    (told,) = heard(step)
    (refusal,) = [effect.text for effect in step[1] if isinstance(effect, Happened) and effect.kind == "route_refused"]
    assert told in {
        TEXTS[language][f"no_way_{why}"].format(name=goal.upper(), a="B", b="C", metres="30") for why in NO_WAY
    }
    assert any("\u4e00" <= character <= "\u9fff" for character in told) == (language == "zh")
    assert told != refusal
    assert refusal.isascii()


def test_an_edge_elsewhere_that_is_closed_changes_nothing_for_the_walker():
    state = leading(goal="b")
    step = published(state, edits.set_edge(ring(), "cd", closed=True))
    assert not heard(step)
    assert step[0].route is state.route
    assert step[0].graph.edges["cd"].closed, "but it is not planned through from now on"
    behind = leading(goal="c", pose=at(9.9, 3.0))
    assert not heard(published(behind, edits.set_edge(ring(), "ab", closed=True)))


# ------------------------------------------------------------------------------------------------- off the route
def test_who_has_left_the_road_for_good_is_led_from_where_they_are():
    state = standing(leading(goal="c"), Action.WALK, Reason.OFF_ROAD, 0.0, deviation_m=2.5)
    hold_s = SETTINGS.planning.replan_hold_s
    state, effects = plan_if_needed(state, at(0.3, 4.0, 90.0), 10.0)
    assert not effects
    step = plan_if_needed(state, at(0.3, 4.0, 90.0), 10.0 + hold_s)
    assert stops(step[0]) == ["d", "c"]
    assert heard(step) == ["Off the road. New way: 12 metres."]
    assert any(isinstance(effect, Happened) and "new way" in effect.text for effect in step[1])


def test_who_comes_back_to_the_route_in_time_keeps_it():
    state = standing(leading(), Action.WALK, Reason.OFF_ROAD, 0.0, deviation_m=2.5)
    state, _ = plan_if_needed(state, at(2.0, 2.5), 10.0)
    state, _ = plan_if_needed(standing(state, Action.WALK, Reason.OK, 0.0, deviation_m=0.5), at(2.0, 0.5), 11.0)
    state = standing(state, Action.WALK, Reason.OFF_ROAD, 0.0, deviation_m=2.5)
    assert plan_if_needed(state, at(2.0, 2.5), 10.0 + SETTINGS.planning.replan_hold_s)[1] == ()


# ------------------------------------------------------------------------------------------------- the closed loop
WALLS = (
    box(-1.4, -1.4, 11.4, -1.2), box(-1.4, 7.2, 11.4, 7.4), box(-1.4, -1.4, -1.2, 7.4), box(11.2, -1.4, 11.4, 7.4),
    box(1.2, 1.2, 8.8, 4.8),
)  # fmt: skip
"""A corridor 2.4 m wide all round a block."""


@pytest.mark.parametrize("policy", ["paper", "road_centred"])
def test_a_walker_before_a_blocked_corridor_waits_and_arrives_by_the_other_way(policy: str):
    state = leading()
    state = replace(state, settings=SETTINGS.changed({"follower.policy": policy}))
    walls = (*WALLS, box(5.0, -1.2, 5.2, 1.2))

    def planned(located: Localization, guidance: Guidance | None):
        nonlocal state
        state, _ = plan_if_needed(replace(state, guidance=guidance), located.pose, located.stamp_s)
        assert state.route is not None
        return state.route, state.route_version

    assert state.route is not None
    result = walk(walls, state.route, (2.0, 0.0, 0.0), seed=2, settings=state.settings, planned=planned, limit_s=110.0)
    versions = [guidance.route_version for guidance in result.guidance]
    assert result.arrived, result.guidance[-1].trace.rule
    assert result.contacts == 0
    assert sorted(set(versions)) == [1, 2], "one change of the way, and no more"
    assert stops(state) == ["a", "d", "c", "b"]
    assert max(x for x, _ in result.trail[: versions.index(2)]) < 4.7
    assert HOLD_S < versions.index(2) / 10 < 4 * HOLD_S

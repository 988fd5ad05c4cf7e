"""What the console's orders do to the device's state. Pure: what is to happen in the world is returned as effects."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import msgspec

from device_agent import step_back
from device_agent.led_by import led_by
from device_agent.ports import ButtonPress
from device_agent.privacy import taken
from device_agent.settings_trial import apply_settings, keep_settings
from device_agent.sharing import Consent, LinkStands
from device_agent.state import (
    BlockedPlace,
    DeviceState,
    Effect,
    Happened,
    MapWalkTold,
    Notice,
    Outdated,
    PreparedMap,
    Step,
    StoreGraph,
    SwapMap,
)
from device_agent.states import StateEvent
from device_agent.transitions import By, happen
from navcore.cues.table import CueKind
from navcore.cues.texts import TEXTS
from navcore.obstacle.memory import ObstacleMemory
from navcore.planning.poi_graph import PoiGraph
from navcore.wire import (
    Accesses,
    ApplySettings,
    AskColour,
    BeginMapWalk,
    ClearDestination,
    ConsoleMessage,
    EndMapWalk,
    GraphRunning,
    KeepSettings,
    MapRunning,
    Pause,
    PublishGraph,
    Repeat,
    Resume,
    Say,
    SetDestination,
    Watchers,
)


@dataclass(frozen=True, slots=True)
class Lead:
    """Lead to a PoI, as the device was told when it was started."""

    poi_id: str


Order = ConsoleMessage | PreparedMap | MapWalkTold | Lead | ButtonPress | LinkStands | Consent
"""What the agent takes between two frames; what a press means is decided in :mod:`device_agent.menu`."""
_JUST_AHEAD_M = 0.3
_OF_THE_MAP_BEFORE = Outdated(frozenset({CueKind.MAP_NEWS, CueKind.MAP_ADVICE}))
"""That there is no map, or how far it is built, is no longer true of a new one. What somebody has asked for is answered
all the same."""
_WISHES: dict[type[ConsoleMessage], StateEvent] = {
    ClearDestination: StateEvent.STOP,
    Pause: StateEvent.PAUSE,
    Resume: StateEvent.RESUME,
    Repeat: StateEvent.REPEAT,
    BeginMapWalk: StateEvent.MAP_ORDERED,
    EndMapWalk: StateEvent.MAP_ENDED,
}
"""What is wished for with an order that says nothing else."""


def carry_out(
    state: DeviceState,
    order: ConsoleMessage | PreparedMap | MapWalkTold | Lead | LinkStands | Consent,
    now_s: float,
) -> Step:
    """Return the state after an order, and what is to be done."""
    match order:
        case Lead():
            return happen(state, StateEvent.DESTINATION, now_s, poi_id=order.poi_id)
        case SetDestination():
            return led_by(state, order, now_s)
        case ClearDestination() | Pause() | Resume() | Repeat() | BeginMapWalk() | EndMapWalk():
            return happen(state, _WISHES[type(order)], now_s, by=By.CONSOLE)
        case Say():
            return state, (Notice(order.text), Happened("cue", f"Message: {order.text}"[:500]))
        case Watchers() | AskColour() | Accesses() | LinkStands() | Consent():
            return taken(state, order, now_s)
        case ApplySettings():
            return apply_settings(state, order, now_s)
        case KeepSettings():
            return keep_settings(state, order)
        case PublishGraph():
            return _publish(state, order.graph)
        case MapWalkTold():
            return _told(state, order, now_s)
        case PreparedMap():
            told = (MapRunning(state.map_checksum, waiting_checksum=order.checksum),) if state.uses_its_map else ()
            return replace(state, waiting_map=order), told
        case _:
            return state, ()


def at_rest(state: DeviceState) -> Step:
    """Take what waited for a stop: the map first, then the PoI-graph. Nothing while somebody is led, or maps."""
    if state.uses_its_map:
        return state, ()
    effects: list[Effect] = []
    if state.waiting_map is not None:
        prepared = state.waiting_map
        # The route and all that is remembered belong to the old map's frame of reference.
        state = replace(
            state, waiting_map=None, site_id=prepared.site.site_id, map_checksum=prepared.checksum,
            obstacles=ObstacleMemory(), heard=ObstacleMemory(), recent_scans=(), is_hidden_ahead=False, step_back=None,
            graph=prepared.site.poi_graph, route=None, guidance=None, trail=(), off_route_since_s=None, blocked=(),
            located=None, fixes=(), sure=None,
        )  # fmt: skip
        effects += [
            _OF_THE_MAP_BEFORE,
            SwapMap(prepared),
            MapRunning(prepared.checksum),
            GraphRunning(state.graph.version),
        ]
        if prepared.told is not None:
            effects += _words_of(state, prepared.told)
    if state.waiting_graph is not None:
        graph = state.waiting_graph
        state = replace(state, waiting_graph=None, graph=graph, blocked=())
        effects += [StoreGraph(graph), GraphRunning(graph.version)]
    return state, tuple(effects)


def _told(state: DeviceState, told: MapWalkTold, now_s: float) -> Step:
    effects = _words_of(state, told)
    if not told.failed:
        return state, effects
    state, also = happen(state, StateEvent.MAP_FAILED, now_s)
    return state, (*effects, *also)


def _words_of(state: DeviceState, told: MapWalkTold) -> tuple[Effect, ...]:
    """Nobody who is led is talked to about maps; the console hears of it in any case."""
    happened = Happened("mode", told.text("en"))
    if state.leading:
        return (happened,)
    return Notice(told.text(state.settings.cues.language), kind=told.kind), happened


def _publish(state: DeviceState, graph: PoiGraph) -> Step:
    refusal = _unsound(graph)
    if refusal:
        return state, (GraphRunning(state.graph.version, refusal),)
    state = replace(state, waiting_graph=graph)
    return _closed_under_way(state, graph) if state.leading else (state, ())


def _closed_under_way(state: DeviceState, published: PoiGraph) -> Step:
    """An edge that was closed is not walked any more, though all else of a new graph waits until nobody is led.

    Whoever is on that edge goes back: nobody knows where on it the closure is.
    """
    known = state.graph.edges
    newly = {key for key, edge in published.edges.items() if edge.closed and key in known and not known[key].closed}
    if not newly:
        return state, ()
    edges = {key: msgspec.structs.replace(edge, closed=edge.closed or key in newly) for key, edge in known.items()}
    state = replace(state, graph=msgspec.structs.replace(state.graph, edges=edges))
    if step_back.is_under_way(state):
        return _closed_while_led_back(state, newly)
    here, route = state.place_ahead(0.0), state.route
    if route is None or not newly & _edges_ahead(state):
        return state, ()
    ahead = state.place_ahead(_JUST_AHEAD_M)
    if here is not None and ahead is not None and here.edge_id in newly and ahead.edge_id == here.edge_id:
        state = replace(state, blocked=(*state.blocked, BlockedPlace(-math.inf, ahead, until_rest=True)))
    text = TEXTS[state.settings.cues.language]["way_closed"]
    happened = Happened("mode", "An edge of the way was closed: another way is looked for.")
    return replace(state, wanted_id=state.wanted_id or state.destination_id), (Notice(text), happened)


def _closed_while_led_back(state: DeviceState, newly: set[str]) -> Step:
    """Whoever is led back a little is led on by another way at once, where that on which they stood was closed.

    Where the closed edge is another one, the way on is planned without it anyhow.
    """
    place = None if state.step_back is None else state.step_back.place
    if place is None or place.edge_id not in newly:
        return state, ()
    state = replace(state, blocked=(*state.blocked, BlockedPlace(-math.inf, place, until_rest=True)))
    text = TEXTS[state.settings.cues.language]["way_closed"]
    happened = Happened("mode", "The edge ahead was closed while the walker was led back: another way is looked for.")
    return replace(state, wanted_id=state.wanted_id or state.destination_id), (Notice(text), happened)


def _edges_ahead(state: DeviceState) -> set[str]:
    """Return the edges of the route that the walker is on or comes to."""
    route, guidance = state.route, state.guidance
    if route is None:
        return set()
    index = guidance.trace.closest_index if guidance is not None else None
    done_m = 0.0 if index is None or state.place_ahead(0.0) is None else float(route.arc_length_m[index])
    return {piece.edge_id for piece in route.pieces if piece.end_m > done_m}


def _unsound(graph: PoiGraph) -> str:
    for key, edge in graph.edges.items():
        if edge.id != key or edge.a not in graph.pois or edge.b not in graph.pois or len(edge.path_m) < 2:
            return f"The PoI-graph is unsound at edge {key}: check it in the editor and publish it again."
    for key, poi in graph.pois.items():
        if poi.id != key:
            return f"The PoI-graph is unsound at PoI {key}: check it in the editor and publish it again."
    return ""

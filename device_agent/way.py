"""Planning within the loop: a new destination, or a walker who has left the road for good. Pure."""

from __future__ import annotations

from dataclasses import replace

from device_agent.orders import mode_event, stopped
from device_agent.state import DeviceState, Effect, Happened, Notice, Step
from navcore.errors import PlanningError
from navcore.planning.poi_graph import PoiGraph
from navcore.planning.way_finding import find_route
from navcore.settings import Settings
from navcore.types import Pose2D, Route
from navcore.wire import RouteChanged


def plan_if_needed(state: DeviceState, pose: Pose2D | None, now_s: float) -> Step:
    """Plan a way to the wanted destination, or anew from where the walker strayed to."""
    if pose is None or state.mode != "guiding":
        return state, ()
    if state.wanted_id is not None:
        return _to_wanted(state, pose, state.wanted_id, now_s)
    state = _watched(state, now_s)
    since_s = state.off_route_since_s
    if since_s is None or now_s - since_s < state.settings.planning.replan_hold_s or state.destination_id is None:
        return state, ()
    return _anew(replace(state, off_route_since_s=None), pose, state.destination_id, now_s)


def _to_wanted(state: DeviceState, pose: Pose2D, wanted_id: str, now_s: float) -> Step:
    try:
        route = _route(state.graph, pose, wanted_id, state.settings)
    except PlanningError as error:
        return _refused(state, wanted_id, str(error), now_s)
    changed = state.destination_id != wanted_id or state.route is None
    state = replace(_with_route(state, route), destination_id=wanted_id, wanted_id=None)
    effects: tuple[Effect, ...] = (mode_event(state),) if changed else ()
    return state, (*effects, _route_message(state, now_s))


def _anew(state: DeviceState, pose: Pose2D, destination_id: str, now_s: float) -> Step:
    try:
        route = _route(state.graph, pose, destination_id, state.settings)
    except PlanningError:
        # The old way still leads back to the road.
        return state, ()
    state = _with_route(state, route)
    return state, (Happened("mode", "Off the road: a new way is planned."), _route_message(state, now_s))


def _refused(state: DeviceState, wanted_id: str, refusal: str, now_s: float) -> Step:
    refusal = refusal[:500]
    effects: tuple[Effect, ...] = (Notice(refusal), Happened("route_refused", refusal))
    if state.route is not None and state.destination_id != wanted_id:
        state = replace(state, wanted_id=None)
        return state, (*effects, _with_refusal(_route_message(state, now_s), refusal))
    state = stopped(state)
    return state, (*effects, mode_event(state), RouteChanged(now_s, refusal=refusal))


def _with_refusal(message: RouteChanged, refusal: str) -> RouteChanged:
    return RouteChanged(message.stamp_s, message.points_m, message.stops, message.destination_id, refusal)


def _watched(state: DeviceState, now_s: float) -> DeviceState:
    deviation_m = state.guidance.trace.deviation_m if state.guidance is not None else None
    if deviation_m is None or deviation_m <= state.settings.planning.replan_deviation_m:
        return replace(state, off_route_since_s=None) if state.off_route_since_s is not None else state
    return replace(state, off_route_since_s=now_s) if state.off_route_since_s is None else state


def _route(graph: PoiGraph, pose: Pose2D, poi_id: str, settings: Settings) -> Route:
    return find_route(graph, pose.x_m, pose.y_m, poi_id, settings.planning)


def _with_route(state: DeviceState, route: Route) -> DeviceState:
    return replace(state, route=route, route_version=state.route_version + 1, off_route_since_s=None)


def _route_message(state: DeviceState, now_s: float) -> RouteChanged:
    route = state.route
    assert route is not None
    points = tuple((float(x), float(y)) for x, y in route.points_m)
    stops = tuple((stop.name, stop.distance_m) for stop in route.stops)
    return RouteChanged(now_s, points, stops, state.destination_id)

"""Planning within the loop: a new destination, a way that is blocked, or a walker who has left the road. Pure.

What is planned anew, and when: ::

    a destination is wanted, or an edge of the way was closed   -> at once, as soon as the place is known for sure
    something blocks the way for blocked_hold_s                 -> round it; where there is no other way, that is said
    ... at the walker's feet, where no image shows it           -> first a few steps back, to look from there
    the walker is off the route for replan_hold_s               -> from where they are now
"""

from __future__ import annotations

from dataclasses import replace

from device_agent import step_back
from device_agent.state import BlockedPlace, DeviceState, Effect, Happened, Notice, Step, StepBack
from device_agent.states import StateEvent
from device_agent.transitions import happen, mode_event
from device_agent.whereabouts import finder_of
from navcore.cues.texts import TEXTS
from navcore.errors import PlanningError
from navcore.types import Action, Pose2D, Reason, Route, TurnKind
from navcore.wire import RouteChanged

_BLOCKING = frozenset({Reason.OBSTACLE_DEPTH, Reason.OBSTACLE_SONAR, Reason.DROP_AHEAD, Reason.NO_CANDIDATE})
_SEEKING = frozenset({TurnKind.ASIDE, TurnKind.LOOK})
_TO_AND_FRO_COUNT = 4
"""Who has been turned to the other side so often without a step is turned to and fro."""
_NEAREST_BLOCK_M = 0.3
_FARTHEST_BLOCK_M = 3.0


def plan_if_needed(state: DeviceState, pose: Pose2D | None, now_s: float) -> Step:
    """Plan a way to the wanted destination, round what blocks it, or anew from where the walker strayed to."""
    if pose is None or not state.on_the_way:
        return state, ()
    if state.wanted_id is not None:
        return _to_wanted(_with_finder(state), pose, state.wanted_id, now_s)
    state = _watched(state, now_s)
    if state.destination_id is None or state.route is None:
        return state, ()
    is_blocked = _is_blocked(state, now_s)
    if step_back.is_under_way(state) and (is_blocked or step_back.is_far_enough(state, pose)):
        happened = "Looking again at what was out of sight."
        return _anew(_with_finder(state), pose, state.destination_id, now_s, happened)
    if is_blocked:
        back = step_back.way_back(state) if step_back.helps(state, now_s) else None
        if back is not None:
            return _led_back(state, back, pose, now_s)
        return _round(_with_finder(state), pose, state.destination_id, now_s)
    since_s = state.off_route_since_s
    if since_s is None or now_s - since_s < state.settings.planning.replan_hold_s:
        return state, ()
    strayed, happened = replace(state, off_route_since_s=None), "Off the road: a new way is planned."
    return _anew(_with_finder(strayed), pose, state.destination_id, now_s, happened, "way_anew")


# ------------------------------------------------------------------------------------------------ a destination
def _to_wanted(state: DeviceState, pose: Pose2D, wanted_id: str, now_s: float) -> Step:
    try:
        route = _route_anyhow(state, pose, wanted_id, now_s)
    except PlanningError as error:
        return _refused(state, wanted_id, error, now_s)
    changed = state.destination_id != wanted_id
    state = replace(_with_route(state, route), destination_id=wanted_id, wanted_id=None)
    effects: tuple[Effect, ...] = (mode_event(state),) if changed else ()
    return state, (*effects, route_message(state, now_s))


def _refused(state: DeviceState, wanted_id: str, error: PlanningError, now_s: float) -> Step:
    """The walker hears why in their language; what is to be done about the map is for the console."""
    refusal = str(error)[:500]
    told = TEXTS[state.settings.cues.language][f"no_way_{error.why}"].format(**error.fields)
    effects: tuple[Effect, ...] = (Notice(told), Happened("route_refused", refusal))
    if state.route is not None and state.destination_id != wanted_id:
        before = state.overridden
        state = replace(state, wanted_id=None, aim_by=before.by if before is not None else "", overridden=None)
        return state, (*effects, _with_refusal(route_message(state, now_s), refusal))
    state, ended = happen(state, StateEvent.NO_WAY, now_s, refusal=refusal)
    return state, (*effects, *ended)


def _with_refusal(message: RouteChanged, refusal: str) -> RouteChanged:
    return RouteChanged(message.stamp_s, message.points_m, message.stops, message.destination_id, refusal)


# ------------------------------------------------------------------------------------------------- off the route
def _watched(state: DeviceState, now_s: float) -> DeviceState:
    guidance = state.guidance
    if state.told_blocked_s is not None and guidance is not None and guidance.action is Action.WALK:
        state = replace(state, told_blocked_s=None)
    deviation_m = guidance.trace.deviation_m if guidance is not None else None
    if deviation_m is None or deviation_m <= state.settings.planning.replan_deviation_m:
        return replace(state, off_route_since_s=None) if state.off_route_since_s is not None else state
    return replace(state, off_route_since_s=now_s) if state.off_route_since_s is None else state


def _anew(state: DeviceState, pose: Pose2D, destination_id: str, now_s: float, happened: str, *told: str) -> Step:
    """Plan from where the walker is now; ``told`` are the texts (by their keys) that they hear of it."""
    try:
        route = _route_anyhow(state, pose, destination_id, now_s)
    except PlanningError:
        # The old way still leads back to the road; at the end of a few steps back the walker is stopped.
        return state, ()
    state = _with_route(state, route)
    heard = tuple(_notice(state, key) for key in told)
    return state, (*heard, Happened("mode", happened), route_message(state, now_s))


# ----------------------------------------------------------------------------------------------- a blocked way
def _is_blocked(state: DeviceState, now_s: float) -> bool:
    """Whether the walker has stood before something for so long that another way is to be looked for.

    Turning to and fro for a way round gets twice the time, but is no going on for ever either; nor is being turned so
    to the route, whatever the reason.
    """
    guidance = state.guidance
    if guidance is None:
        return False
    stands = guidance.action is Action.STOP and guidance.reason in _BLOCKING
    to_and_fro = guidance.action is Action.TURN and guidance.trace.reversals_count >= _TO_AND_FRO_COUNT
    seeks = (guidance.trace.turn in _SEEKING or to_and_fro) and guidance.reason is not Reason.POSE_LOST
    if not (stands or seeks):
        return False
    planning, since_s = state.settings.planning, guidance.trace.stopped_since_s
    hold_s = planning.blocked_hold_s if stands else 2.0 * planning.blocked_hold_s
    if since_s is None or now_s - since_s < hold_s:
        return False
    # What blocked the other ways may be gone after a while.
    return state.told_blocked_s is None or now_s - state.told_blocked_s >= planning.blocked_memory_s


def _round(state: DeviceState, pose: Pose2D, destination_id: str, now_s: float) -> Step:
    """Plan round what blocks the way; where there is no other, say so once, and wait on: it may go away."""
    assert state.guidance is not None
    trace = state.guidance.trace
    near_m = [each for each in (trace.nearest_ahead_m, trace.sonar_m) if each is not None]
    ahead_m = min(max(min(near_m, default=1.0), _NEAREST_BLOCK_M), _FARTHEST_BLOCK_M)
    place = state.place_ahead(ahead_m)
    if place is not None:
        state = replace(state, blocked=(*state.blocked, BlockedPlace(now_s, place)))
    try:
        if place is None:
            text = "Where on the road the way is blocked is not known: wait, or choose the place again."
            raise PlanningError(text, "lost")
        route = _route(state, pose, destination_id, now_s)
    except PlanningError as error:
        blocked = Happened("route_refused", f"The way is blocked, and there is no other. {error}"[:500])
        state = replace(state, told_blocked_s=now_s)
        return state, (_notice(state, "way_blocked_wait"), blocked)
    state = _with_route(state, route)
    happened = Happened("mode", f"The way is blocked: another one, {route.length_m:.0f} m, is taken.")
    return state, (_notice(state, "way_blocked"), happened, route_message(state, now_s))


# ------------------------------------------------------------------------------------------- a few steps back
def _led_back(state: DeviceState, back: Route, pose: Pose2D, now_s: float) -> Step:
    place = state.place_ahead(_NEAREST_BLOCK_M)
    state = _with_route(state, back)
    state = replace(state, step_back=StepBack(now_s, pose.x_m, pose.y_m, state.route_version, place))
    # Once the walker looks again it must not be said late.
    told = Notice(TEXTS[state.settings.cues.language]["way_look_again"], answers=True)
    happened = Happened("mode", "What is at the walker's feet is out of sight: they go back a little to look again.")
    return state, (told, happened, route_message(state, now_s))


# -------------------------------------------------------------------------------------------------------- parts
def _with_finder(state: DeviceState) -> DeviceState:
    return replace(state, way_finder=finder_of(state))


def _route(state: DeviceState, pose: Pose2D, poi_id: str, now_s: float) -> Route:
    """Return the shortest route round everything that is known to be in the way. Raises PlanningError."""
    assert state.way_finder is not None
    memory_s, here = state.settings.planning.blocked_memory_s, state.place_ahead(0.0)
    return state.way_finder.route_to(
        poi_id, pose.x_m, pose.y_m, heading=pose.heading, on_edge=None if here is None else here.edge_id,
        blockages=[each.place for each in state.blocked if each.until_rest or now_s - each.since_s <= memory_s],
    )  # fmt: skip


def _route_anyhow(state: DeviceState, pose: Pose2D, poi_id: str, now_s: float) -> Route:
    """Return the shortest route; where the only one leads past what once stood in the way, that one: it may be gone."""
    try:
        return _route(state, pose, poi_id, now_s)
    except PlanningError:
        closed = tuple(each for each in state.blocked if each.until_rest)
        return _route(replace(state, blocked=closed), pose, poi_id, now_s)


def _with_route(state: DeviceState, route: Route) -> DeviceState:
    version = state.route_version + 1
    return replace(state, route=route, route_version=version, off_route_since_s=None, told_blocked_s=None)


def _notice(state: DeviceState, key: str) -> Notice:
    metres = round(state.route.length_m) if state.route is not None else 0
    return Notice(TEXTS[state.settings.cues.language][key].format(metres=metres))


def route_message(state: DeviceState, now_s: float) -> RouteChanged:
    """Return what the console is told of the way that is walked; there is one."""
    route = state.route
    assert route is not None
    points = tuple((float(x), float(y)) for x, y in route.points_m)
    stops = tuple((stop.name, stop.distance_m) for stop in route.stops)
    return RouteChanged(now_s, points, stops, state.destination_id)

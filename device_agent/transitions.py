"""What an event does to the device's state: the answer of the table, and the action that it names. Pure.

:func:`happen` is the only way from one mode to another.
"""

from __future__ import annotations

import enum
from collections.abc import Callable
from dataclasses import dataclass, replace

from device_agent.state import DeviceState, Effect, Happened, MarkPlace, Notice, Outdated, SayAgain, Step
from device_agent.states import StateAction, StateEvent, Transition, answer
from device_agent.whereabouts import mode_text, whereabouts
from navcore.cues.table import CueKind
from navcore.cues.texts import TEXTS
from navcore.modes import Mode
from navcore.obstacle.memory import ObstacleMemory
from navcore.wire import MapWalkRunning, RouteChanged


class By(enum.Enum):
    """Who or what causes an event."""

    DEVICE = "device"
    WALKER = "walker"
    CONSOLE = "console"


@dataclass(frozen=True, slots=True)
class _Case:
    """What an action may look at, besides the state."""

    now_s: float
    poi_id: str
    refusal: str
    who: str


def happen(
    state: DeviceState, event: StateEvent, now_s: float, *, poi_id: str = "", by: By = By.DEVICE, refusal: str = "",
    who: str = "",
) -> Step:  # fmt: skip
    """Return the state after an event, and what is to be done.

    Args:
        state: the state before.
        event: what happens.
        now_s: the present time.
        poi_id: the destination, with ``DESTINATION``.
        by: who causes it; what the device does by itself is not told to the walker in words of its own.
        refusal: why there is no way, with ``NO_WAY``.
        who: the person at the console, with ``DESTINATION``.
    """
    found = answer(state.mode, state.beneath, event)
    transition = found.transition
    purpose, aim_id = state.purpose, state.aim_id
    state = replace(state, mode=found.mode, beneath=found.beneath)
    said: tuple[Effect, ...] = ()
    if transition.says and by is not By.DEVICE:
        said = (_said(state, transition, poi_id, by, who, aim_id),)
    if transition.refused:
        return state, (*said, *_refusal(state, event, now_s))
    was_mapping = purpose is Mode.MAPPING
    state, effects = _ACTIONS[transition.action](state, _Case(now_s, poi_id, refusal, who))
    if state.purpose is not purpose and event not in _TOLD_OTHERWISE and transition.action is not StateAction.SET_OUT:
        effects = (mode_event(state), *effects)
    if purpose is Mode.MAPPING and state.purpose is not purpose and event is not StateEvent.MAP_FAILED:
        # Advice to who records holds while they do; that recording has failed is said as it ends.
        effects = (Outdated(frozenset({CueKind.MAP_ADVICE})), *effects)
    if was_mapping is not (state.purpose is Mode.MAPPING):
        effects = (MapWalkRunning(not was_mapping), *effects)
    return state, (*said, *effects)


_TOLD_OTHERWISE = frozenset(
    {StateEvent.POSE_FOUND, StateEvent.POSE_LOST, StateEvent.FAILED, StateEvent.RECOVERED, StateEvent.DESTINATION}
)
"""Localization, sensors and planning have events of their own for the record."""


def mode_event(state: DeviceState) -> Happened:
    """Say for the record what the device does now."""
    place = state.place_name(state.destination_id)
    texts = {
        Mode.GUIDING: f"Leading to {place}.",
        Mode.LOST: f"Leading to {place}, as soon as the position is known.",
        Mode.PAUSED: "Guidance is paused.",
        Mode.ARRIVED: f"Arrived at {place}.",
        Mode.OFF_DUTY: "The walker has put the device off duty.",
        Mode.MAPPING: "A map is being recorded.",
    }
    return Happened("mode", texts.get(state.purpose, "Nobody is being led."))


def _said(state: DeviceState, transition: Transition, poi_id: str, by: By, who: str, aim_id: str | None) -> Notice:
    texts, key = TEXTS[state.settings.cues.language], transition.says
    is_led_by = key == "destination" and by is By.CONSOLE and aim_id != poi_id
    if is_led_by and aim_id is not None:
        key = "destination_instead"
    elif by is By.CONSOLE and (is_led_by or key != "destination"):
        key = f"{key}_console" if f"{key}_console" in texts else key
    names = {"name": state.place_name(poi_id), "before": state.place_name(aim_id), "who": who or texts["the_console"]}
    # Whoever is led elsewhere than they chose hears it to its end, also where an instruction cuts it off.
    return Notice(texts[key].format(**names), answers=key != "destination_instead")


def _refusal(state: DeviceState, event: StateEvent, now_s: float) -> tuple[Effect, ...]:
    """The console hears of a refusal as well, in words for those who watch."""
    why = state.purpose.sentence
    happened = Happened("mode", f"Refused: {event.value}. {why}")
    if event is StateEvent.DESTINATION:
        return happened, RouteChanged(now_s, refusal=why)
    if event in (StateEvent.MAP_ORDERED, StateEvent.MAP_ENDED):
        return happened, MapWalkRunning(state.purpose is Mode.MAPPING, why)
    return (happened,)


# ------------------------------------------------------------------------------------------------------ actions
Act = Callable[[DeviceState, _Case], Step]


def _nothing(state: DeviceState, case: _Case) -> Step:
    return state, ()


def _look(state: DeviceState, case: _Case) -> Step:
    return replace(_unseen(state), promised_ready=True), ()


def _say_ready(state: DeviceState, case: _Case) -> Step:
    if not state.promised_ready:
        return state, ()
    return replace(state, promised_ready=False), (Notice(mode_text(state), answers=True),)


def _set_out(state: DeviceState, case: _Case) -> Step:
    state = replace(
        state, wanted_id=case.poi_id, destination_id=case.poi_id, route=None, guidance=None, off_route_since_s=None,
        promised_ready=False, aim_by=case.who, overridden=None,
    )  # fmt: skip
    return state, (mode_event(state),)


def _change_way(state: DeviceState, case: _Case) -> Step:
    if state.route is None:
        return _set_out(state, case)
    # Whoever is on their way is led on until the new way is known to exist.
    return replace(state, wanted_id=case.poi_id, aim_by=case.who, overridden=None), ()


def _go_on(state: DeviceState, case: _Case) -> Step:
    # The walker may have moved meanwhile: the way begins where they are now.
    return replace(state, wanted_id=state.wanted_id or state.destination_id), ()


def _end_way(state: DeviceState, case: _Case) -> Step:
    state = replace(
        state, destination_id=None, wanted_id=None, route=None, guidance=None, off_route_since_s=None,
        promised_ready=False, aim_by="", overridden=None,
    )  # fmt: skip
    if state.purpose is Mode.OFF_DUTY:
        state = _unseen(state)
    return state, (RouteChanged(case.now_s, refusal=case.refusal),)


def _arrive(state: DeviceState, case: _Case) -> Step:
    return replace(state, route=None, wanted_id=None, off_route_since_s=None), ()


def _repeat(state: DeviceState, case: _Case) -> Step:
    return state, (SayAgain(mode_text(state)),)


def _tell_where(state: DeviceState, case: _Case) -> Step:
    return state, (Notice(whereabouts(state, case.now_s), answers=True),)


def _begin_map(state: DeviceState, case: _Case) -> Step:
    state, effects = _end_way(_unseen(state), case)
    # How an earlier walk or its map went on, or that there is none, is another story from now on.
    outdated = Outdated(frozenset({CueKind.MAP_NEWS, CueKind.MAP_ADVICE}))
    return replace(state, mark_count=0), (outdated, *effects)


def _mark(state: DeviceState, case: _Case) -> Step:
    number = state.mark_count + 1
    texts = TEXTS[state.settings.cues.language]
    said = Notice(texts["map_marked"].format(number=number), answers=True)
    return replace(state, mark_count=number), (said, MarkPlace(texts["map_place"].format(number=number)))


def _unseen(state: DeviceState) -> DeviceState:
    """Forget what was seen where the walker may no longer be."""
    return replace(
        state, obstacles=ObstacleMemory(), heard=ObstacleMemory(), recent_scans=(), trail=(), blocked=(), located=None,
        fixes=(), guidance=None,
    )  # fmt: skip


_ACTIONS: dict[StateAction, Act] = {
    StateAction.NOTHING: _nothing,
    StateAction.LOOK: _look,
    StateAction.SAY_READY: _say_ready,
    StateAction.SET_OUT: _set_out,
    StateAction.CHANGE_WAY: _change_way,
    StateAction.GO_ON: _go_on,
    StateAction.END_WAY: _end_way,
    StateAction.ARRIVE: _arrive,
    StateAction.REPEAT: _repeat,
    StateAction.TELL_WHERE: _tell_where,
    StateAction.BEGIN_MAP: _begin_map,
    StateAction.MARK: _mark,
}

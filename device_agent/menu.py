"""What the buttons mean: a menu without a picture. Pure.

The main button starts, pauses, goes on and, held, stops; *next* and *previous* go through the places, and the main
button chooses the one that was named last. Every press is answered in words. What a wish leads to is for the state
machine to say (:mod:`device_agent.states`).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Literal

from device_agent import privacy_menu
from device_agent.led_by import can_refuse, refused
from device_agent.ports import Button, ButtonPress, PressKind
from device_agent.privacy import answered, can_answer
from device_agent.state import DeviceState, Effect, Happened, Menu, Notice, Step
from device_agent.states import STATES, StateEvent
from device_agent.transitions import By, happen
from device_agent.whereabouts import HERE_M, costs_m, finder_of, name_of
from navcore.cues.texts import TEXTS, distance_text
from navcore.errors import PlanningError
from navcore.modes import Mode
from navcore.planning.poi_graph import Poi
from navcore.types import LocalizationQuality, Pose2D

OPEN_FOR_S = 30.0
"""The menu closes when nothing has been pressed for so long."""

Browse = Literal["browse next", "browse previous", "browse", "change order"]
Offer = Literal["offer a map walk"]
Meaning = StateEvent | Browse | Offer

MAIN_SHORT: dict[Mode, Meaning] = {
    Mode.OFF_DUTY: StateEvent.ON_DUTY,
    Mode.MAPPING: StateEvent.MARK,
    Mode.LOCALIZING: "browse",
    Mode.READY: "browse",
    Mode.GUIDING: StateEvent.PAUSE,
    Mode.PAUSED: StateEvent.RESUME,
    Mode.LOST: StateEvent.PAUSE,
    Mode.ARRIVED: "browse",
}
"""The main button, pressed shortly while no place is browsed; while one is, it chooses that place."""
MAIN_LONG: dict[Mode, Meaning] = {
    **{
        mode: StateEvent.OFF_DUTY if mode in (Mode.LOCALIZING, Mode.READY, Mode.ARRIVED) else StateEvent.STOP
        for mode in MAIN_SHORT
    },
    Mode.OFF_DUTY: "offer a map walk",
}
"""The main button, held: it stops, and puts off duty whoever is not led; off duty it offers a map walk, which *next*
begins, and any other press does not: none begins by holding a button too long. While a place is browsed, nobody led: it
closes the menu."""
OTHERS: dict[tuple[Button, PressKind], Meaning] = {
    (Button.NEXT, PressKind.SHORT): "browse next",
    (Button.PREVIOUS, PressKind.SHORT): "browse previous",
    (Button.NEXT, PressKind.LONG): "change order",
    (Button.PREVIOUS, PressKind.LONG): StateEvent.WHERE,
    (Button.REPEAT, PressKind.SHORT): StateEvent.REPEAT,
    (Button.REPEAT, PressKind.LONG): StateEvent.WHERE,
}
"""The other buttons mean the same in every state. Glasses with three buttons have *where am I* as well."""


ANSWERS: dict[tuple[Button, PressKind], bool] = {
    (Button.NEXT, PressKind.LONG): True,
    (Button.PREVIOUS, PressKind.LONG): False,
}
"""While somebody asks to see pictures: what allows it, and what refuses it; while they see them, the second ends it."""

REFUSES = (Button.PREVIOUS, PressKind.LONG)
"""What keeps their way for whom somebody at the console leads elsewhere; a question on pictures is answered first."""


def pressed(state: DeviceState, press: ButtonPress, now_s: float) -> Step:
    """Return the state after a button was pressed, and what is to be done."""
    if (answer := _to_somebody(state, press, now_s)) is not None:
        return answer
    if state.menu is not None and not _stays_open(state, state.menu, now_s):
        state = replace(state, menu=None)
    if press.button is Button.MAIN and state.menu is not None:
        if press.kind is PressKind.SHORT:
            return _chosen(state, state.menu, now_s)
        state = replace(state, menu=None)
        if not state.leading:
            return state, (Notice(TEXTS[state.settings.cues.language]["menu_closed"], answers=True),)
    is_offered = now_s <= state.map_offered_until_s
    state = replace(state, map_offered_until_s=-math.inf)
    if is_offered and (press.button, press.kind) == (Button.NEXT, PressKind.SHORT):
        return _wish(state, StateEvent.MAP_BEGUN, now_s)
    meaning = meaning_of(state.purpose, press.button, press.kind)
    if meaning == "offer a map walk":
        text = TEXTS[state.settings.cues.language]["map_offered"]
        return replace(state, map_offered_until_s=now_s + OPEN_FOR_S), (Notice(text, answers=True),)
    if meaning is StateEvent.ON_DUTY and not state.has_map:
        meaning = StateEvent.ON_DUTY_WITHOUT_MAP
    if isinstance(meaning, StateEvent):
        return _wish(state, meaning, now_s)
    if meaning == "change order" and not _may_choose(state):
        return privacy_menu.opened(state, now_s + OPEN_FOR_S)
    if not _may_choose(state) and not _in_privacy(state):
        # The state's own answer says why.
        return _wish(state, StateEvent.DESTINATION, now_s)
    return _BROWSE[meaning](state, now_s)


def meaning_of(purpose: Mode, button: Button, kind: PressKind) -> Meaning:
    """Return what a press means in a state, while the menu is closed; in a fault, the state is the one beneath it."""
    if button is Button.MAIN:
        return (MAIN_SHORT if kind is PressKind.SHORT else MAIN_LONG)[purpose]
    return OTHERS[button, kind]


def _to_somebody(state: DeviceState, press: ButtonPress, now_s: float) -> Step | None:
    """Return the step of a press that answers somebody at the console; None where it answers nobody."""
    if (allowed := _answer(state, press, now_s)) is not None:
        state, effects = answered(state, allowed, now_s)
        return replace(state, map_offered_until_s=-math.inf), effects
    if (press.button, press.kind) == REFUSES and can_refuse(state, now_s):
        return refused(replace(state, menu=None), now_s)
    return None


def _answer(state: DeviceState, press: ButtonPress, now_s: float) -> bool | None:
    """Return what a press says to who asks for pictures, or sees them; None where it says nothing to them."""
    allowed = ANSWERS.get((press.button, press.kind))
    return allowed if allowed is not None and can_answer(state, allowed, now_s) else None


def _stays_open(state: DeviceState, menu: Menu, now_s: float) -> bool:
    return now_s <= menu.until_s and (menu.by == "privacy" or _may_choose(state))


def _in_privacy(state: DeviceState) -> bool:
    return state.menu is not None and state.menu.by == "privacy"


def _may_choose(state: DeviceState) -> bool:
    return not STATES[state.purpose].answers[StateEvent.DESTINATION].refused


def _wish(state: DeviceState, event: StateEvent, now_s: float, poi_id: str = "") -> Step:
    """Ask the state machine, and tell the console that it was the walker who asked."""
    what = f"{event.value}, {state.place_name(poi_id)}" if poi_id else event.value
    state, effects = happen(state, event, now_s, poi_id=poi_id, by=By.WALKER)
    return state, (Happened("button", f"The walker pressed: {what}."), *effects)


def _chosen(state: DeviceState, menu: Menu, now_s: float) -> Step:
    if menu.by == "privacy":
        return privacy_menu.chosen(state, now_s, now_s + OPEN_FOR_S)
    return _wish(replace(state, menu=None), StateEvent.DESTINATION, now_s, menu.entry_id)


# -------------------------------------------------------------------------------------------------------- browsing
def _browse(state: DeviceState, now_s: float, step: int = 0) -> Step:
    """Go to another place of the list, or to the first one."""
    menu = state.menu
    if menu is not None and menu.by == "privacy":
        return privacy_menu.moved(state, step, now_s + OPEN_FOR_S)
    by: Literal["distance", "name"] = "distance" if _pose(state) else "name"
    if menu is not None:
        by = "distance" if menu.by == "distance" else "name"
    pois = _listed(state, menu) if menu is not None else places(state, by)
    if not pois:
        return replace(state, menu=None), (Notice(TEXTS[state.settings.cues.language]["menu_empty"], answers=True),)
    ids = [poi.id for poi in pois]
    if menu is None or menu.entry_id not in ids:
        # The way back into the list begins at its end.
        at = len(pois) - 1 if step < 0 else 0
    else:
        at = (ids.index(menu.entry_id) + step) % len(pois)
    return _named(_opened_at(state, by, pois, at, now_s), pois, at, opened=menu is None)


def _listed(state: DeviceState, menu: Menu) -> tuple[Poi, ...]:
    """Return the places of the open list in its own order, without those that a newer graph has no more."""
    there = {poi.id: poi for poi in places(state, "name")}
    return tuple(there[key] for key in menu.listed if key in there)


def _opened_at(
    state: DeviceState, by: Literal["distance", "name"], pois: tuple[Poi, ...], at: int, now_s: float
) -> DeviceState:
    listed = tuple(poi.id for poi in pois)
    return replace(state, menu=Menu(listed[at], by, now_s + OPEN_FOR_S, listed))


def _changed_order(state: DeviceState, now_s: float) -> Step:
    """Go to the next list, and begin at its first entry: places by distance, by name, and then privacy."""
    before = state.menu.by if state.menu is not None else "privacy"
    if before == "name":
        return privacy_menu.opened(state, now_s + OPEN_FOR_S)
    by: Literal["distance", "name"] = "name" if before == "distance" or not _pose(state) else "distance"
    state = replace(state, menu=None)
    pois = places(state, by)
    if not pois:
        return _browse(state, now_s)
    return _named(_opened_at(state, by, pois, 0, now_s), pois, 0, opened=True)


_BROWSE: dict[Browse, Callable[[DeviceState, float], Step]] = {
    "browse": _browse,
    "browse next": lambda state, now_s: _browse(state, now_s, 1),
    "browse previous": lambda state, now_s: _browse(state, now_s, -1),
    "change order": _changed_order,
}


def places(state: DeviceState, by: Literal["distance", "name"]) -> tuple[Poi, ...]:
    """Return the places that can be chosen, in order: no junctions, and nothing that stands beside the road.

    By distance, those to which no way leads from here come last.
    """
    joined = {end for edge in state.graph.edges.values() for end in (edge.a, edge.b)}
    pois = [poi for poi in state.graph.pois.values() if poi.on_road and poi.kind != "junction" and poi.id in joined]
    pois.sort(key=lambda poi: (name_of(poi).casefold(), poi.id))
    pose = _pose(state)
    if by == "distance" and pose is not None:
        cost_m = costs_m(state, pose)
        pois.sort(key=lambda poi: cost_m.get(poi.id, float("inf")))
    return tuple(pois)


def _named(state: DeviceState, pois: tuple[Poi, ...], at: int, *, opened: bool) -> Step:
    assert state.menu is not None
    language = state.settings.cues.language
    texts, entry = TEXTS[language], _entry(state, pois[at], at + 1, len(pois))
    begin = texts[f"menu_by_{state.menu.by}"] + ("" if language == "zh" else " ") if opened else ""
    effects: tuple[Effect, ...] = (Notice(begin + entry, answers=True),)
    return state, effects


def _entry(state: DeviceState, poi: Poi, number: int, count: int) -> str:
    language, pose = state.settings.cues.language, _pose(state)
    texts, name = TEXTS[language], name_of(poi)
    way_m = None if pose is None else _way_m(state, poi, pose)
    if way_m is None:
        return texts["menu_entry_unknown"].format(name=name, number=number, count=count)
    if way_m < HERE_M:
        return texts["menu_entry_here"].format(name=name, number=number, count=count)
    distance = distance_text(way_m, language)
    return texts["menu_entry"].format(name=name, distance=distance, number=number, count=count)


def _way_m(state: DeviceState, poi: Poi, pose: Pose2D) -> float | None:
    """Return the length of the way from here to a place; None where none leads there."""
    try:
        return finder_of(state).route_to(poi.id, pose.x_m, pose.y_m, heading=pose.heading).length_m
    except PlanningError:
        return None


def _pose(state: DeviceState) -> Pose2D | None:
    """Return where the walker is, if that is sure: a way from anywhere else would have another length."""
    located = state.located
    return located.pose if located is not None and located.quality is LocalizationQuality.LOCALIZED else None

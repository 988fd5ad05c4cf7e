"""What the buttons mean: a menu without a picture. Pure.

The main button starts, pauses, goes on and, held, stops; *next* and *previous* go through the places, and the main
button chooses the one that was named last: it is named again, with the length of the way, and only a second press sets
off. After the last place comes *privacy*, which opens a list of its own (:mod:`device_agent.privacy_menu`). Every press
is answered in words. What a wish leads to is for the state machine to say (:mod:`device_agent.states`).
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
from device_agent.state import DeviceState, Happened, Menu, Notice, Step
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
SET_OFF_WITHIN_S = 10.0
"""So long after a place was chosen a second press sets off; later it asks again."""
PRIVACY = "*privacy"
"""The last entry among the places; no identifier of a place has an asterisk."""

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
"""The main button, pressed shortly while no list is open; in one it chooses what was named last."""
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
        # There are no places to put in order: what concerns privacy is within reach in every state.
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
    if menu.entry_id == PRIVACY:
        return privacy_menu.opened(state, now_s + OPEN_FOR_S)
    if menu.entry_id not in _listed(state, menu):
        return _browse(state, now_s)
    if now_s <= menu.set_off_until_s:
        return _wish(replace(state, menu=None), StateEvent.DESTINATION, now_s, menu.entry_id)
    menu = replace(menu, until_s=now_s + OPEN_FOR_S, set_off_until_s=now_s + SET_OFF_WITHIN_S)
    question = TEXTS[state.settings.cues.language]["menu_set_off"].format(place=_place(state, menu.entry_id))
    return replace(state, menu=menu), (Notice(question, answers=True),)


# -------------------------------------------------------------------------------------------------------- browsing
def _browse(state: DeviceState, now_s: float, step: int = 0) -> Step:
    """Go to another entry of the open list, or open the list of places."""
    menu = state.menu
    if menu is not None and menu.by == "privacy":
        return privacy_menu.moved(state, step, now_s + OPEN_FOR_S)
    if menu is None:
        # The way back into the list begins at its end.
        return _opened(state, "distance" if _pose(state) else "name", now_s, at=min(step, 0))
    listed = _listed(state, menu)
    at = (listed.index(menu.entry_id) + step) % len(listed) if menu.entry_id in listed else min(step, 0)
    return _named(replace(state, menu=Menu(listed[at], menu.by, now_s + OPEN_FOR_S, listed)))


def _listed(state: DeviceState, menu: Menu) -> tuple[str, ...]:
    """Return the entries of the open list in its own order, without the places that a newer graph has no more."""
    there = {PRIVACY, *(poi.id for poi in places(state, "name"))}
    return tuple(key for key in menu.listed if key in there)


def _opened(state: DeviceState, by: Literal["distance", "name"], now_s: float, at: int = 0) -> Step:
    """Open the list of places, and say how they are ordered before what is named; where there is none, that."""
    listed = (*(poi.id for poi in places(state, by)), PRIVACY)
    is_empty = len(listed) == 1
    begin = "menu_empty" if is_empty else "" if listed[at] == PRIVACY else f"menu_by_{by}"
    return _named(replace(state, menu=Menu(listed[at], by, now_s + OPEN_FOR_S, listed)), begin)


def _changed_order(state: DeviceState, now_s: float) -> Step:
    """List the places by name where they are listed by distance, else by distance; begin at the first."""
    is_by_distance = state.menu is not None and state.menu.by == "distance"
    return _opened(state, "name" if is_by_distance or not _pose(state) else "distance", now_s)


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


def _named(state: DeviceState, begin: str = "") -> Step:
    """Say the entry at which the list is, after a text of its own (a key of TEXTS)."""
    language = state.settings.cues.language
    said = [*([TEXTS[language][begin]] if begin else []), _entry(state)]
    return state, (Notice(("" if language == "zh" else " ").join(said), answers=True),)


def _entry(state: DeviceState) -> str:
    menu, texts = state.menu, TEXTS[state.settings.cues.language]
    assert menu is not None
    if menu.entry_id == PRIVACY:
        return texts["menu_privacy"]
    number, count = menu.listed.index(menu.entry_id) + 1, len(menu.listed) - 1
    return texts["menu_entry"].format(place=_place(state, menu.entry_id), number=number, count=count)


def _place(state: DeviceState, poi_id: str) -> str:
    """Return what a place is called and how long the way to it is, where that is known."""
    language, pose, poi = state.settings.cues.language, _pose(state), state.graph.pois[poi_id]
    texts, name = TEXTS[language], name_of(poi)
    way_m = None if pose is None else _way_m(state, poi, pose)
    if way_m is None:
        return name
    if way_m < HERE_M:
        return texts["menu_place_here"].format(name=name)
    return texts["menu_place"].format(name=name, distance=distance_text(way_m, language))


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

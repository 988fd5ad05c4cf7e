"""The buttons: places are browsed and chosen, guidance is paused and stopped, and *where am I* is answered honestly."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from device_hall import Rig

from device_agent.led_by import REFUSE_WITHIN_S
from device_agent.menu import MAIN_LONG, MAIN_SHORT, OPEN_FOR_S, OTHERS, SET_OFF_WITHIN_S, places, pressed
from device_agent.orders import carry_out
from device_agent.ports import Button, ButtonPress, PressKind
from device_agent.state import (
    DeviceState,
    Happened,
    MapWalkTold,
    MarkPlace,
    Notice,
    Phrase,
    PreparedMap,
    SayAgain,
    Step,
)
from device_agent.states import StateEvent
from device_agent.way import plan_if_needed
from device_agent.whereabouts import whereabouts
from navcore.cues.table import CueKind
from navcore.cues.texts import TEXTS
from navcore.geometry import world_from_camera_at
from navcore.modes import Mode
from navcore.planning.poi_graph import Edge, Poi, PoiGraph
from navcore.settings import Settings
from navcore.site import Site
from navcore.types import Action, DecisionTrace, Guidance, Localization, LocalizationQuality, Pose2D, Reason
from navcore.wire import Pause, Repeat, Say, SetDestination

PLACES = {
    "hall": ("Hall", "hall", 0.0, 0.0), "bar": ("Bar", "bar", 10.0, 0.0), "x": ("Corner", "junction", 20.0, 0.0),
    "wash": ("Wash room", "toilet", 20.0, 8.0), "attic": ("Attic", "room", 0.5, 50.0),
    "annex": ("Annex", "room", 5.0, 3.0), "loft": ("Loft", "room", 0.0, 0.5),
}  # fmt: skip
POIS = {key: Poi(key, *rest, spoken_name="the bar" if key == "bar" else "") for key, rest in PLACES.items()} | {
    "desk": Poi("desk", "Desk", "other", 1.0, 1.0, on_road=False)
}


def edge(a: str, b: str) -> Edge:
    ends = tuple((POIS[key].x_m, POIS[key].y_m) for key in (a, b))
    return Edge(f"{a}-{b}", a, b, ends, math.dist(*ends))


# The annex and the loft are joined with each other alone: no way leads there from the hall.
GRAPH = PoiGraph(
    1, POIS, {each.id: each for each in (edge("hall", "bar"), edge("bar", "x"), edge("x", "wash"))}
    | {"annex-loft": edge("annex", "loft")},
)  # fmt: skip
SURE, UNSURE, LOST = LocalizationQuality.LOCALIZED, LocalizationQuality.UNCERTAIN, LocalizationQuality.LOST


def located(
    x_m: float = 2.0, y_m: float = 0.0, heading_deg: float = 0.0, quality: LocalizationQuality = SURE
) -> Localization:
    pose = world_from_camera_at((x_m, y_m, 1.6), math.radians(heading_deg), np.radians(15.0))
    return Localization(0.0, quality, None if quality is LOST else pose)


def standing(mode: Mode = Mode.READY, where: Localization | None = None, **settings: str) -> DeviceState:
    changed = Settings().changed({f"cues.{name}": value for name, value in settings.items()})
    return DeviceState(changed, GRAPH, mode=mode, located=where or located())


def press(state: DeviceState, button: Button, kind: PressKind = PressKind.SHORT, now_s: float = 0.0) -> Step:
    return pressed(state, ButtonPress(now_s, button, kind), now_s)


def heard(step: Step) -> list[str]:
    return [effect.text for effect in step[1] if isinstance(effect, Notice)]


def leading(where: Localization | None = None, **settings: str) -> DeviceState:
    """Somebody on their way to the wash room, who has just heard *walk*."""
    state = standing(Mode.GUIDING, where, **settings)
    state = replace(state, destination_id="wash", wanted_id="wash")
    assert state.located is not None
    assert state.located.pose is not None
    state, _ = plan_if_needed(state, state.located.pose, 0.0)
    trace = DecisionTrace(closest_index=0)
    return replace(state, guidance=Guidance(0.0, Action.WALK, None, Reason.OK, trace, state.route_version))


# -------------------------------------------------------------------------------------------------------- browsing
def test_the_main_button_opens_the_list_at_the_nearest_place_and_chooses_it() -> None:
    step = press(standing(), Button.MAIN)
    assert heard(step) == ["Places by distance. Hall, 2 metres. 1 of 5."]
    step = press(step[0], Button.NEXT)
    assert heard(step) == ["the bar, 8 metres. 2 of 5."]
    step = press(step[0], Button.NEXT)
    assert heard(step) == ["Wash room, 26 metres. 3 of 5."]
    step = press(step[0], Button.MAIN)
    assert heard(step) == ["Wash room, 26 metres. Press again to set off."]
    assert step[0].wanted_id is None
    state, effects = press(step[0], Button.MAIN)
    assert heard((state, effects)) == ["To Wash room."]
    assert (state.mode, state.wanted_id, state.menu) == (Mode.GUIDING, "wash", None)
    assert Happened("button", "The walker pressed: destination, Wash room.") in effects


def test_the_list_goes_round_and_names_last_what_cannot_be_reached() -> None:
    privacy = press(standing(), Button.PREVIOUS)
    assert heard(privacy) == ["Privacy. Press the main button to open it."]
    assert heard(press(privacy[0], Button.NEXT)) == ["Hall, 2 metres. 1 of 5."]
    loft = press(privacy[0], Button.PREVIOUS)
    assert heard(loft) == ["Loft. 5 of 5."]
    assert heard(press(loft[0], Button.NEXT)) == heard(privacy)
    assert [poi.id for poi in places(standing(), "distance")] == ["hall", "bar", "wash", "annex", "loft"]
    assert [poi.id for poi in places(standing(), "name")] == ["annex", "hall", "loft", "bar", "wash"], "as it is called"


def test_the_list_keeps_its_order_while_it_is_open_however_far_the_walker_goes_meanwhile() -> None:
    state, _ = press(standing(), Button.NEXT)
    named = [state.menu.entry_id] if state.menu is not None else []
    for x_m in (8.0, 15.0, 19.0, 19.0):
        state, _ = press(replace(state, located=located(x_m)), Button.NEXT)
        assert state.menu is not None
        named.append(state.menu.entry_id)
    assert named == ["hall", "bar", "wash", "annex", "loft"], "each once, though the nearest is another by now"
    state, _ = press(replace(state, graph=replace_pois(GRAPH, without="hall")), Button.NEXT)
    state, said = press(state, Button.NEXT)
    assert heard((state, said)) == ["the bar, 9 metres. 1 of 4."], "a place that is gone is left out"


def replace_pois(graph: PoiGraph, *, without: str) -> PoiGraph:
    pois = {key: poi for key, poi in graph.pois.items() if key != without}
    edges = {key: each for key, each in graph.edges.items() if without not in (each.a, each.b)}
    return PoiGraph(graph.version + 1, pois, edges)


def test_nobody_is_led_anywhere_by_one_press_nor_by_two_with_another_or_too_long_between() -> None:
    state, _ = press(standing(), Button.NEXT)
    asked, _ = press(state, Button.MAIN)
    moved, _ = press(asked, Button.NEXT)
    assert heard(press(moved, Button.MAIN)) == ["the bar, 8 metres. Press again to set off."], "another place"
    late = press(asked, Button.MAIN, now_s=SET_OFF_WITHIN_S + 0.1)
    assert heard(late) == ["Hall, 2 metres. Press again to set off."], "it is asked again"
    assert press(late[0], Button.MAIN, now_s=SET_OFF_WITHIN_S + 5.0)[0].wanted_id == "hall"
    closed, _ = press(asked, Button.MAIN, PressKind.LONG)
    assert heard(press(closed, Button.MAIN)) == ["Places by distance. Hall, 2 metres. 1 of 5."]
    gone = press(replace(asked, graph=replace_pois(GRAPH, without="hall")), Button.MAIN, now_s=1.0)
    assert heard(gone) == ["the bar. 1 of 4."], "the place is there no more"
    assert gone[0].wanted_id is None
    nowhere, _ = press(standing(Mode.LOCALIZING, located(quality=LOST)), Button.NEXT)
    assert heard(press(nowhere, Button.MAIN)) == ["Annex. Press again to set off."], "the way is not known yet"
    chinese, _ = press(standing(language="zh"), Button.NEXT)
    assert heard(press(chinese, Button.MAIN)) == ["Hall,距离2米。再按一次出发。"]


def test_a_held_next_sorts_by_name_and_again_by_distance_and_leads_from_privacy_to_the_places() -> None:
    step = press(standing(), Button.NEXT)
    step = press(step[0], Button.NEXT, PressKind.LONG)
    assert heard(step) == ["Places by name. Annex. 1 of 5."]
    assert heard(press(step[0], Button.NEXT)) == ["Hall, 2 metres. 2 of 5."]
    by_distance = press(step[0], Button.NEXT, PressKind.LONG)
    assert heard(by_distance) == ["Places by distance. Hall, 2 metres. 1 of 5."]
    step = press(press(by_distance[0], Button.PREVIOUS)[0], Button.MAIN)
    assert heard(step) == ["Privacy. There is no link to the console. It is not known who watches."]
    assert heard(press(step[0], Button.NEXT, PressKind.LONG)) == heard(by_distance)


@pytest.mark.parametrize("where", [located(quality=LOST), located(quality=UNSURE)])
def test_without_a_sure_position_the_list_is_by_name_and_tells_no_distance(where: Localization) -> None:
    step = press(standing(Mode.LOCALIZING, where), Button.MAIN)
    assert heard(step) == ["Places by name. Annex. 1 of 5."]
    assert heard(press(step[0], Button.NEXT, PressKind.LONG)) == ["Places by name. Annex. 1 of 5."]


def test_the_place_where_one_stands_is_here() -> None:
    assert heard(press(standing(where=located(10.3)), Button.MAIN)) == ["Places by distance. the bar, here. 1 of 5."]


def test_a_site_without_places_says_so_and_leads_to_privacy_all_the_same() -> None:
    state = replace(standing(), graph=PoiGraph())
    said = ["There is no place to go to. Privacy. Press the main button to open it."]
    for button in (Button.MAIN, Button.NEXT, Button.PREVIOUS):
        assert heard(press(state, button)) == said
    step = press(state, Button.NEXT, PressKind.LONG)
    assert heard(step) == said
    assert heard(press(step[0], Button.MAIN))[0].startswith("Privacy. There is no link")


def test_the_list_closes_by_itself_and_by_the_held_main_button() -> None:
    state, _ = press(standing(), Button.NEXT)
    late = OPEN_FOR_S + 1.0
    assert heard(press(state, Button.MAIN, now_s=late)) == ["Places by distance. Hall, 2 metres. 1 of 5."]
    step = press(state, Button.MAIN, PressKind.LONG)
    assert heard(step) == ["List closed."]
    assert (step[0].mode, step[0].menu) == (Mode.READY, None)
    assert press(step[0], Button.MAIN, PressKind.LONG)[0].mode is Mode.OFF_DUTY


def test_a_place_that_is_gone_from_a_new_graph_does_not_lead_anywhere_else() -> None:
    state, _ = press(standing(), Button.PREVIOUS)
    state = replace(
        state, graph=PoiGraph(2, {key: POIS[key] for key in ("hall", "bar")}, {"hall-bar": edge("hall", "bar")})
    )
    assert heard(press(state, Button.NEXT)) == ["Hall, 2 metres. 1 of 2."]


def test_whoever_is_led_may_choose_another_place_and_is_led_on_meanwhile() -> None:
    state, _ = press(leading(), Button.NEXT)
    state, _ = press(state, Button.MAIN)
    assert (state.mode, state.destination_id, state.wanted_id) == (Mode.GUIDING, "wash", None)
    state, effects = press(state, Button.MAIN)
    assert (state.mode, state.destination_id, state.wanted_id) == (Mode.GUIDING, "wash", "hall")
    assert heard((state, effects)) == ["To Hall."]


@pytest.mark.parametrize("mode", [Mode.OFF_DUTY, Mode.MAPPING])
def test_where_nothing_can_be_chosen_the_reason_is_said(mode: Mode) -> None:
    for button in (Button.NEXT, Button.PREVIOUS):
        (reason,) = heard(press(standing(mode), button))
        assert reason.startswith("You are off duty." if mode is Mode.OFF_DUTY else "A map is being recorded.")
    assert heard(press(standing(mode), Button.NEXT, PressKind.LONG))[0].startswith("Privacy. There is no link")


def test_every_press_is_answered_in_every_state() -> None:
    assert set(MAIN_SHORT) == set(MAIN_LONG) == set(Mode) - {Mode.FAULT}
    assert {button for button, _ in OTHERS} == set(Button) - {Button.MAIN}
    for mode in Mode:
        for button in Button:
            for kind in PressKind:
                beneath = Mode.READY if mode is Mode.FAULT else None
                before = replace(standing(mode), beneath=beneath, destination_id="bar")
                after, effects = press(before, button, kind)
                # Guidance itself says "Stop. Paused.", "Stop. No destination.", and goes on by "Move forward.".
                spoken = any(isinstance(effect, Notice | SayAgain) for effect in effects)
                assert spoken or after.mode is not before.mode, (mode, button, kind)


def test_held_main_stops_whoever_is_led_and_puts_off_duty_whoever_is_not() -> None:
    for mode, purpose in MAIN_LONG.items():
        if mode is Mode.OFF_DUTY:
            # There it offers a map walk.
            continue
        assert purpose is (
            StateEvent.OFF_DUTY if mode in (Mode.READY, Mode.LOCALIZING, Mode.ARRIVED) else StateEvent.STOP
        )


# ------------------------------------------------------------------------------------------------------ where am I
@pytest.mark.parametrize(
    ("style", "heading_deg", "said"),
    [
        ("degrees", 0.0, "the bar: 3 metres, straight ahead."),
        ("degrees", 90.0, "the bar: 3 metres, 90 degrees to the right."),
        ("degrees", -42.0, "the bar: 3 metres, 40 degrees to the left."),
        ("degrees", 180.0, "the bar: 3 metres, behind you."),
        ("clock", 0.0, "the bar: 3 metres, at 12 o'clock."),
        ("clock", 90.0, "the bar: 3 metres, at 3 o'clock."),
        ("clock", -60.0, "the bar: 3 metres, at 10 o'clock."),
        ("sides", 45.0, "the bar: 3 metres, half right."),
        ("sides", -90.0, "the bar: 3 metres, on the left."),
        ("sides", -135.0, "the bar: 3 metres, behind on the left."),
    ],
)
def test_the_nearest_place_is_told_in_the_walkers_style(style: str, heading_deg: float, said: str) -> None:
    state = standing(where=located(7.0, 0.0, heading_deg), direction_style=style)
    assert whereabouts(state, 0.0) == said


def test_a_place_behind_a_wall_is_not_the_nearest() -> None:
    state = standing(where=located(5.0, 0.0))
    assert whereabouts(state, 0.0) in ("Hall: 5 metres, behind you.", "the bar: 5 metres, straight ahead.")
    assert whereabouts(standing(where=located(0.4, 0.0)), 0.0) == "You are at Hall."


def test_whoever_has_arrived_is_told_once_where_they_are() -> None:
    state = standing(where=located(0.4, 0.0))
    arrived = replace(state, mode=Mode.ARRIVED, destination_id=next(iter(state.graph.pois)))
    assert whereabouts(arrived, 0.0) == "You are at Hall."


def test_the_way_that_is_left_and_the_next_stops_are_told_fewer_to_whoever_walks() -> None:
    walking = leading()
    assert whereabouts(walking, 0.0) == (
        "Hall: 2 metres, behind you. To Wash room: 26 metres. On the way: the bar in 8 metres."
    )
    assert walking.guidance is not None
    paused = replace(walking, mode=Mode.PAUSED, guidance=replace(walking.guidance, action=Action.STOP))
    text = whereabouts(paused, 0.0)
    assert text.startswith("Paused, on the way to Wash room. Hall: 2 metres")
    assert "Corner" not in text, "a junction without a spoken name is passed in silence"


def test_an_uncertain_position_is_said_to_be_one_and_a_lost_one_is_not_told_at_all() -> None:
    assert whereabouts(standing(where=located(quality=UNSURE)), 0.0).startswith("Position uncertain. Hall: 2 metres")
    lost = standing(Mode.LOST, located(quality=LOST))
    assert whereabouts(lost, 0.0) == "Position lost. Your position is not known."
    known = replace(lost, sure=(10.0, Pose2D(7.0, 0.0, located().pose.heading)))  # type: ignore[union-attr]
    assert whereabouts(known, 22.0) == "Position lost. 12 seconds ago you were 3 metres from the bar."
    assert whereabouts(known, 3600.0) == "Position lost. Your position is not known.", "that was long ago"
    blind = replace(known, mode=Mode.FAULT, beneath=Mode.READY, located=None)
    assert whereabouts(blind, 22.0).startswith("Something has failed. 12 seconds ago")


def test_it_is_told_in_chinese_as_well() -> None:
    assert whereabouts(standing(where=located(7.0), language="zh"), 0.0) == "the bar在正前方,距离3米。"
    assert heard(press(standing(language="zh"), Button.MAIN)) == ["地点按距离排列。Hall,距离2米。第1个,共5个。"]


def test_who_has_no_named_place_near_hears_that() -> None:
    state = replace(standing(), graph=PoiGraph(1, {"x": POIS["x"]}))
    assert whereabouts(state, 0.0) == "Your position is known, but no place has a name."


# -------------------------------------------------------------------------------------------------- the whole device
@pytest.fixture
def rig() -> Rig:
    return Rig()


def test_a_walk_from_start_to_stop_by_buttons_alone(rig: Rig) -> None:
    rig.cycles(2)
    assert rig.press(Button.MAIN) == ["Places by distance. Hall, here. 1 of 2."]
    assert rig.press(Button.NEXT) == ["Bar, 20 metres. 2 of 2."]
    assert rig.press(Button.MAIN) == ["Bar, 20 metres. Press again to set off."]
    assert rig.press(Button.MAIN)[0] == "To Bar."
    assert rig.cycles(8)[-1].guidance.action is Action.WALK
    rig.cycles(30)
    rig.press(Button.REPEAT, PressKind.LONG)
    rig.cycles(60)
    answers = [cue.text for cue in rig.output.cues if cue.kind is CueKind.ANSWER]
    assert answers[-1] == "You are at Hall. To Bar: 20 metres."
    assert rig.press(Button.MAIN) == ["Stop. Paused."]
    assert {cycle.guidance.action for cycle in rig.cycles(20)} == {Action.STOP}
    rig.press(Button.MAIN)
    assert rig.cycles(8)[-1].guidance.action is Action.WALK
    assert rig.press(Button.MAIN, PressKind.LONG) == ["Stop. No destination."]
    rig.cycles(20)
    assert rig.agent.state.mode is Mode.READY
    assert rig.press(Button.MAIN, PressKind.LONG) == ["Off duty."]
    assert rig.events("button") == [
        "The walker pressed: destination, Bar.", "The walker pressed: where am I.", "The walker pressed: pause.",
        "The walker pressed: resume.", "The walker pressed: stop.", "The walker pressed: off duty.",
    ]  # fmt: skip


def test_the_last_order_wins_whoever_gives_it_and_both_hear_of_it(rig: Rig) -> None:
    rig.cycles(2)
    rig.agent.submit(SetDestination("bar"))
    rig.cycles(6)
    assert "The console leads you to Bar." in [cue.text for cue in rig.output.cues]
    rig.press(Button.NEXT)
    rig.press(Button.MAIN)
    rig.press(Button.MAIN)
    rig.cycles(6)
    assert rig.agent.state.destination_id == "hall"
    assert "The walker pressed: destination, Hall." in rig.events("button")
    assert rig.uplink.states[-1].destination_id == "hall"
    rig.agent.submit(SetDestination("bar"))
    rig.cycles(6)
    assert rig.agent.state.destination_id == "bar"


def test_repeat_says_the_last_sentence_and_never_a_walk_that_no_longer_holds(rig: Rig) -> None:
    rig.lead_to()
    rig.cycles(30)
    assert rig.press(Button.REPEAT) == ["Move forward."]
    assert rig.output.cues[-1].kind is CueKind.MESSAGE, "words, not an instruction"
    rig.cycles(30)
    rig.agent.submit(Pause())
    rig.agent.submit(Repeat())
    before = len(rig.output.cues)
    rig.cycles(40)
    said = [cue.text for cue in rig.output.cues[before:] if cue.text]
    assert said[0] == "Paused, on the way to Bar."
    assert "Move forward." not in said
    assert rig.press(Button.REPEAT) == ["Stop. Paused."]


def test_repeat_before_anything_was_said_tells_the_state(rig: Rig) -> None:
    rig.cycles(2)
    assert rig.press(Button.REPEAT) == ["Ready."]


def test_an_answer_that_an_instruction_cuts_off_is_not_said_again(rig: Rig) -> None:
    rig.cycles(2)
    rig.agent.submit(SetDestination("bar"))
    rig.cycles(40)
    said = [cue.text for cue in rig.output.cues if cue.text]
    assert said.count("The console leads you to Bar.") == 1
    assert said.index("The console leads you to Bar.") < said.index("Move forward.")


def test_buttons_that_are_gone_are_told_once_and_nothing_else_happens(rig: Rig) -> None:
    rig.lead_to()
    rig.buttons.close()
    assert {cycle.guidance.action for cycle in rig.cycles(5)} == {Action.WALK}
    assert rig.events("sensor") == ["The buttons are closed: start the device again."]
    assert rig.agent.state.failed_s == -math.inf


def test_a_button_pressed_while_the_camera_is_dead_is_answered_and_holds_afterwards(rig: Rig) -> None:
    from navcore.errors import SensorError

    rig.lead_to()
    good, rig.spoil = rig.spoil, lambda frame: SensorError("no picture")
    rig.cycles(3)
    assert rig.agent.state.mode is Mode.FAULT
    rig.press(Button.MAIN, PressKind.LONG)
    rig.spoil = good
    assert {cycle.guidance.action for cycle in rig.cycles(30)} == {Action.STOP}
    assert rig.agent.state.mode is Mode.READY


# ------------------------------------------------------------------------------------------------------ map walks
def test_a_map_walk_begins_with_next_after_it_was_offered_and_with_nothing_else() -> None:
    offered = press(standing(Mode.OFF_DUTY), Button.MAIN, PressKind.LONG)
    assert heard(offered) == ["Does a sighted person want to record a map? Press next to begin."]
    begun, effects = press(offered[0], Button.NEXT)
    assert begun.mode is Mode.MAPPING
    assert heard((begun, effects)) == ["The map walk begins."]
    for button, kind in itertools.product(Button, PressKind):
        if (button, kind) == (Button.NEXT, PressKind.SHORT):
            continue
        between, _ = press(offered[0], button, kind)
        assert between.mode is not Mode.MAPPING
        if (button, kind) != (Button.MAIN, PressKind.LONG):
            assert press(between, Button.NEXT)[0].mode is not Mode.MAPPING, "another press has closed the offer"
    late, _ = press(offered[0], Button.NEXT, now_s=OPEN_FOR_S + 0.1)
    assert late.mode is Mode.OFF_DUTY
    assert press(standing(Mode.OFF_DUTY), Button.NEXT)[0].mode is Mode.OFF_DUTY, "it was not offered"


NO_MAP = "There is no map yet. Hold the main button to record one, or have one sent by the console."


def test_on_duty_without_a_map_says_what_can_be_done_and_that_works() -> None:
    state = DeviceState(Settings(), PoiGraph(), mode=Mode.OFF_DUTY)
    step = press(state, Button.MAIN)
    assert (step[0].mode, heard(step)) == (Mode.OFF_DUTY, [NO_MAP])
    step = press(step[0], Button.MAIN, PressKind.LONG)
    assert press(step[0], Button.NEXT)[0].mode is Mode.MAPPING
    with_map = press(replace(state, map_checksum="a-map"), Button.MAIN)
    assert (with_map[0].mode, heard(with_map)) == (Mode.LOCALIZING, ["On duty. Looking for your position."])


def test_after_a_map_walk_without_a_map_nothing_is_said_to_be_looked_for() -> None:
    state = DeviceState(Settings(), PoiGraph(), mode=Mode.LOCALIZING)
    said = "There is no map yet. Wait while one is built, or hold the main button twice to record one."
    (again,) = (effect for effect in press(state, Button.REPEAT)[1] if isinstance(effect, SayAgain))
    assert again.otherwise == said
    assert whereabouts(state, 0.0).startswith(said)
    state, _ = press(state, Button.MAIN, PressKind.LONG)
    offered = press(state, Button.MAIN, PressKind.LONG)
    assert press(offered[0], Button.NEXT)[0].mode is Mode.MAPPING, "twice held, as it was said"


def news(rig: Rig, key: str, kind: CueKind = CueKind.MAP_NEWS, **values: int) -> list[str]:
    """Tell of a map as a map walk does; return what is said within a while."""
    before = len(rig.output.cues)
    rig.agent.submit(MapWalkTold(kind, (Phrase(key, dict(values)),)))
    rig.cycles(60)
    return [cue.text for cue in rig.output.cues[before:] if cue.text]


def repeated(rig: Rig) -> list[str]:
    before = len(rig.output.cues)
    rig.press(Button.REPEAT)
    rig.cycles(40)
    return [cue.text for cue in rig.output.cues[before:] if cue.text]


@pytest.mark.parametrize("key", ["map_none", "map_building"])
def test_news_of_a_map_are_said_again_only_while_they_are_true(rig: Rig, key: str, small_site: Site) -> None:
    rig.cycles(5)
    told = news(rig, key, percent=40)
    assert repeated(rig) == told, "it is still so"
    rig.agent.submit(PreparedMap(Path("staging"), "new", small_site, rig.localizer))
    rig.cycles(1)
    assert repeated(rig) == ["Ready."]


def test_news_and_advice_of_a_walk_end_with_the_next_one(rig: Rig) -> None:
    rig.cycles(5)
    rig.press(Button.MAIN, PressKind.LONG)
    rig.cycles(40)
    (told,) = news(rig, "map_none")
    assert repeated(rig) == [told]
    rig.press(Button.MAIN, PressKind.LONG)
    rig.press(Button.NEXT)
    rig.cycles(60)
    assert repeated(rig) != [told], "one is being recorded"
    (advice,) = news(rig, "map_walk_slow_down", CueKind.MAP_ADVICE)
    assert repeated(rig) == [advice]
    rig.press(Button.MAIN, PressKind.LONG)
    rig.cycles(60)
    assert advice not in repeated(rig)


def test_news_that_wait_are_not_said_late_of_a_map_that_is_gone(rig: Rig, small_site: Site) -> None:
    rig.cycles(5)
    rig.agent.submit(Say("Somebody speaks for quite a while, so that whatever else there is to say has to wait."))
    rig.cycles(1)
    rig.agent.submit(MapWalkTold(CueKind.MAP_NEWS, (Phrase("map_none"),)))
    rig.cycles(1)
    rig.agent.submit(PreparedMap(Path("staging"), "new", small_site, rig.localizer))
    rig.cycles(150)
    assert TEXTS["en"]["map_none"] not in [cue.text for cue in rig.output.cues]


def test_places_are_counted_anew_in_each_map_walk() -> None:
    state = replace(standing(Mode.OFF_DUTY), mark_count=7, map_offered_until_s=1.0)
    state, _ = press(state, Button.NEXT)
    for number in (1, 2):
        state, effects = press(state, Button.MAIN)
        assert heard((state, effects)) == [f"Place {number} is marked."]
        assert MarkPlace(f"Place {number}") in effects
    state, _ = press(state, Button.MAIN, PressKind.LONG)
    assert state.mode is Mode.LOCALIZING


# ---------------------------------------------------------------------------------- somebody else chooses the way
def ordered(state: DeviceState, poi_id: str, who: str = "Edi", now_s: float = 0.0) -> Step:
    return carry_out(state, SetDestination(poi_id, who), now_s)


def test_who_is_led_elsewhere_hears_by_whom_and_can_keep_their_own_way_by_one_press() -> None:
    step = ordered(leading(), "bar")
    assert heard(step) == ["Edi leads you to the bar. Hold previous to keep Wash room."]
    assert step[0].aim_by == "Edi"
    assert Happened("mode", "Instead of Wash room, which the walker had chosen: the bar.") in step[1]
    kept, effects = press(step[0], Button.PREVIOUS, PressKind.LONG, 10.0)
    assert heard((kept, effects)) == ["To Wash room."]
    assert (kept.wanted_id, kept.aim_by, kept.mode) == ("wash", "", Mode.GUIDING)
    assert Happened("button", "The walker refuses to be led to the bar.") in effects
    again = ordered(step[0], "bar", now_s=5.0)[0]
    assert press(again, Button.PREVIOUS, PressKind.LONG, 10.0)[0].wanted_id == "wash", "the same order twice"
    late = press(step[0], Button.PREVIOUS, PressKind.LONG, REFUSE_WITHIN_S + 1.0)
    assert late[0].wanted_id == "bar", "the button means again what it always does"
    chinese = ordered(leading(language="zh"), "bar")
    assert heard(chinese) == ["Edi带您前往the bar。按住上一个键仍去Wash room。"]


def test_who_was_not_led_hears_by_whom_and_their_buttons_mean_what_they_always_do() -> None:
    step = ordered(standing(), "bar")
    assert heard(step) == ["Edi leads you to the bar."]
    asked = press(step[0], Button.PREVIOUS, PressKind.LONG)[0]
    assert (asked.mode, asked.wanted_id) == (Mode.GUIDING, "bar"), "they were told of no press that refuses"
    assert press(step[0], Button.MAIN, PressKind.LONG)[0].mode is Mode.READY
    chinese = ordered(standing(language="zh"), "bar")
    assert heard(chinese) == ["Edi带您前往the bar。"]


def test_who_stood_in_a_pause_does_so_again_after_refusing() -> None:
    paused = replace(leading(), mode=Mode.PAUSED)
    step = ordered(paused, "bar")
    assert step[0].mode is Mode.GUIDING
    back = press(step[0], Button.PREVIOUS, PressKind.LONG)[0]
    assert (back.mode, back.wanted_id) == (Mode.PAUSED, "wash")

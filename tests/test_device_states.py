"""The table of states: it is whole, every state can be reached, and nobody is sent walking but in one of them."""

from __future__ import annotations

import itertools
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from device_hall import GRAPH, Rig, pose_at
from hypothesis import given, settings
from hypothesis import strategies as st

from device_agent.orders import carry_out
from device_agent.ports import Button, PressKind
from device_agent.state import DeviceState, Happened, Notice
from device_agent.states import EVENT_SOURCES, STATES, WISHES, StateAction, StateEvent, answer, may_be_told
from device_agent.transitions import By, happen
from navcore.cues.table import CueKind
from navcore.cues.texts import TEXTS
from navcore.errors import SensorError
from navcore.modes import Mode
from navcore.settings import Settings
from navcore.types import Action, LocalizationQuality
from navcore.wire import ClearDestination, Pause, Repeat, Resume, RouteChanged, SetDestination

SENDING = {CueKind.WALK, CueKind.TICK, CueKind.STEER}
STANDING = set(Mode) - {Mode.GUIDING}
EVERYWHERE = [(mode, None) for mode in Mode if mode is not Mode.FAULT] + [
    (Mode.FAULT, mode) for mode in Mode if mode not in (Mode.FAULT, Mode.OFF_DUTY)
]


def state_in(mode: Mode, beneath: Mode | None = None, **changes: object) -> DeviceState:
    purpose = beneath or mode
    goal = "bar" if purpose in (Mode.GUIDING, Mode.PAUSED, Mode.LOST, Mode.ARRIVED) else None
    state = DeviceState(Settings(), GRAPH, mode=mode, beneath=beneath, destination_id=goal)
    return replace(state, **changes)


# ------------------------------------------------------------------------------------------------------ the table
def test_every_event_is_answered_in_every_state() -> None:
    assert set(STATES) == set(Mode)
    assert set(EVENT_SOURCES) == set(StateEvent)
    for mode, entry in STATES.items():
        assert set(entry.answers) == set(StateEvent), mode


def test_every_action_is_used_and_every_state_has_words() -> None:
    used = {transition.action for entry in STATES.values() for transition in entry.answers.values()}
    assert used == set(StateAction)
    for mode in Mode:
        assert mode.label
        assert mode.sentence.endswith(".")
        assert all(f"mode_{mode.value}" in TEXTS[language] for language in ("en", "zh"))


def test_every_state_can_be_reached_from_the_start() -> None:
    seen, new = set(), [(Mode.LOCALIZING, None)]
    while new:
        here = new.pop()
        seen.add(here)
        found = [answer(*here, event) for event in StateEvent]
        new += [(each.mode, each.beneath) for each in found if (each.mode, each.beneath) not in seen]
    assert {mode for mode, _ in seen} == set(Mode)
    assert seen == set(EVERYWHERE)
    for begin in EVERYWHERE:
        assert _leads_to(begin, (Mode.GUIDING, None)), f"nobody is stuck in {begin}"


def _leads_to(begin: tuple[Mode, Mode | None], end: tuple[Mode, Mode | None]) -> bool:
    seen, new = set(), [begin]
    while new:
        here = new.pop()
        seen.add(here)
        new += [(each.mode, each.beneath) for event in StateEvent if (each := answer(*here, event)).mode]
        new = [each for each in new if each not in seen]
    return end in seen


def test_only_wishes_are_refused_and_with_a_spoken_reason_in_both_languages() -> None:
    for mode, event in itertools.product(Mode, StateEvent):
        transition = STATES[mode].answers[event]
        if not transition.refused:
            continue
        assert event in WISHES
        assert transition.to is None
        for language in ("en", "zh"):
            state = state_in(mode)
            state = replace(state, settings=state.settings.changed({"cues.language": language}))
            after, effects = happen(state, event, 0.0, poi_id="bar", by=By.WALKER)
            assert (after.mode, after.beneath, after.destination_id) == (mode, None, state.destination_id)
            assert effects[0] == Notice(TEXTS[language][transition.says], answers=True)
            assert any(isinstance(effect, Happened) for effect in effects), "the console hears of it"


def test_a_refused_destination_is_told_to_the_console_as_such() -> None:
    state, effects = carry_out(state_in(Mode.OFF_DUTY), SetDestination("bar"), 5.0)
    assert state.mode is Mode.OFF_DUTY
    assert effects[0] == Notice("You are off duty. Press the main button to go on duty.", answers=True)
    assert effects[-1] == RouteChanged(5.0, refusal=Mode.OFF_DUTY.sentence)


@pytest.mark.parametrize(("mode", "beneath"), EVERYWHERE)
def test_stop_leads_to_a_state_in_which_the_walker_stands_and_nobody_is_led(mode: Mode, beneath: Mode | None) -> None:
    state, _ = happen(state_in(mode, beneath, wanted_id="bar"), StateEvent.STOP, 0.0, by=By.WALKER)
    assert STATES[state.mode].allows == {Action.STOP}
    assert not state.leading


def test_walk_is_told_in_one_state_alone_and_turns_in_two() -> None:
    assert [mode for mode in Mode if may_be_told(mode, Action.WALK)] == [Mode.GUIDING]
    assert {mode for mode in Mode if may_be_told(mode, Action.TURN)} == {Mode.GUIDING, Mode.LOST}
    assert all(may_be_told(mode, Action.STOP) for mode in Mode)


@pytest.mark.parametrize("before", [mode for mode in Mode if mode not in (Mode.FAULT, Mode.OFF_DUTY)])
def test_a_fault_leads_back_to_where_it_came_from(before: Mode) -> None:
    failed, _ = happen(state_in(before), StateEvent.FAILED, 0.0)
    again, _ = happen(failed, StateEvent.FAILED, 0.1)
    assert (again.mode, again.purpose) == (Mode.FAULT, before)
    back, _ = happen(again, StateEvent.RECOVERED, 1.2)
    assert (back.mode, back.beneath) == (before, None)


def test_what_is_asked_in_a_fault_holds_after_it() -> None:
    led, _ = happen(state_in(Mode.GUIDING), StateEvent.FAILED, 0.0)
    paused, _ = happen(led, StateEvent.PAUSE, 0.1, by=By.WALKER)
    assert (paused.mode, paused.beneath) == (Mode.FAULT, Mode.PAUSED)
    stopped, _ = happen(paused, StateEvent.STOP, 0.2, by=By.WALKER)
    assert happen(stopped, StateEvent.RECOVERED, 1.5)[0].mode is Mode.READY
    off, _ = happen(stopped, StateEvent.OFF_DUTY, 0.3, by=By.WALKER)
    assert (off.mode, off.beneath) == (Mode.OFF_DUTY, None), "a camera that never comes back holds nobody on duty"


def test_who_chooses_another_place_while_paused_is_not_led_on_along_the_old_way() -> None:
    state, _ = happen(state_in(Mode.PAUSED), StateEvent.DESTINATION, 0.0, poi_id="attic", by=By.WALKER)
    assert (state.mode, state.route, state.destination_id) == (Mode.GUIDING, None, "attic")


@given(st.lists(st.tuples(st.sampled_from(StateEvent), st.sampled_from(By), st.sampled_from(sorted(GRAPH.pois)))))
def test_whatever_happens_the_state_stays_consistent(events: list[tuple[StateEvent, By, str]]) -> None:
    state = DeviceState(Settings(), GRAPH)
    for event, by, poi_id in events:
        before = state
        state, _ = happen(state, event, 0.0, poi_id=poi_id, by=by)
        assert (state.beneath is not None) == (state.mode is Mode.FAULT)
        assert state.beneath is not Mode.FAULT
        assert state.leading <= (state.destination_id is not None), "whoever is led has somewhere to go"
        if state.purpose in (Mode.OFF_DUTY, Mode.MAPPING, Mode.READY, Mode.LOCALIZING):
            assert (state.destination_id, state.wanted_id, state.route) == (None, None, None)
        if state.mode is Mode.GUIDING and before.mode is not Mode.GUIDING:
            asked = (StateEvent.DESTINATION, StateEvent.RESUME)
            assert event in asked or before.on_the_way, "nobody sets out unasked"


# ------------------------------------------------------------------------------------------------- the whole device
def step(rig: Rig, what: str) -> None:
    """Do one thing to the agent, by its real ports."""
    orders = {
        "bar": SetDestination("bar"), "attic": SetDestination("attic"), "clear": ClearDestination(), "pause": Pause(),
        "resume": Resume(), "repeat": Repeat(),
    }  # fmt: skip
    if what in orders:
        rig.agent.submit(orders[what])
    elif what in ("sure", "uncertain"):
        rig.pose, rig.quality = rig.pose or pose_at(0.5), LocalizationQuality.LOCALIZED
        rig.quality = LocalizationQuality.UNCERTAIN if what == "uncertain" else rig.quality
    elif what == "lost":
        rig.pose = None
    elif what == "there":
        rig.pose = pose_at(19.8)
    elif what == "blind":
        rig.spoil = lambda frame: SensorError("no picture")
    elif what == "sees":
        rig.spoil = lambda frame: frame
    elif what == "raises":
        rig.locate_error = ZeroDivisionError("a bug")
    elif what == "works":
        rig.locate_error = None
    elif what == "late":
        rig.clock.sleep_until(rig.clock.now_s() + 0.7)
    else:
        name, kind = what.split()
        rig.press(Button(name), PressKind(kind))


STEPS = [
    "bar", "attic", "clear", "pause", "resume", "repeat", "sure", "uncertain", "lost", "there", "blind", "sees",
    "raises", "works", "late", *(f"{button.value} {kind.value}" for button in Button for kind in PressKind),
]  # fmt: skip


@settings(max_examples=25, deadline=None)
@given(st.lists(st.tuples(st.sampled_from(STEPS), st.integers(1, 12)), min_size=3, max_size=12))
def test_nobody_is_sent_walking_but_while_they_are_guided(steps: list[tuple[str, int]]) -> None:
    rig = Rig()
    rig.lead_to()
    for what, count in steps:
        step(rig, what)
        for _ in range(count):
            (cycle,) = rig.cycles(1)
            mode = rig.uplink.states[-1].mode
            sent = cycle.guidance.action is Action.WALK or any(cue.kind in SENDING for cue in cycle.cues)
            assert not sent or mode is Mode.GUIDING
            assert may_be_told(mode, cycle.guidance.action)
            assert "is not told in the state" not in cycle.guidance.trace.rule, "the last net has nothing to catch"


def test_states_reach_the_console_as_they_change() -> None:
    rig = Rig()
    rig.pose = None
    rig.cycles(1)
    rig.pose = pose_at(18.5)
    rig.cycles(1)
    rig.lead_to()
    rig.pose = None
    rig.cycles(40)
    rig.pose = pose_at(18.5)
    rig.cycles(10)
    rig.agent.submit(Pause())
    rig.cycles(1)
    rig.spoil = lambda frame: SensorError("no picture")
    rig.cycles(1)
    rig.spoil = lambda frame: frame
    rig.cycles(20)
    rig.agent.submit(Resume())
    rig.cycles(6)
    rig.pose = pose_at(19.8)
    rig.cycles(3)
    seen = [mode for mode, _ in itertools.groupby(state.mode for state in rig.uplink.states)]
    assert seen == [
        Mode.LOCALIZING, Mode.READY, Mode.GUIDING, Mode.LOST, Mode.GUIDING, Mode.PAUSED, Mode.FAULT, Mode.PAUSED,
        Mode.GUIDING, Mode.ARRIVED,
    ]  # fmt: skip


def test_off_duty_nobody_is_located_and_no_picture_leaves_the_device() -> None:
    rig = Rig()
    rig.cycles(2)
    assert rig.press(Button.MAIN, PressKind.LONG) == ["Off duty."]
    rig.locate_error = AssertionError("off duty nobody is located")
    images = len(rig.uplink.depth_images)
    rig.cycles(5)
    assert len(rig.uplink.depth_images) == images
    assert rig.uplink.states[-1].pose is None
    rig.agent.submit(SetDestination("bar"))
    rig.cycles(20)
    assert rig.output.cues[-1].text == "You are off duty. Press the main button to go on duty."
    assert rig.messages(RouteChanged)[-1].refusal == Mode.OFF_DUTY.sentence
    rig.locate_error = None
    assert rig.press(Button.MAIN)[0] == "On duty. Looking for your position."
    rig.cycles(40)
    assert rig.output.cues[-1].text == "Ready."
    assert rig.agent.state.mode is Mode.READY


def test_no_graph_and_no_map_is_taken_while_a_map_is_recorded() -> None:
    from device_agent.orders import at_rest

    waiting = state_in(Mode.MAPPING, waiting_graph=GRAPH)
    assert at_rest(waiting) == (waiting, ())


def test_the_page_of_the_docs_is_current_and_names_everything() -> None:
    page = subprocess.run(
        [sys.executable, "-m", "device_agent", "states", "--markdown"], capture_output=True, text=True, check=True
    ).stdout
    assert page == (Path(__file__).parent.parent / "docs" / "states.md").read_text(encoding="utf-8")
    for mode in Mode:
        assert page.count(mode.value) >= 4, mode
        assert mode.label in page
    for event in StateEvent:
        assert page.count(event.value) >= 2, event
    for language in ("en", "zh"):
        assert all(text in page for key, text in TEXTS[language].items() if key.startswith("refused_"))

"""The table of states against one statement of where each event leads, and of what is refused."""

from __future__ import annotations

import pytest

from device_agent.states import STATES, StateEvent, answer, may_be_told
from navcore.modes import Mode
from navcore.types import Action

MAY_BE_TOLD = {
    Mode.GUIDING: {Action.WALK, Action.TURN, Action.STOP},
    # Who looks round for a known place turns on the spot.
    Mode.LOST: {Action.TURN, Action.STOP},
}
"""In every other state whoever is there stands."""
UNLED = "off duty: off_duty, destination: guiding, map walk begun: mapping, map walk ordered: mapping, failed: fault"
LEADS_TO = {
    Mode.OFF_DUTY: "on duty: localizing, map walk begun: mapping",
    Mode.MAPPING: "stop: localizing, map walk ended: localizing, map walk failed: localizing, failed: fault",
    Mode.LOCALIZING: f"{UNLED}, position found: ready",
    Mode.READY: f"{UNLED}, position lost: localizing",
    Mode.ARRIVED: f"{UNLED}, stop: ready",
    Mode.GUIDING: "destination: guiding, stop: ready, pause: paused, no way: ready, destination reached: arrived,"
                  " position lost: lost, failed: fault",
    Mode.PAUSED: "destination: guiding, stop: ready, resume: guiding, failed: fault",
    Mode.LOST: "destination: lost, stop: localizing, pause: paused, no way: ready, position found: guiding,"
               " failed: fault",
}  # fmt: skip
"""All else leaves the state as it is."""
UNLED_REFUSE = "on duty, on duty without a map, pause, resume, place marked, map walk ended"
LED_REFUSE = "on duty, on duty without a map, off duty, map walk begun, map walk ordered, place marked, map walk ended"
REFUSES = {
    Mode.OFF_DUTY: "on duty without a map, off duty, destination, stop, pause, resume, where am I, place marked,"
                   " map walk ended, map walk ordered",
    Mode.MAPPING: "on duty, on duty without a map, off duty, destination, pause, resume, where am I, map walk begun,"
                  " map walk ordered",
    Mode.LOCALIZING: f"{UNLED_REFUSE}, stop", Mode.READY: f"{UNLED_REFUSE}, stop", Mode.ARRIVED: UNLED_REFUSE,
    Mode.GUIDING: f"{LED_REFUSE}, resume", Mode.PAUSED: f"{LED_REFUSE}, pause", Mode.LOST: f"{LED_REFUSE}, resume",
}  # fmt: skip


def _after(mode: Mode, event: StateEvent) -> Mode:
    found = dict(each.strip().split(": ") for each in LEADS_TO[mode].split(","))
    return Mode(found.get(event.value, mode))


@pytest.mark.parametrize("mode", LEADS_TO)
def test_each_event_leads_where_it_should(mode: Mode) -> None:
    for event in StateEvent:
        found = answer(mode, None, event)
        assert found.mode is _after(mode, event), event
        assert found.beneath is (mode if found.mode is Mode.FAULT else None), event


@pytest.mark.parametrize("mode", REFUSES)
def test_what_is_refused(mode: Mode) -> None:
    refused = {event.value for event, line in STATES[mode].answers.items() if line.refused}
    assert refused == {each.strip() for each in REFUSES[mode].split(",")}
    assert all(line.says for line in STATES[mode].answers.values() if line.refused), "and it is said why"


@pytest.mark.parametrize("beneath", [None, *(mode for mode in LEADS_TO if mode is not Mode.OFF_DUTY)])
def test_a_fault_lies_over_a_state_until_all_is_well_or_somebody_goes_off_duty(beneath: Mode | None) -> None:
    under = beneath or Mode.LOCALIZING
    for event in StateEvent:
        found = answer(Mode.FAULT, beneath, event)
        if event is StateEvent.RECOVERED:
            assert (found.mode, found.beneath) == (under, None)
        elif event is StateEvent.OFF_DUTY:
            assert (found.mode, found.beneath) == (Mode.OFF_DUTY, None)
        elif event is StateEvent.FAILED:
            assert (found.mode, found.beneath) == (Mode.FAULT, under)
        else:
            assert (found.mode, found.beneath) == (Mode.FAULT, _after(under, event)), event
            assert found.transition == STATES[under].answers[event]


@pytest.mark.parametrize("mode", Mode)
def test_what_may_be_told(mode: Mode) -> None:
    assert {action for action in Action if may_be_told(mode, action)} == MAY_BE_TOLD.get(mode, {Action.STOP})

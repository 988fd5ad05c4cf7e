"""Somebody at the console leads the walker elsewhere: the walker hears who, and can keep what they had. Pure."""

from __future__ import annotations

from dataclasses import replace

from device_agent.state import DeviceState, Happened, Overridden, Step
from device_agent.states import StateEvent
from device_agent.transitions import By, happen
from navcore.modes import Mode
from navcore.wire import SetDestination

REFUSE_WITHIN_S = 30.0
"""So long after the order the walker can refuse it with one press; *stop* is theirs at any time."""


def led_by(state: DeviceState, order: SetDestination, now_s: float) -> Step:
    """Lead to where somebody at the console wants the walker to go, and remember what that took the place of."""
    aim_id, aim_by, overridden = state.aim_id, state.aim_by, state.overridden
    was_paused = state.purpose is Mode.PAUSED
    state, effects = happen(state, StateEvent.DESTINATION, now_s, poi_id=order.poi_id, by=By.CONSOLE, who=order.who)
    if state.wanted_id != order.poi_id:
        return state, effects
    if aim_id == order.poi_id:
        # The same order again takes nothing from them: the press that they were told of holds as long as it did.
        return replace(state, aim_by=aim_by, overridden=overridden), effects
    if aim_id is None:
        # Nothing was taken from them, and no press is told of: holding *main* ends it, the others mean what they do.
        return state, effects
    state = replace(state, overridden=Overridden(aim_id, aim_by, was_paused, now_s + REFUSE_WITHIN_S))
    chosen_by = aim_by or "the walker"
    text = f"Instead of {state.place_name(aim_id)}, which {chosen_by} had chosen: {state.place_name(order.poi_id)}."
    return state, (*effects, Happened("mode", text))


def can_refuse(state: DeviceState, now_s: float) -> bool:
    """Whether the walker can still keep with one press what somebody has led them away from."""
    return state.leading and state.overridden is not None and now_s <= state.overridden.until_s


def refused(state: DeviceState, now_s: float) -> Step:
    """The walker keeps what they had before; call it only where they can refuse."""
    kept = state.overridden
    assert kept is not None, "there is something to refuse"
    happened = Happened("button", f"The walker refuses to be led to {state.place_name(state.aim_id)}.")
    state, effects = happen(state, StateEvent.DESTINATION, now_s, poi_id=kept.poi_id, by=By.WALKER)
    state = replace(state, aim_by=kept.by)
    if kept.was_paused:
        state, paused = happen(state, StateEvent.PAUSE, now_s, by=By.WALKER)
        effects = (*effects, *paused)
    return state, (happened, *effects)

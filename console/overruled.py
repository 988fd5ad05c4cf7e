"""What a walker has heard since the loop of their device decided last: the watchdog's own *Stop*. Pure.

The watchdog speaks where no decision comes, so no state tells of it; its event does.
"""

from __future__ import annotations

from collections.abc import Sequence

from msgspec.structs import replace

from console.live import STALE_AFTER_S
from navcore.types import Action, Reason, Rule
from navcore.wire import GUIDANCE_IS_FRESH, Event, WalkerState
from navcore.wire_trace import DecisionTraceView


def as_heard(state: WalkerState, events: Sequence[Event]) -> WalkerState:
    """Return a state as the walker knows it: *Stop*, where the watchdog has told them so since it was decided.

    Only within the time after which a state is stale anyway: a device that was started anew counts its time anew, and
    events of before would seem to be later than every state.
    """
    last = next((event for event in reversed(events) if event.kind == "watchdog"), None)
    if last is None or last.text == GUIDANCE_IS_FRESH or state.action == Action.STOP.value:
        return state
    if not 0.0 < last.stamp_s - state.stamp_s <= STALE_AFTER_S:
        return state
    trace = replace(state.trace or DecisionTraceView(), decided=Rule.WATCHDOG.value, turn=None)
    return replace(
        state,
        action=Action.STOP.value,
        direction_rad=None,
        reason=Reason.SENSOR_STALE.value,
        rule=last.text,
        trace=trace,
    )

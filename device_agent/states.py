"""The state machine of the device: one table of states, events and actions. Data, and the function that reads it.

Every event is answered in every state: the device goes to another state, stays, or refuses and says why. The page
``docs/states.md`` is made from this table (``vbr states --markdown``); what the actions do is in
:mod:`device_agent.transitions`.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass

from navcore.modes import Mode
from navcore.types import Action


class StateEvent(enum.Enum):
    """What can happen; the value is its name for people."""

    ON_DUTY = "on duty"
    ON_DUTY_WITHOUT_MAP = "on duty without a map"
    OFF_DUTY = "off duty"
    DESTINATION = "destination"
    STOP = "stop"
    PAUSE = "pause"
    RESUME = "resume"
    REPEAT = "repeat"
    WHERE = "where am I"
    MAP_BEGUN = "map walk begun"
    MAP_ORDERED = "map walk ordered"
    MARK = "place marked"
    MAP_ENDED = "map walk ended"
    MAP_FAILED = "map walk failed"
    POSE_FOUND = "position found"
    POSE_LOST = "position lost"
    ARRIVED = "destination reached"
    NO_WAY = "no way"
    FAILED = "failed"
    RECOVERED = "recovered"


EVENT_SOURCES: dict[StateEvent, str] = {
    StateEvent.ON_DUTY: "button",
    StateEvent.ON_DUTY_WITHOUT_MAP: "the same button, while there is no map in which a position could be looked for",
    StateEvent.OFF_DUTY: "button",
    StateEvent.DESTINATION: "button, or console (SetDestination), or `vbr device --to`",
    StateEvent.STOP: "button, or console (ClearDestination)",
    StateEvent.PAUSE: "button, or console (Pause)",
    StateEvent.RESUME: "button, or console (Resume)",
    StateEvent.REPEAT: "button, or console (Repeat)",
    StateEvent.WHERE: "button",
    StateEvent.MAP_BEGUN: "button: *next*, after a map walk was offered",
    StateEvent.MAP_ORDERED: "console (BeginMapWalk)",
    StateEvent.MARK: "button",
    StateEvent.MAP_ENDED: "console (EndMapWalk); *stop* ends a map walk as well",
    StateEvent.MAP_FAILED: "recording: the disk is full, or takes nothing",
    StateEvent.POSE_FOUND: "localization is sure; of whoever is led: guidance knows again where they are",
    StateEvent.POSE_LOST: "localization is lost; of whoever is led: guidance holds them, not knowing where they are",
    StateEvent.ARRIVED: "guidance: the destination is near (Eq. 2, case 3)",
    StateEvent.NO_WAY: "planning: no way leads to the destination, and nobody is on another way yet",
    StateEvent.FAILED: "no picture, an exception in the loop, a decision too late to walk by, or the watchdog's *Stop*",
    StateEvent.RECOVERED: "nothing of that for a second",
}
"""What causes each event."""

WISHES = frozenset(
    {
        StateEvent.ON_DUTY, StateEvent.ON_DUTY_WITHOUT_MAP, StateEvent.OFF_DUTY, StateEvent.DESTINATION,
        StateEvent.STOP, StateEvent.PAUSE, StateEvent.RESUME, StateEvent.REPEAT, StateEvent.WHERE,
        StateEvent.MAP_BEGUN, StateEvent.MAP_ORDERED, StateEvent.MARK, StateEvent.MAP_ENDED,
    }
)  # fmt: skip
"""What a person asks for: only this is ever refused. The other events are findings."""


class StateAction(enum.Enum):
    """What is done on the way from one state to another; the value says it in words."""

    NOTHING = ""
    LOOK = "forget what was seen before, and say *Ready* once the position is known"
    SET_OUT = "look for the way to the destination"
    CHANGE_WAY = "look for the way to the new destination; lead on along the old one until there is one"
    GO_ON = "look for the way from here to the same destination"
    END_WAY = "forget destination and route"
    ARRIVE = "forget the route"
    SAY_READY = "say *Ready*, where that was promised"
    REPEAT = "say the last sentence again, where it is still true; else say the state"
    TELL_WHERE = "say where the walker is"
    BEGIN_MAP = "forget destination and route, and what was seen before; record from now on"
    MARK = "note the place with the next number"


@dataclass(frozen=True, slots=True)
class Transition:
    """The answer of one state to one event."""

    to: Mode | None = None
    """The next state; None stays."""
    action: StateAction = StateAction.NOTHING
    says: str = ""
    """Key of :data:`navcore.cues.texts.TEXTS` that the walker hears; guidance itself says stops, turns and walks."""
    refused: bool = False
    beneath: bool = False
    """Answered as in the state before the fault, which then changes beneath it."""
    back: bool = False
    """Leads to the state beneath the fault."""


@dataclass(frozen=True, slots=True)
class StateEntry:
    """One state: what may be told in it, and its answer to every event."""

    allows: frozenset[Action]
    """What guidance may tell the walker's feet."""
    answers: dict[StateEvent, Transition]


_STAY, _BENEATH = Transition(), Transition(beneath=True)
_STANDS, _LOOKS_ROUND = frozenset({Action.STOP}), frozenset({Action.STOP, Action.TURN})
_FINDINGS = [event for event in StateEvent if event not in WISHES]


def _all(transition: Transition, *events: StateEvent) -> dict[StateEvent, Transition]:
    return dict.fromkeys(events, transition)


def _refusals(**events_by_key: tuple[StateEvent, ...]) -> dict[StateEvent, Transition]:
    """Return refusals, by the text that gives the reason."""
    return {
        event: Transition(says=f"refused_{key}", refused=True)
        for key, events in events_by_key.items()
        for event in events
    }


_STAY_IN_ALL = _all(_STAY, *_FINDINGS)
_FAILS = {StateEvent.FAILED: Transition(Mode.FAULT)}
_REPEATS = {StateEvent.REPEAT: Transition(action=StateAction.REPEAT)}
_TELLS = _REPEATS | {StateEvent.WHERE: Transition(action=StateAction.TELL_WHERE)}

_NOBODY_LED = (
    _STAY_IN_ALL | _FAILS | _TELLS
    | _refusals(
        on_duty=(StateEvent.ON_DUTY, StateEvent.ON_DUTY_WITHOUT_MAP),
        not_led=(StateEvent.STOP, StateEvent.PAUSE, StateEvent.RESUME),
        no_map_walk=(StateEvent.MARK, StateEvent.MAP_ENDED),
    )
    | {
        StateEvent.OFF_DUTY: Transition(Mode.OFF_DUTY, StateAction.END_WAY, "off_duty"),
        StateEvent.DESTINATION: Transition(Mode.GUIDING, StateAction.SET_OUT, "destination"),
        StateEvent.MAP_BEGUN: Transition(Mode.MAPPING, StateAction.BEGIN_MAP, "map_begun"),
        StateEvent.MAP_ORDERED: Transition(Mode.MAPPING, StateAction.BEGIN_MAP, "map_begun"),
    }
)  # fmt: skip
_LED = (
    _STAY_IN_ALL | _FAILS | _TELLS
    | _refusals(
        on_duty=(StateEvent.ON_DUTY, StateEvent.ON_DUTY_WITHOUT_MAP),
        led=(StateEvent.OFF_DUTY, StateEvent.MAP_BEGUN, StateEvent.MAP_ORDERED),
        not_paused=(StateEvent.RESUME,),
        no_map_walk=(StateEvent.MARK, StateEvent.MAP_ENDED),
    )
    | {StateEvent.PAUSE: Transition(Mode.PAUSED)}
)  # fmt: skip

STATES: dict[Mode, StateEntry] = {
    Mode.OFF_DUTY: StateEntry(
        _STANDS,
        _STAY_IN_ALL | _REPEATS
        | _refusals(
            off_duty=(
                StateEvent.OFF_DUTY, StateEvent.DESTINATION, StateEvent.STOP, StateEvent.PAUSE, StateEvent.RESUME,
                StateEvent.WHERE, StateEvent.MARK, StateEvent.MAP_ENDED,
                # Off duty nothing of what the camera sees leaves the device, unless whoever wears it wants it.
                StateEvent.MAP_ORDERED,
            ),
            no_map=(StateEvent.ON_DUTY_WITHOUT_MAP,),
        )
        | {
            StateEvent.ON_DUTY: Transition(Mode.LOCALIZING, StateAction.LOOK, "on_duty"),
            StateEvent.MAP_BEGUN: Transition(Mode.MAPPING, StateAction.BEGIN_MAP, "map_begun"),
        },
    ),
    Mode.MAPPING: StateEntry(
        _STANDS,
        _STAY_IN_ALL | _FAILS | _REPEATS
        | _refusals(
            mapping=(
                StateEvent.ON_DUTY, StateEvent.ON_DUTY_WITHOUT_MAP, StateEvent.OFF_DUTY, StateEvent.DESTINATION,
                StateEvent.PAUSE, StateEvent.RESUME, StateEvent.WHERE, StateEvent.MAP_BEGUN, StateEvent.MAP_ORDERED,
            ),
        )
        | {
            StateEvent.STOP: Transition(Mode.LOCALIZING, StateAction.LOOK, "map_ended"),
            StateEvent.MAP_ENDED: Transition(Mode.LOCALIZING, StateAction.LOOK, "map_ended"),
            StateEvent.MAP_FAILED: Transition(Mode.LOCALIZING, StateAction.LOOK),
            StateEvent.MARK: Transition(action=StateAction.MARK),
        },
    ),
    Mode.LOCALIZING: StateEntry(
        _STANDS, _NOBODY_LED | {StateEvent.POSE_FOUND: Transition(Mode.READY, StateAction.SAY_READY)}
    ),
    Mode.READY: StateEntry(_STANDS, _NOBODY_LED | {StateEvent.POSE_LOST: Transition(Mode.LOCALIZING)}),
    Mode.GUIDING: StateEntry(
        frozenset(Action),
        _LED
        | {
            StateEvent.DESTINATION: Transition(Mode.GUIDING, StateAction.CHANGE_WAY, "destination"),
            StateEvent.STOP: Transition(Mode.READY, StateAction.END_WAY),
            StateEvent.NO_WAY: Transition(Mode.READY, StateAction.END_WAY),
            StateEvent.ARRIVED: Transition(Mode.ARRIVED, StateAction.ARRIVE),
            StateEvent.POSE_LOST: Transition(Mode.LOST),
        },
    ),
    Mode.PAUSED: StateEntry(
        _STANDS,
        _LED
        | _refusals(paused=(StateEvent.PAUSE,))
        | {
            # Whoever stands is not led on along the old way where there is no new one.
            StateEvent.DESTINATION: Transition(Mode.GUIDING, StateAction.SET_OUT, "destination"),
            StateEvent.RESUME: Transition(Mode.GUIDING, StateAction.GO_ON),
            StateEvent.STOP: Transition(Mode.READY, StateAction.END_WAY),
        },
    ),
    Mode.LOST: StateEntry(
        _LOOKS_ROUND,
        _LED
        | {
            StateEvent.DESTINATION: Transition(Mode.LOST, StateAction.CHANGE_WAY, "destination"),
            StateEvent.STOP: Transition(Mode.LOCALIZING, StateAction.END_WAY),
            StateEvent.NO_WAY: Transition(Mode.READY, StateAction.END_WAY),
            StateEvent.POSE_FOUND: Transition(Mode.GUIDING),
        },
    ),
    Mode.ARRIVED: StateEntry(_STANDS, _NOBODY_LED | {StateEvent.STOP: Transition(Mode.READY, StateAction.END_WAY)}),
    Mode.FAULT: StateEntry(
        _STANDS,
        _all(_BENEATH, *StateEvent)
        | {
            # Whoever wants to go off duty need not wait for a camera that may never come back.
            StateEvent.OFF_DUTY: Transition(Mode.OFF_DUTY, StateAction.END_WAY, "off_duty"),
            StateEvent.FAILED: _STAY,
            StateEvent.RECOVERED: Transition(back=True),
        },
    ),
}  # fmt: skip
"""The table."""


@dataclass(frozen=True, slots=True)
class Answer:
    """What becomes of an event."""

    mode: Mode
    beneath: Mode | None
    """The state that a fault lies over, and leads back to; None where there is no fault."""
    transition: Transition
    """The line of the table that decided it: that of the state beneath, where a fault passes the event on."""


def answer(mode: Mode, beneath: Mode | None, event: StateEvent) -> Answer:
    """Return the table's answer to an event; ``beneath`` is None but in a fault."""
    found = STATES[mode].answers[event]
    under = beneath or Mode.LOCALIZING
    if found.beneath:
        found = STATES[under].answers[event]
        return Answer(mode, found.to or under, found)
    if found.back:
        return Answer(under, None, found)
    after = found.to or mode
    if after is Mode.FAULT:
        # A fault never lies over a fault: it would lead back to itself.
        return Answer(after, under if mode is Mode.FAULT else mode, found)
    return Answer(after, None, found)


def may_be_told(mode: Mode, action: Action) -> bool:
    """Return whether guidance may tell the walker this in a state."""
    return action in STATES[mode].allows

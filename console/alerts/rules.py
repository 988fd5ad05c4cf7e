"""What is worth an alert: one table of rules, and what each says of a device at one instant.

The practice is that of alarm management in plants (ISA-18.2, IEC 62682): each alert asks somebody for something, has a
priority, comes after a delay, goes after another, and has a deadband, so that what trembles about a limit is told once.
What is not known is neither: it raises nothing, and ends nothing. That nothing is known of somebody who is being led is
an alert of its own.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal

from console.live import STALE_AFTER_S, Freshness, LiveDevice
from console.live_panel import reason_sentence
from navcore.modes import Mode
from navcore.sonar_gap import sonar_gap_m
from navcore.types import Reason
from navcore.wire import WalkerState

AlertKind = Literal[
    "fall_suspected", "link_lost", "device_fault", "battery_empty", "position_lost", "no_way", "off_road", "stalled",
    "battery_low", "too_hot", "sensors_disagree", "sonar_silent", "broke_off",
]  # fmt: skip


class Priority(enum.IntEnum):
    """How soon somebody must act."""

    LOW = 1
    """Know it; act within the walk."""
    MEDIUM = 2
    """Act within minutes."""
    HIGH = 3
    """Act now: somebody may be in danger, or nothing is known of them."""

    @property
    def word(self) -> str:
        """The priority as it is written."""
        return self.name.lower()


class Verdict(enum.Enum):
    """What is known of a condition."""

    HOLDS = "holds"
    NORMAL = "normal"
    UNKNOWN = "unknown"


@dataclass(frozen=True, slots=True)
class Observation:
    """What the console knows of a device at an instant, as the rules need it."""

    state: WalkerState | None
    """What the device said last; None where that is no longer believed to be now."""
    silent_s: float
    """So long ago, at the most, is what the device said last."""
    was_led: bool
    """Somebody was being led when the device was heard of last."""
    broke_off: bool = False
    """Guidance ended before the destination, nobody is known to have ended it, and nobody has seen this yet."""


@dataclass(frozen=True, slots=True)
class Quantity:
    """Something that is measured, with the two limits of a deadband."""

    name: str
    unit: str
    raise_at: float
    clear_at: float
    """On the good side of ``raise_at``; in between, what was stays."""
    measure: Callable[[Observation], float | None]
    """None where it is not known."""

    def is_beyond(self, value: float, limit: float) -> bool:
        """Say whether a value is at a limit, or on its bad side."""
        return value >= limit if self.raise_at > self.clear_at else value <= limit

    @property
    def side(self) -> str:
        """``≥`` or ``≤``: on which side it is bad."""
        return "≥" if self.raise_at > self.clear_at else "≤"


@dataclass(frozen=True, slots=True)
class Rule:
    """One kind of alert."""

    kind: AlertKind
    title: str
    priority: Priority
    when: Callable[[Observation], bool]
    """Only then can it hold; without quantities, this is the condition."""
    when_words: str
    on_delay_s: float
    """It must hold so long before the alert is raised."""
    off_delay_s: float
    """It must be known to be normal so long before the alert has returned."""
    sentence: str
    """With ``{name}`` of the device, ``{what}`` is measured and its ``{value}``, and guidance's ``{reason}``."""
    advice: str
    """What to do."""
    quantities: tuple[Quantity, ...] = ()
    """One beyond its limit is enough; all must be known, and within theirs, for it to end."""
    escalate_after_s: float | None = None
    """Unacknowledged for so long, the priority goes up one step, once."""
    needs_state: bool = True
    """It is unknown while nothing fresh has come from the device."""


@dataclass(frozen=True, slots=True)
class Finding:
    """What a rule says."""

    verdict: Verdict
    what: str = ""
    """The quantity that makes it hold."""
    value: str = ""
    """Its figure, with the unit."""


# ------------------------------------------------------------------------------------------------- what is looked at
_STOPS_OF_THEIR_OWN = frozenset({Reason.ARRIVED, Reason.PAUSED, Reason.NO_ROUTE, Reason.POSE_LOST})
"""Stops that are meant, or that another rule tells."""
_FAILURES = frozenset({Reason.SENSOR_STALE, Reason.DEPTH_INVALID, Reason.CAMERA_MOVED})
"""Reasons of guidance that say why a device fails; whatever else it says then, it said before."""
_GAP_M = 1.0
_DIGITS = {"%": 0, "°C": 0, "s": 0, "m/s": 2}


def observe(device: LiveDevice | None, now_s: float, heard_s: float, was_led: bool) -> Observation:
    """Return what is known of a device (None: it has not called since the console started).

    ``heard_s`` is when what it said last was true, on the clock of ``now_s``; ``was_led`` is what it said then.
    """
    fresh = device is not None and device.freshness(now_s) in (Freshness.LIVE, Freshness.DELAYED)
    state = device.state if fresh and device is not None else None
    return Observation(state, max(0.0, now_s - heard_s), was_led if state is None else state.leads_somebody)


def judge(rule: Rule, seen: Observation, was_holding: bool) -> Finding:
    """Say whether the condition of a rule holds; ``was_holding`` is what was said of it last."""
    if rule.needs_state and seen.state is None:
        return Finding(Verdict.UNKNOWN)
    if not rule.when(seen):
        return Finding(Verdict.NORMAL)
    if not rule.quantities:
        return Finding(Verdict.HOLDS)
    measured = [(quantity, quantity.measure(seen)) for quantity in rule.quantities]
    known = [(quantity, value) for quantity, value in measured if value is not None and not math.isnan(value)]
    for quantity, value in known:
        if quantity.is_beyond(value, quantity.clear_at if was_holding else quantity.raise_at):
            return Finding(Verdict.HOLDS, quantity.name, _figure(value, quantity.unit))
    is_normal = len(known) == len(measured) if was_holding else bool(known)
    return Finding(Verdict.NORMAL if is_normal else Verdict.UNKNOWN)


def _figure(value: float, unit: str) -> str:
    return f"{value:.0f}{unit}" if unit == "°" else f"{value:.{_DIGITS.get(unit, 1)}f} {unit}"


def sentence_of(rule: Rule, finding: Finding, seen: Observation, name: str) -> str:
    """Return what is wrong, with its figures."""
    reason = "" if seen.state is None else reason_sentence(seen.state.reason)
    if _has_failed(seen) and seen.state is not None and _reason(seen.state) not in _FAILURES:
        reason = "its own log says why."
    return rule.sentence.format(name=name, what=finding.what, value=finding.value, reason=reason)


def _reason(state: WalkerState) -> Reason | None:
    try:
        return Reason(state.reason)
    except ValueError:
        return None


def _of_state(
    field: Literal["eye_m", "battery_percent", "temperature_c", "deviation_m", "speed_m_s"],
) -> Callable[[Observation], float | None]:
    """Return what reads a figure of the state; None where the device does not tell it."""
    return lambda seen: None if seen.state is None else getattr(seen.state, field)


def _tilt_deg(seen: Observation) -> float | None:
    tilt_rad = None if seen.state is None else seen.state.tilt_rad
    return None if tilt_rad is None else math.degrees(abs(tilt_rad))


def _sonar_gap_m(seen: Observation) -> float | None:
    """How much farther the depth camera sees free than the rangefinder hears something."""
    state = seen.state
    if state is None:
        return None
    gap_m = sonar_gap_m(state.sonar_state, state.sonar_m, state.nearest_ahead_m, state.reason)
    is_heard = state.sonar_state == "ok" and state.sonar_m is not None
    if gap_m is None or not is_heard:
        return gap_m
    # What was only heard is remembered, and closes the way like what was seen: the device says where that decided.
    return max(gap_m, _GAP_M if _reason(state) is Reason.OBSTACLE_SONAR else 0.0)


def _is_worn(seen: Observation) -> bool:
    return seen.state is not None and seen.state.mode not in (Mode.OFF_DUTY, Mode.MAPPING)


def _is_worn_unplugged(seen: Observation) -> bool:
    return _is_worn(seen) and seen.state is not None and not seen.state.is_charging


def _is_guiding(seen: Observation) -> bool:
    return seen.state is not None and seen.state.mode is Mode.GUIDING


def _is_held_up(seen: Observation) -> bool:
    state = seen.state
    if state is None or not _is_guiding(seen) or state.action != "stop":
        return False
    return _reason(state) not in _STOPS_OF_THEIR_OWN


def _is_led_without_sonar(seen: Observation) -> bool:
    return _is_guiding(seen) and seen.state is not None and seen.state.sonar_state in ("stale", "absent")


def _is_to_walk(seen: Observation) -> bool:
    return _is_guiding(seen) and seen.state is not None and seen.state.action == "walk"


def _is_lost(seen: Observation) -> bool:
    state = seen.state
    return state is not None and seen.was_led and (state.mode is Mode.LOST or state.quality == "lost")


def _has_failed(seen: Observation) -> bool:
    return seen.state is not None and seen.state.mode is Mode.FAULT


def _is_always(seen: Observation) -> bool:
    return True


# --------------------------------------------------------------------------------------------------------- the table
_TABLE = (
    Rule(
        "fall_suspected", "Fall suspected", Priority.HIGH, _is_worn, "the glasses are worn on duty", 3.0, 5.0,
        "{name} may have fallen: {what} {value}.",
        "Speak to the walker now. Where nobody answers, send help to the place that the map shows.",
        (
            Quantity("eyes above the floor", "m", 0.8, 1.0, _of_state("eye_m")),
            Quantity("tilt of the head", "°", 65.0, 50.0, _tilt_deg),
        ),
    ),
    Rule(
        "link_lost", "Nothing heard while leading", Priority.HIGH, lambda seen: seen.was_led,
        "somebody was being led when the device was heard of last", 0.0, 3.0,
        "Nothing new from {name} for {value}, and somebody was being led.",
        "It is not known whether guidance goes on. Call the walker by telephone, or go there.",
        (Quantity("age of what was heard last", "s", STALE_AFTER_S, 2.0, lambda seen: seen.silent_s),),
        needs_state=False,
    ),
    Rule(
        "broke_off", "Guidance broke off", Priority.HIGH, lambda seen: seen.broke_off,
        "somebody was being led and is no more: not arrived, and nobody has ended it; until somebody has seen it", 3.0,
        1.0, "{name} leads the walker no more: they have not arrived, and nobody has ended it.",
        "The device may have started anew. Speak to the walker, and set the destination again or send somebody.",
        needs_state=False,
    ),
    Rule(
        "device_fault", "The device has failed", Priority.HIGH, _has_failed, "the device is in the state *fault*", 2.0,
        3.0, "{name} has stopped the walker: {reason}",
        "Tell the walker to stay where they are, and have somebody with them before they go on.",
    ),
    Rule(
        "battery_empty", "Battery nearly empty", Priority.HIGH, _is_worn_unplugged,
        "the glasses are worn on duty, and not charged", 5.0, 10.0, "The battery of {name} is at {value}.",
        "Lead the walker to the nearest place to sit, and have the glasses charged.",
        (Quantity("battery", "%", 8.0, 12.0, _of_state("battery_percent")),),
    ),
    Rule(
        "position_lost", "Position lost", Priority.MEDIUM, _is_lost, "somebody is being led, and the position is lost",
        5.0, 2.0, "{name} does not know where the walker is. {reason}",
        "The walker turns to look round. Where that does not help, ask them to walk back a few steps with somebody.",
        escalate_after_s=60.0,
    ),
    Rule(
        "no_way", "No way on", Priority.MEDIUM, _is_held_up,
        "guiding, and told to stand: not arrived, not paused, and the place is known", 10.0, 2.0,
        "No way on for {name}. {reason}",
        "Look at the depth picture. Tell the walker what is there or what to do, or choose another destination.",
        escalate_after_s=120.0,
    ),
    Rule(
        "off_road", "Off the road", Priority.MEDIUM, _is_guiding, "guiding", 3.0, 2.0,
        "{name} is {value} off the road.",
        "Watch whether the walker is led back. Where they are not, pause guidance and speak to them.",
        (Quantity("deviation", "m", 1.5, 1.0, _of_state("deviation_m")),),
        escalate_after_s=120.0,
    ),
    Rule(
        "stalled", "Stalled", Priority.MEDIUM, _is_to_walk, "guiding, and told to walk", 15.0, 2.0,
        "{name} is told to walk, and moves at {value}.",
        "Ask the walker what holds them up; have the last sentence said again.",
        (Quantity("speed", "m/s", 0.1, 0.25, _of_state("speed_m_s")),),
        escalate_after_s=120.0,
    ),
    Rule(
        "battery_low", "Battery low", Priority.LOW, _is_worn_unplugged,
        "the glasses are worn on duty, and not charged", 10.0, 10.0, "The battery of {name} is at {value}.",
        "See that the walk ends before the battery does: about a fifth is left.",
        (Quantity("battery", "%", 20.0, 25.0, _of_state("battery_percent")),),
        escalate_after_s=600.0,
    ),
    Rule(
        "too_hot", "Too hot", Priority.LOW, _is_always, "whenever the device tells it", 10.0, 10.0,
        "{name} is at {value}.",
        "Let the walker rest, out of the sun. A hot device gets slow, and one that is too slow stops the walker.",
        (Quantity("temperature", "°C", 80.0, 72.0, _of_state("temperature_c")),),
        escalate_after_s=600.0,
    ),
    Rule(
        "sensors_disagree", "Sonar and depth disagree", Priority.LOW, _is_guiding, "guiding", 2.0, 3.0,
        "{name}: the sonar hears something {value} nearer than the depth camera sees: glass?",
        "The device stops for it. Tell the walker what is there, and mark it on the map with a caution.",
        (Quantity("sonar nearer than depth by", "m", _GAP_M, 0.5, _sonar_gap_m),),
    ),
    Rule(
        "sonar_silent", "Sonar silent", Priority.LOW, _is_led_without_sonar,
        "guiding, and nothing comes from the ultrasonic rangefinder", 10.0, 5.0,
        "{name} leads by the depth camera alone: nothing comes from the sonar, and glass is seen by nothing else.",
        "The walker has been told. Lead them where there is no glass, and have the sonar's plug looked at.",
        escalate_after_s=600.0,
    ),
)  # fmt: skip
RULES: Mapping[AlertKind, Rule] = MappingProxyType({rule.kind: rule for rule in _TABLE})
"""Every kind of alert, the most urgent first."""

"""Why the walker is told what they are told: one sentence of any state, and the steps that led to it. Pure functions.

The sentence is made from what the console is told (``navcore.wire.WalkerState``), so that live, past and replayed
decisions are explained alike. It begins with what the walker is to do, and calls nothing free that has not been seen
to be free.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from navcore.angles import wrap_rad
from navcore.decision_facts import Facts, facts_of, finite
from navcore.decision_steps import Step, steps_of
from navcore.decision_words import aside, degrees, inlined, metres, seconds
from navcore.sonar_gap import sonar_gap_m
from navcore.types import BearingState, Reason, Rule
from navcore.wire import WalkerState

_DETOUR_RAD = math.radians(5.0)
_SAME_PLACE_M = 0.3
"""Rangefinder and depth camera mean the same thing where they differ by less."""
_OFFSET_M = 0.05
_GONE_ROUND_M = 3.5
"""What is farther ahead is not gone round yet (navcore.follower.beside)."""
_COMES_M_S = 0.2


@dataclass(frozen=True, slots=True)
class Explanation:
    """Why a decision is what it is."""

    sentence: str
    """Begins with "Walk", "Turn" or "Stop"."""
    steps: tuple[Step, ...]
    """What was looked at, in the order in which it was, and what each gave."""


def explain(state: WalkerState) -> Explanation:
    """Return why the walker is told what they are told."""
    facts = facts_of(state)
    sentence = _SENTENCES[state.action](facts)
    return Explanation(sentence if sentence.endswith("?") else f"{sentence}.", steps_of(facts))


# ------------------------------------------------------------------------------------------------------------- walk
def _walk(facts: Facts) -> str:
    direction_rad = facts.direction_rad
    if direction_rad is None:
        head = "Walk"
    elif abs(direction_rad) <= facts.straight_rad:
        head = "Walk straight ahead"
    else:
        head = f"Walk {aside(direction_rad)}"
    return "; ".join([f"{head}: {_why_walk(facts, direction_rad)}", *_reservations(facts)])


def _why_walk(facts: Facts, direction_rad: float | None) -> str:
    state, trace = facts.state, facts.trace
    free_m = None if direction_rad is None else facts.free_m(direction_rad)
    free = "" if free_m is None else f", free for {metres(free_m)}"
    if state.reason == Reason.OFF_ROAD.value:
        return f"back to the road{_away(state.deviation_m)}{free}"
    if trace.rejoins:
        return f"to the road first{_away(state.deviation_m)}, for nothing was found here that leads on{free}"
    if abs(trace.offset_m) >= _OFFSET_M:
        side = "left" if trace.offset_m > 0.0 else "right"
        beside = f"{metres(abs(trace.offset_m))} {side} of the road's middle"
        return f"round {_gone_round(facts)}, {beside}"
    if facts.rule is Rule.TO_WIDEST:
        widest = "this one is the widest" if free_m is None else f"this one is free farthest, for {metres(free_m)}"
        return f"no direction is free as far as it should be, and {widest}"
    expected_rad = facts.expected_rad
    detour = direction_rad is not None and expected_rad is not None and (
        abs(wrap_rad(direction_rad - expected_rad)) > _DETOUR_RAD
    )  # fmt: skip
    if detour and state.nearest_ahead_m is not None and state.nearest_ahead_m <= _GONE_ROUND_M:
        return f"round {_thing_ahead(facts)}"
    if detour and facts.rule is not Rule.TO_STRAIGHT:
        return f"it is the walkable direction nearest to the way's, {_where(expected_rad)}{free}"
    if direction_rad is not None and abs(direction_rad) > facts.straight_rad:
        return f"the way leads there{free}"
    return f"along the way{free}"


def _reservations(facts: Facts) -> list[str]:
    """Return what else whoever watches should know while the walker walks."""
    state, told = facts.state, []
    if state.quality != "localized":
        allowed = f" of at most {seconds(facts.trace.limits.uncertain_s)}" if facts.trace.limits.uncertain_s else ""
        told.append(f"the place has been uncertain{_for_s(facts.trace.uncertain_s)}{allowed}")
    if facts.trace.closing_m_s >= _COMES_M_S:
        told.append(f"something comes nearer at {facts.trace.closing_m_s:.1f} m/s")
    if state.sonar_state in ("stale", "absent"):
        told.append(f"by the depth camera alone, {_NO_SONAR[state.sonar_state]}")
    return told


_NO_SONAR = {"stale": "for the sonar is silent", "absent": "for there is no sonar"}


# ------------------------------------------------------------------------------------------------------------- turn
def _turn(facts: Facts) -> str:
    direction_rad, kind = facts.direction_rad, facts.trace.turn
    side = "" if direction_rad is None else " left" if direction_rad > 0.0 else " right"
    if kind == "around":
        head = f"Turn around{side and f' by the{side}'}"
    elif direction_rad is None:
        head = "Turn on the spot"
    else:
        head = f"Turn{side} {degrees(direction_rad)}"
    return f"{head}: {'; '.join(filter(None, [_blocked(facts), _turn_purpose(facts)]))}"


def _blocked(facts: Facts) -> str:
    """Return what keeps the walker from walking on, where a turn is told because of it."""
    found = _BLOCKED.get(facts.rule) if facts.rule is not None else None
    return found(facts) if found is not None else ""


def _turn_purpose(facts: Facts) -> str:
    state, trace, direction_rad = facts.state, facts.trace, facts.direction_rad
    back = f"back to the road{_away(state.deviation_m)}" if state.reason == Reason.OFF_ROAD.value else ""
    if trace.turn == "look" and state.reason == Reason.POSE_LOST.value:
        return f"to look round for a known place, for the place in the map has been unknown{_for_s(trace.lost_s)}"
    if trace.turn == "look":
        return "to look for a way round"
    if trace.rejoins and trace.turn in ("along", "around"):
        return f"to the road first{_away(state.deviation_m)}, for nothing was found here that leads on"
    if trace.turn == "around":
        return back or "the way leads behind"
    if trace.turn == "aside":
        free_m = None if direction_rad is None else facts.free_m(direction_rad)
        return "to where a way was found a moment ago" if free_m is None else f"that way is free for {metres(free_m)}"
    return back or ("the way bends here" if trace.is_at_corner else "the way leads there")


# ------------------------------------------------------------------------------------------------------------- stop
def _stop(facts: Facts) -> str:
    found = _STOPS.get(facts.rule) if facts.rule is not None else None
    return f"Stop: {(found or _by_reason)(facts)}"


def _by_reason(facts: Facts) -> str:
    """Return why the walker is stopped, by the reason alone: the check is not known, or says nothing more."""
    try:
        reason = Reason(facts.state.reason)
    except ValueError:
        return inlined(facts.state.reason) or "the device names no reason"
    return _REASONS[reason](facts)


def _near_ahead(facts: Facts) -> str:
    needed = facts.trace.limits.stop_m
    asked = "" if needed is None else f", nearer than the {metres(needed)} that are needed to come to a stand"
    if facts.state.reason == Reason.DROP_AHEAD.value or facts.ahead.state is BearingState.DROP:
        return f"the floor falls away{_at(facts.state.nearest_ahead_m, ' ahead')}{asked}"
    if facts.state.reason == Reason.OBSTACLE_SONAR.value:
        return f"the sonar has heard something that no picture shows{_at(facts.state.nearest_ahead_m, ' ahead')}{asked}"
    comes = f", and comes nearer at {facts.trace.closing_m_s:.1f} m/s" if facts.trace.closing_m_s >= _COMES_M_S else ""
    return f"something is in the way{_at(facts.state.nearest_ahead_m, ' ahead')}{asked}{comes}"


def _nothing_free(facts: Facts) -> str:
    required = finite(facts.trace.required_m)
    far = "as far as it should be" if required is None else f"for {metres(required)}"
    if facts.state.reason == Reason.DROP_AHEAD.value:
        return f"the floor falls away on the way, and no direction is free {far}"
    if facts.state.reason == Reason.OBSTACLE_SONAR.value:
        return f"the sonar has heard something on the way that no picture shows, and no direction is free {far}"
    if facts.state.reason == Reason.NO_CANDIDATE.value:
        return f"no direction is known to be free {far}"
    return f"{_thing_ahead(facts, 'something')} is in the way, and no direction is free {far}"


def _echo(facts: Facts) -> str:
    """Return what the rangefinder hears, and what the depth camera says of the same place."""
    state, echo_m = facts.state, finite(facts.state.sonar_m)
    heard = f"the sonar hears something{_at(echo_m)}"
    half_rad = facts.trace.limits.half_field_rad
    if echo_m is None or half_rad <= 0.0 or state.sonar_state != "ok":
        return heard
    cone = facts.cone(facts.trace.sonar_rad, half_rad)
    gap_m = sonar_gap_m(state.sonar_state, echo_m, cone.nearest_m, state.reason)
    if gap_m is not None and cone.nearest_m is not None and gap_m <= _SAME_PLACE_M:
        return f"{heard}, and the depth camera sees something{_at(cone.nearest_m)}"
    if gap_m is None or not cone.is_known:
        return f"{heard} where the depth camera cannot tell what is there"
    if cone.nearest_m is not None:
        return f"{heard} where the depth camera sees nothing nearer than {metres(cone.nearest_m)}: glass?"
    return f"{heard} where the depth camera sees free: glass?"


def _unknown_place(facts: Facts) -> str:
    return f"the place in the map has been unknown{_for_s(facts.trace.lost_s)}"


def _too_long_uncertain(facts: Facts) -> str:
    allowed = facts.trace.limits.uncertain_s
    longer = f", longer than the {seconds(allowed)} that are allowed" if allowed > 0.0 else ", for too long"
    return f"the place in the map has been uncertain{_for_s(facts.trace.uncertain_s)}{longer}"


def _few_depths(facts: Facts) -> str:
    share, least = finite(facts.trace.valid_fraction), facts.trace.limits.min_valid_fraction
    if share is None:
        return "the depth camera sees too little to be believed"
    asked = f", less than the {least:.0%} that are needed" if least > 0.0 else ""
    return f"only {share:.0%} of the depth picture carries a depth{asked}: what is ahead is unknown"


def _arrived(facts: Facts) -> str:
    left_m = finite(facts.state.remaining_m)
    return "the destination is reached" + ("" if left_m is None else f", {metres(left_m)} before the end of the way")


def _waits(facts: Facts) -> str:
    needed = facts.trace.limits.free_frames_count
    counted = f"{facts.trace.free_frame_count} of {needed}" if needed else f"{facts.trace.free_frame_count}"
    waiting = f"{counted} pictures in a row show no reason to stop any more"
    try:
        reason = Reason(facts.state.reason)
    except ValueError:
        return waiting
    was = inlined(reason.sentence)
    return waiting if reason is Reason.OK else f"{waiting}; the stop was told since {was[0].lower()}{was[1:]}"


def _moved(facts: Facts) -> str:
    return inlined(facts.state.rule) or _REASONS[Reason.CAMERA_MOVED](facts)


def _quoted(before: str) -> Callable[[Facts], str]:
    """Return what says something, and then what the device wrote of it."""
    return lambda facts: before + (f" ({inlined(facts.state.rule)})" if facts.state.rule.strip() else "")


def _plain(words: str) -> Callable[[Facts], str]:
    return lambda facts: words


_REASONS: dict[Reason, Callable[[Facts], str]] = {
    Reason.OK: _quoted("the state of the device allows no step"),
    Reason.OFF_ROAD: lambda facts: f"the walker is off the road{_away(facts.state.deviation_m)}",
    Reason.OBSTACLE_DEPTH: lambda facts: f"the depth camera sees something in the way{_ahead_at(facts)}",
    Reason.OBSTACLE_SONAR: _echo,
    Reason.DROP_AHEAD: lambda facts: f"the floor falls away{_ahead_at(facts) or ' ahead'}",
    Reason.NO_CANDIDATE: _plain("no direction is known to be free"),
    Reason.DEPTH_INVALID: _few_depths,
    Reason.POSE_LOST: _unknown_place,
    Reason.SENSOR_STALE: _quoted("a sensor has stopped delivering"),
    Reason.CAMERA_MOVED: _plain("the camera has moved: the floor is not where the calibration has it"),
    Reason.LOOKS_AWAY: _plain("the walker looks too far down, up or aslant, or the camera has slipped"),
    Reason.ARRIVED: _arrived,
    Reason.NO_ROUTE: _plain("no destination is set, or no way leads there"),
    Reason.PAUSED: _plain("guidance is paused"),
}
_STOPS: dict[Rule, Callable[[Facts], str]] = {
    Rule.OFF_DUTY: _plain("the device is off duty, and leads nobody"),
    Rule.MAPPING: _plain("a map is being recorded, and nobody is led"),
    Rule.NO_FRAME: _quoted("the camera gives no picture"),
    Rule.FAULT: _quoted("the program has failed"),
    Rule.PAUSED: _REASONS[Reason.PAUSED],
    Rule.NO_ROUTE: _REASONS[Reason.NO_ROUTE],
    Rule.START_UNKNOWN: lambda facts: f"where the way begins is not known yet; {_unknown_place(facts)}",
    Rule.POSE_LOST: _unknown_place,
    Rule.NOT_SURE_AGAIN: lambda facts: (
        f"the place in the map was lost{_for_s(facts.trace.lost_s, ' before')}, and is only uncertain since"
    ),
    Rule.UNCERTAIN_TOO_LONG: _too_long_uncertain,
    Rule.ARRIVED_BEFORE: _arrived,
    Rule.ARRIVED: _arrived,
    Rule.DEPTH_INVALID: _few_depths,
    Rule.NEAR_AHEAD: _near_ahead,
    Rule.ECHO_NEAR: _echo,
    Rule.NOTHING_FREE: _nothing_free,
    Rule.GATE_CLOSED: _echo,
    Rule.FREE_FRAMES: _waits,
    Rule.CAMERA_MOVED: _moved,
    Rule.DECISION_OLD: _quoted("deciding took too long"),
    Rule.SETTLING: _quoted("all works again, but not for long enough yet"),
    Rule.WATCHDOG: _quoted("no decision came in time, so the watchdog has told the walker to stand"),
    Rule.NOT_ALLOWED: lambda facts: f"the state of the device ({facts.state.mode.label}) allows no step",
}
"""Rules that only ever turn or walk are not in it; a stop by one of them is explained by its reason."""
_BLOCKED: dict[Rule, Callable[[Facts], str]] = {
    Rule.NEAR_AHEAD: _near_ahead,
    Rule.ECHO_NEAR: _echo,
    Rule.NOTHING_FREE: _nothing_free,
    Rule.GATE_CLOSED: _echo,
    Rule.TURN_FIRST: lambda facts: (
        f"{_thing_ahead(facts, 'what is straight ahead is not known')}, and the first steps lead straight on"
    ),
    Rule.FREE_FRAMES: lambda facts: (
        f"{facts.trace.free_frame_count} of {facts.trace.limits.free_frames_count} pictures in a row agree so far"
    ),
}
_SENTENCES: dict[str, Callable[[Facts], str]] = {"walk": _walk, "turn": _turn, "stop": _stop}


# ------------------------------------------------------------------------------------------------------------ words
def _thing_ahead(facts: Facts, otherwise: str = "something") -> str:
    """Return what is nearest ahead, with its distance; ``otherwise`` where nothing is known to be there."""
    nearest_m = finite(facts.state.nearest_ahead_m)
    if nearest_m is None:
        return otherwise
    what = {BearingState.DROP: "a drop", BearingState.HEARD: "what the sonar has heard"}.get(
        facts.ahead.state, "something"
    )
    return f"{what} {metres(nearest_m)} ahead"


def _gone_round(facts: Facts) -> str:
    nearest_m = facts.state.nearest_ahead_m
    is_near = nearest_m is not None and nearest_m <= _GONE_ROUND_M
    return _thing_ahead(facts) if is_near else "what stands on the road"


def _where(direction_rad: float | None) -> str:
    return "which is not known" if direction_rad is None else aside(direction_rad)


def _ahead_at(facts: Facts) -> str:
    return _at(facts.state.nearest_ahead_m, " ahead")


def _at(distance_m: float | None, where: str = "") -> str:
    number = finite(distance_m)
    if number is None:
        return ""
    return f" {metres(number)}{where}" if where else f" at {metres(number)}"


def _away(distance_m: float | None) -> str:
    number = finite(distance_m)
    return "" if number is None else f", {metres(number)} away"


def _for_s(duration_s: float | None, when: str = "") -> str:
    return "" if duration_s is None else f" {seconds(duration_s)}{when}" if when else f" for {seconds(duration_s)}"

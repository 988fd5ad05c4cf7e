"""What a decision looked at, in which order, and what each check gave: the table for technicians. Pure functions."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from navcore.decision_facts import Facts, finite
from navcore.decision_words import aside, degrees, inlined, metres, seconds
from navcore.types import Rule

NOTHING = "–"
_CASES = {1: "case 1, a point on the way", 2: "case 2, a turning point", 3: "case 3, the destination"}
_TURNS = {
    "along": "to where the way leads", "around": "around, for the way leads behind",
    "aside": "to a free direction", "look": "to look for a way",
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Step:
    """One check of a decision."""

    name: str
    found: str
    """Figures, and the limits that they were compared with."""
    outcome: str
    """"passed", "decides: …", or "not reached"; empty where the check that decided is not known."""
    decides: bool = False


def steps_of(facts: Facts) -> tuple[Step, ...]:
    """Return the checks in the order in which they are made; the one that decided says so."""
    decisive = next((i for i, (_, _, rules) in enumerate(_CHECKS) if facts.rule in rules), None)
    return tuple(
        Step(name, found(facts) or NOTHING, _outcome(facts, i, decisive), i == decisive)
        for i, (name, found, _) in enumerate(_CHECKS)
    )


def _outcome(facts: Facts, index: int, decisive: int | None) -> str:
    if decisive is None:
        return ""
    if index == decisive:
        return f"decides: {facts.state.action}"
    return "passed" if index < decisive else "not reached"


def _device(facts: Facts) -> str:
    to = f", to {facts.state.destination_id}" if facts.state.destination_id else ""
    return f"{facts.state.mode.label}{to}"


def _pose(facts: Facts) -> str:
    state, trace = facts.state, facts.trace
    std_m, heading_rad = finite(state.position_std_m), facts.heading_rad
    parts = [
        state.quality,
        f"± {100.0 * std_m:.0f} cm" if std_m is not None else "",
        f"{state.inlier_count} landmarks",
        f"θ_c {math.degrees(heading_rad):.0f}°" if heading_rad is not None else "",
        f"uncertain for {seconds(trace.uncertain_s)} of {seconds(trace.limits.uncertain_s)}"
        if trace.uncertain_s is not None else "",
        f"lost for {seconds(trace.lost_s)}" if trace.lost_s is not None else "",
    ]  # fmt: skip
    return _joined(parts)


def _sub_goal(facts: Facts) -> str:
    state, goal = facts.state, facts.sub_goal
    remaining_m = finite(state.remaining_m)
    parts = [
        _CASES.get(state.sub_goal_case or 0, ""),
        f"{metres(goal[1])} away, {aside(goal[0])}" if goal is not None else "",
        f"{metres(remaining_m)} of the way left" if remaining_m is not None else "",
        f"arrived within {metres(facts.trace.limits.arrival_m)}" if goal is not None else "",
    ]
    return _joined(parts)


def _expected(facts: Facts) -> str:
    expected_rad, limits = facts.expected_rad, facts.trace.limits
    if expected_rad is None:
        return ""
    first = "to the road first" if facts.trace.rejoins else ""
    return _joined(
        [f"θ_exp {aside(expected_rad)}", first, f"Eq. 4 corrects from {degrees(limits.heading_error_rad)} on"]
    )


def _deviation(facts: Facts) -> str:
    deviation_m, limit_m = finite(facts.state.deviation_m), facts.trace.limits.off_road_m
    if deviation_m is None:
        return ""
    where = "" if limit_m <= 0.0 else ", off the road" if deviation_m > limit_m else ", on the road"
    offset = facts.trace.offset_m
    led = f"led {metres(abs(offset))} {'left' if offset > 0.0 else 'right'} of its middle" if offset else ""
    return _joined([f"{deviation_m:.2f} m of at most {metres(limit_m)}{where}", led])


def _turning(facts: Facts) -> str:
    trace, corner = facts.trace, facts.trace.corner
    ahead = "" if corner is None else (
        f"corner of {aside(corner.bend_rad)} in {metres(corner.distance_m)}, turned at {metres(corner.turn_m)} before"
    )  # fmt: skip
    kind = "" if trace.turn is None else f"turns {_TURNS[trace.turn]}"
    return _joined([f"on the spot from {degrees(trace.limits.turn_rad)} on", kind, ahead])


def _depth(facts: Facts) -> str:
    share, least = finite(facts.trace.valid_fraction), facts.trace.limits.min_valid_fraction
    return "" if share is None else f"{share:.0%} of the picture carries a depth, {least:.0%} are needed"


def _near(facts: Facts) -> str:
    if facts.trace.scan is None:
        return ""
    nearest_m, needed_m = finite(facts.state.nearest_ahead_m), facts.trace.limits.stop_m
    comes = facts.trace.closing_m_s
    parts = [
        "nothing found in the walker's width" if nearest_m is None else f"nearest ahead {metres(nearest_m)}",
        _sonar(facts),
        "" if needed_m is None else f"at least {metres(needed_m)} to come to a stand",
        f"something comes nearer at {comes:.1f} m/s" if comes > 0.0 else "",
    ]
    return _joined(parts)


def _sonar(facts: Facts) -> str:
    state, echo_m = facts.state, finite(facts.state.sonar_m)
    words = {"no_echo": "d_sonar: no echo", "stale": "d_sonar: silent", "absent": "no sonar"}
    if state.sonar_state != "ok":
        return words[state.sonar_state]
    return "d_sonar: no distance" if echo_m is None else f"d_sonar {metres(echo_m)}"


def _candidates(facts: Facts) -> str:
    all_of_them, required_m = facts.state.candidates, finite(facts.trace.required_m)
    if not all_of_them and required_m is None:
        return ""
    walkable = [each for each in all_of_them if each.is_walkable]
    farthest_m = max((each.clearance_m for each in all_of_them), default=None)
    parts = [
        f"{len(all_of_them)} directions",
        "" if farthest_m is None else f"free for {metres(farthest_m)} at most",
        "" if required_m is None else f"{len(walkable)} for the {metres(required_m)} that are needed",
    ]
    return _joined(parts)


def _chosen(facts: Facts) -> str:
    optimal_rad = finite(facts.trace.optimal_rad)
    if optimal_rad is None:
        return ""
    free_m = facts.free_m(optimal_rad)
    free = "clearance not known" if free_m is None else f"free for {metres(free_m)}"
    return f"θ_opt {aside(optimal_rad)}, {free}"


def _gate(facts: Facts) -> str:
    limits = facts.trace.limits
    if limits.gate_m is None:
        return ""
    field = f"within {math.degrees(limits.half_field_rad):.1f}° of {aside(facts.trace.sonar_rad)}"
    return f"{_sonar(facts)}, must exceed {metres(limits.gate_m)} {field}"


def _first_step(facts: Facts) -> str:
    stopped_s = facts.trace.stopped_s
    return "" if stopped_s is None else f"not walking for {seconds(stopped_s)}"


def _frames(facts: Facts) -> str:
    trace = facts.trace
    return (
        f"{trace.free_frame_count} of {trace.limits.free_frames_count} since the stop" if trace.free_frame_count else ""
    )


def _last_checks(facts: Facts) -> str:
    return inlined(facts.state.rule) if facts.rule in _OVERRULED else ""


def _result(facts: Facts) -> str:
    direction_rad = facts.direction_rad
    where = "" if direction_rad is None else f" {aside(direction_rad)}"
    return _joined([f"{facts.state.action}{where}", facts.state.reason, inlined(facts.state.rule)])


def _joined(parts: list[str]) -> str:
    return "; ".join(part for part in parts if part)


_OVERRULED = frozenset({Rule.CAMERA_MOVED, Rule.DECISION_OLD, Rule.SETTLING, Rule.NOT_ALLOWED, Rule.WATCHDOG})
_CHECKS: tuple[tuple[str, Callable[[Facts], str], frozenset[Rule]], ...] = (
    ("Device", _device, frozenset({
        Rule.OFF_DUTY, Rule.MAPPING, Rule.NO_FRAME, Rule.FAULT, Rule.PAUSED, Rule.NO_ROUTE, Rule.START_UNKNOWN,
    })),
    ("Pose", _pose, frozenset({Rule.POSE_LOST, Rule.NOT_SURE_AGAIN, Rule.UNCERTAIN_TOO_LONG})),
    ("Sub-goal (Eqs. 1, 2)", _sub_goal, frozenset({Rule.ARRIVED_BEFORE, Rule.ARRIVED})),
    ("Expected direction (Eq. 3)", _expected, frozenset({Rule.LOOKS_ASIDE})),
    ("Deviation", _deviation, frozenset()),
    ("Turn on the spot?", _turning, frozenset({Rule.FAR_ASIDE})),
    ("Depth picture", _depth, frozenset({Rule.DEPTH_INVALID})),
    ("Nearest ahead", _near, frozenset({Rule.NEAR_AHEAD, Rule.ECHO_NEAR})),
    ("Candidates (D)", _candidates, frozenset({Rule.NOTHING_FREE})),
    ("Chosen (Eq. 4)", _chosen, frozenset()),
    ("Ultrasonic gate (Eq. 5)", _gate, frozenset({Rule.GATE_CLOSED})),
    ("First step", _first_step, frozenset({Rule.TURN_FIRST})),
    ("Free pictures after a stop", _frames, frozenset({Rule.FREE_FRAMES})),
    ("Last checks", _last_checks, _OVERRULED),
    ("Result", _result, frozenset({Rule.TO_EXPECTED, Rule.TO_STRAIGHT, Rule.TO_WIDEST})),
)  # fmt: skip
"""Each check: its name, what it found, and the rules by which it decides."""

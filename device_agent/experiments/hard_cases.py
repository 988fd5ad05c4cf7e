"""Situations in which guidance is most likely to be wrong: what happens in each, and what must come of it.

One table for two ways of walking them: among boxes with everything but localization being real
(``tests/test_hard_cases.py``), and in the rendered office floor with the whole stack (``benchmarks/hard_cases.py``).
In every case nothing may be touched, nobody may be sent on while the pose is lost, and the place on the route may not
leap.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

from device_agent.cycle import Cycle
from device_agent.simulation.walker import WalkerBody
from device_agent.walk_measures import Sample
from navcore.cues.table import Cue, CueKind
from navcore.cues.texts import TEXTS
from navcore.modes import ON_THE_WAY, Mode
from navcore.types import Action, Guidance, LocalizationQuality, Reason, TurnKind

_LONGEST_LEAP_M = 2.0
"""The closest point moves less between two cycles, however the walker walks."""
_SENDING = frozenset({CueKind.WALK, CueKind.TICK, CueKind.STEER})
_SOMETHING_AHEAD = frozenset(
    {Reason.OBSTACLE_DEPTH, Reason.OBSTACLE_SONAR, Reason.DROP_AHEAD, Reason.NO_CANDIDATE}
)  # fmt: skip
_TOLD = ("way_blocked", "way_blocked_wait", "way_look_again", "way_anew", "sonar_lost")
"""Texts (by their key) whose place in the order of things is noted."""
WAITS, LED_ON, ANOTHER_WAY, ARRIVES = "waits", "walks", "another way", "arrives"
"""What a walk is told by, besides these texts: kept from walking on by something ahead, led on, a new route, there."""


@dataclass(frozen=True, slots=True)
class Expected:
    """What must come of a case, besides what holds in every one."""

    arrives: bool = True
    stops: tuple[Reason, ...] = ()
    """Each of them stops the walker at some time."""
    stops_for_one_of: tuple[Reason, ...] = ()
    """At least one of them does."""
    turns: tuple[TurnKind, ...] = ()
    """Each of them is told at some time."""
    turns_one_of: tuple[TurnKind, ...] = ()
    """At least one of them is."""
    says: tuple[str, ...] = ()
    """Each of these texts (by its key) is heard."""
    once: tuple[str, ...] = ()
    """Each of them is heard once, and no more."""
    never_says: tuple[str, ...] = _TOLD
    """None of them is, unless it is said above."""
    in_order: tuple[str, ...] = ()
    """Each of these happens after the one before it: one of the words of a walk, or a text by its key."""
    heeds: bool = False
    """The walker is stopped before what is in the way, or turned or led round it."""
    routes: int = 1
    """So many routes are walked by, one after the other."""
    ends: Reason | None = None
    """Why the walker stands at the end, where they do not arrive."""


@dataclass(frozen=True, slots=True)
class HardCase:
    """One situation."""

    name: str
    issue: str
    """What it was asked for as."""
    what_happens: str
    outcome: str
    """What must come of it, in words."""
    expected: Expected


_SOMETHING_SEEN = (Reason.OBSTACLE_DEPTH, Reason.NO_CANDIDATE)

HARD_CASES = (
    HardCase(
        "u-turn", "U-turn needed",
        "The walker faces away from the way they are to go.",
        "turns around on the spot, arrives",
        Expected(turns=(TurnKind.AROUND,)),
    ),
    HardCase(
        "facing a wall", "start facing a wall",
        "The walk begins at arm's length from a wall that is looked at.",
        "turns along the way (looks round first, where the map knows no such view) without a step, arrives",
        Expected(turns_one_of=(TurnKind.ALONG, TurnKind.LOOK)),
    ),
    HardCase(
        "destination behind", "destination behind",
        "Under way, another destination is chosen, which lies behind.",
        "a new way; turns around, arrives there",
        Expected(turns=(TurnKind.AROUND,), routes=2),
    ),
    HardCase(
        "blocked for a while", "corridor blocked",
        "People stand across the corridor and walk on after some seconds.",
        "waits before them, is not sent another way, arrives",
        Expected(stops_for_one_of=_SOMETHING_SEEN, in_order=(WAITS, LED_ON, ARRIVES)),
    ),
    HardCase(
        "blocked, another way", "corridor blocked",
        "Something that stays stands across the corridor; another way leads round.",
        "waits, is told of the other way, arrives by it",
        Expected(
            stops_for_one_of=_SOMETHING_SEEN, says=("way_blocked",), routes=2,
            in_order=(LED_ON, WAITS, ANOTHER_WAY, "way_blocked", LED_ON, ARRIVES),
        ),
    ),
    HardCase(
        "blocked, no other way", "corridor blocked",
        "Something that stays stands across the only way.",
        "waits, is told that there is no other, stands",
        Expected(
            False, stops_for_one_of=_SOMETHING_SEEN, says=("way_blocked_wait",), ends=Reason.OBSTACLE_DEPTH,
            in_order=(LED_ON, WAITS, "way_blocked_wait", WAITS),
        ),
    ),
    HardCase(
        "gone from the feet", "corridor blocked",
        "Something low lies across the only way; once the walker is so near that no image shows it, it is taken away.",
        "comes to a stand, is led back a little to look again, arrives",
        Expected(
            turns=(TurnKind.AROUND,), says=("way_look_again",), routes=3,
            in_order=(WAITS, ANOTHER_WAY, "way_look_again", ANOTHER_WAY, LED_ON, ARRIVES),
        ),
    ),
    HardCase(
        "person coming", "a person walking towards",
        "Somebody comes towards the walker on the middle of the road, stops before them, and later steps aside.",
        "stops before them or goes round, arrives",
        Expected(heeds=True),
    ),
    HardCase(
        "door closing", "door closing",
        "A door closes when the walker is four steps before it, and is opened again after some seconds.",
        "stops before it, goes on when it is open, arrives",
        Expected(stops_for_one_of=_SOMETHING_SEEN, in_order=(LED_ON, WAITS, LED_ON, ARRIVES)),
    ),
    HardCase(
        "glass door", "glass door",
        "A closed door of glass: the depth camera looks through it. Another way leads round.",
        "the rangefinder stops the walker, who arrives by the other way",
        Expected(
            stops=(Reason.OBSTACLE_SONAR,), says=("way_blocked",), routes=2,
            in_order=(LED_ON, WAITS, ANOTHER_WAY, "way_blocked", LED_ON, ARRIVES),
        ),
    ),
    HardCase(
        "stairs down", "drop-offs and stairs down",
        "The floor of the corridor ends at the head of a stair without a rail. Another way leads round.",
        "stops before the edge, is told of the other way, arrives by it",
        Expected(stops=(Reason.DROP_AHEAD,), says=("way_blocked",), routes=2),
    ),
    HardCase(
        "bag that absorbs", "absorbing (depth holes)",
        "A black bag stands on the road: the depth camera shows a hole in the floor, and nothing that stands there.",
        "goes round it, arrives",
        Expected(),
    ),
    HardCase(
        "chair pulled out", "chair pulled out",
        "A chair is pulled out into the way when the walker is near.",
        "goes round it, arrives",
        Expected(heeds=True),
    ),
    HardCase(
        "legs side by side", "junction where two legs run side by side",
        "The way leads to a junction and comes back within arm's reach of itself.",
        "walks to the junction and back, takes no leg for the other, arrives",
        Expected(),
    ),
    HardCase(
        "lost mid-corridor", "lost localization mid-corridor and recovery",
        "Under way the place in the map is not known for some seconds.",
        "stops at once, goes on when the place is known again, arrives",
        Expected(stops=(Reason.POSE_LOST,)),
    ),
    HardCase(
        "sonar unplugged", "sonar unplugged",
        "Under way the ultrasonic rangefinder falls silent for good.",
        "is told so once, goes on by the depth camera, arrives",
        Expected(says=("sonar_lost",), once=("sonar_lost",), in_order=(LED_ON, "sonar_lost", LED_ON, ARRIVES)),
    ),
)  # fmt: skip
"""Every case."""


def hard_case(name: str) -> HardCase:
    """Return a case by its name; KeyError for another."""
    return {case.name: case for case in HARD_CASES}[name]


@dataclass(frozen=True, slots=True)
class Outcome:
    """What happened in a walk."""

    arrived: bool
    contacts: int
    stopped_for: frozenset[Reason]
    turned: frozenset[TurnKind]
    texts: tuple[str, ...]
    """Everything that was spoken."""
    routes: int
    """Routes by which guidance led."""
    ended: Reason
    seconds: float
    sent_while_lost: int
    """Cycles in which the walker was sent on though nobody knew where they were."""
    leap_m: float
    """Farthest that the place on the route moved between two cycles."""
    heeded: bool = False
    """Whether the walker was stopped before something, or turned or led round it."""
    story: tuple[str, ...] = ()
    """What happened, one after the other: words of a walk, and texts by their keys."""

    def said(self, key: str) -> bool:
        """Whether a text was heard, up to its first number."""
        return self.times_said(key) > 0

    def times_said(self, key: str) -> int:
        """Return how often a text was heard, up to its first number."""
        return sum(_is_text(text, key) for text in self.texts)


def outcome_of(samples: Sequence[Sample], cues: Sequence[Cue], body: WalkerBody, *, is_there: bool = True) -> Outcome:
    """Return what happened; ``is_there`` says whether the walker truly stands at the destination at the end."""
    cycles = [sample.cycle for sample in samples if sample.mode in (*ON_THE_WAY, Mode.ARRIVED)]
    guidances = [cycle.guidance for cycle in cycles]
    versions = {guidance.route_version for guidance in guidances if guidance.trace.closest_index is not None}
    sent_while_lost = sum(
        (cycle.localization is None or cycle.localization.quality is LocalizationQuality.LOST)
        and (cycle.guidance.action is Action.WALK or any(cue.kind in _SENDING for cue in cycle.cues))
        for cycle in cycles
    )
    said_so = any(sample.mode is Mode.ARRIVED for sample in samples)
    led = [sample for sample in samples if sample.mode in ON_THE_WAY]
    return Outcome(
        arrived=said_so and is_there,
        contacts=body.contacts,
        stopped_for=frozenset(each.reason for each in guidances if each.action is Action.STOP),
        turned=frozenset(each.trace.turn for each in guidances if each.trace.turn is not None),
        texts=tuple(cue.text for cue in cues if cue.text),
        routes=len(versions),
        ended=guidances[-1].reason if guidances else Reason.NO_ROUTE,
        seconds=led[-1].cycle.stamp_s - samples[0].cycle.stamp_s if led else 0.0,
        sent_while_lost=sent_while_lost,
        leap_m=_longest_leap_m(samples),
        heeded=any(_heeds(guidance) for guidance in guidances),
        story=_story([sample.cycle for sample in samples if sample.mode in (*ON_THE_WAY, Mode.ARRIVED)]),
    )


def differences(expected: Expected, outcome: Outcome) -> tuple[str, ...]:
    """Return in words what happened otherwise than expected; nothing where all is well."""
    found = [
        (outcome.arrived and not expected.arrives, "arrived"),
        (expected.arrives and not outcome.arrived, f"did not arrive ({outcome.ended.value})"),
        (outcome.contacts > 0, f"{outcome.contacts} contacts"),
        (outcome.sent_while_lost > 0, f"sent on in {outcome.sent_while_lost} cycles without a pose"),
        (outcome.leap_m > _LONGEST_LEAP_M, f"the place on the route leapt by {outcome.leap_m:.1f} m"),
        (outcome.routes != expected.routes, f"{outcome.routes} routes instead of {expected.routes}"),
        (expected.ends not in (None, outcome.ended), f"ended with {outcome.ended.value}"),
        (
            bool(expected.stops_for_one_of) and not outcome.stopped_for & set(expected.stops_for_one_of),
            "never stopped for " + " or ".join(reason.value for reason in expected.stops_for_one_of),
        ),
    ]  # fmt: skip
    if expected.turns_one_of:
        kinds = " or ".join(turn.value for turn in expected.turns_one_of)
        found.append((not outcome.turned & set(expected.turns_one_of), f"never turned {kinds}"))
    found += [(reason not in outcome.stopped_for, f"never stopped for {reason.value}") for reason in expected.stops]
    found += [(turn not in outcome.turned, f"never turned {turn.value}") for turn in expected.turns]
    found += [(not outcome.said(key), f"never said {key}") for key in expected.says]
    found += [
        (outcome.times_said(key) != 1, f"said {key} {outcome.times_said(key)} times") for key in expected.once
    ]  # fmt: skip
    found.append((expected.heeds and not outcome.heeded, "was neither stopped before it nor led round it"))
    found.append((not _is_within(expected.in_order, outcome.story), f"not in order: {', '.join(expected.in_order)}"))
    unwanted = [key for key in expected.never_says if key not in expected.says]
    found += [(outcome.said(key), f"said {key}") for key in unwanted]
    return tuple(what for is_so, what in found if is_so)


def _is_text(text: str, key: str) -> bool:
    return text.startswith(TEXTS["en"][key].split("{")[0])


def _waits(guidance: Guidance) -> bool:
    """Whether something ahead keeps somebody from walking on: stopped, or turned to look, or to where it is free."""
    if guidance.action is Action.STOP:
        return guidance.reason in _SOMETHING_AHEAD
    return guidance.trace.turn in (TurnKind.ASIDE, TurnKind.LOOK) and guidance.reason is not Reason.POSE_LOST


def _heeds(guidance: Guidance) -> bool:
    return _waits(guidance) or (guidance.action is Action.WALK and guidance.trace.offset_m != 0.0)


def _story(cycles: Sequence[Cycle]) -> tuple[str, ...]:
    """Return what happened, one after the other; what goes on is told once."""
    told: list[str] = []
    version: int | None = None
    for cycle in cycles:
        guidance = cycle.guidance
        if guidance.trace.closest_index is not None:
            if version not in (None, guidance.route_version):
                told.append(ANOTHER_WAY)
            version = guidance.route_version
        if guidance.action is Action.WALK:
            told.append(LED_ON)
        elif _waits(guidance):
            told.append(WAITS)
        told += [key for key in _TOLD for cue in cycle.cues if _is_text(cue.text, key)]
        if guidance.reason is Reason.ARRIVED:
            told.append(ARRIVES)
    return tuple(what for what, _ in itertools.groupby(told))


def _is_within(wanted: Sequence[str], story: Sequence[str]) -> bool:
    """Whether all that is wanted happened, in this order; other things may have happened between."""
    rest = iter(story)
    return all(each in rest for each in wanted)


def _longest_leap_m(samples: Sequence[Sample]) -> float:
    """Return how far the closest point moved at most between two cycles on one route."""
    longest_m, before = 0.0, None
    for sample in samples:
        guidance = sample.cycle.guidance
        left_m = guidance.trace.remaining_m
        if sample.mode not in ON_THE_WAY or left_m is None:
            continue
        if before is not None and before[0] == guidance.route_version:
            longest_m = max(longest_m, abs(before[1] - left_m))
        before = guidance.route_version, left_m
    return longest_m

"""What other settings would have changed in a recorded walk, from the list of decisions that a replay writes.

A list has a line for each cycle: what was decided then, and what is decided now of the same poses and scans.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from statistics import fmean
from typing import Literal

import msgspec

from console.live_panel import reason_sentence
from navcore.errors import InputError
from navcore.types import Reason

LONGEST_CYCLE_S = 1.0
"""No decision counts for longer, whatever gap follows it."""
_DIRECTION_STEP_DEG = 5
_FIGURES_EVERY_S = 1.0
"""What is told of an unchanged decision is brought up to date so often."""
_SHOWN = ("action", "reason", "direction_deg", "cues")
"""In what decisions differ that are shown as different: what is only measured changes nothing for anybody."""


class Decision(msgspec.Struct, frozen=True):
    """What guidance decided in one cycle, and what was said."""

    action: Literal["walk", "turn", "stop"]
    reason: str
    rule: str
    direction_deg: float | None
    deviation_m: float | None
    cues: tuple[str, ...]

    sentence: str
    """Why, as ``navcore.explain`` tells it."""

    @property
    def words(self) -> str:
        """The decision, and what was said."""
        return "".join([self.sentence, *(f" “{cue}”" for cue in self.cues)])

    @property
    def gist(self) -> tuple[object, ...]:
        """What of it is worth telling at once; figures in the sentence change with every cycle."""
        heading = None if self.direction_deg is None else round(self.direction_deg / _DIRECTION_STEP_DEG)
        return self.action, self.reason, self.rule, heading, self.cues


class DecisionPair(msgspec.Struct, frozen=True):
    """A cycle then, and now."""

    cycle: int
    stamp_s: float
    differs_in: tuple[str, ...]
    then: Decision
    now: Decision

    @property
    def differs(self) -> bool:
        """Something that a walker would hear or do is different."""
        return any(name in _SHOWN for name in self.differs_in)


@dataclass(frozen=True, slots=True)
class Side:
    """One of the two: what was, or what would have been."""

    seconds: dict[str, float]
    """By action."""
    stop_count: int
    stops_by_reason: dict[str, int]
    """How often walking or turning ended in a stop on the way, by the reason's sentence."""
    no_way_count: int
    off_road_count: int
    """How often the walker began to be led back to the road."""
    cue_count: int
    mean_deviation_m: float | None


@dataclass(frozen=True, slots=True)
class Stretch:
    """A time in which one thing holds, in seconds since the replay's beginning."""

    from_s: float
    to_s: float
    then: str
    """The action, of a band."""
    now: str


@dataclass(frozen=True, slots=True)
class Instant:
    """From here on both decisions, in words, until the next one."""

    at_s: float
    then: str
    now: str


@dataclass(frozen=True, slots=True)
class WhatIfResult:
    """What would have changed."""

    length_s: float
    cycle_count: int
    different_s: float
    """How long the walker would have heard or done something else."""
    then: Side
    now: Side
    bands: tuple[Stretch, ...]
    """The actions, then and now."""
    different: tuple[Stretch, ...]
    """When they differ, with the two sentences of its beginning."""
    instants: tuple[Instant, ...]
    """Both sentences wherever a decision changes, and every second."""


def read_decisions(path: Path) -> tuple[DecisionPair, ...]:
    """Read a list of decisions. Raises InputError."""
    decoder = msgspec.json.Decoder(DecisionPair)
    try:
        with path.open("rb") as lines:
            return tuple(decoder.decode(line) for line in lines)
    except (OSError, msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        raise InputError(f"The replay's decisions cannot be read ({error}): ask for them again.") from error


def compared(pairs: tuple[DecisionPair, ...]) -> WhatIfResult:
    """Return what differs. Raises InputError where there is nothing to compare."""
    if not pairs:
        raise InputError("There is not one whole cycle in this walk: choose another one.")
    lengths_s = _lengths_s([pair.stamp_s for pair in pairs])
    began_s = pairs[0].stamp_s
    spans = [
        (pair.stamp_s - began_s, pair.stamp_s - began_s + length_s)
        for pair, length_s in zip(pairs, lengths_s, strict=True)
    ]
    return WhatIfResult(
        length_s=spans[-1][1],
        cycle_count=len(pairs),
        different_s=sum(length_s for pair, length_s in zip(pairs, lengths_s, strict=True) if pair.differs),
        then=_side([pair.then for pair in pairs], lengths_s),
        now=_side([pair.now for pair in pairs], lengths_s),
        bands=tuple(
            _merged((span, (pair.then.action, pair.now.action)) for span, pair in zip(spans, pairs, strict=True))
        ),
        different=tuple(_different(spans, pairs)),
        instants=tuple(_instants(spans, pairs)),
    )


def _lengths_s(stamps_s: list[float]) -> list[float]:
    """Return how long each decision held: until the next one, the last as long as the one before it."""
    gaps = [min(LONGEST_CYCLE_S, max(0.0, b - a)) for a, b in pairwise(stamps_s)]
    return [*gaps, gaps[-1] if gaps else 0.0]


def _side(decisions: list[Decision], lengths_s: list[float]) -> Side:
    seconds = dict.fromkeys(("walk", "turn", "stop"), 0.0)
    for decision, length_s in zip(decisions, lengths_s, strict=True):
        seconds[decision.action] += length_s
    stops = Counter(d.reason for d in _beginnings(decisions, "action") if d.action == "stop" and _is_on_the_way(d))
    reasons = Counter(decision.reason for decision in _beginnings(decisions, "reason"))
    deviations_m = [decision.deviation_m for decision in decisions if decision.deviation_m is not None]
    return Side(
        seconds=seconds,
        stop_count=stops.total(),
        stops_by_reason={reason_sentence(reason): count for reason, count in stops.most_common()},
        no_way_count=reasons[Reason.NO_CANDIDATE.value],
        off_road_count=reasons[Reason.OFF_ROAD.value],
        cue_count=sum(len(decision.cues) for decision in decisions),
        mean_deviation_m=fmean(deviations_m) if deviations_m else None,
    )


def _is_on_the_way(decision: Decision) -> bool:
    """Say whether somebody is still on the way: standing at the destination is no stop, as on the page of a walk."""
    return decision.reason not in (Reason.ARRIVED.value, Reason.NO_ROUTE.value)


def _beginnings(decisions: list[Decision], name: str) -> Iterator[Decision]:
    """Yield each decision that is in this other than the one before it."""
    before = None
    for decision in decisions:
        if getattr(decision, name) != before:
            yield decision
        before = getattr(decision, name)


def _merged(items: Iterable[tuple[tuple[float, float], tuple[str, str]]]) -> Iterator[Stretch]:
    """Join neighbours that say the same."""
    current: Stretch | None = None
    for (from_s, to_s), (then, now) in items:
        if current is not None and (current.then, current.now) == (then, now):
            current = Stretch(current.from_s, to_s, then, now)
            continue
        if current is not None:
            yield current
        current = Stretch(from_s, to_s, then, now)
    if current is not None:
        yield current


def _different(spans: list[tuple[float, float]], pairs: tuple[DecisionPair, ...]) -> Iterator[Stretch]:
    current: Stretch | None = None
    for (from_s, to_s), pair in zip(spans, pairs, strict=True):
        if pair.differs and current is not None:
            current = Stretch(current.from_s, to_s, current.then, current.now)
        elif pair.differs:
            current = Stretch(from_s, to_s, pair.then.words, pair.now.words)
        elif current is not None:
            yield current
            current = None
    if current is not None:
        yield current


def _instants(spans: list[tuple[float, float]], pairs: tuple[DecisionPair, ...]) -> Iterator[Instant]:
    before: tuple[object, ...] | None = None
    next_s = 0.0
    for (at_s, _), pair in zip(spans, pairs, strict=True):
        gist = pair.then.gist, pair.now.gist
        if gist != before or at_s >= next_s:
            yield Instant(at_s, pair.then.words, pair.now.words)
            before, next_s = gist, at_s + _FIGURES_EVERY_S

"""What stands out in a past walk, and when: stops with their reason, weak localization, off the road, disagreement."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from typing import Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

from console.timeline import Timeline
from navcore.geometry import FloatArray
from navcore.modes import ON_THE_WAY, Mode, is_led
from navcore.sonar_gap import sonar_gap_m
from navcore.types import Reason

MarkKind = Literal["stop", "weak", "off_road", "disagreement", "cue", "event", "order", "alert"]
LONGEST_STEP_S = 1.0
"""What lies between two cycles counts for no longer than this: the device was away meanwhile."""
STANDING_M_S = 0.15
"""Slower than this, somebody stands."""
HEARD_WITHIN_M = 2.0
"""What the rangefinder hears farther away asks for nothing yet."""
DISAGREE_BY_M = 0.5
"""So much nearer than what the depth camera sees it must be to be something else."""
_LEAST_S = 0.5
"""What lasts for a shorter time is not told; what comes again as soon is the same."""


class Mark(msgspec.Struct, frozen=True):
    """Something that stands out. Times are seconds from the walk's beginning."""

    kind: MarkKind
    at_s: float
    length_s: float
    text: str
    x_m: float | None = None
    """Where the walker was, as far as that was known."""
    y_m: float | None = None


def led(timeline: Timeline) -> NDArray[np.bool_]:
    """Return (n,) whether somebody was being led, though they may stand just then."""
    alone = timeline.is_word("mode", *(mode for mode in Mode if is_led(mode, has_destination=False)))
    with_goal = timeline.is_word("mode", *(mode for mode in Mode if is_led(mode, has_destination=True)))
    return alone | (with_goal & ~timeline.is_word("destination_id", ""))


def on_the_way(timeline: Timeline) -> NDArray[np.bool_]:
    """Return (n,) whether somebody was led and went on by themselves: the cycles that the paper's figures count."""
    return timeline.is_word("mode", *ON_THE_WAY)


def steps_s(timeline: Timeline) -> FloatArray:
    """Return how long each cycle (n,) lasted, until the next one."""
    return np.minimum(np.diff(timeline.stamps_s, append=timeline.stamps_s[-1]), LONGEST_STEP_S)


def stopped(timeline: Timeline) -> NDArray[np.bool_]:
    """Return (n,) whether the walker was told to stand on the way."""
    return led(timeline) & timeline.is_word("action", "stop")


def weak(timeline: Timeline) -> NDArray[np.bool_]:
    """Return (n,) whether the place in the map was not known for sure while somebody was led."""
    return led(timeline) & ~timeline.is_word("quality", "localized")


def off_road(timeline: Timeline) -> NDArray[np.bool_]:
    """Return (n,) whether guidance led back to the road."""
    return led(timeline) & timeline.is_word("reason", Reason.OFF_ROAD.value)


def disagreeing(timeline: Timeline) -> NDArray[np.bool_]:
    """Return (n,) whether the rangefinder heard something near where the depth camera saw free: glass, mostly."""
    heard_m, seen_m = timeline.numbers["sonar_m"], timeline.numbers["nearest_ahead_m"]
    found = led(timeline) & timeline.is_word("sonar_state", "ok") & (heard_m < HEARD_WITHIN_M)
    for index in np.flatnonzero(found).tolist():
        ahead_m = None if np.isnan(seen_m[index]) else float(seen_m[index])
        gap_m = sonar_gap_m("ok", float(heard_m[index]), ahead_m, timeline.word("reason", index))
        found[index] = gap_m is not None and gap_m > DISAGREE_BY_M
    return found


def marks_of(timeline: Timeline) -> tuple[Mark, ...]:
    """Return all marks of a walk, by time."""
    found = [
        *_lasting(timeline, "stop", stopped(timeline), lambda begin, end: _reason(timeline, begin, end)),
        *_lasting(timeline, "weak", weak(timeline), lambda begin, end: _quality(timeline, begin, end)),
        *_lasting(timeline, "off_road", off_road(timeline), lambda begin, end: _off_road(timeline, begin, end)),
        *_lasting(timeline, "disagreement", disagreeing(timeline), lambda begin, end: _heard(timeline, begin, end)),
        *_momentary(timeline),
    ]
    return tuple(sorted(found, key=lambda mark: (mark.at_s, mark.kind)))


def runs(timeline: Timeline, mask: NDArray[np.bool_]) -> Iterator[tuple[int, int]]:
    """Yield the runs of a mask (n,) that last: first cycle, and the one after the last; short gaps are passed over."""
    edges = np.flatnonzero(np.diff(mask.astype(np.int8), prepend=0, append=0))
    stamps_s = timeline.stamps_s
    joined: list[tuple[int, int]] = []
    for begin, end in edges.reshape(-1, 2).tolist():
        if joined and stamps_s[begin] - stamps_s[joined[-1][1] - 1] <= _LEAST_S:
            joined[-1] = (joined[-1][0], end)
        else:
            joined.append((begin, end))
    for begin, end in joined:
        if _length_s(timeline, begin, end) >= _LEAST_S:
            yield begin, end


def _length_s(timeline: Timeline, begin: int, end: int) -> float:
    stamps_s = timeline.stamps_s
    return float(stamps_s[min(end, len(stamps_s) - 1)] - stamps_s[begin])


def _lasting(
    timeline: Timeline, kind: MarkKind, mask: NDArray[np.bool_], words: Callable[[int, int], str]
) -> Iterator[Mark]:
    for begin, end in runs(timeline, mask):
        at_s = float(timeline.stamps_s[begin]) - timeline.began_s
        yield Mark(kind, at_s, _length_s(timeline, begin, end), words(begin, end), *place_of(timeline, begin))


def place_of(timeline: Timeline, index: int) -> tuple[float | None, float | None]:
    """Return where the walker was in a cycle, or where they were last known to be."""
    known = np.flatnonzero(np.isfinite(timeline.numbers["x_m"][: index + 1]))
    if not len(known):
        return None, None
    return float(timeline.numbers["x_m"][known[-1]]), float(timeline.numbers["y_m"][known[-1]])


def _reason(timeline: Timeline, begin: int, end: int) -> str:
    """Return why, in the sentence of the first cycle that has the reason which held longest."""
    codes = timeline.columns.codes["reason"][begin:end]
    longest = Counter(codes.tolist()).most_common(1)[0][0]
    return timeline.sentence_at(begin + int(np.argmax(codes == longest)))


def _quality(timeline: Timeline, begin: int, end: int) -> str:
    is_lost = bool(timeline.is_word("quality", "lost")[begin:end].any())
    return "The place in the map was lost." if is_lost else "The place in the map was uncertain."


def _off_road(timeline: Timeline, begin: int, end: int) -> str:
    off_m = timeline.numbers["deviation_m"][begin:end]
    return "Off the road." if np.isnan(off_m).all() else f"Off the road by up to {np.nanmax(off_m):.1f} m."


def _heard(timeline: Timeline, begin: int, end: int) -> str:
    heard_m = float(np.nanmin(timeline.numbers["sonar_m"][begin:end]))
    return f"The rangefinder heard something at {heard_m:.1f} m where the depth camera saw free: glass?"


def _momentary(timeline: Timeline) -> Iterator[Mark]:
    for event in timeline.events:
        kind: MarkKind = "cue" if event.kind == "cue" else "event"
        yield _at(timeline, kind, event.stamp_s, event.text)
    for order in timeline.orders:
        yield _at(timeline, "order", order.stamp_s, _order_words(order.kind, order.text))


def _at(timeline: Timeline, kind: MarkKind, stamp_s: float, text: str) -> Mark:
    at_s = min(max(stamp_s, timeline.began_s), timeline.ended_s) - timeline.began_s
    return Mark(kind, at_s, 0.0, text, *place_of(timeline, timeline.index_at(stamp_s)))


_ORDER_WORDS = {
    "SetDestination": "The console set a destination.",
    "Lead": "A destination was chosen.",
    "ClearDestination": "The console ended guidance.",
    "Pause": "The console paused guidance.",
    "Resume": "The console let guidance go on.",
    "Repeat": "The console had the last sentence said again.",
    "ApplySettings": "The console sent settings.",
    "ButtonPress": "The walker pressed a button.",
}


def _order_words(kind: str, content: str) -> str:
    if kind == "Say":
        said = _content(content).get("text", "")
        return f"The console said: “{said}”"
    if kind == "ButtonPress":
        return f"The walker pressed: {_content(content).get('button', 'a button')}."
    return _ORDER_WORDS.get(kind, kind)


def _content(text: str) -> dict[str, object]:
    try:
        return msgspec.json.decode(text, type=dict[str, object])
    except (msgspec.MsgspecError, RecursionError):
        return {}

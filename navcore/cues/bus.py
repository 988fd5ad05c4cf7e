"""One voice for all cues: what is heard now, what waits, what is dropped. A pure state machine.

A higher priority cuts a lower one off. An instruction that was cut off is said again if it still holds; a message from
its first sentence on that was not heard to its end. At the same level the newest is kept. Tones are short and come
again by themselves: they never wait, and they do not cut into words, except that a steering tone cuts off
announcements, which can wait, and answers, which can be asked for again.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

from navcore.cues.table import ASIDES, Cue, CueKind, CuePriority
from navcore.cues.texts import Language, speech_duration_s

_WAITS_AT_MOST_S = 4.0
_MESSAGE_WAITS_AT_MOST_S = 20.0
"""What is told once ("Another way", somebody at the console) is not lost behind a few turns on the spot."""
_PATIENT = frozenset({CueKind.MESSAGE, CueKind.MAP_NEWS})
_SENTENCE_END = re.compile(r"[.!?]\s+|[。\uff01\uff1f]")
_HEARD_FACTOR = 1.4
"""A sentence takes up to so many times as long as is reckoned, by the voice; until then it was not heard for sure."""
PAUSE_S = 0.1
"""Silence between two sentences."""


@dataclass(frozen=True, slots=True)
class CueBus:
    """What the walker hears at this moment, and what they shall hear next."""

    speaking: Cue | None = None
    """The last sentence that was begun."""
    until_s: float = float("-inf")
    """When it will have been spoken."""
    waiting: tuple[Cue, ...] = ()
    """Sentences that wait, at most one of each priority."""
    repeatable: Cue | None = None
    """The last sentence, for "repeat last"; none that is told beside guidance."""

    def is_speaking(self, now_s: float) -> bool:
        """Return whether a sentence is being spoken."""
        return now_s < self.until_s


def play(
    bus: CueBus, cues: Iterable[Cue], now_s: float, language: Language, holds: Callable[[Cue], bool]
) -> tuple[tuple[Cue, ...], CueBus]:
    """Return the cues to begin now, in order (at most one sentence, or one tone), and the new state.

    Args:
        bus: the state before.
        cues: what guidance would like to be heard.
        now_s: the present time.
        language: tells how long a sentence takes.
        holds: whether a sentence that waits, or is being spoken, is still true.
    """
    cues = tuple(cues)
    waiting = {cue.priority: cue for cue in bus.waiting if holds(cue) and _may_wait(cue, now_s)}
    waiting |= {cue.priority: cue for cue in cues if not cue.is_tone}
    # Words that are no longer true do not keep the next ones waiting.
    speaking = bus.speaking if bus.speaking is not None and bus.is_speaking(now_s) and holds(bus.speaking) else None
    chosen = waiting[max(waiting)] if waiting else None
    if chosen is not None and (speaking is None or _cuts_off(chosen, speaking)):
        return _begin(bus, chosen, speaking, waiting, now_s, language)
    tone = _best_tone(cues, speaking)
    if tone is None:
        return (), CueBus(bus.speaking, bus.until_s, tuple(waiting.values()), bus.repeatable)
    if speaking is not None:
        waiting.setdefault(speaking.priority, _not_heard(speaking, bus, now_s, language))
    return (tone,), CueBus(bus.speaking, min(bus.until_s, now_s), tuple(waiting.values()), bus.repeatable)


def _may_wait(cue: Cue, now_s: float) -> bool:
    longest_s = _MESSAGE_WAITS_AT_MOST_S if cue.kind in _PATIENT else _WAITS_AT_MOST_S
    return now_s - cue.stamp_s <= longest_s


def _begin(
    bus: CueBus, chosen: Cue, speaking: Cue | None, waiting: dict[CuePriority, Cue], now_s: float, language: Language
) -> tuple[tuple[Cue, ...], CueBus]:
    rest = {priority: cue for priority, cue in waiting.items() if cue is not chosen}
    if speaking is not None and speaking.priority < chosen.priority:
        rest.setdefault(speaking.priority, _not_heard(speaking, bus, now_s, language))
    until_s = now_s + _takes_s(chosen, chosen.text, language)
    repeatable = bus.repeatable if chosen.kind in ASIDES else chosen
    return (chosen,), CueBus(chosen, until_s, tuple(rest.values()), repeatable)


def _takes_s(cue: Cue, text: str, language: Language) -> float:
    return cue.duration_s + speech_duration_s(text, language) + PAUSE_S


def _not_heard(speaking: Cue, bus: CueBus, now_s: float, language: Language) -> Cue:
    """Return what is to be said again of a cue that is cut off now.

    Of a message the sentences that were heard are not said again: "The way is blocked" would be heard with each of a
    few turns. An instruction is told whole, for half of one could be another.
    """
    if speaking.kind not in _PATIENT or speaking.repeats is not None:
        return speaking
    said_s = now_s - (bus.until_s - _takes_s(speaking, speaking.text, language))
    ends = [match.end() for match in _SENTENCE_END.finditer(speaking.text) if match.end() < len(speaking.text)]
    heard = [end for end in ends if _HEARD_FACTOR * _takes_s(speaking, speaking.text[:end], language) <= said_s]
    return replace(speaking, text=speaking.text[heard[-1] :]) if heard else speaking


def _cuts_off(cue: Cue, speaking: Cue) -> bool:
    """The same words again are no news; else the same level keeps the newest, and a higher one always goes first."""
    return cue.priority > speaking.priority or (cue.priority == speaking.priority and cue.text != speaking.text)


def _best_tone(cues: tuple[Cue, ...], speaking: Cue | None) -> Cue | None:
    tones = [cue for cue in cues if cue.is_tone]
    # Where to go is heard before how near something is: the beeps come again soon.
    tones.sort(key=lambda cue: (cue.kind is not CueKind.STEER, -cue.priority))
    if not tones or (speaking is not None and not _may_interrupt(tones[0], speaking)):
        return None
    return tones[0]


def _may_interrupt(tone: Cue, speaking: Cue) -> bool:
    can_wait = speaking.priority <= CuePriority.REASSURANCE or speaking.kind is CueKind.ANSWER
    return tone.kind is CueKind.STEER and can_wait

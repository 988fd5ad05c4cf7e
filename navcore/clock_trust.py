"""How far a machine's clock may be believed when what is too old is to be deleted for good.

A clock can be set: by hours or years, forwards or back, by somebody, by the network, or by a battery that is empty.
What is deleted because a clock once said ten years more never comes back. So time is taken for no more than what has
certainly passed, until a clock that has leapt ahead has gone on evenly for a day, or is told the time by the network.

A machine without a clock of its own begins each time in 1970, or where it ended, and is told the time a while later. So
what was known is kept while a clock is set back, and the first step after a start may be the time of having been off.
Pure.
"""

from __future__ import annotations

import msgspec

LEAP_S = 3600.0
"""By so much a clock may be ahead of what has passed, or behind it, and count as merely corrected."""
LONGEST_OFF_S = 3 * 86_400.0
"""So long a machine may have been off, for all that its clock says, without being asked whether it is right."""
EVEN_FOR_S = 86_400.0
"""A clock that has leapt ahead, or was set back, is believed once it has gone on evenly for so long."""
_ONE_START_COUNTS_S = EVEN_FOR_S / 2
"""No more of the time between two starts counts as having gone on evenly."""


class SetBack(msgspec.Struct, frozen=True):
    """A clock that shows a time that has long passed."""

    known: ClockTrust
    """What was known before, with the time that has passed since."""
    for_s: float = 0.0
    """How long it has gone on evenly like that."""


class ClockTrust(msgspec.Struct, frozen=True):
    """What is known of a clock, from one look at it to the next; kept over restarts."""

    trusted_s: float
    """Unix time by which things are old: it has come for certain, or is believed to have; no later than shown."""
    shown_s: float
    """What the clock showed at the last look."""
    even_for_s: float | None = None
    """How long it has gone on evenly since it leapt ahead; None while it is believed."""
    may_have_been_off: bool = False
    """There was a start, and the clock has made no step since that tells how long the machine was off."""
    set_back: SetBack | None = None
    """None while the clock is not set back."""


def looked_at(before: ClockTrust, now_s: float, passed_s: float | None, *, synchronised: bool = False) -> ClockTrust:
    """Return what is known after another look.

    Args:
        before: what was known.
        now_s: what the clock shows (Unix time).
        passed_s: how much time has passed since the last look by a clock that nobody sets; None where nothing tells,
            as at a start.
        synchronised: the network has told the clock the time.
    """
    if synchronised:
        return ClockTrust(now_s, now_s)
    known = _with_passed(before if before.set_back is None else before.set_back.known, passed_s or 0.0)
    may_have_been_off = before.may_have_been_off or passed_s is None
    if now_s < _earliest_s(known, may_have_been_off) - LEAP_S:
        return _set_back(before, known, now_s, passed_s, may_have_been_off)
    step_s = now_s - known.shown_s
    off = passed_s is None or (may_have_been_off and step_s > LEAP_S)
    still_off = may_have_been_off and step_s <= LEAP_S
    longest_s = LONGEST_OFF_S if off and known.even_for_s is None else LEAP_S
    even_for_s = 0.0 if known.even_for_s is None else max(0.0, known.even_for_s + _even_s(step_s, passed_s, off))
    if now_s <= known.trusted_s + longest_s or even_for_s >= EVEN_FOR_S:
        return ClockTrust(now_s, now_s, None, still_off)
    return ClockTrust(known.trusted_s, now_s, even_for_s, still_off)


def _with_passed(known: ClockTrust, passed_s: float) -> ClockTrust:
    """Return what is known, with what would be shown now if the clock had gone on."""
    return ClockTrust(known.trusted_s + passed_s, known.shown_s + passed_s, known.even_for_s)


def _earliest_s(known: ClockTrust, may_have_been_off: bool) -> float:
    """Return what a clock that is not set back shows at least; one that has leapt may be set right while it runs."""
    return known.shown_s if may_have_been_off and known.even_for_s is not None else known.trusted_s


def _set_back(
    before: ClockTrust, known: ClockTrust, now_s: float, passed_s: float | None, may_have_been_off: bool
) -> ClockTrust:
    """Return what is known of a clock that shows less than has passed: nothing that it makes younger is deleted."""
    step_s = now_s - before.shown_s
    # A clock that begins in 1970 at each start goes on like no clock.
    is_even = step_s >= 0.0 if passed_s is None else abs(step_s - passed_s) <= LEAP_S
    for_s = before.set_back.for_s + (passed_s or 0.0) if before.set_back is not None and is_even else 0.0
    if for_s >= EVEN_FOR_S:
        return ClockTrust(now_s, now_s)
    return ClockTrust(min(now_s, known.trusted_s), now_s, None, may_have_been_off, SetBack(known, for_s))


def _even_s(step_s: float, passed_s: float | None, off: bool) -> float:
    """Return how much more a clock has gone on evenly, that shows ``step_s`` more than what has passed."""
    if off:
        return min(max(0.0, step_s), _ONE_START_COUNTS_S)
    return passed_s or 0.0 if abs(step_s) <= LEAP_S else -EVEN_FOR_S

"""How far a machine's clock may be believed when what is too old is to be deleted for good.

A clock can be set: by hours or years, forwards or back, by somebody, by the network, or by a battery that is empty.
What is deleted because a clock once said ten years more never comes back. So time is taken for no more than what has
certainly passed, until a clock that has leapt ahead has gone on evenly for a day. Pure.
"""

from __future__ import annotations

import msgspec

LEAP_S = 3600.0
"""By so much a clock may be ahead of what has passed, and count as merely corrected."""
LONGEST_OFF_S = 3 * 86_400.0
"""So long a machine may have been off, for all that its clock says, without being asked whether it is right."""
EVEN_FOR_S = 86_400.0
"""A clock that has leapt is believed once it has gone on evenly for so long."""
_ONE_START_COUNTS_S = EVEN_FOR_S / 2
"""No more of the time between two starts counts as having gone on evenly."""


class ClockTrust(msgspec.Struct, frozen=True):
    """What is known of a clock, from one look at it to the next; kept over restarts."""

    trusted_s: float
    """Unix time that has come for certain, or is believed to have."""
    shown_s: float
    """What the clock showed at the last look."""
    even_for_s: float | None = None
    """How long it has gone on evenly since it leapt ahead; None while it is believed."""


def looked_at(before: ClockTrust, now_s: float, passed_s: float | None) -> ClockTrust:
    """Return what is known after another look.

    Args:
        before: what was known.
        now_s: what the clock shows (Unix time).
        passed_s: how much time has passed since the last look by a clock that nobody sets; None where nothing tells,
            as at a start.
    """
    certain_s = before.trusted_s + (passed_s or 0.0)
    if now_s <= certain_s + LEAP_S:
        return ClockTrust(now_s, now_s)
    if before.even_for_s is None and passed_s is None and now_s <= before.trusted_s + LONGEST_OFF_S:
        return ClockTrust(now_s, now_s)
    even_for_s = 0.0 if before.even_for_s is None else before.even_for_s + _even_s(now_s - before.shown_s, passed_s)
    if even_for_s >= EVEN_FOR_S:
        return ClockTrust(now_s, now_s)
    return ClockTrust(certain_s, now_s, max(0.0, even_for_s))


def _even_s(shown_passed_s: float, passed_s: float | None) -> float:
    if passed_s is None:
        return min(max(0.0, shown_passed_s), _ONE_START_COUNTS_S)
    return passed_s if abs(shown_passed_s - passed_s) <= LEAP_S else -EVEN_FOR_S

"""How often the message table lets a message go: what its sender keeps to, and how its receiver notices who does not.

Pure: the time is handed in.
"""

from __future__ import annotations

from collections.abc import Mapping

import msgspec

from navcore.wire_row import Direction, MessageRow

BURST_S = 30.0
"""A network may hold back so much and deliver it at once: longer ones are found out by pings, which break the link."""


class Pace:
    """Allows something so often on average, and no faster than twice that for a moment."""

    def __init__(self, rate_hz: float) -> None:
        self._period_s = 1.0 / rate_hz
        self._due_s = -1e9

    def wait_s(self, now_s: float) -> float:
        """Return how long it is until the next one is due; 0 or less when it is."""
        return self._due_s - now_s

    def went(self, now_s: float) -> None:
        """Take note that one went."""
        self._due_s = max(self._due_s, now_s - 0.5 * self._period_s) + self._period_s


class Allowance:
    """Counts what comes in (a token bucket): a sender who keeps to the rate never exceeds it, however the network jams.

    Whoever sends at more than the rate exceeds it after, at the most, ``BURST_S`` times the rate.
    """

    def __init__(self, rate_hz: float, now_s: float) -> None:
        self._rate_hz = rate_hz
        self._left_count = self._most_count = BURST_S * rate_hz
        self._at_s = now_s

    def take(self, now_s: float) -> bool:
        """Count one; return whether it was still allowed."""
        passed_s, self._at_s = now_s - self._at_s, now_s
        self._left_count = min(self._most_count, self._left_count + self._rate_hz * max(0.0, passed_s))
        if self._left_count < 1.0:
            return False
        self._left_count -= 1.0
        return True


class Allowances:
    """What may come in one direction of a connection, by the message table: an :class:`Allowance` of each message."""

    def __init__(self, table: Mapping[type[msgspec.Struct], MessageRow], direction: Direction, now_s: float) -> None:
        self._by_kind = {
            kind: Allowance(row.rate_hz, now_s)
            for kind, row in table.items()
            if row.direction is direction and row.rate_hz is not None
        }

    def take(self, kind: type[msgspec.Struct], now_s: float) -> bool:
        """Count one message; return whether it was still allowed."""
        allowance = self._by_kind.get(kind)
        return allowance is None or allowance.take(now_s)

"""Clocks: the steady one of the machine, and one that a test moves by hand."""

from __future__ import annotations

import threading
import time


class SystemClock:
    """Seconds since 1970 as they were at the start, and steady from then on: no leap when the machine's time is set.

    Stamps of events therefore still mean something after a restart.
    """

    def __init__(self) -> None:
        self._offset_s = time.time() - time.monotonic()

    def now_s(self) -> float:
        """Seconds."""
        return self._offset_s + time.monotonic()

    def sleep_until(self, stamp_s: float) -> None:
        """Wait in real time."""
        delay_s = stamp_s - self.now_s()
        if delay_s > 0:
            time.sleep(delay_s)


class FakeClock:
    """A clock that stands still until somebody calls :meth:`advance`; any thread may sleep on it."""

    def __init__(self, now_s: float = 0.0) -> None:
        self._now_s = now_s
        self._changed = threading.Condition()
        self._wake_at_s: list[float] = []

    def now_s(self) -> float:
        """Seconds."""
        with self._changed:
            return self._now_s

    def sleep_until(self, stamp_s: float) -> None:
        """Wait until another thread has advanced the clock that far."""
        with self._changed:
            self._wake_at_s.append(stamp_s)
            self._changed.notify_all()
            self._changed.wait_for(lambda: self._now_s >= stamp_s)
            self._wake_at_s.remove(stamp_s)

    def advance(self, seconds: float) -> None:
        """Move time forward and wake whoever's hour has come."""
        with self._changed:
            self._now_s += seconds
            self._changed.notify_all()

    def wait_for_sleepers(self, count: int, timeout_s: float = 10.0) -> None:
        """Return when at least ``count`` threads sleep whose hour has not come yet. Raises TimeoutError."""
        with self._changed:
            if not self._changed.wait_for(lambda: self._asleep() >= count, timeout_s):
                raise TimeoutError(f"fewer than {count} threads sleep on the clock")

    def _asleep(self) -> int:
        return sum(stamp_s > self._now_s for stamp_s in self._wake_at_s)


class SteppedClock:
    """A clock of one thread: sleeping *is* the passing of time."""

    def __init__(self, now_s: float = 0.0) -> None:
        self._now_s = now_s

    def now_s(self) -> float:
        """Seconds."""
        return self._now_s

    def sleep_until(self, stamp_s: float) -> None:
        """Jump there."""
        self._now_s = max(self._now_s, stamp_s)

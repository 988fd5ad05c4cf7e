"""Slows down whoever tries passwords: a few free failures, then a wait that grows."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable

from console.errors import TooManyError

FREE_FAILURES_COUNT = 5
FIRST_WAIT_S = 5.0
LONGEST_WAIT_S = 300.0
FORGOTTEN_AFTER_S = 900.0
REMEMBERED_COUNT = 10_000


class SignInLimit:
    """Counts failures by key (a name at an address, or an address). Thread-safe; ``now_s`` is a steady clock."""

    def __init__(self, now_s: Callable[[], float], free_failures_count: int = FREE_FAILURES_COUNT) -> None:
        self._now_s = now_s
        self._free_count = free_failures_count
        self._lock = threading.Lock()
        self._failures: OrderedDict[str, tuple[int, float]] = OrderedDict()

    def check(self, key: str) -> None:
        """Raise TooManyError while the key has to wait."""
        with self._lock:
            count, last_s = self._failures.get(key, (0, 0.0))
            wait_s = last_s + self._wait_s(count) - self._now_s()
        if count >= self._free_count and wait_s > 0.0:
            raise TooManyError(f"Too many attempts: try again in {max(1, round(wait_s))} seconds.", wait_s)

    def failed(self, key: str) -> None:
        """Count a failure."""
        with self._lock:
            now_s = self._now_s()
            count, last_s = self._failures.pop(key, (0, now_s))
            count = 0 if now_s - last_s > FORGOTTEN_AFTER_S else count
            self._failures[key] = (count + 1, now_s)
            while len(self._failures) > REMEMBERED_COUNT:
                self._failures.popitem(last=False)

    def succeeded(self, key: str) -> None:
        """Forget the failures of a key."""
        with self._lock:
            self._failures.pop(key, None)

    def _wait_s(self, count: int) -> float:
        return float(min(LONGEST_WAIT_S, FIRST_WAIT_S * 2.0 ** min(20, max(0, count - self._free_count))))

"""Slows down whoever tries passwords: a few free attempts, then a wait that grows."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from ipaddress import IPv6Address, ip_address

from console.errors import TooManyError

FREE_FAILURES_COUNT = 5
FIRST_WAIT_S = 5.0
LONGEST_WAIT_S = 300.0
FORGOTTEN_AFTER_S = 900.0
REMEMBERED_COUNT = 10_000
_IPV6_NETWORK_BITS = 64


@dataclass(frozen=True, slots=True)
class Attempt:
    """An attempt that counts as failed until it is known to have succeeded."""

    key: str
    last_before_s: float
    at_s: float


class SignInLimit:
    """Counts failures by key (a name at an address, or an address). Thread-safe; ``now_s`` is a steady clock."""

    def __init__(
        self,
        now_s: Callable[[], float],
        free_failures_count: int = FREE_FAILURES_COUNT,
        longest_wait_s: float = LONGEST_WAIT_S,
    ) -> None:
        self._now_s = now_s
        self._free_count = free_failures_count
        self._longest_wait_s = longest_wait_s
        self._lock = threading.Lock()
        self._failures: OrderedDict[str, tuple[int, float]] = OrderedDict()

    def attempt(self, key: str) -> Attempt:
        """Count an attempt, before it is judged: many at once are as many as one after the other.

        Raises TooManyError while the key has to wait; that attempt does not count.
        """
        with self._lock:
            now_s = self._now_s()
            count, last_s = self._failures.get(key, (0, now_s))
            wait_s = last_s + self._wait_s(count) - now_s
            if count >= self._free_count and wait_s > 0.0:
                raise TooManyError(f"Too many attempts: try again in {max(1, round(wait_s))} seconds.", wait_s)
            count = 0 if now_s - last_s > FORGOTTEN_AFTER_S else count
            self._keep(key, count + 1, now_s)
        return Attempt(key, last_s, now_s)

    def succeeded(self, attempt: Attempt) -> None:
        """Take back that an attempt has failed; what failed before and beside it stays."""
        with self._lock:
            count, last_s = self._failures.get(attempt.key, (0, 0.0))
            if count > 1:
                self._keep(attempt.key, count - 1, attempt.last_before_s if last_s == attempt.at_s else last_s)
            else:
                self._failures.pop(attempt.key, None)

    def forget(self, key: str) -> None:
        """Forget the failures of a key."""
        with self._lock:
            self._failures.pop(key, None)

    def _keep(self, key: str, count: int, last_s: float) -> None:
        self._failures[key] = (count, last_s)
        self._failures.move_to_end(key)
        while len(self._failures) > REMEMBERED_COUNT:
            self._failures.popitem(last=False)

    def _wait_s(self, count: int) -> float:
        doublings = min(20, max(0, count - self._free_count))
        return min(self._longest_wait_s, FIRST_WAIT_S * 2.0**doublings)


def network_of(address: str) -> str:
    """Return whom an address counts for: a household has as many addresses of IPv6 as it likes, but one network."""
    try:
        parsed = ip_address(address)
    except ValueError:
        return address
    if isinstance(parsed, IPv6Address):
        if parsed.ipv4_mapped is not None:
            return str(parsed.ipv4_mapped)
        return str(IPv6Address(int(parsed) >> _IPV6_NETWORK_BITS << _IPV6_NETWORK_BITS))
    return address

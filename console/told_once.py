"""What is wrong again and again is told now and then: nobody who sends nonsense all day fills the log."""

from __future__ import annotations

from collections.abc import Callable

EVERY_S = 60.0


class ToldOnce:
    """Says of each cause whether it is to be told again. For one thread; as many causes as are named are remembered."""

    def __init__(self, now_s: Callable[[], float], every_s: float = EVERY_S) -> None:
        self._now_s, self._every_s = now_s, every_s
        self._told_s: dict[str, float] = {}

    def is_due(self, cause: str) -> bool:
        """Return whether this has not been told for a while, and take it as told now."""
        now_s = self._now_s()
        if now_s - self._told_s.get(cause, -self._every_s) < self._every_s:
            return False
        self._told_s[cause] = now_s
        return True

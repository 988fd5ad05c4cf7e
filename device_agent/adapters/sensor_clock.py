"""A sensor's own stamps, put on the device's clock."""

from __future__ import annotations

import math
from collections.abc import Callable

from device_agent.ports import Clock

WINDOW_S = 10.0
"""Clocks drift apart by less than a millisecond in this time."""
_PLAUSIBLE_AGE_S = (-0.1, 5.0)


class SensorClock:
    """Tells when, on the device's clock, a sensor took what it stamped with its own clock.

    Where the machine can read the very clock that the stamps are made with (``host_now_s``), a stamp's age is exact.
    Elsewhere nobody knows how long a message was under way: the shortest delay of the last seconds counts as none. What
    waited in a buffer is still found to be old, for it comes later than others did.
    """

    def __init__(self, clock: Clock, host_now_s: Callable[[], float] | None = None) -> None:
        self._clock = clock
        self._host_now_s = host_now_s
        self._is_exact: bool | None = None if host_now_s is not None else False
        self._window_began_s = -math.inf
        self._shortest_s = math.inf
        self._shortest_before_s = math.inf

    def stamp_s(self, sensor_s: float) -> float:
        """Return the time on the device's clock, never after now, of a stamp that has just arrived.

        Args:
            sensor_s: the sensor's own stamp, seconds from any origin; NaN stays NaN.
        """
        now_s = self._clock.now_s()
        if self._host_now_s is not None and self._is_exact is not False:
            age_s = self._host_now_s() - sensor_s
            if self._is_exact is None:
                # Some drivers stamp with another clock than they ought to: the first stamp tells.
                self._is_exact = _PLAUSIBLE_AGE_S[0] <= age_s <= _PLAUSIBLE_AGE_S[1]
            if self._is_exact:
                return now_s - max(age_s, 0.0) if math.isfinite(age_s) else math.nan
        return self._by_shortest_delay(sensor_s, now_s)

    def _by_shortest_delay(self, sensor_s: float, now_s: float) -> float:
        if not math.isfinite(sensor_s):
            return math.nan
        if now_s - self._window_began_s > WINDOW_S:
            self._shortest_before_s, self._shortest_s, self._window_began_s = self._shortest_s, math.inf, now_s
        self._shortest_s = min(self._shortest_s, now_s - sensor_s)
        return sensor_s + min(self._shortest_s, self._shortest_before_s)

"""Where down is, from an accelerometer that somebody carries about."""

from __future__ import annotations

import math

import numpy as np

from navcore.geometry import FloatArray

TIME_CONSTANT_S = 0.5
"""About one step: what a step adds to gravity is taken off again before the next one."""
FRESH_FOR_S = 0.5
_PLAUSIBLE_M_S2 = (7.0, 13.0)
"""A mean beyond these is no gravity: the sensor is broken, or falls."""


class GravityFilter:
    """The mean acceleration of the last half second; at rest an accelerometer measures gravity, pointing up."""

    def __init__(self) -> None:
        self._mean_m_s2: FloatArray | None = None
        self._stamp_s = -math.inf

    def add(self, stamp_s: float, acceleration_m_s2: FloatArray) -> None:
        """Take a sample (3,) in the camera's frame; one that is not newer, or no number, is left out."""
        if not (stamp_s > self._stamp_s and np.isfinite(acceleration_m_s2).all()):
            return
        passed_s = stamp_s - self._stamp_s
        if self._mean_m_s2 is None or passed_s > FRESH_FOR_S:
            self._mean_m_s2 = np.asarray(acceleration_m_s2, dtype=np.float64)
        else:
            share = 1.0 - math.exp(-passed_s / TIME_CONSTANT_S)
            self._mean_m_s2 = self._mean_m_s2 + share * (acceleration_m_s2 - self._mean_m_s2)
        self._stamp_s = stamp_s

    def down(self, stamp_s: float) -> FloatArray | None:
        """Return the unit vector (3,) that points down in the camera's frame at a time; None where it is not known."""
        if self._mean_m_s2 is None or not abs(stamp_s - self._stamp_s) <= FRESH_FOR_S:
            return None
        length_m_s2 = float(np.linalg.norm(self._mean_m_s2))
        if not _PLAUSIBLE_M_S2[0] <= length_m_s2 <= _PLAUSIBLE_M_S2[1]:
            return None
        down: FloatArray = -self._mean_m_s2 / length_m_s2
        return down

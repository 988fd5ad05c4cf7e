"""The ultrasonic gate (Eq. 5): the last check before a direction reaches the walker.

It trusts nothing of what it is handed: a direction that it cannot show to be free is closed.
"""

from __future__ import annotations

import math

from navcore.angles import RelativeAngle, wrap_rad
from navcore.settings import GateSettings
from navcore.types import SonarReading, SonarState

FULL_RANGE_M = 4.25
"""No echo counts as the sensor's full range."""
BLIND_STATES = frozenset({SonarState.STALE, SonarState.ABSENT})
"""States in which guidance goes on with depth only, says so once, and raises an alert."""


def current_reading(reading: SonarReading | None, now_s: float, settings: GateSettings) -> SonarReading:
    """Return the reading as it counts now: one too old, or from the future, is STALE; none at all is ABSENT."""
    if reading is None:
        return SonarReading(now_s, SonarState.ABSENT)
    if reading.state in BLIND_STATES:
        return SonarReading(reading.stamp_s, reading.state)
    if abs(now_s - reading.stamp_s) > settings.stale_after_s:
        return SonarReading(reading.stamp_s, SonarState.STALE)
    return reading


def echo_distance_m(reading: SonarReading) -> float | None:
    """Return d_ultra; the full range for NO_ECHO, 0 for an OK that names no usable distance, None where blind."""
    if reading.state in BLIND_STATES:
        return None
    if reading.state is SonarState.NO_ECHO:
        return FULL_RANGE_M
    distance_m = reading.distance_m
    return distance_m if distance_m is not None and math.isfinite(distance_m) and distance_m >= 0.0 else 0.0


def is_open(direction: RelativeAngle, reading: SonarReading, required_m: float, settings: GateSettings) -> bool:
    """Return whether a direction may be walked (Eq. 5).

    Outside the ultrasonic field, which lies about where the rangefinder looks, it may; inside it only where the echo is
    farther than required (δ, or the sub-goal and a margin where that is nearer). Without a working sensor the depth
    camera alone decides. The printed equation says nothing of "no echo", of a stale reading, or of no sensor.
    """
    if not math.isfinite(direction):
        return False
    distance_m = echo_distance_m(reading)
    if distance_m is None:
        return True
    # A bearing that is no number puts every direction inside the field.
    if abs(wrap_rad(direction - reading.bearing_rad)) > math.radians(settings.half_field_deg):
        return True
    return distance_m > required_m


def walking_direction(
    optimal: RelativeAngle | None, reading: SonarReading, required_m: float, settings: GateSettings
) -> RelativeAngle | None:
    """Return θ_walk: θ_opt where the gate is open, else None (Eq. 5)."""
    if optimal is None or not is_open(optimal, reading, required_m, settings):
        return None
    return optimal

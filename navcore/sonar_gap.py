"""Where the rangefinder hears something that the depth camera does not see: glass, mostly. One measure for everybody.

Alerts, past walks and the sentence that explains a decision all ask here, so that none of them says *glass* where the
depth camera only had nothing to say.
"""

from __future__ import annotations

from navcore.types import Reason

DEPTH_RANGE_M = 6.0
"""Where the depth camera sees nothing, it is free at least so far."""
NOT_SEEN = frozenset({Reason.DEPTH_INVALID.value, Reason.SENSOR_STALE.value})
"""A stop for one of these says that the depth camera is not believed: that it tells of nothing is no free space."""


def sonar_gap_m(sonar_state: str, sonar_m: float | None, seen_m: float | None, reason: str) -> float | None:
    """Return how much farther the depth camera sees free than the rangefinder hears something (m).

    Args:
        sonar_state: ``ok``, ``no_echo``, ``stale`` or ``absent``, as in ``navcore.wire.WalkerState``.
        sonar_m: distance of what is heard; None where nothing is.
        seen_m: distance of what the depth camera sees nearest in the same place; None where it sees nothing there.
        reason: of the decision, as ``navcore.types.Reason`` value.

    Returns:
        0 where nothing is heard, negative where something nearer is seen; None where either sensor is not believed.
    """
    if reason in NOT_SEEN or sonar_state not in ("ok", "no_echo"):
        return None
    if sonar_state == "no_echo" or sonar_m is None:
        return 0.0
    return (DEPTH_RANGE_M if seen_m is None else seen_m) - sonar_m

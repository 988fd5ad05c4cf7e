"""Ways through a building: the recorded walk, longer where wanted."""

from __future__ import annotations

from device_agent.simulation.walk import plan_walk
from navcore.errors import InputError

Waypoints = tuple[tuple[float, float], ...]
_LONGEST_M = 1000.0


def lengthened(waypoints_m: Waypoints, seed: int, min_length_m: float) -> Waypoints:
    """Begin the walk again at its end until it is at least so long. Raises InputError for more than a kilometre.

    The walk of these way points must end where it began.
    """
    if not min_length_m <= _LONGEST_M:
        raise InputError(f"A walk of {min_length_m:g} m is too long to be simulated: ask for {_LONGEST_M:g} m at most.")
    points, following = list(waypoints_m), 1
    while plan_walk(tuple(points), seed).length_m < min_length_m:
        points.append(waypoints_m[following])
        following = following % (len(waypoints_m) - 1) + 1
    return tuple(points)

"""Ways through a building: the recorded walk, longer where wanted, or begun where nobody expects it."""

from __future__ import annotations

import math

import numpy as np

from device_agent.simulation.building import Building, checked_seed, push_from_solids, touchable
from device_agent.simulation.walk import plan_walk
from navcore.errors import InputError

Waypoints = tuple[tuple[float, float], ...]
_LONGEST_M = 1000.0
_ATTEMPTS = 500
_APPROACH_M = 1.8
"""Length of road on which somebody who begins beside it reaches it."""
_BESIDE_M = (0.15, 0.7)
_CLEAR_M = 0.4
_AWAY_M = 3.0
"""A kidnapped walk begins farther than this from where the recorded one does."""


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


def kidnapped_route(building: Building, waypoints_m: Waypoints, seed: int) -> tuple[Waypoints, float]:
    """Begin a way somewhere along it, beside the road; return it with the heading (rad) in which it begins.

    Raises InputError where no such place is free.
    """
    rng = np.random.default_rng([checked_seed(seed), 13])
    solids = touchable(building.solids)
    corners = np.asarray(waypoints_m, np.float64)
    lengths = np.hypot(*np.diff(corners, axis=0).T)
    for _ in range(_ATTEMPTS):
        leg = int(rng.choice(len(lengths), p=lengths / lengths.sum()))
        if lengths[leg] <= _APPROACH_M:
            continue
        along = (corners[leg + 1] - corners[leg]) / lengths[leg]
        beside = float(rng.uniform(*_BESIDE_M)) * float(rng.choice([-1.0, 1.0]))
        start = corners[leg] + along * float(rng.uniform(0.0, lengths[leg] - _APPROACH_M))
        start = start + beside * np.array([-along[1], along[0]])
        way = np.linspace(start, corners[leg + 1], 30)
        is_clear = all(push_from_solids(solids, float(x), float(y))[0] > _CLEAR_M for x, y in way)
        if is_clear and math.dist(start, waypoints_m[0]) > _AWAY_M:
            rest = (*waypoints_m[leg + 1 :], *(waypoints_m[1:] if waypoints_m[0] == waypoints_m[-1] else ()))
            return ((float(start[0]), float(start[1])), *rest), float(rng.uniform(-math.pi, math.pi))
    raise InputError(f"No free place was found beside the road of {building.name}: choose another seed.")

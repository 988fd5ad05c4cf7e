"""What a course forces: how far beside the road somebody must be, in the mean, who passes all that stands on it.

The least line is found by dynamic programming: at each station of the planned route a distance to its left or right, so
that nothing is nearer than a person needs, that the line never slants more than people can be steered, and that the
mean distance is smallest. Whoever knew everything beforehand, and never swayed, would have that mean.

The model walkers sway. So their own distances from the same route where nothing stands on it (Experiment 1) are added
to the line, station by station; the mean of the sums is what the same guidance would reach with the same walkers if
every obstacle were known from the beginning, and cost nobody a turn or a step. People who walk are left out.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from device_agent.experiments.course import COURSES, with_course
from device_agent.experiments.running import Figures
from device_agent.simulation.building import push_from_solids, touchable
from device_agent.simulation.office_floor import office_floor
from navcore.geometry import FloatArray
from navcore.planning.road_joining import evenly_spaced

_STATION_M, _STEP_M = 0.1, 0.02
_FARTHEST_M = 1.2
_SLANT = 0.4
"""About 20°: turned farther aside, somebody is led no more along the road, but away from it."""
DistanceTo = Callable[[float, float], float]
"""Distance from a point (x, y) to the nearest thing, metres; negative inside."""


def least_line_m(stations: FloatArray, left: FloatArray, distance_to: DistanceTo, needed_m: float) -> FloatArray | None:
    """Return how far left (n,) of the stations of a route the least line is; None where there is no room for one.

    Args:
        stations: points (n, 2) of the route, 0.1 m apart.
        left: unit vectors (n, 2) to its left there.
        distance_to: how near things are.
        needed_m: how far a person's middle must be from everything.
    """
    offsets_m = np.round(np.arange(-_FARTHEST_M, _FARTHEST_M + _STEP_M / 2, _STEP_M), 6)
    places = stations[:, None, :] + offsets_m[None, :, None] * left[:, None, :]
    room_m = np.array([[distance_to(float(x), float(y)) for x, y in row] for row in places])
    cost = np.where(room_m >= needed_m, np.abs(offsets_m), np.inf)
    reach = int(_SLANT * _STATION_M / _STEP_M + 1e-9)
    total, came_from = cost[0], []
    for here in cost[1:]:
        padded = np.pad(total, reach, constant_values=np.inf)
        before = np.stack([padded[k : k + len(total)] for k in range(2 * reach + 1)])
        came_from.append(before.argmin(axis=0) - reach)
        total = before.min(axis=0) + here
    at = int(total.argmin())
    if not np.isfinite(total[at]):
        return None
    chosen = [at]
    for steps in reversed(came_from):
        chosen.append(chosen[-1] + int(steps[chosen[-1]]))
    return np.asarray(offsets_m[chosen[::-1]], dtype=np.float64)


def forced_means_m(walks: Sequence[Figures], needed_m: float) -> dict[tuple[str, str], float]:
    """Return, by path and walker, the mean distance from the route that its course leaves to these walkers, metres.

    Only where the batch has walks of Experiment 1 with the policy ``road_centred``, whose sway is taken.

    Args:
        walks: the batch.
        needed_m: how far a person's middle must be from everything.
    """
    free: dict[tuple[str, str], list[Figures]] = {}
    for walk in walks:
        if (walk.experiment, walk.policy) == (1, "road_centred") and len(walk.route_m) > 1 and len(walk.path_m) > 1:
            free.setdefault((walk.path, walk.sight), []).append(walk)
    means = {key: _forced_mean_m(same, needed_m) for key, same in free.items()}
    return {key: mean_m for key, mean_m in means.items() if mean_m is not None}


def _forced_mean_m(walks: Sequence[Figures], needed_m: float) -> float | None:
    stations, left = stations_of(np.array(walks[0].route_m))
    swayed = [_sway_m(stations, left, np.array(walk.path_m)) for walk in walks]
    # Who has arrived is stopped before the end, which may lie nearer to a wall than a person needs.
    walked = max(int(at.max()) for at, _ in swayed) + 1
    line_m = least_line_m(stations[:walked], left[:walked], course_of(walks[0].path), needed_m)
    if line_m is None:
        return None
    return float(np.concatenate([np.abs(line_m[at] + sway_m) for at, sway_m in swayed]).mean())


def course_of(path: str) -> DistanceTo:
    """Return how near to anything that stands on a path a point of the building is, an open hatch included."""
    solids, hole = touchable(with_course(office_floor(), path).solids), COURSES[path].hole_m

    def distance_to(x_m: float, y_m: float) -> float:
        nearest_m = push_from_solids(solids, x_m, y_m)[0]
        if hole is None:
            return nearest_m
        x0, y0, x1, y1 = hole
        return min(nearest_m, math.hypot(max(x0 - x_m, 0.0, x_m - x1), max(y0 - y_m, 0.0, y_m - y1)))

    return distance_to


def stations_of(route_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return points (n, 2) of the route, evenly spaced, and the unit vectors (n, 2) to its left there."""
    stations = evenly_spaced(route_m, _STATION_M)
    along = np.gradient(stations, axis=0)
    along /= np.maximum(np.hypot(along[:, 0], along[:, 1]), 1e-9)[:, None]
    return stations, np.stack([-along[:, 1], along[:, 0]], axis=1)


def _sway_m(stations: FloatArray, left: FloatArray, path_m: FloatArray) -> tuple[NDArray[np.intp], FloatArray]:
    """Return the stations (m,) that the points of a walk are nearest to, and how far left (m,) of it they are."""
    offset = path_m[:, None, :] - stations[None]
    at = (offset**2).sum(axis=2).argmin(axis=1)
    away = offset[np.arange(len(path_m)), at]
    return at, np.asarray((away * left[at]).sum(axis=1), dtype=np.float64)

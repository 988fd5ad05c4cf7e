"""Places that are named by walking: so many metres along the road from one place towards another, or away from it."""

from __future__ import annotations

import math

import numpy as np

from navcore.errors import InputError
from navcore.geometry import FloatArray
from navcore.planning.projection import arc_lengths_m, path_between
from navcore.planning.road_network import RoadNetwork, RoadPoint

Point = tuple[float, float]
_SHORT_OF_END_M = 1e-6


def place_towards(network: RoadNetwork, start: RoadPoint, target: RoadPoint, distance_m: float) -> Point:
    """Return the place, metres, that lies ``distance_m`` along the road from ``start`` towards ``target``.

    Where the distance is negative it lies on the other side: away from ``target``, straight on at junctions.
    Raises InputError where the road between them, or beyond, is shorter; PlanningError where no road joins them.
    """
    if not math.isfinite(distance_m):
        raise InputError("A distance must be a finite number of metres.")
    if distance_m < 0.0:
        return _along(_line_away(network, start, target, -distance_m), -distance_m)
    return _along(network.shortest_piece(start, target).path_m, distance_m)


def place_along(line_m: FloatArray, distance_m: float) -> Point:
    """Return the place at a distance from the beginning of a line (n, 2). Raises InputError where it is shorter."""
    if not distance_m >= 0.0:
        raise InputError("Measure from the beginning of the road: the distance cannot be negative.")
    return _along(line_m, distance_m)


def _along(line_m: FloatArray, distance_m: float) -> Point:
    length_m = float(arc_lengths_m(line_m)[-1])
    if distance_m > length_m + _SHORT_OF_END_M:
        raise InputError(f"The road goes on for {length_m:.2f} m there: choose a distance of at most that.")
    # Of a piece of no length there is only its beginning.
    x, y = (line_m[0] if distance_m <= 0.0 else path_between(line_m, 0.0, min(distance_m, length_m))[-1]).tolist()
    return x, y


def _line_away(network: RoadNetwork, start: RoadPoint, target: RoadPoint, length_m: float) -> FloatArray:
    first, second = (int(vertex) for vertex in network.segments[start.segment])
    ways_m = {v: network.shortest_piece(network.vertex_point(v), target).length_m for v in (first, second)}
    before, here = (second, first) if ways_m[first] > ways_m[second] else (first, second)
    line = [np.array(start.xy_m), network.vertices_m[here]]
    walked_m = float(np.hypot(*(line[1] - line[0])))
    seen = {before, here}
    while walked_m < length_m:
        onward = [(vertex, step_m) for vertex, step_m in network.vertex_neighbours(here) if vertex not in seen]
        if not onward:
            break
        heading = network.vertices_m[here] - network.vertices_m[before]
        straightest = max(onward, key=lambda way: _cosine(heading, network.vertices_m[way[0]] - line[-1]))
        before, (here, step_m) = here, straightest
        seen.add(here)
        line.append(network.vertices_m[here])
        walked_m += step_m
    return np.array(line)


def _cosine(one: FloatArray, other: FloatArray) -> float:
    return float(one @ other / max(float(np.hypot(*one) * np.hypot(*other)), 1e-12))

"""How much room there is beside a path and around a place, from the cloud seen from above."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from console.map_geometry.occupancy import Occupancy
from console.map_geometry.path_samples import sampled
from navcore.geometry import FloatArray
from navcore.map_check.clearance import Bound, PathClearance, PlaceClearance

SPACING_M = 0.1
"""Distance between two places of a path where the room beside it is measured."""
REACH_M = 2.5
"""Nobody needs to know of more room than this to one side."""


def path_clearance(occupancy: Occupancy, path_m: FloatArray) -> PathClearance:
    """Return the room to both sides of a path (k, 2), metres, square to its direction."""
    samples = sampled(path_m, SPACING_M)
    left_m, left_bound = _free(occupancy, samples.points_m, samples.left)
    right_m, right_bound = _free(occupancy, samples.points_m, -samples.left)
    return PathClearance(samples.points_m, samples.arc_m, left_m, right_m, left_bound, right_bound)


def place_clearance(occupancy: Occupancy, x_m: float, y_m: float) -> PlaceClearance:
    """Return the room around a place."""
    row, column, inside = occupancy.cells_of(np.array([x_m, y_m]))
    if not inside:
        return PlaceClearance(float("inf"), False)
    # The distance is between the middles of two cells: the nearer one begins half a cell earlier.
    radius_m = max(0.0, float(occupancy.distance_m[row, column]) - occupancy.cell_m / 2)
    return PlaceClearance(radius_m, bool(occupancy.is_known[row, column]))


def _free(occupancy: Occupancy, points_m: FloatArray, side: FloatArray) -> tuple[FloatArray, NDArray[np.int8]]:
    """Go outwards from each point (n, 2) until something stands there, or nothing is known; return how far, and why."""
    steps_m = np.arange(0.0, REACH_M + occupancy.cell_m / 2, occupancy.cell_m / 2)
    rows, columns, inside = occupancy.cells_of(points_m[:, None] + steps_m[:, None] * side[:, None])
    is_obstacle = inside & occupancy.is_occupied[rows, columns]
    is_end = is_obstacle | ~inside | ~occupancy.is_known[rows, columns]
    first = np.argmax(is_end, axis=1)
    at = np.arange(len(points_m)), first
    bound = np.where(is_obstacle[at], Bound.OBSTACLE, np.where(is_end[at], Bound.UNKNOWN, Bound.OPEN))
    return np.where(is_end[at], steps_m[first], REACH_M), bound.astype(np.int8)

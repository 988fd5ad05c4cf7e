"""What a walk looks like on the floor plan: how often it comes back, and how many loops it makes."""

from __future__ import annotations

from dataclasses import dataclass

import networkx as nx
import numpy as np
from scipy.spatial import cKDTree

from navcore.geometry import FloatArray

RETURN_M = 20.0
"""After so long a way, coming back to a place is a loop that SLAM can close."""
NEAR_M = 0.7
CELL_M = 1.0


@dataclass(frozen=True, slots=True)
class Loops:
    """How a walk comes back to itself."""

    returns: int
    """Times at which it comes back to where it was at least ``RETURN_M`` of way before, after having been away."""
    independent: int
    """Loops of the network of ways that it makes (cyclomatic number): going to and fro makes none."""


def loops_of(position_m: FloatArray) -> Loops:
    """Count the loops of a walk (n, 2)."""
    arc = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(position_m, axis=0).T))])
    even = np.arange(0.0, arc[-1], 0.25)
    points = np.stack([np.interp(even, arc, position_m[:, k]) for k in range(2)], axis=1)
    return Loops(_returns(points, even), _independent_loops(points))


def _returns(points: FloatArray, arc: FloatArray) -> int:
    tree = cKDTree(points)
    back = np.array(
        [
            any(arc[k] - arc[j] >= RETURN_M for j in tree.query_ball_point(point, NEAR_M))
            for k, point in enumerate(points)
        ]
    )
    return int(np.count_nonzero(np.diff(back.astype(np.int8)) == 1))


def _independent_loops(points: FloatArray) -> int:
    """Return E − V + 1 of the graph of passages between coarse cells, without small meshes."""
    graph = nx.Graph()
    places: list[FloatArray] = []
    before = -1
    for point in points:
        nearest = int(np.argmin(np.hypot(*(np.array(places) - point).T))) if places else -1
        if nearest < 0 or float(np.hypot(*(places[nearest] - point))) > CELL_M:
            places.append(point)
            nearest = len(places) - 1
        if before not in (-1, nearest):
            graph.add_edge(before, nearest)
        before = nearest
    # A cycle of cells that is shorter than a way around a room is no loop of the building.
    return sum(len(cycle) * CELL_M >= RETURN_M / 2 for cycle in nx.minimum_cycle_basis(graph))

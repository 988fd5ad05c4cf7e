"""A* over the PoI-graph as plain arrays (paper IV-B), so that ten thousand PoIs plan within a few milliseconds.

P. Hart, N. Nilsson, B. Raphael, "A formal basis for the heuristic determination of minimum cost paths", IEEE Trans. SSC
4, 1968. The heuristic is the straight line, which is never longer than the road, nor dearer: multipliers are ≥ 1.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from navcore.compiled import kernel
from navcore.geometry import FloatArray
from navcore.planning.poi_graph import PoiGraph

IndexArray = NDArray[np.int64]
Mask = NDArray[np.bool_]
_NO_GOAL = -1


class Source(NamedTuple):
    """A place where a way may begin, and what it costs to get there."""

    poi_id: str
    cost_m: float


class Way(NamedTuple):
    """The cheapest way from one of the sources to the goal."""

    source: int
    """Index of the source it begins at."""
    cost_m: float
    """Cost of the source included."""
    poi_ids: tuple[str, ...]
    """From the source to the goal."""
    edge_ids: tuple[str, ...]
    """One fewer: the edges between them."""


@dataclass(frozen=True, slots=True, eq=False)
class Ways:
    """Every edge twice, once in each direction, sorted by the PoI that it leaves: the ways out of PoI i are
    ``first[i] : first[i + 1]``.
    """

    poi_ids: tuple[str, ...]
    index_of: dict[str, int]
    edge_ids: tuple[str, ...]
    places_m: FloatArray
    """(n, 2) of each PoI."""
    first: IndexArray
    """(n + 1,)."""
    head: IndexArray
    """The PoI that each way leads to, (2 e,)."""
    cost_m: FloatArray
    """Length times multiplier, (2 e,)."""
    edge: IndexArray
    """Index of each way's edge, (2 e,)."""
    is_against: Mask
    """Whether it runs against a one-way edge, (2 e,)."""
    is_closed: Mask
    """Whether its edge is closed, (2 e,)."""

    @staticmethod
    def of(graph: PoiGraph) -> Ways:
        """Lay out a graph; edges that end nowhere are left out."""
        poi_ids = tuple(graph.pois)
        index_of = {poi_id: i for i, poi_id in enumerate(poi_ids)}
        edges = [edge for edge in graph.edges.values() if edge.a in index_of and edge.b in index_of]
        a = np.array([index_of[edge.a] for edge in edges], dtype=np.int64)
        b = np.array([index_of[edge.b] for edge in edges], dtype=np.int64)
        cost_m = np.array([edge.length_m * edge.cost_multiplier for edge in edges], dtype=np.float64)
        one_way = np.array([edge.one_way for edge in edges], dtype=np.bool_)
        closed = np.array([edge.closed for edge in edges], dtype=np.bool_)
        tail = np.concatenate([a, b])
        order = np.argsort(tail, kind="stable")
        counts = np.bincount(tail, minlength=len(poi_ids))
        return Ways(
            poi_ids,
            index_of,
            tuple(edge.id for edge in edges),
            np.array([(poi.x_m, poi.y_m) for poi in graph.pois.values()], dtype=np.float64).reshape(-1, 2),
            np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
            np.concatenate([b, a])[order],
            np.concatenate([cost_m, cost_m])[order],
            np.concatenate([np.arange(len(edges))] * 2).astype(np.int64)[order],
            np.concatenate([np.zeros_like(one_way), one_way])[order],
            np.concatenate([closed, closed])[order],
        )

    def usable(self, *, closed_too: bool = False, against_too: bool = False, without: Sequence[str] = ()) -> Mask:
        """Return which ways may be walked (2 e,); ``without`` names edges that may not."""
        mask = np.ones(len(self.head), dtype=np.bool_)
        if not closed_too:
            mask &= ~self.is_closed
        if not against_too:
            mask &= ~self.is_against
        if without:
            barred = np.isin(np.array(self.edge_ids), list(without))
            mask &= ~barred[self.edge]
        return mask

    def is_joined(self, poi_id: str) -> bool:
        """Return whether any edge ends at a PoI."""
        place = self.index_of.get(poi_id)
        return place is not None and bool(self.first[place + 1] > self.first[place])

    def cheapest(self, sources: Sequence[Source], goal_id: str, usable: Mask) -> Way | None:
        """Return the cheapest way from any of the sources to a PoI, or None where none leads there."""
        known = [i for i, source in enumerate(sources) if source.poi_id in self.index_of]
        goal = self.index_of.get(goal_id)
        if goal is None or not known:
            return None
        places = np.array([self.index_of[sources[i].poi_id] for i in known], dtype=np.int64)
        costs_m = np.array([sources[i].cost_m for i in known], dtype=np.float64)
        before, cost_m = _astar(self.first, self.head, self.cost_m, usable, self.places_m, places, costs_m, goal)
        if not math.isfinite(cost_m[goal]):
            return None
        return self._way(before, float(cost_m[goal]), goal, places, costs_m, known)

    def costs_m(self, sources: Sequence[Source], usable: Mask) -> dict[str, float]:
        """Return what the cheapest way from any of the sources to each PoI costs, where one leads there."""
        known = [source for source in sources if source.poi_id in self.index_of]
        places = np.array([self.index_of[source.poi_id] for source in known], dtype=np.int64)
        costs_m = np.array([source.cost_m for source in known], dtype=np.float64)
        _, cost_m = _astar(self.first, self.head, self.cost_m, usable, self.places_m, places, costs_m, _NO_GOAL)
        return {
            poi_id: float(each_m) for poi_id, each_m in zip(self.poi_ids, cost_m, strict=True) if math.isfinite(each_m)
        }

    def _way(
        self, before: IndexArray, cost_m: float, goal: int, places: IndexArray, costs_m: FloatArray, known: list[int]
    ) -> Way:
        """Follow the search back from the goal."""
        tail = np.repeat(np.arange(len(self.poi_ids)), np.diff(self.first))
        pois, edges = [goal], []
        while before[pois[-1]] >= 0:
            way = int(before[pois[-1]])
            edges.append(self.edge_ids[int(self.edge[way])])
            pois.append(int(tail[way]))
        begun = min((k for k in range(len(places)) if places[k] == pois[-1]), key=lambda k: float(costs_m[k]))
        return Way(known[begun], cost_m, tuple(self.poi_ids[i] for i in pois[::-1]), tuple(edges[::-1]))


@kernel
def _astar(
    first: IndexArray,
    head: IndexArray,
    cost_m: FloatArray,
    usable: Mask,
    places_m: FloatArray,
    sources: IndexArray,
    source_costs_m: FloatArray,
    goal: int,
) -> tuple[IndexArray, FloatArray]:
    """Return the way by which each PoI was reached (n,), -1 for none, and the cost to it (n,), inf where unknown.

    Without a goal (-1) the search ends when all that can be reached has been: it is Dijkstra's then.
    """
    count = places_m.shape[0]
    before = np.full(count, -1, dtype=np.int64)
    best_m = np.full(count, np.inf)
    done = np.zeros(count, dtype=np.bool_)
    queue = [(0.0, 0) for _ in range(0)]
    for k in range(sources.shape[0]):
        place = sources[k]
        if source_costs_m[k] < best_m[place]:
            best_m[place] = source_costs_m[k]
            heapq.heappush(queue, (source_costs_m[k] + _straight_m(places_m, place, goal), place))
    while len(queue) > 0:
        place = heapq.heappop(queue)[1]
        if place == goal:
            break
        if done[place]:
            continue
        done[place] = True
        for way in range(first[place], first[place + 1]):
            towards = head[way]
            total_m = best_m[place] + cost_m[way]
            if usable[way] and not done[towards] and total_m < best_m[towards]:
                best_m[towards] = total_m
                before[towards] = way
                heapq.heappush(queue, (total_m + _straight_m(places_m, towards, goal), towards))
    return before, best_m


@kernel
def _straight_m(places_m: FloatArray, a: int, b: int) -> float:
    if b < 0:
        return 0.0
    return math.hypot(places_m[a, 0] - places_m[b, 0], places_m[a, 1] - places_m[b, 1])


def warm_up() -> None:
    """Compile the search."""
    xs = np.arange(3.0)
    first, head = np.array([0, 1, 2, 2]), np.array([1, 2])
    places_m = np.column_stack([xs, xs])
    _astar(first, head, np.ones(2), np.ones(2, np.bool_), places_m, np.zeros(1, np.int64), np.zeros(1), 2)

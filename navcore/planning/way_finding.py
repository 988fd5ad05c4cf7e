"""Way finding (paper IV-B): A* on the PoI-graph, from wherever the user stands on the road, to a PoI.

The route keeps the road's own geometry. Edges may be one-way, closed, or dearer than they are long; with none of
these it is the paper's globally shortest path.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable
from dataclasses import dataclass

import networkx as nx
import numpy as np

from navcore.errors import PlanningError
from navcore.geometry import FloatArray
from navcore.planning.poi_graph import Edge, Poi, PoiGraph
from navcore.planning.projection import EdgeIndex, EdgePoint, arc_lengths_m, path_between
from navcore.planning.road_joining import evenly_spaced
from navcore.settings import PlanningSettings
from navcore.types import Route, RouteStop

_AT_POI_M = 0.05
"""A start this near to a PoI, along the edge, is at the PoI: every edge of it is open, whatever its direction."""
_TIE_M = 0.05


@dataclass(frozen=True, slots=True)
class _Leg:
    """How a route begins: along the start edge to a PoI (or, where the goal is on it, straight to the goal)."""

    poi_id: str
    path_m: FloatArray
    cost_m: float


@dataclass(frozen=True, slots=True)
class _Way:
    cost_m: float
    leg: _Leg
    poi_ids: tuple[str, ...]


class WayFinder:
    """Plans routes in one version of the PoI-graph. Making it costs more than planning: keep it with the graph."""

    def __init__(self, graph: PoiGraph, settings: PlanningSettings | None = None) -> None:
        self.graph = graph
        self.settings = settings or PlanningSettings()
        self._index = EdgeIndex(graph.edges.values())
        self._open_ways = _directed(graph, (edge for edge in graph.edges.values() if not edge.closed))

    def route_to(self, poi_id: str, x_m: float, y_m: float) -> Route:
        """Return the shortest route from a position to a PoI. Raises PlanningError, which names why there is none."""
        goal = self._destination(poi_id)
        starts = self._starts(x_m, y_m)
        ways = [
            way
            for start in starts
            for leg in self._legs(start)
            if (way := _astar(self._open_ways, self.graph, leg, goal.id)) is not None
        ]
        if not ways:
            raise PlanningError(self._why_unreachable(starts, goal))
        return self._route(min(ways, key=lambda way: way.cost_m))

    def _destination(self, poi_id: str) -> Poi:
        goal = self.graph.pois.get(poi_id)
        if goal is None:
            raise PlanningError(f"There is no place {poi_id!r} in the PoI-graph: choose another destination.")
        if not goal.on_road:
            raise PlanningError(f"{goal.name} does not stand on the virtual blind road: choose a place that does.")
        if not self._open_ways.has_node(poi_id) and not any(poi_id in (e.a, e.b) for e in self.graph.edges.values()):
            raise PlanningError(f"No edge leads to {goal.name}: join it with another place in the PoI-graph first.")
        return goal

    def _starts(self, x_m: float, y_m: float) -> tuple[EdgePoint, ...]:
        if not (math.isfinite(x_m) and math.isfinite(y_m)):
            raise PlanningError("The present position is not known: wait until the place in the map is found.")
        starts = self._index.nearest(x_m, y_m, _TIE_M)
        if not starts:
            raise PlanningError("The PoI-graph has no edges: draw or propose them in the console first.")
        limit_m = self.settings.max_start_distance_m
        if starts[0].point.distance_m > limit_m:
            raise PlanningError(
                f"The virtual blind road is {starts[0].point.distance_m:.1f} m away, more than {limit_m:g} m: go"
                " nearer to it first."
            )
        return starts

    def _legs(self, start: EdgePoint, ignore_direction: bool = False) -> list[_Leg]:
        edge, path = self.graph.edges[start.edge_id], self._index.path(start.edge_id)
        arc_m, length_m = start.point.arc_length_m, edge.length_m
        back = _Leg(edge.a, path_between(path, arc_m, 0.0), arc_m * edge.cost_multiplier)
        onward = _Leg(edge.b, path_between(path, arc_m, length_m), (length_m - arc_m) * edge.cost_multiplier)
        if arc_m <= _AT_POI_M:
            return [back]
        if length_m - arc_m <= _AT_POI_M:
            return [onward]
        # Who stands on a closed edge may leave it.
        return [onward] if edge.one_way and not ignore_direction else [onward, back]

    def _route(self, way: _Way) -> Route:
        parts, arcs = [way.leg.path_m], [_length_m(way.leg.path_m)]
        for a, b in zip(way.poi_ids, way.poi_ids[1:], strict=False):
            edge = self.graph.edges[self._open_ways.edges[a, b]["edge_id"]]
            path = self._index.path(edge.id)
            parts.append(path if edge.a == a else path[::-1])
            arcs.append(arcs[-1] + _length_m(path))
        raw = np.vstack(parts)
        points = evenly_spaced(raw, self.settings.route_spacing_m) if arcs[-1] > 1e-9 else raw[-1:]
        arc_length_m = arc_lengths_m(points)
        scale = float(arc_length_m[-1]) / arcs[-1] if arcs[-1] > 1e-9 else 1.0
        stops = tuple(
            _stop(self.graph.pois[poi_id], arc_m * scale, poi_id == way.poi_ids[-1])
            for poi_id, arc_m in zip(way.poi_ids, arcs, strict=True)
            if arc_m > _AT_POI_M or poi_id == way.poi_ids[-1]
        )
        points.setflags(write=False)
        arc_length_m.setflags(write=False)
        return Route(points, arc_length_m, stops)

    def _why_unreachable(self, starts: Iterable[EdgePoint], goal: Poi) -> str:
        """Plan again without the closures, then without the directions too, and say what stood in the way."""
        edges = list(self.graph.edges.values())
        both = _directed(self.graph, edges)
        for start in starts:
            for leg in self._legs(start):
                way = _astar(both, self.graph, leg, goal.id)
                if way is not None:
                    return self._closed_sentence(goal, way, both)
        undirected = both.to_undirected().to_directed()
        for start in starts:
            for leg in self._legs(start, ignore_direction=True):
                if _astar(undirected, self.graph, leg, goal.id) is not None:
                    return f"Only one-way edges lead between here and {goal.name}, and they lead away from it."
        return f"No road joins this place with {goal.name}: add the missing edge to the PoI-graph."

    def _closed_sentence(self, goal: Poi, way: _Way, ways: nx.DiGraph[str]) -> str:
        for a, b in zip(way.poi_ids, way.poi_ids[1:], strict=False):
            if self.graph.edges[ways.edges[a, b]["edge_id"]].closed:
                pois = self.graph.pois
                return f"{goal.name} cannot be reached: the way between {pois[a].name} and {pois[b].name} is closed."
        return f"{goal.name} cannot be reached: the way is closed."


def find_route(graph: PoiGraph, x_m: float, y_m: float, poi_id: str, settings: PlanningSettings | None = None) -> Route:
    """Return the shortest route from a position to a PoI (see :class:`WayFinder`). Raises PlanningError."""
    return WayFinder(graph, settings).route_to(poi_id, x_m, y_m)


def _directed(graph: PoiGraph, edges: Iterable[Edge]) -> nx.DiGraph[str]:
    ways: nx.DiGraph[str] = nx.DiGraph()
    for edge in edges:
        if edge.a in graph.pois and edge.b in graph.pois:
            cost_m = edge.length_m * edge.cost_multiplier
            ways.add_edge(edge.a, edge.b, cost_m=cost_m, edge_id=edge.id)
            if not edge.one_way:
                ways.add_edge(edge.b, edge.a, cost_m=cost_m, edge_id=edge.id)
    return ways


def _astar(ways: nx.DiGraph[str], graph: PoiGraph, leg: _Leg, goal_id: str) -> _Way | None:
    pois = graph.pois
    goal = pois[goal_id]
    if leg.poi_id == goal_id:
        return _Way(leg.cost_m, leg, (goal_id,))
    if leg.poi_id not in ways or goal_id not in ways:
        return None

    def straight_line_m(a: str, _: str) -> float:
        return math.hypot(pois[a].x_m - goal.x_m, pois[a].y_m - goal.y_m)

    try:
        poi_ids = nx.astar_path(ways, leg.poi_id, goal_id, heuristic=straight_line_m, weight="cost_m")
    except nx.NetworkXNoPath:
        return None
    cost_m = sum(ways.edges[a, b]["cost_m"] for a, b in itertools.pairwise(poi_ids))
    return _Way(leg.cost_m + cost_m, leg, tuple(poi_ids))


def _stop(poi: Poi, distance_m: float, is_goal: bool) -> RouteStop:
    is_silent = poi.kind == "junction" and not poi.spoken_name and not is_goal
    return RouteStop(poi.id, poi.name, distance_m, poi.spoken_name, is_silent)


def _length_m(path_m: FloatArray) -> float:
    return float(np.hypot(*np.diff(path_m, axis=0).T).sum())

"""Way finding (paper IV-B): A* on the PoI-graph, from wherever the user stands on the road, to a PoI.

The route keeps the road's own geometry. Edges may be one-way, closed, dearer than they are long, or blocked at a place
by something that stands there now; with none of these it is the paper's globally shortest path.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from navcore.angles import WorldAngle
from navcore.errors import PlanningError
from navcore.geometry import FloatArray
from navcore.planning.edits import OTHER_SIDE
from navcore.planning.poi_graph import Edge, Poi, PoiGraph
from navcore.planning.projection import EdgeIndex, EdgePoint, arc_lengths_m, direction_at, path_between
from navcore.planning.road_joining import evenly_spaced
from navcore.planning.shortest_path import Source, Way, Ways
from navcore.settings import PlanningSettings
from navcore.types import Route, RoutePiece, RouteStop

_AT_POI_M = 0.05
"""A start this near to a PoI, along the edge, is at the PoI: every edge of it is open, whatever its direction."""
_TIE_M = 0.05
_BESIDE_M = 1.0
"""Roads at most so much farther away than the nearest one may be the walker's, if heading or continuity say so."""
_ACROSS_M = 0.5
"""So much farther away counts a road across the heading; one that was not walked on before counts the same."""


@dataclass(frozen=True, slots=True)
class Blockage:
    """A place on an edge that cannot be passed for the time being."""

    edge_id: str
    arc_m: float
    """Arc length along the edge from its PoI a."""


@dataclass(frozen=True, slots=True)
class _Leg:
    """How a route begins: along the start edge to a PoI (or, where the goal is on it, straight to the goal)."""

    poi_id: str
    path_m: FloatArray
    cost_m: float
    edge_id: str
    from_arc_m: float
    to_arc_m: float


class WayFinder:
    """Plans routes in one version of the PoI-graph. Making it costs more than planning: keep it with the graph."""

    def __init__(self, graph: PoiGraph, settings: PlanningSettings | None = None) -> None:
        self.graph = graph
        self.settings = settings or PlanningSettings()
        self._index = EdgeIndex(graph.edges.values())
        self._ways = Ways.of(graph)

    def route_to(
        self,
        poi_id: str,
        x_m: float,
        y_m: float,
        *,
        heading: WorldAngle | None = None,
        on_edge: str | None = None,
        blockages: Sequence[Blockage] = (),
    ) -> Route:
        """Return the shortest route from a position to a PoI. Raises PlanningError, which names why there is none.

        Args:
            poi_id: the destination.
            x_m, y_m: where the walker is.
            heading: where they look: of two roads about equally near, theirs is the one along it.
            on_edge: the edge they were on: a road that runs beside it is not theirs for being a little nearer.
            blockages: places that cannot be passed now.
        """
        goal = self._destination(poi_id)
        near = self._near(x_m, y_m, heading is not None or on_edge is not None)
        likely = self._likely(near, heading, on_edge)
        usable = self._ways.usable(without=[blockage.edge_id for blockage in blockages])
        for starts in (likely, near):
            legs = [leg for start in starts for leg in self._legs(start, blockages)]
            way = self._ways.cheapest([Source(leg.poi_id, leg.cost_m) for leg in legs], goal.id, usable)
            if way is not None:
                return self._route(way, legs[way.source])
        raise self._why_unreachable(near, goal, blockages)

    def costs_m(self, x_m: float, y_m: float, *, heading: WorldAngle | None = None) -> dict[str, float]:
        """Return what the way from a position to each PoI costs: its length, where nothing makes it dearer.

        PoIs to which no way leads are left out. Raises PlanningError away from the road.
        """
        near = self._likely(self._near(x_m, y_m, heading is not None), heading, None)
        legs = [leg for start in near for leg in self._legs(start, ())]
        return self._ways.costs_m([Source(leg.poi_id, leg.cost_m) for leg in legs], self._ways.usable())

    # ---------------------------------------------------------------------------------------------------- start
    def _destination(self, poi_id: str) -> Poi:
        goal = self.graph.pois.get(poi_id)
        if goal is None:
            raise PlanningError(f"There is no place {poi_id!r} in this map: choose another destination.", "unknown")
        if not goal.on_road:
            text = f"{goal.name} does not stand on the virtual blind road: choose a place that does."
            raise PlanningError(text, "aside", name=_aloud(goal))
        if not self._ways.is_joined(poi_id):
            text = f"No way leads to {goal.name} in this map yet: choose another destination."
            raise PlanningError(text, "unjoined", name=_aloud(goal))
        return goal

    def _near(self, x_m: float, y_m: float, beside_too: bool) -> tuple[EdgePoint, ...]:
        """Return the edges that the walker may be on, nearest first."""
        if not (math.isfinite(x_m) and math.isfinite(y_m)):
            text = "The present position is not known: wait until the place in the map is found."
            raise PlanningError(text, "lost")
        near = self._index.nearest(x_m, y_m, _BESIDE_M if beside_too else _TIE_M)
        if not near:
            text = "This map has no ways yet: whoever looks after it must connect its places first."
            raise PlanningError(text, "no_ways")
        limit_m = self.settings.max_start_distance_m
        if near[0].point.distance_m > limit_m:
            raise PlanningError(
                f"The virtual blind road is {near[0].point.distance_m:.1f} m away, more than {limit_m:g} m: go"
                " nearer to it first.",
                "far", metres=f"{near[0].point.distance_m:.0f}",
            )  # fmt: skip
        return near

    def _likely(
        self, near: Sequence[EdgePoint], heading: WorldAngle | None, on_edge: str | None
    ) -> tuple[EdgePoint, ...]:
        """Return those that distance, heading and continuity together speak for."""
        distances = [start.point.distance_m + self._unlikely_m(start, heading, on_edge) for start in near]
        best_m = min(distances)
        return tuple(start for start, each_m in zip(near, distances, strict=True) if each_m <= best_m + _TIE_M)

    def _unlikely_m(self, start: EdgePoint, heading: WorldAngle | None, on_edge: str | None) -> float:
        """Return how much farther away an edge counts than it is."""
        edge, total_m = self.graph.edges[start.edge_id], 0.0
        if heading is not None:
            off = heading - direction_at(self._index.path(edge.id), start.point.arc_length_m)
            total_m += _ACROSS_M * ((1.0 - math.cos(off)) / 2.0 if edge.one_way else abs(math.sin(off)))
        before = self.graph.edges.get(on_edge) if on_edge is not None else None
        if before is not None and not {edge.a, edge.b} & {before.a, before.b}:
            total_m += _ACROSS_M
        return total_m

    def _legs(self, start: EdgePoint, blockages: Sequence[Blockage], ignore_direction: bool = False) -> list[_Leg]:
        edge, path = self.graph.edges[start.edge_id], self._index.path(start.edge_id)
        arc_m, length_m = start.point.arc_length_m, edge.length_m

        def leg(poi_id: str, to_m: float) -> _Leg:
            cost_m = abs(to_m - arc_m) * edge.cost_multiplier
            return _Leg(poi_id, path_between(path, arc_m, to_m), cost_m, edge.id, arc_m, to_m)

        at = [blockage.arc_m for blockage in blockages if blockage.edge_id == edge.id]
        back = [] if any(place_m < arc_m for place_m in at) else [leg(edge.a, 0.0)]
        onward = [] if any(place_m >= arc_m for place_m in at) else [leg(edge.b, length_m)]
        if arc_m <= _AT_POI_M:
            return [leg(edge.a, 0.0)]
        if length_m - arc_m <= _AT_POI_M:
            return [leg(edge.b, length_m)]
        # Who stands on a closed edge may leave it.
        return onward if edge.one_way and not ignore_direction else onward + back

    # ---------------------------------------------------------------------------------------------------- route
    def _route(self, way: Way, leg: _Leg) -> Route:
        parts, spans = [leg.path_m], [(leg.edge_id, leg.from_arc_m, leg.to_arc_m)]
        for a, edge_id in zip(way.poi_ids[:-1], way.edge_ids, strict=True):
            edge, path = self.graph.edges[edge_id], self._index.path(edge_id)
            parts.append(path if edge.a == a else path[::-1])
            spans.append((edge_id, 0.0, edge.length_m) if edge.a == a else (edge_id, edge.length_m, 0.0))
        arcs = np.cumsum([abs(to_m - from_m) for _, from_m, to_m in spans])
        total_m = float(arcs[-1])
        raw = np.vstack(parts)
        points = evenly_spaced(raw, self.settings.route_spacing_m) if total_m > 1e-9 else raw[-1:]
        arc_length_m = arc_lengths_m(points)
        # Even spacing cuts corners, so that the route is a little shorter than its pieces.
        arcs = arcs * (float(arc_length_m[-1]) / total_m if total_m > 1e-9 else 1.0)
        ends_m = arcs.tolist()
        points.setflags(write=False)
        arc_length_m.setflags(write=False)
        return Route(points, arc_length_m, self._stops(way, ends_m), self._pieces(spans, ends_m))

    def _stops(self, way: Way, ends_m: list[float]) -> tuple[RouteStop, ...]:
        return tuple(
            _stop(self.graph.pois[poi_id], end_m, poi_id == way.poi_ids[-1])
            for poi_id, end_m in zip(way.poi_ids, ends_m, strict=True)
            if end_m > _AT_POI_M or poi_id == way.poi_ids[-1]
        )

    def _pieces(self, spans: list[tuple[str, float, float]], ends_m: list[float]) -> tuple[RoutePiece, ...]:
        begins_m = [0.0, *ends_m[:-1]]
        return tuple(
            route_piece(self.graph.edges[edge_id], begin_m, end_m, from_m, to_m)
            for (edge_id, from_m, to_m), begin_m, end_m in zip(spans, begins_m, ends_m, strict=True)
            if end_m > begin_m
        )

    # ----------------------------------------------------------------------------------------------- unreachable
    def _why_unreachable(self, starts: Sequence[EdgePoint], goal: Poi, blockages: Sequence[Blockage]) -> PlanningError:
        """Plan again without what blocks, then without the closures, then without the directions too: what was it?"""
        legs = [leg for start in starts for leg in self._legs(start, ())]
        sources = [Source(leg.poi_id, leg.cost_m) for leg in legs]
        if blockages and self._ways.cheapest(sources, goal.id, self._ways.usable()) is not None:
            text = f"{goal.name} cannot be reached: the way there is blocked, and there is no other."
            return PlanningError(text, "blocked", name=_aloud(goal))
        way = self._ways.cheapest(sources, goal.id, self._ways.usable(closed_too=True))
        if way is not None:
            return self._closed(goal, way)
        anyhow = [Source(leg.poi_id, leg.cost_m) for start in starts for leg in self._legs(start, (), True)]
        both = self._ways.usable(closed_too=True, against_too=True)
        if self._ways.cheapest(anyhow, goal.id, both) is not None:
            text = f"Only one-way edges lead between here and {goal.name}, and they lead away from it."
            return PlanningError(text, "one_way", name=_aloud(goal))
        text = f"No road joins this place with {goal.name}: add the missing edge to the PoI-graph."
        return PlanningError(text, "apart", name=_aloud(goal))

    def _closed(self, goal: Poi, way: Way) -> PlanningError:
        for edge_id in way.edge_ids:
            edge, pois = self.graph.edges[edge_id], self.graph.pois
            if edge.closed:
                a, b = pois[edge.a], pois[edge.b]
                text = f"{goal.name} cannot be reached: the way between {a.name} and {b.name} is closed."
                return PlanningError(text, "closed_between", name=_aloud(goal), a=_aloud(a), b=_aloud(b))
        return PlanningError(f"{goal.name} cannot be reached: the way is closed.", "closed", name=_aloud(goal))


def _aloud(poi: Poi) -> str:
    return poi.spoken_name or poi.name


def find_route(graph: PoiGraph, x_m: float, y_m: float, poi_id: str, settings: PlanningSettings | None = None) -> Route:
    """Return the shortest route from a position to a PoI (see :class:`WayFinder`). Raises PlanningError."""
    return WayFinder(graph, settings).route_to(poi_id, x_m, y_m)


def route_piece(edge: Edge, begin_m: float, end_m: float, from_m: float, to_m: float) -> RoutePiece:
    """Return the part of a route, between two of its arc lengths, that lies on an edge from one to another of its own.

    What is on the left on the way from a to b is on the right on the way back.
    """
    side = edge.caution_side if from_m <= to_m else OTHER_SIDE[edge.caution_side]
    return RoutePiece(edge.id, begin_m, end_m, from_m, to_m, side, edge.width_m)


def _stop(poi: Poi, distance_m: float, is_goal: bool) -> RouteStop:
    is_silent = poi.kind == "junction" and not poi.spoken_name and not is_goal
    return RouteStop(poi.id, poi.name, distance_m, poi.spoken_name, is_silent, poi.kind)

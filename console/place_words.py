"""Where a walker is, in the words of the map: “at Bar”, “between Hall and Bar”. Pure."""

from __future__ import annotations

import math

from navcore.planning.poi_graph import PoiGraph
from navcore.planning.projection import EdgeIndex, EdgePoint

AT_M = 2.0
"""Nearer to a place than this somebody is at it."""
OFF_ROAD_M = 3.0
"""Farther from the road than this is told."""


class PlaceWords:
    """Names positions on one graph; made once for a version of it."""

    def __init__(self, graph: PoiGraph) -> None:
        self._graph = graph
        self._index = EdgeIndex(graph.edges.values())

    def at(self, x_m: float, y_m: float) -> str:
        """Return where this is; empty on a map without any place."""
        nearest = self._index.nearest(x_m, y_m)
        return self._on_edge(nearest[0]) if nearest else self._near_poi(x_m, y_m)

    def _on_edge(self, at: EdgePoint) -> str:
        edge, point = self._graph.edges[at.edge_id], at.point
        a, b = (self._graph.pois[end].name for end in (edge.a, edge.b))
        to_b_m = edge.length_m - point.arc_length_m
        nearer, distance_m = (a, point.arc_length_m) if point.arc_length_m <= to_b_m else (b, to_b_m)
        if point.distance_m > OFF_ROAD_M:
            return f"{point.distance_m:.0f} m off the road, near {nearer}"
        return f"at {nearer}" if distance_m <= AT_M else f"between {a} and {b}"

    def _near_poi(self, x_m: float, y_m: float) -> str:
        pois = [(math.hypot(poi.x_m - x_m, poi.y_m - y_m), poi.name) for poi in self._graph.pois.values()]
        if not pois:
            return ""
        distance_m, name = min(pois)
        return f"at {name}" if distance_m <= AT_M else f"{distance_m:.0f} m from {name}"

"""Do edges join places along the road?"""

from __future__ import annotations

import math
from collections.abc import Iterator

from navcore.map_check.evidence import ON_ROAD_M, MapEvidence, edge_name, middle_of, path_of, spaced
from navcore.map_check.finding import Finding, Severity
from navcore.planning.poi_graph import Edge, PoiGraph

MIN_EDGE_M = 1.0
"""Places nearer to each other than this cannot be told apart by a position that is known to 0.25 m
(``localization.uncertain_position_m``), two standard deviations each."""
END_WITHIN_M = 0.1
"""An edge ends at its places; what rounding and a change of units leave is far less than this."""


def dangling_edges(evidence: MapEvidence) -> Iterator[Finding]:
    """Find edges that do not end at two different places of the graph, on the road."""
    graph = evidence.graph
    for edge in graph.edges.values():
        if (reason := _why_dangling(edge, graph)) is not None:
            text, action = f"{edge_name(edge, graph)} {reason}.", "Delete it, or connect the two places again."
            yield _finding("dangling_edge", edge, graph, text, action)


def _why_dangling(edge: Edge, graph: PoiGraph) -> str | None:
    if edge.a not in graph.pois or edge.b not in graph.pois:
        return "ends at a place that does not exist"
    if edge.a == edge.b:
        return "ends where it begins"
    path = path_of(edge)
    if len(path) < 2:
        return "has no path"
    for key, end in ((edge.a, path[0]), (edge.b, path[-1])):
        poi = graph.pois[key]
        if math.dist((poi.x_m, poi.y_m), end.tolist()) > END_WITHIN_M:
            return f"does not end at {poi.name}"
        if not poi.on_road:
            return f"ends at {poi.name}, which does not stand on the road"
    return None


def edges_without_road(evidence: MapEvidence) -> Iterator[Finding]:
    """Find edges whose path leaves the road."""
    graph = evidence.graph
    for edge in graph.edges.values():
        path = path_of(edge)
        if len(path) < 2:
            continue
        points = spaced(path)
        distances_m = evidence.road_distances_m(points)
        off = distances_m > ON_ROAD_M
        if not off.any():
            continue
        x_m, y_m = points[int(distances_m.argmax())].tolist()
        farthest = f", {distances_m.max():.1f} m at most" if math.isfinite(distances_m.max()) else ""
        text = f"{edge_name(edge, graph)} leaves the road{farthest}."
        action = "Draw or record the missing piece of road, then connect the two places again."
        ends = tuple(key for key in (edge.a, edge.b) if key in graph.pois)
        yield Finding("edge_without_road", "error", text, action, x_m, y_m, ends, (edge.id,))


def short_edges(evidence: MapEvidence) -> Iterator[Finding]:
    """Find edges between places that are so near to each other that nobody can tell at which of them they are."""
    graph = evidence.graph
    for edge in graph.edges.values():
        if edge.length_m < MIN_EDGE_M:
            text = f"{edge_name(edge, graph)} is {edge.length_m:.1f} m long, less than {MIN_EDGE_M:g} m."
            yield _finding("short_edge", edge, graph, text, "Merge the two places, or move one of them.", "warning")


def _finding(code: str, edge: Edge, graph: PoiGraph, text: str, action: str, severity: Severity = "error") -> Finding:
    ends = tuple(key for key in (edge.a, edge.b) if key in graph.pois)
    return Finding(code, severity, text, action, *middle_of(edge, graph), ends, (edge.id,))

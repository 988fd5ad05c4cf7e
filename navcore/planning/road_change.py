"""A PoI-graph on a road that has changed: longer by another recording, shorter by one that was removed.

Places keep their identifiers, names and settings; they are put back on the road, and edges are made again along it. An
edge on which a new place now lies is divided there, and its parts inherit how it may be walked. What the caregiver has
deleted between old places stays deleted, unless a new road joins them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import msgspec
import numpy as np

from navcore.errors import InputError
from navcore.geometry import FloatArray
from navcore.planning.edits import OTHER_SIDE, along_road, edge_of_piece, free_edge_id
from navcore.planning.neighbours import neighbour_pieces
from navcore.planning.poi_graph import Edge, Poi, PoiGraph
from navcore.planning.projection import project_on_path
from navcore.planning.road_network import RoadNetwork, RoadPiece, RoadPoint

SAME_ROAD_M = 1.0
"""A piece of road that stays nearer than this to another road lies on it."""
MAX_SLIDE_M = 0.75
"""Joined passes lie a little beside each alone. A place that would have to move farther has lost its road."""
_SAME_PLACE_M = 0.05


@dataclass(frozen=True, slots=True)
class Carried:
    """A graph that was carried over to another road."""

    graph: PoiGraph
    off_road: tuple[str, ...]
    """Places that stood on the road, and to which no road leads any more: they stand free now."""
    lost_edges: tuple[str, ...]
    """Edges along which no road leads any more."""


def carried_over(
    graph: PoiGraph,
    added: Mapping[str, Poi],
    places_m: Mapping[str, tuple[float, float]],
    known: RoadNetwork,
    network: RoadNetwork,
) -> Carried:
    """Carry a graph over from the road that was known to the one that is there now, one version on.

    ``places_m`` says where each old place lies now. ``added`` are new places, on the new road already.
    """
    old = {key: _put_back(poi, places_m.get(key, (poi.x_m, poi.y_m)), network) for key, poi in graph.pois.items()}
    off_road = tuple(key for key, poi in graph.pois.items() if poi.on_road and not old[key].on_road)
    pois = {**old, **added}
    points = {key: network.nearest(poi.x_m, poi.y_m) for key, poi in pois.items() if poi.on_road}
    pieces = {frozenset(ends): (ends, piece) for ends, piece in neighbour_pieces(network, points).items()}
    edges: dict[str, Edge] = {}
    divided: list[Edge] = []
    lost: list[str] = []
    for edge in graph.edges.values():
        if _is_divided(edge, added) and frozenset((edge.a, edge.b)) not in pieces:
            divided.append(edge)
            continue
        kept = _kept(edge, pois, pieces, network)
        if kept is None:
            lost.append(edge.id)
        else:
            edges[edge.id] = kept
    _propose(edges, pois, points, pieces, (added, divided, known))
    return Carried(PoiGraph(graph.version + 1, pois, edges, graph.roads), off_road, tuple(lost))


def _put_back(poi: Poi, place_m: tuple[float, float], network: RoadNetwork) -> Poi:
    x_m, y_m = place_m
    if not poi.on_road:
        return msgspec.structs.replace(poi, x_m=x_m, y_m=y_m)
    if network.is_empty or (point := network.nearest(x_m, y_m)).distance_m > MAX_SLIDE_M:
        return msgspec.structs.replace(poi, x_m=x_m, y_m=y_m, on_road=False)
    return msgspec.structs.replace(poi, x_m=point.x_m, y_m=point.y_m)


def _is_divided(edge: Edge, added: Mapping[str, Poi]) -> bool:
    path = np.array(edge.path_m)
    return any(project_on_path(path, poi.x_m, poi.y_m).distance_m < SAME_ROAD_M for poi in added.values())


def _kept(
    edge: Edge,
    pois: Mapping[str, Poi],
    pieces: Mapping[frozenset[str], tuple[tuple[str, str], RoadPiece]],
    network: RoadNetwork,
) -> Edge | None:
    """Return the edge along the road as it is now; None where there is none."""
    if not (pois[edge.a].on_road and pois[edge.b].on_road):
        return None
    ends, piece = pieces.get(frozenset((edge.a, edge.b)), (("", ""), None))
    try:
        if piece is None:
            return along_road(network, pois, edge)
        path = piece.path_m if ends == (edge.a, edge.b) else piece.path_m[::-1]
        return edge_of_piece(edge, pois, RoadPiece(path, piece.length_m))
    except InputError:
        return None


def _propose(
    edges: dict[str, Edge],
    pois: Mapping[str, Poi],
    points: Mapping[str, RoadPoint],
    pieces: Mapping[frozenset[str], tuple[tuple[str, str], RoadPiece]],
    change: tuple[Mapping[str, Poi], list[Edge], RoadNetwork],
) -> None:
    """Join neighbours of which one is new, or between which a new road leads."""
    added, divided, known = change
    joined = {frozenset((edge.a, edge.b)) for edge in edges.values()}
    for pair, ((a, b), piece) in pieces.items():
        is_new = a in added or b in added or not _lies_on(piece.path_m, known)
        if pair in joined or not is_new or math.dist(points[a].xy_m, points[b].xy_m) < _SAME_PLACE_M:
            continue
        key = free_edge_id(edges)
        edges[key] = _inheriting(edge_of_piece(Edge(key, a, b, (), 0.0), pois, piece), divided)


def _lies_on(path_m: FloatArray, network: RoadNetwork) -> bool:
    return bool((network.distances_m(path_m) < SAME_ROAD_M).all())


def _inheriting(part: Edge, divided: list[Edge]) -> Edge:
    """Return a part of an edge that was divided with that edge's settings; others as they are."""
    for whole in divided:
        path = np.array(whole.path_m)
        on_it = [project_on_path(path, x, y) for x, y in part.path_m]
        if max(point.distance_m for point in on_it) < SAME_ROAD_M:
            is_forward = on_it[0].arc_length_m <= on_it[-1].arc_length_m
            turned = msgspec.structs.replace(part, a=part.b, b=part.a, path_m=part.path_m[::-1])
            along = part if is_forward or not whole.one_way else turned
            side = whole.caution_side if is_forward or whole.one_way else OTHER_SIDE[whole.caution_side]
            return msgspec.structs.replace(
                along, one_way=whole.one_way, closed=whole.closed, cost_multiplier=whole.cost_multiplier,
                width_m=whole.width_m, caution_side=side,
            )  # fmt: skip
    return part

"""Which places are neighbours along the road: the pieces of road between them pass no third place."""

from __future__ import annotations

import heapq
from collections.abc import Mapping

import numpy as np
from scipy.sparse.csgraph import dijkstra

from navcore.planning.road_network import RoadNetwork, RoadPiece, RoadPoint, piece_of_path

PASSING_DISTANCE_M = 0.5
"""A road that comes nearer to a place than this, measured along the road, passes it."""


def neighbour_pieces(network: RoadNetwork, points: Mapping[str, RoadPoint]) -> dict[tuple[str, str], RoadPiece]:
    """Return the shortest piece of road between every two places that are neighbours, keyed in the order given."""
    place_at: dict[int, str] = {}
    pieces: dict[tuple[str, str], RoadPiece] = {}
    for key, point in points.items():
        vertex = network.closest_vertex(point)
        if vertex in place_at:
            # Two places on one spot of the network are neighbours of each other; the first stands for both outwards.
            pieces[place_at[vertex], key] = network.shortest_piece(points[place_at[vertex]], point)
        else:
            place_at[vertex] = key
    owner_of = _owners(network, place_at)
    rank = {key: index for index, key in enumerate(points)}
    for vertex, key in place_at.items():
        for other, entry in _reached(network, vertex, key, owner_of).items():
            if rank[key] < rank[other]:
                pieces[key, other] = _piece_through(network, points[key], entry, points[other])
    return pieces


def _owners(network: RoadNetwork, place_at: Mapping[int, str]) -> dict[int, str]:
    """The place that each vertex near one belongs to."""
    if not place_at:
        return {}
    distances, _, sources = dijkstra(
        network.matrix, directed=False, indices=list(place_at), min_only=True, return_predecessors=True,
        limit=PASSING_DISTANCE_M,
    )  # fmt: skip
    return {int(vertex): place_at[int(sources[vertex])] for vertex in np.flatnonzero(np.isfinite(distances))}


def _reached(network: RoadNetwork, start: int, key: str, owner_of: Mapping[int, str]) -> dict[str, list[int]]:
    """Search outwards from a place, never past another one; return the vertices on the way to each that is met."""
    queue: list[tuple[float, int, int]] = [(0.0, start, -1)]
    previous: dict[int, int] = {}
    met: dict[str, list[int]] = {}
    while queue:
        distance_m, vertex, before = heapq.heappop(queue)
        if vertex in previous:
            continue
        previous[vertex] = before
        owner = owner_of.get(vertex, key)
        if owner != key:
            met.setdefault(owner, _way_to(vertex, previous))
            continue
        for neighbour, step_m in network.vertex_neighbours(vertex):
            if neighbour not in previous:
                heapq.heappush(queue, (distance_m + step_m, neighbour, vertex))
    return met


def _way_to(vertex: int, previous: Mapping[int, int]) -> list[int]:
    way = [vertex]
    while previous[way[-1]] >= 0:
        way.append(previous[way[-1]])
    return way[::-1]


def _piece_through(network: RoadNetwork, start: RoadPoint, way: list[int], end: RoadPoint) -> RoadPiece:
    """Join start → way → end; the ends stand up to half a segment beside the vertices of the way."""
    # The start may stand within the first segment of the way already: do not step back to the vertex behind it.
    inner = way[1:] if len(way) > 1 and way[1] in network.segments[start.segment] else way
    tail = network.shortest_piece(network.vertex_point(way[-1]), end).path_m
    return piece_of_path(np.vstack([[start.xy_m], network.vertices_m[inner], tail]))

"""From the places that the recording person named to a first PoI-graph, for the caregiver to correct."""

from __future__ import annotations

import contextlib
import math
import re
from collections.abc import Sequence

import numpy as np

from navcore.errors import InputError
from navcore.geometry import FloatArray
from navcore.planning.edits import MAX_SNAP_DISTANCE_M, add_poi, propose_edges
from navcore.planning.poi_graph import Poi, PoiGraph
from navcore.planning.road_network import RoadNetwork
from navcore.recording import Mark

_MADE_NAME = re.compile(r"Junction (\d{1,6})")


def is_made_name(name: str) -> bool:
    """Say whether a place has a name that nobody gave it: that of a junction where nothing was named."""
    return _MADE_NAME.fullmatch(name) is not None


MAX_MARK_GAP_S = 1.0
"""A place that was named while the camera was not tracked for this long has no known position and is left out."""

JUNCTION_CLEARANCE_M = 1.5
"""A place that was named nearer than this to where roads meet stands for the junction."""
SAME_PLACE_M = 3.0
"""What is called the same, nearer than this, is the same place."""


def graph_from_marks(
    marks: Sequence[Mark], stamps_s: FloatArray, positions_m: FloatArray, network: RoadNetwork
) -> PoiGraph:
    """Return the PoI-graph of the named places and of the junctions of the road, joined along the road.

    ``stamps_s`` (n,) ascending and ``positions_m`` (n, ≥ 2) are the mapped trajectory of the recording. The graph is
    version 1: the first draft.
    """
    graph = PoiGraph()
    for mark in marks:
        place = _place_of(mark, stamps_s, positions_m, network)
        if place is not None:
            graph = add_poi(graph, network, name=mark.name, kind=mark.kind, x_m=place[0], y_m=place[1])
    # A single place, or places on roads that do not meet, have no edges to propose; the places stay.
    with contextlib.suppress(InputError):
        graph = propose_edges(_with_junctions(graph, network), network)
    return PoiGraph(1, graph.pois, graph.edges)


def lost_marks(
    marks: Sequence[Mark], stamps_s: FloatArray, positions_m: FloatArray, network: RoadNetwork
) -> tuple[str, ...]:
    """Return the names of the places that :func:`graph_from_marks` and :func:`places_to_add` leave out."""
    return tuple(mark.name for mark in marks if _place_of(mark, stamps_s, positions_m, network) is None)


def _place_of(
    mark: Mark, stamps_s: FloatArray, positions_m: FloatArray, network: RoadNetwork
) -> tuple[float, float] | None:
    """Return where a place was named; None where the camera was not tracked, or no road is near."""
    if network.is_empty or not len(stamps_s):
        return None
    nearest = int(np.argmin(np.abs(stamps_s - mark.stamp_s)))
    if abs(float(stamps_s[nearest]) - mark.stamp_s) > MAX_MARK_GAP_S:
        return None
    x_m, y_m = (float(value) for value in positions_m[nearest, :2])
    if network.nearest(x_m, y_m).distance_m > MAX_SNAP_DISTANCE_M:
        return None
    return _at_junction(network, x_m, y_m) if mark.kind == "junction" else (x_m, y_m)


def _at_junction(network: RoadNetwork, x_m: float, y_m: float) -> tuple[float, float]:
    """Return the place where roads meet that was meant; the place itself where none is near."""
    junctions = network.vertices_m[network.junctions()]
    if not len(junctions):
        return x_m, y_m
    distances_m = np.hypot(junctions[:, 0] - x_m, junctions[:, 1] - y_m)
    nearest = int(np.argmin(distances_m))
    if distances_m[nearest] > JUNCTION_CLEARANCE_M:
        return x_m, y_m
    return float(junctions[nearest, 0]), float(junctions[nearest, 1])


def _with_junctions(graph: PoiGraph, network: RoadNetwork) -> PoiGraph:
    """Add a PoI where roads meet and nothing was named: without it, edges would lie upon each other."""
    numbered = [_MADE_NAME.fullmatch(poi.name) for poi in graph.pois.values()]
    count = max((int(found[1]) for found in numbered if found), default=0)
    for vertex in network.junctions():
        x_m, y_m = (float(value) for value in network.vertices_m[vertex])
        if _is_free(graph, x_m, y_m):
            count += 1
            graph = add_poi(graph, network, name=f"Junction {count}", kind="junction", x_m=x_m, y_m=y_m)
    return graph


def _is_free(graph: PoiGraph, x_m: float, y_m: float) -> bool:
    return all(math.hypot(poi.x_m - x_m, poi.y_m - y_m) > JUNCTION_CLEARANCE_M for poi in graph.pois.values())


def places_to_add(
    graph: PoiGraph,
    marks: Sequence[Mark],
    stamps_s: FloatArray,
    positions_m: FloatArray,
    known: RoadNetwork,
    network: RoadNetwork,
) -> dict[str, Poi]:
    """Return what a further recording adds to a graph: the places named in it, and where its roads meet others.

    ``graph`` holds the old places where they lie now; ``known`` is the old road, ``network`` the new one. A place that
    was named before, of the same kind and nearer than :data:`SAME_PLACE_M`, is not added again.
    """
    before = graph
    for mark in marks:
        place = _place_of(mark, stamps_s, positions_m, network)
        if place is not None and not _is_known(graph, mark, place):
            graph = add_poi(graph, network, name=mark.name, kind=mark.kind, x_m=place[0], y_m=place[1])
    was_junction = {
        key
        for key, poi in _with_junctions(graph, network).pois.items()
        if key not in graph.pois and not _is_new_junction(poi, known)
    }
    pois = _with_junctions(graph, network).pois
    return {key: poi for key, poi in pois.items() if key not in before.pois and key not in was_junction}


def _is_known(graph: PoiGraph, mark: Mark, place: tuple[float, float]) -> bool:
    return any(
        (poi.name, poi.kind) == (mark.name, mark.kind) and math.dist((poi.x_m, poi.y_m), place) < SAME_PLACE_M
        for poi in graph.pois.values()
    )


def _is_new_junction(poi: Poi, known: RoadNetwork) -> bool:
    """Whether no roads met there before: what the caregiver has deleted does not come back."""
    junctions = known.vertices_m[known.junctions()]
    return not len(junctions) or float(np.hypot(*(junctions - (poi.x_m, poi.y_m)).T).min()) > JUNCTION_CLEARANCE_M

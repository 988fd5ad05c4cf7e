"""From the places that the recording person named to a first PoI-graph, for the caregiver to correct."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Sequence

import numpy as np

from navcore.errors import InputError
from navcore.geometry import FloatArray
from navcore.planning.edits import add_poi, propose_edges
from navcore.planning.poi_graph import PoiGraph
from navcore.planning.road_network import RoadNetwork
from navcore.recording import Mark

MAX_MARK_GAP_S = 1.0
"""A place that was named while the camera was not tracked for this long has no known position and is left out."""


JUNCTION_CLEARANCE_M = 1.5
"""A place that was named nearer than this to where roads meet stands for the junction."""


def graph_from_marks(
    marks: Sequence[Mark], stamps_s: FloatArray, positions_m: FloatArray, network: RoadNetwork
) -> PoiGraph:
    """Return the PoI-graph of the named places and of the junctions of the road, joined along the road.

    ``stamps_s`` (n,) ascending and ``positions_m`` (n, ≥ 2) are the mapped trajectory of the recording. The graph is
    version 1: the first draft.
    """
    graph = PoiGraph()
    for mark in marks:
        nearest = int(np.argmin(np.abs(stamps_s - mark.stamp_s)))
        if abs(float(stamps_s[nearest]) - mark.stamp_s) > MAX_MARK_GAP_S:
            continue
        x_m, y_m = (float(value) for value in positions_m[nearest, :2])
        if mark.kind == "junction":
            x_m, y_m = _at_junction(network, x_m, y_m)
        graph = add_poi(graph, network, name=mark.name, kind=mark.kind, x_m=x_m, y_m=y_m)
    # A single place, or places on roads that do not meet, have no edges to propose; the places stay.
    with contextlib.suppress(InputError):
        graph = propose_edges(_with_junctions(graph, network), network)
    return PoiGraph(1, graph.pois, graph.edges)


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
    count = 0
    for vertex in network.junctions():
        x_m, y_m = (float(value) for value in network.vertices_m[vertex])
        if all(math.hypot(poi.x_m - x_m, poi.y_m - y_m) > JUNCTION_CLEARANCE_M for poi in graph.pois.values()):
            count += 1
            graph = add_poi(graph, network, name=f"Junction {count}", kind="junction", x_m=x_m, y_m=y_m)
    return graph

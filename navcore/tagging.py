"""From the places that the recording person named to a first PoI-graph, for the caregiver to correct."""

from __future__ import annotations

import contextlib
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


def graph_from_marks(
    marks: Sequence[Mark], stamps_s: FloatArray, positions_m: FloatArray, network: RoadNetwork
) -> PoiGraph:
    """Return the PoI-graph of the named places, joined along the road.

    ``stamps_s`` (n,) ascending and ``positions_m`` (n, ≥ 2) are the mapped trajectory of the recording. The graph is
    version 1: the first draft.
    """
    graph = PoiGraph()
    for mark in marks:
        nearest = int(np.argmin(np.abs(stamps_s - mark.stamp_s)))
        if abs(float(stamps_s[nearest]) - mark.stamp_s) > MAX_MARK_GAP_S:
            continue
        x_m, y_m = (float(value) for value in positions_m[nearest, :2])
        graph = add_poi(graph, network, name=mark.name, kind=mark.kind, x_m=x_m, y_m=y_m)
    # A single place, or places on roads that do not meet, have no edges to propose; the places stay.
    with contextlib.suppress(InputError):
        graph = propose_edges(graph, network)
    return PoiGraph(1, graph.pois, graph.edges)

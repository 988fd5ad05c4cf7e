"""Can every place be reached from the others, and left for them, by the edges that are open and their directions?"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order, connected_components

from navcore.map_check.evidence import MapEvidence
from navcore.map_check.finding import Finding, Severity
from navcore.planning.poi_graph import Poi, PoiGraph
from navcore.planning.shortest_path import Ways

_ONE_SIDED_KINDS = frozenset({"entrance", "exit"})
"""A building may be entered where nobody leaves it, and left where nobody enters."""


def unreachable_places(evidence: MapEvidence) -> Iterator[Finding]:
    """Find the places on the road that cannot be reached from most of the others, or not be left for them."""
    graph = _on_road(evidence.graph)
    if len(graph.pois) < 2:
        return
    ids = tuple(graph.pois)
    ways = Ways.of(graph)
    tails = np.repeat(np.arange(len(ids)), np.diff(ways.first))
    usable = ways.usable()
    links = tails[usable], ways.head[usable]
    out = coo_array((np.ones(len(links[0])), links), shape=(len(ids), len(ids))).tocsr()
    _, component = connected_components(out, connection="strong")
    core = int(np.argmax(component == np.argmax(np.bincount(component))))
    left_from_core = set(breadth_first_order(out, core, return_predecessors=False).tolist())
    leads_to_core = set(breadth_first_order(out.T.tocsr(), core, return_predecessors=False).tolist())
    for index, poi_id in enumerate(ids):
        finding = _finding(graph.pois[poi_id], index in left_from_core, index in leads_to_core)
        if finding is not None:
            yield finding


def _on_road(graph: PoiGraph) -> PoiGraph:
    """Return the graph of the places on the road, in the order of their identifiers."""
    pois = {key: graph.pois[key] for key in sorted(graph.pois) if graph.pois[key].on_road}
    return PoiGraph(graph.version, pois, graph.edges)


def _finding(poi: Poi, is_reached: bool, is_left: bool) -> Finding | None:
    if is_reached and is_left:
        return None
    severity: Severity = "warning" if poi.kind in _ONE_SIDED_KINDS and (is_reached or is_left) else "error"
    if not is_reached and not is_left:
        text, action = (
            f"{poi.name} is joined with no other place by an open edge.",
            "Add an edge, or open a closed one.",
        )
    elif is_left:
        text, action = (
            f"{poi.name} cannot be reached: edges only lead away from it.",
            "Let an edge be walked both ways.",
        )
    else:
        text, action = f"{poi.name} cannot be left: edges only lead to it.", "Let an edge be walked both ways."
    code = "unleavable_poi" if is_reached else "unreachable_poi"
    return Finding(code, severity, text, action, poi.x_m, poi.y_m, (poi.id,))

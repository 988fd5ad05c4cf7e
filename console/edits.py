"""The edits of the PoI-graph as values: what the scene, the forms and the log on disk share.

``evaluate`` makes a new graph from an old one and an edit, with the pure functions of ``navcore.planning.edits``.
"""

from __future__ import annotations

from typing import Annotated

import msgspec

from navcore.planning import edits
from navcore.planning.poi_graph import Identifier, Metres, Name, PoiGraph, PoiKind
from navcore.planning.road_network import RoadNetwork

ShortName = Annotated[str, msgspec.Meta(max_length=80)]
Notes = Annotated[str, msgspec.Meta(max_length=2000)]


class _Edit(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="edit"):
    pass


class AddPoi(_Edit, frozen=True, tag="add_poi"):
    """Tag a place. It snaps to the road where ``on_road``."""

    name: Name
    kind: PoiKind
    x_m: Metres
    y_m: Metres
    on_road: bool = True
    spoken_name: ShortName = ""
    notes: Notes = ""


class MovePoi(_Edit, frozen=True, tag="move_poi"):
    """Move a place; its edges follow. It snaps to the road where ``on_road``."""

    poi_id: Identifier
    x_m: Metres
    y_m: Metres
    on_road: bool = True


class UpdatePoi(_Edit, frozen=True, tag="update_poi"):
    """Change what a place is called; None leaves a value as it is."""

    poi_id: Identifier
    name: Name | None = None
    kind: PoiKind | None = None
    spoken_name: ShortName | None = None
    notes: Notes | None = None


class DeletePoi(_Edit, frozen=True, tag="delete_poi"):
    """Remove a place, and the edges that end there."""

    poi_id: Identifier


class AddEdge(_Edit, frozen=True, tag="add_edge"):
    """Join two places by the piece of road between them."""

    a: Identifier
    b: Identifier


class DeleteEdge(_Edit, frozen=True, tag="delete_edge"):
    """Remove an edge."""

    edge_id: Identifier


class SetEdge(_Edit, frozen=True, tag="set_edge"):
    """Change how an edge may be walked; None leaves a value as it is."""

    edge_id: Identifier
    one_way: bool | None = None
    closed: bool | None = None
    cost_multiplier: Annotated[float, msgspec.Meta(ge=1.0, le=100.0)] | None = None


class ProposeEdges(_Edit, frozen=True, tag="propose_edges"):
    """Join all neighbours along the road: the whole graph at one stroke."""


Edit = AddPoi | MovePoi | UpdatePoi | DeletePoi | AddEdge | DeleteEdge | SetEdge | ProposeEdges


def evaluate(edit: Edit, graph: PoiGraph, network: RoadNetwork) -> PoiGraph:
    """Return the graph after an edit. Raises InputError with what is wrong, and what to do."""
    match edit:
        case AddPoi(name, kind, x_m, y_m, on_road, spoken_name, notes):
            return edits.add_poi(
                graph, network, name=name, kind=kind, x_m=x_m, y_m=y_m, on_road=on_road, spoken_name=spoken_name,
                notes=notes,
            )  # fmt: skip
        case MovePoi(poi_id, x_m, y_m, on_road):
            return edits.move_poi(graph, network, poi_id, x_m, y_m, on_road)
        case UpdatePoi(poi_id, name, kind, spoken_name, notes):
            return edits.update_poi(graph, poi_id, name=name, kind=kind, spoken_name=spoken_name, notes=notes)
        case DeletePoi(poi_id):
            return edits.delete_poi(graph, poi_id)
        case AddEdge(a, b):
            return edits.add_edge(graph, network, a, b)
        case DeleteEdge(edge_id):
            return edits.delete_edge(graph, edge_id)
        case SetEdge(edge_id, one_way, closed, cost_multiplier):
            return edits.set_edge(graph, edge_id, one_way=one_way, closed=closed, cost_multiplier=cost_multiplier)
        case ProposeEdges():
            return edits.propose_edges(graph, network)

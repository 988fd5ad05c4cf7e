"""The edits of the PoI-graph as values: what the scene, the forms and the log on disk share.

``evaluate`` makes a new graph from an old one and an edit, with the pure functions of ``navcore.planning.edits``.
"""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec

from navcore.planning import edits, road_edits
from navcore.planning.poi_graph import CautionSide, Identifier, Metres, Name, PoiGraph, PoiKind
from navcore.planning.road_network import RoadNetwork

ShortName = Annotated[str, msgspec.Meta(max_length=80)]
Notes = Annotated[str, msgspec.Meta(max_length=2000)]
Place = tuple[Metres, Metres]
ThingKind = Literal["poi", "edge", "road"]
Thing = tuple[ThingKind, str]
"""What an edit changes: which kind of thing, and its identifier."""


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
    """Change how an edge may be walked; None leaves a value as it is.

    A width of 0 makes it unknown; ``turned`` lets the edge lead from b to a.
    """

    edge_id: Identifier
    one_way: bool | None = None
    closed: bool | None = None
    cost_multiplier: Annotated[float, msgspec.Meta(ge=1.0, le=100.0)] | None = None
    width_m: Annotated[float, msgspec.Meta(ge=0.0, le=50.0)] | None = None
    caution_side: CautionSide | None = None
    turned: bool = False


class MergePois(_Edit, frozen=True, tag="merge_pois"):
    """Make one place of two: ``other_id`` goes, and its edges lead to ``poi_id``."""

    poi_id: Identifier
    other_id: Identifier


class SplitEdge(_Edit, frozen=True, tag="split_edge"):
    """Tag a place on an edge: two edges, walked as the whole one was."""

    edge_id: Identifier
    x_m: Metres
    y_m: Metres
    name: Name
    kind: PoiKind = "junction"


class DrawRoad(_Edit, frozen=True, tag="draw_road"):
    """Draw a line of road where nobody walked; its ends begin on roads that are near."""

    points_m: Annotated[tuple[Place, ...], msgspec.Meta(min_length=2, max_length=road_edits.MAX_POINTS_COUNT)]


class TrimRoad(_Edit, frozen=True, tag="trim_road"):
    """Keep of a road what lies between two places on it."""

    road_id: Identifier
    start_m: Place
    end_m: Place


class SmoothRoad(_Edit, frozen=True, tag="smooth_road"):
    """Take the sway of whoever recorded it out of a road."""

    road_id: Identifier
    window_m: Annotated[float, msgspec.Meta(ge=0.2, le=5.0)] = 1.0


class SplitRoad(_Edit, frozen=True, tag="split_road"):
    """Cut a road in two."""

    road_id: Identifier
    place_m: Place


class JoinRoads(_Edit, frozen=True, tag="join_roads"):
    """Make one road of two, by the ends that are nearest to each other."""

    road_id: Identifier
    other_id: Identifier


class DeleteRoad(_Edit, frozen=True, tag="delete_road"):
    """Remove a road on which nothing stands."""

    road_id: Identifier


class ProposeEdges(_Edit, frozen=True, tag="propose_edges"):
    """Join all neighbours along the road: the whole graph at one stroke."""


PoiEdit = AddPoi | MovePoi | UpdatePoi | DeletePoi | MergePois
EdgeEdit = AddEdge | DeleteEdge | SetEdge | SplitEdge | ProposeEdges
RoadEdit = DrawRoad | TrimRoad | SmoothRoad | SplitRoad | JoinRoads | DeleteRoad
Edit = PoiEdit | EdgeEdit | RoadEdit


def evaluate(edit: Edit, graph: PoiGraph, network: RoadNetwork) -> PoiGraph:
    """Return the graph after an edit. Raises InputError with what is wrong, and what to do."""
    if isinstance(edit, RoadEdit):
        return _with_road_edit(edit, graph)
    return _with_edge_edit(edit, graph, network) if isinstance(edit, EdgeEdit) else _with_poi_edit(edit, graph, network)


def _with_poi_edit(edit: PoiEdit, graph: PoiGraph, network: RoadNetwork) -> PoiGraph:
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
        case MergePois(poi_id, other_id):
            return edits.merge_pois(graph, network, poi_id, other_id)


def _with_edge_edit(edit: EdgeEdit, graph: PoiGraph, network: RoadNetwork) -> PoiGraph:
    match edit:
        case AddEdge(a, b):
            return edits.add_edge(graph, network, a, b)
        case DeleteEdge(edge_id):
            return edits.delete_edge(graph, edge_id)
        case SetEdge(edge_id, one_way, closed, cost_multiplier, width_m, caution_side, turned):
            return edits.set_edge(
                graph, edge_id, one_way=one_way, closed=closed, cost_multiplier=cost_multiplier, width_m=width_m,
                caution_side=caution_side, turned=turned,
            )  # fmt: skip
        case SplitEdge(edge_id, x_m, y_m, name, kind):
            return edits.split_edge(graph, network, edge_id, x_m, y_m, name=name, kind=kind)
        case ProposeEdges():
            return edits.propose_edges(graph, network)


def _with_road_edit(edit: RoadEdit, graph: PoiGraph) -> PoiGraph:
    match edit:
        case DrawRoad(points_m):
            return road_edits.draw_road(graph, points_m)
        case TrimRoad(road_id, start_m, end_m):
            return road_edits.trim_road(graph, road_id, start_m, end_m)
        case SmoothRoad(road_id, window_m):
            return road_edits.smooth_road(graph, road_id, window_m)
        case SplitRoad(road_id, place_m):
            return road_edits.split_road(graph, road_id, place_m)
        case JoinRoads(road_id, other_id):
            return road_edits.join_roads(graph, road_id, other_id)
        case DeleteRoad(road_id):
            return road_edits.delete_road(graph, road_id)


def touched(edit: Edit, graph: PoiGraph) -> tuple[Thing, ...]:
    """Return the things that somebody had in mind who asked for this edit: where another has changed one, they clash.

    What merely follows, as edges follow a place that moves, is not among them: it is computed anew, and nothing of
    anybody's is lost.
    """
    match edit:
        case DeletePoi(poi_id):
            edges = (edge.id for edge in graph.edges.values() if poi_id in (edge.a, edge.b))
            return (("poi", poi_id), *(("edge", edge_id) for edge_id in edges))
        case MovePoi(poi_id) | UpdatePoi(poi_id):
            return (("poi", poi_id),)
        case MergePois(poi_id, other_id):
            return (("poi", poi_id), ("poi", other_id))
        case DeleteEdge(edge_id) | SetEdge(edge_id) | SplitEdge(edge_id):
            return (("edge", edge_id),)
        case TrimRoad(road_id) | SmoothRoad(road_id) | SplitRoad(road_id) | DeleteRoad(road_id):
            return (("road", road_id),)
        case JoinRoads(road_id, other_id):
            return (("road", road_id), ("road", other_id))
        case _:
            return ()

"""Edits of the PoI-graph: each takes a graph and gives a new one, one version on, or raises and changes nothing.

Whatever the sequence of edits, the graph stays valid (:func:`validate`): edges join PoIs that exist, follow the road,
and carry its real length.
"""

from __future__ import annotations

import itertools
import math
import re
import unicodedata
from collections.abc import Collection, Mapping
from typing import get_args

import msgspec
import numpy as np
from scipy.spatial import cKDTree

from navcore.errors import InputError, PlanningError
from navcore.geometry import FloatArray
from navcore.misfit import words_of
from navcore.plain_text import is_blank, refuse_hidden
from navcore.planning.neighbours import neighbour_pieces
from navcore.planning.poi_graph import CAUTION_SIDES, POI_KINDS, CautionSide, Edge, Poi, PoiGraph, PoiKind
from navcore.planning.projection import path_between, project_on_path
from navcore.planning.road_joining import SPACING_M, evenly_spaced
from navcore.planning.road_network import RoadNetwork, RoadPiece

MAX_SNAP_DISTANCE_M = 2.0
"""A PoI that is put farther from the road than this is refused: it would jump to where nobody meant it."""
OTHER_SIDE: Mapping[CautionSide, CautionSide] = {"none": "none", "both": "both", "left": "right", "right": "left"}
"""The side of an edge as it is called by whoever walks it the other way."""
_SAME_PLACE_M = 0.05
_SAME_CORRIDOR_M = 0.5
"""Passes nearer to each other than this are one road (:meth:`RoadNetwork.from_roads`)."""
_BEGINNING_M = 1.0
_LENGTH_TOLERANCE_M = 1e-6


# ---------------------------------------------------------------------------------------------------------- PoIs
def add_poi(
    graph: PoiGraph,
    network: RoadNetwork,
    *,
    name: str,
    kind: PoiKind,
    x_m: float,
    y_m: float,
    on_road: bool = True,
    spoken_name: str = "",
    notes: str = "",
    poi_id: str | None = None,
) -> PoiGraph:
    """Tag a place; it snaps to the road unless it is free-standing (``on_road=False``).

    Without ``poi_id`` an unused one is made of the name; the new PoI is the last one of ``graph.pois``.

    Raises InputError where the id is taken, the name or kind is unfit, or the road is too far.
    """
    poi_id = free_poi_id(graph, name) if poi_id is None else poi_id
    if poi_id in graph.pois:
        raise InputError(f"There is a place with the identifier {poi_id!r} already: choose another one.")
    x_m, y_m = _placed(network, x_m, y_m, on_road)
    poi = _checked_poi(Poi(poi_id, name, kind, x_m, y_m, on_road, spoken_name, notes))
    return _next(graph, pois={**graph.pois, poi_id: poi})


def move_poi(
    graph: PoiGraph, network: RoadNetwork, poi_id: str, x_m: float, y_m: float, on_road: bool = True
) -> PoiGraph:
    """Move a place; it slides along the road, and its edges are made again along the road.

    Where an edge leads along another corridor then, its width and its side of caution, which belong to the old one,
    are unknown again: "none" and None. Whether it is closed or one-way stays.

    Raises InputError where it is unknown, too far from the road, or an edge of it could not follow.
    """
    poi = _poi(graph, poi_id)
    x_m, y_m = _placed(network, x_m, y_m, on_road)
    ends = [edge for edge in graph.edges.values() if poi_id in (edge.a, edge.b)]
    if ends and not on_road:
        raise InputError(f"{poi.name} has edges along the road and must stay on it: delete its edges first.")
    moved = msgspec.structs.replace(poi, x_m=x_m, y_m=y_m, on_road=on_road)
    pois = {**graph.pois, poi_id: moved}
    followed = {edge.id: _followed(network, pois, edge, edge, poi) for edge in ends}
    return _next(graph, pois=pois, edges={**graph.edges, **followed})


def update_poi(
    graph: PoiGraph,
    poi_id: str,
    *,
    name: str | None = None,
    kind: PoiKind | None = None,
    spoken_name: str | None = None,
    notes: str | None = None,
) -> PoiGraph:
    """Change what a place is called; None leaves a value as it is. Raises InputError."""
    poi = _poi(graph, poi_id)
    given = {"name": name, "kind": kind, "spoken_name": spoken_name, "notes": notes}
    changes = {key: value for key, value in given.items() if value is not None}
    return _next(graph, pois={**graph.pois, poi_id: _checked_poi(msgspec.structs.replace(poi, **changes))})


def rename_poi(graph: PoiGraph, poi_id: str, name: str) -> PoiGraph:
    """Give a place another name. Raises InputError."""
    return update_poi(graph, poi_id, name=name)


def merge_pois(graph: PoiGraph, network: RoadNetwork, poi_id: str, other_id: str) -> PoiGraph:
    """Make one place of two: ``other_id`` goes, its edges lead to ``poi_id``, which stays as it is.

    Edges that follow are treated as where a place is moved. An edge between the two goes as well, and of two edges to
    the same place the one that ``poi_id`` had stays. Raises InputError where one is unknown, an edge cannot follow,
    two edges to the same place differ in whether they are closed, in the direction in which they may be walked, or in
    the side of caution, or the edge that goes has one of these while others would lead along there.
    """
    if _poi(graph, poi_id) is _poi(graph, other_id):
        raise InputError(f"Merging takes two different places, not {graph.pois[poi_id].name} twice.")
    _refuse_between(graph, poi_id, other_id)
    pois = {key: poi for key, poi in graph.pois.items() if key != other_id}
    edges = {key: edge for key, edge in graph.edges.items() if other_id not in (edge.a, edge.b)}
    kept = {frozenset((edge.a, edge.b)): edge for edge in edges.values()}
    for edge in graph.edges.values():
        ends = {poi_id if end == other_id else end: None for end in (edge.a, edge.b)}
        if other_id not in (edge.a, edge.b) or len(ends) < 2:
            continue
        a, b = ends
        led = msgspec.structs.replace(edge, a=a, b=b)
        if frozenset(ends) in kept:
            _refuse_differing(graph, kept[frozenset(ends)], led, (poi_id, other_id))
        else:
            edges[edge.id] = _followed(network, pois, edge, led, graph.pois[other_id])
    return _next(graph, pois=pois, edges=edges)


def delete_poi(graph: PoiGraph, poi_id: str) -> PoiGraph:
    """Remove a place and the edges that end there. Raises InputError where it is unknown."""
    _poi(graph, poi_id)
    pois = {key: poi for key, poi in graph.pois.items() if key != poi_id}
    edges = {key: edge for key, edge in graph.edges.items() if poi_id not in (edge.a, edge.b)}
    return _next(graph, pois=pois, edges=edges)


# --------------------------------------------------------------------------------------------------------- edges
def add_edge(graph: PoiGraph, network: RoadNetwork, a: str, b: str, *, edge_id: str | None = None) -> PoiGraph:
    """Join two places by the piece of road between them; its length is the real one.

    Raises InputError for the same place twice, a free-standing place, an edge that exists, or where no road leads.
    """
    first, second = _poi(graph, a), _poi(graph, b)
    if a == b:
        raise InputError(f"An edge needs two different places, not {first.name} twice.")
    if edge_between(graph, a, b) is not None:
        raise InputError(f"{first.name} and {second.name} are joined already: change that edge instead.")
    edge_id = free_edge_id(graph.edges) if edge_id is None else edge_id
    if edge_id in graph.edges:
        raise InputError(f"There is an edge with the identifier {edge_id!r} already: choose another one.")
    edge = along_road(network, graph.pois, Edge(edge_id, a, b, (), 0.0))
    return _next(graph, edges={**graph.edges, edge_id: edge})


def delete_edge(graph: PoiGraph, edge_id: str) -> PoiGraph:
    """Remove an edge. Raises InputError where it is unknown."""
    _edge(graph, edge_id)
    return _next(graph, edges={key: edge for key, edge in graph.edges.items() if key != edge_id})


def set_edge(
    graph: PoiGraph,
    edge_id: str,
    *,
    one_way: bool | None = None,
    closed: bool | None = None,
    cost_multiplier: float | None = None,
    width_m: float | None = None,
    caution_side: CautionSide | None = None,
    turned: bool = False,
) -> PoiGraph:
    """Change how an edge may be walked; None leaves a value as it is, a width of 0 makes it unknown.

    ``turned`` lets it lead from b to a: a one-way edge leads the other way then, and the side of caution, which stays
    where it is in the building, has its other name. Raises InputError.
    """
    edge = _edge(graph, edge_id)
    if turned:
        edge = _turned(edge)
    if width_m is not None and width_m != 0.0 and not 0.3 <= width_m <= 50.0:
        raise InputError(f"A passage cannot be {width_m:g} m wide: give 0.3 to 50 m, or 0 where it is not known.")
    if caution_side is not None and caution_side not in CAUTION_SIDES:
        raise InputError(f"There is no side {caution_side!r}: choose one of {', '.join(CAUTION_SIDES)}.")
    if cost_multiplier is not None and not 1.0 <= cost_multiplier <= 100.0:
        raise InputError(f"The cost of an edge cannot be {cost_multiplier:g}: give a number from 1 to 100.")
    given = {
        "one_way": one_way, "closed": closed, "cost_multiplier": cost_multiplier, "width_m": width_m,
        "caution_side": caution_side,
    }  # fmt: skip
    changes: dict[str, object] = {key: value for key, value in given.items() if value is not None}
    if width_m == 0.0:
        changes["width_m"] = None
    return _next(graph, edges={**graph.edges, edge_id: msgspec.structs.replace(edge, **changes)})


def split_edge(
    graph: PoiGraph, network: RoadNetwork, edge_id: str, x_m: float, y_m: float, *, name: str, kind: PoiKind
) -> PoiGraph:
    """Tag a place on an edge, at its point nearest to (x, y): two edges, walked as the whole one was.

    Raises InputError where the edge is unknown, or that point is too near to one of its ends.
    """
    edge = _edge(graph, edge_id)
    if not (math.isfinite(x_m) and math.isfinite(y_m)):
        raise InputError("A place needs two coordinates in metres.")
    path = np.array(edge.path_m)
    cut = project_on_path(path, x_m, y_m)
    if min(cut.arc_length_m, edge.length_m - cut.arc_length_m) < _SAME_PLACE_M:
        raise InputError("There is a place at this end of the connection already: choose a point farther inside.")
    graph = add_poi(graph, network, name=name, kind=kind, x_m=cut.x_m, y_m=cut.y_m)
    middle = next(reversed(graph.pois))
    second_id = free_edge_id(graph.edges)
    ways = (
        (edge_id, edge.a, middle, path_between(path, 0.0, cut.arc_length_m)),
        (second_id, middle, edge.b, path_between(path, cut.arc_length_m, edge.length_m)),
    )
    parts = {
        key: edge_of_piece(msgspec.structs.replace(edge, id=key, a=a, b=b), graph.pois, RoadPiece(part, 0.0))
        for key, a, b, part in ways
    }
    # The new place and the edges are one edit.
    return PoiGraph(graph.version, graph.pois, {**graph.edges, **parts}, graph.roads)


def propose_edges(graph: PoiGraph, network: RoadNetwork) -> PoiGraph:
    """Join all places that are neighbours along the road: no third place lies on the road between them.

    Edges that exist are kept as they are. Raises InputError where nothing is left to join.
    """
    points = {key: network.nearest(poi.x_m, poi.y_m) for key, poi in graph.pois.items() if poi.on_road}
    joined = {frozenset((edge.a, edge.b)) for edge in graph.edges.values()}
    edges = dict(graph.edges)
    for (a, b), piece in neighbour_pieces(network, points).items():
        if frozenset((a, b)) not in joined and math.dist(points[a].xy_m, points[b].xy_m) >= _SAME_PLACE_M:
            edge_id = free_edge_id(edges)
            edges[edge_id] = edge_of_piece(Edge(edge_id, a, b, (), 0.0), graph.pois, piece)
    if len(edges) == len(graph.edges):
        raise InputError("All places that are neighbours along the road are joined already.")
    return _next(graph, edges=edges)


def edge_between(graph: PoiGraph, a: str, b: str) -> Edge | None:
    """Return the edge that joins two places, in whichever direction, or None."""
    return next((edge for edge in graph.edges.values() if {edge.a, edge.b} == {a, b}), None)


# ---------------------------------------------------------------------------------------------------------- laws
def validate(graph: PoiGraph) -> None:
    """Raise InputError, naming the first fault, where the graph breaks a law; every edit keeps all of them."""
    for key, poi in graph.pois.items():
        if key != poi.id:
            raise InputError(f"The place {poi.id!r} is filed under {key!r}: import the graph again.")
        _checked_poi(poi)
    if (loose := graph.loose_edge()) is not None:
        raise InputError(f"The edge {loose.id} does not join two places of the graph: delete it.")
    pairs: set[frozenset[str]] = set()
    for key, edge in graph.edges.items():
        if key != edge.id:
            raise InputError(f"The edge {edge.id!r} is filed under {key!r}: import the graph again.")
        if frozenset((edge.a, edge.b)) in pairs:
            raise InputError(f"The edge {edge.id} joins places that another edge joins already: delete one.")
        pairs.add(frozenset((edge.a, edge.b)))
        _check_edge(graph, edge)
    for key, road in graph.roads.items():
        if key != road.id:
            raise InputError(f"The road {road.id!r} is filed under {key!r}: import the graph again.")
        if len(road.points_m) < 2:
            raise InputError(f"The road {road.id} has fewer than two points: delete it, or draw it again.")


def _check_edge(graph: PoiGraph, edge: Edge) -> None:
    if len(edge.path_m) < 2 or abs(_length_m(np.array(edge.path_m)) - edge.length_m) > _LENGTH_TOLERANCE_M:
        raise InputError(f"The length of edge {edge.id} is not that of its piece of road: draw it again.")
    for poi_id, end in ((edge.a, edge.path_m[0]), (edge.b, edge.path_m[-1])):
        poi = graph.pois[poi_id]
        if not poi.on_road or math.dist((poi.x_m, poi.y_m), end) > _LENGTH_TOLERANCE_M:
            raise InputError(f"The edge {edge.id} does not end at {poi.name}: draw it again.")
    if not 1.0 <= edge.cost_multiplier <= 100.0:
        raise InputError(f"The cost of edge {edge.id} must be between 1 and 100: change it.")


# ------------------------------------------------------------------------------------------------------- parts
def free_poi_id(graph: PoiGraph, name: str) -> str:
    """Return an identifier that reads like the name and is not taken."""
    ascii_name = unicodedata.normalize("NFKD", name).encode("ascii", "ignore").decode()
    stem = re.sub(r"[^a-z0-9]+", "-", ascii_name.lower()).strip("-")[:48] or "place"
    if stem not in graph.pois:
        return stem
    return next(f"{stem}-{n}" for n in itertools.count(2) if f"{stem}-{n}" not in graph.pois)


def free_edge_id(edges: Mapping[str, Edge]) -> str:
    """Return an identifier that no edge has."""
    return free_numbered_id("e", edges)


def free_numbered_id(letter: str, taken: Collection[str]) -> str:
    """Return a letter with the number after the highest one that is taken; longer numbers, of imports, are passed."""
    numbers = [int(key[1:]) for key in taken if re.fullmatch(rf"{letter}[0-9]{{1,9}}", key)]
    first = max(numbers, default=0) + 1
    return next(key for key in (f"{letter}{n}" for n in itertools.count(first)) if key not in taken)


def _next(graph: PoiGraph, pois: dict[str, Poi] | None = None, edges: dict[str, Edge] | None = None) -> PoiGraph:
    return PoiGraph(
        graph.version + 1, graph.pois if pois is None else pois, graph.edges if edges is None else edges, graph.roads
    )


def _followed(network: RoadNetwork, pois: Mapping[str, Poi], old: Edge, edge: Edge, moved: Poi) -> Edge:
    """Lay an edge along the road to where one of its places is now, which stood at ``moved`` on the edge ``old``."""
    laid = along_road(network, pois, edge)
    if edge.width_m is None and edge.caution_side == "none":
        return laid
    is_start = old.a == moved.id
    new_end = pois[laid.a if is_start else laid.b]
    from_m, to_m = network.nearest(moved.x_m, moved.y_m), network.nearest(new_end.x_m, new_end.y_m)
    turn = -1 if is_start else 1
    try:
        slide_m = network.shortest_piece(from_m, to_m).path_m
    except PlanningError:
        slide_m = None
    if slide_m is not None and _same_corridor(np.array(old.path_m)[::turn], np.array(laid.path_m)[::turn], slide_m):
        return laid
    return msgspec.structs.replace(laid, width_m=None, caution_side="none")


def _same_corridor(old_m: FloatArray, new_m: FloatArray, slide_m: FloatArray) -> bool:
    """Whether a way (n, 2) begins along an old one from the same place, and leaves it only by where its end slid."""
    first_m = min(_BEGINNING_M, _length_m(old_m), _length_m(new_m))
    start = path_between(new_m, 0.0, first_m)[-1]
    if project_on_path(old_m, *start.tolist()).distance_m > first_m / 2:
        return False
    known_m = np.vstack([evenly_spaced(old_m, SPACING_M), evenly_spaced(slide_m, SPACING_M)])
    far_m, _ = cKDTree(known_m).query(evenly_spaced(new_m, SPACING_M))
    return bool(np.max(far_m) < _SAME_CORRIDOR_M)


def _refuse_between(graph: PoiGraph, poi_id: str, other_id: str) -> None:
    between = edge_between(graph, poi_id, other_id)
    if between is None or not (between.closed or between.one_way or between.caution_side != "none"):
        return
    if any(other_id in (edge.a, edge.b) for edge in graph.edges.values() if edge is not between):
        first, other = graph.pois[poi_id].name, graph.pois[other_id].name
        raise InputError(
            f"The connection of {first} and {other} is closed, one-way or has a side of caution, and those of {other}"
            " would lead along there without it: set these alike first, and then delete that connection."
        )


def _refuse_differing(graph: PoiGraph, kept: Edge, going: Edge, merged: tuple[str, str]) -> None:
    alike = going if going.a == kept.a else _turned(going)
    differing = [
        what
        for what, is_other in (
            ("being closed", kept.closed != going.closed),
            ("the direction", kept.one_way != going.one_way or (kept.one_way and going.a != kept.a)),
            ("the side of caution", kept.caution_side != alike.caution_side),
        )
        if is_other
    ]
    if differing:
        third = kept.b if kept.a == merged[0] else kept.a
        first, other, joined = (graph.pois[key].name for key in (*merged, third))
        raise InputError(
            f"{first} and {other} are both joined to {joined}, and these connections differ in"
            f" {' and '.join(differing)}: make them alike, or delete one of them first."
        )


def _turned(edge: Edge) -> Edge:
    return msgspec.structs.replace(
        edge, a=edge.b, b=edge.a, path_m=edge.path_m[::-1], caution_side=OTHER_SIDE[edge.caution_side]
    )


def _poi(graph: PoiGraph, poi_id: str) -> Poi:
    if poi_id not in graph.pois:
        raise InputError(f"There is no place {poi_id!r} in the graph: it may have been deleted meanwhile.")
    return graph.pois[poi_id]


def _edge(graph: PoiGraph, edge_id: str) -> Edge:
    if edge_id not in graph.edges:
        raise InputError(f"There is no edge {edge_id!r} in the graph: it may have been deleted meanwhile.")
    return graph.edges[edge_id]


def _placed(network: RoadNetwork, x_m: float, y_m: float, on_road: bool) -> tuple[float, float]:
    if not (math.isfinite(x_m) and math.isfinite(y_m)) or max(abs(x_m), abs(y_m)) > 100_000.0:
        raise InputError("A place needs two coordinates in metres, within 100 km of the origin.")
    if not on_road:
        return x_m, y_m
    if network.is_empty:
        raise InputError("There is no virtual blind road to put a place on: build the map from a walk first.")
    point = network.nearest(x_m, y_m)
    if point.distance_m > MAX_SNAP_DISTANCE_M:
        raise InputError(
            f"That is {point.distance_m:.1f} m from the road, but a place must be within {MAX_SNAP_DISTANCE_M:g} m of"
            " it: choose a place on the road."
        )
    return point.xy_m


def _checked_poi(poi: Poi) -> Poi:
    if poi.kind not in get_args(PoiKind):
        raise InputError(f"There is no kind of place {poi.kind!r}: choose one of {', '.join(POI_KINDS)}.")
    if is_blank(poi.name):
        raise InputError("A place needs a name.")
    refuse_hidden("The name of this place", poi.name)
    refuse_hidden(f"The spoken name of {poi.name[:80]}", poi.spoken_name)
    refuse_hidden(f"What is noted on {poi.name[:80]}", poi.notes, may_break=True)
    try:
        return msgspec.convert(msgspec.to_builtins(poi), Poi)
    except msgspec.ValidationError as error:
        raise InputError(f"The place {poi.name[:80]!r} is not usable ({words_of(error)}): correct it.") from error


def along_road(network: RoadNetwork, pois: Mapping[str, Poi], edge: Edge) -> Edge:
    """Return the edge with the shortest piece of road between its ends. Raises InputError where there is none."""
    first, second = pois[edge.a], pois[edge.b]
    for poi in (first, second):
        if not poi.on_road:
            raise InputError(f"{poi.name} does not stand on the road: move it onto the road first.")
    if network.is_empty:
        raise InputError("There is no virtual blind road for an edge: build the map from a walk first.")
    start, end = network.nearest(first.x_m, first.y_m), network.nearest(second.x_m, second.y_m)
    if math.dist(start.xy_m, end.xy_m) < _SAME_PLACE_M:
        raise InputError(f"{first.name} and {second.name} stand on the same spot: move one of them along the road.")
    try:
        piece = network.shortest_piece(start, end)
    except PlanningError as error:
        raise InputError(
            f"No road leads from {first.name} to {second.name}: record the walk between them, or choose others."
        ) from error
    return edge_of_piece(edge, pois, piece)


def edge_of_piece(edge: Edge, pois: Mapping[str, Poi], piece: RoadPiece) -> Edge:
    """Return the edge with a piece of road as its own, from one of its places exactly to the other."""
    path = piece.path_m.copy()
    path[0] = pois[edge.a].x_m, pois[edge.a].y_m
    path[-1] = pois[edge.b].x_m, pois[edge.b].y_m
    points = tuple((float(x), float(y)) for x, y in path)
    return msgspec.structs.replace(edge, path_m=points, length_m=_length_m(path))


def _length_m(path_m: FloatArray) -> float:
    return float(np.hypot(*np.diff(path_m, axis=0).T).sum())

"""A PoI-graph from a file: what the draft would be with it, and what would change.

A file that this program wrote holds a whole graph, which takes the draft's place. What another program drew holds
places, lines and links, which are added to the draft by the same edits that people make: nothing is removed.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import cast

import msgspec
import numpy as np

from navcore import graph_geojson, graph_graphml
from navcore.errors import InputError
from navcore.foreign_map import ForeignLine, ForeignLink, ForeignMap, ForeignPlace, Point, shown
from navcore.planning import edits
from navcore.planning.poi_graph import Poi, PoiGraph, PoiKind
from navcore.planning.road_edits import (
    MAX_ROADS_LENGTH_M,
    checked_line,
    draw_roads,
    network_of,
    refuse_too_wide,
    without_road,
)
from navcore.planning.road_joining import evenly_spaced
from navcore.planning.road_network import RoadNetwork

MAX_GRAPH_FILE_BYTES = 16 << 20
MAX_POINT_COUNT = 400_000
"""Forty kilometres of road with a point every 0.1 m; looked at before anything is read, for each takes memory."""
MAX_FOREIGN_COUNT = 3000
"""Places, lines and links of a file of another program: each is an edit of its own."""
MAX_FOREIGN_LENGTH_M = 10_000.0
"""All lines of a file of another program: they are walked through to find where they join."""
END_DISTANCE_M = 0.5
"""A line that ends so near to a place is meant to end at it."""
SAME_ROAD_M = 0.25
"""A line that is nowhere farther from a road than this is that road."""
_STEP_M = 0.5
_SAME_PLACE_M = 0.05
_FRAME_NOTE = "The file does not say where it lies: its coordinates are taken as metres of this map."
GRAPH_FORMS = {"geojson": graph_geojson.encode, "graphml": graph_graphml.encode}
"""By the ending of a file's name: graph, id and name of the site → bytes."""


@dataclass(frozen=True, slots=True)
class GraphImport:
    """What an import makes of a draft."""

    graph: PoiGraph
    """Valid, one version after the draft."""
    is_whole: bool
    """The file held a whole graph, which takes the place of the draft's; else the draft has grown."""
    unused: tuple[str, ...]
    """A sentence for each thing that cannot be used, beginning with what it is."""
    notes: tuple[str, ...] = ()
    """What somebody should look at before they take it."""


def imported(data: bytes, draft: PoiGraph) -> GraphImport:
    """Return what the draft, with its roads, becomes by a GeoJSON or GraphML file, told apart by its contents.

    A whole graph without roads lies on those of the draft. Raises InputError, saying what is wrong with the file, or
    naming the first fault of its graph.
    """
    found = read_graph(data)
    _refuse_too_much(found)
    if isinstance(found, PoiGraph):
        graph = msgspec.structs.replace(found, roads=found.roads or draft.roads)
        refuse_too_wide(graph.roads, draft.roads)
        unused: tuple[str, ...] = ()
        notes = _notes(graph)
    else:
        graph, unused = _grown(draft, found)
        notes = (_FRAME_NOTE,)
    edits.validate(graph)
    numbered = msgspec.structs.replace(graph, version=draft.version + 1)
    return GraphImport(numbered, isinstance(found, PoiGraph), unused, notes)


def _notes(graph: PoiGraph) -> tuple[str, ...]:
    off_road = without_road(graph, network_of(graph.roads), graph.pois, graph.edges)
    if off_road is None:
        return ()
    return (f"{off_road} lies on no road here, and others may: see whether the file is of this site.",)


def read_graph(data: bytes) -> PoiGraph | ForeignMap:
    """Return what a GeoJSON or GraphML file holds. Raises InputError, saying what is wrong with it."""
    if len(data) > MAX_GRAPH_FILE_BYTES:
        raise InputError(f"The file is larger than {MAX_GRAPH_FILE_BYTES >> 20} MiB: import a part of it.")
    try:
        text = data.decode("utf-8-sig").lstrip().encode()
    except UnicodeDecodeError as error:
        raise InputError(f"The file is no text in UTF-8 (byte {error.start}): save it in UTF-8.") from error
    if text.count(b"[") > MAX_POINT_COUNT:
        raise InputError(f"The file holds more than {MAX_POINT_COUNT} points: import a part of it, or thin its lines.")
    if text.startswith(b"{"):
        return graph_geojson.decode(text)
    if text.startswith(b"<"):
        return graph_graphml.decode(text)
    raise InputError("The file is neither GeoJSON nor GraphML: export the graph in one of the two.")


def _refuse_too_much(found: PoiGraph | ForeignMap) -> None:
    if isinstance(found, PoiGraph):
        lines, longest_m = [road.points_m for road in found.roads.values()], MAX_ROADS_LENGTH_M
    else:
        lines, longest_m = [line.points_m for line in found.lines], MAX_FOREIGN_LENGTH_M
        if len(found.places) + len(found.lines) + len(found.links) > MAX_FOREIGN_COUNT:
            raise InputError(f"The file holds more than {MAX_FOREIGN_COUNT} places and lines: import a part of it.")
    length_m = sum(math.dist(a, b) for line in lines for a, b in itertools.pairwise(line))
    if length_m > longest_m:
        raise InputError(
            f"The lines of the file are {length_m / 1000:.0f} km long, and {longest_m / 1000:g} km are taken: import a"
            " part of it, and see that its unit is metres."
        )


# ------------------------------------------------------------------------------------------- of other programs
@dataclass(slots=True)
class _Growing:
    """The draft while things are added to it."""

    graph: PoiGraph
    network: RoadNetwork
    unused: list[str]
    ids: dict[str, str]
    """PoI by its key in the file."""
    places: list[tuple[Point, str]]
    """PoI by where the file has it, for snapping has moved it."""


def _grown(draft: PoiGraph, found: ForeignMap) -> tuple[PoiGraph, tuple[str, ...]]:
    draft_network, unused = network_of(draft.roads), list(found.unused)
    lines = [line.points_m for line in found.lines if _is_new_road(draft_network, line, unused)]
    graph = draw_roads(draft, lines) if lines else draft
    network = network_of(graph.roads) if lines else draft_network
    growing = _Growing(graph, network, unused, {}, [])
    growing.places += [((poi.x_m, poi.y_m), poi.id) for poi in growing.graph.pois.values()]
    for place in found.places:
        _add_place(growing, place)
    for line in found.lines:
        ends = (_place_near(growing, line.points_m[0]), _place_near(growing, line.points_m[-1]))
        if ends[0] is not None and ends[1] is not None and ends[0] != ends[1]:
            _add_edge(growing, line.label, ends[0], ends[1])
    for link in found.links:
        _add_link(growing, link)
    return growing.graph, tuple(growing.unused)


def _is_new_road(network: RoadNetwork, line: ForeignLine, unused: list[str]) -> bool:
    """Whether a line can be drawn, and there is no road all along it yet."""
    try:
        points = checked_line(line.points_m)
    except InputError as error:
        unused.append(f"{line.label}: {error}")
        return False
    return bool((network.distances_m(evenly_spaced(np.array(points), _STEP_M)) > SAME_ROAD_M).any())


def _add_place(growing: _Growing, place: ForeignPlace) -> None:
    x_m, y_m = place.place_m
    graph, network = growing.graph, growing.network
    known = [poi for poi in graph.pois.values() if poi.name.casefold() == place.name.casefold()]
    label = f"Place {shown(place.name)}"
    if len(known) > 1:
        growing.unused.append(f"{label}: several places have this name, and it cannot be told which is meant.")
        return
    on_road = not network.is_empty and network.nearest(x_m, y_m).distance_m <= edits.MAX_SNAP_DISTANCE_M
    try:
        if known:
            poi_id = known[0].id
            growing.graph = _moved(graph, network, known[0], place, on_road)
        else:
            kind = cast("PoiKind", place.kind or "other")
            growing.graph = edits.add_poi(
                graph, network, name=place.name, kind=kind, x_m=x_m, y_m=y_m, on_road=on_road,
                spoken_name=place.spoken_name, notes=place.notes,
            )  # fmt: skip
            poi_id = next(reversed(growing.graph.pois))
    except InputError as error:
        growing.unused.append(f"{label}: {error}")
        return
    growing.places.append((place.place_m, poi_id))
    if place.key:
        growing.ids[place.key] = poi_id


def _moved(graph: PoiGraph, network: RoadNetwork, poi: Poi, place: ForeignPlace, on_road: bool) -> PoiGraph:
    """Return the graph with a place that it knows by name, as the file has it."""
    target_m = network.nearest(*place.place_m).xy_m if on_road else place.place_m
    if math.dist(target_m, (poi.x_m, poi.y_m)) > _SAME_PLACE_M:
        graph = edits.move_poi(graph, network, poi.id, *place.place_m, on_road)
    return edits.update_poi(
        graph,
        poi.id,
        kind=cast("PoiKind", place.kind) if place.kind else None,
        spoken_name=place.spoken_name or None,
        notes=place.notes or None,
    )


def _place_near(growing: _Growing, end_m: Point) -> str | None:
    near = [(math.dist(place_m, end_m), poi_id) for place_m, poi_id in growing.places]
    best = min(near, default=None)
    return best[1] if best is not None and best[0] <= END_DISTANCE_M else None


def _add_link(growing: _Growing, link: ForeignLink) -> None:
    a, b = growing.ids.get(link.a), growing.ids.get(link.b)
    if a is None or b is None:
        growing.unused.append(f"{link.label}: it does not join two places of the file that can be used.")
        return
    _add_edge(growing, link.label, a, b)


def _add_edge(growing: _Growing, label: str, a: str, b: str) -> None:
    if edits.edge_between(growing.graph, a, b) is not None:
        return
    try:
        growing.graph = edits.add_edge(growing.graph, growing.network, a, b)
    except InputError as error:
        growing.unused.append(f"{label}: as an edge, it cannot be used. {error}")

"""Edits of the road itself: each takes a graph with its roads and gives a new one, one version on, or raises.

PoIs and edges are put back on the road as it is then, edges along the same way. An edit that would take the road from
under one of them is refused, naming it: nothing is lost silently. What no road carried before is left as it is.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import msgspec
import numpy as np
from scipy.spatial import cKDTree

from navcore.errors import InputError
from navcore.geometry import FloatArray
from navcore.planning.edits import along_road, edge_of_piece, free_numbered_id
from navcore.planning.poi_graph import Edge, Poi, PoiGraph, Road, RoadOrigin
from navcore.planning.projection import arc_lengths_m, path_between, project_on_path
from navcore.planning.road_joining import SPACING_M, evenly_spaced
from navcore.planning.road_network import RoadNetwork, RoadPiece

MAX_SLIDE_M = 0.75
"""A place that would have to move farther to stand on the road again has lost it (as where a map grows)."""
MAX_JOIN_M = 2.0
"""Ends farther apart than this are not joined by a straight line: somebody draws what lies between."""
MEET_M = 0.5
"""The end of a drawn line that is nearer than this to a road begins on it: passes so near are one road."""
MAX_POINTS_COUNT = 5000
MIN_LENGTH_M, MAX_LENGTH_M = 0.3, 2000.0
MAX_ROADS_LENGTH_M = 40_000.0
"""All roads of a graph together: each edit walks through them to find where they join."""
MAX_SPAN_M2 = 600_000.0
"""The rectangle round all roads: in a larger one the cells in which roads are joined grow beyond 0.1 m."""
_SAME_ROAD_M = 0.05
_SMOOTHING_STEP_M = 0.1

Point = tuple[float, float]


def recorded_roads(roads_m: Sequence[FloatArray]) -> dict[str, Road]:
    """Return the walks of a site, polylines (n, 2) or (n, 3), as roads ``r1``, ``r2`` … of a graph."""
    lines = (_distinct([(float(x), float(y)) for x, y in np.asarray(road)[:, :2]]) for road in roads_m)
    long_enough = [line for line in lines if len(line) > 1]
    return {f"r{n}": Road(f"r{n}", line) for n, line in enumerate(long_enough, start=1)}


def network_of(roads: Mapping[str, Road]) -> RoadNetwork:
    """Return the network that the roads of a graph make."""
    return _network_of(tuple(roads.values()))


# The roads before an edit, those after it, and one more that somebody else looks at.
@lru_cache(maxsize=3)
def _network_of(roads: tuple[Road, ...]) -> RoadNetwork:
    recorded = [np.array(road.points_m) for road in roads if road.origin == "recorded"]
    drawn = [np.array(road.points_m) for road in roads if road.origin == "drawn"]
    return RoadNetwork.from_roads(recorded, drawn_m=drawn)


def drawn_lines_m(graph: PoiGraph) -> list[FloatArray]:
    """Return the lines (n, 2) of a graph that somebody has drawn."""
    return [np.array(road.points_m) for road in graph.roads.values() if road.origin == "drawn"]


def roads_with_drawn(roads_m: Sequence[FloatArray], drawn_m: Sequence[FloatArray]) -> dict[str, Road]:
    """Return recorded walks and drawn lines as the roads of a graph; none where nothing is drawn."""
    if not drawn_m:
        return {}
    roads = recorded_roads(roads_m)
    for line in drawn_m:
        road_id = _free_road_id(roads)
        roads[road_id] = _as_road(road_id, line, "drawn")
    return roads


def without_road(graph: PoiGraph, network: RoadNetwork, poi_ids: Iterable[str], edge_ids: Iterable[str]) -> str | None:
    """Return the name of the first of these that no road carries; None where all lie on one."""
    return next((_name(graph, thing) for thing in _off_road(graph, network, poi_ids, edge_ids)), None)


def newly_without_road(
    before: PoiGraph,
    after: PoiGraph,
    before_network: RoadNetwork,
    after_network: RoadNetwork,
    poi_ids: Iterable[str],
    edge_ids: Iterable[str],
) -> str | None:
    """Return the name of the first of these that a change leaves, or brings back, without a road.

    What no road carried ``before`` either is nothing that the change does. None where there is nothing else.
    """
    for thing in _off_road(after, after_network, poi_ids, edge_ids):
        was = before.pois.get(thing.id) if isinstance(thing, Poi) else before.edges.get(thing.id)
        if was is None or _is_carried(before_network, was):
            return _name(after, thing)
    return None


def _off_road(
    graph: PoiGraph, network: RoadNetwork, poi_ids: Iterable[str], edge_ids: Iterable[str]
) -> Iterator[Poi | Edge]:
    pois = (graph.pois[key] for key in poi_ids if key in graph.pois)
    edges = (graph.edges[key] for key in edge_ids if key in graph.edges)
    things: Iterator[Poi | Edge] = itertools.chain(pois, edges)
    return (thing for thing in things if not _is_carried(network, thing))


def _is_carried(network: RoadNetwork, thing: Poi | Edge) -> bool:
    """Whether a thing lies on the road, or need not: a place that stands free."""
    if isinstance(thing, Edge):
        return _carries(network, thing.path_m)
    return not thing.on_road or _carries(network, [(thing.x_m, thing.y_m)])


def _name(graph: PoiGraph, thing: Poi | Edge) -> str:
    return thing.name if isinstance(thing, Poi) else f"{graph.pois[thing.a].name} – {graph.pois[thing.b].name}"


def _carries(network: RoadNetwork, points_m: Sequence[Point]) -> bool:
    return bool((network.distances_m(np.array(points_m)) < _SAME_ROAD_M).all())


# ---------------------------------------------------------------------------------------------------------- edits
def draw_road(graph: PoiGraph, points_m: Sequence[Point]) -> PoiGraph:
    """Draw a line where nobody walked; where an end of it lies near a road, it begins there.

    Raises InputError for a line that is too short or too long, or is no line.
    """
    return draw_roads(graph, [points_m])


def draw_roads(graph: PoiGraph, lines_m: Sequence[Sequence[Point]]) -> PoiGraph:
    """Draw several lines as one edit: what is on the road is put back on it once. Raises InputError."""
    lines = [checked_line(points_m) for points_m in lines_m]
    network = network_of(graph.roads)
    roads = dict(graph.roads)
    for line in lines:
        if not network.is_empty:
            line = _line((_met(network, line[0]), *line[1:-1], _met(network, line[-1])))
        road_id = _free_road_id(roads)
        roads[road_id] = Road(road_id, line, "drawn")
    return _with_roads(graph, roads)


def trim_road(graph: PoiGraph, road_id: str, start_m: Point, end_m: Point) -> PoiGraph:
    """Keep of a road what lies between two places on it. Raises InputError."""
    road = _road(graph, road_id)
    path = np.array(road.points_m)
    arcs_m = sorted(project_on_path(path, *place).arc_length_m for place in (start_m, end_m))
    if arcs_m[1] - arcs_m[0] < MIN_LENGTH_M:
        raise InputError(f"Less than {MIN_LENGTH_M:g} m of the road would be left: choose places farther apart.")
    return _with_road(graph, road, path_between(path, *arcs_m))


def smooth_road(graph: PoiGraph, road_id: str, window_m: float = 1.0) -> PoiGraph:
    """Take the sway of whoever recorded it out of a road: a moving mean over ``window_m`` along it; its ends stay.

    Raises InputError where the window is not between 0.2 and 5 m.
    """
    if not 0.2 <= window_m <= 5.0:
        raise InputError(f"A road cannot be smoothed over {window_m:g} m: choose between 0.2 and 5 m.")
    road = _road(graph, road_id)
    return _with_road(graph, road, _smoothed(np.array(road.points_m), window_m))


def split_road(graph: PoiGraph, road_id: str, place_m: Point) -> PoiGraph:
    """Cut a road in two at the place nearest to ``place_m``. Raises InputError where that is one of its ends."""
    road = _road(graph, road_id)
    path = np.array(road.points_m)
    cut_m, length_m = project_on_path(path, *place_m).arc_length_m, float(arc_lengths_m(path)[-1])
    if min(cut_m, length_m - cut_m) < MIN_LENGTH_M:
        raise InputError("A road is not cut at its end: choose a place farther inside.")
    other_id = _free_road_id(graph.roads)
    first, second = path_between(path, 0.0, cut_m), path_between(path, cut_m, length_m)
    parts = {road_id: _as_road(road_id, first, road.origin), other_id: _as_road(other_id, second, road.origin)}
    return _with_roads(graph, {**graph.roads, **parts})


def join_roads(graph: PoiGraph, first_id: str, second_id: str) -> PoiGraph:
    """Make one road of two, by the ends that are nearest to each other.

    Raises InputError where these are farther apart than ``MAX_JOIN_M``.
    """
    first, second = _road(graph, first_id), _road(graph, second_id)
    if first_id == second_id:
        raise InputError("Joining takes two different roads: choose another one.")
    one, other = min(
        ((one, other) for one in _both_ways(first) for other in _both_ways(second)),
        key=lambda lines: math.dist(lines[0][-1], lines[1][0]),
    )
    gap_m = math.dist(one[-1], other[0])
    if gap_m > MAX_JOIN_M:
        raise InputError(
            f"The ends of these roads are {gap_m:.1f} m apart, and {MAX_JOIN_M:g} m at most are joined straight: draw"
            " the piece between them."
        )
    origin: RoadOrigin = "drawn" if "drawn" in (first.origin, second.origin) else "recorded"
    joined = Road(first_id, _distinct([*one, *other]), origin)
    rest = {key: road for key, road in graph.roads.items() if key not in (first_id, second_id)}
    return _with_roads(graph, {**rest, first_id: joined})


def delete_road(graph: PoiGraph, road_id: str) -> PoiGraph:
    """Remove a road on which nothing stands. Raises InputError."""
    _road(graph, road_id)
    return _with_roads(graph, {key: road for key, road in graph.roads.items() if key != road_id})


# ---------------------------------------------------------------------------------------------------------- parts
def _with_road(graph: PoiGraph, road: Road, path_m: FloatArray) -> PoiGraph:
    return _with_roads(graph, {**graph.roads, road.id: _as_road(road.id, path_m, road.origin)})


@dataclass(frozen=True, eq=False)
class _Change:
    """The road before an edit of it and after."""

    before: Mapping[str, Road]
    network: RoadNetwork

    @cached_property
    def known(self) -> RoadNetwork:
        """The road before: made only where something does not lie on the road after."""
        return network_of(self.before)


def _with_roads(graph: PoiGraph, roads: dict[str, Road]) -> PoiGraph:
    _refuse_too_long(roads, graph.roads)
    refuse_too_wide(roads, graph.roads)
    change = _Change(graph.roads, network_of(roads))
    pois = {key: _put_back(poi, change) for key, poi in graph.pois.items()}
    edges = {key: _laid_again(edge, graph, pois, change) for key, edge in graph.edges.items()}
    return PoiGraph(graph.version + 1, pois, edges, roads)


def _refuse_too_long(roads: Mapping[str, Road], before: Mapping[str, Road]) -> None:
    total_m = roads_length_m(roads.values())
    if total_m > max(MAX_ROADS_LENGTH_M, roads_length_m(before.values())):
        raise InputError(
            f"All roads together would be {total_m / 1000:.1f} km long, and {MAX_ROADS_LENGTH_M / 1000:g} km are taken:"
            " delete or trim roads that nobody walks."
        )


def refuse_too_wide(roads: Mapping[str, Road], before: Mapping[str, Road]) -> None:
    """Raise InputError where roads lie so far apart that they are no one site, and did not ``before``."""
    width_m, height_m = _span_m(roads)
    if width_m * height_m > max(MAX_SPAN_M2, math.prod(_span_m(before))):
        raise InputError(
            f"The roads would lie on {width_m:.0f} by {height_m:.0f} m, and {MAX_SPAN_M2 / 10_000:g} hectares are"
            " taken: keep to what lies near the other roads, and make a site of its own of what lies far away."
        )


def _span_m(roads: Mapping[str, Road]) -> Point:
    """Sides of the rectangle round all roads, and the margin that joining them takes."""
    points = [point for road in roads.values() for point in road.points_m]
    if not points:
        return 0.0, 0.0
    xs, ys = zip(*points, strict=True)
    return max(xs) - min(xs) + 1.0, max(ys) - min(ys) + 1.0


def _put_back(poi: Poi, change: _Change) -> Poi:
    if not poi.on_road:
        return poi
    place = None if change.network.is_empty else change.network.nearest(poi.x_m, poi.y_m)
    if (place is None or place.distance_m > _SAME_ROAD_M) and not _is_carried(change.known, poi):
        return poi
    if place is None or place.distance_m > MAX_SLIDE_M:
        raise InputError(f"{poi.name} stands on that piece of road: move or delete it first.")
    return poi if place.distance_m < 1e-9 else msgspec.structs.replace(poi, x_m=place.x_m, y_m=place.y_m)


def _laid_again(edge: Edge, graph: PoiGraph, pois: Mapping[str, Poi], change: _Change) -> Edge:
    a, b = pois[edge.a], pois[edge.b]
    stays = (a, b) == (graph.pois[edge.a], graph.pois[edge.b])
    is_carried = _is_carried(change.network, edge)
    if stays and is_carried:
        return edge
    old_path = np.array(edge.path_m)
    if not is_carried and not _is_carried(change.known, edge):
        return edge if stays else edge_of_piece(edge, pois, RoadPiece(old_path, edge.length_m))
    refusal = f"{a.name} and {b.name} are joined along that piece of road"
    try:
        laid = along_road(change.network.near(old_path, MAX_SLIDE_M + SPACING_M), pois, edge)
    except InputError as error:
        raise InputError(f"{refusal}, and no other leads along there: delete their connection first.") from error
    if _farthest_m(old_path, np.array(laid.path_m)) > MAX_SLIDE_M:
        raise InputError(f"{refusal}, and would be joined by another way: delete their connection first.")
    return laid


def _farthest_m(path_m: FloatArray, other_m: FloatArray) -> float:
    """How far a polyline (n, 2) goes from another."""
    near, _ = cKDTree(evenly_spaced(other_m, SPACING_M)).query(evenly_spaced(path_m, SPACING_M))
    return float(np.max(near))


def _road(graph: PoiGraph, road_id: str) -> Road:
    if road_id not in graph.roads:
        raise InputError(f"There is no road {road_id!r}: it may have been deleted meanwhile.")
    return graph.roads[road_id]


def _free_road_id(roads: Mapping[str, Road]) -> str:
    return free_numbered_id("r", roads)


def _as_road(road_id: str, path_m: FloatArray, origin: RoadOrigin) -> Road:
    return Road(road_id, _line([(float(x), float(y)) for x, y in path_m]), origin)


def checked_line(points_m: Sequence[Point]) -> tuple[Point, ...]:
    """Return points that somebody draws as a road has them.

    Raises InputError where they are too many, too few or nowhere, or the line is too long.
    """
    if len(points_m) > MAX_POINTS_COUNT:
        raise InputError(f"A road may have {MAX_POINTS_COUNT} points, not {len(points_m)}: draw it in pieces.")
    if not all(math.isfinite(part) and abs(part) <= 100_000.0 for point in points_m for part in point):
        raise InputError("A road needs points in metres, within 100 km of the origin.")
    length_m = _length_m(points_m)
    if length_m > MAX_LENGTH_M:
        raise InputError(
            f"A line of {length_m / 1000:.1f} km is too long for a road: draw it in pieces of {MAX_LENGTH_M / 1000:g}"
            " km at most."
        )
    return _line(points_m)


def roads_length_m(roads: Iterable[Road]) -> float:
    """Return the length of all these roads together."""
    return sum(_length_m(road.points_m) for road in roads)


def _line(points_m: Sequence[Point]) -> tuple[Point, ...]:
    line = _distinct(points_m)
    if len(line) < 2 or _length_m(line) < MIN_LENGTH_M:
        raise InputError(f"A road must be at least {MIN_LENGTH_M:g} m long: draw a longer line.")
    return line


def _length_m(points_m: Sequence[Point]) -> float:
    return sum(itertools.starmap(math.dist, itertools.pairwise(points_m)))


def _distinct(points_m: Sequence[Point]) -> tuple[Point, ...]:
    """Return points to the millimetre, without those that repeat the one before."""
    rounded = [(round(float(x), 3), round(float(y), 3)) for x, y in points_m]
    return tuple(point for i, point in enumerate(rounded) if i == 0 or point != rounded[i - 1])


def _met(network: RoadNetwork, end_m: Point) -> Point:
    place = network.nearest(*end_m)
    return place.xy_m if place.distance_m < MEET_M else end_m


def _both_ways(road: Road) -> tuple[tuple[Point, ...], tuple[Point, ...]]:
    return road.points_m, road.points_m[::-1]


def _smoothed(path_m: FloatArray, window_m: float) -> FloatArray:
    arcs_m = arc_lengths_m(path_m)
    count = max(2, math.ceil(float(arcs_m[-1]) / _SMOOTHING_STEP_M) + 1)
    even_m = np.linspace(0.0, float(arcs_m[-1]), count)
    line = np.column_stack([np.interp(even_m, arcs_m, path_m[:, axis]) for axis in (0, 1)])
    sums = np.vstack([np.zeros((1, 2)), np.cumsum(line, axis=0)])
    reach = min(round(window_m / 2 / _SMOOTHING_STEP_M), (count - 1) // 2)
    # Nearer to an end the window is narrower, so that the mean stays centred and the end where it is.
    half = np.minimum(reach, np.minimum(np.arange(count), np.arange(count)[::-1]))
    indices = np.arange(count)
    smooth: FloatArray = (sums[indices + half + 1] - sums[indices - half]) / (2 * half + 1)[:, None]
    return smooth

"""What the checks look at: the graph and its road, and what has been measured or rehearsed. Values only."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import msgspec
import numpy as np
from scipy.spatial import cKDTree

from navcore.geometry import FloatArray
from navcore.map_check.clearance import PathClearance, PlaceClearance
from navcore.planning.poi_graph import Edge, Poi, PoiGraph
from navcore.planning.projection import arc_lengths_m
from navcore.planning.road_network import RoadNetwork
from navcore.settings import Settings

ON_ROAD_M = 0.5
"""What is nearer to the road than this lies on it: two passes of one corridor that close are the same road."""
_SPACING_M = 0.25
_MAX_SAMPLES = 20_000


class WeakPlace(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A stretch of the road where localization is, or may be, weak."""

    x_m: float
    y_m: float
    """Its middle; of what the map walk was warned of, its beginning."""
    length_m: float
    reason: str
    """Why, as the end of a sentence that begins with "Localization may be weak here: "."""


class Announced(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One thing that was said in a rehearsal."""

    kind: str
    """A :class:`navcore.cues.table.CueKind`'s value."""
    poi_id: str
    """What place was announced; empty where it was none."""
    at_m: float
    """Way walked along the route when it was said."""
    distance_m: float
    """Way from there to what it announces."""
    x_m: float
    y_m: float
    edge_id: str = ""
    """The edge on which the walker was."""


class RehearsedRoute(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A route on which the navigation was run without anyone walking, and what was said."""

    start_id: str
    goal_id: str
    length_m: float
    end_x_m: float
    end_y_m: float
    """Where it ends."""
    announced: tuple[Announced, ...]
    """In the order of ``at_m``."""
    edge_ids: tuple[str, ...] = ()
    """The edges that it leads along."""


@dataclass(frozen=True, eq=False)
class MapEvidence:
    """Everything that the checks look at. What has not been measured is left out, and not checked."""

    graph: PoiGraph
    network: RoadNetwork
    """The road that the graph's edges are pieces of."""
    paths: Mapping[str, PathClearance] = field(default_factory=dict)
    """The room beside edges, by their identifiers."""
    places: Mapping[str, PlaceClearance] = field(default_factory=dict)
    """The room around PoIs, by their identifiers."""
    weak: Sequence[WeakPlace] = ()
    routes: Sequence[RehearsedRoute] = ()
    not_rehearsed: Sequence[str] = ()
    """Edges that rehearsals left out: what is said there nobody knows."""
    refusals: Sequence[str] = ()
    """Rehearsals in which the walker did not arrive, and why."""
    settings: Settings = field(default_factory=Settings)

    def road_distances_m(self, points_m: FloatArray) -> FloatArray:
        """Return how far points (n, 2) are from the road (n,), to half a vertex spacing; inf where there is none."""
        if self.network.is_empty:
            return np.full(len(points_m), np.inf)
        return np.asarray(self._road_tree.query(points_m)[0], np.float64)

    def road_ids_at(self, x_m: float, y_m: float) -> tuple[str, ...]:
        """Return which of the graph's roads lie at a place, in order of their identifiers."""
        here = np.array([[x_m, y_m]])
        near = [key for key, tree in self._trees_of_roads.items() if float(np.min(tree.query(here)[0])) < ON_ROAD_M]
        return tuple(sorted(near))

    @cached_property
    def _road_tree(self) -> cKDTree:
        return cKDTree(self.network.vertices_m)

    @cached_property
    def _trees_of_roads(self) -> dict[str, cKDTree]:
        roads = {key: np.array(road.points_m, np.float64).reshape(-1, 2) for key, road in self.graph.roads.items()}
        return {key: cKDTree(spaced(points)) for key, points in roads.items() if len(points)}


def path_of(edge: Edge) -> FloatArray:
    """Return the path of an edge, (n, 2); it may be empty where the graph was written by hand."""
    return np.array(edge.path_m, np.float64).reshape(-1, 2)


def spaced(path_m: FloatArray) -> FloatArray:
    """Return a polyline (n, 2), n ≥ 1, as points (k, 2) about 0.25 m apart, farther where it is kilometres long."""
    along_m = arc_lengths_m(path_m)
    count = min(_MAX_SAMPLES, max(2, math.ceil(float(along_m[-1]) / _SPACING_M) + 1))
    at_m = np.linspace(0.0, float(along_m[-1]), count)
    return np.column_stack([np.interp(at_m, along_m, path_m[:, axis]) for axis in (0, 1)])


def middle_of(edge: Edge, graph: PoiGraph) -> tuple[float, float]:
    """Return where to look for an edge: the middle of its path, or one of its places."""
    path = path_of(edge)
    if len(path):
        points = spaced(path)
        return float(points[len(points) // 2, 0]), float(points[len(points) // 2, 1])
    poi = graph.pois.get(edge.a) or graph.pois.get(edge.b)
    return (poi.x_m, poi.y_m) if poi is not None else (0.0, 0.0)


def edge_name(edge: Edge, graph: PoiGraph) -> str:
    """Return what a person calls an edge: "The connection from Hall to Bar"."""
    a, b = (graph.pois[key].name if key in graph.pois else f"a place that is gone ({key})" for key in (edge.a, edge.b))
    return f"The connection from {a} to {b}"


def is_silent(poi: Poi) -> bool:
    """Whether a place is passed without a word: a junction to which nobody gave a spoken name."""
    return poi.kind == "junction" and not poi.spoken_name.strip()


def said_of(poi: Poi) -> str:
    """Return what a place is called aloud."""
    return poi.spoken_name.strip() or poi.name

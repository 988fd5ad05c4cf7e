"""The virtual blind road as one network: what was recorded, with passes of the same corridor joined.

A PoI lies on it, an edge of the PoI-graph is a piece of it (paper IV-A).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, cast

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import connected_components, dijkstra
from scipy.spatial import cKDTree

from navcore.errors import InputError, PlanningError
from navcore.geometry import FloatArray
from navcore.planning.drawn_lines import with_drawn
from navcore.planning.road_joining import SPACING_M, evenly_spaced, joined_centre_lines

_NEAR_M = 2.0
IndexArray = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class RoadPoint:
    """A place on the road, and how far from it the place that was asked for lies."""

    x_m: float
    y_m: float
    segment: int
    """Index of the segment of the network that carries the point."""
    fraction: float
    """Place along the segment, 0–1."""
    distance_m: float

    @property
    def xy_m(self) -> tuple[float, float]:
        """The place, metres."""
        return self.x_m, self.y_m


class RoadPiece(NamedTuple):
    """A piece of the road between two places on it."""

    path_m: FloatArray
    """Points (n, 2), n ≥ 2, in the order from the first place to the second."""
    length_m: float


@dataclass(frozen=True, eq=False)
class RoadNetwork:
    """Vertices about 0.1 m apart, and the segments between them; never changed once made."""

    vertices_m: FloatArray
    """Places (n, 2)."""
    segments: IndexArray
    """Pairs of vertices (m, 2)."""
    lines: tuple[FloatArray, ...] = ()
    """The same as polylines (k, 2) from junction or end to junction or end, for drawing."""

    @staticmethod
    def from_roads(
        roads_m: Sequence[FloatArray], merge_distance_m: float = 0.5, *, drawn_m: Sequence[FloatArray] = ()
    ) -> RoadNetwork:
        """Make the network of recorded walks, and of lines that somebody has drawn beside them.

        Args:
            roads_m: polylines (n, 2) or (n, 3), metres; of three coordinates the height is left out.
            merge_distance_m: passes nearer to each other than this are the same road.
            drawn_m: polylines of the same form; they meet the recorded road, and never move it.

        Raises InputError where a polyline is of another form or holds a number that is not finite.
        """
        if not 0.05 <= merge_distance_m <= 5.0:
            raise InputError(f"Roads cannot be merged over {merge_distance_m:g} m: choose between 0.05 and 5 m.")
        walks, drawn = ([_checked_walk(road) for road in roads] for roads in (roads_m, drawn_m))
        lines = joined_centre_lines([walk for walk in walks if len(walk) > 1], merge_distance_m)
        return RoadNetwork._from_lines(with_drawn(lines, [line for line in drawn if len(line) > 1], merge_distance_m))

    @staticmethod
    def _from_lines(lines: Sequence[FloatArray]) -> RoadNetwork:
        """Lines that meet share their end points; equal end points become one vertex."""
        index_of: dict[tuple[float, float], int] = {}
        vertices: list[FloatArray] = []
        segments: list[tuple[int, int]] = []
        for line in lines:
            indices: list[int] = []
            for position, point in enumerate(line):
                key = (float(point[0]), float(point[1]))
                is_end = position in (0, len(line) - 1)
                if is_end and key in index_of:
                    indices.append(index_of[key])
                    continue
                if is_end:
                    index_of[key] = len(vertices)
                indices.append(len(vertices))
                vertices.append(point)
            segments += [(a, b) for a, b in itertools.pairwise(indices) if a != b]
        return RoadNetwork(
            np.array(vertices, dtype=np.float64).reshape(-1, 2),
            np.array(segments, dtype=np.int64).reshape(-1, 2),
            tuple(lines),
        )

    @property
    def is_empty(self) -> bool:
        """Whether there is no road at all."""
        return len(self.segments) == 0

    @cached_property
    def length_m(self) -> float:
        """Length of all roads together."""
        return float(self._segment_lengths_m.sum())

    def polylines(self) -> tuple[FloatArray, ...]:
        """Return the road as polylines (n, 2), cut at junctions, for drawing."""
        return self.lines

    def nearest(self, x_m: float, y_m: float) -> RoadPoint:
        """Return the place on the road that is nearest. Raises PlanningError where there is no road."""
        if self.is_empty:
            raise PlanningError("There is no virtual blind road here: build the map from a walk first.", "no_ways")
        if not (math.isfinite(x_m) and math.isfinite(y_m)):
            raise InputError("A position must be two finite numbers in metres.")
        query = np.array([x_m, y_m])
        vertex_distance_m, _ = self._tree.query(query)
        # The nearest point lies within half a segment of one of the vertices in this reach.
        near = self._tree.query_ball_point(query, float(vertex_distance_m) + self._longest_segment_m)
        candidates = np.unique(np.concatenate([self._segments_at[vertex] for vertex in near]))
        start, end = self.vertices_m[self.segments[candidates, 0]], self.vertices_m[self.segments[candidates, 1]]
        along = end - start
        fraction = np.clip(((query - start) * along).sum(axis=1) / (along * along).sum(axis=1), 0.0, 1.0)
        points = start + fraction[:, None] * along
        best = int(np.argmin(((points - query) ** 2).sum(axis=1)))
        x, y = float(points[best, 0]), float(points[best, 1])
        return RoadPoint(x, y, int(candidates[best]), float(fraction[best]), math.hypot(x - x_m, y - y_m))

    def distances_m(self, points_m: FloatArray) -> FloatArray:
        """Return how far from the road each of some places (n, 2) lies (n,); inf where there is no road."""
        if self.is_empty or len(points_m) == 0:
            return np.full(len(points_m), np.inf)
        middle_distances_m, _ = self._middles.query(points_m)
        # The nearest segment cannot have its middle farther than this.
        reach_m = middle_distances_m + self._longest_segment_m / 2 + 1e-9
        near = cast("list[list[int]]", self._middles.query_ball_point(points_m, reach_m))
        counts = np.fromiter(map(len, near), dtype=np.int64, count=len(near))
        candidates = np.fromiter(itertools.chain.from_iterable(near), dtype=np.int64, count=int(counts.sum()))
        places = np.repeat(points_m, counts, axis=0)
        start, along = self.vertices_m[self.segments[candidates, 0]], self._steps_m[candidates]
        fraction = np.clip(((places - start) * along).sum(axis=1) / (along * along).sum(axis=1), 0.0, 1.0)
        distances = np.hypot(*(start + fraction[:, None] * along - places).T)
        nearest: FloatArray = np.minimum.reduceat(distances, np.cumsum(counts) - counts)
        return nearest

    def near(self, path_m: FloatArray, distance_m: float) -> RoadNetwork:
        """Return the part of the network that stays within a distance of a polyline (n, 2), without its ``lines``."""
        if self.is_empty:
            return self
        within = np.zeros(len(self.vertices_m), dtype=bool)
        found = self._tree.query_ball_point(evenly_spaced(path_m, SPACING_M), distance_m)
        within[list(itertools.chain.from_iterable(cast("list[list[int]]", found)))] = True
        kept, segments = np.unique(self.segments[within[self.segments].all(axis=1)], return_inverse=True)
        return RoadNetwork(self.vertices_m[kept], segments.reshape(-1, 2))

    def shortest_piece(self, a: RoadPoint, b: RoadPoint) -> RoadPiece:
        """Return the shortest way along the road from a to b. Raises PlanningError where no road joins them."""
        if a.segment == b.segment:
            path = np.array([a.xy_m, b.xy_m])
            return RoadPiece(path, math.dist(a.xy_m, b.xy_m))
        starts, ends = self._ends(a), self._ends(b)
        # Mostly the way is hardly longer than the straight line: only where it is, the whole network is searched.
        for limit_m in (2.0 * math.dist(a.xy_m, b.xy_m) + _NEAR_M, math.inf):
            distances, previous = dijkstra(
                self._both_ways, indices=[v for v, _ in starts], return_predecessors=True, limit=limit_m
            )
            length_m, row, last = min(
                (start_m + float(distances[i, vertex]) + end_m, i, vertex)
                for i, (_, start_m) in enumerate(starts)
                for vertex, end_m in ends
            )
            if length_m <= limit_m:
                break
        if not math.isfinite(length_m):
            text = "The virtual blind road does not join these two places: record the walk between them."
            raise PlanningError(text, "no_ways")
        inner = _walk_back(previous[row], last)
        return piece_of_path(np.vstack([[a.xy_m], self.vertices_m[inner], [b.xy_m]]))

    def closest_vertex(self, point: RoadPoint) -> int:
        """Return the index of the end of the point's segment that is nearer to it."""
        return int(self.segments[point.segment, 1 if point.fraction > 0.5 else 0])

    def vertex_point(self, vertex: int) -> RoadPoint:
        """Return a vertex as a place on the road."""
        segment = int(self._segments_at[vertex][0])
        x, y = self.vertices_m[vertex].tolist()
        return RoadPoint(x, y, segment, 0.0 if self.segments[segment, 0] == vertex else 1.0, 0.0)

    def vertex_neighbours(self, vertex: int) -> list[tuple[int, float]]:
        """Return the vertices one segment away, each with its distance."""
        around = self._segments_at[vertex]
        ends = self.segments[around].sum(axis=1) - vertex
        return list(zip(ends.tolist(), self._segment_lengths_m[around].tolist(), strict=True))

    def junctions(self) -> list[int]:
        """Return the vertices where three or more pieces of road meet."""
        meeting = np.bincount(self.segments.ravel(), minlength=len(self.vertices_m))
        return [int(vertex) for vertex in np.flatnonzero(meeting >= 3)]

    def component_count(self) -> int:
        """Return the number of roads that do not join each other."""
        return 0 if self.is_empty else int(connected_components(self.matrix, directed=False)[0])

    def _ends(self, point: RoadPoint) -> tuple[tuple[int, float], tuple[int, float]]:
        first, second = self.segments[point.segment]
        length_m = float(self._segment_lengths_m[point.segment])
        return (int(first), point.fraction * length_m), (int(second), (1.0 - point.fraction) * length_m)

    @cached_property
    def _segment_lengths_m(self) -> FloatArray:
        lengths: FloatArray = np.hypot(*self._steps_m.T)
        return lengths

    @cached_property
    def _steps_m(self) -> FloatArray:
        """From the first to the second end of each segment (m, 2)."""
        steps: FloatArray = self.vertices_m[self.segments[:, 1]] - self.vertices_m[self.segments[:, 0]]
        return steps

    @cached_property
    def _longest_segment_m(self) -> float:
        return float(self._segment_lengths_m.max(initial=SPACING_M))

    @cached_property
    def _tree(self) -> cKDTree:
        return cKDTree(self.vertices_m)

    @cached_property
    def _middles(self) -> cKDTree:
        return cKDTree(self.vertices_m[self.segments].mean(axis=1))

    @cached_property
    def _segments_at(self) -> list[IndexArray]:
        at: list[list[int]] = [[] for _ in range(len(self.vertices_m))]
        for index, (first, second) in enumerate(self.segments.tolist()):
            at[first].append(index)
            at[second].append(index)
        return [np.array(indices, dtype=np.int64) for indices in at]

    @cached_property
    def _both_ways(self) -> csr_array:
        """The same with both triangles: scipy would add the other one in each search."""
        return csr_array(self.matrix.maximum(self.matrix.T))

    @cached_property
    def matrix(self) -> csr_array:
        """Lengths of the segments between vertices (n, n), one triangle, for scipy's graph routines."""
        size = len(self.vertices_m)
        rows, cols = self.segments[:, 0], self.segments[:, 1]
        return csr_array(coo_array((self._segment_lengths_m, (rows, cols)), shape=(size, size)))


def _checked_walk(road: FloatArray) -> FloatArray:
    walk = np.asarray(road, dtype=np.float64)
    if walk.ndim != 2 or walk.shape[1] not in (2, 3):
        raise InputError(f"A road must be a list of points with two or three coordinates, not of shape {walk.shape}.")
    if not np.isfinite(walk).all() or (walk.size and float(np.abs(walk).max()) > 100_000.0):
        raise InputError("A road holds a coordinate that is not a number or is farther than 100 km: record it again.")
    moved = np.ones(len(walk), dtype=bool)
    moved[1:] = np.hypot(*np.diff(walk[:, :2], axis=0).T) > 1e-9
    return np.ascontiguousarray(walk[moved, :2])


def _walk_back(previous: NDArray[np.int32], last: int) -> list[int]:
    path = [last]
    while previous[path[-1]] >= 0:
        path.append(int(previous[path[-1]]))
    return path[::-1]


def piece_of_path(path_m: FloatArray) -> RoadPiece:
    """Return points (n, 2) as a piece of road, without those that repeat the one before."""
    keep = np.ones(len(path_m), dtype=bool)
    keep[1:] = np.hypot(*np.diff(path_m, axis=0).T) > 1e-7
    path = path_m[keep] if keep.sum() > 1 else path_m[[0, -1]]
    return RoadPiece(path, float(np.hypot(*np.diff(path, axis=0).T).sum()))

"""Where on the edges of a PoI-graph a position lies: the start of a route may be in the middle of an edge."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from navcore.angles import WorldAngle, world_angle
from navcore.geometry import FloatArray
from navcore.planning.poi_graph import Edge

_INDEX_SPACING_M = 0.5
_DIRECTION_SPAN_M = 0.3


@dataclass(frozen=True, slots=True)
class PathPoint:
    """The point of a polyline that is nearest to a position."""

    x_m: float
    y_m: float
    arc_length_m: float
    """Distance along the polyline from its first point."""
    distance_m: float
    """Distance of the position from the polyline."""


@dataclass(frozen=True, slots=True)
class EdgePoint:
    """A position projected on an edge."""

    edge_id: str
    point: PathPoint


def arc_lengths_m(path_m: FloatArray) -> FloatArray:
    """Return the distance along a polyline (n, 2) of each of its points (n,) from the first."""
    return np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(path_m, axis=0).T))])


def project_on_path(path_m: FloatArray, x_m: float, y_m: float) -> PathPoint:
    """Return the point of a polyline (n, 2), n ≥ 2, that is nearest to a position."""
    query = np.array([x_m, y_m])
    start, along = path_m[:-1], np.diff(path_m, axis=0)
    squares = np.maximum((along * along).sum(axis=1), 1e-18)
    fraction = np.clip(((query - start) * along).sum(axis=1) / squares, 0.0, 1.0)
    points = start + fraction[:, None] * along
    distances = np.hypot(*(points - query).T)
    best = int(np.argmin(distances))
    arc_m = float(arc_lengths_m(path_m)[best] + fraction[best] * np.hypot(*along[best]))
    return PathPoint(float(points[best, 0]), float(points[best, 1]), arc_m, float(distances[best]))


def path_between(path_m: FloatArray, from_arc_m: float, to_arc_m: float) -> FloatArray:
    """Return the part of a polyline between two places given by arc length; backwards where from > to."""
    arcs = arc_lengths_m(path_m)
    low, high = sorted((from_arc_m, to_arc_m))
    inner = path_m[(arcs > low + 1e-9) & (arcs < high - 1e-9)]
    ends = np.stack([np.interp([low, high], arcs, path_m[:, axis]) for axis in (0, 1)], axis=1)
    part = np.vstack([ends[:1], inner, ends[1:]])
    return np.asarray(part if from_arc_m <= to_arc_m else part[::-1])


def direction_at(path_m: FloatArray, arc_m: float) -> WorldAngle:
    """Return the direction in which a polyline runs at an arc length, over a short piece of it."""
    arcs = arc_lengths_m(path_m)
    at = np.clip([arc_m - _DIRECTION_SPAN_M, arc_m + _DIRECTION_SPAN_M], 0.0, arcs[-1])
    begin, end = (np.array([np.interp(place, arcs, path_m[:, axis]) for axis in (0, 1)]) for place in at)
    return world_angle(math.atan2(end[1] - begin[1], end[0] - begin[0]))


class EdgeIndex:
    """Finds the edges nearest to a position; made once for a graph."""

    def __init__(self, edges: Iterable[Edge]) -> None:
        kept = tuple(edges)
        self._ids = tuple(edge.id for edge in kept)
        self._number = {edge_id: number for number, edge_id in enumerate(self._ids)}
        self._starts = np.concatenate([[0], np.cumsum([len(edge.path_m) for edge in kept])]).astype(np.int64)
        flat = itertools.chain.from_iterable(itertools.chain.from_iterable(edge.path_m for edge in kept))
        self._points = np.fromiter(flat, dtype=np.float64, count=2 * int(self._starts[-1])).reshape(-1, 2)
        samples, self._edge_of_sample = _samples(self._points, self._starts)
        self._tree = cKDTree(samples) if kept else None

    def path(self, edge_id: str) -> FloatArray:
        """Return the polyline (n, 2) of an edge."""
        number = self._number[edge_id]
        return self._points[self._starts[number] : self._starts[number + 1]]

    def nearest(self, x_m: float, y_m: float, tie_m: float = 0.0) -> tuple[EdgePoint, ...]:
        """Return the nearest edge, and those at most ``tie_m`` farther, nearest first; none without edges."""
        if self._tree is None:
            return ()
        reach_m = float(self._tree.query([x_m, y_m])[0]) + tie_m + _INDEX_SPACING_M
        near = np.unique(self._edge_of_sample[self._tree.query_ball_point([x_m, y_m], reach_m)])
        found = [EdgePoint(self._ids[i], project_on_path(self.path(self._ids[i]), x_m, y_m)) for i in near.tolist()]
        found.sort(key=lambda candidate: candidate.point.distance_m)
        return tuple(c for c in found if c.point.distance_m <= found[0].point.distance_m + tie_m)


def _samples(points_m: FloatArray, starts: NDArray[np.int64]) -> tuple[FloatArray, NDArray[np.int64]]:
    """Return points (k, 2) of polylines laid end to end, at most ``_INDEX_SPACING_M`` apart, and whose each is (k,)."""
    owner = np.repeat(np.arange(len(starts) - 1), np.diff(starts))
    within = owner[:-1] == owner[1:]
    begin, step, whose = points_m[:-1][within], np.diff(points_m, axis=0)[within], owner[:-1][within]
    counts = np.maximum(1, np.ceil(np.hypot(step[:, 0], step[:, 1]) / _INDEX_SPACING_M)).astype(np.int64)
    segment = np.repeat(np.arange(len(counts)), counts)
    share = (np.arange(len(segment)) - np.repeat(np.cumsum(counts) - counts, counts)) / counts[segment]
    ends = starts[1:] - 1
    samples = np.vstack([begin[segment] + share[:, None] * step[segment], points_m[ends]])
    return samples, np.concatenate([whose[segment], owner[ends]])

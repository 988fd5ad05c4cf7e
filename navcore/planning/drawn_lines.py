"""Lines drawn by hand beside the recorded road: they begin and end on it, and never move it.

Passes of one corridor are averaged, for each is somebody's walk. A line that somebody draws is no walk: where it runs
along a road it *is* that road, and elsewhere it is a piece of its own that meets the road where it comes near.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from navcore.geometry import FloatArray
from navcore.planning.projection import PathPoint, arc_lengths_m, path_between, project_on_path
from navcore.planning.road_joining import SPACING_M, evenly_spaced

_SHORTEST_M = 0.05
_ROUNDING_M = 1e-6
_SLANTED_M = 1.5
"""A line that runs along a road for less than this, up to its own end, is not taken for that road."""


@dataclass(frozen=True, slots=True, eq=False)
class _Line:
    """One line of the network, with what is asked of it for every line that is drawn."""

    points_m: FloatArray
    spaced_m: FloatArray
    """The same, in even steps."""
    low_m: FloatArray
    high_m: FloatArray
    """Opposite corners (2,) of the box about it."""

    @staticmethod
    def of(points_m: FloatArray) -> _Line:
        return _Line(points_m, evenly_spaced(points_m, SPACING_M), points_m.min(axis=0), points_m.max(axis=0))

    def box_distance_m(self, place_m: FloatArray) -> float:
        """Return how far a place is from the box; no point of the line is nearer."""
        return float(np.hypot(*np.maximum(0.0, np.maximum(self.low_m - place_m, place_m - self.high_m))))


def with_drawn(
    lines_m: Sequence[FloatArray], drawn_m: Sequence[FloatArray], merge_distance_m: float
) -> list[FloatArray]:
    """Return the lines (n, 2) of a network with drawn ones added; lines that meet share their end points.

    Args:
        lines_m: the network's, cut at its junctions.
        drawn_m: polylines (n, 2) in the order in which they were drawn.
        merge_distance_m: a drawn line that is nearer to a road than this runs along it.
    """
    lines = [_Line.of(each) for each in lines_m]
    for drawn in drawn_m:
        lines = _with_one(lines, drawn, merge_distance_m)
    return [each.points_m for each in lines]


def _with_one(lines: list[_Line], drawn: FloatArray, merge_distance_m: float) -> list[_Line]:
    line = evenly_spaced(drawn, SPACING_M)
    if not lines:
        return [_Line.of(line)]
    apart = _are_apart(lines, line, merge_distance_m)
    for first, last in _runs(apart):
        # Whoever draws a line that ends on a road at a slant means the line, to its end.
        first = 0 if first * SPACING_M < _SLANTED_M else first
        last = len(line) - 1 if (len(line) - 1 - last) * SPACING_M < _SLANTED_M else last
        piece = line[first : last + 1]
        if first > 0 or not apart[0]:
            lines, meets = _met(lines, piece[0])
            piece = _beginning_at(meets, piece)
        if last < len(line) - 1 or not apart[-1]:
            lines, meets = _met(lines, piece[-1])
            piece = _beginning_at(meets, piece[::-1])[::-1]
        if len(piece) > 1 and float(arc_lengths_m(piece)[-1]) > _SHORTEST_M:
            lines = [*lines, _Line.of(piece)]
    return lines


def _are_apart(lines: list[_Line], line: FloatArray, merge_distance_m: float) -> NDArray[np.bool_]:
    """Return which points (n,) of a line are farther than the merge distance from all of the network."""
    # A margin, for the even steps of a line may leave its box by a rounding.
    reach_m = merge_distance_m + SPACING_M
    low_m, high_m = line.min(axis=0) - reach_m, line.max(axis=0) + reach_m
    near = [each.spaced_m for each in lines if (each.low_m <= high_m).all() and (each.high_m >= low_m).all()]
    if not near:
        return np.ones(len(line), np.bool_)
    distance_m = np.asarray(cKDTree(np.vstack(near)).query(line)[0])
    return np.asarray(np.greater(distance_m, merge_distance_m))


def _met(lines: list[_Line], place_m: FloatArray) -> tuple[list[_Line], FloatArray]:
    """Cut the nearest line at the place on it that is nearest to ``place_m``; return the lines, and that place."""
    index, point = _nearest(lines, place_m)
    line, at_m = lines[index].points_m, point.arc_length_m
    length_m = float(arc_lengths_m(line)[-1])
    if at_m < _SHORTEST_M or at_m > length_m - _SHORTEST_M:
        return lines, line[0 if at_m < length_m / 2 else -1]
    before, after = path_between(line, 0.0, at_m), path_between(line, at_m, length_m)
    # The very same numbers in all parts: ends that are equal become one vertex.
    after[0] = before[-1]
    return [*lines[:index], _Line.of(before), _Line.of(after), *lines[index + 1 :]], before[-1]


def _nearest(lines: list[_Line], place_m: FloatArray) -> tuple[int, PathPoint]:
    """Return the index of the nearest line, the first of those that are as near, and the place on it."""
    index, nearest = 0, project_on_path(lines[0].points_m, float(place_m[0]), float(place_m[1]))
    for k in range(1, len(lines)):
        if lines[k].box_distance_m(place_m) > nearest.distance_m + _ROUNDING_M:
            continue
        point = project_on_path(lines[k].points_m, float(place_m[0]), float(place_m[1]))
        if point.distance_m < nearest.distance_m:
            index, nearest = k, point
    return index, nearest


def _beginning_at(place_m: FloatArray, piece: FloatArray) -> FloatArray:
    """Return a piece that begins at exactly this place; points closer together than a hand's breadth are one."""
    rest = piece[np.hypot(*(piece - place_m).T) > _SHORTEST_M]
    return np.vstack([place_m, rest])


def _runs(which: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return the first and last index of each unbroken run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], which, [False]]).astype(np.int8)))
    return [(int(first), int(end) - 1) for first, end in zip(edges[::2], edges[1::2], strict=True)]

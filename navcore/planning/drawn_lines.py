"""Lines drawn by hand beside the recorded road: they begin and end on it, and never move it.

Passes of one corridor are averaged, for each is somebody's walk. A line that somebody draws is no walk: where it runs
along a road it *is* that road, and elsewhere it is a piece of its own that meets the road where it comes near.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from navcore.geometry import FloatArray
from navcore.planning.projection import arc_lengths_m, path_between, project_on_path
from navcore.planning.road_joining import SPACING_M, evenly_spaced

_SHORTEST_M = 0.05
_SLANTED_M = 1.5
"""A line that runs along a road for less than this, up to its own end, is not taken for that road."""


def with_drawn(
    lines_m: Sequence[FloatArray], drawn_m: Sequence[FloatArray], merge_distance_m: float
) -> list[FloatArray]:
    """Return the lines (n, 2) of a network with drawn ones added; lines that meet share their end points.

    Args:
        lines_m: the network's, cut at its junctions.
        drawn_m: polylines (n, 2) in the order in which they were drawn.
        merge_distance_m: a drawn line that is nearer to a road than this runs along it.
    """
    lines = list(lines_m)
    for drawn in drawn_m:
        lines = _with_one(lines, drawn, merge_distance_m)
    return lines


def _with_one(lines: list[FloatArray], drawn: FloatArray, merge_distance_m: float) -> list[FloatArray]:
    line = evenly_spaced(drawn, SPACING_M)
    if not lines:
        return [line]
    distance_m = np.asarray(cKDTree(np.vstack([evenly_spaced(each, SPACING_M) for each in lines])).query(line)[0])
    apart: NDArray[np.bool_] = np.greater(distance_m, merge_distance_m)
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
            lines = [*lines, piece]
    return lines


def _met(lines: list[FloatArray], place_m: FloatArray) -> tuple[list[FloatArray], FloatArray]:
    """Cut the nearest line at the place on it that is nearest to ``place_m``; return the lines, and that place."""
    points = [project_on_path(line, float(place_m[0]), float(place_m[1])) for line in lines]
    index = min(range(len(lines)), key=lambda k: points[k].distance_m)
    line, at_m = lines[index], points[index].arc_length_m
    length_m = float(arc_lengths_m(line)[-1])
    if at_m < _SHORTEST_M or at_m > length_m - _SHORTEST_M:
        return lines, line[0 if at_m < length_m / 2 else -1]
    before, after = path_between(line, 0.0, at_m), path_between(line, at_m, length_m)
    # The very same numbers in all parts: ends that are equal become one vertex.
    after[0] = before[-1]
    return [*lines[:index], before, after, *lines[index + 1 :]], before[-1]


def _beginning_at(place_m: FloatArray, piece: FloatArray) -> FloatArray:
    """Return a piece that begins at exactly this place; points closer together than a hand's breadth are one."""
    rest = piece[np.hypot(*(piece - place_m).T) > _SHORTEST_M]
    return np.vstack([place_m, rest])


def _runs(which: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return the first and last index of each unbroken run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], which, [False]]).astype(np.int8)))
    return [(int(first), int(end) - 1) for first, end in zip(edges[::2], edges[1::2], strict=True)]

"""Joining recorded walks: many polylines, walked twice and crossing each other, become the centre lines of one road.

The walks are drawn with a brush as wide as the distance below which two passes count as one; what lies between them
fills up, and the middle line of the painted band is the road. Nothing depends on the order or the direction in which
the walks were recorded, there are no rungs between two passes, and a crossing becomes one junction.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from navcore.compiled import kernel
from navcore.geometry import FloatArray

CELL_M = 0.05
"""Side of a raster cell; the lines are smoothed over several cells afterwards."""
SPACING_M = 0.1
"""Distance between the points of a joined road."""
_SMOOTHING_M = 0.25
"""Standard deviation, along the road, of the smoothing that takes out gait and raster."""
_MAX_CELLS = 60_000_000

Mask = NDArray[np.uint8]
Pixel = tuple[int, int]


def joined_centre_lines(walks_m: Sequence[FloatArray], merge_distance_m: float) -> list[FloatArray]:
    """Return the centre lines (n, 2) of what was walked; lines that meet share their end point exactly.

    Args:
        walks_m: polylines (n, 2), metres, n ≥ 2.
        merge_distance_m: two passes nearer than this are the same road.
    """
    if not walks_m:
        return []
    low = np.min([walk.min(axis=0) for walk in walks_m], axis=0)
    high = np.max([walk.max(axis=0) for walk in walks_m], axis=0)
    margin_m = 2 * merge_distance_m + 4 * CELL_M
    # A road network of a whole campus still fits: the cells grow where the area is very large.
    cell_m = max(CELL_M, math.sqrt(float(np.prod(high - low + 2 * margin_m)) / _MAX_CELLS))
    # On the grid of the map itself: a road that is made longer or shorter at one end stays where it is elsewhere.
    origin = np.floor((low - margin_m) / cell_m) * cell_m
    shape = tuple(int(n) for n in np.ceil((high - origin + margin_m) / cell_m).astype(int))
    band = _painted_band(walks_m, origin, cell_m, (shape[1], shape[0]), merge_distance_m)
    chains = _without_spurs(_chains(_thinned(band)), merge_distance_m / cell_m)
    return [_smooth_line(np.array(chain)[:, ::-1] * cell_m + origin, chain[0] == chain[-1]) for chain in chains]


def _painted_band(
    walks_m: Sequence[FloatArray], origin: FloatArray, cell_m: float, shape: Pixel, merge_distance_m: float
) -> Mask:
    lines = np.full(shape, 255, dtype=np.uint8)
    fixed_point_bits = 8
    for walk in walks_m:
        cells = np.round((walk - origin) / cell_m * (1 << fixed_point_bits)).astype(np.int32)
        cv2.polylines(lines, [cells.reshape(-1, 1, 2)], False, 0, 1, cv2.LINE_8, fixed_point_bits)
    distance_px = cv2.distanceTransform(lines, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    band: Mask = (distance_px <= merge_distance_m / cell_m / 2 + 0.5).astype(np.uint8)
    return _without_slivers(band, merge_distance_m / cell_m / 4)


def _without_slivers(band: Mask, radius_px: float) -> Mask:
    """Fill the holes in which no disc of this radius fits: gaps between two passes, not something walked round."""
    outside, labels = cv2.connectedComponents((1 - band).astype(np.uint8), connectivity=4)
    if outside <= 2:
        return band
    depth_px = cv2.distanceTransform((1 - band).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    is_deep = np.zeros(outside, dtype=bool)
    is_deep[labels[depth_px > radius_px]] = True
    filled: Mask = (band.astype(bool) | ~is_deep[labels]).astype(np.uint8)
    return filled


@kernel
def _thin_once(image: Mask, second_pass: bool, marked: Mask) -> int:
    """Mark the boundary cells that one pass of Guo and Hall's thinning (1989) takes off; return how many."""
    height, width = image.shape
    count = 0
    for row in range(1, height - 1):
        for col in range(1, width - 1):
            if image[row, col] == 0:
                continue
            n, ne, e, se = image[row - 1, col], image[row - 1, col + 1], image[row, col + 1], image[row + 1, col + 1]
            s, sw, w, nw = image[row + 1, col], image[row + 1, col - 1], image[row, col - 1], image[row - 1, col - 1]
            crossings = ((1 - n) & (ne | e)) + ((1 - e) & (se | s)) + ((1 - s) & (sw | w)) + ((1 - w) & (nw | n))
            ones = min((nw | n) + (ne | e) + (se | s) + (sw | w), (n | ne) + (e | se) + (s | sw) + (w | nw))
            edge = ((s | sw | (1 - nw)) & w) if second_pass else ((n | ne | (1 - se)) & e)
            if crossings == 1 and 2 <= ones <= 3 and edge == 0:
                marked[row, col] = 1
                count += 1
    return count


def _thinned(band: Mask) -> Mask:
    image = band.copy()
    while True:
        removed = 0
        for second_pass in (False, True):
            marked = np.zeros_like(image)
            removed += _thin_once(image, second_pass, marked)
            image[marked == 1] = 0
        if not removed:
            return image


def _neighbours(pixel: Pixel, pixels: set[Pixel]) -> list[Pixel]:
    """The neighbours in the line; a diagonal one counts only where no straight step leads there."""
    row, col = pixel
    straight = [p for p in ((row - 1, col), (row, col + 1), (row + 1, col), (row, col - 1)) if p in pixels]
    diagonal = [
        (row + i, col + j)
        for i in (-1, 1)
        for j in (-1, 1)
        if (row + i, col + j) in pixels and (row + i, col) not in pixels and (row, col + j) not in pixels
    ]
    return straight + diagonal


def _chains(skeleton: Mask) -> list[list[Pixel]]:
    """Cut a one-cell-wide skeleton at its ends and junctions; chains that meet share the junction's cell."""
    rows, cols = np.nonzero(skeleton)
    pixels = set(zip(rows.tolist(), cols.tolist(), strict=True))
    neighbours = {pixel: _neighbours(pixel, pixels) for pixel in sorted(pixels)}
    nodes = [pixel for pixel, around in neighbours.items() if len(around) != 2]
    used: set[tuple[Pixel, Pixel]] = set()
    chains = [
        _follow(node, step, neighbours, used) for node in nodes for step in neighbours[node] if (node, step) not in used
    ]
    on_chains = {pixel for chain in chains for pixel in chain}
    for pixel, around in neighbours.items():
        # What is left are closed rings without a junction.
        if pixel not in on_chains and len(around) == 2:
            ring = _follow(pixel, around[0], neighbours, used)
            on_chains.update(ring)
            chains.append(ring)
    return chains


def _follow(
    start: Pixel, step: Pixel, neighbours: dict[Pixel, list[Pixel]], used: set[tuple[Pixel, Pixel]]
) -> list[Pixel]:
    chain = [start, step]
    while len(neighbours[chain[-1]]) == 2 and chain[-1] != start:
        first, second = neighbours[chain[-1]]
        chain.append(second if first == chain[-2] else first)
    used.add((chain[0], chain[1]))
    used.add((chain[-1], chain[-2]))
    return chain


class _Line(NamedTuple):
    """A chain with its length: on a large site each is asked for in every round of dropping a spur."""

    chain: list[Pixel]
    length_px: float


def _without_spurs(chains: list[list[Pixel]], max_length_px: float) -> list[list[Pixel]]:
    """Drop dead ends that are shorter than the brush is wide, and join what then passes straight through a node."""
    lines = [_Line(chain, sum(math.dist(a, b) for a, b in itertools.pairwise(chain))) for chain in chains]
    while True:
        lines = _merged_through(lines)
        ends = _end_counts(lines)
        spurs = [
            line
            for line in lines
            if line.length_px <= max_length_px
            and line.chain[0] != line.chain[-1]
            # A short line that stands alone is a short road, not a spur of another.
            and (ends[line.chain[0]] == 1) != (ends[line.chain[-1]] == 1)
        ]
        if not spurs:
            return [line.chain for line in lines]
        # One at a time: the second leg of a fork at a road's end is the road once the first is gone.
        shortest = min(spurs, key=lambda line: (line.length_px, line.chain[0], line.chain[-1]))
        lines = [line for line in lines if line is not shortest]


def _merged_through(lines: list[_Line]) -> list[_Line]:
    while (pair := _meeting_alone(lines)) is not None:
        node, first, second = pair
        head = first.chain if first.chain[-1] == node else first.chain[::-1]
        tail = second.chain if second.chain[0] == node else second.chain[::-1]
        rest = [line for line in lines if line is not first and line is not second]
        lines = [*rest, _Line(head + tail[1:], first.length_px + second.length_px)]
    return lines


def _meeting_alone(lines: list[_Line]) -> tuple[Pixel, _Line, _Line] | None:
    """The first node at which two lines meet, and no other."""
    at: dict[Pixel, list[_Line]] = {}
    for line in lines:
        at.setdefault(line.chain[0], []).append(line)
        at.setdefault(line.chain[-1], []).append(line)
    for node, touching in at.items():
        if len(touching) == 2 and touching[0] is not touching[1]:
            return node, touching[0], touching[1]
    return None


def _end_counts(lines: list[_Line]) -> dict[Pixel, int]:
    counts: dict[Pixel, int] = {}
    for line in lines:
        for end in (line.chain[0], line.chain[-1]):
            counts[end] = counts.get(end, 0) + 1
    return counts


def _smooth_line(points_m: FloatArray, closed: bool) -> FloatArray:
    """Smooth a raster line along its length and space it evenly; the ends stay where they are."""
    even = evenly_spaced(points_m, SPACING_M / 2)
    sigma = _SMOOTHING_M / (SPACING_M / 2)
    reach = min(int(3 * sigma), len(even) - 1)
    if reach < 1:
        return even
    # Mirrored through the end points, so that the ends keep their place and their direction.
    head = even[-1 - reach : -1] if closed else 2 * even[0] - even[reach:0:-1]
    tail = even[1 : reach + 1] if closed else 2 * even[-1] - even[-2 : -2 - reach : -1]
    padded = np.concatenate([head, even, tail])
    weights = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma) ** 2)
    weights /= weights.sum()
    smooth = np.stack([np.convolve(padded[:, axis], weights, mode="valid") for axis in (0, 1)], axis=1)
    smooth[0], smooth[-1] = even[0], even[-1]
    return evenly_spaced(smooth, SPACING_M)


def evenly_spaced(points_m: FloatArray, spacing_m: float) -> FloatArray:
    """Return a polyline (n, 2) again with points at most ``spacing_m`` apart, evenly along it; the ends are kept."""
    steps = np.hypot(*np.diff(points_m, axis=0).T)
    arc = np.concatenate([[0.0], np.cumsum(steps)])
    count = max(1, math.ceil(float(arc[-1]) / spacing_m - 1e-9))
    at = np.linspace(0.0, float(arc[-1]), count + 1)
    even: FloatArray = np.stack([np.interp(at, arc, points_m[:, axis]) for axis in (0, 1)], axis=1)
    even[0], even[-1] = points_m[0], points_m[-1]
    return even

"""The virtual blind road: where the sighted person walked (paper IV-A, 1).

The head sways with every step, stands still, and turns on the spot; the road does none of that. It is the trajectory,
low-passed along its own length, on the floor, as evenly spaced points.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from navcore.geometry import FloatArray

SPACING_M = 0.1
"""Distance between points of the road."""
SWAY_M = 0.4
"""Standard deviation of the low-pass along the road: of a gait cycle's sway, 1.4 m long, a third remains."""
STEP_M = 0.2
"""Movement below this is standing, or turning on the spot."""
REVERSAL_RAD = np.radians(120.0)
"""A bend sharper than this is a turning back: its tip stays where it is."""
MAX_GAP_S = 1.5
"""A longer time without a pose ends a stretch of road …"""
MAX_JUMP_M = 0.8
"""… and so does a jump in place."""
MIN_LENGTH_M = 0.5
"""A shorter stretch is no road."""


def build_roads(
    stamps_s: FloatArray, positions_m: FloatArray, spacing_m: float = SPACING_M, sway_m: float = SWAY_M
) -> tuple[FloatArray, ...]:
    """Return the roads (n, 3) that a trajectory leaves on the floor, z = 0, points ``spacing_m`` apart.

    ``stamps_s`` (m,) ascend; ``positions_m`` (m, 3) are the camera's in the levelled frame. The trajectory is split
    where tracking was lost. What was walked several times appears several times; planning merges it.
    """
    stretches = _split(np.asarray(stamps_s, np.float64), np.asarray(positions_m, np.float64)[:, :2])
    roads = [_road(stretch, spacing_m, sway_m) for stretch in stretches]
    return tuple(road for road in roads if road is not None)


def _split(stamps_s: FloatArray, positions: FloatArray) -> list[FloatArray]:
    if len(positions) == 0:
        return []
    gap = np.diff(stamps_s) > MAX_GAP_S
    jump = np.linalg.norm(np.diff(positions, axis=0), axis=1) > MAX_JUMP_M
    return list(np.split(positions, np.flatnonzero(gap | jump) + 1))


def _road(positions: FloatArray, spacing_m: float, sway_m: float) -> FloatArray | None:
    walked = _without_standing(positions)
    if arc_length(walked)[-1] < MIN_LENGTH_M:
        return None
    pieces = [_smooth(piece, spacing_m, sway_m) for piece in _between_reversals(walked)]
    whole = np.concatenate([pieces[0], *(piece[1:] for piece in pieces[1:])])
    even = resample(whole, spacing_m)
    return np.column_stack([even, np.zeros(len(even))])


def _without_standing(positions: FloatArray) -> FloatArray:
    """Keep a point only when it lies a step away from the last one kept; the last point stays."""
    kept = [positions[0]]
    for position in positions[1:]:
        if np.linalg.norm(position - kept[-1]) >= STEP_M:
            kept.append(position)
    if np.linalg.norm(positions[-1] - kept[-1]) > 0.25 * STEP_M:
        kept.append(positions[-1])
    return np.array(kept)


def _between_reversals(points: FloatArray) -> list[FloatArray]:
    """Split where the walker turned back; both pieces hold the point of return."""
    chord = 3
    reach = np.zeros(len(points))
    for i in range(1, len(points) - 1):
        before = points[i] - points[max(i - chord, 0)]
        after = points[min(i + chord, len(points) - 1)] - points[i]
        lengths = float(np.linalg.norm(before)), float(np.linalg.norm(after))
        if before @ after < np.cos(REVERSAL_RAD) * lengths[0] * lengths[1]:
            # Around a tip several points look back on both sides; it is the one that reaches farthest.
            reach[i] = sum(lengths)
    cuts = [i for i in np.flatnonzero(reach).tolist() if i == _farthest(reach, i, chord)]
    bounds = [0, *cuts, len(points) - 1]
    return [points[a : b + 1] for a, b in pairwise(bounds) if b > a]


def _farthest(reach: FloatArray, i: int, chord: int) -> int:
    first = max(i - chord, 0)
    return first + int(np.argmax(reach[first : i + chord + 1]))


def _smooth(points: FloatArray, spacing_m: float, sway_m: float) -> FloatArray:
    """Low-pass along the arc length, both ends kept.

    What the low-pass takes away is low-passed and given back once (Tukey's twicing): sway stays out, bends stay in.
    """
    even = resample(points, spacing_m)
    smooth = _low_pass(even, spacing_m, sway_m)
    return smooth + _low_pass(even - smooth, spacing_m, sway_m)


def _low_pass(values: FloatArray, spacing_m: float, sway_m: float) -> FloatArray:
    """Gaussian mean along the curve; both ends stay, because it goes on beyond them point-mirrored."""
    reach = int(np.ceil(3.0 * sway_m / spacing_m))
    if len(values) < 3 or reach == 0:
        return values
    offsets = np.arange(-reach, reach + 1) * spacing_m
    weights = np.exp(-0.5 * (offsets / sway_m) ** 2)
    weights /= weights.sum()
    extended = np.concatenate([_mirrored(values, reach), values, _mirrored(values[::-1], reach)[::-1]])
    return np.stack([np.convolve(extended[:, axis], weights, mode="valid") for axis in range(2)], axis=1)


def _mirrored(points: FloatArray, count: int) -> FloatArray:
    """Return ``count`` points that continue a curve before its first point, as its mirror image through that point."""
    index = np.minimum(np.arange(count, 0, -1), len(points) - 1)
    return np.asarray(2.0 * points[0] - points[index])


def arc_length(points: FloatArray) -> FloatArray:
    """Return the length (n,) of a polyline (n, d) up to each of its points."""
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])


def resample(points: FloatArray, spacing_m: float) -> FloatArray:
    """Return a polyline (n, d) as points evenly spaced by (nearly) ``spacing_m``; first and last points stay."""
    length = arc_length(points)
    count = max(round(length[-1] / spacing_m), 1) + 1
    wanted = np.linspace(0.0, length[-1], count)
    return np.stack([np.interp(wanted, length, points[:, axis]) for axis in range(points.shape[1])], axis=1)

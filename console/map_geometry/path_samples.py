"""Polylines as evenly spaced points, with the directions to their left."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from navcore.geometry import FloatArray
from navcore.planning.projection import arc_lengths_m

MAX_SAMPLES = 20_000
"""Of one path: of one longer than 2 km the points are farther apart than was asked for."""
_CHORD_M = 0.4
"""Directions are taken over this length: a recorded road sways a little from point to point."""


@dataclass(frozen=True, slots=True, eq=False)
class PathSamples:
    """Points of a polyline, from its first to its last."""

    points_m: FloatArray
    """(n, 2)."""
    arc_m: FloatArray
    """(n,): way from the first point."""
    left: FloatArray
    """(n, 2): unit vectors to the left of the way."""


def sampled(path_m: FloatArray, spacing_m: float) -> PathSamples:
    """Return a polyline (k, 2), k ≥ 1, as points about ``spacing_m`` apart; both ends are among them."""
    path = np.asarray(path_m, np.float64)[:, :2]
    along_m = arc_lengths_m(path)
    length_m = float(along_m[-1])
    count = min(MAX_SAMPLES, max(2, int(np.ceil(length_m / spacing_m)) + 1))
    arc_m = np.linspace(0.0, length_m, count)
    points = _at(path, along_m, arc_m)
    chords = _at(path, along_m, arc_m + _CHORD_M / 2) - _at(path, along_m, arc_m - _CHORD_M / 2)
    lengths = np.hypot(*chords.T)[:, None]
    ahead = np.divide(chords, lengths, out=np.tile([1.0, 0.0], (len(chords), 1)), where=lengths > 1e-9)
    return PathSamples(points, arc_m, np.column_stack([-ahead[:, 1], ahead[:, 0]]))


def _at(path_m: FloatArray, along_m: FloatArray, arc_m: FloatArray) -> FloatArray:
    return np.column_stack([np.interp(arc_m, along_m, path_m[:, axis]) for axis in (0, 1)])

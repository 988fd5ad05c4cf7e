"""How far somebody walks from the planned way, in the paper's form: maximum, mean and variance (Tables I and II)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from navcore.geometry import FloatArray


@dataclass(frozen=True, slots=True)
class DeviationFigures:
    """Of the distances from the planned way, one for each cycle in which somebody was led; NaN where there is none."""

    max_m: float
    mean_m: float
    variance_m2: float
    count: int
    """Cycles that count."""

    @staticmethod
    def of(deviation_m: FloatArray) -> DeviationFigures:
        """Return the figures of distances (n,), metres; those that are NaN are not known, and do not count."""
        known = deviation_m[np.isfinite(deviation_m)]
        if not len(known):
            return DeviationFigures(math.nan, math.nan, math.nan, 0)
        return DeviationFigures(float(known.max()), float(known.mean()), float(known.var()), len(known))


def distance_to_polyline_m(point_m: FloatArray, polyline_m: FloatArray) -> float:
    """Return the distance of a point (2,) from a polyline (n, 2), n ≥ 1."""
    if len(polyline_m) == 1:
        return float(np.hypot(*(point_m - polyline_m[0])))
    begins, steps = polyline_m[:-1], np.diff(polyline_m, axis=0)
    share = ((point_m - begins) * steps).sum(axis=1) / np.maximum((steps**2).sum(axis=1), 1e-12)
    nearest = begins + np.clip(share, 0.0, 1.0)[:, None] * steps
    return float(np.hypot(*(point_m - nearest).T).min())

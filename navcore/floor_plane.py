"""The plane that is fitted to floor: by least squares, trimmed of what stands on it and of what mirrors.

Points are in level axes, z up; what they are measured from is up to the caller.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from navcore.geometry import FloatArray

TRIMMED_M = 0.04
"""Points farther than this from the plane are not floor; twice as much in the first round."""
MIN_POINTS = 200
"""Fewer points say nothing."""
MIN_SPREAD_M = 0.25
"""Standard deviation that floor points need along both axes before they say anything about tilt."""


@dataclass(frozen=True, slots=True, eq=False)
class FloorPlane:
    """A floor z = a x + b y + c."""

    coefficients: FloatArray
    """(3,): a, b, and c in metres."""
    points: FloatArray
    """(n, 3): the points that lie on it."""

    def heights_m(self, points: FloatArray) -> FloatArray:
        """Return how far points (n, 3) lie above it (n,)."""
        a, b, c = self.coefficients
        return np.asarray(points[:, 2] - a * points[:, 0] - b * points[:, 1] - c)


def trimmed_plane(points: FloatArray) -> FloorPlane | None:
    """Fit the floor of points (n, 3), trimmed twice; None where they are too few, or too close together."""
    found = FloorPlane(np.zeros(3), points)
    for trimmed_m in (math.inf, 2 * TRIMMED_M, TRIMMED_M):
        height = found.heights_m(points)
        kept = points[np.abs(height - np.median(height)) < trimmed_m] if len(points) else points
        if len(kept) < MIN_POINTS or kept[:, :2].std(axis=0).min() < MIN_SPREAD_M:
            return None
        found = FloorPlane(fitted_plane(kept), kept)
    return found


def fitted_plane(points: FloatArray) -> FloatArray:
    """Return a, b, c (3,) of z = a x + b y + c for points (n, 3), least squares."""
    middle = points.mean(axis=0)
    centred = points - middle
    moments = centred.T @ centred
    slope = np.linalg.solve(moments[:2, :2], moments[:2, 2])
    return np.array([slope[0], slope[1], middle[2] - middle[:2] @ slope])

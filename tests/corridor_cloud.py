"""A made-up corridor as a cloud, and what can be put into it: grids of points, 5 cm apart, z up, floor at z = 0."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from navcore.geometry import FloatArray

LENGTH_M, WIDTH_M, HEIGHT_M = 12.0, 2.4, 2.6
STEP_M = 0.05
ROAD_M: FloatArray = np.column_stack([np.arange(0.5, 11.55, 0.1), np.zeros(111)])
"""Down the middle, from x = 0.5 m to 11.5 m."""


def corridor(door_m: tuple[float, float] | None = None, *, floor: bool = True, seed: int = 0) -> FloatArray:
    """Floor, ceiling and both walls, with 5 mm of noise; ``door_m`` is where along x the left wall has an opening."""
    parts = [box((0.0, -WIDTH_M / 2, HEIGHT_M), (LENGTH_M, WIDTH_M / 2, HEIGHT_M))]
    parts.append(box((0.0, -WIDTH_M / 2, 0.0), (LENGTH_M, -WIDTH_M / 2, HEIGHT_M)))
    left = box((0.0, WIDTH_M / 2, 0.0), (LENGTH_M, WIDTH_M / 2, HEIGHT_M))
    if door_m is not None:
        through = (left[:, 0] > door_m[0]) & (left[:, 0] < door_m[1]) & (left[:, 2] < 2.1)
        left = left[~through]
    parts.append(left)
    if floor:
        parts.append(box((0.0, -WIDTH_M / 2, 0.0), (LENGTH_M, WIDTH_M / 2, 0.0)))
    points = np.vstack(parts)
    return points + np.random.default_rng(seed).normal(0.0, 0.005, points.shape)


def box(low_m: Sequence[float], high_m: Sequence[float]) -> FloatArray:
    """Points (n, 3) that fill a box, a plate or a line, evenly."""
    axes = [np.linspace(a, b, round((b - a) / STEP_M) + 1) for a, b in zip(low_m, high_m, strict=True)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)

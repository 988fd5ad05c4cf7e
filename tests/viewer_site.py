"""A made-up site for tests of the scene: two crossing corridors, a coloured cloud, and roads through both."""

from __future__ import annotations

import numpy as np

from navcore.geometry import FloatArray
from navcore.planning.poi_graph import PoiGraph
from navcore.site import Site
from navcore.types import CameraIntrinsics

LENGTH_M, WIDTH_M, HEIGHT_M = 20.0, 2.4, 2.8
SMALL_CAMERA = CameraIntrinsics(320, 240, 262.5, 262.5, 159.5, 119.5)


def crossing_corridors(points_count: int = 12_000, seed: int = 0, poi_graph: PoiGraph | None = None) -> Site:
    """One corridor along x (0…20 m, y = 0) and one along y (x = 10 m, −8…8 m), each with a road down its middle."""
    rng = np.random.default_rng(seed)
    along_x = _corridor_points(rng, points_count // 2, LENGTH_M)
    along_y = _corridor_points(rng, points_count - points_count // 2, 16.0)
    along_y = np.column_stack([10.0 + along_y[:, 1], along_y[:, 0] - 8.0, along_y[:, 2]])
    points = np.vstack([along_x, along_y])
    # Where they cross neither has walls.
    crossing = (np.abs(points[:, 0] - 10.0) <= WIDTH_M / 2) & (np.abs(points[:, 1]) <= WIDTH_M / 2)
    points[crossing & (points[:, 2] < HEIGHT_M), 2] = 0.0
    return Site(
        "crossing", "Two corridors", SMALL_CAMERA, {}, crossing_roads(), points.astype(np.float32),
        _colours(points, rng), poi_graph or PoiGraph(),
    )  # fmt: skip


def crossing_roads() -> tuple[FloatArray, ...]:
    """The roads of the site: polylines (n, 3), a point every 0.1 m; they cross at (10, 0)."""
    x = np.arange(0.5, LENGTH_M - 0.45, 0.1)
    y = np.arange(-7.5, 7.55, 0.1)
    return (
        np.column_stack([x, np.zeros_like(x), np.zeros_like(x)]),
        np.column_stack([np.full_like(y, 10.0), y, np.zeros_like(y)]),
    )


def _corridor_points(rng: np.random.Generator, count: int, length_m: float) -> FloatArray:
    """Points on the floor, the ceiling and both walls of a corridor along x."""
    across = rng.uniform(-WIDTH_M / 2, WIDTH_M / 2, count)
    up = rng.uniform(0.0, HEIGHT_M, count)
    surface = rng.integers(0, 4, count)
    y = np.where(surface == 2, WIDTH_M / 2, np.where(surface == 3, -WIDTH_M / 2, across))
    z = np.where(surface == 0, 0.0, np.where(surface == 1, HEIGHT_M, up))
    return np.column_stack([rng.uniform(0.0, length_m, count), y, z])


def _colours(points: FloatArray, rng: np.random.Generator) -> np.ndarray:
    floor = points[:, 2] < 0.01
    base = np.where(floor[:, None], (120, 105, 85), (150, 160, 175)) + 25 * np.sin(points[:, :1] * 3.0)
    return np.clip(base + rng.normal(0, 12, (len(points), 1)), 0, 255).astype(np.uint8)

"""Where something nearer hides what is behind it, a corner of the picture is nowhere in the world."""

from __future__ import annotations

import numpy as np
import pytest

from navcore.slam.contours import on_contour
from navcore.slam.features import FeatureExtractor
from navcore.slam.keyframes import SlamCamera
from navcore.types import CameraIntrinsics

WIDTH_PX, HEIGHT_PX, FOCAL_PX = 320, 240, 230.0
EDGE_PX = 160
"""The nearer wall ends at this column."""


def two_walls(near_m: float, far_m: float) -> np.ndarray:
    depth_m = np.full((HEIGHT_PX, WIDTH_PX), far_m, np.float32)
    depth_m[:, :EDGE_PX] = near_m
    return depth_m


def is_on_contour(depth_m: np.ndarray, u: float, v: float, reach_px: float = 5.0) -> bool:
    return bool(on_contour(np.array([[u, v]]), np.array([reach_px]), depth_m)[0])


@pytest.mark.parametrize("beside_px", [-4.0, -1.0, 0.0, 3.0])
def test_beside_the_end_of_a_wall_there_is_a_contour_on_either_side(beside_px: float) -> None:
    assert is_on_contour(two_walls(1.5, 3.0), EDGE_PX + beside_px, 100.0)
    assert is_on_contour(np.ascontiguousarray(two_walls(1.5, 3.0).T), 100.0, EDGE_PX + beside_px)


def test_away_from_it_there_is_none() -> None:
    assert not is_on_contour(two_walls(1.5, 3.0), EDGE_PX + 8.0, 100.0)
    assert not is_on_contour(two_walls(1.5, 3.0), EDGE_PX - 8.0, 100.0)


def test_neither_a_steep_floor_nor_the_corner_of_a_room_is_a_contour() -> None:
    v, u = np.mgrid[0:HEIGHT_PX, 0:WIDTH_PX].astype(np.float64)
    floor = 1.4 * FOCAL_PX / np.maximum(v - 60.0, 1e-6)
    walls = 3.0 / (1.0 + np.abs(u - EDGE_PX) / FOCAL_PX)
    for row in (110.0, 150.0, 200.0):
        assert not is_on_contour(floor.astype(np.float32), 100.0, row, 8.0)
        assert not is_on_contour(walls.astype(np.float32), float(EDGE_PX), row, 8.0)


def test_where_nothing_was_measured_nothing_is_said() -> None:
    assert not is_on_contour(two_walls(1.5, np.nan), EDGE_PX - 2.0, 100.0)
    assert not is_on_contour(two_walls(1.5, 3.0), 0.0, 0.0)


def test_features_on_a_contour_have_no_depth() -> None:
    camera = SlamCamera(WIDTH_PX, HEIGHT_PX, FOCAL_PX, FOCAL_PX, 160.0, 120.0, 100.0)
    intrinsics = CameraIntrinsics(WIDTH_PX, HEIGHT_PX, FOCAL_PX, FOCAL_PX, 160.0, 120.0)
    grey = np.random.default_rng(2).integers(40, 210, (HEIGHT_PX // 6, WIDTH_PX // 6)).astype(np.uint8)
    grey = np.pad(np.kron(grey, np.ones((6, 6), np.uint8)), ((0, 0), (0, 2)), mode="edge")
    features = FeatureExtractor(intrinsics, camera, 600).extract_grey(grey, two_walls(1.5, 3.0))
    away_px = np.abs(features.uvr_px[:, 0] - EDGE_PX)
    measured = np.isfinite(features.depth_m)
    assert np.count_nonzero(away_px < 2.0) >= 5
    assert not measured[away_px < 2.0].any()
    assert not np.isfinite(features.uvr_px[away_px < 2.0, 2]).any()
    # Far from the contour and from the border, where the coarsest level reaches 11 pixels, all is as it was.
    assert measured[away_px > 12.0].all()

"""Points without depth come into the map by parallax, where they are, and only where two rays fix them."""

from __future__ import annotations

import math

import numpy as np
import pytest

from navcore.geometry import FloatArray
from navcore.slam.features import GRID_PX
from navcore.slam.keyframes import Features, SlamCamera
from navcore.slam.map import MapBuilder
from navcore.slam.triangulation import add_landmarks_without_depth

CAMERA = SlamCamera(320, 240, 233.0, 233.0, 159.5, 119.5, 100.0)
MAX_DEPTH_M = 6.0


def world(count: int, near_m: float, far_m: float, seed: int) -> tuple[FloatArray, np.ndarray]:
    """Points in front of a camera at the origin that looks along z, and what they look like."""
    rng = np.random.default_rng(seed)
    z = rng.uniform(near_m, far_m, count)
    uv = rng.uniform((30.0, 20.0), (290.0, 220.0), (count, 2))
    points = np.stack([(uv[:, 0] - CAMERA.cx_px) / 233.0 * z, (uv[:, 1] - CAMERA.cy_px) / 233.0 * z, z], axis=1)
    return points, rng.integers(0, 256, (count, 32)).astype(np.uint8)


def seen_from(x_m: float, points: FloatArray, looks: np.ndarray, noise_px: float) -> tuple[FloatArray, Features]:
    """A camera moved to the side, and its features: depth where the point is near."""
    pose = np.eye(4)
    pose[0, 3] = -x_m
    in_camera = points + pose[:3, 3]
    uv = 233.0 * in_camera[:, :2] / in_camera[:, 2:] + (CAMERA.cx_px, CAMERA.cy_px)
    uv += np.random.default_rng(round(100 * x_m)).normal(0.0, noise_px, uv.shape)
    depth = np.where(points[:, 2] < MAX_DEPTH_M, in_camera[:, 2], np.nan)
    uvr = np.column_stack([uv, uv[:, 0] - CAMERA.bf_px_m / depth])
    columns, rows = math.ceil(320 / GRID_PX), math.ceil(240 / GRID_PX)
    count = len(points)
    features = Features(
        uvr, depth, np.zeros(count, np.int32), np.zeros(count), looks, np.zeros(columns * rows + 1, np.int32), columns
    )
    return pose, features


def two_views(baseline_m: float, noise_px: float = 0.3) -> tuple[MapBuilder, FloatArray, int]:
    """A map of near landmarks seen from two places, and far points that are not in it yet."""
    near, near_looks = world(40, 2.0, 5.0, 1)
    far, far_looks = world(60, 8.0, 14.0, 2)
    points, looks = np.concatenate([near, far]), np.concatenate([near_looks, far_looks])
    builder = MapBuilder(CAMERA, len(points))
    for number, x_m in enumerate((0.0, baseline_m)):
        pose, features = seen_from(x_m, points, looks, noise_px)
        landmarks = np.full(len(points), -1, np.int32)
        if number > 0:
            landmarks[:40] = np.arange(40)
        keyframe = builder.add_keyframe(0.5 * number, features, pose, landmarks)
        if number == 0:
            builder.add_landmarks(keyframe, np.arange(40, dtype=np.int32), near)
    return builder, far, keyframe


def test_far_points_become_landmarks_where_they_are() -> None:
    builder, far, keyframe = two_views(baseline_m=1.5)
    added = add_landmarks_without_depth(builder, keyframe, MAX_DEPTH_M)
    assert added > 45
    seen = builder.landmark_of[keyframe, 40:]
    assert np.array_equal(seen >= 0, builder.landmark_of[0, 40:] >= 0)
    truth, made = far[seen >= 0], builder.positions[seen[seen >= 0]]
    assert np.median(np.linalg.norm(made - truth, axis=1) / truth[:, 2]) < 0.02
    assert np.array_equal(builder.landmark_of[0, 40:][seen >= 0], seen[seen >= 0])


def test_what_is_there_already_is_left_alone() -> None:
    builder, _, keyframe = two_views(baseline_m=1.5)
    before = builder.positions.copy()
    add_landmarks_without_depth(builder, keyframe, MAX_DEPTH_M)
    assert np.array_equal(builder.positions[: len(before)], before)
    assert add_landmarks_without_depth(builder, keyframe, MAX_DEPTH_M) == 0


@pytest.mark.parametrize("baseline_m", [0.1, 5.0])
def test_key_frames_too_near_or_too_far_make_none(baseline_m: float) -> None:
    builder, _, keyframe = two_views(baseline_m)
    assert add_landmarks_without_depth(builder, keyframe, MAX_DEPTH_M) == 0


def test_points_off_the_epipolar_line_make_none() -> None:
    builder, _, keyframe = two_views(baseline_m=1.5)
    builder.keyframes[keyframe].features.uvr_px[40:, 1] += 8.0
    assert add_landmarks_without_depth(builder, keyframe, MAX_DEPTH_M) < 3

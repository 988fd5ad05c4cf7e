"""What the fisheye picture says of the pose: the Jacobian, the pose that both cameras agree on, outliers, certainty."""

from __future__ import annotations

import math

import numpy as np
import pytest

from navcore.geometry import FloatArray, Transform, rotation_from_rotvec
from navcore.slam.fisheye import lens_numbers, project
from navcore.slam.fisheye_pose import FisheyeObservations, fisheye_factor, linearize, refine_with_fisheye, residual
from navcore.slam.keyframes import SlamCamera
from navcore.slam.lie import exp_se3, update_pose
from navcore.slam.pose import refine_pose
from navcore.slam.pose_factor import PoseFactor
from navcore.types import FisheyeIntrinsics

LENS = FisheyeIntrinsics(400, 320, 150.0, 150.0, 199.5, 159.5, -0.0065, 0.0486, -0.0459, 0.0083, math.radians(86.0))
FISHEYE_FROM_CAMERA: FloatArray = np.array(
    Transform.from_rotation_translation(
        rotation_from_rotvec(np.array([-0.14, 0.03, 0.01])), np.array([-0.08, 0.02, 0.0])
    ).matrix
)
CAMERA = SlamCamera(320, 240, 233.0, 233.0, 159.5, 119.5, 100.0)
NOTHING: tuple[FloatArray, FloatArray, FloatArray] = (np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0))


def seen_from(pose: FloatArray, count: int = 60, noise_px: float = 0.0, seed: int = 0) -> FisheyeObservations:
    """Landmarks all around a camera, as its fisheye sees them."""
    rng = np.random.default_rng(seed)
    azimuth, height, away = rng.uniform(-1.35, 1.35, count), rng.uniform(-0.6, 0.6, count), rng.uniform(1.0, 8.0, count)
    in_fisheye = np.stack([np.sin(azimuth), height, np.cos(azimuth)], axis=1) * away[:, None]
    pixels = project(LENS, in_fisheye) + rng.normal(0.0, noise_px, (count, 2))
    world_from_fisheye = np.linalg.inv(FISHEYE_FROM_CAMERA @ pose)
    points = in_fisheye @ world_from_fisheye[:3, :3].T + world_from_fisheye[:3, 3]
    return FisheyeObservations(points, pixels, np.ones(count), lens_numbers(LENS), FISHEYE_FROM_CAMERA)


def pose_near(pose: FloatArray, twist: FloatArray) -> FloatArray:
    moved = np.eye(4)
    update_pose(pose, twist, moved)
    return moved


@pytest.fixture
def pose() -> FloatArray:
    return exp_se3(np.array([0.4, -1.0, 0.7, 0.2, -0.9, 0.3]))


def test_jacobian_agrees_with_finite_differences(pose: FloatArray) -> None:
    seen = seen_from(pose)
    guess = pose_near(pose, np.array([0.05, -0.02, 0.03, 0.02, -0.03, 0.01]))
    numbers = seen.numbers
    for i in range(len(seen)):
        e, j, plus, minus, unused = np.empty(2), np.empty((2, 6)), np.empty(2), np.empty(2), np.empty((2, 6))
        assert residual(guess, seen.points, seen.lens_px, numbers, FISHEYE_FROM_CAMERA, i, e, j)
        for k in range(6):
            step = np.zeros(6)
            step[k] = 1e-6
            for sign, out in ((1.0, plus), (-1.0, minus)):
                moved = pose_near(guess, sign * step)
                residual(moved, seen.points, seen.lens_px, numbers, FISHEYE_FROM_CAMERA, i, out, unused)
            np.testing.assert_allclose(j[:, k], (plus - minus) / 2e-6, rtol=1e-5, atol=1e-4)


def test_the_fisheye_alone_finds_the_pose(pose: FloatArray) -> None:
    guess = pose_near(pose, np.array([0.2, -0.1, 0.15, 0.06, -0.05, 0.04]))
    found = refine_with_fisheye(guess, *NOTHING, CAMERA, seen_from(pose))
    np.testing.assert_allclose(found.camera_from_world, pose, atol=1e-6)
    assert found.fisheye_inlier.all()
    assert np.linalg.eigvalsh(found.information).min() > 0


def test_wrong_matches_are_left_out(pose: FloatArray) -> None:
    seen = seen_from(pose, 80, noise_px=0.4)
    wrong = np.random.default_rng(2).permutation(80)[:28]
    seen.lens_px[wrong] += np.random.default_rng(3).uniform(6.0, 25.0, (28, 2))
    guess = pose_near(pose, np.array([0.05, -0.03, 0.04, 0.02, -0.015, 0.01]))
    found = refine_with_fisheye(guess, *NOTHING, CAMERA, seen)
    assert not found.fisheye_inlier[wrong].any()
    right = np.setdiff1d(np.arange(80), wrong)
    assert found.fisheye_inlier[right].mean() > 0.9
    assert np.abs(found.camera_from_world - pose).max() < 0.01


def test_errors_are_as_large_as_the_information_says(pose: FloatArray) -> None:
    chi2 = []
    for seed in range(60):
        found = refine_with_fisheye(pose, *NOTHING, CAMERA, seen_from(pose, 40, noise_px=0.9, seed=seed))
        turn = found.camera_from_world[:3, :3] @ pose[:3, :3].T
        phi = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]) / 2
        xi = np.concatenate([found.camera_from_world[:3, 3] - turn @ pose[:3, 3], phi])
        chi2.append(float(xi @ found.information @ xi))
    # Six degrees of freedom; the noise is a little below the one pixel that the weights assume.
    assert 3.5 < np.mean(chi2) < 7.5


def depth_camera_sees(points: FloatArray, pose: FloatArray, noise_px: float) -> FloatArray:
    in_camera = points @ pose[:3, :3].T + pose[:3, 3]
    u = CAMERA.fx_px * in_camera[:, 0] / in_camera[:, 2] + CAMERA.cx_px
    v = CAMERA.fy_px * in_camera[:, 1] / in_camera[:, 2] + CAMERA.cy_px
    rows = np.stack([u, v, u - CAMERA.bf_px_m / in_camera[:, 2]], axis=1)
    return rows + np.random.default_rng(5).normal(0.0, noise_px, rows.shape)


def test_both_together_know_more_than_either(pose: FloatArray) -> None:
    rng = np.random.default_rng(4)
    ahead = np.stack([rng.uniform(-0.3, 0.3, 20), rng.uniform(-0.3, 0.3, 20), rng.uniform(4.0, 5.0, 20)], axis=1)
    world_from_camera = np.linalg.inv(pose)
    points = ahead @ world_from_camera[:3, :3].T + world_from_camera[:3, 3]
    rows, seen = depth_camera_sees(points, pose, 0.5), seen_from(pose, 40, noise_px=0.5)
    front = (CAMERA.fx_px, CAMERA.fy_px, CAMERA.cx_px, CAMERA.cy_px, CAMERA.bf_px_m)
    _, _, alone = refine_pose(pose, points, rows, np.ones(20), *front)
    only_fisheye = refine_with_fisheye(pose, *NOTHING, CAMERA, seen)
    both = refine_with_fisheye(pose, points, rows, np.ones(20), CAMERA, seen)
    assert both.inlier.mean() > 0.8
    for less in (alone, only_fisheye.information):
        variance, better = np.diag(np.linalg.inv(less)), np.diag(np.linalg.inv(both.information))
        assert np.all(better < variance)


def test_the_joint_pose_is_where_both_gradients_cancel(pose: FloatArray) -> None:
    rng = np.random.default_rng(6)
    ahead = np.stack([rng.uniform(-0.5, 0.5, 40), rng.uniform(-0.4, 0.4, 40), rng.uniform(1.5, 4.0, 40)], axis=1)
    world_from_camera = np.linalg.inv(pose)
    points = ahead @ world_from_camera[:3, :3].T + world_from_camera[:3, 3]
    rows, seen = depth_camera_sees(points, pose, 0.3), seen_from(pose, 40, noise_px=0.3, seed=8)
    both = refine_with_fisheye(pose, points, rows, np.ones(40), CAMERA, seen)
    assert both.inlier.all()
    assert both.fisheye_inlier.all()

    def cost(at: FloatArray) -> float:
        residuals = project(
            LENS, seen.points @ (FISHEYE_FROM_CAMERA @ at)[:3, :3].T + (FISHEYE_FROM_CAMERA @ at)[:3, 3]
        )
        return float(np.sum((residuals - seen.lens_px) ** 2) + np.sum((depth_rows(points, at) - rows) ** 2))

    best = cost(both.camera_from_world)
    for k in range(6):
        for step in (2e-4, -2e-4):
            twist = np.zeros(6)
            twist[k] = step
            assert cost(pose_near(both.camera_from_world, twist)) > best


def depth_rows(points: FloatArray, pose: FloatArray) -> FloatArray:
    return depth_camera_sees(points, pose, 0.0)


def test_what_is_known_besides_steadies_the_pose_and_adds_no_certainty(pose: FloatArray) -> None:
    seen = seen_from(pose, 200, noise_px=0.8, seed=9)
    aside = seen.lens_px[:, 0] < 60.0
    sliver = FisheyeObservations(
        seen.points[aside], seen.lens_px[aside], seen.inv_sigma2[aside], seen.numbers, seen.fisheye_from_camera
    )
    assert 10 < len(sliver) < 60
    known = PoseFactor(pose, np.diag([4e6] * 3 + [4e6] * 3))
    alone = refine_with_fisheye(pose, *NOTHING, CAMERA, sliver)
    both = refine_with_fisheye(pose, *NOTHING, CAMERA, sliver, known)
    assert np.abs(both.camera_from_world - pose).max() < 0.4 * np.abs(alone.camera_from_world - pose).max()
    np.testing.assert_allclose(
        np.linalg.eigvalsh(both.information), np.linalg.eigvalsh(alone.information), rtol=0.25, atol=1.0
    )


def test_without_observations_nothing_is_known(pose: FloatArray) -> None:
    seen = seen_from(pose, 0)
    factor, inlier = fisheye_factor(pose, seen, False)
    assert not factor.information.any()
    assert len(inlier) == 0
    h, g, _ = linearize(pose, seen.points, seen.lens_px, seen.inv_sigma2, seen.numbers, seen.fisheye_from_camera, True)
    assert not h.any()
    assert not g.any()

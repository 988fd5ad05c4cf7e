"""Pose of one camera, and the laws of SE(3) in the kernels."""

from __future__ import annotations

import bundle_oracle as oracle
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from navcore.slam import lie, pose

CAMERA = (230.0, 230.0, 160.0, 120.0, 20.0)
TRUE_POSE = lie.exp_se3(np.array([0.2, -0.1, 0.3, 0.1, -0.2, 0.05]))
twists = st.lists(st.floats(-1.5, 1.5), min_size=6, max_size=6).map(np.array)


def scene(count: int, noise_px: float, seed: int = 0, depthless: float = 0.3) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    in_camera = np.column_stack([rng.uniform(-2, 2, count), rng.uniform(-1.5, 1.5, count), rng.uniform(2.5, 5, count)])
    world_from_camera = np.linalg.inv(TRUE_POSE)
    fx, fy, cx, cy, bf = CAMERA
    u, v = (in_camera[:, k] / in_camera[:, 2] * f + c for k, f, c in ((0, fx, cx), (1, fy, cy)))
    uvr = np.column_stack([u, v, u - bf / in_camera[:, 2]]) + rng.normal(0, noise_px, (count, 3))
    uvr[rng.random(count) < depthless, 2] = np.nan
    return in_camera @ world_from_camera[:3, :3].T + world_from_camera[:3, 3], uvr


@given(twists)
@settings(max_examples=50, deadline=None)
def test_log_undoes_exp(xi: np.ndarray) -> None:
    assert np.allclose(lie.log_se3(lie.exp_se3(xi)), xi, atol=1e-8)


@given(twists, twists)
@settings(max_examples=50, deadline=None)
def test_adjoint_moves_a_twist_to_the_other_side(xi: np.ndarray, eta: np.ndarray) -> None:
    transform = lie.exp_se3(eta)
    assert np.allclose(transform @ lie.exp_se3(xi), lie.exp_se3(lie.adjoint_se3(transform) @ xi) @ transform)


@given(twists)
@settings(max_examples=50, deadline=None)
def test_inverse_and_determinant(xi: np.ndarray) -> None:
    transform = lie.exp_se3(xi)
    assert np.allclose(lie.inverse_se3(transform) @ transform, np.eye(4))
    assert np.isclose(np.linalg.det(transform[:3, :3]), 1.0)


@pytest.mark.parametrize("angle", [np.pi, np.pi - 1e-7, np.pi - 1e-3])
def test_log_of_half_a_turn(angle: float) -> None:
    axis = np.array([0.6, -0.48, 0.64])
    rotation = lie.exp_so3(angle * axis)
    assert np.allclose(lie.exp_so3(lie.log_so3(rotation)), rotation, atol=1e-6)


def test_refinement_finds_the_pose_among_outliers() -> None:
    points, uvr = scene(300, 0.5)
    wrong = np.random.default_rng(1).random(300) < 0.25
    uvr[wrong, :2] += np.random.default_rng(2).choice([-40, 40], (np.count_nonzero(wrong), 2))
    guess = lie.exp_se3(np.array([0.08, -0.05, 0.06, 0.04, -0.03, 0.02])) @ TRUE_POSE
    found, inlier, information = pose.refine_pose(guess, points, uvr, np.full(300, 4.0), *CAMERA)
    assert np.abs(found - TRUE_POSE).max() < 0.01
    assert not np.any(inlier & wrong)
    assert np.mean(inlier[~wrong]) > 0.9
    assert np.all(np.linalg.eigvalsh(information) > 0)
    assert np.allclose(found[:3, :3] @ found[:3, :3].T, np.eye(3), atol=1e-12)


def test_information_is_that_of_the_numeric_jacobian() -> None:
    points, uvr = scene(40, 0.2)
    found, inlier, information = pose.refine_pose(TRUE_POSE, points, uvr, np.ones(40), *CAMERA)
    assert inlier.all()
    expected = np.zeros((6, 6))
    for x, o in zip(points, uvr, strict=True):
        jacobian = oracle.numeric_jacobian(
            lambda d, x=x, o=o: oracle.residuals(CAMERA, oracle.moved(found, d), x, o), 6
        )
        expected += jacobian.T @ jacobian
    assert np.allclose(information, expected, rtol=1e-4, atol=1e-2)


def test_covariance_tells_the_true_scatter() -> None:
    """Over many noisy images of one place, the positions scatter as the covariance says."""
    offsets, spread = [], []
    for seed in range(60):
        points, _ = scene(80, 0.0, seed=3)
        _, uvr = scene(80, 0.0, seed=3, depthless=0.3)
        uvr = uvr + np.random.default_rng(seed).normal(0, 0.5, uvr.shape)
        found, _, information = pose.refine_pose(TRUE_POSE, points, uvr, np.full(80, 4.0), *CAMERA)
        centre, true_centre = (-p[:3, :3].T @ p[:3, 3] for p in (found, TRUE_POSE))
        offsets.append(centre - true_centre)
        spread.append(np.diag(pose.covariance_in_world(found, information))[:3])
    ratio = np.var(offsets, axis=0) / np.mean(spread, axis=0)
    assert np.all((ratio > 0.5) & (ratio < 2.0))


def test_covariance_of_what_nothing_constrains_is_large() -> None:
    assert np.all(np.diag(pose.covariance_in_world(np.eye(4), np.zeros((6, 6)))) >= 1e5)


def test_too_few_observations_leave_the_guess() -> None:
    points, uvr = scene(2, 0.0)
    found, inlier, information = pose.refine_pose(TRUE_POSE, points, uvr, np.ones(2), *CAMERA)
    assert np.array_equal(found, TRUE_POSE)
    assert not inlier.any()
    assert not information.any()


def test_landmarks_behind_the_camera_are_no_inliers() -> None:
    points, uvr = scene(60, 0.2)
    centre = -TRUE_POSE[:3, :3].T @ TRUE_POSE[:3, 3]
    points[:10] = 2 * centre - points[:10]
    _, inlier, _ = pose.refine_pose(TRUE_POSE, points, uvr, np.ones(60), *CAMERA)
    assert not inlier[:10].any()
    assert inlier[10:].all()


def test_pnp_finds_the_pose_among_outliers_and_is_repeatable() -> None:
    points, uvr = scene(150, 0.5)
    rng = np.random.default_rng(4)
    wrong = rng.random(150) < 0.4
    uvr[wrong, :2] = rng.uniform(0, 240, (np.count_nonzero(wrong), 2))
    first = pose.pnp_ransac(points, uvr[:, :2], *CAMERA[:4], seed=7, threshold_px=3.0)
    second = pose.pnp_ransac(points, uvr[:, :2], *CAMERA[:4], seed=7, threshold_px=3.0)
    assert first is not None
    assert second is not None
    assert np.array_equal(first[0], second[0])
    assert np.abs(first[0] - TRUE_POSE).max() < 0.03
    assert np.mean(first[1] == ~wrong) > 0.95


def test_pnp_of_chance_finds_nothing() -> None:
    rng = np.random.default_rng(5)
    points, uv = rng.uniform(-3, 3, (60, 3)), rng.uniform(0, 240, (60, 2))
    assert pose.pnp_ransac(points, uv, *CAMERA[:4], seed=0, threshold_px=3.0, min_inliers=12) is None
    assert pose.pnp_ransac(points[:3], uv[:3], *CAMERA[:4]) is None


def test_rigid_alignment_among_outliers() -> None:
    rng = np.random.default_rng(6)
    b = rng.uniform(-3, 3, (100, 3))
    a = b @ TRUE_POSE[:3, :3].T + TRUE_POSE[:3, 3]
    a[:50] += rng.uniform(0.5, 2.0, (50, 3))
    aligned = pose.align_ransac(a, b, 0.05, seed=1)
    assert aligned is not None
    assert np.allclose(aligned[0], TRUE_POSE)
    assert np.array_equal(aligned[1], np.arange(100) >= 50)
    assert pose.align_ransac(rng.uniform(-3, 3, (80, 3)), b[:80], 0.05, seed=1) is None

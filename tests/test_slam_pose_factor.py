"""What is known of a pose from elsewhere joins its optimization as a Gaussian."""

from __future__ import annotations

import bundle_oracle as oracle
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from test_slam_backend_pose import CAMERA, TRUE_POSE, scene

from navcore.slam import lie, pose
from navcore.slam.pose_factor import PoseFactor, add_factor, factor_cost, factor_error, factor_jacobian, intersected

NOTHING = np.zeros((0, 3))
twists = st.lists(st.floats(-0.7, 0.7), min_size=6, max_size=6).map(np.array)


def some_information(seed: int, scale: float = 1e4) -> np.ndarray:
    root = np.random.default_rng(seed).normal(size=(6, 6))
    return scale * root @ root.T


@given(twists, twists)
@settings(max_examples=40, deadline=None)
def test_jacobian_of_the_factor_is_the_numeric_one(away: np.ndarray, place: np.ndarray) -> None:
    mean = lie.exp_se3(place)
    at = np.empty((4, 4))
    lie.update_pose(mean, away, at)
    assert np.allclose(factor_error(at, mean), away, atol=1e-9)
    numeric = oracle.numeric_jacobian(lambda d: factor_error(oracle.moved(at, d), mean), 6)
    assert np.allclose(factor_jacobian(away), numeric, atol=1e-5)


def test_normal_equations_of_the_factor_are_the_gradient_and_curvature_of_its_cost() -> None:
    information, at = some_information(0), lie.exp_se3(np.array([0.03, -0.02, 0.05, 0.02, 0.01, -0.04])) @ TRUE_POSE
    h, g = np.zeros((6, 6)), np.zeros(6)
    add_factor(at, TRUE_POSE, information, h, g)
    slope = oracle.numeric_jacobian(lambda d: np.array([factor_cost(oracle.moved(at, d), TRUE_POSE, information)]), 6)
    assert np.allclose(2 * g, slope[0], rtol=1e-4, atol=1e-2 * np.abs(g).max())
    jacobian = factor_jacobian(factor_error(at, TRUE_POSE))
    assert np.allclose(h, jacobian.T @ information @ jacobian)


def test_without_points_the_factor_is_the_pose() -> None:
    information = some_information(1)
    guess = lie.exp_se3(np.array([0.1, 0.0, -0.1, 0.1, -0.1, 0.0])) @ TRUE_POSE
    found, inlier, told = pose.refine_pose(
        guess, NOTHING, NOTHING, np.zeros(0), *CAMERA, PoseFactor(TRUE_POSE, information)
    )
    assert np.allclose(found, TRUE_POSE, atol=1e-5)
    assert np.allclose(told, information, rtol=1e-3, atol=1e-3 * np.abs(information).max())
    assert len(inlier) == 0


def test_directions_of_which_the_factor_knows_nothing_stay_with_the_guess() -> None:
    information = np.diag([1e4, 0.0, 1e4, 1e4, 1e4, 1e4])
    off = np.array([0.05, 0.08, -0.04, 0.0, 0.0, 0.0])
    found, _, told = pose.refine_pose(
        lie.exp_se3(off) @ TRUE_POSE, NOTHING, NOTHING, np.zeros(0), *CAMERA, PoseFactor(TRUE_POSE, information)
    )
    assert np.allclose((found - TRUE_POSE)[:3, 3], [0.0, 0.08, 0.0], atol=1e-5)
    assert np.isclose(np.linalg.eigvalsh(told)[0], 0.0, atol=1e-3)


@pytest.mark.parametrize("count", [2, 4, 60])
def test_points_and_factor_together_weigh_by_their_information(count: int) -> None:
    """The optimum of both is where their gradients cancel: information-weighted, as in a Kalman update."""
    points, uvr = scene(count, 0.0, depthless=0.0)
    mean = lie.exp_se3(np.array([0.004, -0.003, 0.002, 0.001, -0.001, 0.002])) @ TRUE_POSE
    factor = PoseFactor(mean, some_information(2, 10.0))
    found, inlier, both = pose.refine_pose(mean, points, uvr, np.ones(count), *CAMERA, factor)
    assert inlier.all()
    of_points = both - factor.information
    expected = np.linalg.solve(both, factor.information @ factor_error(mean, TRUE_POSE))
    assert np.all(np.linalg.eigvalsh(of_points + 1e-3 * both) > 0)
    scale = np.abs(factor_error(mean, TRUE_POSE)).max()
    assert np.abs(factor_error(found, TRUE_POSE) - expected).max() < 0.1 * scale


def test_wrong_points_do_not_pull_the_pose_from_the_factor() -> None:
    points, uvr = scene(12, 0.3, depthless=0.0)
    uvr[:5, :2] += 60.0
    found, inlier, _ = pose.refine_pose(
        TRUE_POSE, points, uvr, np.ones(12), *CAMERA, PoseFactor(TRUE_POSE, 1e5 * np.eye(6))
    )
    assert not inlier[:5].any()
    assert inlier[5:].all()
    assert np.abs(found - TRUE_POSE).max() < 0.01


def test_what_is_said_twice_is_no_surer_than_once() -> None:
    once = PoseFactor(TRUE_POSE, some_information(3))
    twice = intersected(once, once)
    np.testing.assert_allclose(twice.information, once.information)
    np.testing.assert_allclose(twice.camera_from_world, TRUE_POSE, atol=1e-12)


def test_two_poses_that_may_err_alike_meet_by_their_information_and_promise_no_more_than_either_could() -> None:
    """Whatever they have in common, the true covariance of the mean is below the promised one (a matrix inequality)."""
    first, second = some_information(4), some_information(5)
    shift = np.array([0.01, -0.02, 0.015, 0.0, 0.0, 0.0])
    moved = np.empty((4, 4))
    lie.update_pose(TRUE_POSE, shift, moved)
    both = intersected(PoseFactor(TRUE_POSE, first), PoseFactor(moved, second))
    expected = np.linalg.solve(first + second, second @ shift)
    np.testing.assert_allclose(factor_error(both.camera_from_world, TRUE_POSE), expected, atol=1e-6)
    promised = np.linalg.inv(both.information)
    gains = np.linalg.solve(first + second, first), np.linalg.solve(first + second, second)
    roots = np.linalg.cholesky(np.linalg.inv(first)), np.linalg.cholesky(np.linalg.inv(second))
    for alike in (-1.0, 0.0, 1.0):
        common = alike * gains[0] @ roots[0] @ roots[1].T @ gains[1].T
        own = sum(g @ r @ r.T @ g.T for g, r in zip(gains, roots, strict=True))
        assert np.linalg.eigvalsh(promised - own - common - common.T)[0] > -1e-12

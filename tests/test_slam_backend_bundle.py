"""Bundle adjustment and pose graph, against plain NumPy and against the truth."""

from __future__ import annotations

import bundle_oracle as oracle
import numpy as np
import pytest

from navcore.slam import pose_graph, reduced_system
from navcore.slam.bundle_adjustment import bundle_adjust
from navcore.slam.bundle_kernels import observation_jacobians
from navcore.slam.lie import exp_se3, inverse_se3

CAMERA = (230.0, 231.0, 160.0, 120.0, 20.0)


def problem(keyframes: int, landmarks: int, noise_px: float, seed: int = 0):
    """True poses and points, and observations of all points by all key frames, a third of them without depth."""
    rng = np.random.default_rng(seed)
    points = np.column_stack(
        [rng.uniform(-1.5, 1.5, landmarks), rng.uniform(-1, 1, landmarks), rng.uniform(3, 5, landmarks)]
    )
    poses = np.stack([exp_se3(np.r_[0.15 * k, rng.normal(0, 0.02, 5)]) for k in range(keyframes)])
    keyframe = np.repeat(np.arange(keyframes, dtype=np.int32), landmarks)
    point = np.tile(np.arange(landmarks, dtype=np.int32), keyframes)
    p = np.einsum("mij,mj->mi", poses[keyframe, :3, :3], points[point]) + poses[keyframe, :3, 3]
    u, v = (p[:, k] / p[:, 2] * f + c for k, f, c in ((0, CAMERA[0], CAMERA[2]), (1, CAMERA[1], CAMERA[3])))
    uvr = np.column_stack([u, v, u - CAMERA[4] / p[:, 2]]) + rng.normal(0, noise_px, (len(p), 3))
    uvr[rng.random(len(p)) < 0.3, 2] = np.nan
    fixed = np.arange(keyframes) == 0
    return poses, fixed, points, keyframe, point, uvr


def disturbed(poses, fixed, points, seed: int = 1):
    rng = np.random.default_rng(seed)
    moved = np.stack([p if f else exp_se3(rng.normal(0, 0.01, 6)) @ p for p, f in zip(poses, fixed, strict=True)])
    return moved, points + rng.normal(0, 0.03, points.shape)


def test_analytic_jacobians_are_the_numeric_ones() -> None:
    poses, _, points, keyframe, point, uvr = problem(2, 6, 0.5)
    e, jc, jp = np.empty(3), np.empty((3, 6)), np.empty((3, 3))
    for m in range(len(keyframe)):
        pose, x = poses[keyframe[m]], points[point[m]]
        rows = observation_jacobians(np.array(CAMERA), pose, x, uvr[m], e, jc, jp)
        assert rows == (2 if np.isnan(uvr[m, 2]) else 3)
        assert np.allclose(e[:rows], oracle.residuals(CAMERA, pose, x, uvr[m]))
        numeric = oracle.numeric_jacobian(
            lambda d, p=pose, x=x, o=uvr[m]: oracle.residuals(CAMERA, oracle.moved(p, d), x, o), 6
        )
        assert np.allclose(jc[:rows], numeric, rtol=1e-5, atol=1e-4)
        numeric = oracle.numeric_jacobian(lambda d, p=pose, x=x, o=uvr[m]: oracle.residuals(CAMERA, p, x + d, o), 3)
        assert np.allclose(jp[:rows], numeric, rtol=1e-5, atol=1e-4)


def test_it_reaches_the_minimum_of_the_plain_version() -> None:
    poses, fixed, points, keyframe, point, uvr = problem(4, 12, 0.7)
    uvr[::17, 0] += 15.0
    inv_sigma2 = np.where(point % 2 == 0, 1.0, 0.5)
    start_poses, start_points = disturbed(poses, fixed, points)
    args = (keyframe, point, uvr, inv_sigma2)
    fast = bundle_adjust(*CAMERA, start_poses, fixed, start_points, *args, iterations=40, rounds=1)
    slow_poses, slow_points = oracle.bundle_adjust(CAMERA, start_poses, fixed, start_points, *args, iterations=15)
    assert oracle.cost(CAMERA, fast.poses, fast.points, *args) == pytest.approx(
        oracle.cost(CAMERA, slow_poses, slow_points, *args), rel=1e-4
    )
    assert fast.initial_cost == pytest.approx(oracle.cost(CAMERA, start_poses, start_points, *args))
    assert np.allclose(fast.poses, slow_poses, atol=5e-3)


def test_outliers_are_named_and_do_not_move_the_result() -> None:
    poses, fixed, points, keyframe, point, uvr = problem(6, 80, 0.4)
    wrong = np.random.default_rng(3).random(len(point)) < 0.05
    uvr[wrong, 1] += 25.0
    start = disturbed(poses, fixed, points)
    result = bundle_adjust(*CAMERA, start[0], fixed, start[1], keyframe, point, uvr, np.full(len(point), 4.0), 15)
    assert not np.any(result.inlier & wrong)
    assert np.mean(result.inlier[~wrong]) > 0.95
    assert np.abs(result.poses - poses).max() < 0.04
    assert result.final_cost < result.initial_cost
    assert np.array_equal(result.poses[0], poses[0])


def test_the_order_of_observations_does_not_matter() -> None:
    poses, fixed, points, keyframe, point, uvr = problem(4, 30, 0.4)
    start = disturbed(poses, fixed, points)
    weight = np.ones(len(point))
    a = bundle_adjust(*CAMERA, start[0], fixed, start[1], keyframe, point, uvr, weight)
    mixed = np.random.default_rng(5).permutation(len(point))
    b = bundle_adjust(*CAMERA, start[0], fixed, start[1], keyframe[mixed], point[mixed], uvr[mixed], weight)
    assert np.array_equal(a.poses, b.poses)
    assert np.array_equal(a.inlier[mixed], b.inlier)


def test_a_landmark_seen_once_without_depth_stays_finite() -> None:
    poses, fixed, points, keyframe, point, uvr = problem(3, 20, 0.3)
    once = (point != 0) | (keyframe == 1)
    uvr[(point == 0) & (keyframe == 1), 2] = np.nan
    start = disturbed(poses, fixed, points)
    result = bundle_adjust(
        *CAMERA, start[0], fixed, start[1], keyframe[once], point[once], uvr[once], np.ones(sum(once))
    )
    assert np.all(np.isfinite(result.poses))
    assert np.all(np.isfinite(result.points))
    assert np.abs(result.poses - poses).max() < 0.05


def test_without_a_fixed_key_frame_or_with_a_wrong_index_it_refuses() -> None:
    poses, fixed, points, keyframe, point, uvr = problem(2, 5, 0.3)
    weight = np.ones(len(point))
    with pytest.raises(ValueError, match="fixed"):
        bundle_adjust(*CAMERA, poses, np.zeros(2, bool), points, keyframe, point, uvr, weight)
    with pytest.raises(ValueError, match="does not exist"):
        bundle_adjust(*CAMERA, poses, fixed, points[:3], keyframe, point, uvr, weight)


# ----------------------------------------------------------------------------------------------- pose graph
def ring(count: int, seed: int = 0):
    """A ring of poses, noisy edges between neighbours, and one exact edge that closes it."""
    rng = np.random.default_rng(seed)
    angle = np.linspace(0, 2 * np.pi, count, endpoint=False)
    truth = np.stack([exp_se3(np.r_[0, 0, 3.0, 0, 0, 0]) @ exp_se3(np.r_[0, 0, 0, 0, a, 0]) for a in angle])
    i = np.r_[np.arange(1, count), 0].astype(np.int32)
    j = np.r_[np.arange(count - 1), count - 1].astype(np.int32)
    relative = np.stack([truth[a] @ inverse_se3(truth[b]) for a, b in zip(i, j, strict=True)])
    relative[:-1] = np.stack([exp_se3(rng.normal(0, 0.02, 6)) @ r for r in relative[:-1]])
    start = [truth[0]]
    for r in relative[:-1]:
        start.append(r @ start[-1])
    return truth, np.stack(start), i, j, relative


def dense_pose_graph(poses, i, j, relative, weights, fixed, iterations=15):
    """The same minimization with numeric Jacobians and one dense system."""
    poses = poses.copy()
    for _ in range(iterations):

        def errors(twist, poses=poses):
            moved = [p if f else exp_se3(x) @ p for p, f, x in zip(poses, fixed, twist.reshape(-1, 6), strict=True)]
            edges = zip(i, j, relative, weights, strict=True)
            return np.concatenate([np.sqrt(w) * pose_graph.edge_error(moved[a], moved[b], r) for a, b, r, w in edges])

        jacobian = oracle.numeric_jacobian(errors, 6 * len(poses))
        e = errors(np.zeros(6 * len(poses)))
        step = np.linalg.lstsq(jacobian, -e, rcond=None)[0].reshape(-1, 6)
        poses = np.stack([p if f else exp_se3(x) @ p for p, f, x in zip(poses, fixed, step, strict=True)])
    return poses


def test_pose_graph_jacobians_are_the_numeric_ones() -> None:
    _, poses, i, j, relative = ring(6)
    for a, b, r in zip(i, j, relative, strict=True):
        r = exp_se3(np.array([0.05, -0.02, 0.03, 0.1, -0.1, 0.05])) @ r
        analytic = pose_graph.edge_jacobians(poses[a], poses[b], r)
        by_i = oracle.numeric_jacobian(
            lambda d, a=a, b=b, r=r: pose_graph.edge_error(exp_se3(d) @ poses[a], poses[b], r), 6
        )
        by_j = oracle.numeric_jacobian(
            lambda d, a=a, b=b, r=r: pose_graph.edge_error(poses[a], exp_se3(d) @ poses[b], r), 6
        )
        assert np.allclose(analytic[0], by_i, atol=1e-4)
        assert np.allclose(analytic[1], by_j, atol=1e-4)


def test_pose_graph_reaches_the_minimum_of_the_dense_solver() -> None:
    _, start, i, j, relative = ring(8)
    weights, fixed = np.where(np.arange(8) == 7, 20.0, 1.0), np.arange(8) == 0
    fast = pose_graph.optimize(start, i, j, relative, weights, fixed, 50)
    slow = dense_pose_graph(start, i, j, relative, weights, fixed)
    assert pose_graph.cost(fast, i, j, relative, weights) == pytest.approx(
        pose_graph.cost(slow, i, j, relative, weights), rel=1e-4
    )
    assert np.allclose(fast, slow, atol=1e-3)


@pytest.mark.parametrize("count", [30, 120])
def test_a_closed_ring_is_nearer_to_the_truth(count: int) -> None:
    """Small graphs are solved dense, large ones sparse: both must spread the error."""
    truth, start, i, j, relative = ring(count)
    weights, fixed = np.ones(count), np.arange(count) == 0
    weights[-1] = 100.0
    closed = pose_graph.optimize(start, i, j, relative, weights, fixed)
    assert pose_graph.cost(closed, i, j, relative, weights) < 0.2 * pose_graph.cost(start, i, j, relative, weights)
    assert np.abs(closed - truth).max() < 0.6 * np.abs(start - truth).max()
    assert np.array_equal(closed[0], start[0])


def test_a_graph_that_agrees_with_itself_stays() -> None:
    truth, _, i, j, _ = ring(12)
    relative = np.stack([truth[a] @ inverse_se3(truth[b]) for a, b in zip(i, j, strict=True)])
    assert np.allclose(pose_graph.optimize(truth, i, j, relative, np.ones(12), np.arange(12) == 3), truth)


def test_pose_graph_refuses_what_floats() -> None:
    truth, _, i, j, relative = ring(4)
    with pytest.raises(ValueError, match="fixed"):
        pose_graph.optimize(truth, i, j, relative, np.ones(4), np.zeros(4, bool))
    with pytest.raises(ValueError, match="does not exist"):
        pose_graph.optimize(truth[:3], i, j, relative, np.ones(4), np.ones(3, bool))


def test_dense_and_sparse_factorization_agree(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(8)
    count = 50
    row = np.r_[np.arange(count), np.arange(count - 1)].astype(np.int32)
    col = np.r_[np.arange(count), np.arange(1, count)].astype(np.int32)
    blocks = 0.3 * rng.normal(size=(len(row), 6, 6))
    blocks[:count] = blocks[:count] @ blocks[:count].transpose(0, 2, 1) + 6 * np.eye(6)
    rhs = rng.normal(size=(count, 6))
    sparse = reduced_system.solve_reduced(blocks, row, col, rhs)
    monkeypatch.setattr(reduced_system, "DENSE_LIMIT", 1000)
    dense = reduced_system.solve_reduced(blocks, row, col, rhs)
    assert np.allclose(sparse, dense)
    blocks[3] = -np.eye(6)
    assert reduced_system.solve_reduced(blocks, row, col, rhs) is None

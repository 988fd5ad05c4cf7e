"""Bundle adjustment: key frames' poses and landmarks together, by Levenberg–Marquardt on the Schur complement.

Each landmark touches only the key frames that see it, so the landmarks are eliminated first; what remains is one
6×6 block per pair of key frames that share landmarks (Triggs et al., Bundle adjustment – a modern synthesis).
Observations with and without depth are mixed; see :mod:`navcore.slam.pose` for their form.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from navcore.geometry import FloatArray
from navcore.slam.bundle_kernels import (
    back_substitute,
    classify,
    damp_points,
    eliminate,
    linearize,
    pair_blocks,
    robust_cost,
    step_cameras,
    step_points,
)
from navcore.slam.reduced_system import solve_reduced

BoolArray = NDArray[np.bool_]
Int32Array = NDArray[np.int32]

_MAX_DAMPING = 1e6


@dataclass(frozen=True, slots=True, eq=False)
class BundleResult:
    """What a bundle adjustment gives back."""

    poses: FloatArray
    """``camera_from_world`` (K, 4, 4) in the order of the input."""
    points: FloatArray
    """Landmarks (N, 3), metres."""
    inlier: BoolArray
    """Observations (M,) that agree with the result (χ² 5.991, with depth 7.815, and in front of the camera)."""
    initial_cost: float = 0.0
    """Robust cost before, in units of variance."""
    final_cost: float = 0.0
    """Robust cost after, over the observations that are inliers at the end."""


def bundle_adjust(
    fx_px: float,
    fy_px: float,
    cx_px: float,
    cy_px: float,
    bf: float,
    poses: FloatArray,
    fixed: BoolArray,
    points: FloatArray,
    obs_keyframe: Int32Array,
    obs_point: Int32Array,
    obs_uvr: FloatArray,
    inv_sigma2: FloatArray,
    iterations: int = 10,
    rounds: int = 2,
) -> BundleResult:
    """Adjust key frames' poses and landmarks to their observations.

    ``poses`` are ``camera_from_world`` (K, 4, 4); those marked in ``fixed`` (K,) stay, and at least one must be, since
    nothing else says where the map lies. Observation m is landmark ``obs_point[m]`` seen by key frame
    ``obs_keyframe[m]`` at ``obs_uvr[m]`` (u, v, u_right or NaN) with the inverse variance ``inv_sigma2[m]``.

    Of ``rounds`` rounds, the first is Huber-robust; after each, observations that do not agree are left out of the
    next, which is quadratic. ``iterations`` are shared among the rounds, a third for the first of two.

    Raises ValueError where no key frame is fixed or an index points outside.
    """
    count_m = len(obs_keyframe)
    _check_indices(len(poses), len(points), obs_keyframe, obs_point, fixed)
    order = np.lexsort((obs_keyframe, obs_point))
    problem = _Problem(
        camera=np.array([fx_px, fy_px, cx_px, cy_px, bf], dtype=np.float64),
        keyframe=np.ascontiguousarray(obs_keyframe[order], dtype=np.int32),
        point=np.ascontiguousarray(obs_point[order], dtype=np.int32),
        uvr=np.ascontiguousarray(obs_uvr[order], dtype=np.float64),
        inv_sigma2=np.ascontiguousarray(inv_sigma2[order], dtype=np.float64),
        free=_free_index(fixed),
        point_start=np.searchsorted(obs_point[order], np.arange(len(points) + 1)).astype(np.int64),
    )
    new_poses = np.array(poses, dtype=np.float64, order="C")
    new_points = np.array(points, dtype=np.float64, order="C")
    used = np.ones(count_m, dtype=np.bool_)
    initial_cost = final_cost = 0.0
    for round_index in range(rounds):
        share = iterations if rounds == 1 else (iterations + 2) // 3 if round_index == 0 else iterations * 2 // 3
        before, final_cost = _optimize(problem, new_poses, new_points, used, share, robust=round_index == 0)
        initial_cost = before if round_index == 0 else initial_cost
        classify(
            problem.camera,
            new_poses,
            new_points,
            problem.keyframe,
            problem.point,
            problem.uvr,
            problem.inv_sigma2,
            used,
        )
    inlier = np.empty(count_m, dtype=np.bool_)
    inlier[order] = used
    return BundleResult(new_poses, new_points, inlier, initial_cost, final_cost)


@dataclass(frozen=True, slots=True, eq=False)
class _Problem:
    """The observations, sorted by landmark, and what follows from them once."""

    camera: FloatArray
    keyframe: Int32Array
    point: Int32Array
    uvr: FloatArray
    inv_sigma2: FloatArray
    free: Int32Array
    """Index (K,) of each key frame among the free ones, −1 where it is fixed."""
    point_start: NDArray[np.int64]
    """First observation (N + 1,) of each landmark."""


def _check_indices(
    keyframes: int, points: int, obs_keyframe: Int32Array, obs_point: Int32Array, fixed: BoolArray
) -> None:
    if not np.any(fixed):
        raise ValueError("a bundle adjustment needs at least one fixed key frame")
    if len(obs_keyframe) and (
        obs_keyframe.min() < 0 or obs_keyframe.max() >= keyframes or obs_point.min() < 0 or obs_point.max() >= points
    ):
        raise ValueError("an observation names a key frame or a landmark that does not exist")


def _free_index(fixed: BoolArray) -> Int32Array:
    free = np.where(fixed, -1, np.cumsum(~fixed) - 1)
    return free.astype(np.int32)


def _optimize(
    problem: _Problem, poses: FloatArray, points: FloatArray, used: BoolArray, iterations: int, robust: bool
) -> tuple[float, float]:
    """Levenberg–Marquardt in place; returns the cost before and after."""
    p = problem
    cameras = int(p.free.max()) + 1
    hcc = np.zeros((cameras, 6, 6))
    gc = np.zeros((cameras, 6))
    hpp = np.zeros((len(points), 3, 3))
    gp = np.zeros((len(points), 3))
    hcp = np.zeros((len(p.keyframe), 6, 3))
    block_of, block_row, block_col = pair_blocks(p.keyframe, p.free, p.point_start, cameras)
    arguments = (p.camera, p.keyframe, p.point, p.uvr, p.inv_sigma2)
    first = cost = robust_cost(*arguments, poses, points, used, robust)
    damping = 1e-4
    growth = 2.0
    linearized = False
    for _ in range(iterations):
        if not linearized:
            linearize(*arguments, p.free, poses, points, used, robust, hcc, gc, hpp, gp, hcp)
            linearized = True
        inverse = damp_points(hpp, damping)
        blocks, rhs = eliminate(
            p.keyframe, p.free, p.point_start, used, hcc, gc, gp, hcp, inverse, damping, block_of, len(block_row)
        )
        step_c = solve_reduced(blocks, block_row, block_col, rhs) if cameras else np.zeros((0, 6))
        if step_c is not None:
            step_p = back_substitute(p.keyframe, p.free, p.point_start, used, gp, hcp, inverse, step_c)
            new_poses = step_cameras(poses, p.free, step_c)
            new_points = step_points(points, step_p)
            new_cost = robust_cost(*arguments, new_poses, new_points, used, robust)
            if new_cost <= cost:
                gain = cost - new_cost
                predicted = _predicted_gain(step_c, step_p, gc, gp, hcc, hpp, damping)
                poses[:], points[:], cost = new_poses, new_points, new_cost
                linearized = False
                ratio = gain / predicted if predicted > 0.0 else 1.0
                damping = max(damping * max(1.0 / 3.0, 1.0 - (2.0 * min(ratio, 1.0) - 1.0) ** 3), 1e-9)
                growth = 2.0
                if gain <= 1e-5 * cost:
                    break
                continue
        damping *= growth
        growth *= 2.0
        if damping > _MAX_DAMPING:
            break
    return first, cost


def _predicted_gain(
    step_c: FloatArray,
    step_p: FloatArray,
    gc: FloatArray,
    gp: FloatArray,
    hcc: FloatArray,
    hpp: FloatArray,
    damping: float,
) -> float:
    """Gain that the quadratic model promises: δᵀ(damping · diag H δ − g)."""
    camera_diagonal = np.einsum("kii->ki", hcc)
    point_diagonal = np.einsum("kii->ki", hpp)
    total = np.sum(step_c * (damping * camera_diagonal * step_c - gc))
    total += np.sum(step_p * (damping * point_diagonal * step_p - gp))
    return float(total)


def warm_up() -> None:
    """Compile this module's kernels on a problem of three key frames and eight landmarks."""
    corners = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (4.0, 5.0)])
    poses = np.stack([np.eye(4)] * 3)
    poses[1:, 0, 3] = (-0.2, 0.2)
    keyframe = np.repeat(np.arange(3, dtype=np.int32), len(corners))
    point = np.tile(np.arange(len(corners), dtype=np.int32), 3)
    seen = corners[point] + poses[keyframe, :3, 3]
    uvr = np.empty((len(keyframe), 3))
    uvr[:, :2] = seen[:, :2] / seen[:, 2:] * 100.0 + 50.0
    uvr[:, 2] = uvr[:, 0] - 8.0 / seen[:, 2]
    fixed = np.array([True, False, False])
    bundle_adjust(
        100.0, 100.0, 50.0, 50.0, 8.0, poses, fixed, corners + 0.01, keyframe, point, uvr, np.ones(len(keyframe)), 3
    )

"""Pose graph: key frames' poses adjusted to relative poses between them, so that a closed loop spreads over all.

Gauss–Newton with Levenberg–Marquardt damping on SE(3); the system is sparse, one 6×6 block per edge. Depth fixes the
scale, so the poses are rigid (ORB-SLAM2 closes loops of depth cameras the same way).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from navcore.compiled import kernel
from navcore.geometry import FloatArray
from navcore.slam.lie import adjoint_se3, exp_se3, inverse_se3, log_se3, product, skew
from navcore.slam.reduced_system import solve_reduced

BoolArray = NDArray[np.bool_]
Int32Array = NDArray[np.int32]

_MAX_DAMPING = 1e6


def optimize(
    poses: FloatArray,
    edge_i: Int32Array,
    edge_j: Int32Array,
    relative: FloatArray,
    weights: FloatArray,
    fixed: BoolArray,
    iterations: int = 20,
) -> FloatArray:
    """Adjust poses to relative poses.

    ``poses`` are ``camera_from_world`` (K, 4, 4); edge e says that ``poses[edge_i[e]] @ inverse(poses[edge_j[e]])``,
    camera i from camera j, is ``relative[e]`` (4, 4), with the inverse variance ``weights[e]`` (1/m² and 1/rad²).
    Those marked in ``fixed`` (K,) stay. The result (K, 4, 4) minimizes the weighted squared twists of all edges.

    Raises ValueError where no pose is fixed or an edge names a pose that does not exist.
    """
    count = len(poses)
    if not np.any(fixed):
        raise ValueError("a pose graph needs at least one fixed pose")
    if len(edge_i) and (min(edge_i.min(), edge_j.min()) < 0 or max(edge_i.max(), edge_j.max()) >= count):
        raise ValueError("an edge names a pose that does not exist")
    current = np.array(poses, dtype=np.float64, order="C")
    free = np.where(fixed, -1, np.cumsum(~fixed) - 1).astype(np.int32)
    edges = (
        np.ascontiguousarray(edge_i, dtype=np.int32),
        np.ascontiguousarray(edge_j, dtype=np.int32),
        np.ascontiguousarray(relative, dtype=np.float64),
        np.ascontiguousarray(weights, dtype=np.float64),
    )
    if not np.any(~fixed) or not len(edge_i):
        return current
    return _minimize(current, edges, free, iterations)


def cost(poses: FloatArray, edge_i: Int32Array, edge_j: Int32Array, relative: FloatArray, weights: FloatArray) -> float:
    """Return the weighted sum of squared twists that :func:`optimize` minimizes."""
    return _cost(
        np.ascontiguousarray(poses, dtype=np.float64),
        np.ascontiguousarray(edge_i, dtype=np.int32),
        np.ascontiguousarray(edge_j, dtype=np.int32),
        np.ascontiguousarray(relative, dtype=np.float64),
        np.ascontiguousarray(weights, dtype=np.float64),
    )


def _minimize(
    poses: FloatArray,
    edges: tuple[Int32Array, Int32Array, FloatArray, FloatArray],
    free: Int32Array,
    iterations: int,
) -> FloatArray:
    count = int(free.max()) + 1
    block_row, block_col, edge_block = _pattern(free[edges[0]], free[edges[1]], count)
    now = _cost(poses, *edges)
    damping, growth = 1e-6, 2.0
    blocks, gradient = _linearize(poses, *edges, free, edge_block, count, len(block_row))
    for _ in range(iterations):
        damped = blocks.copy()
        diagonal = np.einsum("kii->ki", damped[:count])
        diagonal += damping * diagonal + 1e-12
        step = solve_reduced(damped, block_row, block_col, -gradient)
        trial = poses if step is None else _step(poses, free, step)
        after = np.inf if step is None else _cost(trial, *edges)
        if after > now:
            damping, growth = max(damping, 1e-6) * growth, growth * 2.0
            if damping > _MAX_DAMPING:
                break
            continue
        gain, poses, now = now - after, trial, after
        damping, growth = damping * 0.3, 2.0
        if gain <= 1e-7 * now + 1e-15:
            break
        blocks, gradient = _linearize(poses, *edges, free, edge_block, count, len(block_row))
    return poses


def _pattern(i: Int32Array, j: Int32Array, count: int) -> tuple[Int32Array, Int32Array, Int32Array]:
    """Number the upper blocks: first the diagonal, then one for each pair; the third result is each edge's block."""
    low, high = np.minimum(i, j).astype(np.int64), np.maximum(i, j).astype(np.int64)
    coupled = (low >= 0) & (low != high)
    keys, inverse = np.unique(low[coupled] * count + high[coupled], return_inverse=True)
    edge_block = np.full(len(i), -1, np.int32)
    edge_block[coupled] = count + inverse
    diagonal = np.arange(count)
    row = np.concatenate([diagonal, keys // count]).astype(np.int32)
    col = np.concatenate([diagonal, keys % count]).astype(np.int32)
    return row, col, edge_block


# --------------------------------------------------------------------------------------------------- kernels
@kernel
def edge_error(pose_i: FloatArray, pose_j: FloatArray, relative: FloatArray) -> FloatArray:
    """Return the twist (6,) by which ``pose_i @ inverse(pose_j)`` differs from the measured relative pose."""
    return log_se3(product(product(inverse_se3(relative), pose_i), inverse_se3(pose_j)))


@kernel
def _left_jacobian_inverse(xi: FloatArray) -> FloatArray:
    """The series I − ad/2 + ad²/12 of the inverse left Jacobian of SE(3), exact enough below half a radian."""
    ad = np.zeros((6, 6))
    rotation, translation = skew(xi[3:]), skew(xi[:3])
    for i in range(3):
        for j in range(3):
            ad[i, j] = rotation[i, j]
            ad[3 + i, 3 + j] = rotation[i, j]
            ad[i, 3 + j] = translation[i, j]
    square = product(ad, ad)
    fourth = product(square, square)
    out = np.empty((6, 6))
    for i in range(6):
        for j in range(6):
            out[i, j] = -0.5 * ad[i, j] + square[i, j] / 12.0 - fourth[i, j] / 720.0
        out[i, i] += 1.0
    return out


@kernel
def edge_jacobians(pose_i: FloatArray, pose_j: FloatArray, relative: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the Jacobians (6, 6) of :func:`edge_error` by left-multiplied twists of pose i and of pose j."""
    error = edge_error(pose_i, pose_j, relative)
    jacobian_i = product(_left_jacobian_inverse(error), adjoint_se3(inverse_se3(relative)))
    for k in range(6):
        error[k] = -error[k]
    # The right Jacobian at e is the left one at −e.
    jacobian_j = _left_jacobian_inverse(error)
    for i in range(6):
        for k in range(6):
            jacobian_j[i, k] = -jacobian_j[i, k]
    return jacobian_i, jacobian_j


@kernel
def _cost(
    poses: FloatArray, edge_i: Int32Array, edge_j: Int32Array, relative: FloatArray, weights: FloatArray
) -> float:
    total = 0.0
    for e in range(len(edge_i)):
        error = edge_error(poses[edge_i[e]], poses[edge_j[e]], relative[e])
        for k in range(6):
            total += weights[e] * error[k] * error[k]
    return total


@kernel
def _add_product(out: FloatArray, weight: float, a: FloatArray, b: FloatArray) -> None:
    """Add weight · aᵀ b (6, 6)."""
    for i in range(6):
        for j in range(6):
            for k in range(6):
                out[i, j] += weight * a[k, i] * b[k, j]


@kernel
def _add_gradient(out: FloatArray, weight: float, jacobian: FloatArray, error: FloatArray) -> None:
    for i in range(6):
        for k in range(6):
            out[i] += weight * jacobian[k, i] * error[k]


@kernel
def _linearize(
    poses: FloatArray,
    edge_i: Int32Array,
    edge_j: Int32Array,
    relative: FloatArray,
    weights: FloatArray,
    free: Int32Array,
    edge_block: Int32Array,
    count: int,
    block_count: int,
) -> tuple[FloatArray, FloatArray]:
    blocks = np.zeros((block_count, 6, 6))
    gradient = np.zeros((count, 6))
    for e in range(len(edge_i)):
        pose_i, pose_j = poses[edge_i[e]], poses[edge_j[e]]
        error = edge_error(pose_i, pose_j, relative[e])
        jacobian_i, jacobian_j = edge_jacobians(pose_i, pose_j, relative[e])
        i, j = free[edge_i[e]], free[edge_j[e]]
        w = weights[e]
        if i >= 0:
            _add_product(blocks[i], w, jacobian_i, jacobian_i)
            _add_gradient(gradient[i], w, jacobian_i, error)
        if j >= 0:
            _add_product(blocks[j], w, jacobian_j, jacobian_j)
            _add_gradient(gradient[j], w, jacobian_j, error)
        if i >= 0 and j >= 0 and i != j:
            if i < j:
                _add_product(blocks[edge_block[e]], w, jacobian_i, jacobian_j)
            else:
                _add_product(blocks[edge_block[e]], w, jacobian_j, jacobian_i)
    return blocks, gradient


@kernel
def _step(poses: FloatArray, free: Int32Array, step: FloatArray) -> FloatArray:
    out = poses.copy()
    for k in range(len(poses)):
        if free[k] >= 0:
            out[k] = product(exp_se3(step[free[k]]), poses[k])
    return out


def warm_up() -> None:
    """Compile this module's kernels."""
    poses = np.stack([np.eye(4)] * 3)
    relative = np.stack([np.eye(4)] * 2)
    relative[:, 0, 3] = 0.1
    index = np.arange(2, dtype=np.int32)
    optimize(poses, index, index + 1, relative, np.ones(2), np.array([True, False, False]), 2)

"""What is known of a pose from elsewhere than its landmarks, as a Gaussian: it joins the optimization of the pose.

The error of a pose T against the mean M is the twist ξ = (ρ, φ) that takes M to T the way poses are updated,
``R ← exp(φ) R, t ← exp(φ) t + ρ`` (:func:`navcore.slam.lie.update_pose`); the cost is ξᵀ Λ ξ.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from navcore.compiled import kernel
from navcore.geometry import FloatArray
from navcore.slam.lie import left_jacobian_inverse_so3, log_so3, product, update_pose


@dataclass(frozen=True, slots=True, eq=False)
class PoseFactor:
    """A measurement of a whole pose. Directions of which it knows nothing have no information."""

    camera_from_world: FloatArray
    """(4, 4): the mean."""
    information: FloatArray
    """(6, 6): inverse covariance of a left-multiplied twist (translation, rotation) in the camera's frame, positive
    semi-definite, as :func:`navcore.slam.pose.refine_pose` returns it."""

    @staticmethod
    def nothing() -> PoseFactor:
        """Return the factor that says nothing."""
        return PoseFactor(np.eye(4), np.zeros((6, 6)))


@kernel
def factor_error(pose: FloatArray, mean: FloatArray) -> FloatArray:
    """Return the twist (6,) that takes the mean (4, 4) to the pose (4, 4)."""
    turn = np.zeros((3, 3))
    for i in range(3):
        for j in range(3):
            for k in range(3):
                turn[i, j] += pose[i, k] * mean[j, k]
    phi = log_so3(turn)
    xi = np.empty(6)
    for i in range(3):
        xi[i] = pose[i, 3] - turn[i, 0] * mean[0, 3] - turn[i, 1] * mean[1, 3] - turn[i, 2] * mean[2, 3]
        xi[3 + i] = phi[i]
    return xi


@kernel
def factor_jacobian(xi: FloatArray) -> FloatArray:
    """Return how the error ξ (6,) changes with an update of the pose (6, 6): ρ' = ρ + δρ − ρ × δφ, φ' = φ + J⁻¹ δφ."""
    jacobian = np.zeros((6, 6))
    rotation = left_jacobian_inverse_so3(xi[3:].copy())
    for i in range(3):
        jacobian[i, i] = 1.0
        a, b = (i + 1) % 3, (i + 2) % 3
        jacobian[i, 3 + a] = xi[b]
        jacobian[i, 3 + b] = -xi[a]
        for j in range(3):
            jacobian[3 + i, 3 + j] = rotation[i, j]
    return jacobian


@kernel
def factor_cost(pose: FloatArray, mean: FloatArray, information: FloatArray) -> float:
    """Return ξᵀ Λ ξ."""
    xi = factor_error(pose, mean)
    total = 0.0
    for i in range(6):
        for j in range(6):
            total += xi[i] * information[i, j] * xi[j]
    return total


@kernel
def add_factor(pose: FloatArray, mean: FloatArray, information: FloatArray, h: FloatArray, g: FloatArray) -> None:
    """Add the factor to the normal equations, h (6, 6) += JᵀΛJ and g (6,) += JᵀΛξ."""
    xi = factor_error(pose, mean)
    jacobian = factor_jacobian(xi)
    weighted = product(information, jacobian)
    for i in range(6):
        for k in range(6):
            g[i] += weighted[k, i] * xi[k]
            for j in range(6):
                h[i, j] += jacobian[k, i] * weighted[k, j]


def fused(first: PoseFactor, second: PoseFactor) -> PoseFactor:
    """Return what two measurements of a pose say together, linearized at the first: a Kalman update."""
    information = first.information + second.information
    pull = second.information @ factor_error(second.camera_from_world, first.camera_from_world)
    step = np.linalg.solve(information + 1e-9 * np.eye(6), pull)
    pose = np.empty((4, 4))
    update_pose(first.camera_from_world, np.asarray(step, dtype=np.float64), pose)
    return PoseFactor(pose, information)


def intersected(first: PoseFactor, second: PoseFactor) -> PoseFactor:
    """Return what two measurements of a pose that may err alike say together: covariance intersection with equal
    weights (Julier and Uhlmann 1997), never surer than what they deserve, whatever they have in common."""
    return fused(
        replace(first, information=0.5 * first.information), replace(second, information=0.5 * second.information)
    )

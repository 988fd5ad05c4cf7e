"""SO(3) and SE(3) inside compiled kernels.

Twists are ordered (translation ρ, rotation φ), as the covariances in :mod:`navcore.types` are. Poses are updated from
the left: ``T ← exp(ξ) T``.
"""

from __future__ import annotations

import math

import numpy as np

from navcore.compiled import kernel
from navcore.geometry import FloatArray

SMALL_ANGLE_RAD = 1e-8


@kernel
def skew(v: FloatArray) -> FloatArray:
    """Return the matrix (3, 3) of the cross product with ``v`` (3,)."""
    m = np.zeros((3, 3))
    m[0, 1] = -v[2]
    m[0, 2] = v[1]
    m[1, 0] = v[2]
    m[1, 2] = -v[0]
    m[2, 0] = -v[1]
    m[2, 1] = v[0]
    return m


@kernel
def product(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the matrix product of small C-contiguous matrices; compiles in a fraction of what a BLAS call takes."""
    out = np.zeros((a.shape[0], b.shape[1]))
    for i in range(a.shape[0]):
        for k in range(a.shape[1]):
            for j in range(b.shape[1]):
                out[i, j] += a[i, k] * b[k, j]
    return out


@kernel
def _series(phi: FloatArray, a: float, b: float) -> FloatArray:
    """Return I + a [φ] + b [φ]² (3, 3), [φ] being the matrix of the cross product: what SO(3) is written in."""
    x, y, z = phi[0], phi[1], phi[2]
    r = np.empty((3, 3))
    r[0, 0] = 1.0 - b * (y * y + z * z)
    r[0, 1] = b * x * y - a * z
    r[0, 2] = b * x * z + a * y
    r[1, 0] = b * x * y + a * z
    r[1, 1] = 1.0 - b * (x * x + z * z)
    r[1, 2] = b * y * z - a * x
    r[2, 0] = b * x * z - a * y
    r[2, 1] = b * y * z + a * x
    r[2, 2] = 1.0 - b * (x * x + y * y)
    return r


@kernel
def exp_so3(phi: FloatArray) -> FloatArray:
    """Return the rotation matrix (3, 3) of a rotation vector (3,), radians (Rodrigues)."""
    angle = math.sqrt(phi[0] * phi[0] + phi[1] * phi[1] + phi[2] * phi[2])
    if angle < SMALL_ANGLE_RAD:
        return _series(phi, 1.0, 0.5)
    return _series(phi, math.sin(angle) / angle, (1.0 - math.cos(angle)) / (angle * angle))


@kernel
def log_so3(r: FloatArray) -> FloatArray:
    """Return the rotation vector (3,), radians, of a rotation matrix (3, 3), or of the rotation of a pose (4, 4)."""
    phi = np.empty(3)
    phi[0] = 0.5 * (r[2, 1] - r[1, 2])
    phi[1] = 0.5 * (r[0, 2] - r[2, 0])
    phi[2] = 0.5 * (r[1, 0] - r[0, 1])
    sine = math.sqrt(phi[0] * phi[0] + phi[1] * phi[1] + phi[2] * phi[2])
    cosine = 0.5 * (r[0, 0] + r[1, 1] + r[2, 2] - 1.0)
    angle = math.atan2(sine, cosine)
    if sine > 1e-6:
        for i in range(3):
            phi[i] *= angle / sine
        return phi
    if cosine > 0.0:
        return phi
    # Half a turn: the axis is the largest column of (R + I) / 2.
    k = 0
    for i in range(1, 3):
        if r[i, i] > r[k, k]:
            k = i
    axis = np.empty(3)
    for i in range(3):
        axis[i] = 0.5 * r[i, k] + (0.5 if i == k else 0.0)
    norm = math.sqrt(axis[0] * axis[0] + axis[1] * axis[1] + axis[2] * axis[2])
    sign = 1.0 if phi[0] * axis[0] + phi[1] * axis[1] + phi[2] * axis[2] >= 0.0 else -1.0
    for i in range(3):
        axis[i] *= sign * angle / norm
    return axis


@kernel
def _left_jacobian_so3(phi: FloatArray) -> FloatArray:
    angle2 = phi[0] * phi[0] + phi[1] * phi[1] + phi[2] * phi[2]
    if angle2 < 1e-8:
        a, b = 0.5 - angle2 / 24.0, 1.0 / 6.0 - angle2 / 120.0
    else:
        angle = math.sqrt(angle2)
        a, b = (1.0 - math.cos(angle)) / angle2, (angle - math.sin(angle)) / (angle2 * angle)
    return _series(phi, a, b)


@kernel
def left_jacobian_inverse_so3(phi: FloatArray) -> FloatArray:
    """Return the matrix (3, 3) with log(exp(δ) exp(φ)) ≈ φ + J⁻¹ δ for a rotation vector φ (3,)."""
    angle2 = phi[0] * phi[0] + phi[1] * phi[1] + phi[2] * phi[2]
    if angle2 < 1e-8:
        b = 1.0 / 12.0 + angle2 / 720.0
    else:
        angle = math.sqrt(angle2)
        b = 1.0 / angle2 - (1.0 + math.cos(angle)) / (2.0 * angle * math.sin(angle))
    return _series(phi, -0.5, b)


@kernel
def exp_se3(xi: FloatArray) -> FloatArray:
    """Return the pose (4, 4) of a twist (6,) ordered (translation, rotation)."""
    phi = xi[3:].copy()
    rotation = exp_so3(phi)
    jacobian = _left_jacobian_so3(phi)
    pose = np.zeros((4, 4))
    pose[3, 3] = 1.0
    for i in range(3):
        for j in range(3):
            pose[i, j] = rotation[i, j]
            pose[i, 3] += jacobian[i, j] * xi[j]
    return pose


@kernel
def log_se3(pose: FloatArray) -> FloatArray:
    """Return the twist (6,) ordered (translation, rotation) of a pose (4, 4)."""
    phi = log_so3(pose)
    jacobian = left_jacobian_inverse_so3(phi)
    xi = np.zeros(6)
    for i in range(3):
        xi[3 + i] = phi[i]
        for j in range(3):
            xi[i] += jacobian[i, j] * pose[j, 3]
    return xi


@kernel
def inverse_se3(pose: FloatArray) -> FloatArray:
    """Return the inverse of a rigid pose (4, 4)."""
    out = np.zeros((4, 4))
    out[3, 3] = 1.0
    for i in range(3):
        s = 0.0
        for k in range(3):
            out[i, k] = pose[k, i]
            s += pose[k, i] * pose[k, 3]
        out[i, 3] = -s
    return out


@kernel
def adjoint_se3(pose: FloatArray) -> FloatArray:
    """Return Ad(T) (6, 6) with ``T exp(ξ) = exp(Ad(T) ξ) T`` for a pose T (4, 4)."""
    cross = skew(pose[:3, 3])
    out = np.zeros((6, 6))
    for i in range(3):
        for j in range(3):
            out[i, j] = pose[i, j]
            out[3 + i, 3 + j] = pose[i, j]
            for k in range(3):
                out[i, 3 + j] += cross[i, k] * pose[k, j]
    return out


@kernel
def update_pose(pose: FloatArray, xi: FloatArray, out: FloatArray) -> None:
    """Write ``pose`` (4, 4) moved from the left by a small twist (6,): rotation about the camera, then translation."""
    r = exp_so3(xi[3:])
    for i in range(3):
        for j in range(4):
            out[i, j] = r[i, 0] * pose[0, j] + r[i, 1] * pose[1, j] + r[i, 2] * pose[2, j]
        out[i, 3] += xi[i]
    out[3, 0] = 0.0
    out[3, 1] = 0.0
    out[3, 2] = 0.0
    out[3, 3] = 1.0


def warm_up() -> None:
    """Compile this module's kernels."""
    pose = exp_se3(np.full(6, 0.1))
    update_pose(pose, log_se3(inverse_se3(pose)), np.eye(4))
    adjoint_se3(pose)

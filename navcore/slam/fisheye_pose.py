"""What landmarks in the fisheye picture say of the pose: two residuals each, in pixels of the lens, without depth.

The residual of a landmark X seen at the pixel p is π(F T X) − p, π being the lens (Kannala and Brandt), F the mounting
``fisheye_from_camera`` and T the pose of the depth camera. Linearized at a pose, all of them together are a Gaussian,
so they join the depth camera's landmarks as a factor (:mod:`navcore.slam.pose_factor`); it is linearized anew at each
new pose, until both agree. What the depth camera alone does is left as it is.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from navcore.compiled import kernel
from navcore.geometry import FloatArray
from navcore.slam.fisheye import project_with_jacobian
from navcore.slam.keyframes import SlamCamera
from navcore.slam.lie import log_se3, update_pose
from navcore.slam.pose import refine_pose
from navcore.slam.pose_factor import PoseFactor, add_factor, fused
from navcore.slam.pose_kernels import CHI2_MONO

BoolArray = NDArray[np.bool_]

ROUNDS = 6
"""Linearizations, at most."""
ROBUST_ROUNDS = 2
"""In the first of them outliers weigh little (Huber); in the others they are left out (χ² 5.991)."""
_DONE = 1e-5
"""Movement (m, rad) below which a further round changes nothing."""


@dataclass(frozen=True, slots=True, eq=False)
class FisheyeObservations:
    """Landmarks seen by the fisheye camera."""

    points: FloatArray
    """(n, 3): in the world, metres."""
    lens_px: FloatArray
    """(n, 2): where they are seen in the fisheye picture."""
    inv_sigma2: FloatArray
    """(n,): 1/px²."""
    numbers: FloatArray
    """(9,): the lens, see :func:`navcore.slam.fisheye.lens_numbers`."""
    fisheye_from_camera: FloatArray
    """(4, 4)."""

    def __len__(self) -> int:
        return len(self.points)


@dataclass(frozen=True, slots=True, eq=False)
class JointPose:
    """A pose that both cameras agree on."""

    camera_from_world: FloatArray
    """(4, 4)."""
    inlier: BoolArray
    """(n,): which observations of the depth camera agree."""
    fisheye_inlier: BoolArray
    """(m,): which of the fisheye camera do."""
    information: FloatArray
    """(6, 6): as :func:`navcore.slam.pose.refine_pose` gives it, of both cameras."""


def fisheye_factor(
    camera_from_world: FloatArray, seen: FisheyeObservations, is_robust: bool
) -> tuple[PoseFactor, BoolArray]:
    """Return what the observations say of the pose, linearized at one, and which of them agree with it (m,).

    With ``is_robust`` those that do not agree weigh less and less; without, nothing.
    """
    h, g, inlier = linearize(
        np.ascontiguousarray(camera_from_world, dtype=np.float64),
        np.ascontiguousarray(seen.points, dtype=np.float64),
        np.ascontiguousarray(seen.lens_px, dtype=np.float64),
        np.ascontiguousarray(seen.inv_sigma2, dtype=np.float64),
        seen.numbers,
        np.ascontiguousarray(seen.fisheye_from_camera, dtype=np.float64),
        is_robust,
    )
    # A direction that nothing constrains keeps the pose where it is.
    step = np.asarray(np.linalg.solve(h + np.diag(1e-6 * np.diag(h) + 1e-9), -g), dtype=np.float64)
    mean = np.eye(4)
    update_pose(camera_from_world, step, mean)
    return PoseFactor(mean, h), inlier


def refine_with_fisheye(
    guess: FloatArray,
    points: FloatArray,
    observations: FloatArray,
    inv_sigma2: FloatArray,
    camera: SlamCamera,
    seen: FisheyeObservations,
    known: PoseFactor | None = None,
    slides: FloatArray | None = None,
) -> JointPose:
    """Refine the depth camera's pose on what both cameras see.

    ``points`` (n, 3), ``observations`` (n, 3), ``inv_sigma2`` (n,) and ``slides`` (n, 3) are the depth camera's, as
    :func:`navcore.slam.pose.refine_pose` takes them; n may be 0. ``known`` is what is known of the pose from elsewhere:
    it steadies the pose, but the information stays that of the landmarks, from which it may have come, frames ago.
    """
    pose = np.array(guess, dtype=np.float64, order="C")
    for number in range(ROUNDS):
        is_robust = number < ROBUST_ROUNDS
        factor, fisheye_inlier = fisheye_factor(pose, seen, is_robust)
        if known is not None:
            factor = fused(factor, known)
        refined, inlier, information = refine_pose(
            pose,
            points,
            observations,
            inv_sigma2,
            camera.fx_px,
            camera.fy_px,
            camera.cx_px,
            camera.cy_px,
            camera.bf_px_m,
            factor,
            slides,
        )
        moved = float(np.abs(log_se3(np.ascontiguousarray(refined @ np.linalg.inv(pose)))).max())
        pose = refined
        if not is_robust and moved < _DONE:
            break
    if known is not None:
        theirs = np.zeros((6, 6))
        add_factor(pose, factor.camera_from_world, known.information, theirs, np.zeros(6))
        information = information - theirs
    return JointPose(pose, inlier, fisheye_inlier, information)


def warm_up() -> None:
    """Compile this module's kernels."""
    numbers = np.array([100.0, 100.0, 80.0, 60.0, 0.01, 0.0, 0.0, 0.0, 1.5])
    points = np.array([[0.1, 0.2, 1.0], [1.0, 0.0, 0.5], [-1.0, 0.3, 0.4]])
    seen = FisheyeObservations(points, np.full((3, 2), 70.0), np.ones(3), numbers, np.eye(4))
    nothing = np.zeros((0, 3))
    refine_with_fisheye(
        np.eye(4), nothing, nothing, np.zeros(0), SlamCamera(160, 120, 100.0, 100.0, 80.0, 60.0, 10.0), seen
    )


# --------------------------------------------------------------------------------------------------- kernels
@kernel
def linearize(
    pose: FloatArray,
    points: FloatArray,
    lens_px: FloatArray,
    inv_sigma2: FloatArray,
    numbers: FloatArray,
    fisheye_from_camera: FloatArray,
    robust: bool,
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Return h (6, 6) = Σ JᵀWJ, g (6,) = Σ JᵀWe of an update of the pose, and which observations agree (m,)."""
    h = np.zeros((6, 6))
    g = np.zeros(6)
    inlier = np.zeros(len(points), np.bool_)
    e = np.empty(2)
    j = np.empty((2, 6))
    for i in range(len(points)):
        if not residual(pose, points, lens_px, numbers, fisheye_from_camera, i, e, j):
            continue
        w = inv_sigma2[i]
        chi2 = w * (e[0] * e[0] + e[1] * e[1])
        inlier[i] = chi2 <= CHI2_MONO
        if not inlier[i]:
            if not robust:
                continue
            w *= math.sqrt(CHI2_MONO / chi2)
        for r in range(2):
            for k in range(6):
                g[k] += w * j[r, k] * e[r]
                for m in range(6):
                    h[k, m] += w * j[r, k] * j[r, m]
    return h, g, inlier


@kernel
def residual(
    pose: FloatArray,
    points: FloatArray,
    lens_px: FloatArray,
    numbers: FloatArray,
    fisheye_from_camera: FloatArray,
    i: int,
    e: FloatArray,
    j: FloatArray,
) -> bool:
    """Fill error e (2,) and Jacobian j (2, 6) of observation i; False where the lens does not show the point."""
    in_camera = np.empty(3)
    for r in range(3):
        in_camera[r] = pose[r, 3]
        for c in range(3):
            in_camera[r] += pose[r, c] * points[i, c]
    f = fisheye_from_camera
    x = f[0, 0] * in_camera[0] + f[0, 1] * in_camera[1] + f[0, 2] * in_camera[2] + f[0, 3]
    y = f[1, 0] * in_camera[0] + f[1, 1] * in_camera[1] + f[1, 2] * in_camera[2] + f[1, 3]
    z = f[2, 0] * in_camera[0] + f[2, 1] * in_camera[1] + f[2, 2] * in_camera[2] + f[2, 3]
    lens = np.empty((2, 3))
    u, v = project_with_jacobian(numbers, x, y, z, lens)
    if math.isnan(u):
        return False
    e[0] = u - lens_px[i, 0]
    e[1] = v - lens_px[i, 1]
    for r in range(2):
        # d(u, v) / d(point in the depth camera); that point moves by ρ + φ × point.
        a = lens[r, 0] * f[0, 0] + lens[r, 1] * f[1, 0] + lens[r, 2] * f[2, 0]
        b = lens[r, 0] * f[0, 1] + lens[r, 1] * f[1, 1] + lens[r, 2] * f[2, 1]
        c2 = lens[r, 0] * f[0, 2] + lens[r, 1] * f[1, 2] + lens[r, 2] * f[2, 2]
        j[r, 0], j[r, 1], j[r, 2] = a, b, c2
        j[r, 3] = c2 * in_camera[1] - b * in_camera[2]
        j[r, 4] = a * in_camera[2] - c2 * in_camera[0]
        j[r, 5] = b * in_camera[0] - a * in_camera[1]
    return True

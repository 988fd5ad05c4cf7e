"""Pose of one camera from known landmarks: robust refinement, and RANSAC where there is no first guess.

Observations are rows (u, v, u_right) in pixels, u_right = u − bf / z being the column where a second camera at the
baseline would see the landmark; it is NaN where depth was not measured (ORB-SLAM2, section III-A).
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from navcore.geometry import FloatArray
from navcore.slam.pose_factor import PoseFactor
from navcore.slam.pose_kernels import MIN_DEPTH_M, MIN_OBSERVATIONS, refine
from navcore.slam.triple_kernels import best_of_triples

BoolArray = NDArray[np.bool_]


def refine_pose(
    camera_from_world: FloatArray,
    points_world: FloatArray,
    observations: FloatArray,
    inv_sigma2: FloatArray,
    fx_px: float,
    fy_px: float,
    cx_px: float,
    cy_px: float,
    bf: float,
    factor: PoseFactor | None = None,
    slides: FloatArray | None = None,
) -> tuple[FloatArray, BoolArray, FloatArray]:
    """Refine a camera's pose on landmarks that stay where they are (ORB-SLAM2, motion-only bundle adjustment).

    Takes the first guess (4, 4), landmarks (n, 3) in metres, observations (n, 3) in pixels, the inverse variance of
    each (n,) in 1/px², and the camera (``bf``: baseline × fx, px·m). Four rounds of a Huber-robust optimization, each
    followed by a new decision which observations are inliers (χ² 5.991, with depth 7.815). A ``factor``, what is known
    of the pose from elsewhere, weighs in by its information; observations may then be few, or none.

    Returns the pose (4, 4), the inliers (n,), and the information (6, 6), the inverse covariance of a left-multiplied
    twist (translation, rotation) in the camera's frame, the factor's included; with fewer than three observations and
    no factor the guess comes back, without inliers and with zero information.
    """
    pose = np.array(camera_from_world, dtype=np.float64, order="C")
    count = points_world.shape[0]
    if count < MIN_OBSERVATIONS and factor is None:
        return pose, np.zeros(count, dtype=np.bool_), np.zeros((6, 6))
    known = factor or PoseFactor.nothing()
    return refine(
        pose,
        np.ascontiguousarray(points_world, dtype=np.float64),
        np.ascontiguousarray(observations, dtype=np.float64),
        np.zeros((count, 3)) if slides is None else np.ascontiguousarray(slides),
        np.ascontiguousarray(inv_sigma2, dtype=np.float64),
        (float(fx_px), float(fy_px), float(cx_px), float(cy_px), float(bf)),
        np.ascontiguousarray(known.camera_from_world, dtype=np.float64),
        np.ascontiguousarray(known.information, dtype=np.float64),
    )


def covariance_in_world(camera_from_world: FloatArray, information: FloatArray) -> FloatArray:
    """Return the covariance (6, 6) of (camera position, rotation) in the world frame, m² and rad².

    ``information`` is what :func:`refine_pose` gives. A direction that nothing constrains gets a large variance
    (10⁶), never a small one.
    """
    values, vectors = np.linalg.eigh(0.5 * (information + information.T))
    covariance = (vectors / np.maximum(values, 1e-6)) @ vectors.T
    rotation = camera_from_world[:3, :3]
    # R ← exp(φ) R and t ← exp(φ) t + ρ move the centre −Rᵀt by −Rᵀρ, and turn the camera by −Rᵀφ in the world.
    jacobian = np.zeros((6, 6))
    jacobian[:3, :3] = -rotation.T
    jacobian[3:, 3:] = -rotation.T
    return np.asarray(jacobian @ covariance @ jacobian.T)


def position_sigma_m(information: FloatArray) -> float:
    """Return the standard deviation of the position along the direction that is fixed worst.

    ``information`` (6, 6) is what :func:`refine_pose` gives; 1000 m where a direction is open.
    """
    return float(np.sqrt(np.linalg.eigvalsh(covariance_in_world(np.eye(4), information)[:3, :3])[-1]))


def pnp_ransac(
    points_world: FloatArray,
    uv_px: FloatArray,
    fx_px: float,
    fy_px: float,
    cx_px: float,
    cy_px: float,
    seed: int = 0,
    threshold_px: float = 4.0,
    iterations: int = 200,
    min_inliers: int = 8,
) -> tuple[FloatArray, BoolArray] | None:
    """Find a camera's pose from landmarks (n, 3) and where they are seen (n, 2), many of them possibly wrong.

    Returns (``camera_from_world`` (4, 4), inliers (n,)), or None where fewer than ``min_inliers`` agree. The same
    input and seed give the same result.
    """
    count = points_world.shape[0]
    if count < max(4, min_inliers):
        return None
    camera = np.array([[fx_px, 0.0, cx_px], [0.0, fy_px, cy_px], [0.0, 0.0, 1.0]])
    points = np.ascontiguousarray(points_world, dtype=np.float64).reshape(-1, 1, 3)
    pixels = np.ascontiguousarray(uv_px, dtype=np.float64).reshape(-1, 1, 2)
    cv2.setRNGSeed(seed)
    try:
        found, rotvec, translation, inlier_index = cv2.solvePnPRansac(
            points,
            pixels,
            camera,
            np.zeros(0),
            iterationsCount=iterations,
            reprojectionError=threshold_px,
            confidence=0.999,
            flags=cv2.SOLVEPNP_SQPNP,
        )
    except cv2.error:
        return None
    if not found or inlier_index is None or len(inlier_index) < min_inliers:
        return None
    index = inlier_index[:, 0]
    rotvec, translation = cv2.solvePnPRefineLM(points[index], pixels[index], camera, np.zeros(0), rotvec, translation)
    pose = np.eye(4)
    pose[:3, :3] = cv2.Rodrigues(rotvec)[0]
    pose[:3, 3] = translation[:, 0]
    if not np.all(np.isfinite(pose)):
        return None
    inliers = _reprojection_inliers(pose, points[:, 0], pixels[:, 0], camera, threshold_px)
    if int(np.count_nonzero(inliers)) < min_inliers:
        return None
    return pose, inliers


def _reprojection_inliers(
    pose: FloatArray, points: FloatArray, pixels: FloatArray, camera: FloatArray, threshold_px: float
) -> BoolArray:
    in_camera = points @ pose[:3, :3].T + pose[:3, 3]
    depth = np.maximum(in_camera[:, 2], MIN_DEPTH_M)
    projected = in_camera @ camera.T
    error = projected[:, :2] / depth[:, None] - pixels
    return np.asarray((np.sum(error**2, axis=1) <= threshold_px**2) & (in_camera[:, 2] > MIN_DEPTH_M))


def align(points_a: FloatArray, points_b: FloatArray) -> FloatArray:
    """Return ``a_from_b`` (4, 4), the rigid transform that best takes points b (n, 3) onto points a (n, 3) (Horn)."""
    centre_a, centre_b = points_a.mean(axis=0), points_b.mean(axis=0)
    u, _, vt = np.linalg.svd((points_b - centre_b).T @ (points_a - centre_a))
    sign = np.sign(np.linalg.det(vt.T @ u.T))
    rotation = vt.T @ np.diag([1.0, 1.0, sign if sign != 0 else 1.0]) @ u.T
    result = np.eye(4)
    result[:3, :3] = rotation
    result[:3, 3] = centre_a - rotation @ centre_b
    return result


def align_ransac(
    points_a: FloatArray,
    points_b: FloatArray,
    threshold_m: float | FloatArray = 0.1,
    seed: int = 0,
    iterations: int = 200,
    min_inliers: int = 12,
) -> tuple[FloatArray, BoolArray] | None:
    """Find the rigid transform between matched points (n, 3) and (n, 3), many of them possibly wrong.

    ``threshold_m`` is the distance up to which a pair agrees, one number or one per pair (depth gets worse with
    distance). Returns (``a_from_b`` (4, 4), inliers (n,)), or None where fewer than ``min_inliers`` agree.
    """
    count = points_a.shape[0]
    if count < max(3, min_inliers):
        return None
    a = np.ascontiguousarray(points_a, dtype=np.float64)
    b = np.ascontiguousarray(points_b, dtype=np.float64)
    limit2 = np.square(np.broadcast_to(np.asarray(threshold_m, dtype=np.float64), (count,)))
    triples = np.random.default_rng(seed).integers(0, count, (iterations, 3))
    inliers = best_of_triples(a, b, np.ascontiguousarray(limit2), triples)
    for _ in range(3):
        if int(np.count_nonzero(inliers)) < min_inliers:
            return None
        transform = align(a[inliers], b[inliers])
        inliers = np.sum((b @ transform[:3, :3].T + transform[:3, 3] - a) ** 2, axis=1) <= limit2
    if int(np.count_nonzero(inliers)) < min_inliers:
        return None
    return transform, inliers


def warm_up() -> None:
    """Compile this module's kernels."""
    points = np.array([[0.0, 0.0, 2.0], [1.0, 0.0, 3.0], [0.0, 1.0, 2.5], [1.0, 1.0, 4.0]])
    uv = points[:, :2] / points[:, 2:] * 100.0 + 50.0
    observations = np.column_stack([uv, uv[:, 0] - 8.0 / points[:, 2]])
    refine_pose(np.eye(4), points, observations, np.ones(4), 100.0, 100.0, 50.0, 50.0, 8.0)
    align_ransac(points, points, min_inliers=3, iterations=4)

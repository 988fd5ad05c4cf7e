"""How far a pose can be wrong: the covariance of a match with the map, and how it grows while odometry carries on.

The curvature of the pose's least squares assumes that pixels err independently by one pixel of their pyramid level.
They do not: a rolling shutter, a lens that is not quite as calibrated, or a bent piece of the map shift neighbouring
pixels together. How much more than assumed the pose therefore varies is measured on the frame itself: residuals are
summed over blocks of the image, and the spread of the blocks' sums is compared with what the curvature promises (the
cluster-robust covariance of Liang and Zeger 1986). Errors that all landmarks in view share cannot show in one frame;
the map's own covariance at this place is added for them.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from navcore.compiled import kernel
from navcore.geometry import FloatArray
from navcore.slam.keyframes import SlamCamera
from navcore.slam.lie import log_so3
from navcore.slam.pose import covariance_in_world
from navcore.slam.pose_factor import PoseFactor
from navcore.slam.pose_kernels import MIN_DEPTH_M
from navcore.slam.tracking import MapView, Track

BLOCK_COLUMNS = 4
BLOCK_ROWS = 3
"""Blocks of the image whose pixels may err together."""
MIN_BLOCKS = 4
"""Fewer blocks with landmarks say nothing of their spread."""
UNKNOWN_MISFIT = 3.0
"""Variance factor where the blocks are too few."""
LEAST_MISFIT = 1.0
"""The variance is never taken for less than that of independent pixels."""
ALIKE_LANDMARKS = 2.5
"""Landmarks beside each other err alike, which few blocks of the image show: so many count as one."""
SYSTEMATIC_SIGMA_M = 0.003
SYSTEMATIC_SIGMA_RAD = 0.001
"""Standard deviation, per axis, of what no residual shows: calibration and shutter err alike in map and frame.

This, ALIKE_LANDMARKS and :data:`navcore.slam.map_uncertainty.MAP_VARIANCE` are measured together, on simulated walks
whose truth is known (``python -m benchmarks.trust``): the 95 % ellipsoids shall hold it as often where many landmarks
are seen as where few are."""
DRIFT_SHARE = 0.025
"""Standard deviation of odometry, per metre moved and per radian turned from one frame to the next."""
DRIFT_SIGMA_M = 0.0033
DRIFT_SIGMA_RAD = 0.0016
"""Standard deviation of odometry, per frame."""
MAX_SPEED_M_S = 2.0
STEP_M = 0.1
"""Nobody moves faster, the first 10 cm aside; what odometry says beyond that is a mistake."""
UNSEEN_SIGMA_M_S = 0.7
UNSEEN_SIGMA_RAD_S = 0.5
"""Standard deviation, per axis and second, of what somebody does while no frame comes: about a walker's speed."""
DRIFTED_M = 1.0
"""So far can a frame have drifted before it is found again."""
AMBIGUITY_SIGMA_M = 0.3
AMBIGUITY_SIGMA_RAD = 0.1
"""Standard deviation of a pose that further frames have not confirmed: it may be off by a period of a wall."""


def misfit(view: MapView, track: Track) -> float:
    """Return by how much the variance of a pose exceeds that of independent pixels of nominal noise; about 1 is fine.

    At least ``LEAST_MISFIT``; ``UNKNOWN_MISFIT`` where the landmarks lie in too few blocks of the image.
    """
    seen = np.flatnonzero(track.landmark_of >= 0)
    return _misfit(view.camera, track, seen, view.positions[track.landmark_of[seen]])


def weighed_by_misfit(camera: SlamCamera, track: Track) -> Track:
    """Return a frame that odometry followed, its information divided by the misfit of the points that it followed."""
    if track.carried_points is None:
        return track
    seen = np.flatnonzero(np.isfinite(track.carried_points[:, 2]))
    points = np.ascontiguousarray(track.carried_points[seen])
    return replace(track, information=track.information / _misfit(camera, track, seen, points))


def _misfit(camera: SlamCamera, track: Track, seen: NDArray[np.int64], points: FloatArray) -> float:
    """Return the misfit of the features ``seen`` (m,), which show points (m, 3)."""
    features = track.features
    gradients, counts = _block_gradients(
        np.ascontiguousarray(track.camera_from_world),
        points,
        features.uvr_px[seen],
        features.inv_sigma2[seen],
        camera.fx_px,
        camera.fy_px,
        camera.cx_px,
        camera.cy_px,
        camera.bf_px_m,
        float(camera.width_px),
        float(camera.height_px),
    )
    blocks = int(np.count_nonzero(counts))
    if blocks < MIN_BLOCKS:
        return UNKNOWN_MISFIT
    spread = gradients.T @ gradients * (blocks / (blocks - 1))
    try:
        factor = float(np.trace(np.linalg.solve(track.information, spread))) / 6
    except np.linalg.LinAlgError:
        return UNKNOWN_MISFIT
    return max(LEAST_MISFIT, factor) if math.isfinite(factor) else UNKNOWN_MISFIT


def map_covariance(
    track: Track, keyframe_covariance: FloatArray, variance_factor: float
) -> tuple[FloatArray, FloatArray]:
    """Return the covariance (6, 6) of (position, rotation) in the world of a pose that matched the map.

    The second is the part of it that all landmarks in view share: the covariance of the key frames around
    (:mod:`navcore.slam.map_uncertainty`), and systematic errors. The same factor applies to all, for the map was made
    of pixels of the same kind.
    """
    shared = variance_factor * (keyframe_covariance + _diagonal(SYSTEMATIC_SIGMA_M**2, SYSTEMATIC_SIGMA_RAD**2))
    return shared + covariance_of(map_factor(track, variance_factor)), shared


def map_factor(track: Track, variance_factor: float) -> PoseFactor:
    """Return what the landmarks that a frame shows say of its pose, relative to the map around."""
    return PoseFactor(track.camera_from_world, track.information / (ALIKE_LANDMARKS * variance_factor))


def covariance_of(factor: PoseFactor) -> FloatArray:
    """Return the covariance (6, 6) of (position, rotation) in the world of what is known of a pose."""
    return covariance_in_world(factor.camera_from_world, factor.information)


def drifted(covariance: FloatArray, before: Track, after: Track) -> FloatArray:
    """Return the covariance (6, 6) after a movement that only odometry saw.

    What the points that it followed leave open is added, where any were followed: in the dark, they are few and noisy.
    """
    moved_m = float(np.linalg.norm(centre_of(after) - centre_of(before)))
    step = after.camera_from_world[:3, :3] @ before.camera_from_world[:3, :3].T
    turned_rad = float(np.linalg.norm(log_so3(np.ascontiguousarray(step))))
    rotation_variance = float(np.trace(covariance[3:, 3:])) / 3
    growth_m2 = (DRIFT_SHARE * moved_m) ** 2 + DRIFT_SIGMA_M**2 + rotation_variance * moved_m**2
    growth_rad2 = (DRIFT_SHARE * turned_rad) ** 2 + DRIFT_SIGMA_RAD**2
    grown = covariance + _diagonal(growth_m2, growth_rad2)
    return grown + covariance_in_world(after.camera_from_world, after.information) if after.information.any() else grown


def walked_unseen(covariance: FloatArray, gap_s: float) -> FloatArray:
    """Return the covariance (6, 6) after ``gap_s`` without any frame: the walker may have gone on, or turned round."""
    return covariance + _diagonal((UNSEEN_SIGMA_M_S * gap_s) ** 2, (UNSEEN_SIGMA_RAD_S * gap_s) ** 2)


def is_walkable(before: Track, after: Track) -> bool:
    """Tell whether somebody can have moved so far between two frames."""
    moved_m = float(np.linalg.norm(centre_of(after) - centre_of(before)))
    return moved_m <= STEP_M + MAX_SPEED_M_S * abs(after.stamp_s - before.stamp_s)


def is_reachable(before: Track, after: Track) -> bool:
    """Tell whether somebody can have come from one frame to another, the one before having drifted."""
    moved_m = float(np.linalg.norm(centre_of(after) - centre_of(before)))
    return moved_m <= DRIFTED_M + MAX_SPEED_M_S * abs(after.stamp_s - before.stamp_s)


def odometry_factor(relative_covariance: FloatArray, before: Track, after: Track) -> PoseFactor:
    """Return what odometry says of a pose relative to the map, given the covariance (6, 6) of the frame before.

    That covariance is without what all landmarks share: those that are matched next share it, too.
    """
    relative = drifted(relative_covariance, before, after)
    world_from_twist = np.zeros((6, 6))
    world_from_twist[:3, :3] = world_from_twist[3:, 3:] = -after.camera_from_world[:3, :3].T
    return PoseFactor(after.camera_from_world, world_from_twist.T @ np.linalg.inv(relative) @ world_from_twist)


def with_ambiguity(covariance: FloatArray) -> FloatArray:
    """Return the covariance (6, 6) of a pose that further frames have not confirmed."""
    return covariance + _diagonal(AMBIGUITY_SIGMA_M**2, AMBIGUITY_SIGMA_RAD**2)


def centre_of(track: Track) -> FloatArray:
    """Return where the camera is (3,), metres in the world."""
    return np.asarray(-track.camera_from_world[:3, :3].T @ track.camera_from_world[:3, 3])


def _diagonal(position_m2: float, rotation_rad2: float) -> FloatArray:
    return np.diag([position_m2] * 3 + [rotation_rad2] * 3)


# --------------------------------------------------------------------------------------------------- kernels
@kernel
def _block_gradients(
    pose: FloatArray,
    points: FloatArray,
    uvr: FloatArray,
    inv_sigma2: FloatArray,
    fx: float,
    fy: float,
    cx: float,
    cy: float,
    bf: float,
    width: float,
    height: float,
) -> tuple[FloatArray, FloatArray]:
    """Return Σ JᵀWe (blocks, 6) over the observations in each block of the image, and how many (blocks,) these are."""
    gradients = np.zeros((BLOCK_COLUMNS * BLOCK_ROWS, 6))
    counts = np.zeros(BLOCK_COLUMNS * BLOCK_ROWS)
    for i in range(len(points)):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        px = pose[0, 0] * x + pose[0, 1] * y + pose[0, 2] * z + pose[0, 3]
        py = pose[1, 0] * x + pose[1, 1] * y + pose[1, 2] * z + pose[1, 3]
        pz = pose[2, 0] * x + pose[2, 1] * y + pose[2, 2] * z + pose[2, 3]
        if pz < MIN_DEPTH_M:
            continue
        w = inv_sigma2[i]
        u = fx * px / pz + cx
        # The force that the observation exerts on the point in the camera's frame …
        pull_u = w * (u - uvr[i, 0])
        pull_v = w * (fy * py / pz + cy - uvr[i, 1])
        pull_r = 0.0 if math.isnan(uvr[i, 2]) else w * (u - bf / pz - uvr[i, 2])
        force_x = fx / pz * (pull_u + pull_r)
        force_y = fy / pz * pull_v
        force_z = (-fx * px * (pull_u + pull_r) - fy * py * pull_v + bf * pull_r) / (pz * pz)
        column = min(max(int(uvr[i, 0] * BLOCK_COLUMNS / width), 0), BLOCK_COLUMNS - 1)
        row = min(max(int(uvr[i, 1] * BLOCK_ROWS / height), 0), BLOCK_ROWS - 1)
        block = row * BLOCK_COLUMNS + column
        counts[block] += 1.0
        # … moves the pose by itself, and turns it by its moment.
        gradients[block, 0] += force_x
        gradients[block, 1] += force_y
        gradients[block, 2] += force_z
        gradients[block, 3] += py * force_z - pz * force_y
        gradients[block, 4] += pz * force_x - px * force_z
        gradients[block, 5] += px * force_y - py * force_x
    return gradients, counts

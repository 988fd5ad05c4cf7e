"""How far the map itself can be wrong, place by place: the covariance of its key frames.

Landmarks are eliminated from the normal equations of the whole map, as in bundle adjustment; the inverse of what
remains is the covariance of the key frames. Where the map as a whole lies is nobody's error: of all rigid motions, the
one that takes it nearest to the truth is removed. Stretches that hang on few others, or were walked once, come out with
large variances, and those that loops tie together with small ones.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.sparse
import scipy.sparse.linalg
from numpy.typing import NDArray

from navcore.geometry import FloatArray
from navcore.slam.bundle_kernels import classify, damp_points, eliminate, linearize, pair_blocks
from navcore.slam.keyframes import INV_SIGMA2, IntArray
from navcore.slam.nearest import nearest_index
from navcore.slam.slam_map import SlamMap

SAMPLED_KEYFRAMES = 60
"""Key frames whose covariance is computed, evenly over the map, besides those on both sides of a leap; the others take
that of the nearest on their side."""
GAUGE_LEVER_M = 1.0
"""When the map is laid onto the truth, a radian of a key frame counts as much as this distance."""
TIE_SIGMA_M = 0.08
TIE_SIGMA_RAD = 0.023
"""Standard deviation between key frames that follow each other in a recording, were there no landmark: they have been
followed from one to the next all the same."""
MAP_VARIANCE = 0.5
"""By so much the adjustment of a map by its landmarks is better than pixels of nominal noise would have it; measured,
see :data:`navcore.slam.pose_uncertainty.SYSTEMATIC_SIGMA_M`."""
LEAST_VARIANCE = 1e-9
"""Of a key frame along any axis (m², rad²): no map is surer than a thirtieth of a millimetre."""
_EDGE_SHARE = 0.01
"""What an observation of an edge counts."""
_PRIOR = 1.0
"""Information (1/m², 1/rad²) on each key frame, so that the system can be inverted: next to nothing."""

BoolArray = NDArray[np.bool_]


def with_covariances(slam_map: SlamMap, is_edge: BoolArray | None = None) -> SlamMap:
    """Return the map with the covariances of its key frames; see :func:`keyframe_covariances`."""
    return replace(slam_map, keyframe_covariance=keyframe_covariances(slam_map, is_edge))


def keyframe_covariances(slam_map: SlamMap, is_edge: BoolArray | None = None) -> FloatArray:
    """Return the covariance (K, 6, 6) of (camera position, rotation) of each key frame, in the world.

    Observations count with the nominal noise of their pyramid level; those of features (F,) that are edges
    (:mod:`navcore.slam.apertures`) next to nothing, for they agree wherever along the edge the camera is.
    """
    blocks, row, col = _reduced_system(slam_map, is_edge)
    turned = _world_from_twist(slam_map)
    information = _assembled(turned[row] @ blocks @ turned[col].transpose(0, 2, 1), row, col, slam_map.keyframe_count)
    prior = _PRIOR * scipy.sparse.identity(information.shape[0], format="csc")
    information = scipy.sparse.csc_matrix(information + MAP_VARIANCE * _ties(slam_map) + prior)
    factor = scipy.sparse.linalg.splu(
        information, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
    )
    sampled, stands_for = _sampled(slam_map)
    covariances = _gauge_free(factor, _rigid_motions(slam_map), sampled)
    return np.ascontiguousarray(positive(MAP_VARIANCE * covariances)[stands_for])


def positive(covariances: FloatArray) -> FloatArray:
    """Return covariances (n, 6, 6) without axes that rounding has made negative: the common motion, a million times as
    large, was subtracted from them."""
    values, vectors = np.linalg.eigh(covariances)
    held = (vectors * np.maximum(values, LEAST_VARIANCE)[:, None, :]) @ vectors.transpose(0, 2, 1)
    return np.asarray(0.5 * (held + held.transpose(0, 2, 1)))


def _sampled(slam_map: SlamMap) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the key frames (n,) whose covariance is computed, and which of them stands for each key frame (K,).

    Where a recording ends, and where nothing seen led on, the covariance leaps: both sides are computed, and none
    stands for a key frame on the other side.
    """
    count = slam_map.keyframe_count
    leaps: BoolArray = np.any(slam_map.keyframe_drift != 0.0, axis=(1, 2))
    leaps[1:] |= np.diff(slam_map.keyframe_session) != 0
    leaps[0] = True
    begins = np.flatnonzero(leaps)
    evenly = np.linspace(0, count - 1, SAMPLED_KEYFRAMES).round().astype(np.int64)
    sampled = np.unique(np.concatenate([evenly, begins, begins[1:] - 1, [count - 1]]))
    # Whatever lies beyond a leap is farther away than anything on this side.
    places = np.arange(count) + 2.0 * count * np.cumsum(leaps)
    return sampled, nearest_index(places[sampled], places)


def _reduced_system(slam_map: SlamMap, is_edge: BoolArray | None) -> tuple[FloatArray, IntArray, IntArray]:
    """Return the upper blocks (B, 6, 6) of the key frames' information at (row, col), by twists in the camera."""
    seen = np.flatnonzero(slam_map.feature_landmark >= 0)
    keyframe = np.repeat(np.arange(slam_map.keyframe_count, dtype=np.int32), np.diff(slam_map.feature_start))[seen]
    point = slam_map.feature_landmark[seen]
    order = np.lexsort((keyframe, point))
    seen, keyframe, point = seen[order], keyframe[order], point[order]
    uvr = slam_map.feature_uvr_px[seen].astype(np.float64)
    inv_sigma2 = INV_SIGMA2[slam_map.feature_octave[seen]]
    if is_edge is not None:
        inv_sigma2 = np.where(is_edge[seen], _EDGE_SHARE * inv_sigma2, inv_sigma2)
    camera = slam_map.camera
    lens = np.array([camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px, camera.bf_px_m])
    poses, points = slam_map.camera_from_world, slam_map.positions
    count, point_count = len(poses), len(points)
    used = np.ones(len(seen), np.bool_)
    classify(lens, poses, points, keyframe, point, uvr, inv_sigma2, used)
    free = np.arange(count, dtype=np.int32)
    start = np.searchsorted(point, np.arange(point_count + 1)).astype(np.int64)
    hcc, gc = np.zeros((count, 6, 6)), np.zeros((count, 6))
    hpp, gp = np.zeros((point_count, 3, 3)), np.zeros((point_count, 3))
    hcp = np.zeros((len(seen), 6, 3))
    linearize(
        lens, keyframe, point, uvr, inv_sigma2, free, poses, points, used, False, hcc, gc, hpp, gp, hcp
    )  # fmt: skip
    block_of, row, col = pair_blocks(keyframe, free, start, count)
    blocks, _ = eliminate(
        keyframe, free, start, used, hcc, gc, gp, hcp, damp_points(hpp, 0.0), 0.0, block_of, len(row)
    )  # fmt: skip
    return blocks, row, col


def _world_from_twist(slam_map: SlamMap) -> FloatArray:
    """Return (K, 6, 6): what a twist in each camera's frame does to its position and rotation in the world."""
    back = -slam_map.camera_from_world[:, :3, :3].transpose(0, 2, 1)
    turned = np.zeros((len(back), 6, 6))
    turned[:, :3, :3] = turned[:, 3:, 3:] = back
    return turned


def _assembled(blocks: FloatArray, row: IntArray, col: IntArray, count: int) -> scipy.sparse.csc_matrix:
    off = row != col
    rows, cols = np.concatenate([row, col[off]]), np.concatenate([col, row[off]])
    data = np.concatenate([blocks, blocks[off].transpose(0, 2, 1)])
    within_row, within_col = np.mgrid[0:6, 0:6]
    places = ((rows[:, None, None] * 6 + within_row).ravel(), (cols[:, None, None] * 6 + within_col).ravel())
    return scipy.sparse.csc_matrix((data.ravel(), places), shape=(6 * count, 6 * count))


def _ties(slam_map: SlamMap) -> scipy.sparse.csc_matrix:
    """Return the information that ties each key frame to the one before it in the same recording: less along what
    nothing seen led along between them."""
    after = np.flatnonzero(np.diff(slam_map.keyframe_session) == 0).astype(np.int32) + np.int32(1)
    before = after - np.int32(1)
    centres = _centres(slam_map)
    carried = _carried(centres[after] - centres[before])
    turned = _world_from_twist(slam_map)[after]
    drift = turned @ slam_map.keyframe_drift[after] @ turned.transpose(0, 2, 1)
    weight = np.linalg.inv(drift + np.diag([TIE_SIGMA_M**2] * 3 + [TIE_SIGMA_RAD**2] * 3))
    back = carried.transpose(0, 2, 1) @ weight
    blocks = np.concatenate([back @ carried, weight, -back])
    row, col = np.concatenate([before, after, before]), np.concatenate([before, after, after])
    return _assembled(blocks, row, col, slam_map.keyframe_count)


def _centres(slam_map: SlamMap) -> FloatArray:
    return np.asarray(
        -np.einsum("kji,kj->ki", slam_map.camera_from_world[:, :3, :3], slam_map.camera_from_world[:, :3, 3])
    )


def _rigid_motions(slam_map: SlamMap) -> FloatArray:
    """Return (K, 6, 6): how each key frame moves when the whole map is shifted, and turned about its middle."""
    centres = _centres(slam_map)
    return _carried(centres - centres.mean(axis=0))


def _carried(arms_m: FloatArray) -> FloatArray:
    """Return (n, 6, 6): how what is fixed to something at the end of an arm (n, 3) moves when that thing moves."""
    x, y, z = arms_m.T
    motions = np.zeros((len(arms_m), 6, 6))
    motions[:] = np.eye(6)
    motions[:, 0, 4], motions[:, 0, 5] = z, -y
    motions[:, 1, 3], motions[:, 1, 5] = -z, x
    motions[:, 2, 3], motions[:, 2, 4] = y, -x
    return motions


def _gauge_free(factor: scipy.sparse.linalg.SuperLU, motions: FloatArray, sampled: NDArray[np.int64]) -> FloatArray:
    """Return the covariances (n, 6, 6) of the sampled key frames once the map is laid onto the truth.

    With Σ the inverse of the information and G the rigid motions, x' = (I − G M) x for the least-squares fit M of G.
    """
    count = len(motions)
    stacked = motions.reshape(6 * count, 6)
    weight = np.tile([1.0, 1.0, 1.0, *[GAUGE_LEVER_M**2] * 3], count)
    fit = np.linalg.solve(stacked.T @ (weight[:, None] * stacked), (weight[:, None] * stacked).T)
    spread = np.asarray(factor.solve(np.ascontiguousarray(fit.T)))
    common = fit @ spread
    result = np.empty((len(sampled), 6, 6))
    for n, k in enumerate(sampled.tolist()):
        unit = np.zeros((6 * count, 6))
        unit[6 * k : 6 * k + 6] = np.eye(6)
        own = np.asarray(factor.solve(unit))[6 * k : 6 * k + 6]
        cross = spread[6 * k : 6 * k + 6] @ motions[k].T
        full = own - cross - cross.T + motions[k] @ common @ motions[k].T
        result[n] = 0.5 * (full + full.T)
    return result

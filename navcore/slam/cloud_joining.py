"""Clouds of several recordings as one: what lies in the same voxel is one point, and knows who saw it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from navcore.geometry import FloatArray
from navcore.slam.dense_cloud import CEILING_M, VOXEL_M, DenseCloud

MAX_JOINED_POINTS = 800_000
"""Points of a joined cloud; where there are more, voxels get larger."""


def joined_clouds(
    clouds: Sequence[DenseCloud],
    voxel_m: float = VOXEL_M,
    max_points: int = MAX_JOINED_POINTS,
    ceiling_m: float = CEILING_M,
) -> DenseCloud:
    """Return one cloud of several in the same frame; the points of a voxel become their mean, by weight."""
    points = np.concatenate([cloud.points_m for cloud in clouds]).astype(np.float64)
    colours = np.concatenate([cloud.colours_rgb for cloud in clouds]).astype(np.float64)
    weight = np.concatenate([cloud.weights for cloud in clouds]).astype(np.float64)
    views = np.concatenate([cloud.view_counts for cloud in clouds]).astype(np.int64)
    sessions = np.concatenate([cloud.sessions for cloud in clouds])
    if not len(points):
        return clouds[0]
    while True:
        group, count = _voxels(points, voxel_m)
        if count <= max_points:
            break
        voxel_m *= 1.25
    total = np.asarray(np.bincount(group, weight, count), dtype=np.float64)
    mean = _means(np.column_stack([points, colours]), weight, group, total)
    seen_by = np.zeros(count, np.uint64)
    np.bitwise_or.at(seen_by, group, sessions)
    views_sum = np.minimum(np.bincount(group, views, count), 65_535).astype(np.uint16)
    places = mean[:, :3].astype(np.float32)
    return DenseCloud(
        places,
        np.clip(np.round(mean[:, 3:]), 0, 255).astype(np.uint8),
        places[:, 2] > ceiling_m,
        total.astype(np.float32),
        views_sum,
        seen_by,
    )


def _voxels(points: FloatArray, voxel_m: float) -> tuple[NDArray[np.int64], int]:
    """Return the number of each point's voxel (n,), in the order of place, and how many there are."""
    cell = np.floor(points / voxel_m).astype(np.int64) + (1 << 20)
    keys, group = np.unique((cell[:, 0] << 42) | (cell[:, 1] << 21) | cell[:, 2], return_inverse=True)
    return group.astype(np.int64), len(keys)


def _means(values: FloatArray, weight: FloatArray, group: NDArray[np.int64], total: FloatArray) -> FloatArray:
    sums = [np.bincount(group, weight * column, len(total)) for column in values.T]
    return np.stack(sums, axis=1) / np.maximum(total, 1e-12)[:, None]


def cloud_without_session(cloud: DenseCloud, session: int) -> DenseCloud:
    """Return the cloud without what a recording alone has seen; those with higher numbers move up."""
    bit = np.uint64(1) << np.uint64(session)
    below = bit - np.uint64(1)
    others = cloud.sessions & ~bit
    kept = others != 0
    # The bits above the recording's own move down by one.
    renumbered = (others & below) | ((others & ~below) >> np.uint64(1))
    return replace(cloud.chosen(kept), sessions=renumbered[kept])

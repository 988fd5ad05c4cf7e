"""What lies in a map moves with it: when key frames are adjusted, points follow the key frame that sees them best."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from navcore.geometry import FloatArray

AHEAD_M = 1.5
"""A key frame speaks for what lies around a point so far ahead of it."""


@dataclass(frozen=True, slots=True, eq=False)
class Deformation:
    """How key frames of a map were moved."""

    before: FloatArray
    """(K, 4, 4): camera_from_world."""
    after: FloatArray
    """(K, 4, 4): the same key frames."""

    def moved(self, points_m: FloatArray) -> FloatArray:
        """Return points (n, 3) where the key frame that is nearest to looking at each has taken them."""
        if not len(points_m) or not len(self.before):
            return np.array(points_m, dtype=np.float64)
        nearest = self._nearest(points_m)
        step = np.linalg.inv(self.after) @ self.before
        return np.asarray(np.einsum("nij,nj->ni", step[nearest, :3, :3], points_m) + step[nearest, :3, 3])

    def _nearest(self, points_m: FloatArray) -> NDArray[np.int64]:
        world_from_camera = np.linalg.inv(self.before)
        ahead = world_from_camera[:, :3, 3] + AHEAD_M * world_from_camera[:, :3, 2]
        return np.asarray(cKDTree(ahead).query(points_m)[1])

    @property
    def largest_step_m(self) -> float:
        """By how much the key frame that moved most was moved."""
        if not len(self.before):
            return 0.0
        step = np.linalg.inv(self.after)[:, :3, 3] - np.linalg.inv(self.before)[:, :3, 3]
        return float(np.linalg.norm(step, axis=1).max())


def rigid_fit(source: FloatArray, target: FloatArray) -> FloatArray:
    """Return the motion (4, 4) that brings points (n, 3), n ≥ 3, nearest to others (Horn; by SVD)."""
    source_mean, target_mean = source.mean(axis=0), target.mean(axis=0)
    u, _, vt = np.linalg.svd((target - target_mean).T @ (source - source_mean))
    rotation = u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))]) @ vt
    motion = np.eye(4)
    motion[:3, :3] = rotation
    motion[:3, 3] = target_mean - rotation @ source_mean
    return motion


def frame_kept(deformation: Deformation) -> FloatArray:
    """Return the motion (4, 4) of the whole map after which its key frames lie as near as can be to where they lay."""
    return rigid_fit(_triads(deformation.after), _triads(deformation.before))


def _triads(camera_from_world: FloatArray) -> FloatArray:
    """Return each camera's centre and the tips of its axes, a metre long: places and directions count alike."""
    tips = np.concatenate([np.zeros((1, 3)), np.eye(3)])
    world_from_camera = np.linalg.inv(camera_from_world)
    rotated = np.einsum("kij,tj->kti", world_from_camera[:, :3, :3], tips)
    return np.asarray((rotated + world_from_camera[:, None, :3, 3]).reshape(-1, 3))

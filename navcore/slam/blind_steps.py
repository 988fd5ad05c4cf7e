"""Steps along which nothing seen led, only the motion model: how far they may be wrong.

A wrong velocity stays wrong: along what was open, the standard deviation grows with the time, not with its root.
"""

from __future__ import annotations

import numpy as np

from navcore.geometry import FloatArray
from navcore.slam.depth_tracking import motion_covariance


class BlindSteps:
    """The drift of a camera since its last key frame, by steps that nothing seen fixed."""

    def __init__(self) -> None:
        self._blind_s = 0.0
        self._in_world = np.zeros((6, 6))

    def note(self, camera_from_world: FloatArray, step_s: float, free_directions: FloatArray) -> None:
        """Take in a frame with its pose (4, 4), ``step_s`` after the one before; directions (k, 6) in its camera, of
        which there are none where its pose was fixed, were open."""
        if len(free_directions) == 0:
            self._blind_s = 0.0
            return
        before_s, self._blind_s = self._blind_s, self._blind_s + abs(step_s)
        world_from_camera = np.kron(np.eye(2), camera_from_world[:3, :3].T)
        grown = (self._blind_s**2 - before_s**2) * motion_covariance(free_directions)
        self._in_world += world_from_camera @ grown @ world_from_camera.T

    def taken(self, camera_from_world: FloatArray) -> FloatArray:
        """Return the covariance (6, 6) of a key frame's step from the one before, as a twist in its camera's frame, and
        begin anew from it."""
        camera_from = np.kron(np.eye(2), camera_from_world[:3, :3])
        drift, self._in_world = camera_from @ self._in_world @ camera_from.T, np.zeros((6, 6))
        return drift

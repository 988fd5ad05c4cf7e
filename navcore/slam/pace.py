"""How fast the walker has been going, for where nothing seen tells: the mean over the last second that was sure.

The step between two frames is no measure of it: where a pose has just been corrected, most of the step is correction,
and carried on it would lead metres away within a second.
"""

from __future__ import annotations

import numpy as np

from navcore.geometry import FloatArray

MEMORY_S = 1.0
"""Sure frames that are older than this, when another comes, are forgotten."""
LEAST_S = 0.25
"""A shorter time says nothing of the walker's speed."""
MAX_SPEED_M_S = 1.8
"""Nobody walks faster while wearing the glasses."""


class Pace:
    """The walker's velocity, from frames whose positions were sure."""

    def __init__(self) -> None:
        self._stamps_s: list[float] = []
        self._centres: list[FloatArray] = []

    def forget(self) -> None:
        """Forget all frames: the map has moved, or the walker was lost."""
        self._stamps_s, self._centres = [], []

    def note(self, stamp_s: float, camera_from_world: FloatArray) -> None:
        """Remember a frame whose position (pose (4, 4)) is sure."""
        self._stamps_s.append(stamp_s)
        self._centres.append(-camera_from_world[:3, :3].T @ camera_from_world[:3, 3])
        while abs(stamp_s - self._stamps_s[0]) > MEMORY_S:
            self._stamps_s.pop(0)
            self._centres.pop(0)

    @property
    def is_known(self) -> bool:
        """Whether enough is remembered to tell a velocity."""
        return bool(self._stamps_s) and abs(self._stamps_s[-1] - self._stamps_s[0]) >= LEAST_S

    @property
    def velocity_m_s(self) -> FloatArray:
        """(3,): in the world; zero where too little is known."""
        if not self.is_known:
            return np.zeros(3)
        stamps = np.array(self._stamps_s) - np.mean(self._stamps_s)
        velocity = stamps @ np.array(self._centres) / (stamps @ stamps)
        speed = float(np.linalg.norm(velocity))
        return np.asarray(velocity * min(1.0, MAX_SPEED_M_S / max(speed, 1e-9)))

    def carried_on(self, camera_from_world: FloatArray, since_s: float, rotation: FloatArray) -> FloatArray:
        """Return the pose (4, 4) ``since_s`` after another one (4, 4), with a rotation (3, 3) of its own."""
        centre = -camera_from_world[:3, :3].T @ camera_from_world[:3, 3] + since_s * self.velocity_m_s
        pose = np.eye(4)
        pose[:3, :3] = rotation
        pose[:3, 3] = -rotation @ centre
        return pose

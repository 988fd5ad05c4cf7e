"""What SLAM makes of a map walk while it is walked: each frame as a :class:`navcore.coverage.Sight`.

The same mapper that ``vbr map build`` runs follows the camera here, so that the advice is about what the map will be.
Its map is thrown away: the recording's is built with more care.
"""

from __future__ import annotations

import math
from concurrent.futures import Executor

import numpy as np

from navcore.coverage import Sight
from navcore.geometry import FloatArray
from navcore.settings import Settings
from navcore.slam.features import feature_count_for, grey_of
from navcore.slam.keyframes import SlamCamera
from navcore.slam.map_build import BF_PX_M
from navcore.slam.mapper import Followed, Mapper
from navcore.types import CameraIntrinsics, Frame

USUAL_TILT_RAD = math.radians(-15.0)
"""How the camera on the glasses points while somebody looks straight ahead."""
_USUAL_SHARE = 0.005
"""How quickly what is usual follows: within some 20 s at 10 frames a second."""


class WalkTracker:
    """Follows the frames of one map walk."""

    def __init__(self, intrinsics: CameraIntrinsics, settings: Settings, executor: Executor | None = None) -> None:
        """``executor`` runs local mapping beside tracking."""
        count = feature_count_for(intrinsics.width_px, intrinsics.height_px, settings.localization.feature_count)
        self._mapper = Mapper(intrinsics, SlamCamera.of(intrinsics, BF_PX_M), count, executor=executor)
        self._far_m = settings.map_walk.far_m
        self._last: tuple[float, FloatArray] | None = None
        self._loop_count = 0
        self._usual_down: FloatArray | None = None

    def see(self, frame: Frame) -> Sight:
        """Follow a frame; stamps grow. What the mapper raises comes through."""
        self._mapper.add(frame)
        followed = self._mapper.followed
        pose = self._mapper.world_from_camera if followed.tracked else None
        turn_rad_s, speed_m_s = self._motion(frame.stamp_s, pose)
        grey = grey_of(frame.colour_rgb)
        valid = np.isfinite(frame.depth_m)
        valid_count = int(np.count_nonzero(valid))
        return Sight(
            frame.stamp_s,
            followed.tracked,
            followed.landmark_count,
            followed.is_fixed,
            valid_count / valid.size,
            int(np.count_nonzero(frame.depth_m > self._far_m)) / max(valid_count, 1),
            float(grey.mean()) / 255.0,
            float(grey.std()) / 255.0,
            turn_rad_s,
            speed_m_s,
            self._tilt_rad(frame, followed, pose),
            self._mapper.loop_count,
        )

    def _motion(self, stamp_s: float, pose: FloatArray | None) -> tuple[float, float]:
        """Return how fast the camera turns and moves; zeros where that is not known, or a loop has moved the map."""
        before, self._last = self._last, None if pose is None else (stamp_s, pose)
        has_moved = self._loop_count != self._mapper.loop_count
        self._loop_count = self._mapper.loop_count
        if before is None or pose is None or has_moved:
            return 0.0, 0.0
        step_s = stamp_s - before[0]
        step = np.linalg.inv(before[1]) @ pose
        turn_rad = math.acos(float(np.clip((np.trace(step[:3, :3]) - 1.0) / 2.0, -1.0, 1.0)))
        return turn_rad / step_s, float(np.linalg.norm(step[:3, 3])) / step_s

    def _tilt_rad(self, frame: Frame, followed: Followed, pose: FloatArray | None) -> float | None:
        """Return how far the camera points up: by its accelerometer, else against how it usually points."""
        if frame.gravity is not None:
            return -math.asin(float(np.clip(frame.gravity[2], -1.0, 1.0)))
        if pose is None or not followed.is_fixed:
            return None
        down, forward = pose[:3, 1], pose[:3, 2]
        usual = down if self._usual_down is None else (1 - _USUAL_SHARE) * self._usual_down + _USUAL_SHARE * down
        self._usual_down = usual
        length = float(np.linalg.norm(usual))
        return USUAL_TILT_RAD - math.asin(float(np.clip(forward @ usual / length, -1.0, 1.0)))

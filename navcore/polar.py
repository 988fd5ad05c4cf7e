"""Places on the floor as somebody sees them: bearing and distance, and back."""

from __future__ import annotations

import math

import numpy as np

from navcore.geometry import FloatArray
from navcore.types import Pose2D


def seen_from(pose: Pose2D, places_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return bearings (k,) relative to the heading, in [−π, π), and distances (k,) of places (k, 2) in the map."""
    offset = places_m - (pose.x_m, pose.y_m)
    angle = np.arctan2(offset[:, 1], offset[:, 0]) - pose.heading
    return (angle + math.pi) % math.tau - math.pi, np.hypot(offset[:, 0], offset[:, 1])


def placed(pose: Pose2D, bearing_rad: FloatArray, range_m: FloatArray) -> FloatArray:
    """Return the places (k, 2) in the map, metres, of what is seen in bearings (k,) at distances (k,)."""
    angle_rad = bearing_rad + pose.heading
    along = np.stack([np.cos(angle_rad), np.sin(angle_rad)], axis=1)
    return np.asarray(along * np.reshape(range_m, (-1, 1)) + (pose.x_m, pose.y_m), dtype=np.float64)

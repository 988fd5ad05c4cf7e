"""Rigid transforms, SE(3).

Conventions: world in metres, right-handed, z up; body x forward, y left, z up (REP-103); camera x right, y down,
z forward (OpenCV). A transform is named ``a_from_b``: it takes coordinates in b to coordinates in a, and
``a_from_b @ b_from_c`` is ``a_from_c``. Quaternions say their order.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from navcore.angles import WorldAngle, world_angle

FloatArray = NDArray[np.float64]

BODY_FROM_CAMERA_AXES: FloatArray = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""Rotation that takes camera axes (x right, y down, z forward) to body axes (x forward, y left, z up)."""
BODY_FROM_CAMERA_AXES.setflags(write=False)


@dataclass(frozen=True, slots=True, eq=False)
class Transform:
    """A rigid transform as a 4×4 homogeneous matrix (read-only, float64)."""

    matrix: FloatArray

    def __post_init__(self) -> None:
        matrix = np.array(self.matrix, dtype=np.float64)
        if matrix.shape != (4, 4):
            raise ValueError(f"a Transform needs a 4×4 matrix, not one of shape {matrix.shape}")
        matrix.setflags(write=False)
        object.__setattr__(self, "matrix", matrix)

    @staticmethod
    def identity() -> Transform:
        """Return the transform that changes nothing."""
        return Transform(np.eye(4))

    @staticmethod
    def from_rotation_translation(rotation: FloatArray, translation: FloatArray) -> Transform:
        """Build from a rotation matrix (3, 3) and a translation (3,) in metres."""
        matrix = np.eye(4)
        matrix[:3, :3] = rotation
        matrix[:3, 3] = translation
        return Transform(matrix)

    @staticmethod
    def from_quat_xyzw(quat_xyzw: FloatArray, translation: FloatArray) -> Transform:
        """Build from a quaternion in the order of TUM files (x, y, z, w) and a translation (3,) in metres."""
        return Transform.from_rotation_translation(rotation_from_quat_xyzw(quat_xyzw), translation)

    @property
    def rotation(self) -> FloatArray:
        """Rotation matrix (3, 3)."""
        return self.matrix[:3, :3]

    @property
    def translation(self) -> FloatArray:
        """Translation (3,), metres."""
        return self.matrix[:3, 3]

    @property
    def quat_xyzw(self) -> FloatArray:
        """Rotation as a unit quaternion (x, y, z, w) with w ≥ 0."""
        return quat_xyzw_from_rotation(self.rotation)

    def inverse(self) -> Transform:
        """Return ``b_from_a`` of this ``a_from_b``."""
        rotation = self.rotation.T
        return Transform.from_rotation_translation(rotation, -rotation @ self.translation)

    def __matmul__(self, other: Transform) -> Transform:
        return Transform(self.matrix @ other.matrix)

    def apply(self, points: FloatArray) -> FloatArray:
        """Transform points (..., 3)."""
        return points @ self.rotation.T + self.translation


def rotation_from_quat_xyzw(quat_xyzw: FloatArray) -> FloatArray:
    """Return the rotation matrix (3, 3) of a quaternion (x, y, z, w), which need not be normalized.

    Raises ValueError for a quaternion of length zero or one that is not finite.
    """
    quat = np.asarray(quat_xyzw, dtype=np.float64)
    norm = float(np.linalg.norm(quat))
    if not math.isfinite(norm) or norm < 1e-12:
        raise ValueError("a quaternion of length zero is no rotation")
    x, y, z, w = (float(c) for c in quat / norm)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def quat_xyzw_from_rotation(rotation: FloatArray) -> FloatArray:
    """Return the unit quaternion (x, y, z, w), w ≥ 0, of a rotation matrix (3, 3)."""
    m = rotation
    # The four ways to write the quaternion; the one with the largest divisor is the accurate one (Shepperd).
    squares = np.array(
        [
            1 + m[0, 0] - m[1, 1] - m[2, 2],
            1 - m[0, 0] + m[1, 1] - m[2, 2],
            1 - m[0, 0] - m[1, 1] + m[2, 2],
            1 + m[0, 0] + m[1, 1] + m[2, 2],
        ]
    )
    largest = int(np.argmax(squares))
    if largest == 0:
        quat = [squares[0], m[0, 1] + m[1, 0], m[0, 2] + m[2, 0], m[2, 1] - m[1, 2]]
    elif largest == 1:
        quat = [m[0, 1] + m[1, 0], squares[1], m[1, 2] + m[2, 1], m[0, 2] - m[2, 0]]
    elif largest == 2:
        quat = [m[0, 2] + m[2, 0], m[1, 2] + m[2, 1], squares[2], m[1, 0] - m[0, 1]]
    else:
        quat = [m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1], squares[3]]
    result = np.array(quat, dtype=np.float64)
    result /= np.linalg.norm(result)
    return -result if result[3] < 0 else result


def rotation_from_rotvec(rotvec_rad: FloatArray) -> FloatArray:
    """Return the rotation matrix (3, 3) of an axis–angle vector (3,), radians (Rodrigues)."""
    angle = float(np.linalg.norm(rotvec_rad))
    x, y, z = (float(c) for c in rotvec_rad)
    skew: FloatArray = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    unit: FloatArray = np.eye(3)
    if angle < 1e-8:
        return np.asarray(unit + skew + 0.5 * skew @ skew)
    return np.asarray(unit + (math.sin(angle) / angle) * skew + ((1 - math.cos(angle)) / angle**2) * skew @ skew)


def rotation_about_z(angle_rad: float) -> FloatArray:
    """Return the rotation matrix (3, 3) that turns counter-clockwise seen from above."""
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def heading_of_camera(world_from_camera: Transform) -> WorldAngle:
    """Return θ_c, the direction of the optical axis on the floor plane (paper IV-C, term 2).

    A camera that looks straight up or down has no heading; its image-up axis stands in for it then.
    """
    forward = world_from_camera.rotation[:, 2]
    if math.hypot(forward[0], forward[1]) < 1e-6:
        forward = -world_from_camera.rotation[:, 1] * (1.0 if forward[2] < 0 else -1.0)
    return world_angle(math.atan2(float(forward[1]), float(forward[0])))


def world_from_camera_at(
    position_m: tuple[float, float, float], heading_rad: float, pitch_down_rad: float = 0.0, roll_rad: float = 0.0
) -> Transform:
    """Return the pose of a camera that stands at a place (x, y, z) and looks along a heading.

    ``pitch_down_rad`` tilts the optical axis below the horizon; ``roll_rad`` tilts the head about the optical axis
    (positive leans to the right).
    """
    cp, sp = math.cos(pitch_down_rad), math.sin(pitch_down_rad)
    cr, sr = math.cos(roll_rad), math.sin(roll_rad)
    pitch = np.array([[cp, 0.0, sp], [0.0, 1.0, 0.0], [-sp, 0.0, cp]])
    roll = np.array([[1.0, 0.0, 0.0], [0.0, cr, -sr], [0.0, sr, cr]])
    rotation = rotation_about_z(heading_rad) @ pitch @ roll @ BODY_FROM_CAMERA_AXES
    return Transform.from_rotation_translation(rotation, np.array(position_m, dtype=np.float64))

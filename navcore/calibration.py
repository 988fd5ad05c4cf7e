"""What has been measured of one pair of glasses: how the depth camera is mounted, its lenses, and the rangefinder.

All are frozen values; where they are kept: :mod:`device_agent.calibration_store`, how they are measured:
:mod:`navcore.calibrating`. A part that is None has not been measured, and nothing is assumed in its place.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from navcore.errors import InputError
from navcore.geometry import FloatArray, Transform, rotation_from_rotvec
from navcore.obstacle.levelling import Levelling
from navcore.types import CameraIntrinsics, FisheyeCamera, FisheyeIntrinsics, SonarReading, SonarState

HEIGHTS_M = (0.9, 2.3)
"""Camera heights that a person's glasses have, sitting or standing; what is nearer below is a table."""
_MAX_TILT_RAD = math.radians(50.0)
_MAX_BEARING_RAD = math.radians(30.0)
MAX_BIAS_M = 0.3


@dataclass(frozen=True, slots=True)
class FloorCalibration:
    """How the depth camera is held above the floor by somebody who stands upright and looks straight ahead."""

    made_s: float
    """When it was measured, seconds since 1970 (Unix time)."""
    height_m: float
    """Height of the camera above the floor."""
    height_sigma_m: float
    pitch_rad: float
    """How far the optical axis points below the horizon."""
    pitch_sigma_rad: float
    roll_rad: float
    """How far the camera leans to the right."""
    roll_sigma_rad: float
    frame_count: int
    """Frames that the fit rests on; the standard deviations are those of one frame."""
    up_from_gravity_rad: tuple[float, float, float] | None = None
    """Rotation vector, in the camera's frame, from what the accelerometer feels as up to the floor's normal; None where
    the frames carried no gravity."""

    def __post_init__(self) -> None:
        low_m, high_m = HEIGHTS_M
        _require(low_m <= self.height_m <= high_m, f"a camera {self.height_m:g} m above the floor is worn by nobody")
        tilts_rad = (self.pitch_rad, self.roll_rad, *(self.up_from_gravity_rad or ()))
        _require(all(abs(each) <= _MAX_TILT_RAD for each in tilts_rad), "the camera leans by more than 50°")
        sigmas = (self.height_sigma_m, self.pitch_sigma_rad, self.roll_sigma_rad)
        _require(all(0.0 <= each < 1.0 for each in sigmas), "a standard deviation is no small positive number")
        _require(math.isfinite(self.made_s) and self.frame_count > 0, "it does not say when and from what it was made")

    @property
    def up(self) -> FloatArray:
        """The floor's normal (3,), up, in the camera's frame."""
        cp, sp = math.cos(self.pitch_rad), math.sin(self.pitch_rad)
        return np.array([-cp * math.sin(self.roll_rad), -cp * math.cos(self.roll_rad), -sp])

    def up_by_gravity(self, gravity: FloatArray | None) -> FloatArray | None:
        """Return where up (3,) is in the camera's frame by the accelerometer; None where nothing was measured of it."""
        if gravity is None or self.up_from_gravity_rad is None:
            return None
        up: FloatArray = rotation_from_rotvec(np.array(self.up_from_gravity_rad)) @ -gravity
        return up


@dataclass(frozen=True, slots=True)
class LensQuality:
    """How well a lens was measured."""

    made_s: float
    """When, seconds since 1970 (Unix time)."""
    rms_px: float
    """Root mean square of the reprojection error."""
    picture_count: int
    coverage: float
    """Share of the picture, by cells of a grid, in which corners of the board were seen, 0–1."""

    def __post_init__(self) -> None:
        good = 0.0 <= self.rms_px < 100.0 and 0.0 <= self.coverage <= 1.0 and self.picture_count > 0
        _require(good and math.isfinite(self.made_s), "it does not say how well the lens was measured")


@dataclass(frozen=True, slots=True)
class PinholeCalibration:
    """The depth camera's colour lens, measured with a board."""

    intrinsics: CameraIntrinsics
    quality: LensQuality

    def __post_init__(self) -> None:
        numbers = (self.intrinsics.fx_px, self.intrinsics.fy_px, self.intrinsics.cx_px, self.intrinsics.cy_px)
        sizes = (self.intrinsics.width_px, self.intrinsics.height_px)
        finite = all(math.isfinite(each) for each in (*numbers, *self.intrinsics.distortion))
        _require(finite and min(*numbers, *sizes) > 0, "its camera matrix is that of no camera")


@dataclass(frozen=True, slots=True)
class FisheyeCalibration:
    """The fisheye camera's lens, measured with a board."""

    intrinsics: FisheyeIntrinsics
    quality: LensQuality
    fisheye_from_camera: tuple[float, float, float, float, float, float, float] | None = None
    """Its mounting, the depth camera seen from the fisheye camera: tx ty tz (m) qx qy qz qw; None where nobody has told
    it, for a board before one camera does not."""

    def __post_init__(self) -> None:
        mounting = self.fisheye_from_camera
        if mounting is not None:
            finite = all(math.isfinite(each) for each in mounting)
            _require(finite and 0.99 <= math.hypot(*mounting[3:]) <= 1.01, "the fisheye camera's mounting is none")

    @property
    def camera(self) -> FisheyeCamera | None:
        """The camera as the program uses it; None without a mounting."""
        if self.fisheye_from_camera is None:
            return None
        place = np.array(self.fisheye_from_camera)
        return FisheyeCamera(self.intrinsics, Transform.from_quat_xyzw(place[3:], place[:3]))


@dataclass(frozen=True, slots=True)
class SonarAlignment:
    """Where the rangefinder looks, and how its distances differ from the depth camera's."""

    made_s: float
    """When it was measured, seconds since 1970 (Unix time)."""
    bearing_rad: float
    """Direction of its axis, to the left of the camera's."""
    bearing_sigma_rad: float
    bias_m: float
    """How much farther than the camera's depth it says a wall is: its place before or behind the camera, and its own
    error, together."""
    bias_sigma_m: float
    residual_m: float
    """Standard deviation of its readings about the model."""
    reading_count: int

    def __post_init__(self) -> None:
        _require(abs(self.bearing_rad) <= _MAX_BEARING_RAD, "the rangefinder looks more than 30° aside")
        _require(abs(self.bias_m) <= MAX_BIAS_M, f"the rangefinder's distances are off by more than {MAX_BIAS_M:g} m")
        sigmas = (self.bearing_sigma_rad, self.bias_sigma_m, self.residual_m)
        _require(all(0.0 <= each < 1.0 for each in sigmas), "a standard deviation is no small positive number")
        _require(math.isfinite(self.made_s) and self.reading_count > 0, "it does not say from what it was made")

    def aligned(self, reading: SonarReading) -> SonarReading:
        """Return the reading with its distance as the depth camera would have measured it, and where it looks."""
        distance_m = reading.distance_m
        if reading.state is SonarState.OK and distance_m is not None:
            distance_m = max(0.0, distance_m - self.bias_m)
        return SonarReading(reading.stamp_s, reading.state, distance_m, self.bearing_rad)


@dataclass(frozen=True, slots=True)
class Calibration:
    """Everything that has been measured of one pair of glasses."""

    floor: FloorCalibration | None = None
    pinhole: PinholeCalibration | None = None
    fisheye: FisheyeCalibration | None = None
    sonar: SonarAlignment | None = None

    @property
    def is_empty(self) -> bool:
        """Whether nothing has been measured yet."""
        return self == Calibration()


def pitch_and_roll_rad(levelling: Levelling) -> tuple[float, float]:
    """Return how far the optical axis points below the horizon, and how far the camera leans to the right."""
    up_x, up_y, up_z = (float(each) for each in levelling.level_from_camera[2])
    return -math.asin(max(-1.0, min(1.0, up_z))), math.atan2(-up_x, -up_y)


def angle_between_rad(one: FloatArray, other: FloatArray) -> float:
    """Return the angle between two directions (3,), 0 to π."""
    return math.atan2(float(np.linalg.norm(np.cross(one, other))), float(one @ other))


def _require(condition: bool, what: str) -> None:
    if not condition:
        raise InputError(f"The calibration cannot be right ({what}): calibrate again.")

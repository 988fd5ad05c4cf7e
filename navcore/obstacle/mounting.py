"""Is the camera still where it was calibrated? The floor that it sees tells.

A head nods and turns, so one look tells nothing. Three things are compared, look by look, and only a disagreement that
lasts counts: ::

    height   of the camera above the floor                              a nodding head does not change it
    tilt     the floor's normal against up by gravity, or by the pose   a nodding head does not change it
    posture  the floor's normal against the calibration's own           a head that is held low changes it as well

The last is the only one that notices a camera with an accelerometer inside that has slipped on the glasses, for its
gravity, and a pose from its pictures, slip with it. It asks for more patience, and looks at the mean of some looks, in
which the nods of a stride cancel out.
Where no floor is in view nothing is known: that neither confirms nor ends a disagreement.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

from navcore.calibration import FloorCalibration, angle_between_rad
from navcore.geometry import FloatArray
from navcore.obstacle.levelling import Levelling, level_by_floor
from navcore.settings import CalibrationSettings
from navcore.types import CameraIntrinsics, DepthImage, Localization, LocalizationQuality

FloorFinder = Callable[[DepthImage, CameraIntrinsics], Levelling | None]
"""What :func:`navcore.obstacle.levelling.level_by_floor` is: a replay of a walk without pictures has another one."""
find_floor: FloorFinder = level_by_floor
LOOK_EVERY_S = 0.5
"""Looking for the floor takes longer than following it: not in every frame."""
_AT_THE_START_S = 1.5
"""Before the floor has ever agreed, nobody has reason to believe that it does."""
_LONGEST_LOOK_S = 1.0
"""Time for which nobody looked does not count as a disagreement."""
_AGREES_AFTER_S = 1.0
_POSTURE_TIME_CONSTANT_S = 1.5
"""Two or three steps."""
_OTHER_PLANE_RAD = math.radians(20.0)
"""A plane that gravity or the pose says is steeper than this is no floor: a stair, seen from its foot, is one."""


@dataclass(frozen=True, slots=True)
class MountingWatch:
    """What is remembered of the looks at the floor."""

    looked_s: float = -math.inf
    """When the floor was last looked for."""
    seen_s: float = -math.inf
    """When it was last seen."""
    height_apart_s: float = 0.0
    """How long, looks added up, the height has disagreed without a look at which it agreed; so the other two."""
    tilt_apart_s: float = 0.0
    posture_apart_s: float = 0.0
    posture_offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """The mean of the last looks' ``posture_offset``."""
    agrees_s: float = 0.0
    """How long, looks added up, all has agreed."""
    has_agreed: bool = False
    """The floor has been where it should be, since the start."""
    moved: bool = False
    """The camera has moved."""
    by_posture: bool = False
    """Only the posture told so: it may be the head that is held otherwise."""
    why: str = ""
    """What disagreed when it was found to have moved, in words."""


@dataclass(frozen=True, slots=True)
class FloorDifference:
    """How the floor that is seen differs from the calibration."""

    height_m: float
    """By how much the camera is higher than it was."""
    tilt_rad: float | None
    """Angle between the floor's normal and up by gravity or the pose; None where neither is known."""
    posture_offset: tuple[float, float, float]
    """The floor's normal less that of the calibration, unit vectors in the camera's frame."""

    @property
    def posture_rad(self) -> float:
        """Angle between the floor's normal and that of the calibration."""
        return _angle_rad(self.posture_offset)

    def words(self) -> str:
        """Return it for people."""
        tilt = "" if self.tilt_rad is None else f", {math.degrees(self.tilt_rad):.0f}° off level"
        return (
            f"{abs(self.height_m):.2f} m {'higher' if self.height_m >= 0 else 'lower'} and"
            f" {math.degrees(self.posture_rad):.0f}° otherwise inclined than calibrated{tilt}"
        )


def _angle_rad(offset: tuple[float, float, float]) -> float:
    """Return the angle between two unit vectors with this difference; that of the mean of such, nearly."""
    return 2.0 * math.asin(min(1.0, math.hypot(*offset) / 2.0))


def floor_difference(seen: Levelling, calibrated: FloorCalibration, up: FloatArray | None) -> FloorDifference | None:
    """Return how a floor that is seen differs from the calibration; None where the plane can be no floor.

    Args:
        seen: by the largest plane below the camera.
        calibrated: how it was.
        up: up (3,) in the camera's frame, by gravity or the pose; None where neither is known.
    """
    normal = seen.level_from_camera[2]
    tilt_rad = None if up is None else angle_between_rad(normal, up)
    if tilt_rad is not None and tilt_rad > _OTHER_PLANE_RAD:
        return None
    x, y, z = (float(each) for each in normal - calibrated.up)
    return FloorDifference(seen.height_m - calibrated.height_m, tilt_rad, (x, y, z))


def independent_up(
    calibrated: FloorCalibration, gravity: FloatArray | None, located: Localization
) -> FloatArray | None:
    """Return up (3,) in the camera's frame by the accelerometer, else by a pose that is sure; None without either."""
    up = calibrated.up_by_gravity(gravity)
    if up is not None or located.world_from_camera is None or located.quality is not LocalizationQuality.LOCALIZED:
        return up
    by_pose: FloatArray = located.world_from_camera.rotation[2]
    return by_pose


def watched(
    watch: MountingWatch, difference: FloorDifference | None, stamp_s: float, settings: CalibrationSettings
) -> MountingWatch:
    """Take in one look at the floor, and return what to remember.

    Args:
        watch: what this function returned last.
        difference: what the look came to; None where no floor was in view.
        stamp_s: when the picture was taken.
        settings: tolerances, and how long a disagreement must last.
    """
    passed_s = min(max(stamp_s - watch.looked_s, 0.0), _LONGEST_LOOK_S) if math.isfinite(watch.looked_s) else 0.0
    watch = replace(watch, looked_s=stamp_s)
    if difference is None:
        return watch
    tolerance_rad = math.radians(settings.tilt_tolerance_deg)
    height = not abs(difference.height_m) <= settings.height_tolerance_m
    tilt = difference.tilt_rad is not None and not difference.tilt_rad <= tolerance_rad
    offset = _mean_offset(watch, difference, passed_s)
    posture = not _angle_rad(offset) <= tolerance_rad
    agrees = not (height or tilt or posture)
    watch = replace(
        watch,
        height_apart_s=watch.height_apart_s + passed_s if height else 0.0,
        tilt_apart_s=watch.tilt_apart_s + passed_s if tilt else 0.0,
        posture_apart_s=watch.posture_apart_s + passed_s if posture else 0.0,
        agrees_s=watch.agrees_s + passed_s if agrees else 0.0,
        posture_offset=offset,
        seen_s=stamp_s,
        has_agreed=watch.has_agreed or agrees,
    )
    return _judged(watch, difference, settings)


def _mean_offset(watch: MountingWatch, difference: FloorDifference, passed_s: float) -> tuple[float, float, float]:
    """Return the mean of the last looks; the first look is all there is."""
    share = 1.0 - math.exp(-passed_s / _POSTURE_TIME_CONSTANT_S) if math.isfinite(watch.seen_s) else 1.0
    x, y, z = (
        old + share * (new - old) for old, new in zip(watch.posture_offset, difference.posture_offset, strict=True)
    )
    return x, y, z


def _judged(watch: MountingWatch, difference: FloorDifference, settings: CalibrationSettings) -> MountingWatch:
    if watch.moved:
        if watch.agrees_s < _AGREES_AFTER_S:
            return watch
        return replace(watch, moved=False, by_posture=False, why="")
    patience_s = math.inf if watch.has_agreed else _AT_THE_START_S
    by_floor = max(watch.height_apart_s, watch.tilt_apart_s) >= min(settings.moved_after_s, patience_s)
    by_posture = watch.posture_apart_s >= min(settings.posture_after_s, patience_s)
    if not (by_floor or by_posture):
        return watch
    return replace(watch, moved=True, by_posture=not by_floor, why=difference.words())

"""Pitch, roll and height of the depth camera, from the floor that it sees.

In each frame the floor is looked for by RANSAC and fitted by least squares (:mod:`navcore.obstacle.levelling`); the
result is the median over the frames, which a frame with somebody's foot in it does not move. What could be something
other than the floor is refused with the reason, frame by frame, and so is a set of frames that does not agree.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from navcore.calibration import HEIGHTS_M, FloorCalibration, angle_between_rad, pitch_and_roll_rad
from navcore.errors import InputError
from navcore.geometry import FloatArray
from navcore.obstacle.levelling import Levelling, level_by_floor, sampled_points
from navcore.types import CameraIntrinsics, DepthImage, Frame

MIN_FRAMES = 10
_MIN_SHARE = 0.6
"""Share of the frames in which the floor must be found."""
_ON_FLOOR_M = 0.05
_BELOW_M = 0.15
_MAX_BELOW_SHARE = 0.04
"""So much below a plane is noise and mirrored light; more is the floor, below a table."""
_MIN_FLOOR_SHARE = 0.35
"""Share of the lower image that must be floor."""
_MAX_FROM_GRAVITY_RAD = math.radians(10.0)
_MAX_TILT_SCATTER_RAD = math.radians(2.0)
_MAX_HEIGHT_SCATTER_M = 0.06
_SIGMA_OF_MAD = 1.4826


@dataclass(frozen=True, slots=True, eq=False)
class _Look:
    """The floor of one frame."""

    levelling: Levelling
    up_from_gravity_rad: FloatArray | None


def calibrated_floor(frames: Iterable[Frame], intrinsics: CameraIntrinsics, now_s: float) -> FloorCalibration:
    """Return how the camera is held above the floor.

    Args:
        frames: of somebody who stands still, upright, and looks straight ahead, with free floor before them.
        intrinsics: of the depth images.
        now_s: the present time, seconds since 1970, to be noted.

    Raises:
        InputError: where there is no floor, too few frames, or the fit is ambiguous; the text says what to do.
    """
    looks: list[_Look] = []
    refusals: Counter[str] = Counter()
    for number, frame in enumerate(frames):
        look = _look(frame, intrinsics, number)
        if isinstance(look, str):
            refusals[look] += 1
        else:
            looks.append(look)
    frame_count = len(looks) + refusals.total()
    if frame_count < MIN_FRAMES:
        raise InputError(f"Only {frame_count} frames came, and {MIN_FRAMES} are needed: let the camera look longer.")
    if len(looks) < max(MIN_FRAMES, _MIN_SHARE * frame_count):
        raise InputError(
            f"The floor was found in {len(looks)} of {frame_count} frames only: {refusals.most_common(1)[0][0]}."
        )
    return _combined(looks, now_s)


def _look(frame: Frame, intrinsics: CameraIntrinsics, seed: int) -> _Look | str:
    """Return the floor of one frame, or why what was found may be none, and what to do."""
    levelling = level_by_floor(frame.depth_m, intrinsics, seed)
    if levelling is None:
        return "no plane below the camera can be the floor; look along free floor, not at a wall"
    low_m, high_m = HEIGHTS_M
    if not low_m <= levelling.height_m <= high_m:
        return (
            f"the largest plane is {levelling.height_m:.2f} m below the camera, where a table or a step would be;"
            f" wear the glasses ({low_m:g} to {high_m:g} m) and look along free floor"
        )
    floor_share, below_share = _shares(levelling, frame.depth_m, intrinsics)
    if below_share > _MAX_BELOW_SHARE:
        return "something lies below the plane that was found, as the floor does below a table; step away from it"
    if floor_share < _MIN_FLOOR_SHARE:
        return "less than a third of the lower picture is floor; turn to where more of it is free"
    if frame.gravity is None:
        return _Look(levelling, None)
    normal = levelling.level_from_camera[2]
    if angle_between_rad(normal, -frame.gravity) > _MAX_FROM_GRAVITY_RAD:
        return "the plane that was found is not level by the accelerometer; find a level floor, and keep still"
    return _Look(levelling, _rotation_between(-frame.gravity, normal))


def _shares(levelling: Levelling, depth_m: DepthImage, intrinsics: CameraIntrinsics) -> tuple[float, float]:
    """Return which shares of the lower image's points lie on the plane, and below it."""
    points = sampled_points(depth_m, intrinsics)
    above_m = points @ levelling.level_from_camera[2] + levelling.height_m
    slack_m = 0.01 * points[:, 2] ** 2
    on_floor = np.abs(above_m) < _ON_FLOOR_M + slack_m
    return float(on_floor.mean()), float((above_m < -_BELOW_M - slack_m).mean())


def _combined(looks: list[_Look], now_s: float) -> FloorCalibration:
    tilts = np.array([pitch_and_roll_rad(look.levelling) for look in looks])
    heights_m = np.array([look.levelling.height_m for look in looks])
    pitch_rad, pitch_sigma_rad = _median_and_sigma(tilts[:, 0])
    roll_rad, roll_sigma_rad = _median_and_sigma(tilts[:, 1])
    height_m, height_sigma_m = _median_and_sigma(heights_m)
    if max(pitch_sigma_rad, roll_sigma_rad) > _MAX_TILT_SCATTER_RAD or height_sigma_m > _MAX_HEIGHT_SCATTER_M:
        raise InputError(
            f"The frames do not agree (±{math.degrees(max(pitch_sigma_rad, roll_sigma_rad)):.1f}°,"
            f" ±{height_sigma_m:.2f} m): stand still, look straight ahead, and calibrate again."
        )
    felt = [look.up_from_gravity_rad for look in looks if look.up_from_gravity_rad is not None]
    # The frames without gravity are those before its filter has settled; too few with it tell nothing.
    offset = np.median(felt, axis=0) if len(felt) >= MIN_FRAMES else None
    return FloorCalibration(
        now_s, height_m, height_sigma_m, pitch_rad, pitch_sigma_rad, roll_rad, roll_sigma_rad, len(looks),
        None if offset is None else (float(offset[0]), float(offset[1]), float(offset[2])),
    )  # fmt: skip


def _median_and_sigma(values: FloatArray) -> tuple[float, float]:
    """Return the median, and the standard deviation of one value by the median absolute deviation."""
    median = float(np.median(values))
    return median, _SIGMA_OF_MAD * float(np.median(np.abs(values - median)))


def _rotation_between(one: FloatArray, other: FloatArray) -> FloatArray:
    """Return the shortest rotation vector (3,) from one direction to another."""
    axis = np.cross(one, other)
    length = float(np.linalg.norm(axis))
    if length < 1e-12:
        return np.zeros(3)
    vector: FloatArray = axis / length * angle_between_rad(one, other)
    return vector

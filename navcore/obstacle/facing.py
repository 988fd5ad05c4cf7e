"""Does the camera look where the walker walks? The way that was walked tells.

The floor says nothing of a camera, or a head, that is turned aside. Where somebody walks straight on, the direction of
the way less that of the optical axis does: ::

    leg       a metre of the way, walked at a walker's pace, with the camera looking in one direction
    offset    of a leg: heading of the camera less direction of the leg; left is positive

Heads turn, and places are known to a few centimetres, so one leg tells nothing: only the mean of several that follow
each other in one line counts. Whoever stands, turns, walks backwards, or is not located for sure, begins anew; that
neither confirms nor ends what was found. All that guidance says is relative to the camera, so who looks 20° aside and
walks by what they hear walks 20° aside: that is told, and it is for them to look ahead.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from navcore.angles import wrap_rad
from navcore.settings import CalibrationSettings
from navcore.types import Pose2D

LEG_M = 1.0
_SLOWEST_M_S = 0.3
_LONGEST_GAP_S = 1.0
_STRAIGHT_RAD = math.radians(12.0)
"""Legs that differ more in direction are no line; a camera that turns more within a leg looks nowhere."""
_BACKWARDS_RAD = math.radians(90.0)
_AGREES_AFTER_LEGS = 3
Sample = tuple[float, float, float, float]
"""Stamp (s), x and y (m), heading (rad)."""


@dataclass(frozen=True, slots=True)
class FacingWatch:
    """What is remembered of the way."""

    leg: tuple[Sample, ...] = ()
    """The leg that is being walked."""
    direction_rad: float | None = None
    """Of the leg before, where it was one."""
    offsets_rad: tuple[float, ...] = ()
    """Of the last legs in one line, oldest first."""
    turned: bool = False
    """The camera looks aside."""
    offset_rad: float = 0.0
    """How far it did when that was found; left is positive."""


def faced(watch: FacingWatch, stamp_s: float, pose: Pose2D | None, settings: CalibrationSettings) -> FacingWatch:
    """Take in where the walker is, and return what to remember.

    Args:
        watch: what this function returned last.
        stamp_s: when the picture was taken.
        pose: place and heading of the camera; None where they are not known for sure.
        settings: tolerance, and how many metres must tell of it.
    """
    if pose is None:
        return _anew(watch, ())
    sample = (stamp_s, pose.x_m, pose.y_m, pose.heading)
    if not watch.leg or not 0.0 < stamp_s - watch.leg[-1][0] <= _LONGEST_GAP_S:
        return _anew(watch, (sample,))
    watch = replace(watch, leg=(*watch.leg, sample))
    began_s, x_m, y_m, _ = watch.leg[0]
    if math.hypot(pose.x_m - x_m, pose.y_m - y_m) < LEG_M:
        return watch if stamp_s - began_s < LEG_M / _SLOWEST_M_S else _anew(watch, (sample,))
    direction_rad = math.atan2(pose.y_m - y_m, pose.x_m - x_m)
    offset_rad = _offset_rad(watch.leg, direction_rad)
    if offset_rad is None:
        return _anew(watch, (sample,))
    before_rad = watch.direction_rad
    in_line = before_rad is not None and abs(wrap_rad(direction_rad - before_rad)) <= _STRAIGHT_RAD
    needed = max(_AGREES_AFTER_LEGS, math.ceil(settings.turned_after_m / LEG_M))
    offsets_rad = (*(watch.offsets_rad if in_line else ()), offset_rad)[-needed:]
    watch = replace(watch, leg=(sample,), direction_rad=direction_rad, offsets_rad=offsets_rad)
    return _judged(watch, needed, math.radians(settings.yaw_tolerance_deg))


def _anew(watch: FacingWatch, leg: tuple[Sample, ...]) -> FacingWatch:
    return replace(watch, leg=leg, direction_rad=None, offsets_rad=())


def _offset_rad(leg: tuple[Sample, ...], direction_rad: float) -> float | None:
    """Return by how much the camera looked to the left of a leg; None where it looked about, or back."""
    offsets_rad = [wrap_rad(heading_rad - direction_rad) for _, _, _, heading_rad in leg]
    mean_rad = sum(offsets_rad) / len(offsets_rad)
    looks_about = max(abs(offset_rad - mean_rad) for offset_rad in offsets_rad) > _STRAIGHT_RAD
    return None if looks_about or abs(mean_rad) > _BACKWARDS_RAD else mean_rad


def _judged(watch: FacingWatch, needed: int, tolerance_rad: float) -> FacingWatch:
    if watch.turned:
        newest_rad = watch.offsets_rad[-_AGREES_AFTER_LEGS:]
        agrees = len(newest_rad) == _AGREES_AFTER_LEGS and abs(_mean(newest_rad)) <= tolerance_rad
        return replace(watch, turned=False, offset_rad=0.0) if agrees else watch
    mean_rad = _mean(watch.offsets_rad)
    is_turned = len(watch.offsets_rad) == needed and abs(mean_rad) > tolerance_rad
    return replace(watch, turned=True, offset_rad=mean_rad) if is_turned else watch


def _mean(values: tuple[float, ...]) -> float:
    return sum(values) / len(values)

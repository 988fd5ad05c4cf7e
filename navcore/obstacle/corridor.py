"""Whether a person fits: corridors of their width, in metres, in every direction of the scan.

The paper's reference [13] slides a window as wide in pixels as a person needs at δ, w = f W / δ; that is exact at δ
only.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from navcore.angles import relative_angle
from navcore.geometry import FloatArray
from navcore.settings import ObstacleSettings
from navcore.types import BearingState, CandidateDirection

_MAX_UNKNOWN_SHARE = 0.3
"""A direction with more unknown bearings than this, in the paper's window about it, is not walkable."""
_MAX_FREE_WIDTH_M = 3.0


def candidate_directions(
    bearing_rad: FloatArray,
    nearest_m: FloatArray,
    state: NDArray[np.int8],
    settings: ObstacleSettings,
    max_m: float,
    unseen: tuple[FloatArray, FloatArray] = (np.zeros(0), np.zeros(0)),
) -> tuple[CandidateDirection, ...]:
    """Return D: every direction, a few degrees apart, in which the corridor is free beyond the stop distance.

    Which of them are free far enough is the follower's to say: that depends on how far the sub-goal is. ``unseen`` are
    bearings (m,) and distances (m,) of what the image does not show and is there nevertheless.
    """
    if len(bearing_rad) == 0:
        return ()
    step_rad = math.radians(settings.candidate_step_deg)
    reach = int(max(-bearing_rad[0], bearing_rad[-1]) / step_rad)
    angles = np.asarray(np.arange(-reach, reach + 1) * step_rad, dtype=np.float64)
    along, aside = _in_corridor_axes(
        np.concatenate([bearing_rad, unseen[0]]), np.concatenate([nearest_m, unseen[1]]), angles
    )
    inside = (along > 0.0) & (np.abs(aside) < settings.person_width_m / 2)
    free_m = np.where(inside, along, max_m).min(axis=1, initial=max_m)
    walkable = _are_known(bearing_rad, state, angles, settings) & (free_m > settings.stop_distance_m)
    left_m, right_m = _free_sides_m(along, aside, np.minimum(free_m, settings.clearance_m))
    return tuple(
        CandidateDirection(relative_angle(float(angles[i])), float(free_m[i]), float(left_m[i] + right_m[i]))
        for i in np.flatnonzero(walkable).tolist()
    )


def clearance_ahead_m(bearing_rad: FloatArray, nearest_m: FloatArray, width_m: float, max_m: float) -> float:
    """Return how far a corridor of this width is free straight ahead, up to ``max_m``.

    Args:
        bearing_rad: bearings (n,).
        nearest_m: distance (n,) of what is nearest; inf where free, NaN where unknown.
        width_m: width of the corridor.
        max_m: farthest that is looked.
    """
    along, aside = _in_corridor_axes(bearing_rad, nearest_m, np.zeros(1))
    inside = (along > 0.0) & (np.abs(aside) < width_m / 2)
    return float(np.where(inside, along, max_m).min(initial=max_m))


def _are_known(
    bearing_rad: FloatArray, state: NDArray[np.int8], angles: FloatArray, settings: ObstacleSettings
) -> NDArray[np.bool_]:
    """Whether the window of a person's width at δ, about each direction, was seen; outside the image nothing was."""
    half_rad = math.asin(min(1.0, settings.person_width_m / 2 / settings.clearance_m))
    step_rad = float(bearing_rad[1] - bearing_rad[0]) if len(bearing_rad) > 1 else half_rad
    expected = max(1, int(2 * half_rad / step_rad))
    window = np.abs(bearing_rad - angles[:, None]) <= half_rad
    known = (window & (state != BearingState.UNKNOWN)).sum(axis=1)
    return np.asarray(known >= (1.0 - _MAX_UNKNOWN_SHARE) * expected)


def _free_sides_m(along: FloatArray, aside: FloatArray, distance_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return how wide the way is, left and right of each direction, up to a distance along it."""
    beside = (along > 0.0) & (along < distance_m[:, None])
    most_m = _MAX_FREE_WIDTH_M / 2
    left = np.where(beside & (aside >= 0.0), aside, most_m).min(axis=1, initial=most_m)
    right = np.where(beside & (aside < 0.0), -aside, most_m).min(axis=1, initial=most_m)
    return left, right


def _in_corridor_axes(
    bearing_rad: FloatArray, nearest_m: FloatArray, angles: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return where obstacles are along and aside of each direction (k, n); what is free or unknown is nowhere."""
    seen = np.isfinite(nearest_m)
    turned = bearing_rad[seen] - angles[:, None]
    return nearest_m[seen] * np.cos(turned), nearest_m[seen] * np.sin(turned)

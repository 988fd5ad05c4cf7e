"""The policy ``road_centred`` round what stands on the road: a line beside the road's middle, and back to it.

Where nothing is in the way the line is the road itself. Where something is, lines at other distances from the middle
are tried, each led over from where the walker is now: the one nearest to the middle that is free is followed, and one
that leaves more room is worth a little. Lines are judged by all that is known, what is remembered beside the image
included, so that nobody is led back into what they have just been led round. (Lateral offsets of a reference line, as
M. Werling et al., "Optimal trajectory generation for dynamic street scenarios in a Frenet frame", ICRA 2010.)

Whether the direction to the line may be walked is not decided here: Eq. 4 and the gate decide. Pure functions.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from navcore.angles import wrap_rad
from navcore.geometry import FloatArray
from navcore.polar import placed
from navcore.types import ObstacleScan, Pose2D, Route

_SEEN_M = 3.5
"""Farther ahead nothing is gone round yet."""
_FREE_M, _STILL_FREE_M = 1.6, 1.3
"""A line must be free for this at least, or it leads nowhere; one that is followed already, for less."""
_FARTHEST_M, _STEP_M = 1.2, 0.1
_LED_OVER_M = (1.6, 0.8, 0.4)
"""Along the road, from where the walker is to the line: gently; steeply only for who stands before something."""
_BESIDE_VIEW_RAD = math.radians(8.0)
_ROOMY_M = 0.12
"""Room beside a person's own width that is worth a detour."""
_CROWDED_COST, _BLOCKED_COST, _CHANGE_COST, _OTHER_SIDE_COST = 0.4, 8.0, 0.3, 1.5


@dataclass(frozen=True, slots=True)
class Line:
    """Where to go beside the road."""

    offset_m: float
    """Left of the road's middle."""
    x_m: float
    y_m: float
    """The point of the line that is walked to now."""


def line_beside(
    route: Route,
    closest_index: int,
    until_index: int,
    pose: Pose2D,
    scan: ObstacleScan,
    ahead_m: float,
    half_width_m: float,
    last_offset_m: float,
) -> Line | None:
    """Return the line to follow, or None where the road itself is free, or nothing beside it is.

    Args:
        route: the paper's W.
        closest_index: P_cls.
        until_index: point of the route up to which the road goes on without a sharp corner.
        pose: where the walker is.
        scan: what is known to be in the way.
        ahead_m: how far ahead on the line the walker is led to.
        half_width_m: half of a person's width.
        last_offset_m: the line of the frame before; 0 for the road itself.
    """
    arcs = route.arc_length_m
    last = min(int(np.searchsorted(arcs, float(arcs[closest_index]) + _SEEN_M)), until_index, len(arcs) - 1)
    if last - closest_index < 2:
        return None
    road, left = _stations(route, closest_index, last)
    stations_m = np.asarray(arcs[closest_index : last + 1] - arcs[closest_index], dtype=np.float64)
    along_m, aside_m = _on_road(known_places_m(scan, pose), road, left, stations_m)
    if not len(along_m):
        return None
    here_m = float((np.array([pose.x_m, pose.y_m]) - road[0]) @ left[0])
    middle_m = _free_m(np.zeros(1), here_m, along_m, aside_m, half_width_m, float(stations_m[-1]), _LED_OVER_M[0])
    if middle_m[0] >= stations_m[-1] and last_offset_m == 0.0:
        return None
    # Who has not begun to go round goes on to the side that they drift to.
    towards_m = last_offset_m if last_offset_m != 0.0 else here_m + float(left[0] @ _unit(pose.heading))
    for led_over_m in _LED_OVER_M:
        offset_m = _best_offset_m(
            here_m, along_m, aside_m, half_width_m, float(stations_m[-1]), led_over_m, last_offset_m, towards_m
        )
        if offset_m is not None:
            line = _point_on(offset_m, here_m, road, left, stations_m, min(ahead_m, led_over_m), led_over_m)
            return line if offset_m != 0.0 and _is_in_view(line, pose, scan) else None
    return None


def _is_in_view(line: Line, pose: Pose2D, scan: ObstacleScan) -> bool:
    """Whether the image shows, or nearly so, where a line leads: what nobody has looked at is not free."""
    if not len(scan.bearing_rad):
        return False
    bearing_rad = wrap_rad(direction_rad(line, pose) - pose.heading)
    return bool(scan.bearing_rad[0] - _BESIDE_VIEW_RAD <= bearing_rad <= scan.bearing_rad[-1] + _BESIDE_VIEW_RAD)


def _best_offset_m(
    here_m: float, along_m: FloatArray, aside_m: FloatArray, half_width_m: float, length_m: float, led_over_m: float,
    last_offset_m: float, towards_m: float,
) -> float | None:  # fmt: skip
    """Return the line to follow; 0 for the road itself, None where no line is free for long enough."""
    offsets_m = np.round(np.arange(-_FARTHEST_M, _FARTHEST_M + _STEP_M / 2, _STEP_M), 6)
    free_m = _free_m(offsets_m, here_m, along_m, aside_m, half_width_m, length_m, led_over_m)
    roomy_m = _free_m(offsets_m, here_m, along_m, aside_m, half_width_m + _ROOMY_M, length_m, led_over_m)
    cost = (
        np.abs(offsets_m)
        + _CHANGE_COST * np.abs(offsets_m - towards_m)
        + _OTHER_SIDE_COST * (offsets_m * last_offset_m < 0.0)
        + _CROWDED_COST * (roomy_m < free_m)
        + _BLOCKED_COST * (length_m - free_m) / length_m
    )
    cost[free_m < min(_STILL_FREE_M if last_offset_m != 0.0 else _FREE_M, length_m)] = np.inf
    best = int(np.argmin(cost))
    return float(offsets_m[best]) if np.isfinite(cost[best]) else None


def _unit(angle_rad: float) -> FloatArray:
    return np.array([math.cos(angle_rad), math.sin(angle_rad)])


def known_places_m(scan: ObstacleScan, pose: Pose2D) -> FloatArray:
    """Return the places (k, 2) in the world of all that is known to be in the way, in the image and beside it."""
    seen = np.isfinite(scan.nearest_m)
    bearing_rad = np.concatenate([scan.bearing_rad[seen], scan.unseen_rad])
    return placed(pose, bearing_rad, np.concatenate([scan.nearest_m[seen], scan.unseen_m]))


def _stations(route: Route, first: int, last: int) -> tuple[FloatArray, FloatArray]:
    """Return points (n, 2) of the road ahead, and the unit vectors (n, 2) to its left there."""
    points = route.points_m
    step = points[np.minimum(np.arange(first, last + 1) + 2, len(points) - 1)]
    step = step - points[np.maximum(np.arange(first, last + 1) - 2, 0)]
    tangent = step / np.maximum(np.hypot(step[:, 0], step[:, 1]), 1e-9)[:, None]
    return points[first : last + 1], np.stack([-tangent[:, 1], tangent[:, 0]], axis=1)


def _on_road(
    places_m: FloatArray, road: FloatArray, left: FloatArray, stations_m: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return how far along the road (k,) and left of it (k,) places lie; those behind or beyond are left out."""
    offset = places_m[:, None, :] - road[None]
    nearest = np.argmin((offset**2).sum(axis=2), axis=1)
    aside_m = (offset[np.arange(len(places_m)), nearest] * left[nearest]).sum(axis=1)
    inside = (nearest > 0) & (nearest < len(road) - 1) & (np.abs(aside_m) < 2.0 * _FARTHEST_M)
    return stations_m[nearest][inside], aside_m[inside]


def _free_m(
    offsets_m: FloatArray, here_m: float, along_m: FloatArray, aside_m: FloatArray, half_width_m: float, most_m: float,
    led_over_m: float,
) -> FloatArray:  # fmt: skip
    """Return how far (n,) lines at offsets are free, along the road; they begin where the walker is."""
    share = np.minimum(along_m / led_over_m, 1.0)
    line_m = here_m + (offsets_m[:, None] - here_m) * share
    hit = np.abs(aside_m - line_m) < half_width_m
    return np.asarray(np.where(hit, along_m, most_m).min(axis=1, initial=most_m))


def _point_on(
    offset_m: float, here_m: float, road: FloatArray, left: FloatArray, stations_m: FloatArray, ahead_m: float,
    led_over_m: float,
) -> Line:  # fmt: skip
    at = min(int(np.searchsorted(stations_m, ahead_m)), len(road) - 1)
    share = min(float(stations_m[at]) / led_over_m, 1.0)
    x_m, y_m = road[at] + (here_m + (offset_m - here_m) * share) * left[at]
    return Line(offset_m, float(x_m), float(y_m))


def direction_rad(line: Line, pose: Pose2D) -> float:
    """Return the direction in the world from the walker to the point of the line."""
    return math.atan2(line.y_m - pose.y_m, line.x_m - pose.x_m)

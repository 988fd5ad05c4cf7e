"""What comes towards the walker: how fast each bearing closes, the walker's own movement taken out by the pose.

The paper claims "dynamic obstacles" and names no method. Here a scan is compared with one of a moment before: what
stands where the floor was seen to be free has moved there. What was at its old place has gone from there, or is hidden
behind it now; the difference of the distances is how fast it comes. Depth noise and a trembling pose make slow things
of what stands, so they count as standing.

What comes is then taken to be where it will be when the walker has reacted (:func:`anticipated`): the same checks as
for everything else stop the walker, or lead them aside, that much earlier. It only ever gets less free by that.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from navcore.geometry import FloatArray
from navcore.obstacle.corridor import candidate_directions, clearance_ahead_m
from navcore.obstacle.memory import bearing_index
from navcore.obstacle.polar_grid import MAX_RANGE_M
from navcore.polar import placed, seen_from
from navcore.settings import ObstacleSettings
from navcore.types import ObstacleScan, Pose2D

_COMPARED_AFTER_S, _COMPARED_AT_MOST_S = 0.5, 0.9
"""Over a shorter time, noise of 2 cm is a speed; over a longer one, somebody has come and gone."""
_FREE_MARGIN_M = 0.2
"""A place was free where the scan before saw so far beyond it."""
_NEIGHBOURS = 2
"""Bearings to either side that are looked at as well: edges tremble."""
_FEWEST_BEARINGS = 3
_FASTEST_M_S = 2.5
"""What seems to come faster, a runner or two different things, counts as coming so fast."""
_SLOWEST_M_S = 0.3
_BODY_M = 0.4
"""Neighbouring bearings that differ by more than this show different things."""
_ASIDE_RAD = math.radians(4.0)
_TALL_M = 0.6
"""What is lower, and the edge of a drop, does not come by itself."""


@dataclass(frozen=True, slots=True, eq=False)
class SeenBefore:
    """A scan of a moment ago, and from where."""

    stamp_s: float
    pose: Pose2D
    scan: ObstacleScan


RecentScans = tuple[SeenBefore, ...]
"""Oldest first; the newest is the present one."""


def with_scan(recent: RecentScans, scan: ObstacleScan, pose: Pose2D, now_s: float) -> RecentScans:
    """Return the scans of the last moments, with this one."""
    kept = (each for each in recent if 0.0 < now_s - each.stamp_s <= _COMPARED_AT_MOST_S)
    return (*kept, SeenBefore(now_s, pose, scan))


def closing_speed_m_s(recent: RecentScans) -> FloatArray:
    """Return how fast (n,) what is nearest in each bearing of the newest scan comes towards its place.

    Metres per second in the world, so that walking towards a wall is no approach; 0 where it stands, goes away, or
    nobody can tell. At most 2.5 m/s.
    """
    if not recent:
        return np.zeros(0)
    now = recent[-1]
    speed_m_s = np.zeros(len(now.scan.bearing_rad))
    before = _compared_with(recent)
    if before is None or len(now.scan.bearing_rad) < _FEWEST_BEARINGS or len(before.scan.bearing_rad) < 2:
        return speed_m_s
    duration_s = now.stamp_s - before.stamp_s
    old = _points_m(before)
    old_bearing_rad, old_range_m = seen_from(now.pose, old)
    vanished = _was_free(now.scan, old_bearing_rad, old_range_m)
    for first, end in _groups(now.scan.nearest_m, _has_come(now, before)):
        cluster = slice(first, end)
        middle_rad = float(np.mean(now.scan.bearing_rad[cluster]))
        range_m = float(np.median(now.scan.nearest_m[cluster]))
        gone = vanished & _near(middle_rad, range_m, old_bearing_rad, old_range_m, _FASTEST_M_S * duration_s + _BODY_M)
        if np.count_nonzero(gone) >= _FEWEST_BEARINGS:
            was_m = float(np.median(old_range_m[gone]))
        else:
            was_m = _behind_m(now.scan.bearing_rad[cluster], range_m, old_bearing_rad, old_range_m)
        closing_m_s = (was_m - range_m) / duration_s
        if _SLOWEST_M_S <= closing_m_s < math.inf:
            speed_m_s[cluster] = min(closing_m_s, _FASTEST_M_S)
    return speed_m_s


def anticipated(scan: ObstacleScan, speed_m_s: FloatArray, settings: ObstacleSettings) -> ObstacleScan:
    """Return the scan as it will be when the walker has reacted, with the speed (n,) of what comes.

    Nothing is farther away in it than it is now.
    """
    scan = replace(scan, closing_m_s=speed_m_s)
    if not speed_m_s.any():
        return scan
    nearest_m = np.maximum(scan.nearest_m - np.maximum(speed_m_s, 0.0) * settings.approach_horizon_s, 0.0)
    ahead_m = clearance_ahead_m(scan.bearing_rad, nearest_m, settings.person_width_m, MAX_RANGE_M)
    return replace(
        scan,
        nearest_m=nearest_m,
        candidates=candidate_directions(scan.bearing_rad, nearest_m, scan.state, settings, MAX_RANGE_M),
        nearest_ahead_m=ahead_m if ahead_m < MAX_RANGE_M else None,
    )


def _compared_with(recent: RecentScans) -> SeenBefore | None:
    """Return the newest scan that is old enough to tell a movement from noise."""
    now_s = recent[-1].stamp_s
    old = [each for each in recent if now_s - each.stamp_s >= _COMPARED_AFTER_S - 1e-6]
    return old[-1] if old else None


def _has_come(now: SeenBefore, before: SeenBefore) -> NDArray[np.bool_]:
    """Return in which bearings (n,) something stands where the scan before saw that nothing stood."""
    known = np.isfinite(now.scan.nearest_m)
    points = _points_m(now)
    bearing_rad, range_m = seen_from(before.pose, points)
    come = np.zeros(len(known), np.bool_)
    come[known] = _was_free(before.scan, bearing_rad, range_m)
    return come & (now.scan.top_m >= _TALL_M)


def _was_free(scan: ObstacleScan, bearing_rad: FloatArray, range_m: FloatArray) -> NDArray[np.bool_]:
    """Whether a scan saw beyond places (k,) on all bearings about them; what it did not see does not count."""
    at, last = bearing_index(scan, bearing_rad), len(scan.bearing_rad) - 1
    around = np.clip(at[:, None] + np.arange(-_NEIGHBOURS, _NEIGHBOURS + 1), 0, last)
    # NaN, unknown, is as near as can be: it shows nothing to be free.
    nearest_m = np.nan_to_num(scan.nearest_m, nan=-np.inf, posinf=np.inf)[around].min(axis=1)
    return np.asarray((at >= 0) & (nearest_m > range_m + _FREE_MARGIN_M))


def _groups(nearest_m: FloatArray, which: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return the runs (first, end) of neighbouring bearings that show one thing, if they are wide enough."""
    groups, first = [], -1
    for i in range(len(which) + 1):
        goes_on = i < len(which) and which[i] and (first < 0 or abs(nearest_m[i] - nearest_m[i - 1]) <= _BODY_M)
        if goes_on:
            first = i if first < 0 else first
            continue
        if first >= 0 and i - first >= _FEWEST_BEARINGS:
            groups.append((first, i))
        first = i if i < len(which) and which[i] else -1
    return groups


def _near(
    middle_rad: float, range_m: float, bearing_rad: FloatArray, at_m: FloatArray, within_m: float
) -> NDArray[np.bool_]:
    """Return which places (k,) lie within a distance of a thing's middle."""
    dx = at_m * np.cos(bearing_rad) - range_m * math.cos(middle_rad)
    dy = at_m * np.sin(bearing_rad) - range_m * math.sin(middle_rad)
    return np.asarray(np.hypot(dx, dy) <= within_m)


def _behind_m(cluster_rad: FloatArray, range_m: float, bearing_rad: FloatArray, at_m: FloatArray) -> float:
    """Return the distance of the nearest thing that was seen before in the bearings of a thing, behind it; inf if none.

    It is hidden behind the thing now: the thing itself, at its old place, or a wall, and then far behind.
    """
    behind = (bearing_rad > cluster_rad[0] - _ASIDE_RAD) & (bearing_rad < cluster_rad[-1] + _ASIDE_RAD)
    return float(at_m[behind & (at_m > range_m)].min(initial=np.inf))


def _points_m(seen: SeenBefore) -> FloatArray:
    """Return the places (k, 2) of what was seen, metres, in the map."""
    known = np.isfinite(seen.scan.nearest_m)
    return placed(seen.pose, seen.scan.bearing_rad[known], seen.scan.nearest_m[known])

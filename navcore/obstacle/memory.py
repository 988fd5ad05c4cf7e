"""What was seen to be in the way a moment ago and is out of the image now, at the walker's feet or beside them.

A camera at eye height sees nothing low that is nearer than about 1.8 m, and a walker who turns loses sight of what is
beside them. So what a scan has found is kept for a while, in the map, with its height. It is forgotten where the image
would show it and does not (somebody has walked on), and in the course of time. Time does not count against something
low that stands where the image cannot show it: that is in the way until it was looked at, or is far away. What is
remembered only ever closes a direction: nothing becomes free by being forgotten that the present image does not show
to be free.

What the rangefinder alone has heard (glass) is remembered apart (:func:`remember_heard`), for no image shows that it
has gone: somebody who has turned away from a pane would be sent back into it, since their camera sees a free way.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from navcore.geometry import FloatArray
from navcore.obstacle.corridor import candidate_directions, clearance_ahead_m
from navcore.obstacle.polar_grid import MAX_RANGE_M
from navcore.polar import placed, seen_from
from navcore.settings import ObstacleSettings
from navcore.types import BearingState, ObstacleScan, Pose2D

CELL_M = 0.1
_KEPT_WITHIN_M = 3.0
"""Farther away nothing is taken up, and what was taken up is forgotten: it will be seen again."""
_LOW_M = 1.3
"""What is lower than this does not walk away, and can vanish below the image while one walks up to it."""
_FORGOTTEN_AFTER_S, _TALL_FORGOTTEN_AFTER_S = 20.0, 2.0
_STANDING_FORGOTTEN_AFTER_S = 120.0
"""For what is low, counted while the image shows the place. Who stands before it cannot see whether it is still there,
however long they stand: it is in the way until they have stepped back and looked."""
_STANDS_COUNT = 6
"""What was seen in one place in so many frames stands there, however tall it is: a chair, a cupboard."""
_SAME_THING_CELLS = 2
"""So near to a place where something low stands, what was seen at all is taken for its edge."""
_SEEN_TWICE = 2
"""Frames in which something must have been seen before it counts without being seen: noise is nowhere twice."""
_GONE_MARGIN_M = 0.3
_HEARD_FORGOTTEN_AFTER_S, _HEARD_OFTEN_FORGOTTEN_AFTER_S = 8.0, 40.0
_HEARD_OFTEN = 4
"""Who goes round a pane has it beside them, where nothing hears it, for as long as that takes."""
_HEARD_WITHIN_M = 2.6
_HEARD_BESIDE_M = 0.25
"""What is heard may reach so far beyond the ultrasonic field: a pane has no edge that could be heard."""
_SILENT_FOR_S = 0.5
"""An echo that fails to come once or twice says nothing: a pane that is met aslant returns few."""
_UNSEEN_MARGIN_M = 0.4
"""An echo that is so much nearer than all that the image shows about it comes from what the image does not show."""
_ABOUT_RAD = math.radians(10.0)
_INSIDE_IMAGE = 0.95
_HIDDEN_MARGIN_M, _HIDDEN_WITHIN_M = 0.2, 1.8
"""What is hidden is so much nearer than all that the image shows, and no farther than where the image begins."""
_MAX_PLACES = 4000
_HEARD_TOP_M = math.inf


@dataclass(frozen=True, slots=True, eq=False)
class ObstacleMemory:
    """Places on the floor (k, 2), in cells, where something stood, or the floor ended."""

    cell: NDArray[np.int64] = field(default_factory=lambda: np.zeros((0, 2), np.int64))
    top_m: FloatArray = field(default_factory=lambda: np.zeros(0))
    """Height (k,); 0 for a drop, inf for what was only heard."""
    seen_s: FloatArray = field(default_factory=lambda: np.zeros(0))
    """When (k,) it was last seen, or it could not be seen whether it was there."""
    seen_count: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))

    @property
    def places_m(self) -> FloatArray:
        """Middles (k, 2) of the cells, metres, in the map."""
        return np.asarray((self.cell + 0.5) * CELL_M, dtype=np.float64)

    def and_also(self, other: ObstacleMemory) -> ObstacleMemory:
        """Return both."""
        return ObstacleMemory(
            np.concatenate([self.cell, other.cell]), np.concatenate([self.top_m, other.top_m]),
            np.concatenate([self.seen_s, other.seen_s]), np.concatenate([self.seen_count, other.seen_count]),
        )  # fmt: skip

    def kept(self, which: NDArray[np.bool_]) -> ObstacleMemory:
        """Return some of it."""
        return ObstacleMemory(self.cell[which], self.top_m[which], self.seen_s[which], self.seen_count[which])


def remember(memory: ObstacleMemory, scan: ObstacleScan, pose: Pose2D, now_s: float) -> ObstacleMemory:
    """Return what is remembered after a scan at a pose: the old that may still be there, and the new."""
    memory = _may_be_there(memory, scan, pose, now_s)
    near = np.isfinite(scan.nearest_m) & (scan.nearest_m < _KEPT_WITHIN_M)
    points = placed(pose, scan.bearing_rad[near], scan.nearest_m[near])
    fresh = ObstacleMemory(
        np.floor(points / CELL_M).astype(np.int64), scan.top_m[near],
        np.full(len(points), now_s), np.ones(len(points), np.int64),
    )  # fmt: skip
    return _merged(memory, fresh)


def remember_heard(
    heard: ObstacleMemory, scan: ObstacleScan, echo_m: float | None, half_field_rad: float, pose: Pose2D, now_s: float,
    looks_rad: float = 0.0,
) -> ObstacleMemory:  # fmt: skip
    """Return what is remembered of the echoes that nothing in the image explains.

    An echo says how far, not where in the ultrasonic field: all of the arc is kept, until the rangefinder, turned to
    it, hears farther.

    Args:
        heard: what this function returned last.
        scan: the present one, as the image shows it.
        echo_m: d_ultra; None without a working rangefinder.
        half_field_rad: half of the ultrasonic field.
        pose: where the walker is.
        now_s: the present time.
        looks_rad: the direction of the rangefinder's axis, to the left of the camera's.
    """
    bearing_rad, range_m = seen_from(pose, heard.places_m)
    often = heard.seen_count >= _HEARD_OFTEN
    patience_s = np.where(often, _HEARD_OFTEN_FORGOTTEN_AFTER_S, _HEARD_FORGOTTEN_AFTER_S)
    kept = (np.abs(now_s - heard.seen_s) <= patience_s) & (range_m < _KEPT_WITHIN_M)
    if echo_m is None:
        return heard.kept(kept)
    # Right beside the field nothing is heard either: there may be the edge of a pane.
    silent = (np.abs(bearing_rad - looks_rad) < half_field_rad) & (range_m < echo_m - _GONE_MARGIN_M)
    heard = heard.kept(kept & ~(silent & (now_s - heard.seen_s > _SILENT_FOR_S)))
    about = np.abs(scan.bearing_rad - looks_rad) <= _ABOUT_RAD
    shown_m = float(np.nan_to_num(scan.nearest_m[about], nan=np.inf).min(initial=np.inf))
    if echo_m >= _HEARD_WITHIN_M or shown_m < echo_m + _UNSEEN_MARGIN_M:
        return heard
    half_arc_rad = half_field_rad + _HEARD_BESIDE_M / max(echo_m, _HEARD_BESIDE_M)
    count = 2 + int(2.0 * half_arc_rad * echo_m / CELL_M)
    points = placed(pose, looks_rad + np.linspace(-half_arc_rad, half_arc_rad, count), np.full(count, echo_m))
    cells = np.unique(np.floor(points / CELL_M).astype(np.int64), axis=0)
    top_m = np.full(len(cells), _HEARD_TOP_M)
    return _merged(heard, ObstacleMemory(cells, top_m, np.full(len(cells), now_s), np.ones(len(cells), np.int64)))


def with_memory(scan: ObstacleScan, memory: ObstacleMemory, pose: Pose2D, settings: ObstacleSettings) -> ObstacleScan:
    """Return the scan with what is remembered and not in the image; it only ever gets less free.

    A bearing of the image is closed where something remembered is nearer than what is seen; directions are tested
    against what is remembered beside the image as well.
    """
    sure = memory.kept(memory.seen_count >= _SEEN_TWICE)
    bearing_rad, range_m = seen_from(pose, sure.places_m)
    if not len(range_m) or not len(scan.bearing_rad):
        return scan
    nearest_m, state = _closed(scan, bearing_rad, range_m, sure.top_m)
    everywhere = np.concatenate([scan.bearing_rad, bearing_rad]), np.concatenate([nearest_m, range_m])
    ahead_m = clearance_ahead_m(*everywhere, settings.person_width_m, MAX_RANGE_M)
    return replace(
        scan,
        nearest_m=nearest_m,
        state=state,
        candidates=candidate_directions(
            scan.bearing_rad, nearest_m, state, settings, MAX_RANGE_M, (bearing_rad, range_m)
        ),
        nearest_ahead_m=ahead_m if ahead_m < MAX_RANGE_M else None,
        unseen_rad=bearing_rad,
        unseen_m=range_m,
    )


def is_hidden_ahead(scan: ObstacleScan, memory: ObstacleMemory, pose: Pose2D, settings: ObstacleSettings) -> bool:
    """Return whether the nearest thing straight ahead is remembered, where no image shows whether it is still there."""
    sure = memory.kept(memory.seen_count >= _SEEN_TWICE)
    bearing_rad, range_m = seen_from(pose, sure.places_m)
    out_of_sight = np.isnan(_shown_m(scan, bearing_rad, range_m, sure.top_m))
    hidden_m = clearance_ahead_m(
        bearing_rad[out_of_sight], range_m[out_of_sight], settings.person_width_m, MAX_RANGE_M
    )  # fmt: skip
    shown_m = MAX_RANGE_M if scan.nearest_ahead_m is None else scan.nearest_ahead_m
    return hidden_m < min(shown_m - _HIDDEN_MARGIN_M, _HIDDEN_WITHIN_M)


def _closed(
    scan: ObstacleScan, bearing_rad: FloatArray, range_m: FloatArray, top_m: FloatArray
) -> tuple[FloatArray, NDArray[np.int8]]:
    """Return distance and state of the image's bearings, with what is remembered in them."""
    nearest_m, state = scan.nearest_m.copy(), scan.state.copy()
    index = bearing_index(scan, bearing_rad)
    for k in np.flatnonzero(index >= 0).tolist():
        i = index[k]
        # NaN, unknown, is not nearer: something known to be there makes it known to be closed.
        if not nearest_m[i] <= range_m[k]:
            nearest_m[i] = range_m[k]
            state[i] = _state_of(float(top_m[k]))
    return nearest_m, state


def _state_of(top_m: float) -> BearingState:
    if top_m == _HEARD_TOP_M:
        return BearingState.HEARD
    return BearingState.OBSTACLE if top_m > 0.0 else BearingState.DROP


def _may_be_there(memory: ObstacleMemory, scan: ObstacleScan, pose: Pose2D, now_s: float) -> ObstacleMemory:
    """Return what is neither too old, nor too far away, nor seen to be gone now.

    What is low and stands there does not grow old where the image cannot show it: that time has passed says nothing.
    """
    bearing_rad, range_m = seen_from(pose, memory.places_m)
    shown_m = _shown_m(scan, bearing_rad, range_m, memory.top_m)
    low, stands = memory.top_m < _LOW_M, memory.seen_count >= _STANDS_COUNT
    stands |= _is_part(memory, low, stands)
    # What is unknown now (NaN) neither shows that anything has gone, nor that it is there.
    gone, is_shown = shown_m > range_m + _GONE_MARGIN_M, shown_m > range_m - _GONE_MARGIN_M
    memory = replace(memory, seen_s=np.where(low & stands & ~is_shown, now_s, memory.seen_s))
    patience_s = np.where(low, _FORGOTTEN_AFTER_S, _TALL_FORGOTTEN_AFTER_S)
    patience_s[stands] = _STANDING_FORGOTTEN_AFTER_S
    young = np.abs(now_s - memory.seen_s) <= patience_s
    return memory.kept(young & (range_m < _KEPT_WITHIN_M) & ~gone)


def _is_part(memory: ObstacleMemory, low: NDArray[np.bool_], stands: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which places (k,) belong to something low that stands there: its edges are seen less often than it is."""
    part = np.zeros(len(low), np.bool_)
    edges = low & ~stands & (memory.seen_count >= _SEEN_TWICE)
    away = np.abs(memory.cell.T[:, edges, None] - memory.cell.T[:, None, low & stands])
    part[edges] = (away <= _SAME_THING_CELLS).all(axis=0).any(axis=1)
    return part


def _shown_m(scan: ObstacleScan, bearing_rad: FloatArray, range_m: FloatArray, top_m: FloatArray) -> FloatArray:
    """Return how far (k,) the image shows what is as high as something remembered, in its bearing.

    NaN where it lies beside the image or below it, or the bearing is unknown.
    """
    index = bearing_index(scan, bearing_rad)
    shown_m = np.full(len(range_m), np.nan)
    for_image = np.flatnonzero(index >= 0)
    at = index[for_image]
    down = (scan.eye_m - top_m[for_image]) / np.maximum(range_m[for_image], 1e-6)
    inside = down < _INSIDE_IMAGE * scan.steepest[at]
    shown_m[for_image[inside]] = scan.nearest_m[at[inside]]
    return shown_m


def bearing_index(scan: ObstacleScan, bearing_rad: FloatArray) -> NDArray[np.intp]:
    """Return which bearing of the scan each one (k,) falls in; −1 beside the image."""
    if len(scan.bearing_rad) < 2:
        return np.full(len(bearing_rad), -1, np.intp)
    step_rad = float(scan.bearing_rad[1] - scan.bearing_rad[0])
    at = np.rint((bearing_rad - scan.bearing_rad[0]) / step_rad).astype(np.intp)
    return np.where((at >= 0) & (at < len(scan.bearing_rad)), at, -1)


def _merged(old: ObstacleMemory, new: ObstacleMemory) -> ObstacleMemory:
    """Return both; a cell that is in both has been seen once more, and is as high as it was ever seen to be."""
    cells, place = np.unique(np.concatenate([old.cell, new.cell]), axis=0, return_inverse=True)
    place = place.reshape(-1)
    was, now = place[: len(old.cell)], place[len(old.cell) :]
    top_m, seen_s, count = np.zeros(len(cells)), np.full(len(cells), -np.inf), np.zeros(len(cells), np.int64)
    top_m[was], seen_s[was], count[was] = old.top_m, old.seen_s, old.seen_count
    np.maximum.at(top_m, now, new.top_m)
    seen_s[now] = new.seen_s
    count[np.unique(now)] += 1
    merged = ObstacleMemory(cells, top_m, seen_s, count)
    if len(cells) <= _MAX_PLACES:
        return merged
    return merged.kept(seen_s >= np.partition(seen_s, -_MAX_PLACES)[-_MAX_PLACES])

"""What the overlay draws into the world: the way on the floor, the sub-goal, and the edges of what is near. Pure.

Points are metres ahead, to the left, and above the floor; :class:`Head` takes them to the displays.
"""

from __future__ import annotations

import math

import numpy as np

from navcore.cues.overlay_display import Head, Ink
from navcore.cues.overlay_shapes import Area, Label, Line, Shape
from navcore.cues.overlay_signs import metres
from navcore.geometry import FloatArray
from navcore.types import BearingState, DecisionTrace, ObstacleScan, SubGoalCase

_ARROW_FROM_M, _ARROW_LENGTH_M = 3.05, 2.8
"""The displays show the floor from here on."""
_STRIPE_M, _STRIPE_STEP_M, _STRIPES = 0.26, 0.5, 3
_ARROW_HALF_WIDTH_M, _HEAD_HALF_WIDTH_M, _HEAD_M = 0.26, 0.46, 1.2
_POST_M, _RING_M = 0.85, 0.32
_LABEL_ASIDE_M = 0.34
_NEAREST_DRAWN_M = 0.4
"""What is nearer than this cannot be looked at with both eyes."""
_EDGE_STEP_M = 0.35
"""Bearings whose distances differ by more than this do not belong to the same thing."""
_LEAST_RUN = 2
_TOOTH_M = 0.18
_HATCH_EVERY = 2
_LABEL_RAD = math.radians(11.0)
"""Farther aside, the figure would lie under the sign of the next turn."""


def arrow_on_floor(head: Head, direction_rad: float) -> list[Shape]:
    """Return stripes and an arrow head on the floor ahead, bent so that the head points in the direction."""
    begins_m = _STRIPE_STEP_M * np.arange(_STRIPES)
    shapes: list[Shape] = []
    half, tip = _ARROW_HALF_WIDTH_M, 0.22
    for begin_m in begins_m:
        end_m = begin_m + _STRIPE_M
        stripe = [(begin_m, half), (begin_m + tip, 0.0), (begin_m, -half), (end_m, -half), (end_m + tip, 0.0),
                  (end_m, half)]  # fmt: skip
        shapes.append(Area(head.seen(_along_bend(np.array(stripe), direction_rad)), Ink.WAY))
    base_m = _ARROW_LENGTH_M - _HEAD_M
    triangle = [
        (base_m, _HEAD_HALF_WIDTH_M),
        (_ARROW_LENGTH_M, 0.0),
        (base_m, -_HEAD_HALF_WIDTH_M),
        (base_m + 0.2, 0.0),
    ]
    shapes.append(Area(head.seen(_along_bend(np.array(triangle), direction_rad)), Ink.WAY))
    return shapes


def _along_bend(strip: FloatArray, direction_rad: float) -> FloatArray:
    """Return points (n, 3) of a straight strip (n, 2: along it, left of it) laid on the bent way."""
    fine_m = np.linspace(0.0, _ARROW_LENGTH_M, 33)
    share = np.clip(fine_m / (_ARROW_LENGTH_M - _HEAD_M), 0.0, 1.0)
    angles = direction_rad * share * share * (3.0 - 2.0 * share)
    step_m = fine_m[1]
    ahead_m = _ARROW_FROM_M + np.concatenate([[0.0], np.cumsum(np.cos(angles[:-1]) * step_m)])
    left_m = np.concatenate([[0.0], np.cumsum(np.sin(angles[:-1]) * step_m)])
    at = strip[:, 0]
    angle = np.interp(at, fine_m, angles)
    x_m = np.interp(at, fine_m, ahead_m) - strip[:, 1] * np.sin(angle)
    y_m = np.interp(at, fine_m, left_m) + strip[:, 1] * np.cos(angle)
    return np.stack([x_m, y_m, np.zeros(len(at))], axis=1)


def sub_goal_of(trace: DecisionTrace) -> FloatArray | None:
    """Return where the sub-goal lies, metres ahead and to the left (2,); None where that is not known."""
    if trace.sub_goal is None or trace.position is None or trace.heading is None:
        return None
    x_m, y_m = trace.sub_goal.x_m - trace.position[0], trace.sub_goal.y_m - trace.position[1]
    c, s = math.cos(trace.heading), math.sin(trace.heading)
    return np.array([c * x_m + s * y_m, c * y_m - s * x_m])


def sub_goal_post(head: Head, at_m: FloatArray, case: SubGoalCase) -> list[Shape]:
    """Return a ring on the floor, a post in it, and on top a sign of the paper's case, with the distance."""
    x_m, y_m = float(at_m[0]), float(at_m[1])
    angles = math.tau * (np.arange(28) + 0.5) / 28
    away = at_m / max(float(np.hypot(x_m, y_m)), 1e-9)
    # Across the line of sight, so that the sign on top is seen from the front.
    across = np.array([-away[1], away[0]])

    def upright(flat: list[tuple[float, float]]) -> FloatArray:
        points = np.array(flat)
        return head.seen(np.concatenate([at_m + points[:, :1] * across, points[:, 1:]], axis=1))

    def ring(radius_m: float) -> Line:
        floor = np.stack([x_m + radius_m * np.cos(angles), y_m + radius_m * np.sin(angles), 0.0 * angles], axis=1)
        return Line(head.seen(floor), Ink.GOAL, 3, is_closed=True)

    shapes: list[Shape] = [ring(_RING_M), Line(upright([(0.0, 0.0), (0.0, _POST_M)]), Ink.GOAL, 3)]
    if case is SubGoalCase.DESTINATION:
        shapes += [ring(_RING_M / 2.0)]
        disc = np.stack([0.16 * np.cos(angles), _POST_M + 0.16 + 0.16 * np.sin(angles)], axis=1)
        shapes += [Line(upright([(float(u), float(v)) for u, v in disc]), Ink.GOAL, 5, is_closed=True)]
    else:
        wide = 0.13 if case is SubGoalCase.STRAIGHT else 0.22
        middle_m = _POST_M + 0.15
        diamond = [(0.0, _POST_M), (wide, middle_m), (0.0, middle_m + 0.15), (-wide, middle_m)]
        shapes += [Area(upright(diamond), Ink.GOAL)]
    # Beside the sign, away from the middle, where arrow and figures are.
    beside = upright([(math.copysign(_LABEL_ASIDE_M, y_m), _POST_M + 0.15)])[0]
    return [*shapes, Label(metres(math.hypot(x_m, y_m)), beside, Ink.TEXT, 16)]


def near_edges(head: Head, scan: ObstacleScan, range_m: float, stop_m: float) -> list[Shape]:
    """Return the outlines of what is nearer than ``range_m``; the nearer, the thicker; hatched within ``stop_m``."""
    shapes: list[Shape] = []
    for run in _runs(scan, range_m):
        nearest_m = float(scan.nearest_m[run].min())
        width_px = round(min(8.0, max(2.0, 6.0 / nearest_m)))
        ink = Ink.TEXT if nearest_m < stop_m else Ink.NEAR
        if scan.state[run[0]] == BearingState.DROP:
            shapes.append(Line(head.seen(_toothed(scan, run)), ink, width_px))
            continue
        feet, tops = _foot_and_top(scan, run)
        outline = np.concatenate([feet[:1], tops, feet[-1:], feet[::-1]])
        shapes.append(Line(head.seen(outline), ink, width_px, is_closed=True))
        if nearest_m < stop_m:
            hatched = range(_HATCH_EVERY, len(run) - 1, _HATCH_EVERY)
            shapes += [Line(head.seen(np.stack([feet[index], tops[index]])), ink, 2) for index in hatched]
    return shapes


def nearest_label(head: Head, scan: ObstacleScan, range_m: float) -> list[Shape]:
    """Return the distance of what is nearest straight ahead, written on it."""
    near_m = scan.nearest_ahead_m
    if near_m is None or not _NEAREST_DRAWN_M <= near_m <= range_m:
        return []
    ahead = np.abs(scan.bearing_rad) < _LABEL_RAD
    distance_m = np.where(ahead & np.isfinite(scan.nearest_m), scan.nearest_m, np.inf)
    index = int(np.argmin(distance_m))
    bearing = float(scan.bearing_rad[index]) if math.isfinite(distance_m[index]) else 0.0
    point = np.array([[near_m * math.cos(bearing), near_m * math.sin(bearing), head.eye_m - 0.22 * near_m]])
    return [Label(metres(near_m), head.seen(point)[0], Ink.TEXT, 20)]


def _runs(scan: ObstacleScan, range_m: float) -> list[np.ndarray]:
    """Return the indices of neighbouring bearings that show one thing."""
    is_thing = (scan.state == BearingState.OBSTACLE) | (scan.state == BearingState.DROP)
    near = is_thing & (scan.nearest_m <= range_m) & (scan.nearest_m >= _NEAREST_DRAWN_M)
    indices = np.flatnonzero(near)
    if len(indices) == 0:
        return []
    parted = (
        (np.diff(indices) > 1)
        | (np.abs(np.diff(scan.nearest_m[indices])) > _EDGE_STEP_M)
        | (np.diff(scan.state[indices]) != 0)
    )
    return [run for run in np.split(indices, np.flatnonzero(parted) + 1) if len(run) >= _LEAST_RUN]


def _foot_and_top(scan: ObstacleScan, run: np.ndarray) -> tuple[FloatArray, FloatArray]:
    feet = _on_floor(scan, run, scan.nearest_m[run])
    tops = feet.copy()
    tops[:, 2] = scan.top_m[run] if len(scan.top_m) == len(scan.nearest_m) else 1.0
    return feet, tops


def _toothed(scan: ObstacleScan, run: np.ndarray) -> FloatArray:
    teeth = np.where(np.arange(len(run)) % 2 == 0, 0.0, _TOOTH_M)
    # From either end the same, so that a mirrored world gives the mirrored line.
    teeth = np.maximum(teeth, teeth[::-1])
    return _on_floor(scan, run, scan.nearest_m[run] - teeth)


def _on_floor(scan: ObstacleScan, run: np.ndarray, distance_m: FloatArray) -> FloatArray:
    bearing = scan.bearing_rad[run]
    return np.stack([distance_m * np.cos(bearing), distance_m * np.sin(bearing), np.zeros(len(run))], axis=1)

"""A decision as the console is told of it: from the loop's own values to the wire's compact ones."""

from __future__ import annotations

import math

import numpy as np

from navcore.angles import relative_to
from navcore.settings import Settings
from navcore.types import BearingState, CornerAhead, DecisionTrace, Guidance, ObstacleScan
from navcore.wire_trace import MAX_BEARINGS, DecisionLimits, DecisionTraceView, WireCorner, WireScan

_MAX_CM = 65_535
_FARTHEST_UNSEEN_M = 6.0
_UNSEEN_STEP_DEG = 2.0
"""Of what is remembered beside the image, the nearest in so many degrees is told."""
_BEHIND_CORNER_M = 1.0
_ONE_BEARING_RAD = math.radians(1.0)
"""Width of a scan of a single bearing."""
_STATE_OF_RANK = np.array(
    [BearingState.FREE, BearingState.UNKNOWN, BearingState.HEARD, BearingState.OBSTACLE, BearingState.DROP]
)
"""From what is best for a walker to what is worst."""
_RANK_OF_STATE = np.argsort(_STATE_OF_RANK)


def decision_view(guidance: Guidance, scan: ObstacleScan | None, settings: Settings) -> DecisionTraceView:
    """Return how a decision came about; ``scan`` is None where no depth image was looked at."""
    trace, stamp_s = guidance.trace, guidance.stamp_s
    looks = trace.look_target is not None and trace.heading is not None
    return DecisionTraceView(
        decided="" if trace.decided is None else trace.decided.value,
        turn=None if trace.turn is None else trace.turn.value,
        optimal_rad=finite(trace.optimal),
        required_m=finite(trace.required_m),
        closing_m_s=finite(trace.closing_m_s) or 0.0,
        offset_m=finite(trace.offset_m) or 0.0,
        free_frame_count=trace.free_frame_count,
        stopped_s=_since(trace.stopped_since_s, stamp_s),
        uncertain_s=_since(trace.uncertain_since_s, stamp_s),
        lost_s=_since(trace.lost_since_s, stamp_s),
        look_rad=float(relative_to(trace.look_target, trace.heading)) if looks else None,  # type: ignore[arg-type]
        corner=_corner(trace.corner),
        is_at_corner=_is_at_corner(trace, settings.planning.route_spacing_m),
        sonar_rad=finite(trace.sonar_bearing_rad) or 0.0,
        valid_fraction=finite(trace.valid_fraction),
        limits=_limits(trace, settings),
        scan=None if scan is None else wire_scan(scan),
        rejoins=trace.rejoins,
    )


def wire_scan(scan: ObstacleScan) -> WireScan:
    """Return a scan on evenly spaced bearings; those between that it does not have are unknown.

    Of bearings that fall on the same one, the worst state is told, and the nearest distance.
    """
    bearings = scan.bearing_rad
    if not len(bearings):
        return WireScan(0.0, _ONE_BEARING_RAD, (), (), _unseen(scan))
    step_rad = float(np.diff(bearings).min()) if len(bearings) > 1 else _ONE_BEARING_RAD
    step_rad = max(step_rad, float(bearings[-1] - bearings[0]) / (MAX_BEARINGS - 1), 1e-6)
    index = np.rint((bearings - bearings[0]) / step_rad).astype(int)
    worst = np.full(index[-1] + 1, -1)
    np.maximum.at(worst, index, _RANK_OF_STATE[scan.state])
    states = np.where(worst < 0, BearingState.UNKNOWN, _STATE_OF_RANK[worst])
    nearest_m = np.full(len(states), np.inf)
    np.fmin.at(nearest_m, index, scan.nearest_m)
    is_there = np.isfinite(nearest_m)
    # What is there is never told as 0, which would be nothing.
    nearest_cm = np.where(is_there, np.clip(np.rint(np.where(is_there, nearest_m, 0.0) * 100.0), 1, _MAX_CM), 0)
    nearest_cm = nearest_cm.astype(int)
    return WireScan(
        float(bearings[0]), step_rad, tuple(states.tolist()), tuple(nearest_cm.tolist()), _unseen(scan)
    )  # fmt: skip


def finite(value: float | None) -> float | None:
    """Return a plain, finite number, or None: the console takes no others."""
    return float(value) if value is not None and math.isfinite(value) else None


def _unseen(scan: ObstacleScan) -> tuple[tuple[int, int], ...]:
    nearest: dict[int, tuple[float, float]] = {}
    for bearing_rad, distance_m in zip(scan.unseen_rad.tolist(), scan.unseen_m.tolist(), strict=True):
        if not distance_m <= _FARTHEST_UNSEEN_M:
            continue
        sector = round(math.degrees(bearing_rad) / _UNSEEN_STEP_DEG)
        nearest[sector] = min(nearest.get(sector, (math.inf, 0.0)), (distance_m, bearing_rad))
    return tuple(
        (round(math.degrees(bearing_rad)), round(100.0 * distance_m))
        for _, (distance_m, bearing_rad) in sorted(nearest.items())
    )


def _since(since_s: float | None, stamp_s: float) -> float | None:
    return None if since_s is None else finite(stamp_s - since_s)


def _corner(corner: CornerAhead | None) -> WireCorner | None:
    if corner is None:
        return None
    return WireCorner(float(corner.distance_m), float(corner.bend), float(corner.turn_m))


def _is_at_corner(trace: DecisionTrace, spacing_m: float) -> bool:
    """Return whether the last corner that was reached is not far behind yet; a route's points are evenly spaced."""
    goal, at = trace.sub_goal, trace.closest_index
    if goal is None or at is None or goal.passed_index == 0:
        return False
    return (at - goal.passed_index) * spacing_m <= _BEHIND_CORNER_M


def _limits(trace: DecisionTrace, settings: Settings) -> DecisionLimits:
    obstacle, follower = settings.obstacle, settings.follower
    return DecisionLimits(
        stop_m=finite(trace.stop_m),
        gate_m=finite(trace.gate_m),
        clearance_m=obstacle.clearance_m,
        person_width_m=obstacle.person_width_m,
        half_field_rad=math.radians(settings.gate.half_field_deg),
        off_road_m=follower.off_road_distance_m,
        heading_error_rad=math.radians(follower.heading_error_deg),
        turn_rad=math.radians(follower.turn_angle_deg),
        straight_rad=math.radians(settings.cues.straight_within_deg),
        arrival_m=follower.arrival_distance_m,
        uncertain_s=settings.localization.uncertain_hold_s,
        min_valid_fraction=obstacle.min_valid_fraction,
        free_frames_count=obstacle.leave_frames_count,
    )

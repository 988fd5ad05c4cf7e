"""What a told state says of one decision, read carefully: what nobody has measured is never called free."""

from __future__ import annotations

import math
from dataclasses import dataclass

from navcore.angles import wrap_rad
from navcore.types import BearingState, Rule
from navcore.wire import WalkerState
from navcore.wire_trace import DecisionTraceView, WireScan

_SAME_DIRECTION_RAD = math.radians(2.5)
"""Candidates lie 3° apart by default, and θ_opt at most half of that beside one."""
_AHEAD_RAD = math.radians(15.0)
_USUALLY_STRAIGHT_RAD = math.radians(10.0)
"""What sounds like straight ahead by default, for recordings that do not tell."""
_UNKNOWN = int(BearingState.UNKNOWN)
_NOTHING = (int(BearingState.FREE), _UNKNOWN)
_ROUNDING = 1e-6
"""Of an index; a bearing at the edge of a cone is inside."""


@dataclass(frozen=True, slots=True)
class Cone:
    """What the depth image shows in some directions."""

    is_known: bool
    """Something was measured in every bearing, and the image covers all of them."""
    nearest_m: float | None
    """Distance to what is nearest; None where nothing is seen."""
    state: BearingState
    """Of the nearest; FREE only where all is known and nothing is seen."""


@dataclass(frozen=True, slots=True)
class Facts:
    """A state, and what follows from it for a sentence."""

    state: WalkerState
    trace: DecisionTraceView
    rule: Rule | None
    """The check that decided; None for one that this program does not know, and in older recordings."""

    @property
    def straight_rad(self) -> float:
        """What is nearer to straight ahead than this sounds like it."""
        return self.trace.limits.straight_rad or _USUALLY_STRAIGHT_RAD

    @property
    def direction_rad(self) -> float | None:
        """θ_walk, where it is a number."""
        return finite(self.state.direction_rad)

    @property
    def heading_rad(self) -> float | None:
        """θ_c."""
        return None if self.state.pose is None else finite(self.state.pose[3])

    @property
    def expected_rad(self) -> float | None:
        """θ_exp, relative to the heading."""
        expected_rad, heading_rad = finite(self.state.expected_rad), self.heading_rad
        return None if expected_rad is None or heading_rad is None else wrap_rad(expected_rad - heading_rad)

    @property
    def sub_goal(self) -> tuple[float, float] | None:
        """Bearing (rad, relative to the heading) and distance (m) of P_G."""
        goal, pose, heading_rad = self.state.sub_goal, self.state.pose, self.heading_rad
        if goal is None or pose is None or heading_rad is None:
            return None
        dx_m, dy_m = goal[0] - pose[0], goal[1] - pose[1]
        if not (math.isfinite(dx_m) and math.isfinite(dy_m)):
            return None
        return wrap_rad(math.atan2(dy_m, dx_m) - heading_rad), math.hypot(dx_m, dy_m)

    def free_m(self, direction_rad: float) -> float | None:
        """Return how far a direction is known to be free for a person; None where that is not known."""
        near = [
            (abs(wrap_rad(each.angle_rad - direction_rad)), each.clearance_m)
            for each in self.state.candidates
            if math.isfinite(each.angle_rad) and math.isfinite(each.clearance_m)
        ]
        apart_rad, clearance_m = min(near, default=(math.inf, 0.0))
        return clearance_m if apart_rad <= _SAME_DIRECTION_RAD and clearance_m > 0.0 else None

    def cone(self, towards_rad: float, half_rad: float) -> Cone:
        """Return what the image shows within ``half_rad`` of a direction."""
        scan = self.trace.scan
        if scan is None or not scan.states:
            return Cone(False, None, BearingState.UNKNOWN)
        inside = _inside(scan, towards_rad, half_rad)
        covers = _covers(scan, towards_rad, half_rad)
        is_known = covers and bool(inside) and all(scan.states[i] != _UNKNOWN for i in inside)
        seen = [(scan.nearest_cm[i], scan.states[i]) for i in inside if scan.states[i] not in _NOTHING]
        if not seen:
            return Cone(is_known, None, BearingState.FREE if is_known else BearingState.UNKNOWN)
        nearest_cm, state = min(seen)
        return Cone(is_known, nearest_cm / 100.0, BearingState(state))

    @property
    def ahead(self) -> Cone:
        """What the image shows about straight ahead."""
        return self.cone(0.0, _AHEAD_RAD)


def facts_of(state: WalkerState) -> Facts:
    """Return what a state says."""
    trace = state.trace or DecisionTraceView()
    try:
        rule = Rule(trace.decided)
    except ValueError:
        rule = None
    return Facts(state, trace, rule)


def finite(value: float | None) -> float | None:
    """Return a number that is one, or None: not every field of the wire is checked for it."""
    return value if value is not None and math.isfinite(value) else None


def _inside(scan: WireScan, towards_rad: float, half_rad: float) -> range:
    """Return the indices of the bearings within ``half_rad`` of a direction."""
    if not scan.step_rad > 0.0:
        return range(0)
    first = math.ceil((towards_rad - half_rad - scan.first_rad) / scan.step_rad - _ROUNDING)
    last = math.floor((towards_rad + half_rad - scan.first_rad) / scan.step_rad + _ROUNDING)
    count = min(len(scan.states), len(scan.nearest_cm))
    return range(min(max(first, 0), count), min(max(last + 1, 0), count))


def _covers(scan: WireScan, towards_rad: float, half_rad: float) -> bool:
    """Return whether the image covers a cone, but for half a bearing at its edges."""
    last_rad, slack_rad = scan.first_rad + (len(scan.states) - 1) * scan.step_rad, abs(scan.step_rad)
    return scan.first_rad - slack_rad <= towards_rad - half_rad and towards_rad + half_rad <= last_rad + slack_rad

"""People who see give way to somebody who is led: they step aside in time, and stop rather than walk into anybody.

A model: evasive movements of pedestrians begin about two metres ahead and are sideways (K. Kitazawa, T. Fujiyama,
"Pedestrian vision and collision avoidance behavior", Pedestrian and Evacuation Dynamics 2008).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

from device_agent.simulation.renderer import Placement

_NOTICED_M = 2.0
_STOPS_M = 0.9
_IN_THE_WAY_M = 0.8
"""Sideways distance at which two people pass each other."""
_BROAD_M = 0.6
_STEP_ASIDE_M_S, _BACK_M_S = 0.6, 0.3
_FARTHEST_ASIDE_M = 0.9
_PATIENCE_S = 4.0
_PASSED_M = 1.2
"""Who has passed the walker goes back to their path when they are so far away."""
_PACE_M_S, _FORESEES_S, _YIELDS_WITHIN_M = 0.9, 2.0, 2.5
"""Who foresees coming too near waits, where that leaves more room than going on."""
_HURRIES = 0.5
"""Who is before the walker already, and sees them come too near, walks faster by so much of their pace. Walkers adapt
to each other, both of them, where they would come nearer than a metre (A.-H. Olivier et al., "Minimal predicted
distance", Gait & Posture 36, 2012); that it is by pace, and by how much, is assumed."""
_SEEN_RAD, _KNOWN_RAD, _KNOWN_S = math.radians(100.0), math.radians(150.0), 3.0
"""The visual field reaches so far from straight ahead. Farther aside, people know for a while of whom they have just
seen; who is right behind them they do not know of."""
_MOVES_M_S = 0.2
_GOES_BACK_S, _LETS_PASS_S = 3.0, 12.0
"""Who has stood before the walker for so long without being passed goes back to where there is more room, and waits."""
IsFree = Callable[[float, float], bool]


@dataclass(frozen=True, slots=True)
class Courtesy:
    """How far somebody has given way."""

    waited_s: float = 0.0
    """How long they have stood so far: they are so late."""
    aside_m: tuple[float, float] = (0.0, 0.0)
    """How far they are beside their path now."""
    standing_s: float = 0.0
    """How long they have been standing before the walker, or going back from them, without a break."""
    unseen_s: float = math.inf
    """For how long they have not had the walker near and in their visual field."""


def beside_path(placement: Placement | None, courtesy: Courtesy) -> Placement | None:
    """Return where somebody is who would be at a place of their path by now."""
    if placement is None:
        return None
    return replace(placement, x_m=placement.x_m + courtesy.aside_m[0], y_m=placement.y_m + courtesy.aside_m[1])


@dataclass(frozen=True, slots=True)
class Seen:
    """What people see of the walker. Metres, metres a second."""

    x_m: float
    y_m: float
    vx_m_s: float = 0.0
    vy_m_s: float = 0.0


def given_way(
    courtesy: Courtesy,
    placement: Placement,
    walker: Seen,
    is_free: IsFree,
    dt_s: float,
    *,
    walks: bool = True,
    back: Placement | None = None,
) -> Courtesy:
    """Return how somebody gives way to the walker in the next moment.

    Args:
        courtesy: how far they have so far.
        placement: where they are, beside their path.
        walker: what they see of the walker.
        is_free: whether a person has room at a place (x, y).
        dt_s: the moment's length.
        walks: whether they would walk in it: nobody hurries who stands at an end of their path.
        back: where they would be who goes back along their path in it; None where they have room behind them.
    """
    dx_m, dy_m = walker.x_m - placement.x_m, walker.y_m - placement.y_m
    c, s = math.cos(placement.yaw_rad), math.sin(placement.yaw_rad)
    ahead_m, left_m = c * dx_m + s * dy_m, -s * dx_m + c * dy_m
    distance_m = _distance_m(placement, walker)
    aside_rad = abs(math.atan2(left_m, ahead_m))
    sees = aside_rad <= _SEEN_RAD and distance_m <= _YIELDS_WITHIN_M
    courtesy = replace(courtesy, unseen_s=0.0 if sees else courtesy.unseen_s + dt_s)
    if courtesy.standing_s > _PATIENCE_S:
        goes_back = back is None or _distance_m(back, walker) >= distance_m
        return _making_room(courtesy, dt_s, goes_back=goes_back)
    if ahead_m <= 0.0 and distance_m < _PASSED_M:
        knows = aside_rad <= _KNOWN_RAD and courtesy.unseen_s <= _KNOWN_S
        hurries = walks and knows and _hurries_better(placement, walker)
        hurried_s = _HURRIES * dt_s if hurries else 0.0
        return replace(courtesy, waited_s=courtesy.waited_s - hurried_s, standing_s=0.0)
    late_s = dt_s if _stands_better(placement, walker) else 0.0
    if ahead_m <= 0.0 and late_s > 0.0:
        return replace(courtesy, waited_s=courtesy.waited_s + late_s, standing_s=0.0)
    if ahead_m <= 0.0 or distance_m > _YIELDS_WITHIN_M:
        return replace(courtesy, aside_m=_shorter(courtesy.aside_m, _BACK_M_S * dt_s), standing_s=0.0)
    sign = -1.0 if left_m > 0.0 else 1.0
    aside = -sign * s, sign * c
    if abs(left_m) < _IN_THE_WAY_M and distance_m < _NOTICED_M and not _walks_along(placement, walker, aside):
        courtesy = _stepped(courtesy, placement, aside, is_free, _STEP_ASIDE_M_S * dt_s)
    if distance_m < _STOPS_M and abs(left_m) < _BROAD_M:
        return replace(courtesy, waited_s=courtesy.waited_s + dt_s, standing_s=courtesy.standing_s + dt_s)
    return replace(courtesy, waited_s=courtesy.waited_s + late_s, standing_s=0.0)


def _stands_better(placement: Placement, walker: Seen) -> bool:
    """Whether somebody who walks on would come too near to the walker, and nearer than if they stand."""
    if not _moves(walker) or _distance_m(placement, walker) > _YIELDS_WITHIN_M:
        return False
    goes_m = _nearest_at_pace_m(placement, walker, _PACE_M_S)
    return goes_m < _IN_THE_WAY_M and goes_m <= _nearest_at_pace_m(placement, walker, 0.0)


def _hurries_better(placement: Placement, walker: Seen) -> bool:
    """Whether somebody who walks on would come too near to the walker, and less near if they walk faster."""
    if not _moves(walker):
        return False
    stands_m, goes_m, hurries_m = (
        _nearest_at_pace_m(placement, walker, pace_m_s) for pace_m_s in (0.0, _PACE_M_S, (1.0 + _HURRIES) * _PACE_M_S)
    )
    return goes_m < _IN_THE_WAY_M and hurries_m > max(goes_m, stands_m)


def _walks_along(placement: Placement, walker: Seen, aside: tuple[float, float]) -> bool:
    """Whether somebody who steps aside stays so beside the walker, who goes that way, and nearer than if they stand."""
    if not _moves(walker):
        return False
    dx_m, dy_m = walker.x_m - placement.x_m, walker.y_m - placement.y_m
    steps_m = _nearest_m(
        dx_m, dy_m, walker.vx_m_s - _STEP_ASIDE_M_S * aside[0], walker.vy_m_s - _STEP_ASIDE_M_S * aside[1]
    )  # fmt: skip
    return steps_m < min(_IN_THE_WAY_M, _nearest_m(dx_m, dy_m, walker.vx_m_s, walker.vy_m_s))


def _moves(walker: Seen) -> bool:
    return math.hypot(walker.vx_m_s, walker.vy_m_s) >= _MOVES_M_S


def _nearest_at_pace_m(placement: Placement, walker: Seen, pace_m_s: float) -> float:
    """Return how near somebody comes to the walker who walks on at a pace."""
    vx_m_s = walker.vx_m_s - pace_m_s * math.cos(placement.yaw_rad)
    vy_m_s = walker.vy_m_s - pace_m_s * math.sin(placement.yaw_rad)
    return _nearest_m(walker.x_m - placement.x_m, walker.y_m - placement.y_m, vx_m_s, vy_m_s)


def _nearest_m(dx_m: float, dy_m: float, vx_m_s: float, vy_m_s: float) -> float:
    """Return how near something comes that is at (dx, dy) and moves on evenly, as far as people foresee."""
    when_s = -(dx_m * vx_m_s + dy_m * vy_m_s) / max(vx_m_s**2 + vy_m_s**2, 1e-9)
    when_s = min(_FORESEES_S, max(0.0, when_s))
    return math.hypot(dx_m + when_s * vx_m_s, dy_m + when_s * vy_m_s)


def _distance_m(placement: Placement, walker: Seen) -> float:
    return math.hypot(walker.x_m - placement.x_m, walker.y_m - placement.y_m)


def _making_room(courtesy: Courtesy, dt_s: float, *, goes_back: bool) -> Courtesy:
    """Go back along the path, where that leads away from the walker, and let them pass."""
    since_s = courtesy.standing_s - _PATIENCE_S
    if since_s > _GOES_BACK_S + _LETS_PASS_S:
        return replace(courtesy, standing_s=0.0)
    late_s = 2.0 * dt_s if goes_back and since_s < _GOES_BACK_S else dt_s
    return replace(courtesy, waited_s=courtesy.waited_s + late_s, standing_s=courtesy.standing_s + dt_s)


def _stepped(
    courtesy: Courtesy, placement: Placement, aside: tuple[float, float], is_free: IsFree, step_m: float
) -> Courtesy:
    moved = courtesy.aside_m[0] + step_m * aside[0], courtesy.aside_m[1] + step_m * aside[1]
    goes = math.hypot(*moved) <= _FARTHEST_ASIDE_M and is_free(
        placement.x_m + step_m * aside[0], placement.y_m + step_m * aside[1]
    )
    return replace(courtesy, aside_m=moved) if goes else courtesy


def _shorter(offset: tuple[float, float], by_m: float) -> tuple[float, float]:
    length_m = math.hypot(*offset)
    scale = max(0.0, length_m - by_m) / length_m if length_m > 0.0 else 0.0
    return offset[0] * scale, offset[1] * scale

"""What the sighted person who records a map is told on the way: how well the building is being seen. Pure.

A frame is reduced to a :class:`Sight`; :func:`advise` turns one after the other into at most one :class:`Advice` each.
What is wrong must last before it is said, is said again only after a while, and what is right is not talked about.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType

from navcore.settings import MapWalkSettings

CLEARED_AFTER_S = 1.0
"""What has not been so for this long is over; shorter gaps do not interrupt it."""
APART_S = 3.0
"""Time between two sentences, so that the first can be heard and heeded."""
LONG_LOST_S = 3.0
"""Whoever was lost for as long as this hears that the place was found again."""


class Advice(enum.Enum):
    """What can be said of a map walk; the value is the end of its text's key (``map_walk_…``). The first is the most
    urgent."""

    COVERED = "covered"
    DARK = "dark"
    LOST = "lost"
    SLOW_DOWN = "slow_down"
    LOOK_AHEAD = "look_ahead"
    WEAK = "weak"
    FOUND = "found"
    LOOP = "loop"


HOLD_S: Mapping[Advice, float] = MappingProxyType(
    {
        Advice.COVERED: 1.0,
        Advice.DARK: 2.0,
        Advice.LOST: 1.0,
        Advice.SLOW_DOWN: 0.5,
        Advice.LOOK_AHEAD: 2.0,
        Advice.WEAK: 2.0,
    }
)
"""How long each trouble must last before it is said: a turn into a corridor is over before it matters."""
LEAVES_GAPS = frozenset({Advice.COVERED, Advice.DARK, Advice.LOST, Advice.WEAK})
"""What makes the map worse at the place where it was so; these are noted for the report."""
GOOD_NEWS = frozenset({Advice.FOUND, Advice.LOOP})


@dataclass(frozen=True, slots=True)
class Sight:
    """One frame of a map walk, as far as coverage goes."""

    stamp_s: float
    tracked: bool
    """The camera's motion was followed to this frame."""
    landmark_count: int = 0
    """Landmarks that agree with the pose."""
    is_fixed: bool = True
    """Something seen fixes the pose in every direction; otherwise it was carried on."""
    valid_depth_share: float = 1.0
    """Share of the pixels that have a depth, 0–1."""
    far_share: float = 1.0
    """Share of these that are farther than :attr:`MapWalkSettings.far_m`."""
    brightness: float = 0.5
    """Mean of the grey picture, 0–1."""
    contrast: float = 0.2
    """Standard deviation of the grey picture, 0–1."""
    turn_rad_s: float = 0.0
    """How fast the camera turns; 0 where that is not known."""
    speed_m_s: float = 0.0
    tilt_rad: float | None = None
    """How far the optical axis points above the horizontal; None where nothing tells."""
    loop_count: int = 0
    """Loops that were closed so far."""


@dataclass(frozen=True, slots=True)
class Lasting:
    """A trouble that is there now, or was a moment ago."""

    since_s: float
    last_s: float


@dataclass(frozen=True, slots=True)
class Coverage:
    """What is remembered between two frames of a map walk."""

    lasting: Mapping[Advice, Lasting] = field(default_factory=dict)
    told_s: Mapping[Advice, float] = field(default_factory=dict)
    """When each advice was last given."""
    loop_count: int = 0

    def holds(self, advice: Advice) -> bool:
        """Return whether a trouble is there now and has lasted long enough to count."""
        found = self.lasting.get(advice)
        return found is not None and found.last_s - found.since_s >= HOLD_S[advice]

    @property
    def gaps(self) -> tuple[Advice, ...]:
        """What makes the map worse here."""
        return tuple(advice for advice in Advice if advice in LEAVES_GAPS and self.holds(advice))


def advise(sight: Sight, before: Coverage, settings: MapWalkSettings) -> tuple[Advice | None, Coverage]:
    """Return what is to be said after a frame, if anything, and what to remember.

    Args:
        sight: the frame; stamps grow from call to call.
        before: what this function returned last; ``Coverage()`` at the start.
        settings: thresholds.
    """
    troubles = troubles_in(sight, settings)
    after = replace(before, lasting=_lasting(before, troubles, sight.stamp_s))
    advice = _good_news(sight, before, after) or _due(after, troubles, sight.stamp_s, settings)
    if advice is Advice.LOOP:
        after = replace(after, loop_count=sight.loop_count)
    if advice is not None:
        after = replace(after, told_s={**after.told_s, advice: sight.stamp_s})
    return advice, after


def troubles_in(sight: Sight, settings: MapWalkSettings) -> frozenset[Advice]:
    """Return what is wrong with one frame. What explains another trouble stands for it."""
    if sight.valid_depth_share < settings.covered_fraction and (
        sight.contrast < settings.flat_fraction or sight.brightness < settings.dark_fraction
    ):
        return frozenset({Advice.COVERED})
    if sight.brightness < settings.dark_fraction:
        return frozenset({Advice.DARK})
    found = {Advice.LOST} if not sight.tracked else set()
    if sight.turn_rad_s > math.radians(settings.turn_in_1_s_deg) or sight.speed_m_s > settings.way_in_1_s_m:
        found.add(Advice.SLOW_DOWN)
    if _looks_away(sight, settings):
        found.add(Advice.LOOK_AHEAD)
    elif sight.tracked and _is_weak(sight, settings):
        found.add(Advice.WEAK)
    return frozenset(found)


def _looks_away(sight: Sight, settings: MapWalkSettings) -> bool:
    """Floors and ceilings look the same everywhere, and so does a wall before one's nose."""
    if sight.tilt_rad is not None:
        tilt_deg = math.degrees(sight.tilt_rad)
        if tilt_deg < -settings.look_down_deg or tilt_deg > settings.look_up_deg:
            return True
    return sight.valid_depth_share >= settings.valid_depth_fraction and sight.far_share < settings.far_fraction


def _is_weak(sight: Sight, settings: MapWalkSettings) -> bool:
    return (
        not sight.is_fixed
        or sight.landmark_count < settings.landmarks_count
        or sight.valid_depth_share < settings.valid_depth_fraction
    )


def _lasting(before: Coverage, troubles: frozenset[Advice], now_s: float) -> dict[Advice, Lasting]:
    kept = {
        advice: found for advice, found in before.lasting.items() if now_s - found.last_s <= CLEARED_AFTER_S
    }  # fmt: skip
    return kept | {
        advice: Lasting(kept[advice].since_s if advice in kept else now_s, now_s) for advice in troubles
    }  # fmt: skip


def _good_news(sight: Sight, before: Coverage, after: Coverage) -> Advice | None:
    if sight.loop_count > before.loop_count:
        return Advice.LOOP
    lost = before.lasting.get(Advice.LOST)
    was_long = lost is not None and lost.last_s - lost.since_s >= LONG_LOST_S and Advice.LOST in before.told_s
    return Advice.FOUND if was_long and Advice.LOST not in after.lasting and sight.tracked else None


def _due(coverage: Coverage, troubles: frozenset[Advice], now_s: float, settings: MapWalkSettings) -> Advice | None:
    """Return the most urgent trouble that has lasted, unless it, or anything, was said a moment ago."""
    for advice in Advice:
        if advice not in troubles or not coverage.holds(advice):
            continue
        told_s = coverage.told_s.get(advice, -math.inf)
        newest_s = max(coverage.told_s.values(), default=-math.inf)
        if now_s - told_s >= settings.repeat_s and now_s - newest_s >= APART_S:
            return advice
        # What is less urgent waits until this is over.
        return None
    return None

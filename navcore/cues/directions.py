"""Directions in words, by the style that the walker has chosen, and the angle that each of them means.

A style says only certain angles; what a walker who turns by exactly that leaves over is said again, as a smaller turn,
until the expected direction is as near as a turn need come (``follower.turn_settled_deg``).
"""

from __future__ import annotations

import math
from typing import Literal

from navcore.cues.texts import TEXTS, Language

DirectionStyle = Literal["degrees", "clock", "sides"]

SIZES_DEG: dict[str, float] = {"slightly": 15.0, "half": 45.0, "full": 90.0, "sharp": 135.0, "round": 180.0}
"""The angle that each word of the style ``sides`` stands for: it is said for every angle that is nearest to it."""
CLOCK_DEG: tuple[float, ...] = (SIZES_DEG["slightly"], *(30.0 * step for step in range(1, 7)))
"""The angles of the clock's hours. What is less than half an hour is put into words, or it could never be told."""
DEGREES_STEP_DEG = 5.0
SMALLEST_TURN_DEG = 10.0
"""Nobody can turn by less to order: turns without vision err by several degrees."""
_AROUND_DEG = 155.0
_AHEAD_DEG = 15.0
"""A place within this of straight ahead, or of straight behind, is said to be there."""


def told_turn_deg(direction_rad: float, style: DirectionStyle) -> float:
    """Return the angle, degrees, left positive, that is told for a turn on the spot; never 0."""
    degrees = abs(math.degrees(direction_rad))
    if style == "degrees":
        told = max(SMALLEST_TURN_DEG, DEGREES_STEP_DEG * round(degrees / DEGREES_STEP_DEG))
    else:
        told = _nearest(degrees, style)
    return math.copysign(told, direction_rad)


def told_move_deg(direction_rad: float, straight_within_deg: float, style: DirectionStyle) -> float:
    """Return the angle, degrees, left positive, that is told at the beginning of a movement; 0 is straight ahead."""
    degrees = abs(math.degrees(direction_rad))
    if degrees <= straight_within_deg:
        return 0.0
    if style == "degrees":
        return math.copysign(max(1.0, round(degrees / DEGREES_STEP_DEG)) * DEGREES_STEP_DEG, direction_rad)
    return math.copysign(_nearest(degrees, style), direction_rad)


def turn_text(angle_deg: float, style: DirectionStyle, language: Language) -> str:
    """Return the words of a turn on the spot by an angle that is told; left is positive."""
    if abs(angle_deg) >= _AROUND_DEG:
        return TEXTS[language][f"turn_round_{_side(angle_deg)}"]
    return _text("turn", angle_deg, style, language)


def move_text(angle_deg: float, style: DirectionStyle, language: Language) -> str:
    """Return the words that begin a movement in a direction that is told; left is positive."""
    if angle_deg == 0.0:
        return TEXTS[language]["move_straight"]
    return _text("move", angle_deg, style, language)


def place_direction_text(bearing_rad: float, style: DirectionStyle, language: Language) -> str:
    """Return in which direction a place lies, in words: no instruction. Left is positive."""
    angle_deg = (math.degrees(bearing_rad) + 180.0) % 360.0 - 180.0
    texts, size_deg = TEXTS[language], abs(angle_deg)
    if style == "clock":
        return texts["at_clock"].format(hour=hour(angle_deg))
    if size_deg < _AHEAD_DEG:
        return texts["at_ahead"]
    if size_deg > 180.0 - _AHEAD_DEG:
        return texts["at_behind"]
    side = _side(angle_deg)
    if style == "degrees":
        return texts[f"at_degrees_{side}"].format(degrees=round(DEGREES_STEP_DEG * round(size_deg / DEGREES_STEP_DEG)))
    size = min(("half", "full", "sharp"), key=lambda each: abs(SIZES_DEG[each] - size_deg))
    return texts[f"at_{size}_{side}"]


def hour(angle_deg: float) -> int:
    """Return the hour on a clock face, of which 12 is straight ahead, nearest to an angle; left is positive."""
    return (12 - round(angle_deg / 30.0) - 1) % 12 + 1


def _nearest(degrees: float, style: DirectionStyle) -> float:
    angles = CLOCK_DEG if style == "clock" else tuple(SIZES_DEG.values())
    return min(angles, key=lambda angle: abs(angle - degrees))


def _text(verb: str, angle_deg: float, style: DirectionStyle, language: Language) -> str:
    texts, size_deg = TEXTS[language], abs(angle_deg)
    if style == "degrees":
        return texts[f"{verb}_{_side(angle_deg)}"].format(degrees=round(size_deg))
    if style == "clock" and size_deg >= CLOCK_DEG[1]:
        return texts[f"{verb}_clock"].format(hour=hour(angle_deg))
    size = min(SIZES_DEG, key=lambda each: abs(SIZES_DEG[each] - size_deg))
    return texts[f"{verb}_{size}_{_side(angle_deg)}"]


def _side(angle_deg: float) -> str:
    return "left" if angle_deg > 0.0 else "right"

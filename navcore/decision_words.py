"""Figures of a decision in words."""

from __future__ import annotations

import math


def metres(distance_m: float) -> str:
    """Return "1.4 m"."""
    return f"{distance_m:.1f} m"


def seconds(duration_s: float) -> str:
    """Return "0.4 s", "4 s"."""
    return f"{duration_s:.1f} s" if duration_s < 3.0 and duration_s % 1.0 else f"{duration_s:.0f} s"


def degrees(angle_rad: float) -> str:
    """Return how large an angle is, without its side: "85°"."""
    return f"{abs(math.degrees(angle_rad)):.0f}°"


def aside(angle_rad: float) -> str:
    """Return an angle with its side: "12° right", "straight ahead"."""
    if round(math.degrees(angle_rad)) == 0:
        return "straight ahead"
    return f"{degrees(angle_rad)} {'left' if angle_rad > 0.0 else 'right'}"


def inlined(words: str) -> str:
    """Return words of somebody else so that a sentence can go on after them: no point at the end, no end of a line."""
    return " ".join(words.split()).rstrip(".")

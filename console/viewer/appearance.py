"""Colours, shapes and words of the scene, in one place.

The kinds of places differ in colour and in shape, so that nobody has to tell two hues apart; the hues are those of
Okabe and Ito, which hold for the common forms of colour blindness, deepened, since the scene's light pales them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from navcore.planning.poi_graph import PoiKind

Rgb = tuple[int, int, int]
Shape = Literal["ball", "box", "post", "diamond"]

ROAD: Rgb = (240, 200, 80)
EDGE: Rgb = (88, 104, 124)
EDGE_CLOSED: Rgb = (200, 60, 0)
EDGE_SELECTED: Rgb = (255, 240, 120)
PREVIEW: Rgb = (255, 240, 150)
ARROW: Rgb = (235, 245, 255)
ROUTE: Rgb = (20, 120, 255)
TRAIL: Rgb = (190, 120, 220)
WALKER: Rgb = (230, 60, 60)
WALKER_STALE: Rgb = (130, 130, 135)
SUB_GOAL: Rgb = (40, 110, 255)
CLOSEST: Rgb = (250, 220, 40)
CANDIDATE: Rgb = (0, 200, 150)
CHOSEN: Rgb = (255, 255, 255)
SONAR: Rgb = (230, 159, 0)
SONAR_NEAR: Rgb = (230, 60, 60)
FLOOR: Rgb = (24, 27, 33)
GRID: Rgb = (48, 54, 64)
GRID_SECTION: Rgb = (72, 80, 94)
BRAND: Rgb = (86, 160, 233)


@dataclass(frozen=True, slots=True)
class KindLook:
    """How a kind of place looks, and what it is called."""

    word: str
    colour: Rgb
    shape: Shape


KINDS: dict[PoiKind, KindLook] = {
    "room": KindLook("Room", (0, 114, 190), "ball"),
    "toilet": KindLook("Wash room", (195, 60, 140), "ball"),
    "bar": KindLook("Bar", (235, 125, 0), "ball"),
    "lounge": KindLook("Lounge", (0, 145, 100), "ball"),
    "hall": KindLook("Hall", (235, 205, 0), "ball"),
    "junction": KindLook("Junction", (205, 210, 220), "diamond"),
    "lift": KindLook("Lift", (110, 80, 235), "post"),
    "stairs": KindLook("Stairs", (213, 94, 0), "post"),
    "door": KindLook("Door", (150, 110, 70), "box"),
    "entrance": KindLook("Entrance", (40, 170, 60), "box"),
    "exit": KindLook("Exit", (215, 40, 40), "box"),
    "other": KindLook("Other", (120, 130, 145), "ball"),
}
KIND_OF_WORD: dict[str, PoiKind] = {look.word: kind for kind, look in KINDS.items()}


def dimmed(colour: Rgb, share: float) -> Rgb:
    """Return a colour at this share of its brightness, 0–1."""
    red, green, blue = (round(part * share) for part in colour)
    return red, green, blue


def metres_text(length_m: float) -> str:
    """A length as it stands at an edge."""
    return f"{length_m:.1f} m" if length_m < 100 else f"{length_m:.0f} m"


def age_text(age_s: float) -> str:
    """An age in words, as coarse as is honest."""
    if age_s < 10.0:
        return f"{age_s:.1f} s ago"
    if age_s < 120.0:
        return f"{age_s:.0f} s ago"
    if age_s < 7200.0:
        return f"{age_s / 60.0:.0f} min ago"
    return f"{age_s / 3600.0:.0f} h ago"

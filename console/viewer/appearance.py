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
BRAND: Rgb = (86, 160, 233)


@dataclass(frozen=True, slots=True)
class Theme:
    """The colours that depend on whether the scene is dark or light."""

    name: Literal["dark", "light"]
    floor: Rgb
    grid: Rgb
    grid_section: Rgb
    road: Rgb
    """The line that places and connections lie on."""
    recorded: Rgb
    """The band of road that somebody has walked."""
    drawn: Rgb
    """The band of road that somebody has drawn; it is dashed besides."""
    edge: Rgb
    edge_closed: Rgb
    """Closed edges are dashed besides."""
    selected: Rgb
    preview: Rgb
    arrow: Rgb
    ring: Rgb
    """Round what is selected."""
    cursor: Rgb


DARK = Theme(
    "dark", (24, 27, 33), (48, 54, 64), (72, 80, 94), (240, 200, 80), (86, 70, 30), (20, 110, 165), (44, 62, 92),
    (200, 60, 0), (255, 170, 0), (255, 240, 150), (235, 245, 255), (255, 255, 255), (255, 120, 200),
)  # fmt: skip
LIGHT = Theme(
    "light", (238, 240, 243), (212, 217, 224), (184, 191, 201), (176, 124, 0), (200, 160, 70), (30, 120, 180),
    (112, 124, 140), (190, 56, 0), (255, 170, 0), (0, 110, 190), (30, 42, 58), (20, 30, 44), (190, 20, 120),
)  # fmt: skip
THEMES: dict[str, Theme] = {theme.name: theme for theme in (DARK, LIGHT)}

PEOPLE: tuple[Rgb, ...] = ((230, 159, 0), (86, 180, 233), (0, 158, 115), (204, 121, 167), (213, 94, 0))
"""Rings of other people; their names stand beside them, for no colour is anybody's for long."""

STEPS: tuple[Rgb, ...] = ((68, 1, 84), (59, 82, 139), (33, 145, 140), (94, 201, 98), (253, 231, 37))
"""From low to high, in hue and in brightness: viridis, which no colour blindness confuses."""
KNOWN_WELL, KNOWN_FAIRLY, KNOWN_POORLY, NOT_KNOWN = (0, 158, 115), (240, 200, 60), (213, 60, 0), (120, 124, 132)


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

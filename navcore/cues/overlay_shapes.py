"""Shapes of the overlay: what is drawn, in metres before the eyes, whichever eye looks. Values only."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from navcore.cues.overlay_display import DisplayGeometry, Ink
from navcore.geometry import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Area:
    """A filled polygon."""

    points_m: FloatArray
    """Corners (n, 3): x right, y down, z forward."""
    ink: Ink


@dataclass(frozen=True, slots=True, eq=False)
class Line:
    """A line through points, or round them."""

    points_m: FloatArray
    """(n, 3): x right, y down, z forward."""
    ink: Ink
    width_px: int
    is_closed: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Label:
    """Figures or a word; the font has no others than Latin letters."""

    text: str
    at_m: FloatArray
    """The middle of the text (3,)."""
    ink: Ink
    height_px: int
    """Height of a capital letter."""
    is_degrees: bool = False
    """A degree sign follows."""
    is_on_sign: bool = False
    """It is written on what was drawn before; any other label keeps its ground clear."""


Shape = Area | Line | Label


@dataclass(frozen=True, slots=True)
class Sheet:
    """The virtual image as a sheet to draw signs on; pixels right of and below its middle."""

    display: DisplayGeometry
    u_px: float = 0.0
    """The origin of what is drawn."""
    v_px: float = 0.0

    def moved(self, u_px: float, v_px: float) -> Sheet:
        """Return the sheet with its origin elsewhere."""
        return Sheet(self.display, self.u_px + u_px, self.v_px + v_px)

    def points(self, pixels: FloatArray | list[tuple[float, float]]) -> FloatArray:
        """Return pixels (n, 2) as points (n, 3)."""
        pixels = np.asarray(pixels, dtype=np.float64).reshape(-1, 2)
        return self.display.at_image(pixels[:, 0] + self.u_px, pixels[:, 1] + self.v_px)

    def area(self, pixels: FloatArray | list[tuple[float, float]], ink: Ink) -> Area:
        """Return a filled polygon."""
        return Area(self.points(pixels), ink)

    def line(
        self, pixels: FloatArray | list[tuple[float, float]], ink: Ink, width_px: int = 4, *, is_closed: bool = False
    ) -> Line:
        """Return a line."""
        return Line(self.points(pixels), ink, width_px, is_closed)

    def ring(self, radius_px: float, ink: Ink, width_px: int = 4) -> Line:
        """Return a circle about the origin."""
        return self.line(_circle(radius_px, 40), ink, width_px, is_closed=True)

    def disc(self, radius_px: float, ink: Ink) -> Area:
        """Return a filled circle about the origin."""
        return self.area(_circle(radius_px, 24), ink)

    def label(
        self, text: str, ink: Ink, height_px: int, *, is_degrees: bool = False, is_on_sign: bool = False
    ) -> Label:
        """Return a text about the origin."""
        return Label(text, self.points([(0.0, 0.0)])[0], ink, height_px, is_degrees, is_on_sign)


def regular(corners: int, radius_px: float, first_rad: float = 0.0) -> FloatArray:
    """Return the corners (n, 2) of a regular polygon, from an angle clockwise of the top on."""
    angles = first_rad + math.tau * np.arange(corners) / corners
    return np.stack([radius_px * np.sin(angles), -radius_px * np.cos(angles)], axis=1)


def _circle(radius_px: float, corners: int) -> FloatArray:
    return regular(corners, radius_px, math.pi / corners)

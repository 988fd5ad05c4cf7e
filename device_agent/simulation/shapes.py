"""What a simulated building is made of: flat textured surfaces to be seen, and solids to bump into. Pure data."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace

import numpy as np

from navcore.geometry import FloatArray

Point3 = tuple[float, float, float]

GLASS = "glass"
"""Texture name of a pane: the depth camera and the eye look through it, the ultrasonic rangefinder does not."""


@dataclass(frozen=True, slots=True)
class Surface:
    """A flat, textured quadrilateral.

    Corners in metres, counter-clockwise seen from the visible side, beginning at the lower left one of the picture
    that is painted on it. ``texture`` names a pattern of :mod:`textures`.
    """

    corners: tuple[Point3, Point3, Point3, Point3]
    texture: str

    @property
    def normal(self) -> Point3:
        """Unit vector towards the visible side."""
        a, b, _, d = self.corners
        return _unit(_cross(_minus(b, a), _minus(d, a)))

    @property
    def size_m(self) -> tuple[float, float]:
        """Width along the lower edge and height across it, metres."""
        a, b = self.corners[:2]
        axis_v = _cross(self.normal, _unit(_minus(b, a)))
        heights = [sum(p * q for p, q in zip(corner, axis_v, strict=True)) for corner in self.corners]
        return math.dist(a, b), max(heights) - min(heights)

    def moved(self, x_m: float, y_m: float, z_m: float = 0.0, yaw_rad: float = 0.0) -> Surface:
        """Turn about the vertical axis through the origin, then shift."""
        c, s = math.cos(yaw_rad), math.sin(yaw_rad)
        a, b, d, e = ((x_m + c * x - s * y, y_m + s * x + c * y, z_m + z) for x, y, z in self.corners)
        return replace(self, corners=(a, b, d, e))


def _minus(p: Point3, q: Point3) -> Point3:
    return p[0] - q[0], p[1] - q[1], p[2] - q[2]


def _cross(p: Point3, q: Point3) -> Point3:
    return p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]


def _unit(p: Point3) -> Point3:
    length = math.hypot(*p)
    return p[0] / length, p[1] / length, p[2] / length


@dataclass(frozen=True, slots=True)
class Solid:
    """An upright box to bump into: a turned rectangle on the floor plan with a span of heights. Metres."""

    name: str
    x_m: float
    y_m: float
    half_x_m: float
    half_y_m: float
    yaw_rad: float = 0.0
    low_m: float = 0.0
    high_m: float = 2.7

    def moved(self, x_m: float, y_m: float, z_m: float = 0.0, yaw_rad: float = 0.0) -> Solid:
        """Turn about the vertical axis through the origin, then shift."""
        c, s = math.cos(yaw_rad), math.sin(yaw_rad)
        return replace(
            self,
            x_m=x_m + c * self.x_m - s * self.y_m,
            y_m=y_m + s * self.x_m + c * self.y_m,
            yaw_rad=self.yaw_rad + yaw_rad,
            low_m=self.low_m + z_m,
            high_m=self.high_m + z_m,
        )

    @property
    def outline_m(self) -> FloatArray:
        """Corners (4, 2) on the floor plan, counter-clockwise."""
        local = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]) * (self.half_x_m, self.half_y_m)
        c, s = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        outline: FloatArray = local @ np.array([[c, s], [-s, c]]) + np.array([self.x_m, self.y_m])
        return outline


@dataclass(frozen=True, slots=True)
class Piece:
    """A thing in the building: what is seen of it and what is bumped into."""

    surfaces: tuple[Surface, ...] = ()
    solids: tuple[Solid, ...] = ()

    def __add__(self, other: Piece) -> Piece:
        return Piece(self.surfaces + other.surfaces, self.solids + other.solids)

    def moved(self, x_m: float, y_m: float, yaw_deg: float = 0.0, z_m: float = 0.0) -> Piece:
        """Turn about the vertical axis through the origin, then shift."""
        yaw_rad = math.radians(yaw_deg)
        return Piece(
            tuple(surface.moved(x_m, y_m, z_m, yaw_rad) for surface in self.surfaces),
            tuple(solid.moved(x_m, y_m, z_m, yaw_rad) for solid in self.solids),
        )


def together(*pieces: Piece) -> Piece:
    """Put pieces into one, in order."""
    return Piece(
        tuple(surface for piece in pieces for surface in piece.surfaces),
        tuple(solid for piece in pieces for solid in piece.solids),
    )


def floor_quad(x0_m: float, y0_m: float, x1_m: float, y1_m: float, z_m: float, texture: str) -> Surface:
    """Return a level rectangle that is seen from above."""
    return Surface(((x0_m, y0_m, z_m), (x1_m, y0_m, z_m), (x1_m, y1_m, z_m), (x0_m, y1_m, z_m)), texture)


def ceiling_quad(x0_m: float, y0_m: float, x1_m: float, y1_m: float, z_m: float, texture: str) -> Surface:
    """Return a level rectangle that is seen from below."""
    return Surface(((x0_m, y1_m, z_m), (x1_m, y1_m, z_m), (x1_m, y0_m, z_m), (x0_m, y0_m, z_m)), texture)


def upright_quad(
    a_m: tuple[float, float], b_m: tuple[float, float], low_m: float, high_m: float, texture: str
) -> Surface:
    """Return an upright rectangle over the line from a to b; a is at the left of whoever sees it."""
    (ax, ay), (bx, by) = a_m, b_m
    return Surface(((ax, ay, low_m), (bx, by, low_m), (bx, by, high_m), (ax, ay, high_m)), texture)


def box(
    size_m: Point3,
    texture: str,
    *,
    base_m: float = 0.0,
    top: str = "",
    front: str = "",
    name: str = "",
) -> Piece:
    """Return a box centred on the origin, standing at height ``base_m``.

    ``front`` is the texture of its −y side and ``top`` that of the upper one, where they differ. With a ``name`` it is
    also a solid.
    """
    hx, hy, low, high = size_m[0] / 2, size_m[1] / 2, base_m, base_m + size_m[2]
    surfaces = [
        upright_quad((-hx, -hy), (hx, -hy), low, high, front or texture),
        upright_quad((hx, -hy), (hx, hy), low, high, texture),
        upright_quad((hx, hy), (-hx, hy), low, high, texture),
        upright_quad((-hx, hy), (-hx, -hy), low, high, texture),
        floor_quad(-hx, -hy, hx, hy, high, top or texture),
    ]
    if base_m > 0.0:
        surfaces.append(ceiling_quad(-hx, -hy, hx, hy, low, texture))
    solids = (Solid(name, 0.0, 0.0, hx, hy, 0.0, low, high),) if name else ()
    return Piece(tuple(surfaces), solids)


def column(
    radius_m: float, low_m: float, high_m: float, texture: str, *, top_radius_m: float | None = None, sides: int = 8
) -> Piece:
    """Return an upright prism (or, with another top radius, a tapered one) about the origin, with a lid."""
    upper = radius_m if top_radius_m is None else top_radius_m
    ring = [(math.cos(math.tau * k / sides), math.sin(math.tau * k / sides)) for k in range(sides + 1)]
    surfaces = [
        Surface(
            (
                (radius_m * ax, radius_m * ay, low_m),
                (radius_m * bx, radius_m * by, low_m),
                (upper * bx, upper * by, high_m),
                (upper * ax, upper * ay, high_m),
            ),
            texture,
        )
        for (ax, ay), (bx, by) in itertools.pairwise(ring)
    ]
    for k in range(1, sides - 1, 2):
        lid = [ring[0], ring[k], ring[k + 1], ring[k + 2 if k + 2 < sides else 0]]
        a, b, c, d = ((upper * x, upper * y, high_m) for x, y in lid)
        surfaces.append(Surface((a, b, c, d), texture))
    return Piece(tuple(surfaces))

"""Walls with openings, and what hangs on them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from device_agent.simulation.shapes import GLASS, Piece, Solid, Surface, together, upright_quad
from device_agent.simulation.textures import PATTERNS

HEIGHT_M = 2.7
THICKNESS_M = 0.12
Point2 = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Opening:
    """A hole in a wall, from ``begin_m`` to ``end_m`` along it: a door way, or a window when it has a sill."""

    begin_m: float
    end_m: float
    head_m: float = 2.1
    sill_m: float = 0.0


@dataclass(frozen=True, slots=True)
class Wall:
    """A straight wall from a to b; left and right are those of somebody who walks from a to b."""

    name: str
    a_m: Point2
    b_m: Point2
    left: str
    right: str
    openings: tuple[Opening, ...] = ()

    @property
    def length_m(self) -> float:
        """Distance from a to b."""
        return math.dist(self.a_m, self.b_m)

    def build(self) -> Piece:
        """Return the wall's faces and solids, glass in its windows included."""
        pieces: list[Piece] = []
        position = 0.0
        for number, opening in enumerate(sorted(self.openings, key=lambda o: o.begin_m)):
            pieces.append(self._block(f"{number}", position, opening.begin_m, 0.0, HEIGHT_M))
            pieces.append(self._block(f"{number}h", opening.begin_m, opening.end_m, opening.head_m, HEIGHT_M))
            if opening.sill_m > 0.0:
                pieces.append(self._block(f"{number}s", opening.begin_m, opening.end_m, 0.0, opening.sill_m))
                pieces.append(self._pane(opening))
            position = opening.end_m
        pieces.append(self._block("z", position, self.length_m, 0.0, HEIGHT_M))
        return together(*pieces).moved(
            *self.a_m, math.degrees(math.atan2(self.b_m[1] - self.a_m[1], self.b_m[0] - self.a_m[0]))
        )

    def _block(self, tag: str, begin_m: float, end_m: float, low_m: float, high_m: float) -> Piece:
        """A stretch of wall along x: a cuboid without lid where it reaches the ceiling."""
        # Walls that meet at a corner bury their ends in each other, 1 mm short of the other's face.
        begin = begin_m - THICKNESS_M / 2 + 0.001 if begin_m == 0.0 else begin_m
        end = end_m + THICKNESS_M / 2 - 0.001 if end_m == self.length_m else end_m
        if end - begin < 0.02:
            return Piece()
        half = THICKNESS_M / 2
        left, right = (
            _salted(texture, f"{self.name}{tag}{side}") for texture, side in ((self.left, "l"), (self.right, "r"))
        )
        faces = [
            upright_quad((end, half), (begin, half), low_m, high_m, left),
            upright_quad((begin, -half), (end, -half), low_m, high_m, right),
            upright_quad((begin, half), (begin, -half), low_m, high_m, "plain/#8b8578"),
            upright_quad((end, -half), (end, half), low_m, high_m, "plain/#8b8578"),
        ]
        if low_m == 0.0:
            faces += [
                upright_quad((end, half + 0.008), (begin, half + 0.008), 0.0, 0.09, "plain/#5c564e"),
                upright_quad((begin, -half - 0.008), (end, -half - 0.008), 0.0, 0.09, "plain/#5c564e"),
            ]
        else:
            faces.append(_level(begin, end, half, low_m, seen_from_below=True))
        if high_m < HEIGHT_M:
            faces.append(_level(begin, end, half + 0.05, high_m, seen_from_below=False))
        middle, half_length = (begin + end) / 2, (end - begin) / 2
        return Piece(tuple(faces), (Solid(f"wall {self.name}", middle, 0.0, half_length, half, 0.0, low_m, high_m),))

    def _pane(self, opening: Opening) -> Piece:
        begin, end = opening.begin_m, opening.end_m
        pane = upright_quad((begin, 0.0), (end, 0.0), opening.sill_m, opening.head_m, GLASS)
        bars = [begin, end, *np.arange(begin + 1.0, end - 0.4, 1.0).tolist()]
        frame = [
            upright_quad(
                (x + 0.03 * way, way * 0.03),
                (x - 0.03 * way, way * 0.03),
                opening.sill_m,
                opening.head_m,
                "dark/#33363a",
            )
            for x in bars
            for way in (1.0, -1.0)
        ]
        solid = Solid(
            f"window {self.name}", (begin + end) / 2, 0.0, (end - begin) / 2, 0.02, 0.0, opening.sill_m, opening.head_m
        )
        return Piece((pane, *frame), (solid,))

    def hang(self, texture: str, centre_m: float, size_m: Point2, base_m: float, *, on_left: bool = True) -> Surface:
        """Return a picture (door, sign, poster) flat on one side of the wall, its centre at ``centre_m`` along it."""
        half = THICKNESS_M / 2 + 0.012
        begin, end = centre_m - size_m[0] / 2, centre_m + size_m[0] / 2
        ends = ((end, half), (begin, half)) if on_left else ((begin, -half), (end, -half))
        quad = upright_quad(*ends, base_m, base_m + size_m[1], texture)
        return quad.moved(*self.a_m, 0.0, math.atan2(self.b_m[1] - self.a_m[1], self.b_m[0] - self.a_m[0]))

    def is_free(self, begin_m: float, end_m: float) -> bool:
        """Tell whether a stretch has no opening and lies on the wall."""
        inside = begin_m >= 0.1 and end_m <= self.length_m - 0.1
        return inside and all(end_m < o.begin_m - 0.08 or begin_m > o.end_m + 0.08 for o in self.openings)


def _level(begin: float, end: float, half: float, z: float, *, seen_from_below: bool) -> Surface:
    a, b, c, d = (begin, -half, z), (end, -half, z), (end, half, z), (begin, half, z)
    return Surface((d, c, b, a) if seen_from_below else (a, b, c, d), "plain/#8b8578")


def _salted(texture: str, salt: str) -> str:
    """Give a texture that does not repeat a name of its own, so that no two walls look alike."""
    return texture if PATTERNS[texture.split("/", 1)[0]].tile_m is not None else f"{texture}:{salt}"


def decorate(wall: Wall, rng: np.random.Generator, colours: Sequence[str], *, on_left: bool = True) -> Piece:
    """Hang posters, notice boards and closed doors along a corridor's side of a wall, leaving some of it plain."""
    hung: list[Surface] = []
    position, number = 0.3, 0
    while position < wall.length_m - 0.6:
        kind = rng.choice(["poster", "posters", "notice", "door", "gap"], p=[0.34, 0.24, 0.16, 0.16, 0.10])
        width = {"poster": 0.9, "posters": 1.5, "notice": 1.7, "door": 1.05, "gap": 1.6}[str(kind)]
        if wall.is_free(position, position + width):
            label = f"{wall.name}-{number}"
            hung += _decoration(wall, str(kind), position, width, label, colours, rng, on_left=on_left)
            position += width + float(rng.uniform(0.25, 0.8))
        else:
            position += 0.15
        number += 1
    return Piece(tuple(hung))


def _decoration(
    wall: Wall,
    kind: str,
    begin: float,
    width: float,
    label: str,
    colours: Sequence[str],
    rng: np.random.Generator,
    *,
    on_left: bool,
) -> list[Surface]:
    middle = begin + width / 2
    if kind == "poster":
        size = float(rng.uniform(0.6, 0.85))
        return [
            wall.hang(f"poster/{label}", middle, (size, size * 1.4), float(rng.uniform(0.95, 1.15)), on_left=on_left)
        ]
    if kind == "posters":
        return [
            wall.hang(
                f"poster/{label}{side}",
                middle + shift,
                (0.52, 0.74),
                1.2 + float(rng.uniform(-0.1, 0.1)),
                on_left=on_left,
            )
            for side, shift in (("a", -0.4), ("b", 0.4))
        ]
    if kind == "notice":
        return [wall.hang(f"notice/{label}", middle, (1.6, 1.05), 1.0, on_left=on_left)]
    if kind == "door":
        colour = colours[int(rng.integers(len(colours)))]
        room = str(int(rng.integers(3312, 3399)))
        return [wall.hang(f"door/{colour}:{room}", middle, (0.98, 2.1), 0.0, on_left=on_left)]
    return []

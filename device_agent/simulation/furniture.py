"""Furniture and fittings. Each stands at the origin with its front towards −y; move it with :meth:`Piece.moved`."""

from __future__ import annotations

import math
import zlib

import numpy as np

from device_agent.simulation.shapes import Piece, Solid, Surface, box, ceiling_quad, column, together, upright_quad

_WOOD = "veneer/#b08a5e"
_PALE = "veneer/#d8c8a8"
_STEEL = "metal/#8d9196"


def desk(label: str, width_m: float = 1.6) -> Piece:
    """A desk with a monitor; the seat is in front."""
    top = box((width_m, 0.75, 0.04), _PALE, base_m=0.70)
    legs = together(
        *(box((0.05, 0.6, 0.70), "dark/#303236").moved(x, 0.0) for x in (-width_m / 2 + 0.08, width_m / 2 - 0.08))
    )
    modesty = box((width_m - 0.2, 0.02, 0.4), _PALE, base_m=0.3).moved(0.0, 0.3)
    papers = box((0.3, 0.21, 0.02), "plain/#f4f2ea", base_m=0.74, top=f"poster/paper-{label}").moved(-0.45, -0.1, 17)
    solid = Piece((), (Solid("desk", 0.0, 0.0, width_m / 2, 0.375, 0.0, 0.0, 0.74),))
    return together(top, legs, modesty, papers, monitor(label).moved(0.1, 0.15, 0.0, 0.74), solid)


def monitor(label: str) -> Piece:
    """A monitor on its foot."""
    panel = box((0.56, 0.04, 0.34), "dark/#1c1d20", base_m=0.12, front=f"screen/{label}")
    return panel + box((0.2, 0.16, 0.02), "dark/#1c1d20") + box((0.05, 0.03, 0.12), "dark/#1c1d20").moved(0.0, 0.02)


def chair(colour: str = "#3c5a7a") -> Piece:
    """An office chair; its back is at +y."""
    seat = box((0.48, 0.46, 0.08), f"fabric/{colour}", base_m=0.42)
    back = box((0.46, 0.07, 0.5), f"fabric/{colour}", base_m=0.52).moved(0.0, 0.23)
    foot = (
        column(0.04, 0.05, 0.42, _STEEL, sides=8)
        + box((0.5, 0.08, 0.05), "dark/#26282b")
        + box((0.08, 0.5, 0.05), "dark/#26282b")
    )
    return together(seat, back, foot, Piece((), (Solid("chair", 0.0, 0.02, 0.25, 0.25, 0.0, 0.0, 1.02),)))


def sofa(colour: str, width_m: float = 2.0) -> Piece:
    """A sofa with cushions; its back is at +y."""
    cloth = f"fabric/{colour}"
    base = box((width_m, 0.85, 0.3), cloth, base_m=0.08)
    back = box((width_m, 0.22, 0.45), cloth, base_m=0.38).moved(0.0, 0.315)
    arms = together(
        *(box((0.18, 0.85, 0.25), cloth, base_m=0.38).moved(x, 0.0) for x in (-width_m / 2 + 0.09, width_m / 2 - 0.09))
    )
    cushions = together(
        box((0.42, 0.14, 0.36), "wallpaper/#c9a13b:cushion", base_m=0.4).moved(-0.5, 0.1, 6),
        box((0.42, 0.14, 0.36), "wallpaper/#7a3f4d:cushion", base_m=0.4).moved(0.45, 0.1, -8),
    )
    return together(
        base, back, arms, cushions, Piece((), (Solid("sofa", 0.0, 0.0, width_m / 2, 0.43, 0.0, 0.0, 0.83),))
    )


def low_table(label: str) -> Piece:
    """A low table with a magazine."""
    top = box((1.0, 0.55, 0.05), _WOOD, base_m=0.36)
    leg = box((0.06, 0.06, 0.36), _WOOD)
    legs = together(*(leg.moved(x, y) for x in (-0.44, 0.44) for y in (-0.21, 0.21)))
    magazine = box((0.24, 0.32, 0.015), "plain/#f4f2ea", base_m=0.41, top=f"poster/magazine-{label}").moved(
        0.15, 0.0, 25
    )
    return together(top, legs, magazine, Piece((), (Solid("table", 0.0, 0.0, 0.5, 0.275, 0.0, 0.0, 0.41),)))


def round_table(seats: int = 0, colour: str = "#8a3b2f") -> Piece:
    """A café table with stools around it."""
    table = (
        column(0.35, 0.70, 0.74, _WOOD, sides=8)
        + column(0.05, 0.03, 0.70, _STEEL, sides=8)
        + column(0.24, 0.0, 0.03, _STEEL, sides=8)
    )
    stools = [
        stool(colour, 0.45).moved(0.62 * math.cos(a), 0.62 * math.sin(a))
        for a in np.linspace(0.5, math.tau + 0.5, seats, endpoint=False)
    ]
    return together(table, Piece((), (Solid("table", 0.0, 0.0, 0.32, 0.32, 0.0, 0.0, 0.74),)), *stools)


def stool(colour: str, height_m: float) -> Piece:
    """A stool."""
    seat = column(0.18, height_m - 0.06, height_m, f"fabric/{colour}", sides=8)
    foot = column(0.035, 0.02, height_m - 0.06, _STEEL, sides=8) + column(0.17, 0.0, 0.02, _STEEL, sides=8)
    return together(seat, foot, Piece((), (Solid("stool", 0.0, 0.0, 0.16, 0.16, 0.0, 0.0, height_m),)))


def shelf(label: str, width_m: float = 1.2, height_m: float = 1.9) -> Piece:
    """A shelf full of books."""
    return box((width_m, 0.34, height_m), _WOOD, front=f"books/{label}", name="shelf")


def cabinet(width_m: float = 0.9, height_m: float = 1.1) -> Piece:
    """A low cabinet of pale wood."""
    return box((width_m, 0.36, height_m), _PALE, front="veneer/#c2a878", name="cabinet")


def counter(length_m: float, front: str, top: str = "wood/#6b4429") -> Piece:
    """A bar or reception counter; people stand in front of it."""
    body = box((length_m, 0.6, 1.04), front, name="counter")
    return body + box((length_m + 0.1, 0.75, 0.06), top, base_m=1.04)


def bottle_wall(label: str, width_m: float) -> Piece:
    """The back of a bar."""
    return box((width_m, 0.3, 2.2), "veneer/#5a3b28", front=f"bottles/{label}", name="bottle shelf")


def vending_machine(label: str) -> Piece:
    """A vending machine."""
    return box((0.9, 0.75, 1.85), "metal/#7d2024", front=f"vending/{label}", name="vending machine")


def bench() -> Piece:
    """A wooden bench without a back."""
    top = box((1.4, 0.36, 0.06), "wood/#a97b4d", base_m=0.4)
    legs = together(*(box((0.06, 0.3, 0.4), _STEEL).moved(x, 0.0) for x in (-0.55, 0.55)))
    return together(top, legs, Piece((), (Solid("bench", 0.0, 0.0, 0.7, 0.18, 0.0, 0.0, 0.46),)))


def plant(label: str, height_m: float = 1.5) -> Piece:
    """A plant in a pot: leaves in all directions, no two plants alike."""
    rng = np.random.default_rng(zlib.crc32(label.encode()))
    pot = column(0.13, 0.0, 0.36, "concrete/#8a7a6c:pot", top_radius_m=0.19)
    stem = column(0.02, 0.3, 0.75 * height_m, "veneer/#5b4a32", sides=8)
    greens = ("#3f7a3a", "#2f6434", "#5a9448", "#4d8058")
    leaves = [_leaf(rng, height_m, f"leaf/{greens[k % 4]}") for k in range(34)]
    solid = Solid("plant", 0.0, 0.0, 0.19, 0.19, 0.0, 0.0, height_m)
    return together(pot, stem, Piece(tuple(leaves), (solid,)))


def _leaf(rng: np.random.Generator, height_m: float, texture: str) -> Surface:
    """A leaf that grows outwards from the stem; its upper side is the visible one."""
    around, droop = float(rng.uniform(0, math.tau)), float(rng.uniform(-0.5, 1.0))
    length, half = float(rng.uniform(0.16, 0.3)), float(rng.uniform(0.03, 0.06))
    level = float(rng.uniform(0.42, 0.97)) * height_m
    out = np.array([math.cos(around) * math.cos(droop), math.sin(around) * math.cos(droop), math.sin(droop)])
    side = np.array([-math.sin(around), math.cos(around), 0.0])
    root = np.array([0.03 * math.cos(around), 0.03 * math.sin(around), level])
    corners = (
        root - 0.4 * half * side,
        root + length * out - half * side,
        root + length * out + half * side,
        root + 0.4 * half * side,
    )
    a, b, c, d = (tuple(float(value) for value in corner) for corner in corners)
    return Surface((a, b, c, d), texture)  # type: ignore[arg-type]


def pillar(texture: str, radius_m: float = 0.22) -> Piece:
    """A round pillar up to the ceiling."""
    return column(radius_m, 0.0, 2.7, texture) + Piece((), (Solid("pillar", 0.0, 0.0, radius_m, radius_m),))


def wash_basins(count: int, label: str) -> Piece:
    """A row of basins with mirrors and towel boxes, on a wall behind."""
    width = 0.8 * count
    board = box((width, 0.5, 0.16), "terrazzo/#c8c4ba:basin", base_m=0.72, name="basins")
    bowls = together(
        *(
            column(0.17, 0.86, 0.93, "plain/#fbfbf8", sides=8).moved((k + 0.5) * 0.8 - width / 2, 0.0)
            for k in range(count)
        )
    )
    mirror = Piece((upright_quad((-width / 2, 0.23), (width / 2, 0.23), 1.15, 1.95, "metal/#a9b6bd"),))
    return together(
        board,
        bowls,
        mirror,
        box((0.28, 0.12, 0.36), _STEEL, base_m=1.2, front=f"poster/towel-{label}").moved(width / 2 + 0.3, 0.2),
    )


def cubicle(colour: str, label: str) -> Piece:
    """A closed toilet cubicle."""
    return box((0.95, 1.4, 2.0), f"plain/{colour}", front=f"door/{colour}:{label}", name="cubicle")


def door_leaf(colour: str = "#9a6b3f") -> Piece:
    """An open door leaf, along x from the hinge at the origin."""
    leaf = box((1.2, 0.05, 2.06), f"veneer/{colour}", front=f"door/{colour}", name="door leaf")
    return leaf.moved(0.6, 0.0)


def copier(label: str) -> Piece:
    """An office copier."""
    body = box((0.65, 0.6, 0.95), "plain/#d5d8da", front="plain/#b8bdc2", top=f"screen/{label}", name="copier")
    return body + box((0.5, 0.45, 0.12), "dark/#3a3d42", base_m=0.95).moved(0.0, 0.05)


def ceiling_lamp(length_m: float = 1.2, width_m: float = 0.3) -> Piece:
    """A light panel just under a ceiling of 2.7 m."""
    return Piece((ceiling_quad(-length_m / 2, -width_m / 2, length_m / 2, width_m / 2, 2.69, "lamp/"),))

"""Holes in the floor: an open hatch, the head of a stair without a rail."""

from __future__ import annotations

from dataclasses import replace

from device_agent.simulation.building import Building
from device_agent.simulation.shapes import Solid, Surface, floor_quad, upright_quad
from navcore.errors import InputError

DEPTH_M = 0.8
BODY_RADIUS_M = 0.25
Rectangle = tuple[float, float, float, float]
"""x0, y0, x1, y1, metres."""


def with_hole(building: Building, hole_m: Rectangle) -> Building:
    """Return the building with a rectangular hole in its floor. Raises InputError where it lies in no single floor."""
    x0, y0, x1, y1 = hole_m
    floor = next((surface for surface in building.surfaces if _is_floor_around(surface, hole_m)), None)
    if floor is None or not (x0 < x1 and y0 < y1):
        raise InputError(f"The hole {hole_m} does not lie within the floor of one room: choose another place.")
    others = [surface for surface in building.surfaces if surface is not floor]
    walls = [
        upright_quad((x0, y1), (x1, y1), -DEPTH_M, 0.0, _CONCRETE),
        upright_quad((x1, y0), (x0, y0), -DEPTH_M, 0.0, _CONCRETE),
        upright_quad((x0, y0), (x0, y1), -DEPTH_M, 0.0, _CONCRETE),
        upright_quad((x1, y1), (x1, y0), -DEPTH_M, 0.0, _CONCRETE),
        floor_quad(x0, y0, x1, y1, -DEPTH_M, _CONCRETE),
    ]
    return replace(
        building,
        surfaces=(*others, *_cut(floor, hole_m), *walls),
        solids=(*building.solids, _stepping_in(hole_m)),
    )


_CONCRETE = "concrete/#8f9090:hatch"


def _stepping_in(hole_m: Rectangle) -> Solid:
    """Return what a body touches whose middle comes to the edge: its foot is over it then."""
    x0, y0, x1, y1 = hole_m
    half_x_m, half_y_m = (max(0.01, length_m / 2 - BODY_RADIUS_M) for length_m in (x1 - x0, y1 - y0))
    return Solid("hole", (x0 + x1) / 2, (y0 + y1) / 2, half_x_m, half_y_m, 0.0, 0.0, 1.0)


def _is_floor_around(surface: Surface, hole_m: Rectangle) -> bool:
    (ax, ay, az), _, (cx, cy, cz), _ = surface.corners
    is_floor = surface.normal[2] > 0.99 and az == 0.0 and cz == 0.0
    return is_floor and ax <= hole_m[0] and ay <= hole_m[1] and hole_m[2] <= cx and hole_m[3] <= cy


def _cut(floor: Surface, hole_m: Rectangle) -> list[Surface]:
    """Return the floor around the hole, as up to four rectangles."""
    (ax, ay, z), _, (cx, cy, _), _ = floor.corners
    x0, y0, x1, y1 = hole_m
    parts = ((ax, ay, cx, y0), (ax, y1, cx, cy), (ax, y0, x0, y1), (x1, y0, cx, y1))
    return [
        floor_quad(*part, z, floor.texture) for part in parts if part[2] - part[0] > 1e-6 and part[3] - part[1] > 1e-6
    ]

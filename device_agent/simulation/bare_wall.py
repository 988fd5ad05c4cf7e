"""A room with bare walls: what a rangefinder is aligned before."""

from __future__ import annotations

from device_agent.simulation.building import Building, Place
from device_agent.simulation.shapes import Piece, Solid, ceiling_quad, floor_quad, upright_quad

_WEST_M, _EAST_M, _SIDE_M, _HEIGHT_M, _THICK_M = -3.0, 5.0, 4.0, 2.7, 0.1
WALL_X_M = _EAST_M
"""The wall that somebody who looks along x faces."""


def bare_wall() -> Building:
    """Return the room; its walk leads along its middle and back."""
    corners = [(_WEST_M, -_SIDE_M), (_WEST_M, _SIDE_M), (_EAST_M, _SIDE_M), (_EAST_M, -_SIDE_M)]
    walls = [upright_quad(corners[at], corners[(at + 1) % 4], 0.0, _HEIGHT_M, "plain/#d8d4c8") for at in range(4)]
    floor = floor_quad(_WEST_M, -_SIDE_M, _EAST_M, _SIDE_M, 0.0, "terrazzo")
    ceiling = ceiling_quad(_WEST_M, -_SIDE_M, _EAST_M, _SIDE_M, _HEIGHT_M, "ceiling")
    middle_x_m, half_x_m = (_WEST_M + _EAST_M) / 2, (_EAST_M - _WEST_M) / 2
    solids = (
        Solid("west wall", _WEST_M - _THICK_M, 0.0, _THICK_M, _SIDE_M),
        Solid("east wall", _EAST_M + _THICK_M, 0.0, _THICK_M, _SIDE_M),
        Solid("south wall", middle_x_m, -_SIDE_M - _THICK_M, half_x_m, _THICK_M),
        Solid("north wall", middle_x_m, _SIDE_M + _THICK_M, half_x_m, _THICK_M),
    )
    inside = Piece((*walls, floor, ceiling), solids)
    there = (Place("Start", "hall", 0.0, 0.0), Place("Wall", "room", 4.0, 0.0))
    return Building(
        "the bare room", {place.name: place for place in there}, inside.surfaces, inside.solids, (),
        ((0.0, 0.0, _HEIGHT_M - 0.05), (3.0, 0.0, _HEIGHT_M - 0.05)), ((0.0, 0.0), (4.0, 0.0), (0.0, 0.0)),
    )  # fmt: skip

"""A small simulated building, quick to make: one room of 12 × 4 m, and a road from one end to the other."""

from __future__ import annotations

from device_agent.simulation.building import Building, Place
from device_agent.simulation.shapes import Piece, Solid, ceiling_quad, floor_quad, upright_quad

WEST_M, EAST_M, SOUTH_M, NORTH_M, HEIGHT_M = -1.0, 11.0, -2.0, 2.0, 2.7
START, END = Place("Start", "hall", 0.0, 0.0), Place("End", "bar", 9.0, 0.0)


def small_room() -> Building:
    """Return the room."""
    corners = [(WEST_M, SOUTH_M), (WEST_M, NORTH_M), (EAST_M, NORTH_M), (EAST_M, SOUTH_M)]
    textures = ("brick/west", "poster/north", "notice/east", "poster/south")
    walls = [
        upright_quad(corners[index], corners[(index + 1) % 4], 0.0, HEIGHT_M, textures[index]) for index in range(4)
    ]
    middle_x, middle_y = (WEST_M + EAST_M) / 2, (SOUTH_M + NORTH_M) / 2
    long_side, short_side = (EAST_M - WEST_M) / 2, (NORTH_M - SOUTH_M) / 2
    solids = (
        Solid("west wall", WEST_M - 0.1, middle_y, 0.1, short_side),
        Solid("east wall", EAST_M + 0.1, middle_y, 0.1, short_side),
        Solid("south wall", middle_x, SOUTH_M - 0.1, long_side, 0.1),
        Solid("north wall", middle_x, NORTH_M + 0.1, long_side, 0.1),
    )
    inside = Piece(
        (
            *walls,
            floor_quad(WEST_M, SOUTH_M, EAST_M, NORTH_M, 0.0, "terrazzo"),
            ceiling_quad(WEST_M, SOUTH_M, EAST_M, NORTH_M, HEIGHT_M, "ceiling"),
        ),
        solids,
    )
    return Building(
        "the room", {place.name: place for place in (START, END)}, inside.surfaces, inside.solids, (),
        ((2.0, 0.0, HEIGHT_M - 0.05), (7.0, 0.0, HEIGHT_M - 0.05)), ((0.0, 0.0), (9.0, 0.0), (0.0, 0.0)),
    )  # fmt: skip

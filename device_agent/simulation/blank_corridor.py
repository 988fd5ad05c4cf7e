"""Two furnished rooms with a bare corridor between them: 16 m, a corner, and 10 m more of plain paint and plain floor.

What the picture lacks there, depth must give: walls and floor hold the pose, but for the way along the corridor, which
only its corner and its ends can tell.
"""

from __future__ import annotations

import numpy as np

from device_agent.simulation import furniture as fit
from device_agent.simulation.building import Building, Place, Room
from device_agent.simulation.shapes import Piece, ceiling_quad, floor_quad, together
from device_agent.simulation.walls import HEIGHT_M, Wall, decorate

_BARE, _CREAM = "plain/#dedad0", "paint/#e9e3d3"
_ROOMS = (
    Room("Office", 0.0, -1.6, 6.0, 4.0),
    Room("Corridor", 6.0, 0.0, 22.0, 2.4, is_corridor=True),
    Room("Corridor north", 19.6, 2.4, 22.0, 12.0, is_corridor=True),
    Room("Lounge", 17.5, 12.0, 24.0, 17.0),
)
_FLOORS = {"Office": "carpet/#707a86:blank-a", "Lounge": "wood/#9c6b42:blank-b"}
_FURNISHED = (
    Wall("office-w", (0.0, 4.0), (0.0, -1.6), _CREAM, _CREAM),
    Wall("office-s", (0.0, -1.6), (6.0, -1.6), "brick/#a8573f", _CREAM),
    Wall("office-n", (6.0, 4.0), (0.0, 4.0), _CREAM, _CREAM),
    Wall("lounge-e", (24.0, 12.0), (24.0, 17.0), _CREAM, _CREAM),
    Wall("lounge-n", (24.0, 17.0), (17.5, 17.0), "brick/#8f6238", _CREAM),
    Wall("lounge-w", (17.5, 17.0), (17.5, 12.0), _CREAM, _CREAM),
)
_OTHERS = (
    Wall("office-e1", (6.0, -1.6), (6.0, 0.0), _CREAM, _BARE),
    Wall("office-e2", (6.0, 2.4), (6.0, 4.0), _CREAM, _BARE),
    Wall("corridor-s", (6.0, 0.0), (22.0, 0.0), _BARE, _BARE),
    Wall("corridor-n", (19.6, 2.4), (6.0, 2.4), _BARE, _BARE),
    Wall("corridor-e", (22.0, 0.0), (22.0, 12.0), _BARE, _BARE),
    Wall("corridor-w", (19.6, 12.0), (19.6, 2.4), _BARE, _BARE),
    Wall("lounge-s1", (17.5, 12.0), (19.6, 12.0), _CREAM, _BARE),
    Wall("lounge-s2", (22.0, 12.0), (24.0, 12.0), _CREAM, _BARE),
)
_PLACES = (
    Place("Office", "room", 2.4, 1.2),
    Place("Corner", "junction", 20.8, 1.2),
    Place("Lounge", "lounge", 20.8, 14.4),
)
_LAMPS_M = (
    *((float(x), 1.2, HEIGHT_M - 0.04) for x in (2.0, 4.5, 8.0, 11.0, 14.0, 17.0, 20.0)),
    *((20.8, float(y), HEIGHT_M - 0.04) for y in (4.5, 7.5, 10.5, 13.5, 15.5)),
)


def blank_corridor(seed: int = 0) -> Building:
    """Return the floor; its walk leads from the office to the lounge and back. The seed changes the pictures."""
    rng = np.random.default_rng([seed, 93])
    furniture = _furniture()
    everything = together(
        *(wall.build() for wall in (*_FURNISHED, *_OTHERS)),
        *(decorate(wall, rng, ("#9a6b3f", "#7d8a94", "#b58b5a")) for wall in _FURNISHED),
        *(_floor_and_ceiling(room) for room in _ROOMS),
        *(fit.ceiling_lamp().moved(x_m, y_m) for x_m, y_m, _ in _LAMPS_M),
        *furniture,
    )
    there = tuple((place.x_m, place.y_m) for place in _PLACES)
    return Building(
        name="blank corridor",
        places={place.name: place for place in _PLACES},
        surfaces=everything.surfaces,
        solids=everything.solids,
        rooms=_ROOMS,
        lamps_m=_LAMPS_M,
        road_waypoints=(*there, *there[-2::-1]),
        seed=seed,
        movable=tuple(furniture),
    )


def _floor_and_ceiling(room: Room) -> Piece:
    corners = (room.x0_m, room.y0_m, room.x1_m, room.y1_m)
    floor = floor_quad(*corners, 0.0, _FLOORS.get(room.name, "plain/#b5b2aa"))
    return Piece((floor, ceiling_quad(*corners, HEIGHT_M, "plain/#eceae4")))


def _furniture() -> list[Piece]:
    return [
        fit.desk("blank-a").moved(1.2, 3.3),
        fit.shelf("blank-a", 1.4).moved(3.6, 3.75),
        fit.chair().moved(1.2, -0.9),
        fit.plant("blank-a", 1.5).moved(5.5, -1.1),
        fit.cabinet().moved(0.25, 0.0, 90.0),
        fit.sofa("#8c4a3c").moved(18.2, 14.6, 90.0),
        fit.shelf("blank-b", 1.2).moved(19.4, 16.75),
        fit.plant("blank-b", 1.7).moved(23.5, 16.4),
        fit.round_table(2).moved(22.9, 14.0),
    ]

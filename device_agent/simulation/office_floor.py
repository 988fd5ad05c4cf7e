"""The office floor of the experiments, 30 × 20 m: hall A, wash room B, bar C, lounge D, Room 3308 E, Room 3311, H–K.

A ladder of corridors 2.4 m wide. From the bar to Room 3311 the shortest way is J → I → K → H, as in the paper's
Fig. 4 (b). ::

    ┌────────┬───────┬──────────────┐
    │ 3311   │ 3308 E│   lounge D   │
    └──┐  ┌──┴─┐  ┌──┴──────┐  ┌────┴─┐
       │  H    e     K      d      I  │
       │  ┌─────────┐  ┌─────────┐ │  └─────────┐
    ┌──┘  │ office  │  │ archive │ │            │
    │ B   b         │  │         │ J     bar C  │
    └──┐  └─────────┘  └─────────┘ │  ┌─────────┘
       │             s             │  │
       └──────────┐     ┌──────────┘──┘
                  │hall A│
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from device_agent.simulation import furniture as fit
from device_agent.simulation.building import Building, Mover, Place, Room
from device_agent.simulation.office_furniture import is_movable, office_furniture
from device_agent.simulation.shapes import Piece, Point3, Surface, ceiling_quad, floor_quad, together
from device_agent.simulation.walls import HEIGHT_M, Opening, Wall, decorate

_DOOR = 1.3
"""Clear width of door ways, metres."""

PLACES = (
    Place("Hall", "hall", 15.0, 2.6),
    Place("Wash room", "toilet", 4.3, 10.0),
    Place("Bar", "bar", 26.7, 10.0),
    Place("Lounge", "lounge", 19.0, 16.9),
    Place("Room 3308", "room", 11.0, 16.9),
    Place("Room 3311", "room", 7.0, 16.9),
    Place("H", "junction", 7.0, 14.0),
    Place("I", "junction", 23.0, 14.0),
    Place("J", "junction", 23.0, 10.0),
    Place("K", "junction", 15.0, 14.0),
)

_NODES: dict[str, tuple[float, float]] = {
    "A": (15.0, 2.6),
    "B": (4.3, 10.0),
    "C": (26.7, 10.0),
    "D": (19.0, 16.9),
    "E": (11.0, 16.9),
    "R": (7.0, 16.9),
    "H": (7.0, 14.0),
    "I": (23.0, 14.0),
    "J": (23.0, 10.0),
    "K": (15.0, 14.0),
    "b": (7.0, 10.0),
    "d": (19.0, 14.0),
    "e": (11.0, 14.0),
    "s": (15.0, 6.0),
    "w": (7.0, 6.0),
    "o": (23.0, 6.0),
}
_WALK = "A s w b B b H R H e K s o J I d K e E e H b B b w s K d D d I J C J o s A"
"""Every piece of corridor in both directions, and every turn of the experiments' paths; begins and ends in the hall."""

_ROOMS = (
    Room("Hall", 11.0, 0.2, 19.0, 4.8),
    Room("Wash room", 1.2, 7.8, 5.8, 12.2),
    Room("Bar", 24.2, 7.2, 29.8, 12.8),
    Room("Lounge", 14.0, 15.2, 22.0, 19.8),
    Room("Room 3308", 9.2, 15.2, 14.0, 19.8),
    Room("Room 3311", 4.5, 15.2, 9.2, 19.8),
    Room("Office", 8.2, 7.2, 13.8, 12.8),
    Room("Archive", 16.2, 7.2, 21.8, 12.8),
    Room("South corridor", 5.8, 4.8, 24.2, 7.2, is_corridor=True),
    Room("North corridor", 5.8, 12.8, 24.2, 15.2, is_corridor=True),
    Room("West corridor", 5.8, 7.2, 8.2, 12.8, is_corridor=True),
    Room("East corridor", 21.8, 7.2, 24.2, 12.8, is_corridor=True),
    Room("Middle corridor", 13.8, 7.2, 16.2, 12.8, is_corridor=True),
)
_FLOORS = {
    "Hall": "terrazzo/#cfc6b4:hall",
    "Wash room": "tiles/#b9c4c6:wash",
    "Bar": "wood/#9c6b42:bar",
    "Lounge": "carpet/#6e4a52:lounge",
    "Room 3308": "carpet/#5c6c58:3308",
    "Room 3311": "wood/#b98d5c:3311",
    "Office": "carpet/#707a86:office",
    "Archive": "plain/#9a9a96",
    "South corridor": "terrazzo/#b8b2a4:south",
    "North corridor": "carpet/#5b6878:north",
    "West corridor": "carpet/#7a6450:west",
    "East corridor": "carpet/#4f6b66:east",
    "Middle corridor": "wood/#a67c52:middle",
}
_CREAM, _SAND, _MINT, _SKY, _ROSE = "paint/#e9e3d3", "paint/#ddcfb4", "paint/#d3e0d4", "paint/#d3dee8", "paint/#e6d3cd"
_BRICK, _CONCRETE, _PANEL, _TILED = "brick/#a8573f", "concrete/#aeb0b0", "wood/#8f6238", "tiles/#c9d4d2"

# Walls by name: from, to, left side, right side, openings. Left and right of somebody who walks along them.
_WALLS = (
    Wall("n1", (4.5, 15.2), (9.2, 15.2), _CREAM, _SKY, (Opening(1.85, 1.85 + _DOOR),)),
    Wall("n2", (9.2, 15.2), (14.0, 15.2), _MINT, _SKY, (Opening(1.15, 1.15 + _DOOR),)),
    Wall("n3", (14.0, 15.2), (22.0, 15.2), "wallpaper/#d9c6b0", _CONCRETE, (Opening(4.0, 6.0, 2.3),)),
    Wall("n4", (22.0, 15.2), (24.2, 15.2), _SKY, _SKY),
    Wall("w1", (5.8, 15.2), (5.8, 12.2), _SAND, _CREAM),
    Wall("w2", (5.8, 12.2), (5.8, 7.8), _SAND, _TILED, (Opening(1.55, 1.55 + _DOOR),)),
    Wall("w3", (5.8, 7.8), (5.8, 4.8), _BRICK, _CREAM),
    Wall("s1", (5.8, 4.8), (11.0, 4.8), _CREAM, _CREAM),
    Wall("s2", (11.0, 4.8), (19.0, 4.8), _CREAM, _PANEL, (Opening(1.4, 6.6, 2.4),)),
    Wall("s3", (19.0, 4.8), (24.2, 4.8), _CREAM, _CREAM),
    Wall("e1", (24.2, 4.8), (24.2, 7.2), _MINT, _CREAM),
    Wall("e2", (24.2, 7.2), (24.2, 12.8), _BRICK, _SAND, (Opening(1.8, 3.8, 2.3),)),
    Wall("e3", (24.2, 12.8), (24.2, 15.2), _MINT, _CREAM),
    Wall("p1", (13.8, 7.2), (8.2, 7.2), _CREAM, _CREAM, (Opening(1.3, 4.3, 2.1, 0.9),)),
    Wall("p2", (8.2, 7.2), (8.2, 12.8), _SAND, _CREAM),
    Wall("p3", (8.2, 12.8), (13.8, 12.8), _SKY, _CREAM),
    Wall("p4", (13.8, 12.8), (13.8, 7.2), _PANEL, _CREAM),
    Wall("q1", (21.8, 7.2), (16.2, 7.2), _CONCRETE, _CREAM),
    Wall("q2", (16.2, 7.2), (16.2, 12.8), _ROSE, _CREAM),
    Wall("q3", (16.2, 12.8), (21.8, 12.8), _SKY, _CREAM),
    Wall("q4", (21.8, 12.8), (21.8, 7.2), _MINT, _CREAM),
    Wall("hall-w", (11.0, 4.8), (11.0, 0.2), _CREAM, _CREAM),
    Wall("hall-s", (11.0, 0.2), (19.0, 0.2), _CREAM, _CREAM),
    Wall("hall-e", (19.0, 0.2), (19.0, 4.8), _BRICK, _CREAM),
    Wall("wash-n", (5.8, 12.2), (1.2, 12.2), _TILED, _CREAM),
    Wall("wash-w", (1.2, 12.2), (1.2, 7.8), _TILED, _CREAM),
    Wall("wash-s", (1.2, 7.8), (5.8, 7.8), _TILED, _CREAM),
    Wall("bar-s", (24.2, 7.2), (29.8, 7.2), _SAND, _CREAM),
    Wall("bar-e", (29.8, 7.2), (29.8, 12.8), _SAND, _CREAM),
    Wall("bar-n", (29.8, 12.8), (24.2, 12.8), _PANEL, _CREAM),
    Wall("3311-w", (4.5, 19.8), (4.5, 15.2), _CREAM, _CREAM),
    Wall("3311-n", (9.2, 19.8), (4.5, 19.8), _CREAM, _CREAM),
    Wall("3308-w", (9.2, 19.8), (9.2, 15.2), _MINT, _CREAM),
    Wall("3308-n", (14.0, 19.8), (9.2, 19.8), _MINT, _CREAM),
    Wall("lounge-w", (14.0, 19.8), (14.0, 15.2), _ROSE, _MINT),
    Wall("lounge-n", (22.0, 19.8), (14.0, 19.8), _ROSE, _CREAM),
    Wall("lounge-e", (22.0, 15.2), (22.0, 19.8), "wallpaper/#b9c7b4", _CREAM),
)
_DECORATED = (
    "n1-",
    "n2-",
    "n3-",
    "n4-",
    "w1",
    "w2",
    "w3",
    "s1",
    "s3",
    "e1",
    "e2",
    "e3",
    "p1",
    "p2",
    "p3",
    "p4",
    "q1",
    "q2",
    "q3",
    "q4",
)
_DOOR_COLOURS = ("#9a6b3f", "#7d8a94", "#b58b5a")


def office_floor(obstacles: Sequence[Piece] = (), movers: Sequence[Mover] = (), seed: int = 0) -> Building:
    """Return the floor; obstacles stand where they have been moved to, movers walk. The seed changes the pictures."""
    walls = {wall.name: wall for wall in _WALLS}
    furniture = office_furniture()
    pieces = [
        *(wall.build() for wall in _WALLS),
        _decorations(walls, seed),
        _signs(walls),
        _outlook(walls),
        _floors_and_ceilings(),
        _lamps(),
        *furniture,
    ]
    everything = together(*pieces)
    building = Building(
        "office floor",
        {place.name: place for place in PLACES},
        everything.surfaces,
        everything.solids,
        _ROOMS,
        tuple(_lamp_places()),
        tuple(_NODES[node] for node in _WALK.split()),
        tuple(movers),
        seed,
        tuple(piece for piece in furniture if is_movable(piece)),
    )
    return building.with_pieces(*obstacles)


def _decorations(walls: dict[str, Wall], seed: int) -> Piece:
    rng = np.random.default_rng([seed, 77])
    pieces = []
    for name in _DECORATED:
        wall = walls[name.rstrip("-")]
        pieces.append(decorate(wall, rng, _DOOR_COLOURS, on_left=not name.endswith("-")))
    return together(*pieces)


def _signs(walls: dict[str, Wall]) -> Piece:
    """Plates at doors and junctions, and pictures in the rooms."""
    plates = [
        walls["n1"].hang("sign/3311", 3.45, (0.36, 0.2), 1.75, on_left=False),
        walls["n2"].hang("sign/3308", 2.75, (0.36, 0.2), 1.75, on_left=False),
        walls["n3"].hang("sign/LOUNGE", 5.0, (0.9, 0.24), 2.36, on_left=False),
        walls["w2"].hang("sign/WC", 1.25, (0.3, 0.3), 1.7),
        walls["e2"].hang("sign/BAR", 2.8, (0.7, 0.26), 2.36),
        walls["s2"].hang("sign/HALL", 4.0, (0.9, 0.2), 2.45),
        walls["w1"].hang("exit/west", 1.2, (0.5, 0.2), 2.35),
        walls["e3"].hang("exit/east", 1.2, (0.5, 0.2), 2.35),
        walls["w3"].hang("exit/south", 1.8, (0.5, 0.2), 2.35),
        walls["hall-w"].hang("notice/hall", 2.3, (2.2, 1.3), 0.9),
        walls["hall-e"].hang("poster/hall-east", 1.9, (0.9, 1.25), 0.95),
        walls["s2"].hang("poster/hall-1", 0.7, (0.8, 1.1), 1.0, on_left=False),
        walls["s2"].hang("poster/hall-2", 7.3, (0.8, 1.1), 1.0, on_left=False),
        walls["wash-w"].hang("poster/wash-hands", 2.2, (0.7, 0.95), 1.1),
        walls["wash-w"].hang("notice/wash-plan", 3.5, (0.8, 0.6), 1.2),
        walls["3311-w"].hang("notice/3311", 2.0, (2.2, 1.2), 0.95),
        walls["3308-w"].hang("poster/3308-map", 2.2, (1.6, 1.1), 1.0),
        walls["lounge-e"].hang("poster/lounge-east", 2.3, (1.2, 1.5), 0.85),
        walls["lounge-w"].hang("poster/lounge-west", 2.4, (1.3, 1.5), 0.85),
        walls["bar-s"].hang("poster/bar-1", 1.5, (0.8, 1.1), 1.0),
        walls["bar-s"].hang("poster/bar-2", 4.2, (0.8, 1.1), 1.0),
    ]
    return Piece(tuple(plates))


def _outlook(walls: dict[str, Wall]) -> Piece:
    """Windows to the outside, as pictures: nobody gets near them."""
    return Piece(
        (
            walls["hall-s"].hang("window/entrance", 4.0, (5.0, 2.3), 0.05),
            walls["3311-n"].hang("window/3311", 2.3, (3.0, 1.3), 0.95),
            walls["3308-n"].hang("window/3308", 2.4, (3.2, 1.3), 0.95),
            walls["lounge-n"].hang("window/lounge-1", 2.2, (2.8, 1.6), 0.7),
            walls["lounge-n"].hang("window/lounge-2", 5.8, (2.8, 1.6), 0.7),
            walls["bar-e"].hang("window/bar", 1.2, (1.6, 1.2), 1.0),
        )
    )


def _floors_and_ceilings() -> Piece:
    surfaces: list[Surface] = []
    for room in _ROOMS:
        corners = (room.x0_m, room.y0_m, room.x1_m, room.y1_m)
        surfaces.append(floor_quad(*corners, 0.0, _FLOORS[room.name]))
        surfaces.append(ceiling_quad(*corners, HEIGHT_M, "ceiling/#eceae4"))
    # A door mat in the hall and a rug in the lounge: flat, so no solids.
    surfaces.append(floor_quad(13.6, 0.5, 16.4, 1.6, 0.006, "carpet/#3c3a38:mat"))
    surfaces.append(floor_quad(15.0, 16.0, 17.6, 18.4, 0.008, "wallpaper/#a05a48:rug"))
    return Piece(tuple(surfaces))


def _lamp_places() -> list[Point3]:
    corridors = [(x, y) for y in (6.0, 14.0) for x in np.arange(7.0, 23.5, 2.667)]
    corridors += [(x, y) for x in (7.0, 15.0, 23.0) for y in (8.7, 11.3)]
    rooms = [(13.0, 2.4), (17.0, 2.4), (2.5, 10.0), (4.6, 10.0), (25.8, 8.8), (28.2, 8.8), (25.8, 11.2), (28.2, 11.2)]
    rooms += [
        (5.7, 17.5),
        (8.0, 17.5),
        (10.4, 17.5),
        (12.8, 17.5),
        (15.5, 17.5),
        (18.0, 17.5),
        (20.5, 17.5),
        (9.8, 10.0),
        (12.2, 10.0),
    ]
    return [(float(x), float(y), 2.66) for x, y in corridors + rooms]


def _lamps() -> Piece:
    return together(
        *(fit.ceiling_lamp().moved(x, y, 90.0 if k % 3 == 0 else 0.0) for k, (x, y, _) in enumerate(_lamp_places()))
    )

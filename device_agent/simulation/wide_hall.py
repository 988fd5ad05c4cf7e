"""A hall of 26 × 20 m with little in it: most walls lie beyond the depth camera's reach, which is what it is for.

Somebody who walks through its middle has floor near by and walls far away; pictures, doors and notices hang on them.
"""

from __future__ import annotations

import numpy as np

from device_agent.simulation import furniture as fit
from device_agent.simulation.building import Building, Place, Room
from device_agent.simulation.shapes import Piece, ceiling_quad, floor_quad, together
from device_agent.simulation.walls import HEIGHT_M, Wall, decorate

LENGTH_M, WIDTH_M = 26.0, 20.0
_ROOM = Room("Hall", 0.0, 0.0, LENGTH_M, WIDTH_M)
_WALLS = (
    Wall("south", (0.0, 0.0), (LENGTH_M, 0.0), "paint/#e9e3d3", "paint/#e9e3d3"),
    Wall("east", (LENGTH_M, 0.0), (LENGTH_M, WIDTH_M), "brick/#a8573f", "paint/#e9e3d3"),
    Wall("north", (LENGTH_M, WIDTH_M), (0.0, WIDTH_M), "paint/#d3dee8", "paint/#e9e3d3"),
    Wall("west", (0.0, WIDTH_M), (0.0, 0.0), "wood/#8f6238", "paint/#e9e3d3"),
)
_PLACES = (
    Place("Entrance", "hall", 7.0, 7.0),
    Place("Counter", "other", 19.0, 7.0),
    Place("Lift", "lift", 19.0, 13.0),
    Place("Exit", "exit", 7.0, 13.0),
)
_ROUND = ((7.0, 7.0), (19.0, 7.0), (19.0, 13.0), (7.0, 13.0), (7.0, 7.0), (13.0, 7.0))
"""The sighted person's walk: once round the middle, and on until the beginning is seen again."""
ACROSS = ((9.0, 8.0), (18.0, 11.5), (18.0, 8.5), (8.0, 12.0), (12.0, 12.0))
"""A walk that goes where the first one did not, and looks where it did not."""


def wide_hall(road_waypoints: tuple[tuple[float, float], ...] = _ROUND, seed: int = 0) -> Building:
    """Return the hall; ``road_waypoints`` are the corners of the walk through it. The seed changes the pictures."""
    rng = np.random.default_rng([seed, 91])
    lamps = [(x, y, HEIGHT_M - 0.04) for x in (3.25, 9.75, 16.25, 22.75) for y in (4.0, 10.0, 16.0)]
    everything = together(
        *(wall.build() for wall in _WALLS),
        *(decorate(wall, rng, ("#9a6b3f", "#7d8a94", "#b58b5a")) for wall in _WALLS),
        Piece(
            (
                floor_quad(0.0, 0.0, LENGTH_M, WIDTH_M, 0.0, "terrazzo/#cfc6b4:wide"),
                ceiling_quad(0.0, 0.0, LENGTH_M, WIDTH_M, HEIGHT_M, "ceiling/#eceae4"),
            )
        ),
        *(fit.ceiling_lamp().moved(x, y) for x, y, _ in lamps),
        *_furniture(),
    )
    return Building(
        name="wide hall",
        places={place.name: place for place in _PLACES},
        surfaces=everything.surfaces,
        solids=everything.solids,
        rooms=(_ROOM,),
        lamps_m=tuple(lamps),
        road_waypoints=road_waypoints,
        seed=seed,
    )


def _furniture() -> tuple[Piece, ...]:
    return (
        fit.bench().moved(4.0, 1.0, 180.0),
        fit.bench().moved(16.0, 1.0, 180.0),
        fit.sofa("#5a6c84").moved(24.8, 10.0, -90.0),
        fit.plant("hall-a").moved(1.0, 1.0),
        fit.plant("hall-b").moved(25.0, 19.0),
        fit.vending_machine("hall").moved(12.0, 19.3),
        fit.pillar("concrete/#aeb0b0").moved(10.0, 10.0),
        fit.pillar("concrete/#aeb0b0").moved(16.0, 10.0),
    )

"""Between recording and walking people move furniture: some is gone, some stands elsewhere, some is new."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np

from device_agent.simulation import furniture as fit
from device_agent.simulation.building import Building, Room, checked_seed, push_from_solids, touchable
from device_agent.simulation.obstacles import carton
from device_agent.simulation.shapes import Piece
from navcore.geometry import FloatArray

ROAD_CLEAR_M = 0.62
"""Nothing is put nearer to the road than this: the ways stay passable."""
_GONE_SHARE = 0.35
_NEW_SHARE = 0.3
_ATTEMPTS = 60
_NEAR_M = 2.5
"""What is moved stays within this distance."""


def refurnished(building: Building, share: float, seed: int) -> Building:
    """Return the building with a share of its movable furniture changed. The same seed changes the same."""
    if share == 0.0:
        return building
    rng = np.random.default_rng([checked_seed(seed), 19])
    standing = list(building.movable)
    chosen = rng.permutation(len(standing))[: round(share * len(standing))]
    changed: list[Piece] = [piece for k, piece in enumerate(standing) if k not in set(chosen.tolist())]
    gone = building.with_movable(changed)
    mover = _Placing(gone, rng)
    for k in chosen.tolist():
        if rng.random() >= _GONE_SHARE:
            mover.place_near(standing[k])
    for number in range(math.ceil(_NEW_SHARE * len(chosen))):
        mover.place_anywhere(_new_piece(rng, f"new-{seed}-{number}"))
    return building.with_movable([*changed, *mover.placed])


def _new_piece(rng: np.random.Generator, label: str) -> Piece:
    """Return something that somebody has put there, at the origin."""
    kinds = (
        carton(0.0, 0.0),
        fit.plant(label, 1.4),
        fit.chair("#7a3c3c"),
        fit.cabinet(0.8, 1.0),
        fit.bench(),
        fit.shelf(label, 1.0, 1.6),
    )
    return kinds[int(rng.integers(len(kinds)))]


class _Placing:
    """Puts pieces where there is room for them."""

    def __init__(self, building: Building, rng: np.random.Generator) -> None:
        self._building = building
        self._rng = rng
        self._road = _road_spots(building.road_waypoints)
        self.placed: list[Piece] = []

    def place_near(self, piece: Piece) -> None:
        """Move a piece by up to ``_NEAR_M`` and turn it; leave it out where it fits nowhere."""
        middle = _middle(piece)
        reach = np.array([_NEAR_M, _NEAR_M])
        self._place(piece, middle, middle - reach, middle + reach, self._building.rooms)

    def place_anywhere(self, piece: Piece) -> None:
        """Put a piece somewhere along the walls of the corridors or into a room; leave it out where it fits nowhere."""
        room = self._building.rooms[int(self._rng.integers(len(self._building.rooms)))]
        low, high = np.array([room.x0_m, room.y0_m]), np.array([room.x1_m, room.y1_m])
        self._place(piece, _middle(piece), low, high, (room,))

    def _place(
        self, piece: Piece, middle: FloatArray, low: FloatArray, high: FloatArray, rooms: Sequence[Room]
    ) -> None:
        at_origin = piece.moved(-float(middle[0]), -float(middle[1]))
        for _ in range(_ATTEMPTS):
            x_m, y_m = (float(value) for value in self._rng.uniform(low, high))
            turn_deg = float(self._rng.choice([0.0, 90.0, 180.0, 270.0])) + float(self._rng.normal(0.0, 6.0))
            moved = at_origin.moved(0.0, 0.0, turn_deg).moved(x_m, y_m)
            if self._fits(moved, rooms):
                self.placed.append(moved)
                return

    def _fits(self, piece: Piece, rooms: Sequence[Room]) -> bool:
        spots = np.concatenate([_spots(solid.outline_m) for solid in piece.solids])
        if not any(_holds(room, spots) for room in rooms):
            return False
        own = touchable(piece.solids)
        if any(push_from_solids(own, float(x), float(y))[0] < ROAD_CLEAR_M for x, y in self._road):
            return False
        others = touchable((*self._building.solids, *(solid for other in self.placed for solid in other.solids)))
        return all(push_from_solids(others, float(x), float(y))[0] > 0.03 for x, y in spots)


def _middle(piece: Piece) -> FloatArray:
    middle: FloatArray = np.array([(solid.x_m, solid.y_m) for solid in piece.solids]).mean(axis=0)
    return middle


def _spots(outline_m: FloatArray) -> FloatArray:
    """Return spots all over a rectangle (4, 2), corners included."""
    shares = np.linspace(0.0, 1.0, 7)
    a, b, _, d = outline_m
    return np.array([a + s * (b - a) + t * (d - a) for s in shares for t in shares])


def _holds(room: Room, spots_m: FloatArray) -> bool:
    inside = (spots_m > (room.x0_m + 0.05, room.y0_m + 0.05)) & (spots_m < (room.x1_m - 0.05, room.y1_m - 0.05))
    return bool(inside.all())


def _road_spots(waypoints_m: tuple[tuple[float, float], ...]) -> FloatArray:
    """Return spots (n, 2) along the road, each piece of it once."""
    pieces = {tuple(sorted(pair)) for pair in itertools.pairwise(waypoints_m)}
    return np.concatenate(
        [np.linspace(a, b, max(2, round(math.dist(a, b) / 0.2))) for a, b in sorted(pieces)]
    )  # fmt: skip

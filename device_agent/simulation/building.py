"""A building as data: its places, what is seen of it, what is bumped into, how a sighted person walks through it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from device_agent.simulation.renderer import Placement, Renderer
from device_agent.simulation.shapes import Piece, Point3, Solid, Surface
from navcore.errors import InputError
from navcore.geometry import FloatArray
from navcore.planning.poi_graph import PoiKind


@dataclass(frozen=True, slots=True)
class Place:
    """A place of interest, where it truly is; on the sighted person's walk."""

    name: str
    kind: PoiKind
    x_m: float
    y_m: float


@dataclass(frozen=True, slots=True)
class Start:
    """Where the walker stands at the beginning. Metres, radians."""

    x_m: float
    y_m: float
    heading_rad: float


@dataclass(frozen=True, slots=True)
class Room:
    """A rectangle of the floor plan, metres, for pictures."""

    name: str
    x0_m: float
    y0_m: float
    x1_m: float
    y1_m: float
    is_corridor: bool = False


class Moving(Protocol):
    """Something that moves through the building by itself."""

    @property
    def poses(self) -> tuple[Piece, ...]:
        """What it looks like at each moment of its stride, in its own frame: x forward, standing on z = 0."""
        ...

    def placement_at(self, time_s: float) -> Placement | None:
        """Return where it is at a time of the simulation; None while it is not there."""
        ...


@dataclass(frozen=True, slots=True)
class Mover:
    """Something that moves along a path and back, for ever: a person who crosses or comes towards."""

    poses: tuple[Piece, ...]
    """Of one stride of ``stride_m``, evenly spaced; a thing without legs has one."""
    path_m: tuple[tuple[float, float], ...]
    """Corners of its path (n ≥ 2), metres."""
    speed_mps: float
    start_s: float = 0.0
    """It stands at the first corner until then."""
    stride_m: float = 1.4
    pause_s: float = 0.0
    """How long it stands at each end of its path."""

    def placement_at(self, time_s: float) -> Placement:
        """Return where it is, and where it faces, at a time of the simulation."""
        corners = np.asarray(self.path_m, np.float64)
        steps = np.diff(corners, axis=0)
        lengths = np.hypot(steps[:, 0], steps[:, 1])
        total = float(lengths.sum())
        travelled = self._travelled_m(max(0.0, time_s - self.start_s), total)
        lap = travelled % (2 * total) if total > 0 else 0.0
        along, forth = (lap, 1.0) if lap <= total else (2 * total - lap, -1.0)
        ends = np.cumsum(lengths)
        leg = min(int(np.searchsorted(ends, along)), len(lengths) - 1)
        share = (along - (ends[leg] - lengths[leg])) / max(lengths[leg], 1e-9)
        x_m, y_m = corners[leg] + share * steps[leg]
        yaw_rad = math.atan2(forth * steps[leg, 1], forth * steps[leg, 0])
        return Placement(float(x_m), float(y_m), yaw_rad, pose_in_stride(travelled, self.stride_m, len(self.poses)))

    def moves_between(self, time_s: float, later_s: float) -> bool:
        """Whether it is elsewhere at the later of two times of the simulation, a moment apart."""
        before, after = self.placement_at(time_s), self.placement_at(later_s)
        return (before.x_m, before.y_m) != (after.x_m, after.y_m)

    def _travelled_m(self, walking_s: float, length_m: float) -> float:
        """Return how far it has gone: from one end to the other, and then it stands for a while."""
        way_s = length_m / self.speed_mps
        laps = math.floor(walking_s / (way_s + self.pause_s)) if way_s + self.pause_s > 0.0 else 0
        return laps * length_m + min(walking_s - laps * (way_s + self.pause_s), way_s) * self.speed_mps


def pose_in_stride(travelled_m: float, stride_m: float, count: int) -> int:
    """Return which of ``count`` poses somebody takes who has gone so far."""
    return int(travelled_m / stride_m * count) % count


@dataclass(frozen=True, slots=True)
class Building:
    """A floor of a building. All positions in metres, in the building's own frame (z = 0 is the floor)."""

    name: str
    places: Mapping[str, Place]
    surfaces: tuple[Surface, ...]
    solids: tuple[Solid, ...]
    rooms: tuple[Room, ...]
    lamps_m: tuple[Point3, ...]
    road_waypoints: tuple[tuple[float, float], ...]
    """Corners of the sighted person's walk, in order. Where it comes straight back, the person turns on the spot."""
    movers: tuple[Moving, ...] = ()
    seed: int = 0
    """Of the pictures that are painted on the surfaces."""
    movable: tuple[Piece, ...] = ()
    """Furniture that people move now and then; it is part of the surfaces and solids."""

    def place(self, name: str) -> Place:
        """Return a place by its name, in any case. Raises InputError."""
        for place in self.places.values():
            if place.name.casefold() == name.strip().casefold():
                return place
        raise InputError(f"There is no place named {name!r} in {self.name}: choose one of {', '.join(self.places)}.")

    def with_pieces(self, *pieces: Piece) -> Building:
        """Return the building with more things standing in it."""
        surfaces = tuple(surface for piece in pieces for surface in piece.surfaces)
        solids = tuple(solid for piece in pieces for solid in piece.solids)
        return replace(self, surfaces=self.surfaces + surfaces, solids=self.solids + solids)

    def with_movable(self, pieces: Sequence[Piece]) -> Building:
        """Return the building with other movable furniture in place of its own."""
        gone = {id(part) for piece in self.movable for part in (*piece.surfaces, *piece.solids)}
        emptied = replace(
            self,
            surfaces=tuple(surface for surface in self.surfaces if id(surface) not in gone),
            solids=tuple(solid for solid in self.solids if id(solid) not in gone),
            movable=tuple(pieces),
        )
        return emptied.with_pieces(*pieces)

    def placements_at(self, time_s: float) -> tuple[Placement | None, ...]:
        """Return where the moving things are on their paths; None for those that are not there."""
        return tuple(mover.placement_at(time_s) for mover in self.movers)

    def moving_solids(self, placements: Sequence[Placement | None]) -> tuple[Solid, ...]:
        """Return the solids of the moving things, where they are."""
        return tuple(
            solid.moved(placement.x_m, placement.y_m, 0.0, placement.yaw_rad)
            for mover, placement in zip(self.movers, placements, strict=True)
            if placement is not None
            for solid in mover.poses[0].solids
        )

    @property
    def mover_surfaces(self) -> tuple[tuple[tuple[Surface, ...], ...], ...]:
        """The surfaces of each moving thing in each of its poses, as the renderer takes them."""
        return tuple(tuple(pose.surfaces for pose in mover.poses) for mover in self.movers)


def renderer_of(building: Building) -> Renderer:
    """Build what draws the building; painting and lighting take seconds, so share it where the building is the same."""
    return Renderer(building.surfaces, building.lamps_m, building.seed, building.mover_surfaces)


def checked_seed(seed: int) -> int:
    """Return the seed. Raises InputError where the random generator would not take it."""
    if seed < 0:
        raise InputError(f"The seed is {seed}, but must be 0 or greater: choose another.")
    return seed


BODY_LOW_M = 0.05
BODY_HIGH_M = 1.9
"""Heights between which a solid touches a walking person; lower is a carpet's edge, higher is overhead."""


@dataclass(frozen=True, slots=True, eq=False)
class SolidArrays:
    """Solids that a walking body can touch, as arrays over m solids."""

    centre_m: FloatArray
    half_m: FloatArray
    cos_yaw: FloatArray
    sin_yaw: FloatArray


def touchable(solids: tuple[Solid, ...]) -> SolidArrays:
    """Keep the solids whose span of heights meets the body's."""
    kept = [solid for solid in solids if solid.low_m < BODY_HIGH_M and solid.high_m > BODY_LOW_M]
    table = np.array([(s.x_m, s.y_m, s.half_x_m, s.half_y_m, s.yaw_rad) for s in kept], np.float64).reshape(-1, 5)
    return SolidArrays(table[:, :2], table[:, 2:4], np.cos(table[:, 4]), np.sin(table[:, 4]))


def push_from_solids(solids: SolidArrays, x_m: float, y_m: float) -> tuple[float, FloatArray]:
    """Return the distance from a point to the nearest solid (negative inside), and the unit vector (2,) away from it.

    Without solids the distance is infinite.
    """
    if not len(solids.centre_m):
        return math.inf, np.array([1.0, 0.0])
    offset = np.array([x_m, y_m]) - solids.centre_m
    local_x = solids.cos_yaw * offset[:, 0] + solids.sin_yaw * offset[:, 1]
    local_y = -solids.sin_yaw * offset[:, 0] + solids.cos_yaw * offset[:, 1]
    beyond_x, beyond_y = np.abs(local_x) - solids.half_m[:, 0], np.abs(local_y) - solids.half_m[:, 1]
    outside = np.hypot(np.maximum(beyond_x, 0.0), np.maximum(beyond_y, 0.0))
    distance = outside + np.minimum(np.maximum(beyond_x, beyond_y), 0.0)
    k = int(np.argmin(distance))
    away_x, away_y = max(beyond_x[k], 0.0) * np.sign(local_x[k]), max(beyond_y[k], 0.0) * np.sign(local_y[k])
    if distance[k] <= 0.0:
        # Inside: the nearest side is the way out.
        x_is_nearer = beyond_x[k] > beyond_y[k]
        away_x = math.copysign(1.0, local_x[k]) if x_is_nearer else 0.0
        away_y = 0.0 if x_is_nearer else math.copysign(1.0, local_y[k])
    length = math.hypot(away_x, away_y)
    c, s = solids.cos_yaw[k], solids.sin_yaw[k]
    return float(distance[k]), np.array([c * away_x - s * away_y, s * away_x + c * away_y]) / length

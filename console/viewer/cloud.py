"""What of the point cloud is shown, and from where it is first looked at. Pure functions on arrays."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from console.map_geometry.cloud_cleaning import shown_points
from navcore.geometry import FloatArray

MAX_POINTS_COUNT = 1_000_000
"""More points than this are thinned out before they are sent to a browser."""
CEILING_M = 2.2
"""What is higher than this hides the inside of a floor seen from above: it is a layer of its own."""
_SURFACE_CELL_M = 0.25
FOV_RAD = math.radians(50.0)
"""Vertical field of view of the scene's camera."""
FIRST_ASPECT = 1.2
"""Width to height of a window that is not known yet: beside the panel of a usual screen the scene is about so wide."""
_OBLIQUE_RAD = math.radians(60.0)
_FILLED_SHARE = 0.96
COARSE_COUNT = 80_000
"""Points of the first part of a cloud: something is seen while the others are on their way."""
PART_COUNT = 150_000
"""Points of each further part."""


@dataclass(frozen=True, slots=True, eq=False)
class CloudPart:
    """A part of what is shown, a node of its own: spread over all of the map, not a piece of it."""

    name: str
    """Name of the node."""
    points_m: NDArray[np.float32]
    colours_rgb: NDArray[np.uint8]


@dataclass(frozen=True, slots=True, eq=False)
class ShownCloud:
    """The points that a browser gets, in the order in which it gets them."""

    parts: tuple[CloudPart, ...]
    """Below the ceiling cut."""
    ceiling_parts: tuple[CloudPart, ...]
    """Above it."""
    total_count: int
    """Points of the site."""
    point_size_m: float

    @property
    def shown_count(self) -> int:
        """Points that are sent."""
        return sum(len(part.points_m) for part in (*self.parts, *self.ceiling_parts))

    @property
    def sentence(self) -> str:
        """What is shown, for the person who looks."""
        if self.shown_count == self.total_count:
            return f"{self.total_count:,} points"
        return f"{self.shown_count:,} of {self.total_count:,} points are shown: the cloud was thinned out."


@dataclass(frozen=True, slots=True)
class FloorBounds:
    """The rectangle of the floor that holds the map, metres."""

    x_min_m: float
    y_min_m: float
    x_max_m: float
    y_max_m: float

    @property
    def centre_m(self) -> tuple[float, float]:
        """Middle of the rectangle."""
        return (self.x_min_m + self.x_max_m) / 2, (self.y_min_m + self.y_max_m) / 2

    @property
    def width_m(self) -> float:
        """Extent along x."""
        return self.x_max_m - self.x_min_m

    @property
    def depth_m(self) -> float:
        """Extent along y."""
        return self.y_max_m - self.y_min_m


@dataclass(frozen=True, slots=True)
class CameraView:
    """A place to look from, and the point looked at, metres."""

    position_m: tuple[float, float, float]
    look_at_m: tuple[float, float, float]


def shown_cloud(
    points_m: NDArray[np.float32],
    colours_rgb: NDArray[np.uint8],
    max_count: int = MAX_POINTS_COUNT,
    ceiling_m: float = CEILING_M,
) -> ShownCloud:
    """Thin a cloud (n, 3) to ``max_count`` points, cut it at the ceiling, and in parts; non-finite points go."""
    finite = np.flatnonzero(np.isfinite(points_m).all(axis=1))
    # A cloud that can be shown as it is is: only what is thinned out is cleaned as well.
    kept = finite if len(finite) <= max_count else finite[shown_points(points_m[finite], max_count)]
    # In any order but the map's: each part is a thinner picture of the whole.
    kept = np.random.default_rng(1).permutation(kept)
    points, colours = points_m[kept], colours_rgb[kept]
    high = points[:, 2] > ceiling_m
    return ShownCloud(
        _parts("/map/cloud", points[~high], colours[~high]),
        _parts("/map/ceiling", points[high], colours[high]),
        len(finite),
        _point_size_m(points),
    )


def _parts(layer: str, points_m: NDArray[np.float32], colours_rgb: NDArray[np.uint8]) -> tuple[CloudPart, ...]:
    cuts = [0, *range(COARSE_COUNT, len(points_m), PART_COUNT), len(points_m)]
    names = [f"{layer}/points", *(f"{layer}/points{number}" for number in range(1, len(cuts)))]
    return tuple(
        CloudPart(name, points_m[start:end], colours_rgb[start:end])
        for name, (start, end) in zip(names, itertools.pairwise(cuts), strict=False)
        if end > start
    )


def _point_size_m(points_m: NDArray[np.float32]) -> float:
    """Return a size at which neighbouring points just touch, from the area of the surfaces that the cloud covers."""
    if len(points_m) == 0:
        return 0.02
    cells = np.unique(np.floor(points_m / _SURFACE_CELL_M).astype(np.int32), axis=0)
    spacing_m = math.sqrt(len(cells) * _SURFACE_CELL_M**2 / len(points_m))
    return float(np.clip(0.9 * spacing_m, 0.012, 0.09))


def floor_bounds(points_m: NDArray[np.float32], roads_m: Sequence[FloatArray]) -> FloorBounds:
    """Return the rectangle that holds the road and all but the stray points of the cloud, with a margin of 0.5 m."""
    corners = [road[:, :2] for road in roads_m if len(road)]
    finite = points_m[np.isfinite(points_m).all(axis=1)]
    if len(finite):
        corners.append(np.percentile(finite[:, :2].astype(np.float64), (0.5, 99.5), axis=0))
    if not corners:
        return FloorBounds(-5.0, -5.0, 5.0, 5.0)
    low, high = np.vstack(corners).min(axis=0) - 0.5, np.vstack(corners).max(axis=0) + 0.5
    return FloorBounds(float(low[0]), float(low[1]), float(high[0]), float(high[1]))


def overview(bounds: FloorBounds, aspect: float = FIRST_ASPECT, covered: float = 0.25) -> CameraView:
    """Return an oblique view that holds the whole floor, its longer side across a window of this width to height.

    ``covered`` is the share of the window's width that the panel hides, at its right: the floor lies left of it.
    """
    return _view_from(bounds, aspect, _OBLIQUE_RAD, covered)


def plan_view(bounds: FloorBounds, aspect: float = 1.5, covered: float = 0.25) -> CameraView:
    """Return the view straight down onto the whole floor, its longer side across the window; else as the overview."""
    # A camera exactly above has no "up" in the window: a hair to the side gives it one.
    return _view_from(bounds, aspect, math.radians(89.4), covered)


def _view_from(bounds: FloorBounds, aspect: float, elevation_rad: float, covered: float) -> CameraView:
    is_wide = bounds.width_m >= bounds.depth_m
    side = np.array([0.0, -1.0, 0.0]) if is_wide else np.array([1.0, 0.0, 0.0])
    right = np.array([1.0, 0.0, 0.0]) if is_wide else np.array([0.0, 1.0, 0.0])
    towards = side * math.cos(elevation_rad) + np.array([0.0, 0.0, math.sin(elevation_rad)])
    centre = np.array([*bounds.centre_m, 0.0])
    distance_m = _fitting_distance_m(bounds, towards, right, aspect, covered)
    target = centre + covered * aspect * math.tan(FOV_RAD / 2) * distance_m * right
    return CameraView(tuple((target + distance_m * towards).tolist()), tuple(target.tolist()))


def _fitting_distance_m(
    bounds: FloorBounds, towards: FloatArray, right: FloatArray, aspect: float, covered: float
) -> float:
    """Return how far from the floor, in the direction ``towards``, a camera sees every corner left of the panel.

    At the distance d, a corner at a across the window and o nearer to the camera is seen at (a - c t d) / ((d - o) t),
    with t the half-width of the window at 1 m and c the covered share; this must lie in [-f, f (1 - 2 c)].
    """
    corners = np.array(
        [[x, y, z] for x in (bounds.x_min_m, bounds.x_max_m) for y in (bounds.y_min_m, bounds.y_max_m) for z in (0, 2)]
    )
    offsets = corners - np.array([*bounds.centre_m, 0.0])
    half_height = math.tan(FOV_RAD / 2)
    half_width, free = aspect * half_height, _FILLED_SHARE * (1.0 - 2.0 * covered)
    across, nearer = offsets @ right, offsets @ towards
    upright = np.abs(offsets @ np.cross(towards, right))
    left_m = (nearer * _FILLED_SHARE * half_width - across) / (half_width * (_FILLED_SHARE - covered))
    right_m = (nearer * free * half_width + across) / (half_width * (free + covered))
    high_m = nearer + upright / (half_height * _FILLED_SHARE)
    return float(max(left_m.max(), right_m.max(), high_m.max()))

"""From above: where something stands, where floor has been seen, and where neither is known.

What hangs or stands between knee-low and head-high above the floor beside it occupies its cell. A cell is known where
floor has been seen in it or next to it: what nobody has seen is not free.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from console.map_geometry.cloud_cleaning import one_per_voxel
from console.map_geometry.floor_levels import FloorLevel, floor_levels
from navcore.geometry import FloatArray

LOW_M, HEAD_M = 0.15, 1.9
"""What lies between these heights above the floor is in the way: above a floor's noise and a doorsill, below a head
(``obstacle.head_height_m``)."""
CELL_M = 0.05
MIN_VOXELS = 3
"""Fewer voxels of 5 cm, in a column of 15 × 15 cm, are stray points: a pole or a sign 10 cm high fills more."""
FLOOR_WITHIN_M = 0.08
"""What is nearer than this to a floor's plane is floor."""
FLOOR_GAP_M = 0.2
"""Floor is known this far from where it has been seen: clouds have holes."""
TRODDEN_HALF_WIDTH_M = 0.25
"""Somebody who walked a line needed so much room to each side: half of an adult's shoulders (DIN 33402-2)."""
_MAX_CELLS = 40_000_000
_WALKED_BEYOND_M = 10.0
"""What was walked farther than this beyond the cloud is not known to be floor; it would make the picture coarse."""
_MARGIN_M = 0.5
_STRAY_PERCENT = 0.1

Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Occupancy:
    """Cells of the floor, row by row from the lowest y, each ``cell_m`` wide."""

    x_min_m: float
    y_min_m: float
    cell_m: float
    is_occupied: Mask
    """(rows, columns): something stands or hangs there."""
    is_known: Mask
    """(rows, columns): floor has been seen there, or right beside it."""

    @cached_property
    def distance_m(self) -> NDArray[np.float32]:
        """(rows, columns): distance between the middles of a cell and the nearest occupied one; inf without one."""
        if not self.is_occupied.any():
            return np.full(self.is_occupied.shape, np.inf, np.float32)
        free = (~self.is_occupied).astype(np.uint8)
        cells = cv2.distanceTransform(free, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        return np.asarray(cells * np.float32(self.cell_m), np.float32)

    def cells_of(self, points_m: FloatArray) -> tuple[NDArray[np.int64], NDArray[np.int64], Mask]:
        """Return row and column of points (…, 2), and which of them lie in the picture; those outside give cell 0."""
        columns = np.floor((points_m[..., 0] - self.x_min_m) / self.cell_m).astype(np.int64)
        rows = np.floor((points_m[..., 1] - self.y_min_m) / self.cell_m).astype(np.int64)
        height, width = self.is_occupied.shape
        inside = (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height)
        return np.where(inside, rows, 0), np.where(inside, columns, 0), inside


def occupancy_of(points_m: NDArray[Any], walked_m: Sequence[FloatArray]) -> Occupancy:
    """Return what stands and what is floor in a cloud (n, 3), levelled, metres.

    ``walked_m`` are lines (k, 2) that somebody has walked, not such as were drawn: they tell which planes are floor,
    and there is floor below them although a camera that looks ahead may never have seen it. Nothing else is
    known where no floor has been seen.
    """
    points = np.asarray(points_m[one_per_voxel(points_m, CELL_M)], np.float64)
    levels = floor_levels(points, walked_m)
    low, high = _bounds(points, walked_m)
    cell_m = max(CELL_M, math.sqrt(float(np.prod(high - low)) / _MAX_CELLS))
    width, height = (int(n) for n in np.ceil((high - low) / cell_m))
    grid = _Grid(low, cell_m, (height, width))
    points = points[grid.holds(points)]
    seen, level_of = _floor(points, levels, grid)
    heights_m = _heights_m(points, levels, level_of[grid.cells(points)])
    counts = grid.count(points[(heights_m > LOW_M) & (heights_m < HEAD_M)])
    around = cv2.boxFilter(counts, cv2.CV_32F, (3, 3), normalize=False, borderType=cv2.BORDER_CONSTANT)
    occupied = _closed((counts > 0) & (around >= MIN_VOXELS))
    reach = 2 * round(FLOOR_GAP_M / cell_m) + 1
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (reach, reach))
    known = np.asarray(cv2.dilate(seen.astype(np.uint8), disc), np.bool_) | _trodden(walked_m, grid)
    return Occupancy(float(low[0]), float(low[1]), cell_m, occupied, known)


@dataclass(frozen=True, slots=True, eq=False)
class _Grid:
    low_m: FloatArray
    cell_m: float
    shape: tuple[int, int]

    def cells(self, points_m: FloatArray) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        at = np.floor((points_m[:, :2] - self.low_m) / self.cell_m).astype(np.int64)
        return at[:, 1], at[:, 0]

    def holds(self, points_m: FloatArray) -> Mask:
        rows, columns = self.cells(points_m)
        return (rows >= 0) & (rows < self.shape[0]) & (columns >= 0) & (columns < self.shape[1])

    def count(self, points_m: FloatArray) -> NDArray[np.float32]:
        rows, columns = self.cells(points_m)
        flat = np.bincount(rows * self.shape[1] + columns, minlength=self.shape[0] * self.shape[1])
        return flat.reshape(self.shape).astype(np.float32)


def _bounds(points_m: FloatArray, walked_m: Sequence[FloatArray]) -> tuple[FloatArray, FloatArray]:
    """Return the corners of a rectangle that holds all but stray points, which may lie kilometres away, and the walks.

    A camera that looks ahead does not see where its walk begins: the cloud alone would leave that out.
    """
    if not len(points_m):
        return np.full(2, -_MARGIN_M), np.full(2, _MARGIN_M)
    low, high = np.percentile(points_m[:, :2], (_STRAY_PERCENT, 100.0 - _STRAY_PERCENT), axis=0)
    walked = np.vstack([np.reshape((low, high), (2, 2)), *(path[:, :2] for path in walked_m)])
    walked = np.clip(walked, low - _WALKED_BEYOND_M, high + _WALKED_BEYOND_M)
    return walked.min(axis=0) - _MARGIN_M, walked.max(axis=0) + _MARGIN_M


def _floor(points_m: FloatArray, levels: Sequence[FloorLevel], grid: _Grid) -> tuple[Mask, NDArray[np.int64]]:
    """Return where floor has been seen, and of each cell the level (an index) that is nearest to it."""
    seen = np.zeros(grid.shape, np.bool_)
    level_of = np.zeros(grid.shape, np.int64)
    # The lowest is drawn last: of two above each other, people walk on the one, and the other stands on it.
    for index in sorted(range(len(levels)), key=lambda i: -float(np.median(levels[i].points_m[:, 2]))):
        on_it = np.abs(levels[index].heights_m(points_m)) < FLOOR_WITHIN_M
        cells = grid.cells(points_m[on_it])
        seen[cells] = True
        level_of[cells] = index
    if not seen.any() or len(levels) < 2:
        return seen, level_of
    nearest = distance_transform_edt(~seen, return_distances=False, return_indices=True)
    return seen, np.asarray(level_of[tuple(nearest)])


def _closed(occupied: Mask) -> Mask:
    """Fill gaps of one cell, which points as far apart as cells are wide leave: nobody fits through them."""
    closed = cv2.morphologyEx(occupied.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8))
    return np.asarray(closed, np.bool_)


def _trodden(walked_m: Sequence[FloatArray], grid: _Grid) -> Mask:
    """Return where somebody has set foot."""
    picture = np.zeros(grid.shape, np.uint8)
    bits = 4
    for path in walked_m:
        cells = ((path[:, :2] - grid.low_m) / grid.cell_m - 0.5) * (1 << bits)
        at = np.round(np.clip(cells, -(1 << 24), 1 << 24)).astype(np.int32)
        thickness = max(1, round(2 * TRODDEN_HALF_WIDTH_M / grid.cell_m))
        cv2.polylines(picture, [at], False, 1, thickness, cv2.LINE_8, bits)
    return np.asarray(picture, np.bool_)


def _heights_m(points_m: FloatArray, levels: Sequence[FloorLevel], level_of: NDArray[np.int64]) -> FloatArray:
    """Return how high points (n, 3) are above their level of the floor (n,); above z = 0 where there is no floor."""
    heights_m = points_m[:, 2].copy()
    for index, level in enumerate(levels):
        of_it = level_of == index
        heights_m[of_it] = level.heights_m(points_m[of_it])
    return heights_m

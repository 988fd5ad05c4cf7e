"""What a depth image says of the surfaces around: a small grid of depths, and points with normals fitted to it.

The grid is what key frames keep (under 10 kB each); the surfaces are fitted again when they are needed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from navcore.geometry import FloatArray
from navcore.slam.depth_kernels import UNIT_M, GridArray, Surface, fit_surface, reduce_depth
from navcore.slam.keyframes import SlamCamera
from navcore.types import DepthImage

GRID_COLUMNS = 80
"""Cells across the image."""


@dataclass(frozen=True, slots=True, eq=False)
class DepthModel:
    """The surfaces that one view saw."""

    grid: GridArray
    """(rows, columns): depth at the middle of each cell in UNIT_M, 0 where unknown."""
    surface: Surface
    """(rows, columns, 6): point and normal in the camera's frame; point z is 0 where unknown."""
    pinhole: tuple[float, float, float, float]
    """fx, fy, cx, cy in cells."""

    @property
    def known_share(self) -> float:
        """Share of the cells that lie on a surface, 0–1."""
        return float(np.count_nonzero(self.surface[:, :, 2] > 0) / self.surface[:, :, 2].size)

    @property
    def depth_m(self) -> NDArray[np.float32]:
        """(rows, columns): depth in metres, 0 where unknown."""
        return (self.grid * np.float32(UNIT_M)).astype(np.float32)


def cell_of(camera: SlamCamera) -> int:
    """Return the side of a grid's cells, pixels."""
    return max(1, round(camera.width_px / GRID_COLUMNS))


def grid_shape(camera: SlamCamera) -> tuple[int, int]:
    """Return rows and columns of a camera's grids."""
    cell_px = cell_of(camera)
    return camera.height_px // cell_px, camera.width_px // cell_px


def depth_grid(depth_m: DepthImage, camera: SlamCamera) -> GridArray:
    """Return the grid (rows, columns) of a depth image (h, w) in metres."""
    return reduce_depth(np.ascontiguousarray(depth_m, dtype=np.float32), cell_of(camera))


def model_of_grid(grid: GridArray, camera: SlamCamera) -> DepthModel:
    """Return the surfaces of a grid (rows, columns)."""
    cell_px = cell_of(camera)
    offset = 0.5 * (cell_px - 1)
    pinhole = (
        camera.fx_px / cell_px,
        camera.fy_px / cell_px,
        (camera.cx_px - offset) / cell_px,
        (camera.cy_px - offset) / cell_px,
    )
    contiguous = np.ascontiguousarray(grid, dtype=np.uint16)
    return DepthModel(contiguous, fit_surface(contiguous, *pinhole), pinhole)


def depth_model(depth_m: DepthImage, camera: SlamCamera) -> DepthModel:
    """Return the surfaces of a depth image (h, w) in metres, registered to the ideal pinhole ``camera``."""
    return model_of_grid(depth_grid(depth_m, camera), camera)


def points_and_normals(model: DepthModel) -> tuple[FloatArray, FloatArray]:
    """Return the known points (n, 3) and their normals (n, 3), towards the camera, in the camera's frame."""
    known = model.surface[model.surface[:, :, 2] > 0].astype(np.float64)
    return known[:, :3], known[:, 3:]

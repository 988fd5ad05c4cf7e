"""The compiled parts of depth models and of their alignment; see :mod:`navcore.slam.depth_model`.

A plane n·X = d seen by a pinhole has an inverse depth 1/z = (n·ray)/d, which is affine in the pixel; and the noise of a
stereo or structured-light sensor is the same everywhere in inverse depth. So surfaces are fitted there.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from navcore.compiled import kernel
from navcore.geometry import FloatArray
from navcore.types import DepthImage

GridArray = NDArray[np.uint16]
Surface = NDArray[np.float32]
"""(rows, columns, 6): a point and its normal, towards the camera, in the camera's frame; point z is 0 where unknown."""

UNIT_M = 0.00025
"""Depth of a stored grid is counted in this: 16 bits reach 16 m."""
MAX_RANGE_M = 12.0
INVERSE_NOISE = 0.003
"""Standard deviation of a measured inverse depth, 1/m: z² · 0.003 m, between structured light and small stereo."""
_EDGE_SPREAD = 4.0 * INVERSE_NOISE
"""A cell whose inverse depths scatter more about a plane holds an edge."""
_FOLD_SPREAD = 1.2 * INVERSE_NOISE
"""Neighbouring cells whose inverse depths scatter more about a plane do not lie on one."""
_MIN_SAMPLE_SHARE = 0.6
_MIN_NEIGHBOURS = 6
_MIN_FACING = 0.1
"""Cosine between ray and normal below which a surface is seen too obliquely to be measured."""
_CELL_SAMPLES = 4
"""Samples along a cell's side, at most."""


@kernel
def _solve_affine(s: FloatArray) -> tuple[bool, float, float, float, float]:
    """Fit w = a + b x + c y to sums (n, x, y, xx, xy, yy, w, xw, yw, ww); return validity, a, b, c and the spread."""
    n = s[0]
    mx, my, mw = s[1] / n, s[2] / n, s[6] / n
    xx, xy, yy = s[3] / n - mx * mx, s[4] / n - mx * my, s[5] / n - my * my
    xw, yw, ww = s[7] / n - mx * mw, s[8] / n - my * mw, s[9] / n - mw * mw
    determinant = xx * yy - xy * xy
    if determinant < 1e-9:
        return False, 0.0, 0.0, 0.0, 0.0
    b = (xw * yy - yw * xy) / determinant
    c = (yw * xx - xw * xy) / determinant
    variance = max(ww - b * xw - c * yw, 0.0)
    return True, mw - b * mx - c * my, b, c, math.sqrt(variance)


@kernel
def _add_sample(s: FloatArray, x: float, y: float, w: float) -> None:
    s[0] += 1.0
    s[1] += x
    s[2] += y
    s[3] += x * x
    s[4] += x * y
    s[5] += y * y
    s[6] += w
    s[7] += x * w
    s[8] += y * w
    s[9] += w * w


@kernel
def reduce_depth(depth_m: DepthImage, cell_px: int) -> GridArray:
    """Return the depth (rows, columns) at the middle of each cell, in UNIT_M; 0 where it is unknown or an edge."""
    rows, columns = depth_m.shape[0] // cell_px, depth_m.shape[1] // cell_px
    grid = np.zeros((rows, columns), np.uint16)
    stride = max(1, cell_px // _CELL_SAMPLES)
    wanted = ((cell_px + stride - 1) // stride) ** 2
    middle = 0.5 * (cell_px - 1)
    s = np.empty(10)
    for row in range(rows):
        for column in range(columns):
            s[:] = 0.0
            for y in range(0, cell_px, stride):
                for x in range(0, cell_px, stride):
                    z = depth_m[row * cell_px + y, column * cell_px + x]
                    if 0.1 < z < MAX_RANGE_M:
                        _add_sample(s, x - middle, y - middle, 1.0 / z)
            if s[0] < _MIN_SAMPLE_SHARE * wanted:
                continue
            is_valid, a, _, _, spread = _solve_affine(s) if cell_px > 1 else (True, s[6], 0.0, 0.0, 0.0)
            if is_valid and spread < _EDGE_SPREAD and a > 1.0 / MAX_RANGE_M:
                grid[row, column] = int(1.0 / (a * UNIT_M) + 0.5)
    return grid


@kernel
def fit_surface(grid: GridArray, fx: float, fy: float, cx: float, cy: float) -> Surface:
    """Return points and normals (rows, columns, 6) of a grid, whose pinhole is given in cells.

    Each is the plane through 3×3 cells; where these do not lie on one, there is none.
    """
    rows, columns = grid.shape
    surface = np.zeros((rows, columns, 6), np.float32)
    s = np.empty(10)
    for row in range(1, rows - 1):
        for column in range(1, columns - 1):
            if grid[row, column] == 0:
                continue
            s[:] = 0.0
            for dy in range(-1, 2):
                for dx in range(-1, 2):
                    if grid[row + dy, column + dx] > 0:
                        _add_sample(s, dx, dy, 1.0 / (UNIT_M * grid[row + dy, column + dx]))
            if s[0] < _MIN_NEIGHBOURS:
                continue
            is_valid, a, b, c, spread = _solve_affine(s)
            if not is_valid or spread > _FOLD_SPREAD or a < 1.0 / MAX_RANGE_M:
                continue
            _fill_point(surface[row, column], (column - cx) / fx, (row - cy) / fy, a, b * fx, c * fy)
    return surface


@kernel
def _fill_point(out: NDArray[np.float32], x: float, y: float, a: float, slope_x: float, slope_y: float) -> None:
    """Write point and normal of a plane with inverse depth ``a`` at the ray (x, y, 1) and its slopes along x and y."""
    nx, ny = -slope_x, -slope_y
    nz = -(a - slope_x * x - slope_y * y)
    length = math.sqrt(nx * nx + ny * ny + nz * nz)
    ray = math.sqrt(x * x + y * y + 1.0)
    if a / (length * ray) < _MIN_FACING:
        return
    out[0], out[1], out[2] = x / a, y / a, 1.0 / a
    out[3], out[4], out[5] = nx / length, ny / length, nz / length


@kernel
def accumulate(
    model: Surface,
    seen: Surface,
    seen_from_model: FloatArray,
    fx: float,
    fy: float,
    cx: float,
    cy: float,
    gate_m: float,
    stride: int,
    h: FloatArray,
    g: FloatArray,
) -> tuple[float, float, float, int, int, int]:
    """Fill the normal equations h (6, 6), g (6,) of the distances between two surfaces, point to plane.

    Each point of the model is compared with the surface that the other view sees in its direction. Return the robust
    cost, χ² without robustness, the sum of the squared distances, and how many points match, are contradicted, and are
    known.
    """
    h[:] = 0.0
    g[:] = 0.0
    t = seen_from_model
    rows, columns = seen.shape[0], seen.shape[1]
    cost, chi2, squares = 0.0, 0.0, 0.0
    matched, contradicted, known = 0, 0, 0
    j = np.empty(6)
    for row in range(0, model.shape[0], stride):
        for column in range(0, model.shape[1], stride):
            mx, my, mz = model[row, column, 0], model[row, column, 1], model[row, column, 2]
            if mz <= 0.0:
                continue
            known += 1
            x = t[0, 0] * mx + t[0, 1] * my + t[0, 2] * mz + t[0, 3]
            y = t[1, 0] * mx + t[1, 1] * my + t[1, 2] * mz + t[1, 3]
            z = t[2, 0] * mx + t[2, 1] * my + t[2, 2] * mz + t[2, 3]
            if z < 0.1:
                continue
            u, v = math.floor(fx * x / z + cx + 0.5), math.floor(fy * y / z + cy + 0.5)
            if u < 0 or u >= columns or v < 0 or v >= rows or seen[v, u, 2] <= 0.0:
                continue
            ax, ay, az = model[row, column, 3], model[row, column, 4], model[row, column, 5]
            nx = t[0, 0] * ax + t[0, 1] * ay + t[0, 2] * az
            ny = t[1, 0] * ax + t[1, 1] * ay + t[1, 2] * az
            nz = t[2, 0] * ax + t[2, 1] * ay + t[2, 2] * az
            bx, by, bz = seen[v, u, 3], seen[v, u, 4], seen[v, u, 5]
            dx, dy, dz = x - seen[v, u, 0], y - seen[v, u, 1], z - seen[v, u, 2]
            # The plane between both: the distance is then right to second order in the rotation.
            mean_x, mean_y, mean_z = nx + bx, ny + by, nz + bz
            length = math.sqrt(mean_x * mean_x + mean_y * mean_y + mean_z * mean_z)
            e = (mean_x * dx + mean_y * dy + mean_z * dz) / max(length, 1e-6)
            # An oblique cell is long: the two points may lie as far apart along the surface.
            facing = -(bx * x + by * y + bz * z) / math.sqrt(x * x + y * y + z * z)
            long_m = z / (fx * max(facing, 0.1))
            apart2 = dx * dx + dy * dy + dz * dz
            limit_m = gate_m * (1.0 + 0.1 * z)
            if abs(e) > limit_m or apart2 > (limit_m + long_m) ** 2 or nx * bx + ny * by + nz * bz < 0.8:
                contradicted += 1
                continue
            nx, ny, nz = mean_x / length, mean_y / length, mean_z / length
            sigma = 0.003 + INVERSE_NOISE * z * z
            chi = abs(e) / sigma
            w = 1.0 / (sigma * sigma)
            if chi > 1.5:
                w *= 1.5 / chi
                cost += 2.0 * 1.5 * chi - 1.5 * 1.5
            else:
                cost += chi * chi
            matched += 1
            chi2 += chi * chi
            squares += e * e
            j[0], j[1], j[2] = nx, ny, nz
            j[3], j[4], j[5] = y * nz - z * ny, z * nx - x * nz, x * ny - y * nx
            for k in range(6):
                jw = w * j[k]
                g[k] += jw * e
                for m in range(k, 6):
                    h[k, m] += jw * j[m]
    for k in range(6):
        for m in range(k):
            h[k, m] = h[m, k]
    return cost, chi2, squares, matched, contradicted, known

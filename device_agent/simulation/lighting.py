"""Light, computed once for a building: lamps with their shadows, and how open the surroundings of each spot are.

It makes corners and the floor under desks darker, which is most of what makes a rendered room look like one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from device_agent.simulation.scene import RayScene, SurfaceArrays, rays_from
from device_agent.simulation.shading import F32, I32

CELL_M = 0.3
"""Distance of the spots at which light is computed."""
SMALLEST_AREA_M2 = 0.12
"""Smaller surfaces get one spot."""
LAMP_REACH_M = 6.0
OPEN_REACH_M = 0.9
"""Nearer things take away light that comes from all sides (ambient occlusion)."""
OPEN_RAYS = 40
AMBIENT = 0.7
LAMP_STRENGTH = 0.62
_LIFT_M = 0.02


@dataclass(frozen=True, slots=True, eq=False)
class LightGrid:
    """Brightness factors over all surfaces: a grid per surface, one after the other in ``light``."""

    light: F32
    offset: I32
    """Index (s,) of each surface's first spot."""
    shape: I32
    """Columns and rows (s, 2)."""
    per_m: F32
    """Columns and rows per metre (s, 2)."""


def grid_layout(planes: SurfaceArrays) -> LightGrid:
    """Lay out the spots; light is 1 everywhere."""
    extents = np.stack([planes.extent_u, planes.extent_v], axis=1)
    shape = np.ceil(extents / CELL_M).astype(np.int32) + 1
    shape[extents[:, 0] * extents[:, 1] < SMALLEST_AREA_M2] = 1
    counts = shape[:, 0] * shape[:, 1]
    offset = np.concatenate([[0], np.cumsum(counts)[:-1]]).astype(np.int32)
    per_m = ((shape - 1) / np.maximum(extents, 1e-6)).astype(np.float32)
    return LightGrid(np.ones(int(counts.sum()), np.float32), offset, shape, per_m)


def light_building(
    planes: SurfaceArrays, scene: RayScene, shining: NDArray[np.bool_], lamps_m: Sequence[tuple[float, float, float]]
) -> LightGrid:
    """Compute the light of every spot; ``shining`` (s,) marks surfaces that need none, ``lamps_m`` are centres."""
    grid = grid_layout(planes)
    spots, normals, surface_of = _spots(planes, grid)
    light = AMBIENT * _openness(scene, spots, normals) + LAMP_STRENGTH * _lamp_light(scene, spots, normals, lamps_m)
    light = np.minimum(light, 1.25).astype(np.float32)
    light[shining[surface_of]] = 1.0
    return LightGrid(light, grid.offset, grid.shape, grid.per_m)


def _spots(planes: SurfaceArrays, grid: LightGrid) -> tuple[F32, F32, NDArray[np.int64]]:
    """Return positions (n, 3) just above the surfaces, normals (n, 3), and each spot's surface (n,)."""
    counts = grid.shape[:, 0] * grid.shape[:, 1]
    surface_of = np.repeat(np.arange(len(counts)), counts)
    within = np.arange(len(surface_of)) - grid.offset[surface_of]
    columns = grid.shape[surface_of, 0]
    shape = np.maximum(grid.shape[surface_of] - 1, 1)
    share = np.stack([within % columns, within // columns], axis=1) / shape
    share[counts[surface_of] == 1] = 0.5
    # Spots on the very edge would lie inside the neighbouring wall.
    extents = np.stack([planes.extent_u, planes.extent_v], axis=1)[surface_of]
    margin = np.minimum(0.06 / extents, 0.3)
    share = np.clip(share, margin, 1 - margin)
    u_m, v_m = (share * extents).T[:, :, None]
    position = planes.corner[surface_of] + u_m * planes.axis_u[surface_of] + v_m * planes.axis_v[surface_of]
    normals = planes.normal[surface_of]
    return (position + _LIFT_M * normals).astype(np.float32), normals, surface_of


def _openness(scene: RayScene, spots: F32, normals: F32) -> F32:
    """Return the share (n,) of directions in which nothing is near, weighted by the cosine."""
    free = np.zeros(len(spots), np.float32)
    for towards in _even_directions(OPEN_RAYS):
        # A unit vector added to the normal is distributed as the cosine (Lambert). All spots use the same vectors, so
        # that the error is the same for neighbours and no blotches appear.
        free += ~scene.blocked(rays_from(spots, (normals + 0.98 * towards) * OPEN_REACH_M))
    return free / np.float32(OPEN_RAYS)


def _even_directions(count: int) -> F32:
    """Return unit vectors (count, 3) spread evenly over the sphere (Fibonacci spiral)."""
    k = np.arange(count) + 0.5
    z = 1 - 2 * k / count
    angle = np.pi * (1 + 5**0.5) * k
    radius = np.sqrt(1 - z * z)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=1).astype(np.float32)


def _lamp_light(scene: RayScene, spots: F32, normals: F32, lamps_m: Sequence[tuple[float, float, float]]) -> F32:
    total = np.zeros(len(spots), np.float32)
    for lamp in np.asarray(lamps_m, np.float32).reshape(-1, 3):
        to_lamp = lamp - spots
        distance = np.linalg.norm(to_lamp, axis=1)
        facing = np.einsum("nc,nc->n", to_lamp, normals) / distance
        # A ceiling panel shines down, less to the sides; the ceiling next to it gets a little.
        outward = np.clip(to_lamp[:, 2] / distance, 0.0, 1.0)
        near = np.flatnonzero((distance < LAMP_REACH_M) & (facing > 0.0) & (outward > 0.0))
        if not len(near):
            continue
        lit = ~scene.blocked(rays_from(spots[near], to_lamp[near]), reach=0.97)
        share = facing[near] * outward[near] / (0.6 + 0.25 * distance[near] ** 2)
        total[near] += np.where(lit, share, 0.0).astype(np.float32)
    return total

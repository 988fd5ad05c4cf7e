"""Surfaces as triangles that rays can be cast at, and the arrays that shading reads."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from device_agent.simulation.shading import F32, I32
from device_agent.simulation.shapes import Surface
from navcore.errors import MissingPackageError
from navcore.geometry import FloatArray

RAY_THREADS = 1
"""Threads of Open3D's ray caster: the machine has other work to do."""


def import_open3d() -> Any:
    """Import Open3D on first use. Raises MissingPackageError."""
    try:
        import open3d
    except (ImportError, OSError) as error:
        raise MissingPackageError(
            "The simulated building needs Open3D: install the extra with `pip install 'virtual-blind-road[sim]'`"
            " (and libusb-1.0-0, libgl1, libx11-6, libgomp1 from the system)."
        ) from error
    return open3d


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceArrays:
    """Geometry of s surfaces, float32: what the shading kernel reads."""

    corner: F32
    axis_u: F32
    axis_v: F32
    normal: F32
    extent_u: F32
    extent_v: F32


def surface_arrays(surfaces: Sequence[Surface]) -> SurfaceArrays:
    """Compute the plane of each surface: corner, unit axes, unit normal (s, 3), and extents (s,) in metres."""
    corners = np.array([surface.corners for surface in surfaces], np.float64).reshape(-1, 4, 3)
    edge_u, edge_v = corners[:, 1] - corners[:, 0], corners[:, 3] - corners[:, 0]
    extent_u = np.linalg.norm(edge_u, axis=1)
    axis_u = edge_u / extent_u[:, None]
    normal = np.cross(edge_u, edge_v)
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    axis_v = np.cross(normal, axis_u)
    heights = np.einsum("skc,sc->sk", corners, axis_v)
    arrays = corners[:, 0], axis_u, axis_v, normal, extent_u, np.ptp(heights, axis=1)
    return SurfaceArrays(*(np.ascontiguousarray(array, np.float32) for array in arrays))


class RayScene:
    """Surfaces, ready for rays. Without surfaces every ray misses."""

    def __init__(self, surfaces: Sequence[Surface]) -> None:
        open3d = import_open3d()
        self._tensor = open3d.core.Tensor
        self._scene = open3d.t.geometry.RaycastingScene(nthreads=RAY_THREADS)
        self._is_empty = not surfaces
        if self._is_empty:
            return
        corners = np.array([surface.corners for surface in surfaces], np.float32).reshape(-1, 3)
        first = 4 * np.arange(len(surfaces), dtype=np.uint32)[:, None]
        triangles = (
            np.stack([first + np.array(half) for half in ((0, 1, 2), (0, 2, 3))], axis=1)
            .reshape(-1, 3)
            .astype(np.uint32)
        )
        self._scene.add_triangles(self._tensor.from_numpy(corners), self._tensor.from_numpy(triangles))

    def cast(self, rays: F32) -> tuple[F32, I32]:
        """Cast rays (n, 6), origin and direction.

        Returns the distance (n,) in lengths of the direction, inf for a miss, and the number of the surface (n,), −1
        for a miss.
        """
        if self._is_empty:
            return np.full(len(rays), np.inf, np.float32), np.full(len(rays), -1, np.int32)
        answer = self._scene.cast_rays(self._tensor.from_numpy(rays), nthreads=RAY_THREADS)
        distance: F32 = answer["t_hit"].numpy()
        # The identifier of a miss is 2³² − 1, which is −1 after the conversion, and stays so when halved.
        surface: I32 = answer["primitive_ids"].numpy().view(np.int32) >> 1
        return distance, surface

    def nearest_m(self, points_m: F32) -> F32:
        """Return the distance (n,) of points (n, 3) from the nearest surface, metres."""
        if self._is_empty:
            return np.full(len(points_m), np.inf, np.float32)
        answer = self._scene.compute_distance(self._tensor.from_numpy(points_m), nthreads=RAY_THREADS)
        distance: F32 = answer.numpy()
        return distance

    def blocked(self, rays: F32, reach: float = 1.0) -> NDArray[np.bool_]:
        """Tell (n,) whether anything is hit before ``reach`` lengths of the direction."""
        if self._is_empty:
            return np.zeros(len(rays), np.bool_)
        answer = self._scene.test_occlusions(self._tensor.from_numpy(rays), tnear=0.0, tfar=reach, nthreads=RAY_THREADS)
        blocked: NDArray[np.bool_] = answer.numpy()
        return blocked


def rays_from(origins: FloatArray | F32, directions: FloatArray | F32) -> F32:
    """Pair origins (n, 3) with directions (n, 3), as (n, 6) float32."""
    return np.ascontiguousarray(np.concatenate([origins, directions], axis=1), np.float32)

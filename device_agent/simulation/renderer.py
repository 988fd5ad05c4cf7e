"""What a camera sees in the building: colour, depth, and how each surface is met, for the sensor models.

Rays are cast by Open3D; a compiled kernel looks up textures (mip levels by the ray's footprint, bilinear) and light.
Things that move are in small scenes of their own, whose rays are taken into the thing's frame.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from device_agent.simulation.lighting import LightGrid, grid_layout, light_building
from device_agent.simulation.scene import RayScene, SurfaceArrays, surface_arrays
from device_agent.simulation.shading import F32, I32, aim, shade
from device_agent.simulation.shapes import GLASS, Surface
from device_agent.simulation.textures import Material, TextureAtlas, build_atlas, texture_key
from navcore.geometry import Transform, rotation_about_z
from navcore.types import CameraIntrinsics, DepthImage, ImageRgb


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """A perfect camera's picture, before any sensor spoils it."""

    colour_rgb: ImageRgb
    depth_m: DepthImage
    """Along the optical axis (h, w); inf where there is nothing."""
    incidence: F32
    """Cosine between ray and surface normal (h, w)."""
    material: NDArray[np.uint8]
    """:class:`textures.Material` (h, w)."""
    is_moving: NDArray[np.bool_] | None = None
    """Where the picture shows a moving thing (h, w); None where none is in sight."""

    @property
    def moving_share(self) -> float:
        """Share of the picture that shows moving things, 0–1."""
        return 0.0 if self.is_moving is None else float(self.is_moving.mean())


@dataclass(frozen=True, slots=True)
class Placement:
    """Where a moving thing is now."""

    x_m: float
    y_m: float
    yaw_rad: float
    pose: int = 0
    """Which of its poses it takes: the moment of its stride."""


@dataclass(frozen=True, slots=True, eq=False)
class Shaded:
    """What n rays see: colour (n, 3), cosine of incidence (n,), material (n,)."""

    colour: NDArray[np.uint8]
    incidence: F32
    material: NDArray[np.uint8]


class Appearance:
    """Surfaces with all that is needed to draw them: planes, textures, light, rays."""

    def __init__(
        self, surfaces: Sequence[Surface], seed: int, lamps_m: Sequence[tuple[float, float, float]] | None = None
    ) -> None:
        self.surfaces = tuple(surface for surface in surfaces if surface.texture != GLASS)
        self.planes: SurfaceArrays = surface_arrays(self.surfaces)
        self.scene = RayScene(self.surfaces)
        self.atlas: TextureAtlas = build_atlas(self.surfaces, seed)
        self.texture_of: I32 = np.array([self.atlas.index[texture_key(s)] for s in self.surfaces], np.int32)
        self.material: NDArray[np.uint8] = self.atlas.material[self.texture_of]
        self.light: LightGrid = grid_layout(self.planes)
        if lamps_m is not None:
            self.light = light_building(self.planes, self.scene, self.material == Material.LIT, lamps_m)
        corners = np.array([s.corners for s in self.surfaces]).reshape(-1, 3)
        self.reach_m = float(np.linalg.norm(corners, axis=1).max())

    def shade(self, rays: F32, distance: F32, surface: I32, pixel_rad: float) -> Shaded:
        """Return what is seen along n rays that have been cast."""
        n = len(distance)
        shaded = Shaded(np.empty((n, 3), np.uint8), np.empty(n, np.float32), np.empty(n, np.uint8))
        planes, atlas, light = self.planes, self.atlas, self.light
        shade(
            rays,
            distance,
            surface,
            pixel_rad,
            planes.corner,
            planes.axis_u,
            planes.axis_v,
            planes.normal,
            planes.extent_v,
            self.texture_of,
            atlas.texels,
            atlas.offset,
            atlas.width,
            atlas.height,
            atlas.shrink,
            atlas.px_per_m,
            atlas.repeats,
            atlas.material,
            light.light,
            light.offset,
            light.shape,
            light.per_m,
            shaded.colour,
            shaded.incidence,
            shaded.material,
        )
        return shaded


class Figure:
    """A moving thing in its poses, in its own frame (x forward, standing on z = 0); they share their textures."""

    def __init__(self, poses: Sequence[Sequence[Surface]], seed: int) -> None:
        self.appearance = Appearance([surface for surfaces in poses for surface in surfaces], seed)
        self._scenes = tuple(RayScene(surfaces) for surfaces in poses)
        self._first_surface = np.cumsum([0, *(len(surfaces) for surfaces in poses)])

    def cast(self, rays: F32, pose: int) -> tuple[F32, I32]:
        """Cast rays (n, 6) at one pose; return distances and numbers of surfaces as :meth:`RayScene.cast` does."""
        distance, surface = self._scenes[pose].cast(rays)
        return distance, np.where(surface >= 0, surface + self._first_surface[pose], -1).astype(np.int32)


class Renderer:
    """Renders views of one building. Not for two threads at once: its buffers are reused."""

    def __init__(
        self,
        surfaces: Sequence[Surface],
        lamps_m: Sequence[tuple[float, float, float]] = (),
        seed: int = 0,
        movers: Sequence[Sequence[Sequence[Surface]]] = (),
    ) -> None:
        """``movers`` are the surfaces of each moving thing in each of its poses, as :class:`Figure` takes them."""
        self._building = Appearance(surfaces, seed, lamps_m)
        self._seed = seed
        self._movers = tuple(Figure(poses, seed) for poses in movers)
        self._camera_rays: dict[tuple[object, ...], F32] = {}

    def with_movers(self, movers: Sequence[Sequence[Sequence[Surface]]]) -> Renderer:
        """Return a renderer of the same building with other moving things; the building is not painted again."""
        other = copy.copy(self)
        other._movers = tuple(Figure(poses, self._seed) for poses in movers)
        return other

    def render(
        self, camera: CameraIntrinsics, world_from_camera: Transform, placements: Sequence[Placement | None] = ()
    ) -> View:
        """Render what an ideal pinhole camera sees.

        ``placements`` say where the moving things are, in their order; None for one that is not there.
        """
        seen, distance, is_moving = self.look(
            self._directions(camera), 1.0 / camera.fx_px, world_from_camera, placements
        )
        shape = (camera.height_px, camera.width_px)
        return View(
            seen.colour.reshape(*shape, 3),
            distance.reshape(shape),
            seen.incidence.reshape(shape),
            seen.material.reshape(shape),
            is_moving.reshape(shape) if is_moving.any() else None,
        )

    def look(
        self,
        in_camera: F32,
        pixel_rad: float,
        world_from_camera: Transform,
        placements: Sequence[Placement | None] = (),
    ) -> tuple[Shaded, F32, NDArray[np.bool_]]:
        """Look along rays (n, 3) in the frame of any camera, each ``pixel_rad`` wide.

        Returns what is seen, its distance (n,) in lengths of the rays, and whether it moves (n,).
        """
        rays = np.empty((len(in_camera), 6), np.float32)
        aim(in_camera, np.ascontiguousarray(world_from_camera.rotation), world_from_camera.translation.copy(), rays)
        distance, surface = self._building.scene.cast(rays)
        picture = self._building.shade(rays, distance, surface, pixel_rad)
        is_moving = np.zeros(len(rays), np.bool_)
        for mover, placement in zip(self._movers, placements, strict=True):
            if placement is not None:
                is_moving[_draw_mover(mover, placement, rays, pixel_rad, distance, picture)] = True
        return picture, distance, is_moving

    def _directions(self, camera: CameraIntrinsics) -> F32:
        """Return the rays (n, 3) of all pixels in the camera's frame, 1 m along the optical axis each."""
        key = (camera.width_px, camera.height_px, camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px)
        if key not in self._camera_rays:
            v, u = np.mgrid[0 : camera.height_px, 0 : camera.width_px]
            x, y = (u - camera.cx_px) / camera.fx_px, (v - camera.cy_px) / camera.fy_px
            self._camera_rays[key] = np.stack([x, y, np.ones_like(x)], axis=2).reshape(-1, 3).astype(np.float32)
        return self._camera_rays[key]


def _draw_mover(
    mover: Figure, placement: Placement, rays: F32, pixel_rad: float, distance: F32, picture: Shaded
) -> NDArray[np.int64]:
    """Draw a moving thing over the picture (in place) where it is nearer than what is there; return those pixels."""
    offset = np.array([placement.x_m, placement.y_m, 0.0], np.float32) - rays[0, :3]
    candidates = _rays_towards(offset, mover.appearance.reach_m, rays[:, 3:])
    turn = rotation_about_z(placement.yaw_rad).astype(np.float32)
    own_rays = np.empty((len(candidates), 6), np.float32)
    own_rays[:, :3] = -offset @ turn
    own_rays[:, 3:] = rays[candidates, 3:] @ turn
    own_distance, surface = mover.cast(own_rays, placement.pose)
    nearer = np.flatnonzero(own_distance < distance[candidates])
    shaded = mover.appearance.shade(
        np.ascontiguousarray(own_rays[nearer]), own_distance[nearer], surface[nearer], pixel_rad
    )
    seen: NDArray[np.int64] = candidates[nearer]
    distance[seen] = own_distance[nearer]
    picture.colour[seen] = shaded.colour
    picture.incidence[seen] = shaded.incidence
    picture.material[seen] = shaded.material
    return seen


def _rays_towards(offset: F32, reach_m: float, directions: F32) -> NDArray[np.int64]:
    """Return which rays can meet a sphere of radius ``reach_m`` about a point that is ``offset`` (3,) away."""
    away = float(np.linalg.norm(offset))
    if away <= reach_m:
        return np.arange(len(directions))
    cosine = directions @ (offset / away) / np.linalg.norm(directions, axis=1)
    return np.flatnonzero(cosine > math.sqrt(1.0 - (reach_m / away) ** 2))

"""Rooms of bare planes, as a noisy depth camera sees them: nothing but surfaces."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from navcore.geometry import world_from_camera_at
from navcore.slam.keyframes import SlamCamera

CAMERA = SlamCamera(320, 240, 230.0, 230.0, 159.5, 119.5, 100.0)
MAX_DEPTH_M = 8.0


@dataclass(frozen=True)
class Plane:
    """All points x with normal · x = distance; seen from where normal · x is less."""

    normal: tuple[float, float, float]
    distance_m: float


FLOOR = Plane((0.0, 0.0, -1.0), 0.0)


def room_planes() -> list[Plane]:
    """A room of 6 × 5 m with its floor, the camera in its middle."""
    return [FLOOR] + [
        Plane(n, d) for n, d in (((1, 0, 0), 3.0), ((-1, 0, 0), 3.0), ((0, 1, 0), 2.5), ((0, -1, 0), 2.5))
    ]


def corridor_planes() -> list[Plane]:
    """A corridor of 2 m along x, with floor and ceiling and no end."""
    return [FLOOR, Plane((0.0, 0.0, 1.0), 2.6), Plane((0.0, 1.0, 0.0), 1.0), Plane((0.0, -1.0, 0.0), 1.0)]


def camera_at(place: tuple[float, float, float], heading_rad: float) -> np.ndarray:
    """``camera_from_world`` (4, 4) of a camera that looks level along a heading."""
    return np.ascontiguousarray(world_from_camera_at(place, heading_rad).inverse().matrix)


def depth_of(
    planes: list[Plane], camera_from_world: np.ndarray, noise_per_m: float, rng: np.random.Generator
) -> np.ndarray:
    """Depth image (h, w) whose inverse depths have the standard deviation ``noise_per_m``; NaN beyond MAX_DEPTH_M."""
    v, u = np.mgrid[0 : CAMERA.height_px, 0 : CAMERA.width_px]
    rays = np.stack([(u - CAMERA.cx_px) / CAMERA.fx_px, (v - CAMERA.cy_px) / CAMERA.fy_px, np.ones(u.shape)], axis=2)
    centre = -camera_from_world[:3, :3].T @ camera_from_world[:3, 3]
    inverse = np.zeros(u.shape)
    for plane in planes:
        normal = np.array(plane.normal, dtype=float)
        towards = rays @ (camera_from_world[:3, :3] @ normal)
        gap_m = plane.distance_m - normal @ centre
        inverse = np.maximum(inverse, towards / gap_m)
    inverse += rng.normal(0.0, noise_per_m, inverse.shape)
    with np.errstate(divide="ignore"):
        return np.where(inverse > 1.0 / MAX_DEPTH_M, 1.0 / inverse, np.nan).astype(np.float32)

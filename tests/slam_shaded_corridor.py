"""A corridor as a camera sees it: papered at its beginning, then bare, with skirting boards, evenly lit or by lamps."""

from __future__ import annotations

import numpy as np
from slam_blank_room import CAMERA, camera_at

from navcore.types import CameraIntrinsics, Frame

INTRINSICS = CameraIntrinsics(320, 240, CAMERA.fx_px, CAMERA.fy_px, CAMERA.cx_px, CAMERA.cy_px)
BARE_FROM_M = 2.0
"""From here on along x the walls and the floor are bare."""
END_M = 30.0
REACH_M = 5.5
"""Depth is measured up to here."""
SKIRTING_M = 0.1
STEP_M = 0.08
STEP_S = 0.1
_PLANES = np.array(
    [
        [0.0, 0.0, -1.0, 0.0],
        [0.0, 0.0, 1.0, 2.6],
        [0.0, 1.0, 0.0, 1.1],
        [0.0, -1.0, 0.0, 1.1],
        [1.0, 0.0, 0.0, END_M],
    ]
)
"""Normals away from the corridor, and distances: floor, ceiling, both walls, the far end."""
_PAINT = np.array([165.0, 210.0, 190.0, 190.0, 180.0])
_TILE_M = 0.11
_TILES = np.random.default_rng(5).uniform(0.35, 1.2, (5, 97, 97))


def heading_rad(along_m: float) -> float:
    """A walker looks a little to both sides."""
    return 0.05 * float(np.sin(along_m / 0.9))


def walk(
    begin_m: float, end_m: float, *, lamps: bool, seed: int, step_m: float = STEP_M
) -> list[tuple[Frame, np.ndarray]]:
    """Frames along the corridor, and where they were taken (camera_from_world)."""
    rng = np.random.default_rng(seed)
    frames = []
    for number, along_m in enumerate(np.arange(begin_m, end_m, step_m)):
        side_m = 0.05 * float(np.sin(along_m / 0.7 + seed))
        pose = camera_at((float(along_m), side_m, 1.4), heading_rad(float(along_m) + seed))
        frames.append((_frame(number, pose, lamps, rng), pose))
    return frames


def _frame(number: int, camera_from_world: np.ndarray, lamps: bool, rng: np.random.Generator) -> Frame:
    v, u = np.mgrid[0 : CAMERA.height_px, 0 : CAMERA.width_px]
    rays = np.stack([(u - CAMERA.cx_px) / CAMERA.fx_px, (v - CAMERA.cy_px) / CAMERA.fy_px, np.ones(u.shape)], axis=2)
    rays = rays @ camera_from_world[:3, :3]
    centre = -camera_from_world[:3, :3].T @ camera_from_world[:3, 3]
    inverse = np.stack([rays @ plane[:3] / (plane[3] - plane[:3] @ centre) for plane in _PLANES])
    which = np.argmax(inverse, axis=0)
    nearest = np.max(inverse, axis=0)
    points = centre + rays / nearest[..., None]
    grey = _PAINT[which] * _pattern(which, points) * (_light(points) if lamps else 1.0)
    grey = np.clip(grey + rng.normal(0.0, 2.0, grey.shape), 0, 255).astype(np.uint8)
    measured = nearest + rng.normal(0.0, 0.002, nearest.shape)
    depth_m = np.where(measured > 1.0 / REACH_M, 1.0 / np.maximum(measured, 1e-6), np.nan).astype(np.float32)
    return Frame(STEP_S * number, np.repeat(grey[..., None], 3, axis=2), depth_m)


def _pattern(which: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Tiles up to where it is bare; skirting boards all along."""
    across = np.where((which == 2) | (which == 3), points[..., 2], points[..., 1])
    row = np.floor(points[..., 0] / _TILE_M).astype(int) % 97
    column = np.floor(across / _TILE_M).astype(int) % 97
    bare = (points[..., 0] > BARE_FROM_M) | (which == 1) | (which == 4)
    pattern = np.where(bare, 1.0, _TILES[which, row, column])
    is_skirting = (points[..., 2] < SKIRTING_M) & (which != 0)
    return np.where(is_skirting, 0.25, pattern)


def _light(points: np.ndarray) -> np.ndarray:
    """Lamps under the ceiling every 2.7 m, one brighter than the other."""
    light = np.full(points.shape[:2], 0.4)
    for number in range(12):
        away2 = (points[..., 0] - 2.7 * number) ** 2 + points[..., 1] ** 2 + (points[..., 2] - 2.6) ** 2
        light += (0.6 + 0.1 * (number % 3)) / (0.8 + away2)
    return light

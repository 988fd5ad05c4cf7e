"""Levelling a map: gravity up, the floor at z = 0, axes along the main walls.

The depth images of the key frames say where horizontal and vertical surfaces are; the cameras' mean up direction says
roughly where up is, since a head is held upright on the whole. The result says what it rests on.
"""

from __future__ import annotations

import enum
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from navcore.geometry import FloatArray, Transform
from navcore.types import DepthImage

FLOOR_BELOW_CAMERA_M = (1.1, 2.1)
"""How far below the camera the floor is looked for."""
ASSUMED_HEIGHT_M = 1.5
"""Height of the camera where no floor is seen."""
MAX_TILT_RAD = np.radians(40.0)
"""Mean up direction of the cameras and gravity differ by less than this."""
RANGE_M = (0.4, 4.5)
"""Depths that are used."""
GRID = 80
"""Columns of the grid to which a depth image is thinned."""
BIN_M = 0.02
MIN_FLOOR_SHARE = 0.03
"""Share of all surface points that the floor must have."""
MIN_HORIZONTAL_SHARE = 0.05
"""Share of all surface points that must be horizontal for gravity to be read from them."""
MIN_WALL_CONCENTRATION = 0.25
"""How clearly the directions of vertical surfaces must prefer two axes, 0–1."""


class FloorEvidence(enum.Enum):
    """What up and floor height rest on."""

    FLOOR = "floor"
    """The floor itself was seen."""
    HORIZONTAL_SURFACES = "horizontal_surfaces"
    """Up rests on desks, shelves or the ceiling; the floor's height is assumed."""
    CAMERA_UP = "camera_up"
    """Up is how the cameras were held on the whole; the floor's height is assumed."""


@dataclass(frozen=True, slots=True, eq=False)
class Leveling:
    """How a map is turned and moved to be level."""

    level_from_map: Transform
    evidence: FloorEvidence
    is_along_walls: bool
    """Whether the axes follow the main walls; otherwise x is where the first camera looked."""
    camera_height_m: float
    """Median height of the cameras above the floor."""
    note: str
    """The same in a sentence."""


@dataclass(frozen=True, slots=True, eq=False)
class _Surfaces:
    """Points and unit normals (towards the camera) in the map frame, and the camera that saw each."""

    points: FloatArray
    normals: FloatArray
    view: NDArray[np.int64]


def level(
    views: Iterable[tuple[DepthImage, FloatArray]],
    fx_px: float,
    fy_px: float,
    cx_px: float,
    cy_px: float,
) -> Leveling:
    """Find the level frame from depth images (h, w) and their ``map_from_camera`` (4, 4), at least one.

    A hundred views spread over the map are enough; order does not matter but for the first, whose place becomes
    x = y = 0 and whose heading becomes +x, rounded to the walls where there are some. Raises ValueError without views.
    """
    poses: list[FloatArray] = []
    parts: list[tuple[FloatArray, FloatArray]] = []
    for depth_m, map_from_camera in views:
        points, normals = surface_normals(depth_m, fx_px, fy_px, cx_px, cy_px)
        rotation = map_from_camera[:3, :3]
        parts.append((points @ rotation.T + map_from_camera[:3, 3], normals @ rotation.T))
        poses.append(np.asarray(map_from_camera, dtype=np.float64))
    if not poses:
        raise ValueError("levelling needs at least one view")
    cameras = np.stack(poses)
    surfaces = _Surfaces(
        np.concatenate([points for points, _ in parts]),
        np.concatenate([normals for _, normals in parts]),
        np.repeat(np.arange(len(parts)), [len(points) for points, _ in parts]),
    )
    up, floor_height, evidence = _up_and_floor(surfaces, cameras)
    heading, is_along_walls = _main_direction(surfaces, cameras[0], up)
    rotation = np.stack([heading, np.cross(up, heading), up])
    origin = cameras[0, :3, 3]
    translation = -rotation @ origin
    translation[2] = -floor_height
    height_m = float(np.median(cameras[:, :3, 3] @ up - floor_height))
    return Leveling(
        Transform.from_rotation_translation(rotation, translation),
        evidence,
        is_along_walls,
        height_m,
        _note(evidence, is_along_walls, height_m),
    )


def _note(evidence: FloorEvidence, is_along_walls: bool, height_m: float) -> str:
    floor = {
        FloorEvidence.FLOOR: f"Levelled to the floor, {height_m:.2f} m below the camera",
        FloorEvidence.HORIZONTAL_SURFACES: "No floor seen: levelled to other horizontal surfaces, floor assumed"
        f" {height_m:.2f} m below the camera",
        FloorEvidence.CAMERA_UP: "No horizontal surface seen: up is how the camera was held, floor assumed"
        f" {height_m:.2f} m below it",
    }[evidence]
    return f"{floor}; axes along the {'main walls' if is_along_walls else 'first view'}."


def surface_normals(
    depth_m: DepthImage, fx_px: float, fy_px: float, cx_px: float, cy_px: float
) -> tuple[FloatArray, FloatArray]:
    """Return points (n, 3) and unit normals (n, 3), towards the camera, of smooth surface in a thinned depth image."""
    step = max(depth_m.shape[1] // GRID, 1)
    thin = np.asarray(depth_m[step // 2 :: step, step // 2 :: step], dtype=np.float64)
    v, u = np.mgrid[0 : thin.shape[0], 0 : thin.shape[1]] * step + step // 2
    grid = np.stack([(u - cx_px) / fx_px * thin, (v - cy_px) / fy_px * thin, thin], axis=2)
    right = grid[1:-1, 2:] - grid[1:-1, :-2]
    down = grid[2:, 1:-1] - grid[:-2, 1:-1]
    middle = grid[1:-1, 1:-1]
    with np.errstate(invalid="ignore", divide="ignore"):
        normal = np.cross(down, right)
        normal /= np.linalg.norm(normal, axis=2, keepdims=True)
        normal[np.sum(normal * middle, axis=2) > 0] *= -1.0
        z = middle[:, :, 2]
        # Across an edge the two sides differ by more than a surface seen at 80° would.
        extent = 2.0 * step / fx_px * z
        is_smooth = (np.abs(right[:, :, 2]) < 6.0 * extent) & (np.abs(down[:, :, 2]) < 6.0 * extent)
        bend = np.abs(grid[1:-1, 2:, 2] + grid[1:-1, :-2, 2] - 2.0 * z) + np.abs(
            grid[2:, 1:-1, 2] + grid[:-2, 1:-1, 2] - 2.0 * z
        )
        usable = is_smooth & (bend < 0.02 + 0.02 * z**2) & (z > RANGE_M[0]) & (z < RANGE_M[1])
        usable &= np.all(np.isfinite(normal), axis=2)
    return middle[usable], normal[usable]


# --------------------------------------------------------------------------------------------- up and floor
def _up_and_floor(surfaces: _Surfaces, cameras: FloatArray) -> tuple[FloatArray, float, FloorEvidence]:
    """Return up (3,), the floor's height along it, and what they rest on."""
    held_up = -cameras[:, :3, 1].mean(axis=0)
    held_up /= max(float(np.linalg.norm(held_up)), 1e-9)
    up, is_horizontal_seen = _gravity(surfaces.normals, held_up)
    if not is_horizontal_seen:
        return held_up, float(np.median(cameras[:, :3, 3] @ held_up)) - ASSUMED_HEIGHT_M, FloorEvidence.CAMERA_UP
    for _ in range(4):
        up = _common_normal(surfaces, up)
    floor = _floor_points(surfaces, cameras, up)
    if floor is None:
        height = float(np.median(cameras[:, :3, 3] @ up)) - ASSUMED_HEIGHT_M
        return up, height, FloorEvidence.HORIZONTAL_SURFACES
    return up, float(np.median(floor @ up)), FloorEvidence.FLOOR


def _gravity(normals: FloatArray, held_up: FloatArray) -> tuple[FloatArray, bool]:
    """Return the direction that most horizontal surfaces share, near ``held_up``, and whether there is enough of them.

    Floors look up and ceilings down, so the sign does not count. The cone narrows around what it holds (mean shift),
    beginning at the fullest of many directions.
    """
    if len(normals) == 0:
        return held_up, False
    facing = normals * np.where(normals @ held_up < 0, -1.0, 1.0)[:, None]
    facing = facing[facing @ held_up > np.cos(MAX_TILT_RAD)]
    if len(facing) < MIN_HORIZONTAL_SHARE * len(normals):
        return held_up, False
    sample = facing[:: max(len(facing) // 500, 1)]
    votes = np.count_nonzero(sample @ facing[:: max(len(facing) // 5000, 1)].T > np.cos(np.radians(6)), axis=1)
    up = sample[int(np.argmax(votes))]
    for cone_deg in (10.0, 6.0, 4.0, 4.0, 4.0):
        inside = facing[facing @ up > np.cos(np.radians(cone_deg))]
        up = inside.mean(axis=0)
        up /= np.linalg.norm(up)
    share = np.count_nonzero(np.abs(normals @ up) > np.cos(np.radians(6))) / len(normals)
    return up, bool(share >= MIN_HORIZONTAL_SHARE)


def _floor_points(surfaces: _Surfaces, cameras: FloatArray, up: FloatArray) -> FloatArray | None:
    """Return the points (n, 3) of the lowest large surface that looks up, at a walker's height below the cameras."""
    looks_up = surfaces.normals @ up > np.cos(np.radians(15))
    below = (cameras[:, :3, 3] @ up)[surfaces.view] - surfaces.points @ up
    usable = looks_up & (below > FLOOR_BELOW_CAMERA_M[0]) & (below < FLOOR_BELOW_CAMERA_M[1])
    if np.count_nonzero(usable) < MIN_FLOOR_SHARE * len(surfaces.points):
        return None
    height = surfaces.points[usable] @ up
    lowest = float(height.min())
    counts = np.bincount(((height - lowest) / BIN_M).astype(np.int64)).astype(np.float64)
    smooth = np.convolve(counts, np.ones(5), mode="same")
    peaks = np.flatnonzero(smooth >= 0.5 * smooth.max())
    # The largest surface may be a row of desks; a lower one of half its size is the floor.
    first = peaks[0]
    peak = first + int(np.argmax(smooth[first : first + 6]))
    level_height = lowest + (peak + 0.5) * BIN_M
    near = np.abs(height - level_height) < 0.08
    floor = surfaces.points[usable][near]
    return floor if len(floor) >= MIN_FLOOR_SHARE * len(surfaces.points) else None


def _common_normal(surfaces: _Surfaces, up: FloatArray) -> FloatArray:
    """Return the normal that the horizontal planes (floor, desks, ceiling) share, each at its own height.

    Their points reach far, so this is finer than the mean of the normals.
    """
    points = surfaces.points[np.abs(surfaces.normals @ up) > np.cos(np.radians(12))]
    height = points @ up
    scatter = np.zeros((3, 3))
    for level_height in _plane_heights(height):
        plane = points[np.abs(height - level_height) < 0.08]
        centred = plane - np.median(plane, axis=0)
        distance = np.abs(centred @ up)
        centred = centred[distance <= 2.5 * float(np.median(distance)) + 0.005]
        centred = centred - centred.mean(axis=0)
        scatter += centred.T @ centred
    _, vectors = np.linalg.eigh(scatter)
    normal = vectors[:, 0] * (1.0 if vectors[:, 0] @ up > 0 else -1.0)
    # A strip fixes the tilt along it only; beyond a few degrees the normals of the surfaces know better.
    return np.asarray(normal) if normal @ up > np.cos(np.radians(4)) else up


def _plane_heights(height: FloatArray) -> list[float]:
    """Return the heights at which many points lie, the fullest first; planes with a fifth of the fullest count."""
    lowest = float(height.min())
    counts = np.bincount(((height - lowest) / BIN_M).astype(np.int64)).astype(np.float64)
    smooth = np.convolve(counts, np.ones(5), mode="same")
    least = 0.2 * smooth.max()
    found: list[float] = []
    while len(found) < 6 and smooth.max() >= max(least, 1.0):
        peak = int(np.argmax(smooth))
        found.append(lowest + (peak + 0.5) * BIN_M)
        smooth[max(peak - 8, 0) : peak + 9] = 0.0
    return found


# -------------------------------------------------------------------------------------------------- walls
def _main_direction(surfaces: _Surfaces, first_camera: FloatArray, up: FloatArray) -> tuple[FloatArray, bool]:
    """Return the horizontal axis x (3,) nearest to where the first camera looked, and whether walls gave it."""
    forward = first_camera[:3, 2] - up * (first_camera[:3, 2] @ up)
    if np.linalg.norm(forward) < 0.05:
        forward = -first_camera[:3, 1] + up * (first_camera[:3, 1] @ up)
    forward /= np.linalg.norm(forward)
    left = np.cross(up, forward)
    vertical = surfaces.normals[np.abs(surfaces.normals @ up) < np.sin(np.radians(8))]
    if len(vertical) < 0.02 * max(len(surfaces.normals), 1) or len(vertical) < 50:
        return forward, False
    # Walls at right angles to one another have the same direction modulo 90°.
    quarter = np.arctan2(vertical @ left, vertical @ forward) % (np.pi / 2)
    counts, _ = np.histogram(quarter, bins=90, range=(0.0, np.pi / 2))
    circular = np.concatenate([counts[-2:], counts, counts[:2]])
    peak = (int(np.argmax(np.convolve(circular, np.ones(5), mode="valid"))) + 0.5) * np.pi / 180
    deviation = (quarter - peak + np.pi / 4) % (np.pi / 2) - np.pi / 4
    near = np.abs(deviation) < np.radians(8)
    angle = peak + float(np.median(deviation[near]))
    concentration = np.count_nonzero(near) / len(deviation) - 16.0 / 90.0
    if concentration < MIN_WALL_CONCENTRATION:
        return forward, False
    angle = (angle + np.pi / 4) % (np.pi / 2) - np.pi / 4
    return np.asarray(np.cos(angle) * forward + np.sin(angle) * left), True

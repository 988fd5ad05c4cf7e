"""A synthetic walk for the SLAM back-end: landmarks on a corridor's walls, seen with noise by a camera that drifts."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from navcore.geometry import world_from_camera_at
from navcore.slam.features import GRID_PX, sort_into_cells
from navcore.slam.keyframes import NO_LANDMARK, Features, SlamCamera
from navcore.slam.lie import exp_se3
from navcore.slam.map import MapBuilder

CAMERA = SlamCamera(320, 240, 230.0, 230.0, 160.0, 120.0, 20.0)
MAX_FEATURES = 400
SIGHT_M = 5.0


@dataclass
class World:
    """Points (n, 3), z up, with a descriptor (n, 32) each."""

    points: np.ndarray
    descriptors: np.ndarray


def corridor(path: np.ndarray, rng: np.random.Generator, per_metre: int = 60) -> World:
    """Points on the walls, 1.2 m to either side of a path (n, 2), from floor to 2.4 m."""
    steps = np.diff(path, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    leg = rng.choice(len(steps), size=int(per_metre * lengths.sum()), p=lengths / lengths.sum())
    along = rng.random(len(leg))
    side = rng.choice([-1.2, 1.2], size=len(leg)) + rng.normal(0, 0.1, len(leg))
    forward = steps[leg] / lengths[leg, None]
    left = np.column_stack([-forward[:, 1], forward[:, 0]])
    ground = path[leg] + along[:, None] * steps[leg] + side[:, None] * left
    points = np.column_stack([ground, rng.uniform(0.0, 2.4, len(leg))])
    return World(points, rng.integers(0, 256, (len(points), 32), dtype=np.uint8))


def poses_along(path: np.ndarray, spacing_m: float) -> np.ndarray:
    """``camera_from_world`` (k, 4, 4) of a camera carried along a path (n, 2), looking ahead, turning in corners."""
    poses = []
    heading = None
    for start, end in pairwise(path):
        direction = float(np.arctan2(*(end - start)[::-1]))
        if heading is not None:
            turn = (direction - heading + np.pi) % (2 * np.pi) - np.pi
            poses += [world_from_camera_at((*start, 1.6), heading + share * turn) for share in (0.2, 0.4, 0.6, 0.8)]
        heading = direction
        for s in np.arange(0.0, np.linalg.norm(end - start), spacing_m):
            x, y = start + (end - start) / np.linalg.norm(end - start) * s
            poses.append(world_from_camera_at((x, y, 1.6), heading))
    return np.stack([pose.inverse().matrix for pose in poses])


def drifted(poses: np.ndarray, rng: np.random.Generator, yaw_rad: float, scale: float) -> np.ndarray:
    """The same poses as an odometry with a small error in every step would have them."""
    out = [poses[0]]
    for before, after in pairwise(poses):
        step = after @ np.linalg.inv(before)
        step[:3, 3] *= scale
        error = np.r_[rng.normal(0, 0.002, 3), rng.normal(0, 0.0005, 3)]
        error[4] += yaw_rad
        out.append(exp_se3(error) @ step @ out[-1])
    return np.stack(out)


def look(world: World, camera_from_world: np.ndarray, rng: np.random.Generator) -> tuple[Features, np.ndarray]:
    """What a camera sees of the world: features, and the index of the point behind each."""
    p = world.points @ camera_from_world[:3, :3].T + camera_from_world[:3, 3]
    z = np.maximum(p[:, 2], 1e-6)
    u = CAMERA.fx_px * p[:, 0] / z + CAMERA.cx_px
    v = CAMERA.fy_px * p[:, 1] / z + CAMERA.cy_px
    inside = (p[:, 2] > 0.4) & (p[:, 2] < SIGHT_M) & (u > 1) & (u < 318) & (v > 1) & (v < 238)
    seen = np.flatnonzero(inside)
    seen = np.sort(rng.permutation(seen)[:MAX_FEATURES])
    depth = p[seen, 2] + rng.normal(0, 0.004, len(seen)) * p[seen, 2] ** 2
    uv = np.column_stack([u, v])[seen] + rng.normal(0, 0.4, (len(seen), 2))
    uvr = np.ascontiguousarray(np.column_stack([uv, uv[:, 0] - CAMERA.bf_px_m / depth]))
    columns, rows = -(-CAMERA.width_px // GRID_PX), -(-CAMERA.height_px // GRID_PX)
    order, cell_start = sort_into_cells(uvr, columns, rows)
    flips = (rng.random((len(seen), 256)) < 0.03).astype(np.uint8)
    descriptors = np.packbits(np.unpackbits(world.descriptors[seen], axis=1) ^ flips, axis=1)
    features = Features(
        np.ascontiguousarray(uvr[order]),
        np.ascontiguousarray(depth[order]),
        np.zeros(len(seen), np.int32),
        np.zeros(len(seen)),
        np.ascontiguousarray(descriptors[order]),
        cell_start,
        columns,
    )
    return features, seen[order]


class Odometry:
    """Feeds key frames to a map, connecting points only over a short memory, as tracking without loop closing does."""

    def __init__(self, world: World, seed: int) -> None:
        self.builder = MapBuilder(CAMERA, MAX_FEATURES)
        self._world = world
        self._rng = np.random.default_rng(seed)
        self._landmark_of_point: dict[int, tuple[int, int]] = {}

    def add(self, true_pose: np.ndarray, drifted_step: np.ndarray | None, memory: int = 6) -> int:
        """Add the key frame that stands at ``true_pose``, placed by its step from the last; return its index."""
        builder = self.builder
        features, points = look(self._world, true_pose, self._rng)
        index = len(builder.keyframes)
        pose = true_pose if drifted_step is None else drifted_step @ builder.camera_from_world[index - 1]
        landmark_of = np.full(len(features), NO_LANDMARK, np.int32)
        for f, point in enumerate(points.tolist()):
            known = self._landmark_of_point.get(point)
            if known and index - known[1] <= memory and builder.landmark_alive[known[0]]:
                landmark_of[f] = known[0]
        builder.add_keyframe(float(index), features, pose, landmark_of)
        fresh = np.flatnonzero(landmark_of == NO_LANDMARK).astype(np.int32)
        in_camera = features.points_in_camera(CAMERA)[fresh]
        world_from_camera = np.linalg.inv(pose)
        new = builder.add_landmarks(index, fresh, in_camera @ world_from_camera[:3, :3].T + world_from_camera[:3, 3])
        landmark_of[fresh] = new
        for f, point in enumerate(points.tolist()):
            self._landmark_of_point[point] = (int(landmark_of[f]), index)
        return index


def centres(camera_from_world: np.ndarray) -> np.ndarray:
    """Camera positions (k, 3)."""
    return -np.einsum("kji,kj->ki", camera_from_world[:, :3, :3], camera_from_world[:, :3, 3])

"""The dense coloured point cloud for people to look at: key frames' depth, fused into voxels.

A voxel holds the mean of what fell into it, near measurements counting more (a depth camera's noise grows with the
square of the distance). What only one key frame saw from afar is noise, and what others look through is noise or
somebody who walked by.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from navcore.compiled import kernel
from navcore.geometry import FloatArray
from navcore.types import CameraIntrinsics, DepthImage, ImageRgb

BoolArray = NDArray[np.bool_]
Int64Array = NDArray[np.int64]

VOXEL_M = 0.04
MAX_POINTS = 400_000
MAX_DEPTH_M = 4.5
"""Farther measurements are too noisy to look good."""
CEILING_M = 2.3
"""What lies higher hides the rooms from somebody who looks from above."""
SURE_DEPTH_M = 1.5
"""What was seen from nearer than this needs no second key frame."""
MIN_WEIGHT = 0.15
"""Sum of weights 1/z² below which a voxel is noise."""
IMAGE_COLUMNS = 160
"""Pixels of a row that are used."""
MAX_THROUGH_SHARE = 0.6
"""A voxel that more key frames look through than this share of those that saw it is not there (any more)."""
_COLUMNS = 9
_MAX_LOAD = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class DenseCloud:
    """A coloured point cloud in the level frame."""

    points_m: NDArray[np.float32]
    """(n, 3)."""
    colours_rgb: NDArray[np.uint8]
    """(n, 3)."""
    is_ceiling: BoolArray
    """(n,): higher than a person can reach; leave it out to look into the rooms from above."""
    weights: NDArray[np.float32]
    """(n,): sum of 1/z² over the measurements that made each point, 1/m²."""
    view_counts: NDArray[np.uint16]
    """(n,): key frames that saw it."""
    sessions: NDArray[np.uint64]
    """(n,): bit s is set where recording s saw it."""

    def __len__(self) -> int:
        return len(self.points_m)

    def chosen(self, kept: BoolArray) -> DenseCloud:
        """Return the points that are marked (n,)."""
        return DenseCloud(
            self.points_m[kept],
            self.colours_rgb[kept],
            self.is_ceiling[kept],
            self.weights[kept],
            self.view_counts[kept],
            self.sessions[kept],
        )

    def below_ceiling(self) -> DenseCloud:
        """Return the cloud without the ceiling."""
        return self.chosen(~self.is_ceiling)


def fuse(
    views: Iterable[tuple[ImageRgb, DepthImage, FloatArray]],
    intrinsics: CameraIntrinsics,
    voxel_m: float = VOXEL_M,
    max_points: int = MAX_POINTS,
    ceiling_m: float = CEILING_M,
) -> DenseCloud:
    """Fuse colour (h, w, 3) and depth (h, w) images with their ``level_from_camera`` (4, 4) into one cloud.

    Where there are more than ``max_points`` voxels, larger ones are taken. The same views give the same cloud.
    """
    fusion = VoxelFusion(intrinsics, voxel_m)
    for colour_rgb, depth_m, level_from_camera in views:
        fusion.add(colour_rgb, depth_m, level_from_camera)
    return fusion.cloud(max_points, ceiling_m)


class VoxelFusion:
    """Collects views one by one, so that a caller can show progress."""

    def __init__(self, intrinsics: CameraIntrinsics, voxel_m: float = VOXEL_M, session: int = 0) -> None:
        self._intrinsics = intrinsics
        self._session = session
        self._voxel_m = voxel_m
        self._keys = np.full(1 << 16, -1, np.int64)
        self._sums = np.zeros((1 << 16, _COLUMNS))
        self._count = 0
        self._views = 0
        self._poses: list[FloatArray] = []
        self._depths_mm: list[NDArray[np.uint16]] = []

    def add(self, colour_rgb: ImageRgb, depth_m: DepthImage, level_from_camera: FloatArray) -> None:
        """Add a view; the colour image may be distorted as the intrinsics say, the depth image is not."""
        camera = self._intrinsics
        if camera.distortion and any(camera.distortion):
            undistorted = cv2.undistort(colour_rgb, camera.matrix, np.array(camera.distortion))
            colour_rgb = np.asarray(undistorted, dtype=np.uint8)
        stride = max(camera.width_px // IMAGE_COLUMNS, 1)
        rows = depth_m.shape[0] // stride + 1
        needed = self._count + rows * (depth_m.shape[1] // stride + 1)
        while needed > _MAX_LOAD * len(self._keys):
            self._keys, self._sums = _rehash(self._keys, self._sums, 4 * len(self._keys))
        self._count = _insert_view(
            np.ascontiguousarray(colour_rgb),
            np.ascontiguousarray(depth_m, dtype=np.float32),
            np.ascontiguousarray(level_from_camera, dtype=np.float64),
            np.array([camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px]),
            stride,
            self._voxel_m,
            self._keys,
            self._sums,
            self._count,
        )
        self._views += 1
        self._poses.append(np.array(level_from_camera, dtype=np.float64))
        self._depths_mm.append(_nearest_mm(np.ascontiguousarray(depth_m, dtype=np.float32), stride))

    def cloud(self, max_points: int = MAX_POINTS, ceiling_m: float = CEILING_M) -> DenseCloud:
        """Return what has been collected so far."""
        used = np.flatnonzero(self._keys >= 0)
        used = used[np.argsort(self._keys[used], kind="stable")]
        sums = self._sums[used]
        sure = (sums[:, 7] >= 2.0) | (sums[:, 8] < SURE_DEPTH_M) if self._views > 1 else np.ones(len(sums), np.bool_)
        sums = sums[sure & (sums[:, 0] >= MIN_WEIGHT)]
        sums = sums[~self.looks_through(_places(sums), sums[:, 7])]
        voxel_m = self._voxel_m
        while len(sums) > max_points:
            voxel_m *= 1.25
            sums = _coarser(sums, voxel_m)
        points = _places(sums).astype(np.float32)
        colours = np.clip(np.round(sums[:, 4:7] / np.maximum(sums[:, 0:1], 1e-12)), 0, 255).astype(np.uint8)
        return DenseCloud(
            points,
            colours,
            points[:, 2] > ceiling_m,
            sums[:, 0].astype(np.float32),
            np.minimum(sums[:, 7], 65_535).astype(np.uint16),
            np.full(len(points), np.uint64(1) << np.uint64(self._session)),
        )

    def looks_through(self, points_m: FloatArray, view_counts: FloatArray) -> BoolArray:
        """Return which points (n, 3), seen by so many key frames (n,), the views look through: not there any more."""
        camera = self._intrinsics
        stride = max(camera.width_px // IMAGE_COLUMNS, 1)
        points = np.ascontiguousarray(points_m, dtype=np.float64)
        through = np.zeros(len(points), np.int32)
        thin = np.array([camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px]) / stride
        for pose, depth_mm in zip(self._poses, self._depths_mm, strict=True):
            _count_through(points, pose, depth_mm, thin, through)
        return np.asarray((through >= 2) & (through > MAX_THROUGH_SHARE * view_counts))


def _places(sums: FloatArray) -> FloatArray:
    return np.asarray(sums[:, 1:4] / np.maximum(sums[:, 0:1], 1e-12))


def _coarser(sums: FloatArray, voxel_m: float) -> FloatArray:
    """Merge voxels into larger ones."""
    cells = np.floor(sums[:, 1:4] / sums[:, 0:1] / voxel_m).astype(np.int64)
    _, group = np.unique(cells, axis=0, return_inverse=True)
    merged = np.zeros((int(group.max()) + 1, _COLUMNS))
    np.add.at(merged, group.ravel(), sums)
    return merged


# --------------------------------------------------------------------------------------------------- kernels
# A slot of the table holds: Σw, Σw·x, Σw·y, Σw·z, Σw·r, Σw·g, Σw·b, number of key frames, nearest depth.
@kernel
def _slot(key: int, keys: Int64Array) -> int:
    """Return the slot of a key in an open-addressing table of 2ⁿ slots: its own, or the free one to take."""
    mask = len(keys) - 1
    # Fibonacci hashing spreads neighbouring voxels; the multiplication is meant to overflow.
    h = np.uint64(key) * np.uint64(0x9E3779B97F4A7C15)
    slot = int(h >> np.uint64(20)) & mask
    while keys[slot] != -1 and keys[slot] != key:
        slot = (slot + 1) & mask
    return slot


@kernel
def _rehash(keys: Int64Array, sums: FloatArray, capacity: int) -> tuple[Int64Array, FloatArray]:
    new_keys = np.full(capacity, -1, np.int64)
    new_sums = np.zeros((capacity, sums.shape[1]))
    for old in range(len(keys)):
        if keys[old] >= 0:
            slot = _slot(keys[old], new_keys)
            new_keys[slot] = keys[old]
            new_sums[slot] = sums[old]
    return new_keys, new_sums


@kernel
def _is_edge(depth: NDArray[np.float32], row: int, column: int, z: float) -> bool:
    """Whether a pixel lies at a jump of depth, where a sensor mixes near and far."""
    limit = 0.03 + 0.03 * z
    for dr, dc in ((0, 2), (0, -2), (2, 0), (-2, 0)):
        other = depth[row + dr, column + dc]
        if not abs(other - z) < limit:
            return True
    return False


@kernel
def _insert_view(
    colour: NDArray[np.uint8],
    depth: NDArray[np.float32],
    pose: FloatArray,
    camera: FloatArray,
    stride: int,
    voxel_m: float,
    keys: Int64Array,
    sums: FloatArray,
    count: int,
) -> int:
    height, width = depth.shape
    is_counted = np.zeros(len(keys), np.bool_)
    for row in range(2, height - 2, stride):
        for column in range(2, width - 2, stride):
            z = float(depth[row, column])
            if not (z > 0.3 and z < MAX_DEPTH_M) or _is_edge(depth, row, column, z):
                continue
            x = (column - camera[2]) / camera[0] * z
            y = (row - camera[3]) / camera[1] * z
            px = pose[0, 0] * x + pose[0, 1] * y + pose[0, 2] * z + pose[0, 3]
            py = pose[1, 0] * x + pose[1, 1] * y + pose[1, 2] * z + pose[1, 3]
            pz = pose[2, 0] * x + pose[2, 1] * y + pose[2, 2] * z + pose[2, 3]
            ix = int(np.floor(px / voxel_m)) + (1 << 19)
            iy = int(np.floor(py / voxel_m)) + (1 << 19)
            iz = int(np.floor(pz / voxel_m)) + (1 << 19)
            slot = _slot((ix << 40) | (iy << 20) | iz, keys)
            if keys[slot] == -1:
                keys[slot] = (ix << 40) | (iy << 20) | iz
                sums[slot, 8] = np.inf
                count += 1
            w = 1.0 / (z * z)
            sums[slot, 0] += w
            sums[slot, 1] += w * px
            sums[slot, 2] += w * py
            sums[slot, 3] += w * pz
            for channel in range(3):
                sums[slot, 4 + channel] += w * colour[row, column, channel]
            if not is_counted[slot]:
                is_counted[slot] = True
                sums[slot, 7] += 1.0
            sums[slot, 8] = min(sums[slot, 8], z)
    return count


@kernel
def _nearest_mm(depth: NDArray[np.float32], stride: int) -> NDArray[np.uint16]:
    """Return the nearest depth, in millimetres, of each block of pixels; 0 where any of the block has none."""
    rows, columns = depth.shape[0] // stride, depth.shape[1] // stride
    out = np.zeros((rows, columns), np.uint16)
    for row in range(rows):
        for column in range(columns):
            nearest = 60.0
            for r in range(row * stride, (row + 1) * stride):
                for c in range(column * stride, (column + 1) * stride):
                    z = depth[r, c]
                    nearest = z if z < nearest else (0.0 if not z > 0.0 else nearest)
            out[row, column] = np.uint16(nearest * 1000.0)
    return out


@kernel
def _count_through(
    points: FloatArray, pose: FloatArray, depth_mm: NDArray[np.uint16], camera: FloatArray, through: NDArray[np.int32]
) -> None:
    """Count for each point (n, 3) whether a view sees something well behind it, all around it."""
    rows, columns = depth_mm.shape
    for i in range(len(points)):
        dx = points[i, 0] - pose[0, 3]
        dy = points[i, 1] - pose[1, 3]
        dz = points[i, 2] - pose[2, 3]
        z = pose[0, 2] * dx + pose[1, 2] * dy + pose[2, 2] * dz
        if z < 0.3 or z > MAX_DEPTH_M:
            continue
        u = camera[0] * (pose[0, 0] * dx + pose[1, 0] * dy + pose[2, 0] * dz) / z + camera[2]
        v = camera[1] * (pose[0, 1] * dx + pose[1, 1] * dy + pose[2, 1] * dz) / z + camera[3]
        if u < 2.0 or v < 2.0 or u >= columns - 2.0 or v >= rows - 2.0:
            continue
        limit = 1000.0 * (z + 0.10 + 0.05 * z)
        behind = True
        for r in range(int(v) - 2, int(v) + 3):
            for c in range(int(u) - 2, int(u) + 3):
                if depth_mm[r, c] < limit:
                    behind = False
        if behind:
            through[i] += 1


def warm_up() -> None:
    """Compile this module's kernels."""
    fusion = VoxelFusion(CameraIntrinsics(16, 12, 16.0, 16.0, 8.0, 6.0))
    fusion.add(np.zeros((12, 16, 3), np.uint8), np.ones((12, 16), np.float32), np.eye(4))
    _rehash(fusion._keys, fusion._sums, 4 * len(fusion._keys))
    fusion.cloud()

"""Features of a frame: corners in an image pyramid with an orientation, a binary descriptor and a depth.

The orientation is that of the intensity centroid, the descriptor 256 comparisons of smoothed pixels, turned with the
orientation (Rublee et al. 2011, ORB). The comparisons are our own: see :func:`comparison_pattern`.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from navcore.compiled import kernel
from navcore.geometry import FloatArray
from navcore.slam.corners import HAS_NINE, find_corners
from navcore.slam.keyframes import (
    DESCRIPTOR_BYTES,
    LEVEL_COUNT,
    SCALE_FACTOR,
    ByteArray,
    Features,
    IntArray,
    SlamCamera,
)
from navcore.slam.pattern import comparison_pattern
from navcore.types import CameraIntrinsics, DepthImage, Frame, ImageRgb

GRID_PX = 16
"""Side of the cells into which features are sorted for window searches."""
PATCH_RADIUS_PX = 15
"""Radius of the patch that orientation and descriptor look at."""
TURN_COUNT = 64
"""The comparisons are kept turned to so many orientations."""
FAST_HIGH = 20
"""Grey levels by which a corner differs from its surroundings, where the image has texture."""
FAST_LOW = 7
"""The same, where it has little."""
REFERENCE_AREA_PX = 320 * 240
"""Images of this size get the number of features that is asked for; larger ones more, by area^0.37."""

Float32Array = NDArray[np.float32]


def feature_count_for(width_px: int, height_px: int, reference_count: int) -> int:
    """Return how many features to look for: ``reference_count`` at 320×240; of 600, about 1000 at 640×480."""
    growth = float(np.power(width_px * height_px / REFERENCE_AREA_PX, 0.37))
    return 10 * round(reference_count * growth / 10)


def grey_of(colour_rgb: ImageRgb) -> ByteArray:
    """Return the grey image (h, w)."""
    return np.ascontiguousarray(cv2.cvtColor(colour_rgb, cv2.COLOR_RGB2GRAY), dtype=np.uint8)


def _half_widths() -> IntArray:
    y = np.arange(PATCH_RADIUS_PX + 1)
    return np.asarray(np.sqrt((PATCH_RADIUS_PX + 0.5) ** 2 - y**2).clip(0, PATCH_RADIUS_PX), dtype=np.int32)


def _turned_pattern() -> NDArray[np.int8]:
    """Return (TURN_COUNT, 512, 2): x, y of the points of all comparisons, turned."""
    points = comparison_pattern().reshape(-1, 2).astype(np.float64)
    angles = np.arange(TURN_COUNT) * (2 * np.pi / TURN_COUNT)
    c, s = np.cos(angles)[:, None], np.sin(angles)[:, None]
    turned = np.stack([c * points[:, 0] - s * points[:, 1], s * points[:, 0] + c * points[:, 1]], axis=2)
    return np.round(turned).astype(np.int8)


class FeatureExtractor:
    """Extracts features from frames of one camera; holds tables and scratch images, no memory of earlier frames."""

    def __init__(self, intrinsics: CameraIntrinsics, camera: SlamCamera, count: int) -> None:
        self.camera = camera
        self.count = count
        self._quotas = _level_quotas(count)
        self._sizes = [
            (round(intrinsics.width_px / SCALE_FACTOR**level), round(intrinsics.height_px / SCALE_FACTOR**level))
            for level in range(LEVEL_COUNT)
        ]
        self._scratch = [
            (np.zeros((height, width), np.uint8), np.zeros((height, width), np.uint8)) for width, height in self._sizes
        ]
        self._undistorted = _undistortion_table(intrinsics)
        self._pattern = _turned_pattern()
        self._half_widths = _half_widths()
        self._columns = (camera.width_px + GRID_PX - 1) // GRID_PX
        self._rows = (camera.height_px + GRID_PX - 1) // GRID_PX

    def extract(self, frame: Frame) -> Features:
        """Return the features of a frame."""
        return self.extract_grey(grey_of(frame.colour_rgb), frame.depth_m)

    def extract_grey(self, grey: ByteArray, depth_m: DepthImage) -> Features:
        """Return the features of a grey image (h, w) with its registered depth (h, w)."""
        positions, octaves, angles, descriptors = [], [], [], []
        owed = 0
        for level, (image, quota, scratch) in enumerate(
            zip(self._pyramid(grey), self._quotas, self._scratch, strict=True)
        ):
            corners = find_corners(image, scratch[0], scratch[1], FAST_HIGH, FAST_LOW, quota + owed, HAS_NINE)
            owed += quota - len(corners)
            if len(corners) == 0:
                continue
            smooth = cv2.GaussianBlur(image, (7, 7), 2.0, sigmaY=2.0, borderType=cv2.BORDER_REFLECT_101)
            angle, descriptor = describe(
                image, np.asarray(smooth, dtype=np.uint8), corners, self._pattern, self._half_widths
            )
            # Pixel centres lie at whole numbers; the sizes of the levels are rounded, each side its own way.
            scale = np.array([grey.shape[1] / image.shape[1], grey.shape[0] / image.shape[0]])
            positions.append((corners[:, :2] + 0.5) * scale - 0.5)
            octaves.append(np.full(len(corners), level, np.int32))
            angles.append(angle)
            descriptors.append(descriptor)
        if not positions:
            nothing = np.zeros((0, DESCRIPTOR_BYTES), np.uint8)
            return self._features(np.zeros((0, 2)), np.zeros(0, np.int32), np.zeros(0), nothing, depth_m)
        return self._features(
            np.concatenate(positions),
            np.concatenate(octaves),
            np.concatenate(angles),
            np.concatenate(descriptors),
            depth_m,
        )

    def _pyramid(self, grey: ByteArray) -> list[ByteArray]:
        levels = [grey]
        for size in self._sizes[1:]:
            levels.append(cv2.resize(levels[-1], size, interpolation=cv2.INTER_LINEAR_EXACT))  # type: ignore[arg-type]
        return levels

    def _features(
        self, raw_px: FloatArray, octave: IntArray, angle: FloatArray, descriptors: ByteArray, depth_m: DepthImage
    ) -> Features:
        uvr, depth = measure(raw_px, self._undistorted, depth_m, self.camera.bf_px_m)
        order, cell_start = sort_into_cells(uvr, self._columns, self._rows)
        return Features(
            uvr[order], depth[order], octave[order], angle[order], descriptors[order], cell_start, self._columns
        )


def _level_quotas(count: int) -> list[int]:
    shares = SCALE_FACTOR ** -np.arange(LEVEL_COUNT, dtype=np.float64)
    quotas = np.floor(count * shares / shares.sum()).astype(int)
    quotas[0] += count - int(quotas.sum())
    return [int(quota) for quota in quotas]


def _undistortion_table(intrinsics: CameraIntrinsics) -> Float32Array:
    """Return (h, w, 2): where the ideal pinhole sees what the real camera sees at each pixel."""
    x, y = np.meshgrid(np.arange(intrinsics.width_px), np.arange(intrinsics.height_px))
    pixels = np.stack([x, y], axis=2).astype(np.float64)
    if not any(intrinsics.distortion):
        return pixels.astype(np.float32)
    matrix = intrinsics.matrix
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 40, 1e-5)
    ideal = cv2.undistortPoints(
        pixels.reshape(-1, 1, 2), matrix, np.array(intrinsics.distortion), R=np.eye(3), P=matrix, criteria=criteria
    )
    return np.ascontiguousarray(ideal.reshape(pixels.shape), dtype=np.float32)


# --------------------------------------------------------------------------------------------------- kernels
@kernel
def describe(
    image: ByteArray, smooth: ByteArray, corners: IntArray, pattern: NDArray[np.int8], half_widths: IntArray
) -> tuple[FloatArray, ByteArray]:
    """Return orientation (n,) in radians and descriptors (n, 32) of corners (n, ≥2) of one pyramid level."""
    count = len(corners)
    turns = pattern.shape[0]
    angles = np.empty(count, np.float64)
    descriptors = np.empty((count, 32), np.uint8)
    for i in range(count):
        x, y = corners[i, 0], corners[i, 1]
        m10, m01 = 0, 0
        for dy in range(-PATCH_RADIUS_PX, PATCH_RADIUS_PX + 1):
            half = half_widths[abs(dy)]
            row_sum, row_moment = 0, 0
            for dx in range(-half, half + 1):
                value = int(image[y + dy, x + dx])
                row_sum += value
                row_moment += dx * value
            m10 += row_moment
            m01 += dy * row_sum
        angle = np.arctan2(float(m01), float(m10))
        angles[i] = angle
        turn = int(np.floor(angle * turns / (2 * np.pi) + 0.5)) % turns
        for byte in range(32):
            bits = 0
            for bit in range(8):
                first = 2 * (8 * byte + bit)
                a = smooth[y + pattern[turn, first, 1], x + pattern[turn, first, 0]]
                b = smooth[y + pattern[turn, first + 1, 1], x + pattern[turn, first + 1, 0]]
                bits |= (1 if a < b else 0) << bit
            descriptors[i, byte] = bits
    return angles, descriptors


@kernel
def _depth_near(depth_m: DepthImage, u: float, v: float) -> float:
    """Return the median depth of the 3×3 pixels around a place, NaN where fewer than 3 are known or it is an edge."""
    height, width = depth_m.shape
    x, y = int(np.floor(u + 0.5)), int(np.floor(v + 0.5))
    values = np.empty(9, np.float64)
    count = 0
    for dy in range(-1, 2):
        for dx in range(-1, 2):
            if 0 <= y + dy < height and 0 <= x + dx < width:
                value = depth_m[y + dy, x + dx]
                if value > 0.0:
                    place = count
                    while place > 0 and values[place - 1] > value:
                        values[place] = values[place - 1]
                        place -= 1
                    values[place] = value
                    count += 1
    if count < 3:
        return np.nan
    return float(values[count // 2])


@kernel
def measure(
    raw_px: FloatArray, undistorted: Float32Array, depth_m: DepthImage, bf_px_m: float
) -> tuple[FloatArray, FloatArray]:
    """Return u, v, u_r (n, 3) and depth (n,) of raw pixels (n, 2); u_r and depth are NaN where none was measured."""
    count = len(raw_px)
    uvr = np.empty((count, 3), np.float64)
    depth = np.empty(count, np.float64)
    height, width = undistorted.shape[:2]
    for i in range(count):
        x = min(max(raw_px[i, 0], 0.0), width - 1.001)
        y = min(max(raw_px[i, 1], 0.0), height - 1.001)
        x0, y0 = int(x), int(y)
        fx, fy = x - x0, y - y0
        for c in range(2):
            top = (1 - fx) * undistorted[y0, x0, c] + fx * undistorted[y0, x0 + 1, c]
            bottom = (1 - fx) * undistorted[y0 + 1, x0, c] + fx * undistorted[y0 + 1, x0 + 1, c]
            uvr[i, c] = (1 - fy) * top + fy * bottom
        depth[i] = _depth_near(depth_m, raw_px[i, 0], raw_px[i, 1])
        uvr[i, 2] = uvr[i, 0] - bf_px_m / depth[i]
    return uvr, depth


@kernel
def sort_into_cells(uvr: FloatArray, columns: int, rows: int) -> tuple[NDArray[np.int64], IntArray]:
    """Return the order (n,) that sorts features by grid cell, and where each cell starts (rows · columns + 1,)."""
    count = len(uvr)
    cell_of = np.empty(count, np.int32)
    cell_start = np.zeros(rows * columns + 1, np.int32)
    for i in range(count):
        column = min(max(int(uvr[i, 0]) // GRID_PX, 0), columns - 1)
        row = min(max(int(uvr[i, 1]) // GRID_PX, 0), rows - 1)
        cell_of[i] = row * columns + column
        cell_start[cell_of[i] + 1] += 1
    for c in range(rows * columns):
        cell_start[c + 1] += cell_start[c]
    filled = cell_start[:-1].copy()
    order = np.empty(count, np.int64)
    for i in range(count):
        order[filled[cell_of[i]]] = i
        filled[cell_of[i]] += 1
    return order, cell_start

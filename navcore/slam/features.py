"""Features of a frame: corners in an image pyramid with an orientation, a binary descriptor and a depth."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from navcore.compiled import kernel
from navcore.geometry import FloatArray
from navcore.slam.apertures import REACH_PX, edge_directions, slides_of
from navcore.slam.contours import REACH_PX as CONTOUR_REACH_PX
from navcore.slam.contours import on_contour
from navcore.slam.corners import find_corners
from navcore.slam.descriptors import describe, disc_weights, pattern_places
from navcore.slam.keyframes import (
    LEVEL_COUNT,
    SCALE_FACTOR,
    ByteArray,
    Features,
    IntArray,
    SlamCamera,
)
from navcore.types import CameraIntrinsics, DepthImage, Frame, ImageRgb

GRID_PX = 16
"""Side of the cells into which features are sorted for window searches."""
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


class FeatureExtractor:
    """Extracts features from frames of one camera; holds tables and scratch images, no memory of earlier frames."""

    def __init__(self, intrinsics: CameraIntrinsics, camera: SlamCamera, count: int) -> None:
        self.camera = camera
        self.look_for(count)
        self._sizes = [
            (round(intrinsics.width_px / SCALE_FACTOR**level), round(intrinsics.height_px / SCALE_FACTOR**level))
            for level in range(LEVEL_COUNT)
        ]
        self._scales: FloatArray = np.array(self._sizes[0]) / np.array(self._sizes)
        self._score = [np.zeros((height, width), np.uint8) for width, height in self._sizes]
        self._sums = [np.zeros((height, width), np.uint16) for width, height in self._sizes]
        self._undistorted = _undistortion_table(intrinsics)
        self._places = [pattern_places(width) for width, _ in self._sizes]
        self._disc = disc_weights()
        self._columns = (camera.width_px + GRID_PX - 1) // GRID_PX
        self._rows = (camera.height_px + GRID_PX - 1) // GRID_PX

    def look_for(self, count: int) -> None:
        """Look for so many features from the next image on."""
        self.count = count
        self._quotas = _level_quotas(count)

    def extract(self, frame: Frame) -> Features:
        """Return the features of a frame."""
        return self.extract_grey(grey_of(frame.colour_rgb), frame.depth_m)

    def extract_grey(self, grey: ByteArray, depth_m: DepthImage) -> Features:
        """Return the features of a grey image (h, w) with its registered depth (h, w)."""
        found = []
        owed = 0
        for level, (image, quota) in enumerate(zip(self._pyramid(grey), self._quotas, strict=True)):
            corners = find_corners(image, self._score[level], FAST_HIGH, FAST_LOW, quota + owed)
            owed += quota - len(corners)
            described = describe(image, self._sums[level], corners, self._places[level], *self._disc)
            found.append((corners, *described, edge_directions(self._sums[level], corners)))
        corners, angles, words, edges = (np.concatenate(parts) for parts in zip(*found, strict=True))
        octave = np.repeat(np.arange(LEVEL_COUNT, dtype=np.int32), [len(part[0]) for part in found])
        # Pixel centres lie at whole numbers; the sizes of the levels are rounded, each side its own way.
        raw_px = (corners[:, :2] + 0.5) * self._scales[octave] - 0.5
        uvr, depth = measure(raw_px, self._undistorted, depth_m, self.camera.bf_px_m)
        nowhere = on_contour(raw_px, CONTOUR_REACH_PX * self._scales[octave, 0], depth_m)
        uvr[nowhere, 2], depth[nowhere] = np.nan, np.nan
        reach_px = REACH_PX * self._scales[octave, 0]
        slides = slides_of(edges, raw_px, reach_px, depth_m, self.camera.bf_px_m)
        order, cell_start = sort_into_cells(uvr, self._columns, self._rows)
        descriptors = words[order].view(np.uint8)
        return Features(
            uvr[order],
            depth[order],
            octave[order],
            angles[order],
            descriptors,
            cell_start,
            self._columns,
            slides=slides[order],
        )

    def _pyramid(self, grey: ByteArray) -> list[ByteArray]:
        levels = [grey]
        for size in self._sizes[1:]:
            levels.append(cv2.resize(levels[-1], size, interpolation=cv2.INTER_LINEAR_EXACT))  # type: ignore[arg-type]
        return levels


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
def _depth_near(depth_m: DepthImage, u: float, v: float, values: FloatArray) -> float:
    """Return the median depth of the 3×3 pixels around a place, NaN where fewer than 3 are known.

    ``values`` (9,) is scratch.
    """
    height, width = depth_m.shape
    x, y = int(np.floor(u + 0.5)), int(np.floor(v + 0.5))
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
    values = np.empty(9, np.float64)
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
        depth[i] = _depth_near(depth_m, raw_px[i, 0], raw_px[i, 1], values)
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

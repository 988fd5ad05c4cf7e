"""The fisheye picture as features see it: unrolled onto a cylinder around the wearer, then treated like any picture.

A fisheye lens turns and squeezes what lies off its axis, and descriptors of patches with it. On a cylinder whose axis
is the picture's vertical, every patch near the horizon looks as if a pinhole camera had been pointed at it: azimuth
becomes u, the tangent of the elevation v. One picture has no seams and loses features only at its rim; virtual pinhole
views lose them at the rim of each. What is found is taken back to pixels of the lens.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from navcore.compiled import kernel
from navcore.geometry import FloatArray
from navcore.slam.features import FeatureExtractor, feature_count_for
from navcore.slam.fisheye import lens_numbers, project, project_all
from navcore.slam.keyframes import LEVEL_COUNT, SCALE_FACTOR, ByteArray, Features, IntArray, SlamCamera
from navcore.slam.matching import MIN_VIEW_COSINE
from navcore.types import CameraIntrinsics, DepthImage, FisheyeCamera

BoolArray = NDArray[np.bool_]

MAX_AZIMUTH_RAD = math.radians(80.0)
"""The cylinder reaches this far to either side, where the lens does."""
MAX_ELEVATION_RAD = math.radians(42.0)
"""The cylinder reaches this far up and down, where the lens does: farther, it stretches patches more than twofold."""
RIM_PX = 16
"""Features nearer than this to what the lens does not show are not used: their patch reaches beyond."""
_AT_ONCE: FloatArray = np.eye(4)
_AT_ONCE.setflags(write=False)


@dataclass(frozen=True, slots=True, eq=False)
class FisheyeFeatures:
    """The n features of one fisheye picture."""

    features: Features
    """On the cylinder; without depth."""
    lens_px: FloatArray
    """(n, 2): the same places in the fisheye picture."""
    unusable: BoolArray
    """(n,): too near to the rim of what the lens shows."""
    fisheye_from_camera: FloatArray
    """(4, 4): from the depth camera, at its own time of capture, to the fisheye camera at its."""

    def __len__(self) -> int:
        return len(self.features)


class FisheyeView:
    """Unrolls the pictures of one fisheye camera and finds features in them; remembers no picture."""

    def __init__(self, camera: FisheyeCamera, reference_feature_count: int) -> None:
        """``reference_feature_count`` is the number of features at 320×240."""
        lens = camera.intrinsics
        self.numbers = lens_numbers(lens)
        self.fisheye_from_camera = np.array(camera.fisheye_from_camera.matrix)
        azimuth, elevation = _extent(camera)
        self.focal_px = 0.5 * (lens.fx_px + lens.fy_px)
        width, height = 2 * round(self.focal_px * azimuth), 2 * round(self.focal_px * math.tan(elevation))
        self.cylinder = SlamCamera(width, height, self.focal_px, self.focal_px, (width - 1) / 2, (height - 1) / 2, 1.0)
        u, v = np.meshgrid(np.arange(width, dtype=np.float64), np.arange(height, dtype=np.float64))
        source = project(lens, self.rays_of(np.stack([u.ravel(), v.ravel()], axis=1))).reshape(height, width, 2)
        self._is_shown = _inside(source, lens.width_px, lens.height_px)
        filled = np.nan_to_num(source, nan=-1.0).astype(np.float32)
        self._table = cv2.convertMaps(filled[:, :, 0], filled[:, :, 1], cv2.CV_16SC2)
        patch = np.ones((2 * RIM_PX + 1, 2 * RIM_PX + 1), np.uint8)
        shown = self._is_shown.astype(np.uint8)
        self._is_usable = cv2.erode(shown, patch, borderType=cv2.BORDER_REPLICATE).astype(np.bool_)
        ideal = CameraIntrinsics(width, height, self.focal_px, self.focal_px, self.cylinder.cx_px, self.cylinder.cy_px)
        count = feature_count_for(width, height, reference_feature_count)
        self._extractor = FeatureExtractor(ideal, self.cylinder, count)
        self._no_depth: DepthImage = np.full((height, width), np.nan, np.float32)

    @property
    def has_hidden_parts(self) -> bool:
        """Whether parts of the cylinder lie outside what the lens shows."""
        return not bool(self._is_shown.all())

    def unrolled(self, grey: ByteArray) -> ByteArray:
        """Return the fisheye picture (h, w) on the cylinder."""
        table = self._table
        return np.asarray(cv2.remap(grey, table[0], table[1], cv2.INTER_LINEAR), dtype=np.uint8)

    def extract(self, grey: ByteArray, moved: FloatArray = _AT_ONCE) -> FisheyeFeatures:
        """Return the features of a fisheye picture (h, w).

        ``moved`` (4, 4) takes points in the depth camera's frame at its time of capture to the same camera's frame at
        the fisheye camera's, where the two are not taken at once.
        """
        features = self._extractor.extract_grey(self.unrolled(grey), self._no_depth)
        uv = features.uv_px
        pixel = np.floor(uv + 0.5).astype(np.int64)
        usable = self._is_usable[
            np.clip(pixel[:, 1], 0, self.cylinder.height_px - 1), np.clip(pixel[:, 0], 0, self.cylinder.width_px - 1)
        ]
        lens_px = project_all(self.numbers, self.rays_of(uv))
        return FisheyeFeatures(features, lens_px, ~usable, self.fisheye_from_camera @ moved)

    def rays_of(self, uv_px: FloatArray) -> FloatArray:
        """Return unit rays (n, 3) in the fisheye camera's frame of places (n, 2) on the cylinder."""
        azimuth = (uv_px[:, 0] - self.cylinder.cx_px) / self.focal_px
        height = (uv_px[:, 1] - self.cylinder.cy_px) / self.focal_px
        rays: FloatArray = np.stack([np.sin(azimuth), height, np.cos(azimuth)], axis=1)
        return np.ascontiguousarray(rays / np.sqrt(1.0 + height * height)[:, None])

    def project_landmarks(
        self, fisheye_from_world: FloatArray, positions: FloatArray, normals: FloatArray, reach: FloatArray
    ) -> tuple[FloatArray, IntArray, FloatArray]:
        """Return u, v (n, 2) on the cylinder, expected octave (n,; −1 where not visible) and view cosine (n,).

        A landmark is visible as for :func:`navcore.slam.matching.project_landmarks`.
        """
        return _project_on_cylinder(
            np.ascontiguousarray(fisheye_from_world),
            np.ascontiguousarray(positions),
            np.ascontiguousarray(normals),
            np.ascontiguousarray(reach),
            self._is_usable,
            self.focal_px,
            self.cylinder.cx_px,
            self.cylinder.cy_px,
        )


def _extent(camera: FisheyeCamera) -> tuple[float, float]:
    """Return how far the cylinder reaches to the sides and up and down, radians: as far as the lens and its picture."""
    lens = camera.intrinsics
    angle = np.radians(np.arange(5.0, 90.0, 0.5))
    reach = []
    for axis in (0, 1):
        shown = np.zeros(len(angle), np.bool_)
        for sign in (1.0, -1.0):
            rays = np.zeros((len(angle), 3))
            rays[:, axis], rays[:, 2] = sign * np.sin(angle), np.cos(angle)
            shown |= _inside(project(lens, rays), lens.width_px, lens.height_px)
        reach.append(float(np.max(angle, where=shown, initial=angle[0])))
    return min(reach[0], MAX_AZIMUTH_RAD), min(reach[1], MAX_ELEVATION_RAD)


def _inside(pixels: FloatArray, width_px: int, height_px: int) -> BoolArray:
    """Tell which pixels (..., 2) lie in the picture; NaN does not."""
    u, v = pixels[..., 0], pixels[..., 1]
    with np.errstate(invalid="ignore"):
        return np.asarray((u >= 0) & (u <= width_px - 1) & (v >= 0) & (v <= height_px - 1))


# --------------------------------------------------------------------------------------------------- kernels
@kernel
def _project_on_cylinder(
    fisheye_from_world: FloatArray,
    positions: FloatArray,
    normals: FloatArray,
    reach: FloatArray,
    usable: BoolArray,
    focal: float,
    cx: float,
    cy: float,
) -> tuple[FloatArray, IntArray, FloatArray]:
    count = len(positions)
    height, width = usable.shape
    uv = np.full((count, 2), np.nan)
    octave = np.full(count, -1, np.int32)
    cosine = np.zeros(count)
    t = fisheye_from_world
    log_scale = np.log(SCALE_FACTOR)
    for i in range(count):
        x, y, z = positions[i, 0], positions[i, 1], positions[i, 2]
        px = t[0, 0] * x + t[0, 1] * y + t[0, 2] * z + t[0, 3]
        py = t[1, 0] * x + t[1, 1] * y + t[1, 2] * z + t[1, 3]
        pz = t[2, 0] * x + t[2, 1] * y + t[2, 2] * z + t[2, 3]
        across = math.sqrt(px * px + pz * pz)
        range_m = math.sqrt(across * across + py * py)
        if across < 0.05:
            continue
        u = focal * math.atan2(px, pz) + cx
        v = focal * py / across + cy
        column, row = int(np.floor(u + 0.5)), int(np.floor(v + 0.5))
        if column < 0 or column >= width or row < 0 or row >= height or not usable[row, column]:
            continue
        level = math.log(reach[i] * focal / range_m) / log_scale
        if level < -1.5 or level > LEVEL_COUNT + 0.5:
            continue
        # The direction from the camera to the landmark, in the world, against its mean viewing direction.
        view = 0.0
        for c in range(3):
            view += (t[0, c] * px + t[1, c] * py + t[2, c] * pz) * normals[i, c]
        view /= range_m
        if view < MIN_VIEW_COSINE:
            continue
        uv[i, 0] = u
        uv[i, 1] = v
        cosine[i] = view
        octave[i] = min(max(int(np.floor(level + 0.5)), 0), LEVEL_COUNT - 1)
    return uv, octave, cosine

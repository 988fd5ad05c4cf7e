"""What one frame contributes to the map: the camera it was taken with, its features, and the key frame it may become.

Pixels are undistorted: the distortion of the colour image is removed once, when the features are extracted. A depth z
at a feature becomes a virtual right coordinate u_r = u − bf / z (Mur-Artal and Tardós 2017, section III-A), so that
depth enters pose and bundle adjustment as a third image coordinate.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from navcore.geometry import FloatArray
from navcore.types import CameraIntrinsics

IntArray = NDArray[np.int32]
ByteArray = NDArray[np.uint8]

SCALE_FACTOR = 1.2
"""Ratio between neighbouring levels of the image pyramid."""
LEVEL_COUNT = 8
"""Levels of the image pyramid."""
DESCRIPTOR_BYTES = 32
"""A binary descriptor has 256 bits."""
INV_SIGMA2: FloatArray = np.power(SCALE_FACTOR, -2.0 * np.arange(LEVEL_COUNT, dtype=np.float64))
"""1/σ² (LEVEL_COUNT,) of an image coordinate found at each pyramid level, 1/px²; σ is one pixel of that level."""
INV_SIGMA2.setflags(write=False)
MAX_READOUT_S = 0.05
"""No camera that takes 20 or more pictures a second needs longer from its first row to its last."""
NO_LANDMARK = -1
"""Stands in ``landmark_of`` where a feature shows no landmark."""


@dataclass(frozen=True, slots=True)
class SlamCamera:
    """The ideal pinhole (after undistortion) that all of the map's geometry uses."""

    width_px: int
    height_px: int
    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float
    bf_px_m: float
    """Focal length times the virtual baseline: weighs depth against image coordinates."""

    @staticmethod
    def of(intrinsics: CameraIntrinsics, bf_px_m: float) -> SlamCamera:
        """Return the ideal pinhole of a real camera."""
        return SlamCamera(
            intrinsics.width_px,
            intrinsics.height_px,
            intrinsics.fx_px,
            intrinsics.fy_px,
            intrinsics.cx_px,
            intrinsics.cy_px,
            bf_px_m,
        )

    @property
    def matrix(self) -> FloatArray:
        """Camera matrix (3, 3), pixels."""
        return np.array([[self.fx_px, 0.0, self.cx_px], [0.0, self.fy_px, self.cy_px], [0.0, 0.0, 1.0]])


@dataclass(frozen=True, slots=True, eq=False)
class Features:
    """The n features of one frame, sorted into a grid of cells for window searches. All arrays are C-contiguous."""

    uvr_px: FloatArray
    """(n, 3): u, v undistorted, and the virtual right coordinate u_r, NaN where there is no depth."""
    depth_m: FloatArray
    """(n,): depth along the optical axis, NaN where there is none."""
    octave: IntArray
    """(n,): level of the pyramid, 0 the finest."""
    angle_rad: FloatArray
    """(n,): orientation in the image."""
    descriptors: ByteArray
    """(n, 32): binary descriptors."""
    cell_start: IntArray
    """(rows · columns + 1,): features of cell c are ``cell_start[c]`` up to ``cell_start[c + 1]``; cells of CELL_PX."""
    cell_columns: int
    """Columns of the grid."""
    rolled_uvr_px: FloatArray | None = None
    """(n, 3): u, v, u_r as they were seen, row by row, before the camera's movement during the readout was taken out;
    None where it was not, or is not known any more."""
    slides: FloatArray | None = None
    """(n, 3): unit direction in u, v, u_r in which each feature may lie elsewhere, 0 where it may not (see
    :mod:`navcore.slam.apertures`); None where that is not known."""

    def __len__(self) -> int:
        return len(self.octave)

    @property
    def uv_px(self) -> FloatArray:
        """(n, 2): undistorted pixels."""
        return self.uvr_px[:, :2]

    @property
    def inv_sigma2(self) -> FloatArray:
        """(n,): 1/σ² of each feature's image coordinates."""
        return INV_SIGMA2[self.octave]

    @property
    def is_edge(self) -> NDArray[np.bool_]:
        """(n,): which may lie elsewhere along an edge; none where that is not known."""
        return np.zeros(len(self), np.bool_) if self.slides is None else (self.slides != 0.0).any(axis=1)

    def slides_at(self, feature_index: IntArray) -> FloatArray | None:
        """Return the slides (m, 3) of some features (m,); None where they are not known."""
        return None if self.slides is None else self.slides[feature_index]

    def count_distinct(self, feature_index: IntArray) -> int:
        """Return how many of some features (m,) are no edges."""
        slides = self.slides_at(feature_index)
        return len(feature_index) if slides is None else int(np.count_nonzero((slides == 0.0).all(axis=1)))

    def points_in_camera(self, camera: SlamCamera) -> FloatArray:
        """Return the points (n, 3) in the camera's frame, metres; NaN rows where there is no depth."""
        x = (self.uvr_px[:, 0] - camera.cx_px) / camera.fx_px * self.depth_m
        y = (self.uvr_px[:, 1] - camera.cy_px) / camera.fy_px * self.depth_m
        return np.stack([x, y, self.depth_m], axis=1)


@dataclass(frozen=True, slots=True, eq=False)
class KeyFrame:
    """A frame that the map keeps. Its pose and its landmarks change and live in the map's arrays."""

    index: int
    """Position in the map's arrays; never reused."""
    stamp_s: float
    features: Features
    session: int = 0
    """The recording that it comes from; stamps are only comparable within one."""
    velocity: FloatArray | None = None
    """(6,): twist per second while the picture was taken, see :mod:`navcore.slam.rolling_shutter`; None if unknown."""

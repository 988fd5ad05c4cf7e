"""The head-worn depth camera: how its colour and depth differ from the truth.

The depth camera is modelled on the Intel RealSense D435 (data sheet of the D400 series, and A. Grunnet-Jepsen et al.,
"Tuning depth cameras for best performance", Intel): two imagers 50 mm apart, depth = f B / disparity, disparity known
to a few hundredths of a pixel and reported in steps of 1/32 px, so that the error grows with the distance squared.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage, special

from device_agent.simulation.renderer import View
from device_agent.simulation.sensor_noise import spoil_colour, spoil_depth
from device_agent.simulation.shading import F32
from navcore.errors import InputError
from navcore.types import CameraIntrinsics, Frame, ImageRgb

HFOV_DEG = 69.0
"""Horizontal field of view of the D435's colour camera, to which depth is registered (D400 data sheet)."""
POOL_MARGIN_PX = 128
"""Noise is drawn once, for a picture larger by this on each axis; every frame gets another piece of it."""


@dataclass(frozen=True, slots=True)
class DepthNoise:
    """Parameters of the depth error model."""

    focal_baseline_px_m: float = 21.2
    """f B of the imagers: 424 px (848 px wide, 90° horizontal field of view) × 0.050 m (D400 data sheet)."""
    disparity_sigma_px: float = 0.035
    """Sub-pixel error; gives σ_z ≈ 0.00165 z². Intel's tuning guide calls below 0.1 px well tuned."""
    disparity_step_px: float = 1.0 / 32.0
    """Disparity is reported in steps of 1/32 px (D400, "disparity shift" and sub-pixel documentation)."""
    correlated_share: float = 0.6
    """Share of the error's standard deviation that neighbours have in common (matching windows overlap)."""
    min_m: float = 0.3
    """Nearest distance measured well (D435: about 0.28 m at 848 × 480)."""
    max_m: float = 8.0
    """Farthest distance given out; D435 is specified to about 3 m, and delivers, with large errors, up to 10 m."""
    grazing_cosine: float = 0.20
    """Below this cosine of incidence more and more is missing."""
    shiny_missing: float = 0.45
    """Share of a dark or glossy surface that gives no depth."""
    lit_missing: float = 0.5
    """Share of windows and lamps that gives no depth."""
    random_missing: float = 0.003
    """Share of all pixels that is missing anyhow."""
    edge_missing: float = 0.6
    """Share of pixels on a depth edge that is missing; the others lie between front and back."""


@dataclass(frozen=True, slots=True)
class ColourNoise:
    """Parameters of the colour error model (8-bit grey levels)."""

    read_sigma: float = 1.2
    shot_sigma: float = 2.0
    """Standard deviation at full brightness; it grows with the square root of the light (Poisson)."""
    optics_sigma_px: float = 0.45
    """Blur of the lens."""
    exposure_sigma: float = 0.015
    """Flicker of the automatic exposure from frame to frame, relative."""
    exposure_s: float = 0.008
    """Time of exposure: what moves meanwhile is smeared."""


USUAL_DEPTH_NOISE = DepthNoise()
USUAL_COLOUR_NOISE = ColourNoise()
NO_DEPTH_NOISE = DepthNoise(
    disparity_sigma_px=0.0,
    disparity_step_px=1e-6,
    grazing_cosine=0.0,
    shiny_missing=0.0,
    lit_missing=0.0,
    random_missing=0.0,
    edge_missing=0.0,
)
NO_COLOUR_NOISE = ColourNoise(0.0, 0.0, 0.0, 0.0, 0.0)


def head_camera(width_px: int = 320, height_px: int = 240, hfov_deg: float = HFOV_DEG) -> CameraIntrinsics:
    """Return the intrinsics of the head-worn camera. Raises InputError for an odd size or field of view."""
    if width_px < 16 or height_px < 12 or not 10.0 <= hfov_deg <= 150.0:
        raise InputError(
            f"A camera of {width_px}×{height_px} pixels and {hfov_deg:g}° cannot be simulated: use 640×480 or 320×240."
        )
    focal_px = width_px / 2 / math.tan(math.radians(hfov_deg) / 2)
    return CameraIntrinsics(width_px, height_px, focal_px, focal_px, (width_px - 1) / 2, (height_px - 1) / 2)


class CameraModel:
    """Turns perfect views into frames as a real camera gives them. The same seed and number give the same frame."""

    def __init__(
        self,
        camera: CameraIntrinsics,
        seed: int,
        depth_noise: DepthNoise = USUAL_DEPTH_NOISE,
        colour_noise: ColourNoise = USUAL_COLOUR_NOISE,
    ) -> None:
        self.camera = camera
        self._seed = seed
        self._depth_noise = depth_noise
        self.colour_noise = colour_noise
        rng = np.random.default_rng([seed, 2])
        shape = (camera.height_px + POOL_MARGIN_PX, camera.width_px + POOL_MARGIN_PX)
        # Matching windows and blobs cover the same angle at any resolution.
        scale = camera.width_px / 320
        self._fine = rng.standard_normal(shape, np.float32)
        self._coarse = _correlated(rng, shape, 1.5 * scale)
        self._blobs = special.ndtr(_correlated(rng, shape, 2.0 * scale)).astype(np.float32)

    def capture(
        self,
        view: View,
        stamp_s: float,
        number: int,
        yaw_rate_rad_s: float = 0.0,
        colour_noise: ColourNoise | None = None,
    ) -> Frame:
        """Return the frame with this number; while the head turns, the exposure smears it.

        ``colour_noise`` takes the place of the model's own, where light is short.
        """
        noise = self.colour_noise if colour_noise is None else colour_noise
        motion_px = (yaw_rate_rad_s * noise.exposure_s * self.camera.fx_px, 0.0)
        rng = np.random.default_rng([self._seed, 3, number])
        return Frame(stamp_s, self._colour(view, rng, motion_px, noise), self._depth(view, rng))

    def _depth(self, view: View, rng: np.random.Generator) -> F32:
        noise = self._depth_noise
        out = np.empty_like(view.depth_m)
        spoil_depth(
            view.depth_m,
            view.incidence,
            view.material,
            self._crop(self._fine, rng),
            self._crop(self._coarse, rng),
            self._crop(self._blobs, rng),
            self.camera.fx_px,
            noise.focal_baseline_px_m,
            noise.disparity_sigma_px,
            noise.disparity_step_px,
            noise.correlated_share,
            noise.min_m,
            noise.max_m,
            noise.grazing_cosine,
            noise.shiny_missing,
            noise.lit_missing,
            noise.random_missing,
            noise.edge_missing,
            out,
        )
        return out

    def _colour(
        self, view: View, rng: np.random.Generator, motion_px: tuple[float, float], noise: ColourNoise
    ) -> ImageRgb:
        image: ImageRgb = view.colour_rgb
        if noise.optics_sigma_px > 0.0:
            image = cv2.GaussianBlur(image, (3, 3), noise.optics_sigma_px).astype(np.uint8, copy=False)
        if math.hypot(*motion_px) > 0.7:
            image = cv2.filter2D(image, -1, line_kernel(motion_px)).astype(np.uint8, copy=False)
        gain = 1.0 + noise.exposure_sigma * float(rng.standard_normal())
        out = np.empty_like(view.colour_rgb)
        grains = [self._crop(self._fine, rng) for _ in range(3)]
        spoil_colour(
            np.ascontiguousarray(image), grains[0], grains[1], grains[2], gain, noise.read_sigma, noise.shot_sigma, out
        )
        return out

    def _crop(self, pool: F32, rng: np.random.Generator) -> F32:
        return crop_at_random(pool, (self.camera.height_px, self.camera.width_px), rng)


def crop_at_random(pool: F32, shape: tuple[int, int], rng: np.random.Generator) -> F32:
    """Cut a picture-sized piece (h, w) out of a pool of noise: much cheaper than drawing new noise for each frame."""
    top, left = (int(k) for k in rng.integers(POOL_MARGIN_PX, size=2))
    return np.ascontiguousarray(pool[top : top + shape[0], left : left + shape[1]])


def _correlated(rng: np.random.Generator, shape: tuple[int, int], sigma_px: float) -> F32:
    field = ndimage.gaussian_filter(rng.standard_normal(shape, np.float32), sigma_px, mode="wrap")
    normal: F32 = (field / field.std()).astype(np.float32)
    return normal


def line_kernel(motion_px: tuple[float, float]) -> NDArray[np.float32]:
    """Return a square kernel (odd, odd) that smears a picture along a line of so many pixels (x, y)."""
    half = min(15, math.ceil(max(abs(motion_px[0]), abs(motion_px[1])) / 2))
    mask = np.zeros((2 * half + 1, 2 * half + 1), np.float32)
    for share in np.linspace(-0.5, 0.5, 8 * half + 9):
        column, row = (min(half, max(-half, round(share * m))) for m in motion_px)
        mask[half + row, half + column] += 1.0
    line: NDArray[np.float32] = mask / mask.sum()
    return line

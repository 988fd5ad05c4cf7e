"""The second, wide camera on the glasses: where it sits, what its lens shows, and how its pictures are spoilt.

The lens is modelled on the tracking cameras of the Intel RealSense T265 (Kannala–Brandt coefficients as a unit reports
them, 163° field of view), binned to fewer pixels: grey, global shutter, darker towards the edge.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import cv2
import numpy as np

from device_agent.simulation.renderer import Placement, Renderer
from device_agent.simulation.sensors import (
    POOL_MARGIN_PX,
    USUAL_COLOUR_NOISE,
    ColourNoise,
    crop_at_random,
    line_kernel,
)
from device_agent.simulation.shading import F32
from navcore.errors import InputError
from navcore.geometry import Transform, rotation_from_rotvec
from navcore.slam.fisheye import radius_of, unproject
from navcore.types import FisheyeCamera, FisheyeImage, FisheyeIntrinsics, ImageGrey

LENS_COEFFICIENTS = (-0.0065, 0.0486, -0.0459, 0.0083)
"""k1 to k4 of a T265's left lens."""
HORIZONTAL_HALF_DEG = 80.0
"""Angle off the axis that the left and right edges of the picture show."""
MAX_ANGLE_DEG = 86.0
"""Half the lens's field of view: beyond, the corners of the picture are black."""
MOUNT_RIGHT_M, MOUNT_UP_M = 0.08, 0.02
"""Place of the fisheye camera, seen from the depth camera: on the other side of the glasses' bridge."""
TILT_UP_DEG = 8.0
"""It looks less far down than the depth camera: towards walls rather than the floor."""
EDGE_LIGHT = 0.6
"""Light at the edge of the lens, over that in its middle."""


def head_fisheye(width_px: int = 400, height_px: int = 320) -> FisheyeCamera:
    """Return the fisheye camera of the glasses. Raises InputError for an odd size."""
    if width_px < 64 or height_px < 48:
        raise InputError(f"A fisheye camera of {width_px}×{height_px} pixels cannot be simulated: use 400×320.")
    half_rad = math.radians(HORIZONTAL_HALF_DEG)
    radius = radius_of(np.array([1.0, 1.0, 0.0, 0.0, *LENS_COEFFICIENTS, half_rad]), half_rad)
    focal_px = (width_px / 2) / radius
    lens = FisheyeIntrinsics(
        width_px,
        height_px,
        focal_px,
        focal_px,
        (width_px - 1) / 2,
        (height_px - 1) / 2,
        *LENS_COEFFICIENTS,
        math.radians(MAX_ANGLE_DEG),
    )
    camera_from_fisheye = Transform.from_rotation_translation(
        rotation_from_rotvec(np.array([math.radians(TILT_UP_DEG), 0.0, 0.0])),
        np.array([MOUNT_RIGHT_M, -MOUNT_UP_M, 0.0]),
    )
    return FisheyeCamera(lens, camera_from_fisheye.inverse())


class FisheyeModel:
    """Takes the pictures of one fisheye camera. The same seed and number give the same picture."""

    def __init__(self, camera: FisheyeCamera, seed: int, noise: ColourNoise = USUAL_COLOUR_NOISE) -> None:
        self.camera = camera
        self._seed = seed
        self._noise = noise
        lens = camera.intrinsics
        self._shape = (lens.height_px, lens.width_px)
        v, u = np.mgrid[0 : lens.height_px, 0 : lens.width_px]
        rays = unproject(lens, np.stack([u, v], axis=2).reshape(-1, 2).astype(np.float64))
        # The lens may show more than a right angle off its axis; NaN lies outside its field of view.
        self._shown = np.flatnonzero(np.isfinite(rays[:, 2]))
        self._rays: F32 = np.ascontiguousarray(rays[self._shown], np.float32)
        share = np.arccos(np.clip(self._rays[:, 2], -1.0, 1.0)) / lens.max_angle_rad
        self._light: F32 = (1.0 - (1.0 - EDGE_LIGHT) * share**2).astype(np.float32)
        pool = (lens.height_px + POOL_MARGIN_PX, lens.width_px + POOL_MARGIN_PX)
        self._grain: F32 = np.random.default_rng([seed, 11]).standard_normal(pool, np.float32)

    def capture(
        self,
        renderer: Renderer,
        world_from_camera: Transform,
        stamp_s: float,
        number: int,
        placements: Sequence[Placement | None] = (),
        yaw_rate_rad_s: float = 0.0,
    ) -> FisheyeImage:
        """Take the picture with this number; ``world_from_camera`` is the pose of the depth camera beside it."""
        lens = self.camera.intrinsics
        world_from_fisheye = world_from_camera @ self.camera.fisheye_from_camera.inverse()
        seen, _, _ = renderer.look(self._rays, 1.0 / lens.fx_px, world_from_fisheye, placements)
        grey = cv2.cvtColor(seen.colour.reshape(-1, 1, 3), cv2.COLOR_RGB2GRAY)[:, 0].astype(np.float32)
        picture = np.zeros(self._shape, np.float32)
        picture.ravel()[self._shown] = grey * self._light
        return FisheyeImage(stamp_s, self._spoilt(picture, number, yaw_rate_rad_s * lens.fx_px), self.camera)

    def _spoilt(self, picture: F32, number: int, speed_px_s: float) -> ImageGrey:
        """Return the picture as the sensor reads it: blurred by lens and motion, with noise and a gain of its own."""
        noise = self._noise
        rng = np.random.default_rng([self._seed, 12, number])
        if noise.optics_sigma_px > 0.0:
            picture = cv2.GaussianBlur(picture, (3, 3), noise.optics_sigma_px).astype(np.float32, copy=False)
        smear_px = speed_px_s * noise.exposure_s
        if abs(smear_px) > 0.7:
            picture = cv2.filter2D(picture, -1, line_kernel((smear_px, 0.0))).astype(np.float32, copy=False)
        picture = picture * np.float32(1.0 + noise.exposure_sigma * float(rng.standard_normal()))
        sigma = np.float32(noise.read_sigma) + np.float32(noise.shot_sigma / 16.0) * np.sqrt(picture)
        picture = picture + sigma * crop_at_random(self._grain, self._shape, rng)
        spoilt: ImageGrey = np.clip(picture + np.float32(0.5), 0.0, 255.0).astype(np.uint8)
        return spoilt

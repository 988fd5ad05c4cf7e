"""The two see-through displays as the eyes see them, and what can be read on them. Pure.

Each eye sees a virtual image at :attr:`DisplayGeometry.image_distance_m`; the two images cover each other there, so
that what is drawn at that distance has no disparity, what is nearer a positive, and what is farther a negative one.
"""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass, field

import numpy as np

from navcore.geometry import FloatArray, Transform, heading_of_camera


class Eye(enum.Enum):
    """One of the two."""

    LEFT = -1.0
    RIGHT = 1.0


@dataclass(frozen=True, slots=True)
class DisplayGeometry:
    """Both displays; one lies before each eye, and both look where the camera looks, about 15° down."""

    width_px: int = 640
    height_px: int = 360
    field_deg: float = 45.0
    """Horizontal field of view of each display."""
    pupil_distance_m: float = 0.063
    """Distance between the pupils; the mean of adults (N. Dodgson, "Variation and extrema of human interpupillary
    distance", Proc. SPIE 5291, 2004)."""
    image_distance_m: float = 2.0
    """Distance of the virtual image, at which the eyes focus."""

    @property
    def focal_px(self) -> float:
        """Pixels per unit of the tangent of the angle from the axis."""
        return self.width_px / 2.0 / math.tan(math.radians(self.field_deg) / 2.0)

    def project(self, points_m: FloatArray, eye: Eye) -> FloatArray:
        """Return the pixels (n, 2), u to the right and v down, at which an eye sees points.

        Args:
            points_m: points (n, 3) before the middle of the eyes: x right, y down, z forward and greater than 0.
            eye: which one.
        """
        half_m = eye.value * self.pupil_distance_m / 2.0
        depth_m = points_m[:, 2]
        u_px = (points_m[:, 0] - half_m) / depth_m + half_m / self.image_distance_m
        pixels = np.stack([u_px, points_m[:, 1] / depth_m], axis=1) * self.focal_px
        in_image: FloatArray = pixels + np.array([(self.width_px - 1) / 2.0, (self.height_px - 1) / 2.0])
        return in_image

    def disparity_px(self, depth_m: float) -> float:
        """Return by how much farther left the right eye sees a point at a depth than the left eye does."""
        return self.focal_px * self.pupil_distance_m * (1.0 / depth_m - 1.0 / self.image_distance_m)

    def at_image(self, u_px: FloatArray, v_px: FloatArray) -> FloatArray:
        """Return points (n, 3) on the virtual image, pixels (n,) right of and below its middle."""
        scale = self.image_distance_m / self.focal_px
        return np.stack([u_px * scale, v_px * scale, np.full(len(u_px), self.image_distance_m)], axis=1)


@dataclass(frozen=True, slots=True, eq=False)
class Head:
    """How the displays are held: what is drawn into the world needs to know where the floor is."""

    eye_m: float
    """Height of the eyes above the floor."""
    display_from_level: FloatArray = field(repr=False)
    """Rotation (3, 3) from forward, left, up to right, down, forward of the displays."""

    @staticmethod
    def level(eye_m: float = 1.6, pitch_down_rad: float = math.radians(15.0)) -> Head:
        """Return a head held straight; the displays look down by the given angle."""
        s, c = math.sin(pitch_down_rad), math.cos(pitch_down_rad)
        return Head(eye_m, np.array([[0.0, -1.0, 0.0], [-s, 0.0, -c], [c, 0.0, -s]]))

    @staticmethod
    def at(world_from_camera: Transform, eye_m: float) -> Head:
        """Return the head that holds the camera in a pose; displays and camera look the same way."""
        heading = float(heading_of_camera(world_from_camera))
        s, c = math.sin(heading), math.cos(heading)
        level_from_world = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
        return Head(eye_m, (level_from_world @ world_from_camera.rotation).T)

    def seen(self, points_m: FloatArray) -> FloatArray:
        """Return points (n, 3), metres ahead, to the left, above the floor, in the displays' frame (n, 3)."""
        seen: FloatArray = (points_m - (0.0, 0.0, self.eye_m)) @ self.display_from_level.T
        return seen


Rgb = tuple[int, int, int]
MID_GREY = (128, 128, 128)
"""The world behind, when it is neither dark nor bright."""


class Ink(enum.Enum):
    """The colours of the overlay. Each is bright: light can only be added to the world."""

    WAY = (110, 255, 150)
    """Where to walk or to turn."""
    GOAL = (120, 235, 255)
    """What lies on the way."""
    NEAR = (255, 205, 60)
    """What is in the way."""
    TEXT = (255, 255, 255)
    SIGN = (170, 0, 0)
    """The ground of the sign *Stop*: its shape and its text are white, so that nothing hangs on this colour."""


def luminance(rgb: Rgb) -> float:
    """Return the relative luminance of an sRGB colour, 0 to 1 (WCAG 2.2)."""
    linear = [c / 12.92 if (c := value / 255.0) <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for value in rgb]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def contrast(ink: Rgb, beside: Rgb, world: Rgb = (0, 0, 0)) -> float:
    """Return the contrast (WCAG 2.2), 1 to 21, of two colours of the overlay before the world behind it.

    The display adds its light to the world's, which the glasses are taken to let through as it is. Their white is taken
    to be as bright as a white wall; displays that are darker than that need shades before them.
    """
    lights = [luminance(each) + luminance(world) + 0.05 for each in (ink, beside)]
    return max(lights) / min(lights)

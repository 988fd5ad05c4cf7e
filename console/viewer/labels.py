"""Which labels are shown, so that none covers another: the more important, and then the nearer, ones stay."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from navcore.geometry import FloatArray, rotation_from_quat_xyzw

_CHARACTER_PX, _LINE_PX, _MARGIN_PX = 8.5, 18.0, 4.0


@dataclass(frozen=True, slots=True, eq=False)
class Lens:
    """A camera and its window: pose in the OpenCV convention, vertical field of view, window in pixels."""

    position_m: FloatArray
    quat_wxyz: FloatArray
    fov_rad: float
    width_px: float
    height_px: float


@dataclass(frozen=True, slots=True)
class LabelSpot:
    """A label that would like to be shown."""

    key: str
    text: str
    place_m: tuple[float, float, float]
    importance: int
    """Higher ones are placed first."""
    scale: float = 1.0
    raised: bool = False
    """The text stands on its place; otherwise it is centred there."""


def readable(spots: Sequence[LabelSpot], lens: Lens) -> set[str]:
    """Return the keys of the labels to show: in front of the camera, and not over a more important one."""
    if not spots:
        return set()
    pixels, depth_m = project(np.array([spot.place_m for spot in spots], dtype=np.float64), lens)
    order = sorted(range(len(spots)), key=lambda i: (-spots[i].importance, depth_m[i], spots[i].key))
    taken, shown = np.zeros((len(spots), 4)), set[str]()
    for i in order:
        if depth_m[i] <= 0.05:
            continue
        box = _box(spots[i], pixels[i])
        others = taken[: len(shown)]
        apart = (
            (others[:, 2] < box[0]) | (others[:, 0] > box[2]) | (others[:, 3] < box[1]) | (others[:, 1] > box[3])
        )  # fmt: skip
        if apart.all():
            taken[len(shown)] = box
            shown.add(spots[i].key)
    return shown


def project(places_m: FloatArray, lens: Lens) -> tuple[FloatArray, FloatArray]:
    """Return pixels (n, 2) of places (n, 3) in the window, and their depths (n,); depth ≤ 0 lies behind the camera."""
    w, x, y, z = (float(part) for part in lens.quat_wxyz)
    world_from_camera = rotation_from_quat_xyzw(np.array([x, y, z, w]))
    seen = (places_m - lens.position_m) @ world_from_camera
    depth_m = seen[:, 2]
    focal_px = lens.height_px / 2 / np.tan(lens.fov_rad / 2)
    divisor = np.where(np.abs(depth_m) < 1e-6, 1e-6, depth_m)
    pixels = seen[:, :2] / divisor[:, None] * focal_px + np.array([lens.width_px, lens.height_px]) / 2
    return pixels, depth_m


def _box(spot: LabelSpot, pixel: NDArray[np.float64]) -> NDArray[np.float64]:
    half_px = spot.scale * _CHARACTER_PX * max(len(spot.text), 2) / 2 + _MARGIN_PX
    height_px = spot.scale * _LINE_PX + _MARGIN_PX
    top = pixel[1] - height_px if spot.raised else pixel[1] - height_px / 2
    return np.array([pixel[0] - half_px, top, pixel[0] + half_px, top + height_px])

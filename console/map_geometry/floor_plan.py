"""The floor from above as a picture: what is floor, what stands on it, walls, the road, places with their names.

The picture's edges run along x and y, y upwards; how it lies in the map is told by
:attr:`FloorPlan.world_file`, the six lines that geographic programs read beside a picture.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from console.map_geometry.occupancy import Occupancy
from console.map_geometry.plan_layout import (
    PALETTES,
    PLACE_PX,
    ROAD_PX,
    TEXT_PX,
    TEXT_WEIGHT,
    WALL_PX,
    Frame,
    Palette,
    PlacedName,
    PlanPlace,
    Rgb,
    Theme,
    framed,
    laid_in,
    placed_names,
    scale_bar,
    typeface,
)
from navcore.geometry import FloatArray

Image = NDArray[np.uint8]
Point = tuple[float, float]
_BITS = 4


@dataclass(frozen=True, slots=True)
class FloorPlan:
    """A picture of the floor, and where it lies."""

    png: bytes
    metres_per_pixel: float
    x_min_m: float
    """Left edge of the picture, in the map."""
    y_max_m: float
    """Upper edge."""
    width_px: int
    height_px: int

    @property
    def world_file(self) -> str:
        """What lies beside the picture as ``floor-plan.pgw``: a pixel's size and turn, the upper left one's middle."""
        half_m = self.metres_per_pixel / 2
        values = (self.metres_per_pixel, 0.0, 0.0, -self.metres_per_pixel, self.x_min_m + half_m, self.y_max_m - half_m)
        return "".join(f"{value:.6f}\n" for value in values)


def floor_plan(
    occupancy: Occupancy,
    walls_m: FloatArray,
    roads_m: Sequence[FloatArray],
    places: Sequence[PlanPlace],
    theme: Theme = "light",
) -> FloorPlan:
    """Draw the plan of a floor.

    Args:
        occupancy: what is floor, and what stands on it.
        walls_m: segments (m, 2, 2).
        roads_m: polylines (k, 2).
        places: with their names; the more important ones first.
        theme: for bright or for dark pages.
    """
    frame = framed(occupancy, roads_m, places)
    palette = PALETTES[theme]
    image = np.full((frame.height_px, frame.width_px, 3), palette.ground, np.uint8)
    image[laid_in(occupancy.is_known, occupancy, frame)] = palette.floor
    image[laid_in(occupancy.is_occupied, occupancy, frame)] = palette.standing
    for wall in walls_m:
        _line(image, frame, wall, palette.wall, WALL_PX)
    for road in roads_m:
        _line(image, frame, road, palette.road, ROAD_PX)
    lines = (image == palette.road).all(axis=2) | (image == palette.wall).all(axis=2)
    _draw_places(image, placed_names(frame, places, lines), palette)
    _draw_scale(image, frame, palette)
    encoded, png = cv2.imencode(".png", cv2.cvtColor(image, cv2.COLOR_RGB2BGR))
    assert encoded
    return FloorPlan(
        png.tobytes(), frame.metres_per_pixel, frame.x_min_m, frame.y_max_m, frame.width_px, frame.height_px
    )  # fmt: skip


def _line(image: Image, frame: Frame, points_m: FloatArray, colour: Rgb, width_px: int) -> None:
    at = np.round(frame.pixels(points_m[:, :2]) * (1 << _BITS)).astype(np.int32)
    cv2.polylines(image, [at], False, colour, width_px, cv2.LINE_AA, _BITS)


def _draw_places(image: Image, names: Sequence[PlacedName], palette: Palette) -> None:
    for name in names:
        cv2.line(image, _pixel((name.x_px, name.y_px)), _pixel(name.leader_px), palette.place, 1, cv2.LINE_AA)
    for name in names:
        at = _pixel((name.x_px, name.y_px))
        cv2.circle(image, at, PLACE_PX + 1, palette.plate, cv2.FILLED, cv2.LINE_AA)
        cv2.circle(image, at, PLACE_PX, palette.place, cv2.FILLED, cv2.LINE_AA)
        if name.box is not None:
            left, top, right, bottom = name.box
            cv2.rectangle(image, _pixel((left, top)), _pixel((right, bottom)), palette.plate, cv2.FILLED)
            _draw_text(image, name.text, name.text_at_px, palette.text)


def _draw_scale(image: Image, frame: Frame, palette: Palette) -> None:
    metres, length_px = scale_bar(frame)
    x_px, y_px = 16, frame.height_px - 14
    for begin, end in (((0, 0), (length_px, 0)), ((0, -6), (0, 0)), ((length_px, -6), (length_px, 0))):
        cv2.line(image, (x_px + begin[0], y_px + begin[1]), (x_px + end[0], y_px + end[1]), palette.text, 2)
    _draw_text(image, f"{metres} m", (x_px + length_px + 10, y_px), palette.text)


def _draw_text(image: Image, text: str, at_px: Point, colour: Rgb) -> None:
    cv2.putText(image, text, _pixel(at_px), colour, typeface(), TEXT_PX, TEXT_WEIGHT)


def _pixel(point: Point) -> tuple[int, int]:
    return round(point[0]), round(point[1])

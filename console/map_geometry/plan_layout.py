"""How the plan of a floor is laid out, whatever draws it: colours, what part of the map it shows, where names go."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from console.map_geometry.label_places import Box, Label, label_boxes
from console.map_geometry.occupancy import Occupancy
from navcore.geometry import FloatArray

Theme = Literal["light", "dark"]
Rgb = tuple[int, int, int]
Mask = NDArray[np.bool_]

METRES_PER_PIXEL = 0.02
MAX_SIDE_PX = 4000
"""A larger floor is drawn at fewer pixels to the metre."""
WALL_PX, ROAD_PX, PLACE_PX = 4, 2, 5
"""Widths of lines, and the radius of a place."""
TEXT_PX, TEXT_WEIGHT = 17, 500
PADDING_PX = 4
FOOT_PX = 44
"""Below the floor, for the scale bar."""
_MIN_SIDE_M = 6.0
_MARGIN_M = 0.6
_BAR_M = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000)


@dataclass(frozen=True, slots=True)
class Palette:
    """Colours of a theme (as in static/style.css), told apart by their lightness."""

    ground: Rgb
    floor: Rgb
    standing: Rgb
    wall: Rgb
    road: Rgb
    place: Rgb
    text: Rgb
    plate: Rgb


PALETTES: dict[Theme, Palette] = {
    "light": Palette(
        (243, 245, 248), (255, 255, 255), (176, 186, 198), (45, 55, 68), (0, 95, 158), (168, 50, 10), (19, 26, 34),
        (255, 255, 255),
    ),
    "dark": Palette(
        (14, 19, 24), (40, 50, 61), (98, 112, 128), (214, 224, 234), (98, 184, 245), (255, 148, 104), (234, 240, 246),
        (23, 30, 38),
    ),
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class PlanPlace:
    """A place on the plan; the first ones choose first where their names go."""

    name: str
    x_m: float
    y_m: float


@dataclass(frozen=True, slots=True)
class Frame:
    """What part of the map a picture shows."""

    x_min_m: float
    y_max_m: float
    metres_per_pixel: float
    width_px: int
    height_px: int

    def pixels(self, points_m: FloatArray) -> FloatArray:
        """Return where points (…, 2) lie in the picture, pixels from its upper left corner."""
        x_px = (points_m[..., 0] - self.x_min_m) / self.metres_per_pixel
        y_px = (self.y_max_m - points_m[..., 1]) / self.metres_per_pixel
        return np.stack([x_px, y_px], axis=-1)


def framed(occupancy: Occupancy, roads_m: Sequence[FloatArray], places: Sequence[PlanPlace]) -> Frame:
    """Return the frame that holds all of it, with a foot for the scale bar."""
    corners = [road[:, :2] for road in roads_m if len(road)]
    corners += [np.array([[place.x_m, place.y_m]]) for place in places]
    rows, columns = np.nonzero(occupancy.is_known | occupancy.is_occupied)
    if len(rows):
        cells = np.array([[columns.min(), rows.min()], [columns.max() + 1, rows.max() + 1]])
        corners.append(cells * occupancy.cell_m + (occupancy.x_min_m, occupancy.y_min_m))
    shown = np.vstack(corners) if corners else np.zeros((1, 2))
    middle, size = (shown.min(axis=0) + shown.max(axis=0)) / 2, np.ptp(shown, axis=0)
    size = np.maximum(size + 2 * _MARGIN_M, _MIN_SIDE_M)
    scale = max(METRES_PER_PIXEL, float(size.max()) / MAX_SIDE_PX)
    width_px, height_px = (math.ceil(side / scale) for side in size.tolist())
    left, upper = middle[0] - size[0] / 2, middle[1] + size[1] / 2
    return Frame(float(left), float(upper), scale, width_px, height_px + FOOT_PX)


def laid_in(mask: Mask, occupancy: Occupancy, frame: Frame) -> Mask:
    """Return cells as pixels of the picture, with smooth edges."""
    per_pixel = frame.metres_per_pixel / occupancy.cell_m
    half = 0.5
    # From a pixel's middle to its place among the middles of the cells.
    column = (frame.x_min_m - occupancy.x_min_m) / occupancy.cell_m - half + half * per_pixel
    row = (frame.y_max_m - occupancy.y_min_m) / occupancy.cell_m - half - half * per_pixel
    cell_from_pixel = np.array([[per_pixel, 0.0, column], [0.0, -per_pixel, row]])
    smooth = cv2.warpAffine(
        mask.astype(np.float32), cell_from_pixel, (frame.width_px, frame.height_px),
        flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP, borderMode=cv2.BORDER_CONSTANT, borderValue=0,
    )  # fmt: skip
    return np.asarray(smooth > half)


@dataclass(frozen=True, slots=True)
class PlacedName:
    """A place in the picture, and where its name stands."""

    text: str
    x_px: float
    y_px: float
    box: Box | None
    """None where there is no room for the name."""

    @property
    def leader_px(self) -> tuple[float, float]:
        """The point of the name's box that is nearest to the place; the place itself where it has no name."""
        left, top, right, bottom = self.box or (self.x_px, self.y_px, self.x_px, self.y_px)
        return min(max(self.x_px, left), right), min(max(self.y_px, top), bottom)

    @property
    def text_at_px(self) -> tuple[float, float]:
        """Where the line of text begins that stands in the box."""
        left, _, _, bottom = self.box or (self.x_px, self.y_px, self.x_px, self.y_px)
        return left + PADDING_PX, bottom - PADDING_PX - 0.2 * TEXT_PX


def placed_names(frame: Frame, places: Sequence[PlanPlace], drawn: Mask) -> tuple[PlacedName, ...]:
    """Return where the places' names stand; ``drawn`` (height, width) is what they should rather not cover."""
    texts = [" ".join(place.name.split()) for place in places]
    spots = [frame.pixels(np.array([place.x_m, place.y_m])).tolist() for place in places]
    height_px = TEXT_PX + 2 + 2 * PADDING_PX
    labels = [
        Label(x_px, y_px, _text_width_px(text) + 2 * PADDING_PX, height_px)
        for text, (x_px, y_px) in zip(texts, spots, strict=True)
    ]
    boxes = label_boxes(labels, drawn[:-FOOT_PX])
    return tuple(
        PlacedName(text, label.x_px, label.y_px, box) for text, label, box in zip(texts, labels, boxes, strict=True)
    )


def scale_bar(frame: Frame) -> tuple[int, int]:
    """Return how many metres the scale bar says, and how long it is, pixels."""
    fits = [metres for metres in _BAR_M if metres / frame.metres_per_pixel <= frame.width_px / 3]
    metres = max(fits, default=_BAR_M[0])
    return metres, round(metres / frame.metres_per_pixel)


def typeface() -> Any:
    """Return OpenCV's own typeface, which has Latin, Greek, Cyrillic and Chinese characters."""
    return cv2.FontFace("sans")


def _text_width_px(text: str) -> float:
    _, _, width_px, _ = cv2.getTextSize((0, 0), text, (0, 0), typeface(), TEXT_PX, TEXT_WEIGHT)
    return float(width_px)

"""The floor from above as a picture: what is floor, what stands on it, walls, the road, places with their names.

The picture's edges run along x and y, y upwards; how it lies in the map is told by
:attr:`FloorPlan.world_file`, the six lines that geographic programs read beside a picture.
"""

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
Image = NDArray[np.uint8]
Rgb = tuple[int, int, int]
Pixel = tuple[int, int]

METRES_PER_PIXEL = 0.02
MAX_SIDE_PX = 4000
"""A larger floor is drawn at fewer pixels to the metre."""
_MIN_SIDE_M = 6.0
_MARGIN_M = 0.6
_FOOT_PX = 44
"""Below the floor, for the scale bar."""
_TEXT_PX, _TEXT_WEIGHT = 17, 500
_PADDING_PX = 4
_BAR_M = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000)
_BITS = 4


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
    frame = _framed(occupancy, roads_m, places)
    palette = PALETTES[theme]
    image = np.full((frame.height_px, frame.width_px, 3), palette.ground, np.uint8)
    image[_laid_in(occupancy.is_known, occupancy, frame)] = palette.floor
    image[_laid_in(occupancy.is_occupied, occupancy, frame)] = palette.standing
    for wall in walls_m:
        _line(image, frame, wall, palette.wall, 4)
    for road in roads_m:
        _line(image, frame, road, palette.road, 2)
    lines = (image == palette.road).all(axis=2) | (image == palette.wall).all(axis=2)
    _draw_places(image, frame, places, lines, palette)
    _draw_scale(image, frame, palette)
    encoded, png = cv2.imencode(".png", cv2.cvtColor(image, cv2.COLOR_RGB2BGR))
    assert encoded
    return FloorPlan(
        png.tobytes(), frame.metres_per_pixel, frame.x_min_m, frame.y_max_m, frame.width_px, frame.height_px
    )  # fmt: skip


@dataclass(frozen=True, slots=True)
class _Frame:
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


def _framed(occupancy: Occupancy, roads_m: Sequence[FloatArray], places: Sequence[PlanPlace]) -> _Frame:
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
    return _Frame(float(left), float(upper), scale, width_px, height_px + _FOOT_PX)


def _laid_in(mask: NDArray[np.bool_], occupancy: Occupancy, frame: _Frame) -> NDArray[np.bool_]:
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


def _line(image: Image, frame: _Frame, points_m: FloatArray, colour: Rgb, width_px: int) -> None:
    at = np.round(frame.pixels(points_m[:, :2]) * (1 << _BITS)).astype(np.int32)
    cv2.polylines(image, [at], False, colour, width_px, cv2.LINE_AA, _BITS)


def _draw_places(
    image: Image, frame: _Frame, places: Sequence[PlanPlace], drawn: NDArray[np.bool_], palette: Palette
) -> None:
    spots = [frame.pixels(np.array([place.x_m, place.y_m])) for place in places]
    sizes = [_text_size(place.name) for place in places]
    labels = [
        Label(float(x), float(y), width + 2 * _PADDING_PX, height + 2 * _PADDING_PX)
        for (x, y), (width, height) in zip(spots, sizes, strict=True)
    ]
    boxes = label_boxes(labels, drawn[:-_FOOT_PX])
    for label, box in zip(labels, boxes, strict=True):
        at = (round(label.x_px), round(label.y_px))
        if box is not None:
            cv2.line(image, at, _nearest(box, at), palette.place, 1, cv2.LINE_AA)
    for place, label, box in zip(places, labels, boxes, strict=True):
        at = (round(label.x_px), round(label.y_px))
        cv2.circle(image, at, 6, palette.plate, cv2.FILLED, cv2.LINE_AA)
        cv2.circle(image, at, 5, palette.place, cv2.FILLED, cv2.LINE_AA)
        if box is not None:
            _draw_label(image, place.name, box, palette)


def _nearest(box: Box, at: Pixel) -> Pixel:
    left, top, right, bottom = box
    return round(min(max(at[0], left), right)), round(min(max(at[1], top), bottom))


def _draw_label(image: Image, text: str, box: Box, palette: Palette) -> None:
    left, top, right, bottom = (round(side) for side in box)
    cv2.rectangle(image, (left, top), (right, bottom), palette.plate, cv2.FILLED)
    _draw_text(image, text, (left + _PADDING_PX, bottom - _PADDING_PX - _descent_px()), palette.text)


def _draw_scale(image: Image, frame: _Frame, palette: Palette) -> None:
    fits = [metres for metres in _BAR_M if metres / frame.metres_per_pixel <= frame.width_px / 3]
    metres = max(fits, default=_BAR_M[0])
    length_px = round(metres / frame.metres_per_pixel)
    x_px, y_px = 16, frame.height_px - 14
    for begin, end in (((0, 0), (length_px, 0)), ((0, -6), (0, 0)), ((length_px, -6), (length_px, 0))):
        cv2.line(image, (x_px + begin[0], y_px + begin[1]), (x_px + end[0], y_px + end[1]), palette.text, 2)
    _draw_text(image, f"{metres} m", (x_px + length_px + 10, y_px), palette.text)


def _draw_text(image: Image, text: str, at_px: Pixel, colour: Rgb) -> None:
    cv2.putText(image, _one_line(text), at_px, colour, _face(), _TEXT_PX, _TEXT_WEIGHT)


def _text_size(text: str) -> tuple[float, float]:
    _, _, width, _ = cv2.getTextSize((0, 0), _one_line(text), (0, 0), _face(), _TEXT_PX, _TEXT_WEIGHT)
    return float(width), float(_TEXT_PX + 2)


def _descent_px() -> int:
    return round(0.2 * _TEXT_PX)


def _one_line(text: str) -> str:
    return " ".join(text.split())


def _face() -> Any:
    """Return OpenCV's own typeface, which has Latin, Greek, Cyrillic and Chinese characters."""
    return cv2.FontFace("sans")

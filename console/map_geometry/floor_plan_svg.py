"""The floor from above as SVG: the plan of :mod:`console.map_geometry.floor_plan`, sharp at every size.

Its units are the picture's pixels; how it lies in the map is told by the root's ``data-`` attributes.
"""

from __future__ import annotations

import html
from collections.abc import Iterator, Sequence

import cv2
import numpy as np

from console.map_geometry.occupancy import Occupancy
from console.map_geometry.plan_layout import (
    PALETTES,
    PLACE_PX,
    ROAD_PX,
    TEXT_PX,
    TEXT_WEIGHT,
    WALL_PX,
    Frame,
    Mask,
    Palette,
    PlacedName,
    PlanPlace,
    Rgb,
    Theme,
    framed,
    laid_in,
    placed_names,
    scale_bar,
)
from navcore.geometry import FloatArray

_OUTLINE_WITHIN_PX = 0.8


def floor_plan_svg(
    occupancy: Occupancy,
    walls_m: FloatArray,
    roads_m: Sequence[FloatArray],
    places: Sequence[PlanPlace],
    theme: Theme = "light",
) -> str:
    """Draw the plan of a floor as one SVG document; for the arguments see :func:`floor_plan`."""
    frame, palette = framed(occupancy, roads_m, places), PALETTES[theme]
    walls, roads = ([frame.pixels(line[:, :2]) for line in lines] for lines in (walls_m, roads_m))
    drawn = np.zeros((frame.height_px, frame.width_px), np.uint8)
    for line in (*walls, *roads):
        cv2.polylines(drawn, [np.round(line).astype(np.int32)], False, 1, WALL_PX)
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {frame.width_px} {frame.height_px}" role="img"'
        f' aria-label="Floor plan" data-metres-per-pixel="{frame.metres_per_pixel:.6f}"'
        f' data-left-m="{frame.x_min_m:.4f}" data-top-m="{frame.y_max_m:.4f}">',
        f'<rect width="{frame.width_px}" height="{frame.height_px}" fill="{_hex(palette.ground)}"/>',
        _area(laid_in(occupancy.is_known, occupancy, frame), palette.floor),
        _area(laid_in(occupancy.is_occupied, occupancy, frame), palette.standing),
        *(_polyline(wall, palette.wall, WALL_PX) for wall in walls),
        *(_polyline(road, palette.road, ROAD_PX) for road in roads),
        *_names(placed_names(frame, places, drawn.astype(np.bool_)), palette),
        *_scale(frame, palette),
        "</svg>",
    ]
    return "\n".join(parts) + "\n"


def _area(mask: Mask, colour: Rgb) -> str:
    contours, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    outlines = [cv2.approxPolyDP(contour, _OUTLINE_WITHIN_PX, True).reshape(-1, 2) for contour in contours]
    # A pixel is an area; its outline runs through the pixels' middles.
    data = " ".join(f"M{_points(np.asarray(outline + 0.5, np.float64))}Z" for outline in outlines if len(outline) > 2)
    return f'<path fill="{_hex(colour)}" fill-rule="evenodd" d="{data}"/>'


def _polyline(points_px: FloatArray, colour: Rgb, width_px: int) -> str:
    return (
        f'<polyline points="{_points(points_px)}" fill="none" stroke="{_hex(colour)}" stroke-width="{width_px}"'
        ' stroke-linecap="round" stroke-linejoin="round"/>'
    )


def _names(names: Sequence[PlacedName], palette: Palette) -> Iterator[str]:
    for name in names:
        yield _polyline(np.array([(name.x_px, name.y_px), name.leader_px]), palette.place, 1)
    for name in names:
        yield (
            f'<circle cx="{name.x_px:.1f}" cy="{name.y_px:.1f}" r="{PLACE_PX}" fill="{_hex(palette.place)}"'
            f' stroke="{_hex(palette.plate)}"/>'
        )
        if name.box is not None:
            left, top, right, bottom = name.box
            yield (
                f'<rect x="{left:.1f}" y="{top:.1f}" width="{right - left:.1f}" height="{bottom - top:.1f}"'
                f' fill="{_hex(palette.plate)}"/>'
            )
            yield _text(name.text, name.text_at_px, palette.text)


def _scale(frame: Frame, palette: Palette) -> Iterator[str]:
    metres, length_px = scale_bar(frame)
    x_px, y_px = 16.0, frame.height_px - 14.0
    corners = ((0, -6), (0, 0), (length_px, 0), (length_px, -6))
    bar = np.array([(x_px + right, y_px + down) for right, down in corners])
    yield _polyline(bar, palette.text, 2)
    yield _text(f"{metres} m", (x_px + length_px + 10, y_px), palette.text)


def _text(text: str, at_px: tuple[float, float], colour: Rgb) -> str:
    # What XML cannot hold at all, as control characters, is left out.
    told = html.escape("".join(character for character in text if character.isprintable()))
    return (
        f'<text x="{at_px[0]:.1f}" y="{at_px[1]:.1f}" font-family="sans-serif" font-size="{TEXT_PX}"'
        f' font-weight="{TEXT_WEIGHT}" fill="{_hex(colour)}">{told}</text>'
    )


def _points(points_px: FloatArray) -> str:
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in points_px.tolist())


def _hex(colour: Rgb) -> str:
    return "#{:02x}{:02x}{:02x}".format(*colour)

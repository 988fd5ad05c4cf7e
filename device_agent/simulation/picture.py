"""The floor plan as a picture: walls, furniture, places, and trajectories over it (the paper's Figs. 8 and 9)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from device_agent.simulation.building import BODY_HIGH_M, Building
from device_agent.simulation.shapes import Solid
from navcore.geometry import FloatArray
from navcore.types import ImageRgb

Rgb = tuple[int, int, int]
TRAJECTORY_COLOURS: tuple[Rgb, ...] = (
    (213, 62, 79), (31, 119, 180), (44, 140, 70), (230, 140, 20), (120, 80, 170), (20, 150, 160),
)  # fmt: skip
_PAPER, _ROOM, _CORRIDOR, _WALL, _FURNITURE = (
    (255, 255, 255),
    (246, 244, 238),
    (232, 238, 244),
    (58, 62, 70),
    (201, 190, 172),
)
_GLASS = (120, 180, 215)
_MARGIN_M = 0.6
_SHIFT = 4
"""Fractional bits of drawing coordinates."""


@dataclass(frozen=True, slots=True)
class PlanView:
    """How metres of the building become pixels: x to the right, y upwards."""

    px_per_m: float
    left_m: float
    top_m: float
    width_px: int
    height_px: int

    def pixels(self, points_m: FloatArray) -> FloatArray:
        """Return pixel coordinates (n, 2), column and row, of points (n, 2)."""
        points = np.asarray(points_m, np.float64).reshape(-1, 2)
        return np.stack(
            [(points[:, 0] - self.left_m) * self.px_per_m, (self.top_m - points[:, 1]) * self.px_per_m], axis=1
        )


def plan_view(building: Building, px_per_m: float = 40.0) -> PlanView:
    """Return the view that shows all of the building with a small margin."""
    corners = np.array([(r.x0_m, r.y0_m, r.x1_m, r.y1_m) for r in building.rooms])
    left, bottom = corners[:, 0].min() - _MARGIN_M, corners[:, 1].min() - _MARGIN_M
    right, top = corners[:, 2].max() + _MARGIN_M, corners[:, 3].max() + _MARGIN_M
    return PlanView(
        px_per_m, float(left), float(top), round((right - left) * px_per_m), round((top - bottom) * px_per_m)
    )


def floor_plan(
    building: Building,
    trajectories_m: Mapping[str, Sequence[FloatArray]] | None = None,
    *,
    px_per_m: float = 40.0,
    show_road: bool = False,
) -> ImageRgb:
    """Draw the floor plan, and trajectories (n, 2) by name: those of one name in one colour, with a legend."""
    view = plan_view(building, px_per_m)
    image: NDArray[np.uint8] = np.full((view.height_px, view.width_px, 3), 255, np.uint8)
    _draw_rooms(image, building, view)
    _draw_solids(image, building, view)
    if show_road:
        _draw_line(image, view, np.asarray(building.road_waypoints, np.float64), (150, 175, 205), 2)
    for lines, colour in zip((trajectories_m or {}).values(), _colours(len(trajectories_m or {})), strict=True):
        for points in lines:
            _draw_line(image, view, points, colour, 2)
            _draw_mark(image, view, points[0], colour)
    _draw_places(image, building, view)
    _draw_legend(image, list(trajectories_m or {}))
    return image


def _colours(count: int) -> list[Rgb]:
    return [TRAJECTORY_COLOURS[k % len(TRAJECTORY_COLOURS)] for k in range(count)]


def _fixed(points_px: FloatArray) -> NDArray[np.int32]:
    return np.rint(points_px * (1 << _SHIFT)).astype(np.int32).reshape(-1, 1, 2)


def _draw_rooms(image: ImageRgb, building: Building, view: PlanView) -> None:
    for room in building.rooms:
        outline = np.array(
            [(room.x0_m, room.y0_m), (room.x1_m, room.y0_m), (room.x1_m, room.y1_m), (room.x0_m, room.y1_m)]
        )
        cv2.fillPoly(
            image, [_fixed(view.pixels(outline))], _CORRIDOR if room.is_corridor else _ROOM, cv2.LINE_AA, _SHIFT
        )


def _draw_solids(image: ImageRgb, building: Building, view: PlanView) -> None:
    # Walls over furniture, glass over the wall below it; what hangs overhead is not drawn.
    for solid in sorted((s for s in building.solids if s.low_m < BODY_HIGH_M), key=lambda s: _layer(s)[0]):
        colour = _layer(solid)[1]
        cv2.fillConvexPoly(image, _fixed(view.pixels(solid.outline_m)), colour, cv2.LINE_AA, _SHIFT)


def _layer(solid: Solid) -> tuple[int, Rgb]:
    kind = solid.name.split(" ", 1)[0]
    return {"wall": (1, _WALL), "window": (2, _GLASS), "glass": (2, _GLASS)}.get(kind, (0, _FURNITURE))


def _draw_line(image: ImageRgb, view: PlanView, points_m: FloatArray, colour: Rgb, width_px: int) -> None:
    cv2.polylines(image, [_fixed(view.pixels(points_m))], False, colour, width_px, cv2.LINE_AA, _SHIFT)


def _draw_mark(image: ImageRgb, view: PlanView, point_m: FloatArray, colour: Rgb) -> None:
    centre = _fixed(view.pixels(point_m))[0, 0]
    cv2.circle(image, (int(centre[0]), int(centre[1])), 5 << _SHIFT, colour, -1, cv2.LINE_AA, _SHIFT)


def _draw_places(image: ImageRgb, building: Building, view: PlanView) -> None:
    for place in building.places.values():
        column, row = view.pixels(np.array([[place.x_m, place.y_m]]))[0]
        is_junction = place.kind == "junction"
        colour = (90, 110, 140) if is_junction else (20, 78, 140)
        cv2.circle(image, (round(column), round(row)), 5, colour, -1, cv2.LINE_AA)
        _write(image, place.name, (round(column) + 9, round(row) - 7), colour, 0.5)


def _draw_legend(image: ImageRgb, names: Sequence[str]) -> None:
    for number, (name, colour) in enumerate(zip(names, _colours(len(names)), strict=True)):
        row = 20 + 20 * number
        cv2.line(image, (10, row), (38, row), colour, 3, cv2.LINE_AA)
        _write(image, name, (46, row + 5), (40, 40, 44), 0.5)


def _write(image: ImageRgb, text: str, at_px: tuple[int, int], colour: Rgb, scale: float) -> None:
    cv2.putText(image, text, at_px, cv2.FONT_HERSHEY_DUPLEX, scale, _PAPER, 4, cv2.LINE_AA)
    cv2.putText(image, text, at_px, cv2.FONT_HERSHEY_DUPLEX, scale, colour, 1, cv2.LINE_AA)

"""Where the names go on a plan, so that none covers another."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

_DISTANCES_PX = (9.0, 22.0, 40.0, 64.0, 96.0)
_ANGLES_RAD = tuple(math.radians(angle) for angle in (0, 180, 90, 270, 45, 315, 135, 225))
_COST_PER_PX = 4.0
"""Standing a pixel farther from its place costs a label as much as covering so many drawn pixels."""
_GAP_PX = 3.0
_DOT_PX = 6.0

Box = tuple[float, float, float, float]
"""Left, top, right, bottom, pixels."""


@dataclass(frozen=True, slots=True)
class Label:
    """A name that wants to stand near its place."""

    x_px: float
    y_px: float
    width_px: float
    height_px: float


def label_boxes(labels: Sequence[Label], drawn: NDArray[np.bool_]) -> tuple[Box | None, ...]:
    """Return a box for each label, inside the picture, that covers no other box and no place; None where none is free.

    ``drawn`` (height, width) is what a label should rather not cover, if it can stand a little farther off. The first
    labels are the most important: they choose first.
    """
    height_px, width_px = drawn.shape
    covered = cv2.integral(drawn.astype(np.uint8))
    taken = [_around(label.x_px, label.y_px, _DOT_PX, _DOT_PX) for label in labels]
    placed: list[Box | None] = []
    for label in labels:
        boxes = [each for each in _candidates(label) if _is_free(each[1], taken, width_px, height_px)]
        costs = [_COST_PER_PX * distance_px + _sum_in(covered, box) for distance_px, box in boxes]
        free = boxes[int(np.argmin(costs))][1] if boxes else None
        placed.append(free)
        if free is not None:
            taken.append(free)
    return tuple(placed)


def _sum_in(integral: NDArray[Any], box: Box) -> int:
    left, top, right, bottom = (int(side) for side in box)
    total = integral[bottom, right] - integral[top, right] - integral[bottom, left] + integral[top, left]
    return int(total)


def _candidates(label: Label) -> list[tuple[float, Box]]:
    """Return distance and box around a place, nearest first: beside it, above and below it, and across."""
    half_width, half_height = label.width_px / 2, label.height_px / 2
    boxes = []
    for distance_px in _DISTANCES_PX:
        for angle in _ANGLES_RAD:
            x_px = label.x_px + math.cos(angle) * (distance_px + half_width)
            y_px = label.y_px - math.sin(angle) * (distance_px + half_height)
            boxes.append((distance_px, _around(x_px, y_px, half_width, half_height)))
    return boxes


def _around(x_px: float, y_px: float, half_width_px: float, half_height_px: float) -> Box:
    return x_px - half_width_px, y_px - half_height_px, x_px + half_width_px, y_px + half_height_px


def _is_free(box: Box, taken: Sequence[Box], width_px: float, height_px: float) -> bool:
    left, top, right, bottom = box
    if left < 0.0 or top < 0.0 or right > width_px or bottom > height_px:
        return False
    return not any(
        left < other[2] + _GAP_PX and other[0] < right + _GAP_PX and top < other[3] + _GAP_PX
        and other[1] < bottom + _GAP_PX
        for other in taken
    )  # fmt: skip

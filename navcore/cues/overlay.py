"""The see-through overlay: guidance as a picture for each eye. Pure.

Two steps: :func:`overlay_scene` says what is drawn, in metres before the eyes; :func:`drawn` draws it as one eye sees
it. :func:`render_overlay` does both, for both eyes. No guidance, or an old one, is the sign *Stop*.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from navcore.cues.overlay_display import DisplayGeometry, Eye, Head
from navcore.cues.overlay_shapes import Area, Label, Shape, Sheet
from navcore.cues.overlay_signs import (
    arrival_sign,
    aside_sign,
    corner_sign,
    destination_sign,
    stop_sign,
    turn_sign,
    warning_sign,
)
from navcore.cues.overlay_world import arrow_on_floor, near_edges, nearest_label, sub_goal_of, sub_goal_post
from navcore.settings import Settings
from navcore.types import Action, Guidance, ObstacleScan, Reason

ImageRgba = NDArray[np.uint8]
"""Colour image (height, width, 4), red first; alpha 0 where nothing is drawn. Black is transparent on the glasses."""
_SHIFT = 4
_SUB_PX = float(1 << _SHIFT)
_FONT = cv2.FONT_HERSHEY_DUPLEX
_FONT_HEIGHT_PX = 22.0
"""Height of a capital letter of the font at scale 1."""
_FARTHEST_PX = 8000.0
_NEAREST_M = 0.25
_SEEN_SHARE = 0.85
"""A post nearer to the edge of the field than this is shown by an arrow at the edge."""
_FARTHEST_POST_M = 12.0
_CLEAR = (0, 0, 0, 0)
_EDGE_PX = 2
"""Width of the dark edge that keeps shapes apart; black is transparent."""


@dataclass(frozen=True, slots=True, eq=False)
class Overlay:
    """What the two displays show at one moment."""

    stamp_s: float
    left_rgba: ImageRgba
    right_rgba: ImageRgba
    is_stop: bool


def render_overlay(
    guidance: Guidance | None,
    scan: ObstacleScan | None,
    head: Head,
    now_s: float,
    settings: Settings,
    display: DisplayGeometry,
) -> Overlay:
    """Return the pictures for the left and the right eye.

    Args:
        guidance: what holds; None, or older than ``watchdog.guidance_timeout_s``, shows *Stop*.
        scan: what is near, of the same frame; None where nothing is known.
        head: how the displays are held.
        now_s: the present time, on the scale of the stamps.
        settings: style of directions, ranges.
        display: the displays.
    """
    shapes = overlay_scene(guidance, scan, head, now_s, settings, display)
    is_stop = not is_fresh(guidance, now_s, settings) or guidance is None or guidance.action is Action.STOP
    left, right = (drawn(shapes, display, eye) for eye in Eye)
    return Overlay(now_s, left, right, is_stop)


def is_fresh(guidance: Guidance | None, now_s: float, settings: Settings) -> bool:
    """Return whether guidance may be shown; so written that a stamp which is no number is not."""
    return guidance is not None and now_s - guidance.stamp_s <= settings.watchdog.guidance_timeout_s


def overlay_scene(
    guidance: Guidance | None,
    scan: ObstacleScan | None,
    head: Head,
    now_s: float,
    settings: Settings,
    display: DisplayGeometry,
) -> list[Shape]:
    """Return what is drawn, the last on top (see :func:`render_overlay`)."""
    sheet = Sheet(display)
    if guidance is None or not is_fresh(guidance, now_s, settings):
        return stop_sign(sheet, Reason.SENSOR_STALE)
    if guidance.reason is Reason.ARRIVED and guidance.action is Action.STOP:
        return arrival_sign(sheet)
    stop_m, range_m = settings.obstacle.stop_distance_m, settings.cues.beep_range_m
    near = [] if scan is None else near_edges(head, scan, range_m, stop_m)
    if guidance.action is Action.STOP or guidance.direction is None:
        return [*near, *stop_sign(sheet, guidance.reason)]
    if guidance.action is Action.TURN:
        return [*near, *turn_sign(sheet, float(guidance.direction), settings.cues.direction_style)]
    label = [] if scan is None else nearest_label(head, scan, range_m)
    way = arrow_on_floor(head, float(guidance.direction))
    shapes = [*near, *_sub_goal(guidance, head, sheet), *way, *label, *_ahead(guidance, sheet)]
    # Figures on top: nothing is drawn over what is to be read.
    return sorted(shapes, key=lambda shape: isinstance(shape, Label))


def _sub_goal(guidance: Guidance, head: Head, sheet: Sheet) -> list[Shape]:
    at_m, goal = sub_goal_of(guidance.trace), guidance.trace.sub_goal
    if at_m is None or goal is None:
        return []
    distance_m = math.hypot(at_m[0], at_m[1])
    edge_rad = math.radians(sheet.display.field_deg) / 2.0 * _SEEN_SHARE
    bearing = math.atan2(at_m[1], at_m[0])
    if abs(bearing) > edge_rad:
        return aside_sign(sheet, math.copysign(1.0, bearing))
    return sub_goal_post(head, at_m, goal.case) if 0.5 < distance_m < _FARTHEST_POST_M else []


def _ahead(guidance: Guidance, sheet: Sheet) -> list[Shape]:
    trace, shapes = guidance.trace, []
    if trace.remaining_m is not None:
        shapes += destination_sign(sheet, trace.remaining_m)
    if trace.corner is not None:
        shapes += corner_sign(sheet, float(trace.corner.bend), trace.corner.distance_m)
    if trace.uncertain_since_s is not None:
        shapes += warning_sign(sheet, "?")
    elif guidance.reason is Reason.OFF_ROAD:
        shapes += warning_sign(sheet, "!")
    return shapes


# ------------------------------------------------------------------------------------------------------ drawing
def drawn(shapes: list[Shape], display: DisplayGeometry, eye: Eye) -> ImageRgba:
    """Return the picture of one eye. What is too near for it is left out."""
    image: ImageRgba = np.zeros((display.height_px, display.width_px, 4), np.uint8)
    for shape in shapes:
        points_m = shape.at_m[None] if isinstance(shape, Label) else shape.points_m
        if not bool((points_m[:, 2] > _NEAREST_M).all()):
            continue
        pixels = display.project(points_m, eye)
        if isinstance(shape, Label):
            _write(image, shape, pixels[0])
            continue
        fixed = np.round(np.clip(pixels, -_FARTHEST_PX, _FARTHEST_PX) * _SUB_PX).astype(np.int32)
        colour = (*shape.ink.value, 255)
        if isinstance(shape, Area):
            cv2.polylines(image, [fixed], True, _CLEAR, 2 * _EDGE_PX, cv2.LINE_8, _SHIFT)
            cv2.fillPoly(image, [fixed], colour, cv2.LINE_AA, _SHIFT)
        else:
            width_px = shape.width_px + 2 * _EDGE_PX
            cv2.polylines(image, [fixed], shape.is_closed, _CLEAR, width_px, cv2.LINE_8, _SHIFT)
            cv2.polylines(image, [fixed], shape.is_closed, colour, shape.width_px, cv2.LINE_AA, _SHIFT)
    return image


def _write(image: ImageRgba, label: Label, middle_px: NDArray[np.float64]) -> None:
    scale = label.height_px / _FONT_HEIGHT_PX
    width_px = max(2, round(label.height_px / 8.0))
    (size_px, _), _ = cv2.getTextSize(label.text, _FONT, scale, width_px)
    degree_px = label.height_px / 5.0 if label.is_degrees else 0.0
    x_px = round(float(middle_px[0]) - size_px / 2.0)
    y_px = round(float(middle_px[1]) + label.height_px / 2.0)
    colour = (*label.ink.value, 255)
    if not label.is_on_sign:
        corner = (x_px - 2 * _EDGE_PX, y_px - label.height_px - 2 * _EDGE_PX)
        opposite = (round(x_px + size_px + 3.0 * degree_px) + 2 * _EDGE_PX, y_px + 2 * _EDGE_PX)
        cv2.rectangle(image, corner, opposite, _CLEAR, cv2.FILLED)
    cv2.putText(image, label.text, (x_px, y_px), _FONT, scale, colour, width_px, cv2.LINE_AA)
    if label.is_degrees:
        centre = (round(x_px + size_px + 1.5 * degree_px), round(y_px - label.height_px + degree_px))
        cv2.circle(image, centre, round(degree_px), colour, max(2, width_px // 2), cv2.LINE_AA)

"""The signs of the overlay, which lie on the virtual image: stop and its reasons, the turn, what is ahead. Pure.

Each has a shape of its own, so that none is told by its colour alone.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from navcore.cues.directions import DirectionStyle, hour, told_turn_deg
from navcore.cues.overlay_display import Ink
from navcore.cues.overlay_shapes import Shape, Sheet, regular
from navcore.types import Reason

_STOP_RADIUS_PX = 104.0
_DIAL_RADIUS_PX = 104.0
_EIGHTH_RAD = math.pi / 8.0


def stop_sign(sheet: Sheet, reason: Reason) -> list[Shape]:
    """Return the octagon, and under it the pictogram of the reason."""
    sign = sheet.moved(0.0, -52.0)
    octagon = regular(8, _STOP_RADIUS_PX, _EIGHTH_RAD)
    pictogram = _PICTOGRAMS.get(reason)
    below = [] if pictogram is None else pictogram(sheet.moved(0.0, 112.0))
    return [
        sign.area(octagon, Ink.SIGN),
        sign.line(octagon * 0.955, Ink.TEXT, 7, is_closed=True),
        sign.label("STOP", Ink.TEXT, 48, is_on_sign=True),
        *below,
    ]


def arrival_sign(sheet: Sheet) -> list[Shape]:
    """Return a ring with a tick mark."""
    return [
        sheet.ring(100.0, Ink.TEXT, 10),
        sheet.line([(-46.0, 4.0), (-12.0, 40.0), (50.0, -36.0)], Ink.GOAL, 18),
    ]


def turn_sign(sheet: Sheet, direction_rad: float, style: DirectionStyle) -> list[Shape]:
    """Return a dial seen from above: straight ahead is its top, and an arrow runs round it to the new direction."""
    dial = sheet.moved(0.0, 14.0)
    told_deg = told_turn_deg(direction_rad, style)
    left = math.copysign(1.0, told_deg)
    end_rad = math.radians(abs(told_deg))
    head_rad = min(0.42, 0.6 * end_rad)
    # The tip of the arrow, not its back, points to the new direction.
    arc = _on_dial(np.linspace(0.0, end_rad - head_rad, 24), _DIAL_RADIUS_PX, left)
    base, tip = np.array([end_rad - head_rad]), np.array([end_rad])
    head = np.concatenate(
        [_on_dial(base, _DIAL_RADIUS_PX - 30.0, left), _on_dial(tip, _DIAL_RADIUS_PX, left),
         _on_dial(base, _DIAL_RADIUS_PX + 30.0, left)]
    )  # fmt: skip
    spoke = _on_dial(np.array([end_rad, end_rad]), 1.0, left) * np.array([[58.0], [74.0]])
    shapes: list[Shape] = [dial.line([(0.0, -74.0), (0.0, -136.0)], Ink.TEXT, 5)]
    if style == "clock":
        ticks = [dial.line(regular(12, 1.0)[each] * np.array([[122.0], [132.0]]), Ink.TEXT, 4) for each in range(1, 12)]
        shapes += ticks
    shapes += [dial.line(arc, Ink.WAY, 18), dial.area(head, Ink.WAY), dial.line(spoke, Ink.WAY, 6)]
    return shapes + _figure(dial, told_deg, style)


def _figure(dial: Sheet, told_deg: float, style: DirectionStyle) -> list[Shape]:
    if style == "clock" and abs(told_deg) >= 30.0:
        return [dial.label(str(hour(told_deg)), Ink.TEXT, 44)]
    if style == "sides":
        return []
    return [dial.label(str(round(abs(told_deg))), Ink.TEXT, 38, is_degrees=True)]


def corner_sign(sheet: Sheet, bend_rad: float, distance_m: float) -> list[Shape]:
    """Return a bent arrow on the side of the turn, with the distance to the corner under it."""
    left = math.copysign(1.0, bend_rad)
    # Half of the width is 320 px: the sign keeps off the edge, and out of the way of the arrow on the floor.
    sign = sheet.moved(-left * 236.0, -112.0)
    turn = min(abs(bend_rad), math.radians(150.0))
    along = np.array([-left * math.sin(turn), -math.cos(turn)])
    across = np.array([-along[1], along[0]])
    knee = np.array([left * 18.0, -10.0])
    neck, tip = knee + 30.0 * along, knee + 58.0 * along
    head = np.stack([neck + 20.0 * across, tip, neck - 20.0 * across])
    return [
        sign.line(np.stack([knee + np.array([0.0, 44.0]), knee, neck]), Ink.WAY, 11),
        sign.area(head, Ink.WAY),
        sign.moved(0.0, 62.0).label(metres(distance_m), Ink.TEXT, 22),
    ]


def destination_sign(sheet: Sheet, distance_m: float) -> list[Shape]:
    """Return a target with the distance left under it, at the top."""
    sign = sheet.moved(0.0, -156.0)
    return [
        sign.ring(13.0, Ink.GOAL, 4), sign.disc(5.0, Ink.GOAL),
        sign.moved(0.0, 32.0).label(metres(distance_m), Ink.TEXT, 18),
    ]  # fmt: skip


def aside_sign(sheet: Sheet, left: float) -> list[Shape]:
    """Return an arrow head at the edge: what is looked for lies farther to that side."""
    edge = sheet.moved(-left * 292.0, 20.0)
    return [edge.area([(-left * 20.0, 0.0), (left * 12.0, -26.0), (left * 12.0, 26.0)], Ink.GOAL)]


def warning_sign(sheet: Sheet, mark: str) -> list[Shape]:
    """Return a triangle with a mark: "!" off the road, "?" where the position is not sure."""
    sign = sheet.moved(0.0, -84.0)
    return [
        sign.line(regular(3, 30.0) * (1.0, 0.92), Ink.NEAR, 5, is_closed=True),
        sign.moved(0.0, 3.0).label(mark, Ink.TEXT, 20, is_on_sign=True),
    ]


def metres(distance_m: float) -> str:
    """Return a distance as it is shown: "0.8 m" near by, "12 m" farther away."""
    return f"{distance_m:.1f} m" if distance_m < 2.95 else f"{distance_m:.0f} m"


def _on_dial(angles_rad: np.ndarray, radius_px: float, left: float) -> np.ndarray:
    return np.stack([-left * radius_px * np.sin(angles_rad), -radius_px * np.cos(angles_rad)], axis=1)


# --------------------------------------------------------------------------------------------------- pictograms
def _barrier(sheet: Sheet) -> list[Shape]:
    bar = [(-50.0, -22.0), (50.0, -22.0), (50.0, 2.0), (-50.0, 2.0)]
    stripes = [sheet.line([(x - 8.0, 2.0), (x + 8.0, -22.0)], Ink.NEAR, 6) for x in (-30.0, 0.0, 30.0)]
    legs = [sheet.line([(x, 2.0), (x, 32.0)], Ink.NEAR, 6) for x in (-36.0, 36.0)]
    return [sheet.line(bar, Ink.NEAR, 5, is_closed=True), *stripes, *legs]


def _glass(sheet: Sheet) -> list[Shape]:
    """Waves that come back from a pane."""
    arcs: list[Shape] = []
    for radius in (18.0, 34.0, 50.0):
        angles = np.linspace(-0.8, 0.8, 12)
        arcs.append(
            sheet.line(np.stack([radius * np.sin(angles), 30.0 - radius * np.cos(angles)], axis=1), Ink.NEAR, 5)
        )
    return [sheet.line([(-52.0, -32.0), (52.0, -32.0)], Ink.TEXT, 6), *arcs]


def _drop(sheet: Sheet) -> list[Shape]:
    """An edge, and an arrow that falls from it."""
    edge = [(-54.0, -16.0), (-6.0, -16.0), (-6.0, 34.0)]
    arrow = [(26.0, -30.0), (26.0, 14.0)]
    head = [(8.0, 12.0), (44.0, 12.0), (26.0, 36.0)]
    return [sheet.line(edge, Ink.TEXT, 7), sheet.line(arrow, Ink.NEAR, 8), sheet.area(head, Ink.NEAR)]


def _closed_in(sheet: Sheet) -> list[Shape]:
    walls = [(-44.0, 34.0), (-44.0, -26.0), (44.0, -26.0), (44.0, 34.0)]
    return [sheet.line(walls, Ink.NEAR, 7), sheet.disc(9.0, Ink.TEXT)]


def _eye(sheet: Sheet) -> list[Shape]:
    """An eye that is crossed out."""
    angles = np.linspace(-1.0, 1.0, 16)
    lid = np.stack([48.0 * angles, -24.0 * (1.0 - angles**2)], axis=1)
    return [
        sheet.line(lid, Ink.TEXT, 5), sheet.line(lid * (1.0, -1.0), Ink.TEXT, 5), sheet.disc(11.0, Ink.TEXT),
        sheet.line([(-38.0, 32.0), (38.0, -32.0)], Ink.NEAR, 7),
    ]  # fmt: skip


def _question(sheet: Sheet) -> list[Shape]:
    """A pin on a map, with a question mark."""
    angles = np.linspace(-2.3, 2.3, 24)
    pin = np.stack([26.0 * np.sin(angles), -12.0 - 26.0 * np.cos(angles)], axis=1)
    outline = np.concatenate([pin, [(0.0, 38.0)]])
    return [
        sheet.line(outline, Ink.NEAR, 5, is_closed=True),
        sheet.moved(0.0, -12.0).label("?", Ink.TEXT, 24, is_on_sign=True),
    ]


def _broken(sheet: Sheet) -> list[Shape]:
    """A plug that is out."""
    return [
        sheet.line([(-52.0, 0.0), (-26.0, 0.0)], Ink.TEXT, 6), sheet.line([(52.0, 0.0), (26.0, 0.0)], Ink.TEXT, 6),
        sheet.line(regular(4, 34.0, math.pi / 4.0)[[0, 2]] * 0.8, Ink.NEAR, 8),
        sheet.line(regular(4, 34.0, math.pi / 4.0)[[1, 3]] * 0.8, Ink.NEAR, 8),
    ]  # fmt: skip


def _tilted(sheet: Sheet) -> list[Shape]:
    """A camera that leans over, above a level floor."""
    lean = math.radians(-24.0)
    c, s = math.cos(lean), math.sin(lean)
    case = np.array([(-34.0, -18.0), (34.0, -18.0), (34.0, 18.0), (-34.0, 18.0), (-34.0, -18.0)])
    case = case @ np.array([[c, s], [-s, c]]) - (0.0, 8.0)
    return [
        sheet.line(case, Ink.TEXT, 6), sheet.moved(0.0, -8.0).disc(10.0, Ink.NEAR),
        sheet.line([(-44.0, 36.0), (44.0, 36.0)], Ink.TEXT, 6),
    ]  # fmt: skip


def _look_ahead(sheet: Sheet) -> list[Shape]:
    """A head, and an arrow that leaves it level."""
    return [
        sheet.moved(-30.0, 0.0).ring(22.0, Ink.TEXT, 6), sheet.line([(2.0, 0.0), (34.0, 0.0)], Ink.NEAR, 8),
        sheet.area([(30.0, -18.0), (56.0, 0.0), (30.0, 18.0)], Ink.NEAR),
    ]  # fmt: skip


def _bars(sheet: Sheet) -> list[Shape]:
    return [
        sheet.area([(x - 8.0, -28.0), (x + 8.0, -28.0), (x + 8.0, 28.0), (x - 8.0, 28.0)], Ink.TEXT)
        for x in (-18.0, 18.0)
    ]


def _no_goal(sheet: Sheet) -> list[Shape]:
    return [
        sheet.ring(30.0, Ink.GOAL, 5), sheet.disc(8.0, Ink.GOAL),
        sheet.line([(-34.0, 34.0), (34.0, -34.0)], Ink.TEXT, 7),
    ]  # fmt: skip


def _beside(sheet: Sheet) -> list[Shape]:
    """A road, and a point beside it."""
    road = [sheet.line([(x, -32.0), (x, 34.0)], Ink.TEXT, 6) for x in (-40.0, 0.0)]
    return [*road, sheet.moved(34.0, 4.0).disc(12.0, Ink.NEAR)]


_PICTOGRAMS: dict[Reason, Callable[[Sheet], list[Shape]]] = {
    Reason.OK: _broken,
    Reason.OFF_ROAD: _beside,
    Reason.OBSTACLE_DEPTH: _barrier,
    Reason.OBSTACLE_SONAR: _glass,
    Reason.DROP_AHEAD: _drop,
    Reason.NO_CANDIDATE: _closed_in,
    Reason.DEPTH_INVALID: _eye,
    Reason.POSE_LOST: _question,
    Reason.SENSOR_STALE: _broken,
    Reason.CAMERA_MOVED: _tilted,
    Reason.LOOKS_AWAY: _look_ahead,
    Reason.NO_ROUTE: _no_goal,
    Reason.PAUSED: _bars,
}
"""What is shown under the sign *Stop*; arriving has a sign of its own."""

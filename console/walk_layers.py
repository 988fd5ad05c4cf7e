"""Where on the map something happened in a walk, or in several together: cells of half a metre, and stops."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable

import msgspec
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from console.walk_marks import Mark, disagreeing, led, on_the_way, steps_s, weak
from console.walk_timeline import WalkTimeline
from navcore.geometry import FloatArray

CELL_M = 0.5
NEAR_M = 1.5
"""Something that stands nearer than this in the walker's way is an obstacle worth a place on the map."""


class DeviationCell(msgspec.Struct, frozen=True, array_like=True):
    """A place on the road, and how far from it people walked there."""

    x_m: float
    y_m: float
    mean_m: float
    max_m: float
    count: int
    """Cycles."""


class TimeCell(msgspec.Struct, frozen=True, array_like=True):
    """A place, and for how long something was the case there."""

    x_m: float
    y_m: float
    seconds: float


class StopSpot(msgspec.Struct, frozen=True, array_like=True):
    """Where somebody was told to stop, for how long, and why."""

    x_m: float
    y_m: float
    seconds: float
    why: str


class Layers(msgspec.Struct, frozen=True):
    """What is drawn over the map."""

    deviation: tuple[DeviationCell, ...] = ()
    weak: tuple[TimeCell, ...] = ()
    """Where the place in the map was not known for sure."""
    disagreement: tuple[TimeCell, ...] = ()
    """Where the rangefinder heard what the depth camera did not see."""
    obstacles: tuple[TimeCell, ...] = ()
    """Where something stood in the way."""
    stops: tuple[StopSpot, ...] = ()


def layers_of(timeline: WalkTimeline, marks: tuple[Mark, ...]) -> Layers:
    """Return where things happened in a walk."""
    at_m = _positions(timeline)
    dt_s = steps_s(timeline)
    ahead_m = timeline.numbers["nearest_ahead_m"]
    heading_rad = timeline.numbers["heading_rad"]
    in_the_way = at_m + ahead_m[:, None] * np.stack([np.cos(heading_rad), np.sin(heading_rad)], axis=1)
    return Layers(
        deviation=_deviations(timeline, at_m),
        weak=_times(at_m, dt_s, weak(timeline)),
        disagreement=_times(at_m, dt_s, disagreeing(timeline)),
        obstacles=_times(in_the_way, dt_s, led(timeline) & (ahead_m < NEAR_M)),
        stops=tuple(
            StopSpot(mark.x_m, mark.y_m, mark.length_s, mark.text)
            for mark in marks
            if mark.kind == "stop" and mark.x_m is not None and mark.y_m is not None
        ),
    )


def together(layers: Iterable[Layers]) -> Layers:
    """Return the layers of several walks as one."""
    layers = tuple(layers)
    return Layers(
        deviation=_joined_deviations(cell for each in layers for cell in each.deviation),
        weak=_joined_times(cell for each in layers for cell in each.weak),
        disagreement=_joined_times(cell for each in layers for cell in each.disagreement),
        obstacles=_joined_times(cell for each in layers for cell in each.obstacles),
        stops=tuple(spot for each in layers for spot in each.stops),
    )


def _positions(timeline: WalkTimeline) -> FloatArray:
    """Return (n, 2) where the walker was, or was last known to be; NaN before that."""
    at_m = np.stack([timeline.numbers["x_m"], timeline.numbers["y_m"]], axis=1).astype(np.float64)
    newest = np.maximum.accumulate(np.where(np.isfinite(at_m[:, 0]), np.arange(len(at_m)), 0))
    return at_m[newest]


def _deviations(timeline: WalkTimeline, at_m: FloatArray) -> tuple[DeviationCell, ...]:
    """Return the deviations at those places of the route that were nearest to the walker."""
    deviation_m = timeline.numbers["deviation_m"]
    counts = on_the_way(timeline) & np.isfinite(deviation_m) & np.isfinite(at_m[:, 0])
    cells: defaultdict[tuple[int, int], list[float]] = defaultdict(list)
    stamps_s = [route.stamp_s for route in timeline.routes]
    route_of = np.searchsorted(stamps_s, timeline.stamps_s, side="right") - 1
    for number, route in enumerate(timeline.routes):
        here = np.flatnonzero(counts & (route_of == number))
        if not route.points_m or not len(here):
            continue
        points_m = np.array(route.points_m)
        nearest = points_m[cKDTree(points_m).query(at_m[here])[1]]
        for cell, value_m in zip(_cells(nearest), deviation_m[here].tolist(), strict=True):
            cells[cell].append(value_m)
    return tuple(
        DeviationCell(*_centre(cell), float(np.mean(values)), max(values), len(values))
        for cell, values in sorted(cells.items())
    )


def _times(at_m: FloatArray, dt_s: FloatArray, mask: NDArray[np.bool_]) -> tuple[TimeCell, ...]:
    mask = mask & np.isfinite(at_m).all(axis=1)
    return _summed(zip(_cells(at_m[mask]), dt_s[mask].tolist(), strict=True))


def _joined_times(cells: Iterable[TimeCell]) -> tuple[TimeCell, ...]:
    return _summed((_cells(np.array([[cell.x_m, cell.y_m]]))[0], cell.seconds) for cell in cells)


def _summed(seconds: Iterable[tuple[tuple[int, int], float]]) -> tuple[TimeCell, ...]:
    sums: defaultdict[tuple[int, int], float] = defaultdict(float)
    for cell, lasted_s in seconds:
        sums[cell] += lasted_s
    return tuple(TimeCell(*_centre(cell), lasted_s) for cell, lasted_s in sorted(sums.items()) if lasted_s > 0.0)


def _joined_deviations(cells: Iterable[DeviationCell]) -> tuple[DeviationCell, ...]:
    by_place: defaultdict[tuple[float, float], list[DeviationCell]] = defaultdict(list)
    for cell in cells:
        by_place[cell.x_m, cell.y_m].append(cell)
    return tuple(_joined(here) for _, here in sorted(by_place.items()))


def _joined(here: list[DeviationCell]) -> DeviationCell:
    count = sum(cell.count for cell in here)
    mean_m = sum(cell.mean_m * cell.count for cell in here) / count
    return DeviationCell(here[0].x_m, here[0].y_m, mean_m, max(cell.max_m for cell in here), count)


def _cells(points_m: FloatArray) -> list[tuple[int, int]]:
    return [(x, y) for x, y in np.floor(points_m / CELL_M).astype(int).tolist()]


def _centre(cell: tuple[int, int]) -> tuple[float, float]:
    return (cell[0] + 0.5) * CELL_M, (cell[1] + 0.5) * CELL_M

"""The figures of a past walk in the paper's form, by leg as well, and all that is kept of it for lists and maps.

Deviations are those that the device has computed itself from its own position (the paper's come from a motion-capture
system): of the cycles in which somebody was led and went on by themselves.
"""

from __future__ import annotations

import math

import msgspec
import numpy as np
from numpy.typing import NDArray

from console.timeline import NamedPlace
from console.walk_layers import Layers, layers_of
from console.walk_marks import STANDING_M_S, Mark, led, marks_of, on_the_way, steps_s
from console.walk_timeline import WalkTimeline
from navcore.deviation import DeviationFigures
from navcore.modes import Mode
from navcore.tagging import is_made_name
from navcore.wire import RouteChanged

_STEP_M = 0.3
"""Length of path is counted in steps of this size, so that the position's own noise does not add to it."""
_NEAR_PLACE_M = 3.0
"""What is so near to a place is there."""
_BEGINS_NEAR_M = 5.0
"""Who begins to be led so near to a place that somebody has named begins there: places lie beside the road."""


class Deviation(msgspec.Struct, frozen=True):
    """:class:`navcore.deviation.DeviationFigures` as JSON has it: None where nothing is known."""

    max_m: float | None
    mean_m: float | None
    variance_m2: float | None

    @staticmethod
    def of(deviation_m: NDArray[np.float32]) -> Deviation:
        """Return the figures of distances (n,), metres."""
        found = DeviationFigures.of(deviation_m.astype(np.float64))
        return Deviation(known(found.max_m), known(found.mean_m), known(found.variance_m2))


class Leg(msgspec.Struct, frozen=True):
    """A part of a walk: up to the next place on the route."""

    to: str
    seconds: float
    standing_s: float
    deviation: Deviation


class WalkFigures(msgspec.Struct, frozen=True):
    """What is told of a walk in a list, and compared with others."""

    from_place: str
    to_place: str
    arrived: bool
    outcome: str
    """How it ended, in words."""
    seconds: float
    """In which somebody was led."""
    standing_s: float
    """Of these, how long they stood."""
    path_m: float
    route_m: float | None
    """Length of the first route."""
    deviation: Deviation
    stop_count: int
    weak_s: float
    off_road_s: float
    disagreement_s: float
    legs: tuple[Leg, ...]


class WalkFound(msgspec.Struct, frozen=True):
    """All that is kept of a walk, so that its files need not be read again for a list or a map."""

    parts: tuple[str, ...]
    """Names of the files that it was found in."""
    figures: WalkFigures
    layers: Layers
    version: int


FOUND_VERSION = 3
"""Of what is found and how; what another version has found is found anew."""


def found_in(timeline: WalkTimeline) -> WalkFound:
    """Return what is kept of a walk."""
    marks = marks_of(timeline)
    parts = tuple(path.name for path in timeline.walk.parts)
    return WalkFound(parts, figures_of(timeline, marks), layers_of(timeline, marks), FOUND_VERSION)


def figures_of(timeline: WalkTimeline, marks: tuple[Mark, ...]) -> WalkFigures:
    """Return the figures of a walk."""
    was_led, dt_s = led(timeline), steps_s(timeline)
    routes = [route for route in timeline.routes if route.points_m]
    arrived = bool(timeline.is_word("mode", Mode.ARRIVED).any()) and bool(was_led.any())

    def lasted_s(kind: str) -> float:
        return sum(mark.length_s for mark in marks if mark.kind == kind)

    return WalkFigures(
        from_place=_from_place(timeline, routes),
        to_place=_to_place(timeline, routes),
        arrived=arrived,
        outcome=_outcome(timeline, arrived),
        seconds=float(dt_s[was_led].sum()),
        standing_s=float(dt_s[was_led & standing(timeline)].sum()),
        path_m=_path_m(timeline),
        route_m=_route_m(routes[0]) if routes else None,
        deviation=Deviation.of(timeline.numbers["deviation_m"][on_the_way(timeline)]),
        stop_count=sum(mark.kind == "stop" for mark in marks),
        weak_s=lasted_s("weak"),
        off_road_s=lasted_s("off_road"),
        disagreement_s=lasted_s("disagreement"),
        legs=_legs(timeline),
    )


def standing(timeline: WalkTimeline) -> NDArray[np.bool_]:
    """Return (n,) whether the walker stood; where the speed is not known, whether they were told to."""
    speed_m_s = timeline.numbers["speed_m_s"]
    return np.where(np.isnan(speed_m_s), timeline.is_word("action", "stop"), speed_m_s < STANDING_M_S)


def known(value: float) -> float | None:
    """Return a number, or None for one that is none."""
    return value if math.isfinite(value) else None


def _from_place(timeline: WalkTimeline, routes: list[RouteChanged]) -> str:
    if not routes:
        return ""
    named = tuple(place for place in timeline.places if not is_made_name(place.name))
    away_m, name = _nearest(named, routes[0].points_m[0])
    if away_m <= _BEGINS_NEAR_M:
        return name
    if routes[0].stops and routes[0].stops[0][1] < _NEAR_PLACE_M and len(routes[0].stops) > 1:
        return routes[0].stops[0][0]
    return _place_near(timeline, routes[0].points_m[0])


def _to_place(timeline: WalkTimeline, routes: list[RouteChanged]) -> str:
    if not routes:
        return ""
    # A few steps back, to look again, lead to no place.
    last = next((route for route in reversed(routes) if route.stops), routes[-1])
    return last.stops[-1][0] if last.stops else _place_near(timeline, last.points_m[-1])


def _place_near(timeline: WalkTimeline, point_m: tuple[float, float]) -> str:
    """Return the name of the place at a point; coordinates where there is none."""
    away_m, name = _nearest(timeline.places, point_m)
    return name if away_m <= _NEAR_PLACE_M else f"({point_m[0]:.1f}, {point_m[1]:.1f})"


def _nearest(places: tuple[NamedPlace, ...], point_m: tuple[float, float]) -> tuple[float, str]:
    """Return how far away the nearest place is, metres, and its name; infinity where there is none."""
    away = [(math.dist(point_m, (place.x_m, place.y_m)), place.name) for place in places]
    return min(away, default=(math.inf, ""))


def _outcome(timeline: WalkTimeline, arrived: bool) -> str:
    if arrived:
        return "Arrived."
    last_led = np.flatnonzero(led(timeline))
    if not len(last_led):
        return "Nobody was led."
    if last_led[-1] < len(timeline.stamps_s) - 1:
        return "Ended on the way."
    return f"The recording ends on the way: {timeline.sentence_at(len(timeline.stamps_s) - 1)}"


def _path_m(timeline: WalkTimeline) -> float:
    walked = led(timeline) & np.isfinite(timeline.numbers["x_m"])
    path_m, last = 0.0, None
    for x_m, y_m in zip(timeline.numbers["x_m"][walked], timeline.numbers["y_m"][walked], strict=True):
        if last is None:
            last = (x_m, y_m)
        elif (step_m := math.hypot(x_m - last[0], y_m - last[1])) >= _STEP_M:
            path_m, last = path_m + step_m, (x_m, y_m)
    return path_m


def _route_m(route: RouteChanged) -> float:
    points_m = np.array(route.points_m)
    return float(np.hypot(*np.diff(points_m, axis=0).T).sum())


def _legs(timeline: WalkTimeline) -> tuple[Leg, ...]:
    """Return the figures up to each next place; a new route goes on with the place that comes next on it."""
    went, dt_s, stood = on_the_way(timeline), steps_s(timeline), standing(timeline)
    names = _next_places(timeline)
    legs = []
    for name in dict.fromkeys(name for name in names if name):
        mask = went & np.array([each == name for each in names])
        if mask.any():
            seconds, standing_s = float(dt_s[mask].sum()), float(dt_s[mask & stood].sum())
            legs.append(Leg(name, seconds, standing_s, Deviation.of(timeline.numbers["deviation_m"][mask])))
    return tuple(legs)


def _next_places(timeline: WalkTimeline) -> list[str]:
    """Return for each cycle (n,) the place that came next; empty where nobody was led."""
    names = [""] * len(timeline.stamps_s)
    begins = [route.stamp_s for route in timeline.routes] + [math.inf]
    for route, begin_s, end_s in zip(timeline.routes, begins, begins[1:], strict=False):
        if not route.points_m:
            continue
        stops = route.stops or ((_place_near(timeline, route.points_m[-1]), _route_m(route)),)
        ends_m = np.array([distance_m for _, distance_m in stops])
        for index in np.flatnonzero((timeline.stamps_s >= begin_s) & (timeline.stamps_s < end_s)):
            remaining_m = timeline.numbers["remaining_m"][index]
            if np.isfinite(remaining_m):
                ahead = int(np.searchsorted(ends_m, ends_m[-1] - remaining_m + 1e-6, side="right"))
                names[index] = stops[min(ahead, len(stops) - 1)][0]
    return names

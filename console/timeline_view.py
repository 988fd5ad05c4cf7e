"""What the player shows of a stretch of the past, as plain data for JSON; times are seconds from its beginning."""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np
from fastapi import Query

from console.errors import BadRequestError
from console.live_panel import device_view
from console.timeline import Timeline
from console.walk_figures import known
from console.walk_marks import Mark, on_the_way

MAX_INSTANTS = 120
_CURVE_POINTS = 1200
_TRAIL_POINTS = 3000
MAX_TIME_S = 1e9
"""No stretch of the past is longer."""
From = Annotated[float, Query(alias="from", ge=0.0, le=MAX_TIME_S, allow_inf_nan=False)]
To = Annotated[float, Query(alias="to", ge=0.0, le=MAX_TIME_S, allow_inf_nan=False)]
Step = Annotated[float, Query(alias="step", ge=0.02, le=60.0, allow_inf_nan=False)]
At = Annotated[float, Query(ge=0.0, le=MAX_TIME_S, allow_inf_nan=False)]


def whole_view(timeline: Timeline, marks: tuple[Mark, ...]) -> dict[str, Any]:
    """Return what the player shows of all of it."""
    return {
        "length_s": timeline.ended_s - timeline.began_s,
        "cycle_s": float(np.median(np.diff(timeline.stamps_s))) if len(timeline.stamps_s) > 1 else 0.1,
        "marks": marks,
        "curve": _curve(timeline),
        "trail": _trail(timeline),
        "routes": [
            {"at_s": route.stamp_s - timeline.began_s, "points_m": route.points_m[::5] + route.points_m[-1:]}
            for route in timeline.routes
        ],
        "places": timeline.places,
        "roads": timeline.roads,
        "troubles": timeline.troubles,
    }


def _curve(timeline: Timeline) -> list[tuple[float, float | None]]:
    """Return the deviation over time: seconds and metres, of each stretch its largest; None where it is not known."""
    deviation_m = np.where(on_the_way(timeline), timeline.numbers["deviation_m"], np.nan)
    bins = np.array_split(np.arange(len(deviation_m)), min(_CURVE_POINTS, len(deviation_m)))
    points = []
    for here in bins:
        values = deviation_m[here][np.isfinite(deviation_m[here])]
        at_s = float(timeline.stamps_s[here[0]]) - timeline.began_s
        points.append((at_s, float(values.max()) if len(values) else None))
    return points


def _trail(timeline: Timeline) -> list[tuple[float, float, float, float | None]]:
    """Return where the walker was: seconds, metres, and the deviation there."""
    at = np.flatnonzero(np.isfinite(timeline.numbers["x_m"]))
    at = at[:: max(1, len(at) // _TRAIL_POINTS)]
    x_m, y_m, off_m = (timeline.numbers[name][at].tolist() for name in ("x_m", "y_m", "deviation_m"))
    times_s = (timeline.stamps_s[at] - timeline.began_s).tolist()
    return [(t, x, y, known(off)) for t, x, y, off in zip(times_s, x_m, y_m, off_m, strict=True)]


def instants_view(timeline: Timeline, begin_s: float, end_s: float, step_s: float) -> list[dict[str, Any]]:
    """Return single instants, ``view`` as the live stream shows a device. Raises BadRequestError, NotFoundError."""
    return [_instant(timeline, at_s) for at_s in _times(begin_s, end_s, step_s)]


def _instant(timeline: Timeline, at_s: float) -> dict[str, Any]:
    stamp_s = min(timeline.began_s + at_s, timeline.ended_s)
    view = device_view(timeline.device_at(stamp_s), stamp_s)
    depth_stamp_s = timeline.depth_stamp_s(stamp_s)
    return {
        "at_s": stamp_s - timeline.began_s,
        "depth_at_s": None if depth_stamp_s is None else max(0.0, depth_stamp_s - timeline.began_s),
        "view": view,
    }


def _times(begin_s: float, end_s: float, step_s: float) -> list[float]:
    """Return the times that are asked for. Raises BadRequestError where they are too many."""
    count = int((end_s - begin_s) / step_s + 1e-6) + 1 if end_s >= begin_s else 0
    if not 1 <= count <= MAX_INSTANTS:
        raise BadRequestError(f"These are {count} instants: ask for 1 to {MAX_INSTANTS} at a time.")
    return [begin_s + number * step_s for number in range(count)]

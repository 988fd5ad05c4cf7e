"""The API of past walks: the list, one walk with its marks, its instants, comparisons, overlays and tables."""

from __future__ import annotations

import csv
import io
import time
from collections.abc import Iterable
from typing import Annotated, Any

import numpy as np
from fastapi import FastAPI, Query
from fastapi.responses import Response

from console.errors import BadRequestError
from console.live_panel import device_view
from console.past_walks import PastWalk
from console.requests import Visitor, json_response
from console.services import Services
from console.walk_comparison import Compared, compared_with
from console.walk_figures import WalkFigures, known
from console.walk_layers import together
from console.walk_library import WalkLibrary, walks_named
from console.walk_marks import marks_of, on_the_way
from console.walk_timeline import WalkTimeline

MAX_INSTANTS = 120
MAX_CHOSEN = 200
"""Walks in one overlay or table."""
_CURVE_POINTS = 1200
_TRAIL_POINTS = 3000
Ids = Annotated[list[str], Query(max_length=MAX_CHOSEN)]


def add_routes(app: FastAPI, services: Services) -> None:
    """Add the routes."""
    _add_list_routes(app, services)
    _add_walk_routes(app, services)


def note_access(services: Services, who: str, walk: PastWalk) -> None:
    """Write down who has looked at somebody's walk: the walker can hear it."""
    for device_id in services.devices.ids_of(walk.device) or (walk.device,):
        services.access.note(who, "past_walk", device_id, walk.walk_id, walk.began_at_s)


def note_list(services: Services, who: str) -> None:
    """Write down who has looked at the list of all walks: when somebody walked is theirs as well."""
    services.access.note(who, "past_walk", detail="the list of walks")


def _add_list_routes(app: FastAPI, services: Services) -> None:
    library = services.walk_library

    @app.get("/api/walks")
    def walks(visitor: Visitor) -> Response:
        note_list(services, visitor.user_name)
        here = library.walks.all()
        library.forget_deleted(here)
        return json_response({"walks": [_row(library, walk) for walk in here]})

    @app.get("/api/walk-overlays")
    def overlays(visitor: Visitor, walk: Ids) -> Response:
        chosen = walks_named(library, walk)
        for each in chosen:
            note_access(services, visitor.user_name, each)
        found = [library.found(each) for each in chosen]
        layers = together(each.layers for each in found if each is not None)
        return json_response({"layers": layers, "walk_count": len(found), "reading_count": found.count(None)})

    @app.get("/api/walk-figures.csv")
    def figures(visitor: Visitor, walk: Ids) -> Response:
        chosen = walks_named(library, walk)
        for each in chosen:
            note_access(services, visitor.user_name, each)
        lines = [(each, found.figures) for each in chosen if (found := library.found(each)) is not None]
        return _csv_response(figures_csv(lines))


def _add_walk_routes(app: FastAPI, services: Services) -> None:
    library = services.walk_library

    @app.get("/api/walks/{walk_id}")
    def one(visitor: Visitor, walk_id: str) -> Response:
        walk = library.walks.named(walk_id)
        timeline = library.timeline(walk)
        note_access(services, visitor.user_name, walk)
        return json_response(
            _walk_view(timeline) | {"summary": _row(library, walk), "compared": _compared(library, walk)}
        )

    @app.get("/api/walks/{walk_id}/instants")
    def instants(
        visitor: Visitor,
        walk_id: str,
        begin_s: Annotated[float, Query(alias="from", ge=0.0)],
        end_s: Annotated[float, Query(alias="to", ge=0.0)],
        step_s: Annotated[float, Query(alias="step", ge=0.02, le=60.0)] = 0.1,
    ) -> Response:
        walk = library.walks.named(walk_id)
        timeline = library.timeline(walk)
        note_access(services, visitor.user_name, walk)
        return json_response({"instants": [_instant(timeline, at_s) for at_s in _times(begin_s, end_s, step_s)]})

    @app.get("/api/walks/{walk_id}/depth.jpg")
    def depth(visitor: Visitor, walk_id: str, at: Annotated[float, Query(ge=0.0)]) -> Response:
        walk = library.walks.named(walk_id)
        timeline = library.timeline(walk)
        note_access(services, visitor.user_name, walk)
        return Response(timeline.depth_jpeg(timeline.began_s + at), media_type="image/jpeg")


# ------------------------------------------------------------------------------------------------------------ views
def _row(library: WalkLibrary, walk: PastWalk) -> dict[str, Any]:
    found = library.found(walk)
    trouble = library.trouble(walk)
    return {
        "walk_id": walk.walk_id,
        "device": walk.device,
        "began_at_s": walk.began_at_s,
        "length_s": walk.length_s,
        "size_bytes": walk.size_bytes,
        "has_pictures": walk.has_pictures,
        "map_checksum": walk.map_checksum,
        "troubles": [*walk.troubles, trouble] if trouble and not walk.troubles else walk.troubles,
        "reading": found is None and not trouble,
        "figures": None if found is None else found.figures,
    }


def _walk_view(timeline: WalkTimeline) -> dict[str, Any]:
    """Return what the player shows of a whole walk; times are seconds from its beginning."""
    return {
        "length_s": timeline.ended_s - timeline.began_s,
        "cycle_s": float(np.median(np.diff(timeline.stamps_s))) if len(timeline.stamps_s) > 1 else 0.1,
        "marks": marks_of(timeline),
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


def _curve(timeline: WalkTimeline) -> list[tuple[float, float | None]]:
    """Return the deviation over time: seconds and metres, of each stretch its largest; None where it is not known."""
    deviation_m = np.where(on_the_way(timeline), timeline.numbers["deviation_m"], np.nan)
    bins = np.array_split(np.arange(len(deviation_m)), min(_CURVE_POINTS, len(deviation_m)))
    points = []
    for here in bins:
        values = deviation_m[here][np.isfinite(deviation_m[here])]
        at_s = float(timeline.stamps_s[here[0]]) - timeline.began_s
        points.append((at_s, float(values.max()) if len(values) else None))
    return points


def _trail(timeline: WalkTimeline) -> list[tuple[float, float, float, float | None]]:
    """Return where the walker was: seconds, metres, and the deviation there."""
    at = np.flatnonzero(np.isfinite(timeline.numbers["x_m"]))
    at = at[:: max(1, len(at) // _TRAIL_POINTS)]
    x_m, y_m, off_m = (timeline.numbers[name][at].tolist() for name in ("x_m", "y_m", "deviation_m"))
    times_s = (timeline.stamps_s[at] - timeline.began_s).tolist()
    return [(t, x, y, known(off)) for t, x, y, off in zip(times_s, x_m, y_m, off_m, strict=True)]


def _instant(timeline: WalkTimeline, at_s: float) -> dict[str, Any]:
    stamp_s = min(timeline.began_s + at_s, timeline.ended_s)
    view = device_view(timeline.device_at(stamp_s), stamp_s)
    depth_stamp_s = view["depth_stamp_s"]
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


def _compared(library: WalkLibrary, walk: PastWalk) -> Compared | None:
    """Return a walk beside the earlier ones of the same way; None while it is being read."""
    figures = [(each, found.figures) for each in library.walks.all() if (found := library.found(each)) is not None]
    return compared_with(walk, figures)


# ---------------------------------------------------------------------------------------------------------- tables
_COLUMNS = (
    "walk", "device", "date", "from", "to", "arrived", "outcome", "seconds", "standing_s", "path_m", "route_m",
    "deviation_max_m", "deviation_mean_m", "deviation_variance_m2", "stops", "weak_s", "off_road_s", "disagreement_s",
)  # fmt: skip
_LEADS_TO_FORMULA = ("=", "+", "-", "@", "\t", "\r")


def figures_csv(walks: Iterable[tuple[PastWalk, WalkFigures]]) -> str:
    """Return the figures of walks as a table, one line each."""
    out = io.StringIO(newline="")
    writer = csv.writer(out)
    writer.writerow(_COLUMNS)
    for walk, figures in walks:
        date = time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime(walk.began_at_s))
        writer.writerow([_cell(value) for value in (
            walk.walk_id, walk.device, date, figures.from_place, figures.to_place, "yes" if figures.arrived else "no",
            figures.outcome, figures.seconds, figures.standing_s, figures.path_m, figures.route_m,
            figures.deviation.max_m, figures.deviation.mean_m, figures.deviation.variance_m2, figures.stop_count,
            figures.weak_s, figures.off_road_s, figures.disagreement_s,
        )])  # fmt: skip
    return out.getvalue()


def _cell(value: str | float | None) -> str | float:
    """Return a cell; a text that a spreadsheet would take for a formula stays a text."""
    if value is None:
        return ""
    if isinstance(value, str):
        return f"'{value}" if value.startswith(_LEADS_TO_FORMULA) else value
    return round(value, 4)


def _csv_response(text: str) -> Response:
    return Response(
        text, media_type="text/csv; charset=utf-8", headers={"Content-Disposition": 'attachment; filename="walks.csv"'}
    )

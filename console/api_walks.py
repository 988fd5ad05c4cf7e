"""The API of past walks: the list, one walk with its marks, its instants, comparisons, overlays and tables."""

from __future__ import annotations

import csv
import io
import time
from collections.abc import Iterable
from typing import Annotated, Any

from fastapi import FastAPI, Query
from fastapi.responses import Response

from console.described import answers_with
from console.past_walks import PastWalk
from console.requests import Visitor, json_response
from console.services import Services
from console.timeline_view import At, From, Step, To, instants_view, whole_view
from console.walk_comparison import Compared, compared_with
from console.walk_figures import WalkFigures
from console.walk_layers import together
from console.walk_library import WalkLibrary, walks_named
from console.walk_marks import marks_of

MAX_CHOSEN = 200
"""Walks in one overlay or table."""
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

    @app.get("/api/walk-figures.csv", response_class=Response, responses=answers_with("text/csv"))
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
            whole_view(timeline, marks_of(timeline))
            | {"summary": _row(library, walk), "compared": _compared(library, walk)}
        )

    @app.get("/api/walks/{walk_id}/instants")
    def instants(
        visitor: Visitor,
        walk_id: str,
        begin_s: From,
        end_s: To,
        step_s: Step = 0.1,
    ) -> Response:
        walk = library.walks.named(walk_id)
        timeline = library.timeline(walk)
        note_access(services, visitor.user_name, walk)
        return json_response({"instants": instants_view(timeline, begin_s, end_s, step_s)})

    @app.get("/api/walks/{walk_id}/depth.jpg", response_class=Response, responses=answers_with("image/jpeg"))
    def depth(visitor: Visitor, walk_id: str, at: At) -> Response:
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


def _compared(library: WalkLibrary, walk: PastWalk) -> Compared | None:
    """Return a walk beside the earlier ones of the same way; None while it is being read."""
    figures = [(each, found.figures) for each in library.walks.all() if (found := library.found(each)) is not None]
    return compared_with(walk, figures)


# ---------------------------------------------------------------------------------------------------------- tables
_COLUMNS = (
    "walk", "device", "date", "from", "to", "arrived", "outcome", "seconds", "standing_s", "path_m", "route_m",
    "deviation_max_m", "deviation_mean_m", "deviation_variance_m2", "stops", "weak_s", "off_road_s", "disagreement_s",
)  # fmt: skip
_LEADS_TO_FORMULA = ("=", "+", "-", "@", "\t", "\r", "\n", "\uff1d", "\uff0b", "\uff0d", "\uff20")
"""The last four are the wide forms, which some spreadsheets read as the narrow ones. OWASP, CSV injection."""


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

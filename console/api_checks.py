"""The API of the checker, and of the floor plan."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

from fastapi import FastAPI, Query, Response

from console.map_geometry.floor_plan import floor_plan
from console.map_geometry.floor_plan_svg import floor_plan_svg
from console.map_geometry.occupancy import Occupancy
from console.map_geometry.plan_layout import PlanPlace, Theme
from console.model import SiteModel
from console.requests import json_response
from console.services import Services
from console.surveys import Surveys
from navcore.geometry import FloatArray
from navcore.map_check.evidence import is_silent

WAIT_S = 10.0
"""A plan that takes longer is asked for again: a browser should not be left without a word."""
BRIEFLY_S = 0.4
"""What is done by then is answered at once, without a progress bar."""


def add_routes(app: FastAPI, services: Services) -> None:
    """Add the routes."""
    checks = services.checks

    @app.get("/api/check")
    def state() -> Response:
        return json_response(checks.state())

    @app.post("/api/check")
    def start() -> Response:
        checks.start()
        return json_response(checks.wait(BRIEFLY_S))

    @app.get("/api/floor-plan.png")
    def plan(theme: Annotated[Theme, Query()] = "light") -> Response:
        drawn = floor_plan(*_shown(services.model, services.surveys), theme)
        # Where the picture lies in the map, for programs that lay it under something else.
        headers = {
            "X-Metres-Per-Pixel": f"{drawn.metres_per_pixel:.6f}",
            "X-Left-Metres": f"{drawn.x_min_m:.4f}",
            "X-Top-Metres": f"{drawn.y_max_m:.4f}",
        }
        return Response(drawn.png, media_type="image/png", headers=headers)

    @app.get("/api/floor-plan.svg")
    def plan_as_svg(theme: Annotated[Theme, Query()] = "light") -> Response:
        return Response(floor_plan_svg(*_shown(services.model, services.surveys), theme), media_type="image/svg+xml")


def _shown(
    model: SiteModel, surveys: Surveys
) -> tuple[Occupancy, FloatArray, Sequence[FloatArray], Sequence[PlanPlace]]:
    """Return what the plan of the draft shows; places that are announced choose first where their names go.

    Raises ConflictError while the map is being measured, MappingError where it cannot be.
    """
    survey, graph = surveys.survey(WAIT_S), model.graph
    pois = sorted(graph.pois.values(), key=lambda poi: (is_silent(poi), poi.id))
    places = [PlanPlace(poi.name, poi.x_m, poi.y_m) for poi in pois]
    return survey.occupancy, survey.walls_m, model.network.polylines(), places

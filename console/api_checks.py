"""The API of the checker, and of the floor plan."""

from __future__ import annotations

from typing import Annotated

from fastapi import FastAPI, Query, Response

from console.checks import edited_roads_m
from console.map_geometry.floor_plan import FloorPlan, PlanPlace, Theme, floor_plan
from console.model import SiteModel
from console.requests import json_response
from console.services import Services
from console.surveys import Surveys
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
        drawn = plan_of(services.model, services.surveys, theme)
        # Where the picture lies in the map, for programs that lay it under something else.
        headers = {
            "X-Metres-Per-Pixel": f"{drawn.metres_per_pixel:.6f}",
            "X-Left-Metres": f"{drawn.x_min_m:.4f}",
            "X-Top-Metres": f"{drawn.y_max_m:.4f}",
        }
        return Response(drawn.png, media_type="image/png", headers=headers)


def plan_of(model: SiteModel, surveys: Surveys, theme: Theme) -> FloorPlan:
    """Draw the plan of the draft; places that are announced choose first where their names go.

    Raises ConflictError while the map is being measured, MappingError where it cannot be.
    """
    survey, graph = surveys.survey(WAIT_S), model.graph
    pois = sorted(graph.pois.values(), key=lambda poi: (is_silent(poi), poi.id))
    places = [PlanPlace(poi.name, poi.x_m, poi.y_m) for poi in pois]
    roads_m = edited_roads_m(graph) or model.network.polylines()
    return floor_plan(survey.occupancy, survey.walls_m, roads_m, places, theme)

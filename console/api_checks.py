"""The API of the checker, and of the floor plan."""

from __future__ import annotations

from typing import Annotated

from fastapi import FastAPI, Query, Response

from console.described import answers_with
from console.floor_plans import FloorPlans
from console.map_geometry.plan_layout import Theme
from console.requests import json_response
from console.services import Services

BRIEFLY_S = 0.4
"""What is done by then is answered at once, without a progress bar."""


def add_routes(app: FastAPI, services: Services) -> None:
    """Add the routes."""
    checks, plans = services.checks, FloorPlans(services.model, services.surveys)

    @app.get("/api/check")
    def state() -> Response:
        return json_response(checks.state())

    @app.post("/api/check")
    def start() -> Response:
        checks.start()
        return json_response(checks.wait(BRIEFLY_S))

    @app.get("/api/floor-plan.png", response_class=Response, responses=answers_with("image/png"))
    def plan(theme: Annotated[Theme, Query()] = "light") -> Response:
        drawn = plans.picture(theme)
        # Where the picture lies in the map, for programs that lay it under something else.
        headers = {
            "X-Metres-Per-Pixel": f"{drawn.metres_per_pixel:.6f}",
            "X-Left-Metres": f"{drawn.x_min_m:.4f}",
            "X-Top-Metres": f"{drawn.y_max_m:.4f}",
        }
        return Response(drawn.png, media_type="image/png", headers=headers)

    @app.get("/api/floor-plan.svg", response_class=Response, responses=answers_with("image/svg+xml"))
    def plan_as_svg(theme: Annotated[Theme, Query()] = "light") -> Response:
        return Response(plans.drawing(theme), media_type="image/svg+xml")

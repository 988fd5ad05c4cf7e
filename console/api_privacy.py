"""The API of privacy: colour pictures that a walker allows, who has looked, and how long things are kept."""

from __future__ import annotations

from typing import Any

from fastapi import FastAPI, Response

from console.api_devices import asked
from console.bodies import AskColourBody, DaysBody
from console.described import answers_with
from console.errors import BadRequestError
from console.requests import Visitor, json_response
from console.retention import DEFAULT_DAYS, MAX_DAYS, MIN_DAYS
from console.services import Services

ACCESSES_SHOWN_COUNT = 200


def add_routes(app: FastAPI, services: Services) -> None:
    """Add the routes."""
    _add_colour_routes(app, services)
    _add_retention_routes(app, services)


def _add_colour_routes(app: FastAPI, services: Services) -> None:
    @app.post("/api/devices/{device_id}/colour", status_code=202)
    def ask_colour(visitor: Visitor, device_id: str, body: AskColourBody) -> Response:
        why = " ".join(body.why.split())
        if not why.isprintable():
            raise BadRequestError("This reason cannot be said to the walker: write letters and digits.")
        return asked(services.hub.ask_colour(device_id, why, visitor.user_name))

    @app.get("/api/devices/{device_id}/colour.jpg", response_class=Response, responses=answers_with("image/jpeg"))
    def colour_image(visitor: Visitor, device_id: str) -> Response:
        image = services.hub.colour_image(device_id, visitor.user_name)
        services.watching.looked(visitor.user_name, device_id)
        return Response(image.jpeg, media_type="image/jpeg")


def _add_retention_routes(app: FastAPI, services: Services) -> None:
    retention = services.retention

    @app.get("/api/privacy")
    def privacy() -> Response:
        return json_response(_view(services))

    @app.post("/api/privacy/days")
    def keep_for(visitor: Visitor, body: DaysBody) -> Response:
        retention.keep_for(body.days, visitor.user_name)
        return json_response(_view(services))

    @app.post("/api/privacy/delete")
    def delete(visitor: Visitor) -> Response:
        retention.delete_now(visitor.user_name)
        return json_response(_view(services))


def _view(services: Services) -> dict[str, Any]:
    names = {device.device_id: device.name for device in services.hub.devices()}
    return {
        "days": services.retention.days,
        "default_days": DEFAULT_DAYS,
        "min_days": MIN_DAYS,
        "max_days": MAX_DAYS,
        "last_run": services.retention.last_run,
        "accesses": [
            {
                "who": entry.who,
                "what": entry.what,
                "device": names.get(entry.device_id, entry.device_id),
                "detail": entry.detail,
                "about_s": entry.about_s,
                "began_at_s": entry.began_at_s,
                "ended_at_s": entry.ended_at_s,
            }
            for entry in services.access.latest(ACCESSES_SHOWN_COUNT)
        ],
    }

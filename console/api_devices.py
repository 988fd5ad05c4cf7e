"""The API of devices as people use it: lead the walker, pause, say something."""

from __future__ import annotations

from fastapi import FastAPI, Response

from console.bodies import DestinationBody, SayBody
from console.described import answers_with
from console.errors import BadRequestError, NotFoundError
from console.live import Command
from console.requests import Visitor, json_response
from console.services import Services


def add_routes(app: FastAPI, services: Services) -> None:
    """Add the routes."""
    _add_command_routes(app, services)
    _add_map_walk_routes(app, services)


def asked(command: Command) -> Response:
    """Return the answer to a command that has gone to its device."""
    return json_response({"command": command}, 202)


def _add_command_routes(app: FastAPI, services: Services) -> None:
    hub = services.hub

    @app.post("/api/devices/{device_id}/destination", status_code=202)
    def destination(visitor: Visitor, device_id: str, body: DestinationBody) -> Response:
        if body.poi_id not in services.model.published.pois:
            raise NotFoundError("There is no such place in the published map: publish the draft first.")
        return asked(hub.set_destination(device_id, body.poi_id, visitor.user_name))

    @app.post("/api/devices/{device_id}/clear", status_code=202)
    def clear(visitor: Visitor, device_id: str) -> Response:
        return asked(hub.clear(device_id, visitor.user_name))

    @app.post("/api/devices/{device_id}/pause", status_code=202)
    def pause(visitor: Visitor, device_id: str) -> Response:
        return asked(hub.pause(device_id, visitor.user_name))

    @app.post("/api/devices/{device_id}/resume", status_code=202)
    def resume(visitor: Visitor, device_id: str) -> Response:
        return asked(hub.resume(device_id, visitor.user_name))

    @app.post("/api/devices/{device_id}/repeat", status_code=202)
    def repeat(visitor: Visitor, device_id: str) -> Response:
        return asked(hub.repeat(device_id, visitor.user_name))

    @app.post("/api/devices/{device_id}/say", status_code=202)
    def say(visitor: Visitor, device_id: str, body: SayBody) -> Response:
        text = " ".join(body.text.split())
        if not text or not text.isprintable():
            raise BadRequestError("There is nothing to say in this message: write a sentence.")
        return asked(hub.say(device_id, text, visitor.user_name))

    @app.get("/api/devices/{device_id}/depth.jpg", response_class=Response, responses=answers_with("image/jpeg"))
    def depth_image(visitor: Visitor, device_id: str) -> Response:
        image = hub.device(device_id).depth_image
        services.watching.looked(visitor.user_name, device_id)
        if image is None:
            raise NotFoundError("This device has sent no depth image yet.")
        return Response(image.jpeg, media_type="image/jpeg")


def _add_map_walk_routes(app: FastAPI, services: Services) -> None:
    hub = services.hub

    @app.post("/api/devices/{device_id}/map-walk/begin", status_code=202)
    def begin(visitor: Visitor, device_id: str) -> Response:
        return asked(hub.begin_map_walk(device_id, visitor.user_name))

    @app.post("/api/devices/{device_id}/map-walk/end", status_code=202)
    def end(visitor: Visitor, device_id: str) -> Response:
        return asked(hub.end_map_walk(device_id, visitor.user_name))

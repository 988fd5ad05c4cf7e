"""The API of devices as people use it: lead the walker, pause, say something, tune."""

from __future__ import annotations

from typing import Any

from fastapi import FastAPI, Response

from console.bodies import DestinationBody, SayBody, SettingsBody
from console.errors import BadRequestError, NotFoundError
from console.live import Command, LiveDevice
from console.requests import Visitor, json_response
from console.services import Services
from navcore.settings import SettingSpec, setting_specs

REVISIONS_SHOWN_COUNT = 30


def add_routes(app: FastAPI, services: Services) -> None:
    """Add the routes."""
    _add_command_routes(app, services)
    _add_map_walk_routes(app, services)
    _add_settings_routes(app, services)


def asked(command: Command) -> Response:
    """Return the answer to a command that has gone to its device."""
    return json_response({"command": command}, 202)


def _add_command_routes(app: FastAPI, services: Services) -> None:
    hub = services.hub

    @app.post("/api/devices/{device_id}/destination")
    def destination(visitor: Visitor, device_id: str, body: DestinationBody) -> Response:
        if body.poi_id not in services.model.published.pois:
            raise NotFoundError("There is no such place in the published map: publish the draft first.")
        return asked(hub.set_destination(device_id, body.poi_id, visitor.user_name))

    @app.post("/api/devices/{device_id}/clear")
    def clear(visitor: Visitor, device_id: str) -> Response:
        return asked(hub.clear(device_id, visitor.user_name))

    @app.post("/api/devices/{device_id}/pause")
    def pause(visitor: Visitor, device_id: str) -> Response:
        return asked(hub.pause(device_id, visitor.user_name))

    @app.post("/api/devices/{device_id}/resume")
    def resume(visitor: Visitor, device_id: str) -> Response:
        return asked(hub.resume(device_id, visitor.user_name))

    @app.post("/api/devices/{device_id}/repeat")
    def repeat(visitor: Visitor, device_id: str) -> Response:
        return asked(hub.repeat(device_id, visitor.user_name))

    @app.post("/api/devices/{device_id}/say")
    def say(visitor: Visitor, device_id: str, body: SayBody) -> Response:
        text = " ".join(body.text.split())
        if not text or not text.isprintable():
            raise BadRequestError("There is nothing to say in this message: write a sentence.")
        return asked(hub.say(device_id, text, visitor.user_name))

    @app.get("/api/devices/{device_id}/depth.jpg")
    def depth_image(visitor: Visitor, device_id: str) -> Response:
        image = hub.device(device_id).depth_image
        services.watching.looked(visitor.user_name, device_id)
        if image is None:
            raise NotFoundError("This device has sent no depth image yet.")
        return Response(image.jpeg, media_type="image/jpeg")


def _add_map_walk_routes(app: FastAPI, services: Services) -> None:
    hub = services.hub

    @app.post("/api/devices/{device_id}/map-walk/begin")
    def begin(visitor: Visitor, device_id: str) -> Response:
        return asked(hub.begin_map_walk(device_id, visitor.user_name))

    @app.post("/api/devices/{device_id}/map-walk/end")
    def end(visitor: Visitor, device_id: str) -> Response:
        return asked(hub.end_map_walk(device_id, visitor.user_name))


def _add_settings_routes(app: FastAPI, services: Services) -> None:
    specs = {"settings": [_spec_view(spec) for spec in setting_specs()]}

    @app.get("/api/settings")
    def settings() -> Response:
        return json_response(specs)

    @app.get("/api/devices/{device_id}/settings")
    def device_settings(device_id: str) -> Response:
        return json_response(_settings_view(services, services.hub.device(device_id)))

    @app.patch("/api/devices/{device_id}/settings")
    def change_settings(visitor: Visitor, device_id: str, body: SettingsBody) -> Response:
        command = services.tuning.change(device_id, body.changes, visitor.user_name, body.why, confirmed=body.confirmed)
        return json_response({"command": command, **_settings_view(services, services.hub.device(device_id))}, 202)


def _settings_view(services: Services, device: LiveDevice) -> dict[str, Any]:
    return {
        "values": services.tuning.running_values(device),
        "told_by_device": device.settings is not None,
        "revision": device.settings_revision,
        "revisions": [
            {
                "revision": r.revision,
                "author": r.author,
                "at_s": r.at_s,
                "why": r.why,
                "changes": r.changes,
                "state": r.state,
                "refusal": r.refusal,
            }
            for r in services.devices.revisions(device.device_id, REVISIONS_SHOWN_COUNT)
        ],
    }


def _spec_view(spec: SettingSpec) -> dict[str, Any]:
    fields = ("group", "group_title", "name", "kind", "unit", "default", "low", "high", "step", "choices", "source")
    view = {name: getattr(spec, name) for name in fields}
    return {"key": spec.key, "safety": spec.safety, "meaning": spec.meaning, "range": spec.range_text(), **view}

"""The API of settings: what there is, what a device runs, changing and keeping it, presets."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from fastapi import FastAPI, Response

from console.bodies import (
    BackToBody,
    KeepBody,
    PresetFileBody,
    PresetNameBody,
    SavePresetBody,
    SettingsBody,
)
from console.live import LiveDevice
from console.presets import Preset
from console.requests import Visitor, json_response
from console.services import Services
from console.settings_store import SettingsRevision
from console.tuning import TRIAL_S, Confirmation
from navcore.settings import ORDERS, Settings, SettingSpec, setting_specs

REVISIONS_SHOWN_COUNT = 30


def add_routes(app: FastAPI, services: Services) -> None:
    """Add the routes."""
    _add_reading_routes(app, services)
    _add_changing_routes(app, services)
    _add_preset_routes(app, services)


def _add_reading_routes(app: FastAPI, services: Services) -> None:
    specs = {
        "settings": [_spec_view(spec) for spec in setting_specs()],
        "orders": [asdict(order) for order in ORDERS],
        "trial_s": TRIAL_S,
    }

    @app.get("/api/settings")
    def settings() -> Response:
        return json_response(specs)

    @app.get("/api/devices/{device_id}/settings")
    def device_settings(device_id: str) -> Response:
        return json_response(_settings_view(services, services.hub.device(device_id)))


def _add_changing_routes(app: FastAPI, services: Services) -> None:
    tuning, hub = services.tuning, services.hub

    @app.patch("/api/devices/{device_id}/settings", status_code=202)
    def change_settings(visitor: Visitor, device_id: str, body: SettingsBody) -> Response:
        command = tuning.change(device_id, body.changes, visitor.user_name, _confirmation(body), body.seen_revision)
        return json_response({"command": command, **_settings_view(services, hub.device(device_id))}, 202)

    @app.post("/api/devices/{device_id}/settings/back", status_code=202)
    def back(visitor: Visitor, device_id: str, body: BackToBody) -> Response:
        command = tuning.back_to(device_id, body.revision, visitor.user_name, _confirmation(body), body.seen_revision)
        return json_response({"command": command, **_settings_view(services, hub.device(device_id))}, 202)

    @app.post("/api/devices/{device_id}/settings/keep", status_code=202)
    def keep(visitor: Visitor, device_id: str, body: KeepBody) -> Response:
        command = tuning.keep(device_id, body.revision, visitor.user_name, keep=body.keep)
        return json_response({"command": command}, 202)


def _add_preset_routes(app: FastAPI, services: Services) -> None:
    presets = services.presets

    @app.get("/api/settings/presets")
    def all_presets() -> Response:
        return json_response({"presets": [_preset_view(preset) for preset in presets.all()]})

    @app.get("/api/settings/presets/{name}")
    def export(name: str) -> Response:
        answer = json_response(presets.named(name).as_file())
        answer.headers["Content-Disposition"] = 'attachment; filename="preset.json"'
        return answer

    @app.post("/api/settings/presets", status_code=201)
    def save(visitor: Visitor, body: SavePresetBody) -> Response:
        values = body.values or services.tuning.told_values(body.device_id)
        return json_response({"preset": _preset_view(presets.save(body.name, values, visitor.user_name))}, 201)

    @app.post("/api/settings/presets/import", status_code=201)
    def import_preset(visitor: Visitor, body: PresetFileBody) -> Response:
        return json_response({"preset": _preset_view(presets.save(body.name, body.values, visitor.user_name))}, 201)

    @app.patch("/api/settings/presets/{name}")
    def rename(visitor: Visitor, name: str, body: PresetNameBody) -> Response:
        return json_response({"preset": _preset_view(presets.rename(name, body.name, visitor.user_name))})

    @app.delete("/api/settings/presets/{name}")
    def delete(visitor: Visitor, name: str) -> Response:
        presets.delete(name, visitor.user_name)
        return json_response({})


def _confirmation(body: SettingsBody | BackToBody) -> Confirmation:
    return Confirmation(body.why, body.confirmed, " ".join(body.override_reason.split()), body.trial_s)


def _settings_view(services: Services, device: LiveDevice) -> dict[str, Any]:
    revisions = services.settings.revisions(device.device_id, REVISIONS_SHOWN_COUNT)
    return {
        "values": services.tuning.running_values(device),
        "told_by_device": device.settings is not None,
        "revision": device.settings_revision,
        "revisions": [_revision_view(each, device) for each in revisions],
    }


def _revision_view(revision: SettingsRevision, device: LiveDevice) -> dict[str, Any]:
    fields = ("revision", "author", "at_s", "why", "changes", "refusal", "revert_after_s", "override_reason")
    view = {name: getattr(revision, name) for name in fields}
    known = Settings().values()
    view["values"] = {key: value for key, value in revision.values.items() if key in known}
    view["state"] = "unanswered" if revision.state == "sent" and not _is_awaited(revision, device) else revision.state
    return view


def _is_awaited(revision: SettingsRevision, device: LiveDevice) -> bool:
    """Whether the device may still answer."""
    return any(
        command.kind == "apply_settings" and command.state == "sent" and command.detail == str(revision.revision)
        for command in device.commands
    )


def _preset_view(preset: Preset) -> dict[str, Any]:
    fields = ("name", "values", "about", "author", "at_s", "built_in")
    return {name: getattr(preset, name) for name in fields}


def _spec_view(spec: SettingSpec) -> dict[str, Any]:
    fields = (
        "key", "group", "group_title", "name", "kind", "unit", "default", "low", "high", "step", "choices", "source",
        "safety", "meaning", "paper", "replayed",
    )  # fmt: skip
    return {name: getattr(spec, name) for name in fields} | {"range": spec.range_text()}

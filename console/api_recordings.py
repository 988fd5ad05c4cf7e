"""The API of recordings: devices send them, people see them and have maps built of them."""

from __future__ import annotations

from typing import Any

from fastapi import FastAPI, Request, Response
from starlette.concurrency import run_in_threadpool

from console.bodies import Number
from console.described import FILE_BODY, NO_ROOM, json_body
from console.recordings import StoredRecording, offer_of
from console.requests import Visitor, json_response
from console.services import Services
from navcore.recording_upload import OFFERS_PATH, RecordingOffer


def add_routes(app: FastAPI, services: Services) -> None:
    """Add the routes."""
    _add_device_routes(app, services)
    _add_people_routes(app, services)


def _add_device_routes(app: FastAPI, services: Services) -> None:
    recordings = services.recordings

    @app.post(OFFERS_PATH, responses=NO_ROOM, openapi_extra=json_body(RecordingOffer))
    async def offer(request: Request) -> Response:
        offered = offer_of(await request.body())
        return json_response(await run_in_threadpool(recordings.offer, offered, str(request.state.device_name)))

    @app.put(OFFERS_PATH + "/{sha256}", responses=NO_ROOM, openapi_extra=FILE_BODY)
    async def piece(request: Request, sha256: str, offset: Number) -> Response:
        return json_response(await run_in_threadpool(recordings.add, sha256, offset, await request.body()))


def _add_people_routes(app: FastAPI, services: Services) -> None:
    @app.get("/api/recordings")
    def recordings() -> Response:
        return json_response({"recordings": [_view(services, stored) for stored in services.recordings.all()]})

    @app.post("/api/recordings/{sha256}/map", status_code=202)
    def build(visitor: Visitor, sha256: str) -> Response:
        services.builds.start(sha256, visitor.user_name)
        services.store.audit(visitor.user_name, "build_map", sha256)
        return json_response(_view(services, services.recordings.named(sha256)), 202)


def _view(services: Services, stored: StoredRecording) -> dict[str, Any]:
    entry = stored.entry
    built = entry.map
    return {
        "sha256": entry.offer.sha256,
        "kind": entry.offer.kind,
        "name": entry.offer.name,
        "date": entry.offer.date,
        "device": entry.device,
        "offered_at_s": entry.offered_at_s,
        "size_bytes": entry.offer.size_bytes,
        "have_bytes": stored.have_bytes,
        "complete": stored.complete,
        "file": str(stored.file),
        "map": {
            "stage": built.stage,
            "percent": services.builds.percent(entry.offer.sha256),
            "site": str((services.builds.folder / built.folder).resolve()) if built.stage == "built" else "",
            "reason": built.reason,
            "report": built.report,
        },
    }

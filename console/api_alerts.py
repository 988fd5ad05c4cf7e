"""The API of alerts, and of the incidents that are kept around them."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import FastAPI, Query, Response
from fastapi.responses import StreamingResponse

from console.alerts.alert_store import AlertRecord, AlertStep
from console.alerts.incident_bundle import bundle
from console.alerts.incidents import Cause
from console.alerts.rules import RULES
from console.bodies import AcknowledgeBody, EndWatchBody, ShelveBody
from console.described import NO_ROOM, answers_with
from console.incident_timeline import IncidentTimeline
from console.requests import Visitor, json_response
from console.services import Services
from console.timeline_view import At, From, Step, To, instants_view, whole_view

MOST_SHOWN_COUNT = 500
Count = Annotated[int, Query(ge=1, le=MOST_SHOWN_COUNT)]
DeviceId = Annotated[str | None, Query(max_length=120)]


def add_routes(app: FastAPI, services: Services) -> None:
    """Add the routes."""
    _add_alert_routes(app, services)
    _add_incident_routes(app, services)


def noted_timeline(services: Services, who: str, incident_id: str) -> IncidentTimeline:
    """Return an incident as a timeline, and write down who looks at it. Raises NotFoundError."""
    timeline = services.incident_timelines.named(incident_id)
    incident = timeline.incident
    services.access.note(who, "incident", incident.device_id, incident_id, incident.began_at_s)
    return timeline


def _add_alert_routes(app: FastAPI, services: Services) -> None:
    alerts = services.alerts

    @app.get("/api/alerts")
    def all_alerts(visitor: Visitor, device: DeviceId = None, count: Count = 100) -> Response:
        """What is not done with, and what was raised last, newest first."""
        services.access.note(visitor.user_name, "incident", device or "", "earlier alerts")
        recent = services.alert_store.recent(device, count)
        steps: dict[str, list[AlertStep]] = {}
        for each in services.alert_store.steps(record.alert_id for record in recent):
            steps.setdefault(each.alert_id, []).append(each)
        return json_response(
            {
                "active": alerts.views(device),
                "devices": _devices(services),
                "recent": [_record_view(record, steps.get(record.alert_id, [])) for record in recent],
            }
        )

    @app.post("/api/alerts/{alert_id}/acknowledge")
    def acknowledge(visitor: Visitor, alert_id: str, body: AcknowledgeBody | None = None) -> Response:
        alerts.acknowledge(alert_id, visitor.user_name, body.note.strip() if body is not None else "")
        return json_response({"active": alerts.views()})

    @app.post("/api/alerts/{alert_id}/shelve")
    def shelve(visitor: Visitor, alert_id: str, body: ShelveBody) -> Response:
        alerts.shelve(alert_id, body.minutes, visitor.user_name, body.reason.strip())
        return json_response({"active": alerts.views()})

    @app.post("/api/alerts/{alert_id}/unshelve")
    def unshelve(visitor: Visitor, alert_id: str) -> Response:
        alerts.unshelve(alert_id, visitor.user_name)
        return json_response({"active": alerts.views()})

    @app.post("/api/devices/{device_id}/end_watch")
    def end_watch(visitor: Visitor, device_id: str, body: EndWatchBody) -> Response:
        """Miss a device no more that led somebody and has gone."""
        alerts.end_watch(device_id, visitor.user_name, body.why.strip())
        return json_response({"active": alerts.views()})


def _add_incident_routes(app: FastAPI, services: Services) -> None:
    incidents = services.incidents

    @app.get("/api/incidents")
    def all_incidents(visitor: Visitor, device: DeviceId = None) -> Response:
        services.access.note(visitor.user_name, "incident", device or "", "the list of incidents")
        found = [each for each in incidents.all() if device is None or each.device_id == device]
        return json_response({"incidents": found})

    @app.get("/api/incidents/{incident_id}")
    def one(visitor: Visitor, incident_id: str) -> Response:
        """All that the player of past walks shows of it."""
        timeline = noted_timeline(services, visitor.user_name, incident_id)
        incident = timeline.incident
        summary = {
            "device": incident.device_name, "began_at_s": timeline.began_at_s,
            "length_s": timeline.ended_s - timeline.began_s, "has_pictures": timeline.has_pictures, "figures": None,
        }  # fmt: skip
        return json_response(
            whole_view(timeline, timeline.marks()) | {"summary": summary, "incident": incident, "compared": None}
        )

    @app.get("/api/incidents/{incident_id}/instants")
    def instants(visitor: Visitor, incident_id: str, begin_s: From, end_s: To, step_s: Step = 0.1) -> Response:
        return json_response(
            {
                "instants": instants_view(
                    noted_timeline(services, visitor.user_name, incident_id), begin_s, end_s, step_s
                )
            }
        )

    @app.get("/api/incidents/{incident_id}/depth.jpg", response_class=Response, responses=answers_with("image/jpeg"))
    def depth(visitor: Visitor, incident_id: str, at: At) -> Response:
        timeline = noted_timeline(services, visitor.user_name, incident_id)
        return Response(timeline.depth_jpeg(timeline.began_s + at), media_type="image/jpeg")

    @app.get(
        "/api/incidents/{incident_id}/bundle.zip", response_class=Response, responses=answers_with("application/zip")
    )
    def download(visitor: Visitor, incident_id: str) -> Response:
        incident = incidents.named(incident_id)
        alert_ids = [cause.alert_id for cause in incident.causes if cause.alert_id]
        made = bundle(incidents, incident_id, services.alert_store.named(alert_ids))
        services.access.note(visitor.user_name, "export", incident.device_id, incident_id, incident.began_at_s)
        services.store.audit(visitor.user_name, "incident_download", f"{incident.device_name} {incident_id}")
        headers = {"Content-Disposition": f'attachment; filename="{made.name}"', "Content-Length": str(made.size_bytes)}
        return StreamingResponse(made.pieces(), media_type=made.media_type, headers=headers)

    @app.delete("/api/incidents/{incident_id}")
    def delete(visitor: Visitor, incident_id: str) -> Response:
        incident = incidents.named(incident_id)
        incidents.delete(incident_id)
        services.incident_timelines.forget_deleted()
        services.store.audit(visitor.user_name, "incident_delete", f"{incident.device_name} {incident_id}")
        return json_response({})

    @app.post("/api/devices/{device_id}/keep", status_code=202, responses=NO_ROOM)
    def keep(visitor: Visitor, device_id: str) -> Response:
        """Keep what was heard of a device in the last half minute, and in the next."""
        cause = Cause(services.store.wall_s(), "asked", "Somebody has asked for it.", who=visitor.user_name)
        incident_id = incidents.keep(device_id, cause)
        services.store.audit(visitor.user_name, "incident_keep", f"{device_id} {incident_id}")
        return json_response({"incident_id": incident_id}, 202)


def _devices(services: Services) -> list[dict[str, Any]]:
    """Return the devices that can be asked about: those that have called, and those that have an alert."""
    found = {each.record.device_id: (each.record.device_name, False) for each in services.alerts.active()}
    found |= {device.device_id: (device.name, device.connected) for device in services.hub.devices()}
    return [{"id": key, "name": name, "connected": connected} for key, (name, connected) in sorted(found.items())]


def _record_view(record: AlertRecord, steps: list[AlertStep]) -> dict[str, Any]:
    first = next((step for step in steps if step.what.value == "acknowledged"), None)
    return {
        "id": record.alert_id,
        "device_id": record.device_id,
        "device": record.device_name,
        "kind": record.kind,
        "title": RULES[record.kind].title,
        "priority": record.priority.word,
        "sentence": record.sentence,
        "raised_at_s": record.raised_at_s,
        "times": record.times,
        "returned_at_s": record.returned_at_s,
        "closed_at_s": record.closed_at_s,
        "acknowledged_after_s": first.at_s - record.raised_at_s if first is not None else None,
        "acknowledged_by": first.who if first is not None else "",
        "note": record.note,
        "incident_id": record.incident_id,
        "steps": [{"at_s": s.at_s, "what": s.what.value, "who": s.who, "detail": s.detail} for s in steps],
    }

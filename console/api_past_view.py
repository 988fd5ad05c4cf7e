"""The API that shows an instant of the past in the 3D scene of whoever asks."""

from __future__ import annotations

from fastapi import FastAPI, Response

from console.api_alerts import noted_timeline
from console.api_walks import note_access
from console.bodies import PastViewBody
from console.errors import BadRequestError
from console.requests import Visitor, json_response
from console.services import Services
from console.timeline import Timeline
from console.view_requests import EndPast, ShowPast


def add_routes(app: FastAPI, services: Services) -> None:
    """Add the routes."""

    @app.post("/api/view/past")
    def show(visitor: Visitor, body: PastViewBody) -> Response:
        """Show it in the scenes of this session; return how many there are."""
        timeline = _timeline(services, body, visitor.user_name)
        stamp_s = min(timeline.began_s + body.at_s, timeline.ended_s)
        words = f"{'INCIDENT' if body.incident else 'PAST WALK'} {body.clock}"
        past = ShowPast(timeline.device_at(stamp_s), stamp_s, words, timeline.trail_until(stamp_s))
        return json_response({"scenes": services.views.ask(visitor.session_id, past)})

    @app.delete("/api/view/past")
    def end(visitor: Visitor) -> Response:
        return json_response({"scenes": services.views.ask(visitor.session_id, EndPast())})


def _timeline(services: Services, body: PastViewBody, who: str) -> Timeline:
    """Return what is asked for, and write down who looks at it. Raises BadRequestError, NotFoundError."""
    if bool(body.walk) == bool(body.incident):
        raise BadRequestError("Name a walk or an incident, and not both.")
    if body.incident:
        return noted_timeline(services, who, body.incident)
    walk = services.walk_library.walks.named(body.walk)
    note_access(services, who, walk)
    return services.walk_library.timeline(walk)

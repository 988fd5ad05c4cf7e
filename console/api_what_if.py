"""The API of what-if: past walks to choose from, asking, how far the answer is, giving up."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from fastapi import FastAPI, Response

from console.api_walks import note_access, note_list
from console.bodies import WhatIfBody
from console.past_walks import PastWalk
from console.requests import Visitor, json_response
from console.services import Services
from console.what_if import WhatIfRun


def add_routes(app: FastAPI, services: Services) -> None:
    """Add the routes."""
    what_ifs = services.what_ifs

    @app.get("/api/what-if/walks")
    def walks(visitor: Visitor) -> Response:
        note_list(services, visitor.user_name)
        return json_response({"walks": [_walk_view(walk) for walk in services.walks.all()]})

    @app.post("/api/what-if", status_code=202)
    def ask(visitor: Visitor, body: WhatIfBody) -> Response:
        note_access(services, visitor.user_name, services.walks.named(body.walk_id))
        return json_response(_run_view(what_ifs.start(body.walk_id, body.changes, body.last_s)), 202)

    @app.get("/api/what-if/{run_id}")
    def look(visitor: Visitor, run_id: str) -> Response:
        note_access(services, visitor.user_name, what_ifs.walk_of(run_id))
        return json_response(_run_view(what_ifs.run(run_id)))

    @app.delete("/api/what-if/{run_id}")
    def give_up(run_id: str) -> Response:
        return json_response(_run_view(what_ifs.cancel(run_id)))


def _walk_view(walk: PastWalk) -> dict[str, Any]:
    fields = ("walk_id", "device", "began_at_s", "length_s", "troubles")
    return {name: getattr(walk, name) for name in fields}


def _run_view(run: WhatIfRun) -> dict[str, Any]:
    fields = ("run_id", "walk_id", "changes", "last_s", "not_judged", "state", "percent", "why")
    result = None if run.result is None else asdict(run.result)
    return {name: getattr(run, name) for name in fields} | {"result": result}

"""The API of the draft's versions (names, differences, going back), and of who else is here."""

from __future__ import annotations

from typing import Any

from fastapi import FastAPI, Response

from console.api_graph import graph_view
from console.bodies import Number, PresenceBody, RollBackBody, VersionBody
from console.edit_words import described
from console.graph_delta import difference
from console.model import SiteModel
from console.presence import Present
from console.requests import RequestKey, Visitor, json_response
from console.services import Services
from navcore.plain_text import refuse_hidden


def add_routes(app: FastAPI, services: Services) -> None:
    """Add the routes."""
    model = services.model

    @app.get("/api/versions")
    def versions() -> Response:
        return json_response(versions_view(model))

    @app.post("/api/versions", status_code=201)
    def name_version(visitor: Visitor, body: VersionBody) -> Response:
        refuse_hidden("The name of this version", body.name)
        model.name_version(body.name.strip() or "Unnamed", visitor.user_name)
        return json_response(versions_view(model), 201)

    @app.get("/api/versions/{version}/difference")
    def version_difference(version: Number, to: Number | None = None) -> Response:
        """What leads from a version to another one; to the draft where none is named."""
        before = model.graph_at(version)
        after = model.graph if to is None else model.graph_at(to)
        changes = described(difference(before, after), before, after)
        return json_response({"from": version, "to": after.version, "changes": changes})

    @app.post("/api/versions/{version}/roll-back")
    def roll_back(
        visitor: Visitor, version: Number, body: RollBackBody | None = None, key: RequestKey = ""
    ) -> Response:
        model.roll_back(version, visitor.user_name, body.base_version if body is not None else None, key)
        return json_response(graph_view(model, visitor.user_name))

    @app.post("/api/presence")
    def presence(visitor: Visitor, body: PresenceBody) -> Response:
        if body.doing == "gone":
            services.presence.leave(visitor, body.window)
        else:
            thing = (body.kind, body.id) if body.kind is not None and body.id else None
            services.presence.say(visitor, body.window, "tables", body.doing, thing)
        others = services.presence.others(visitor.user_name)
        return json_response({"others": [presence_view(window) for window in others]})


def presence_view(window: Present) -> dict[str, Any]:
    """Return what others may know of a window: its session's name is nobody's business."""
    return {"user_name": window.user_name, "where": window.where, "doing": window.doing, "thing": window.thing}


def versions_view(model: SiteModel) -> dict[str, Any]:
    """Return every version that has a name or was published, newest first, and the draft's."""
    rows: list[dict[str, Any]] = [
        *({"version": n.version, "name": n.name, "author": n.author, "at_s": n.at_s} for n in model.named_versions()),
        *(
            {"version": p.version, "name": None, "author": p.author, "at_s": p.at_s, "published": True}
            for p in model.publications()
        ),
    ]
    rows.sort(key=lambda row: (row["version"], row["at_s"]), reverse=True)
    return {"draft": model.graph.version, "published": model.published.version, "versions": rows}

"""The API of the PoI-graph: the draft, its edits, undo and redo, publishing, and what the page asks of the scene."""

from __future__ import annotations

import itertools
import math
from typing import Any

import msgspec
from fastapi import FastAPI, Request, Response
from starlette.concurrency import run_in_threadpool

from console.bodies import Number, PublishBody, ViewBody
from console.described import json_body
from console.edit_words import sentence_of
from console.edits import Edit
from console.errors import BadRequestError, NotFoundError
from console.graph_log import LogEntry
from console.model import SiteModel
from console.publishing import publish
from console.requests import RequestKey, Visitor, json_response
from console.roles import EDITING
from console.services import Services
from console.view_requests import FlyToPoi, FlyToPoint, FollowDevice, MoveCamera, ViewRequest
from console.viewer.shortcuts import help_groups
from navcore.misfit import words_of
from navcore.planning.poi_graph import POI_KINDS, PoiGraph, Road

HISTORY_SHOWN_COUNT = 200
_edit_decoder: msgspec.json.Decoder[Edit] = msgspec.json.Decoder(Edit)


def add_routes(app: FastAPI, services: Services) -> None:
    """Add the routes."""
    model = services.model

    @app.get("/api/graph")
    def graph(visitor: Visitor) -> Response:
        return json_response(graph_view(model, visitor.user_name))

    @app.get("/api/history")
    def history() -> Response:
        return json_response({"history": [_entry_view(entry) for entry in model.history(HISTORY_SHOWN_COUNT)]})

    @app.post("/api/edits", openapi_extra=json_body(Edit))
    async def edit(
        request: Request, visitor: Visitor, base_version: Number | None = None, key: RequestKey = ""
    ) -> Response:
        """Make an edit; ``base_version`` is the version that the person saw."""
        wanted = decode_edit(await request.body())
        await run_in_threadpool(model.apply, wanted, visitor.user_name, base_version, key)
        return json_response(graph_view(model, visitor.user_name))

    @app.post("/api/undo")
    def undo(visitor: Visitor, key: RequestKey = "") -> Response:
        model.undo(visitor.user_name, key)
        return json_response(graph_view(model, visitor.user_name))

    @app.post("/api/redo")
    def redo(visitor: Visitor, key: RequestKey = "") -> Response:
        model.redo(visitor.user_name, key)
        return json_response(graph_view(model, visitor.user_name))

    @app.post("/api/publish")
    def publish_draft(visitor: Visitor, body: PublishBody | None = None) -> Response:
        confirmed = body.version if body is not None and body.confirmed else None
        publish(model, services.checks, visitor.user_name, confirmed_version=confirmed)
        return json_response(graph_view(model, visitor.user_name))

    @app.get("/api/shortcuts")
    def shortcuts(visitor: Visitor) -> Response:
        """The keys of the scene, for the pages' help."""
        return json_response({"groups": help_groups(visitor.role in EDITING)})

    @app.post("/api/view")
    def view(visitor: Visitor, body: ViewBody) -> Response:
        return json_response({"scenes": services.views.ask(visitor.session_id, _view_request(body, services))})


def _view_request(body: ViewBody, services: Services) -> ViewRequest:
    if sum(asked is not None for asked in (body.fly_to, body.point, body.follow, body.camera)) != 1:
        raise BadRequestError(
            "Ask the scene for one thing: a place or a point to fly to, a device to show, or a camera."
        )
    if body.camera is not None:
        return MoveCamera(body.camera)
    if body.point is not None:
        return FlyToPoint(*body.point, (body.kind, body.id) if body.kind is not None and body.id else None)
    if body.fly_to is not None:
        if body.fly_to not in services.model.graph.pois:
            raise NotFoundError("There is no such place: it may have been deleted meanwhile.")
        return FlyToPoi(body.fly_to)
    return FollowDevice(services.hub.device(body.follow or "").device_id)


def graph_view(model: SiteModel, who: str) -> dict[str, Any]:
    """Return the draft as pages show it, without the geometry of edges."""
    graph, published = model.graph, model.published
    return {
        "site": {"id": model.site.site_id, "name": model.site.name},
        "version": graph.version,
        "published_version": published.version,
        "can_undo": model.can_undo(who),
        "can_redo": model.can_redo(who),
        "kinds": POI_KINDS,
        "pois": list(graph.pois.values()),
        "edges": _edges_view(graph),
        "roads": [_road_view(road) for road in graph.roads.values()],
        "destinations": [
            {"id": poi.id, "name": poi.name, "kind": poi.kind} for poi in published.pois.values() if poi.on_road
        ],
    }


def _edges_view(graph: PoiGraph) -> list[dict[str, Any]]:
    fields = ("id", "a", "b", "length_m", "one_way", "closed", "cost_multiplier", "width_m", "caution_side")
    return [{name: getattr(edge, name) for name in fields} for edge in graph.edges.values()]


def _road_view(road: Road) -> dict[str, Any]:
    length_m = sum(itertools.starmap(math.dist, itertools.pairwise(road.points_m)))
    ends = {"start_m": road.points_m[0], "end_m": road.points_m[-1]}
    return {"id": road.id, "origin": road.origin, "length_m": length_m, **ends}


def _entry_view(entry: LogEntry) -> dict[str, Any]:
    return {
        "version": entry.version,
        "kind": entry.kind,
        "author": entry.author,
        "at_s": entry.at_s,
        "words": sentence_of(entry),
    }


def decode_edit(body: bytes) -> Edit:
    """Return the edit that a request holds. Raises BadRequestError."""
    try:
        return _edit_decoder.decode(body)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        raise BadRequestError(f"This edit cannot be made: {words_of(error)}.") from error

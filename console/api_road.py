"""What lets forms do what dragging does: places named by distances along the road, and edits seen beforehand."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from fastapi import FastAPI, Query, Request, Response
from starlette.concurrency import run_in_threadpool

from console.api_graph import decode_edit
from console.described import json_body
from console.edit_words import described
from console.edits import Edit
from console.errors import NotFoundError
from console.graph_delta import difference
from console.model import SiteModel
from console.requests import json_response
from console.services import Services
from navcore.planning.poi_graph import PoiGraph
from navcore.planning.road_network import RoadPoint
from navcore.planning.road_walk import place_along, place_towards

Key = Annotated[str, Query(min_length=1, max_length=64)]
Distance = Annotated[float, Query(ge=-10_000.0, le=10_000.0, allow_inf_nan=False)]


def add_routes(app: FastAPI, services: Services) -> None:
    """Add the routes."""
    model = services.model

    @app.get("/api/roads/place")
    def place_between(from_id: Key, towards_id: Key, distance_m: Distance) -> Response:
        """Where one stands after walking so far from a place towards another one; behind it where negative."""
        start, target = _road_point(model, from_id), _road_point(model, towards_id)
        return _place_response(place_towards(model.network, start, target, distance_m))

    @app.get("/api/roads/{road_id}/place")
    def place_on(road_id: str, distance_m: Distance) -> Response:
        """Where one stands after walking so far from a road's beginning."""
        road = model.graph.roads.get(road_id)
        if road is None:
            raise NotFoundError("There is no such road: it may have been deleted meanwhile.")
        return _place_response(place_along(np.array(road.points_m), distance_m))

    @app.post("/api/preview", openapi_extra=json_body(Edit))
    async def preview(request: Request) -> Response:
        """What an edit would change, in words; it changes nothing."""
        wanted = decode_edit(await request.body())
        before = model.graph
        after = await run_in_threadpool(model.preview, wanted)
        changes = described(difference(before, after), before, after)
        return json_response({"version": before.version, "changes": changes, "lengths_m": _lengths_m(after, changes)})


def _lengths_m(graph: PoiGraph, changes: list[dict[str, str]]) -> dict[str, float]:
    edges = (graph.edges.get(change["id"]) for change in changes if change["kind"] == "edge")
    return {edge.id: edge.length_m for edge in edges if edge is not None}


def _road_point(model: SiteModel, poi_id: str) -> RoadPoint:
    poi = model.graph.pois.get(poi_id)
    if poi is None:
        raise NotFoundError("There is no such place: it may have been deleted meanwhile.")
    return model.network.nearest(poi.x_m, poi.y_m)


def _place_response(place_m: tuple[float, float]) -> Response:
    return json_response({"x_m": place_m[0], "y_m": place_m[1]})

"""The API of export and import (docs/exchange.md): files to download, a graph into the draft, a site beside others."""

from __future__ import annotations

import asyncio
import hashlib
import math
import shlex
from collections.abc import AsyncIterator
from typing import Annotated, Any

from fastapi import FastAPI, Query, Request, Response
from fastapi.responses import StreamingResponse
from starlette.concurrency import run_in_threadpool

from console.described import FILE_BODY, NO_ROOM, answers_with
from console.edit_words import described
from console.errors import BadRequestError, ConflictError
from console.graph_delta import GraphDelta, difference
from console.requests import RequestKey, Visitor, json_response
from console.services import Services
from navcore.foreign_map import shown
from navcore.graph_import import imported
from navcore.planning.poi_graph import Poi, PoiGraph
from navcore.planning.road_network import RoadNetwork
from navcore.site_archive import MAX_ARCHIVE_BYTES

FileName = Annotated[str, Query(max_length=120)]
_PATIENCE_S = 60.0
_FAR_M = 50.0
"""No place of a building lies farther from all of its roads and places."""
Token = Annotated[str, Query(max_length=64, pattern="^[0-9a-f]*$")]


def add_routes(app: FastAPI, services: Services) -> None:
    """Add the routes."""

    @app.get("/api/export/{what}", response_class=Response, responses=answers_with("*/*") | NO_ROOM)
    def export(visitor: Visitor, what: str, published: bool = False) -> Response:
        made = services.exports.make(what, published=published)
        services.store.audit(visitor.user_name, "export", made.name)
        headers = {"Content-Disposition": f'attachment; filename="{made.name}"', "Content-Length": str(made.size_bytes)}
        return StreamingResponse(made.pieces(), media_type=made.media_type, headers=headers)

    @app.post("/api/import/graph", openapi_extra=FILE_BODY)
    async def import_graph(request: Request, visitor: Visitor, name: FileName = "", confirm: Token = "") -> Response:
        """Look at a file, and with the preview's token make it the draft."""
        # The rule of this route bounds it; a graph has to be whole before anything can be said of it.
        data = await request.body()
        return json_response(await run_in_threadpool(_import_graph, services, visitor.user_name, data, name, confirm))

    @app.post("/api/import/site", status_code=201, responses=NO_ROOM, openapi_extra=FILE_BODY)
    async def import_site(request: Request, visitor: Visitor, key: RequestKey = "") -> Response:
        """Take a site's archive in, piece by piece, and make it a site beside the others."""
        length = request.headers.get("content-length", "")
        size_bytes = int(length) if length.isdigit() else MAX_ARCHIVE_BYTES
        with services.site_imports.receiving(size_bytes) as archive:
            with archive.open("wb") as out:
                async for piece in _patiently(request.stream()):
                    await run_in_threadpool(out.write, piece)
            folder, manifest = await run_in_threadpool(services.site_imports.keep, archive, key)
        detail = f"{manifest.name} ({manifest.id[:16]}) to {folder}"
        await run_in_threadpool(services.store.audit, visitor.user_name, "import_site", detail)
        return json_response(
            {
                "site": str(folder),
                "name": manifest.name,
                "site_id": manifest.site_id,
                "id": manifest.id,
                "parent_id": manifest.parent_id,
                "graph_version": manifest.graph_version,
                "serve": f"vbr console --site {shlex.quote(str(folder))}",
            },
            201,
        )


async def _patiently(pieces: AsyncIterator[bytes]) -> AsyncIterator[bytes]:
    """Read a body from somebody who may have fallen silent: others wait for the place."""
    while True:
        try:
            async with asyncio.timeout(_PATIENCE_S):
                piece = await anext(pieces)
        except StopAsyncIteration:
            return
        except TimeoutError as error:
            raise BadRequestError("The rest of the file did not come: send it again.") from error
        yield piece


def _import_graph(services: Services, who: str, data: bytes, name: str, confirm: str) -> dict[str, Any]:
    model = services.model
    draft = model.graph
    found = imported(data, draft)
    token = _token_of(data, draft.version)
    changes = difference(draft, found.graph)
    # No draft has the same version twice, so the token is also the key of its request: who heard no answer asks again.
    if confirm and not model.was_made(who, confirm):
        if confirm != token:
            raise ConflictError(
                "The draft was changed since the preview, or this is another file: look again at what would change."
            )
        why = shown(name) or "a file"
        model.replace(found.graph, who, why=why, base_version=draft.version, request=confirm)
    return {
        "applied": bool(confirm),
        "token": token,
        "whole": found.is_whole,
        "draft_version": model.graph.version,
        "changes": described(changes, draft, found.graph),
        "unused": found.unused,
        "notes": (*found.notes, *_far_away(changes, draft, model.network)),
    }


def _far_away(changes: GraphDelta, draft: PoiGraph, network: RoadNetwork) -> tuple[str, ...]:
    """Say which new places lie so far from all that the draft has that they may be of another frame, or in degrees."""
    added = [new for old, new in changes.pois.values() if old is None and new is not None]
    if network.is_empty and not draft.pois:
        return ()
    far = [poi for poi in added if _distance_m(poi, draft, network) > _FAR_M]
    if not far:
        return ()
    more = f", and {len(far) - 1} more," if len(far) > 1 else ""
    verb = "lie" if len(far) > 1 else "lies"
    return (
        f"{far[0].name}{more} {verb} more than {_FAR_M:.0f} m from every road and place of this map: "
        "see whether the file’s coordinates are metres of this map.",
    )


def _distance_m(poi: Poi, draft: PoiGraph, network: RoadNetwork) -> float:
    to_roads = () if network.is_empty else (network.nearest(poi.x_m, poi.y_m).distance_m,)
    to_places = (math.hypot(poi.x_m - other.x_m, poi.y_m - other.y_m) for other in draft.pois.values())
    nearest_m: float = min((*to_roads, *to_places))
    return nearest_m


def _token_of(data: bytes, version: int) -> str:
    """Name a file and the draft that it was laid on: it says what was seen, and is no secret."""
    return hashlib.sha256(version.to_bytes(8, "big") + hashlib.sha256(data).digest()).hexdigest()

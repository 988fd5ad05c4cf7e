"""``/live/overview``: all devices at once for the page Overview, twice a second, and only what has changed since.

A hundred devices that send ten states a second cost the page as many small differences as they have changes to show;
no message holds more than ``ROWS_AT_ONCE_COUNT`` rows.
"""

from __future__ import annotations

import asyncio
from collections.abc import Iterator, Mapping
from itertools import islice
from typing import Any

import msgspec
from fastapi import FastAPI, WebSocket

from console.live_socket import LIMITS
from console.overview import Row, differences, overview_row
from console.page_stream import serve
from console.place_words import PlaceWords
from console.requests import signed_in
from console.services import Services
from console.watching import Window

EVERY_S = 0.5
"""With a device's own tenth of a second this stays well below what counts as delayed."""
ROWS_AT_ONCE_COUNT = 50


def add_routes(app: FastAPI, services: Services) -> None:
    """Add the route."""

    @app.websocket("/live/overview")
    async def overview(socket: WebSocket, says: bool = False) -> None:
        with services.watching.window(signed_in(socket).user_name, says=says) as window:
            await serve(socket, services, lambda: _stream(socket, services, window), window.shows)


async def _stream(socket: WebSocket, services: Services, window: Window) -> None:
    graph = services.model.published
    places = PlaceWords(graph)
    told: Mapping[str, Row] = {}
    while True:
        if services.model.published is not graph:
            graph = services.model.published
            places = PlaceWords(graph)
        now_s = services.hub.now_s()
        rows = {
            device.device_id: overview_row(
                device, graph, places, is_watched=window.sees(device.device_id) and device.has_told(now_s)
            )
            for device in services.hub.devices()
        }
        for message in messages(told, rows):
            picture = {"now_s": services.hub.now_s(), "limits": LIMITS, **message}
            await socket.send_text(msgspec.json.encode(picture).decode())
        told = rows
        await asyncio.sleep(EVERY_S)


def messages(told: Mapping[str, Row], rows: Mapping[str, Row]) -> Iterator[dict[str, Any]]:
    """Yield what tells the differences, at least one: a page that hears nothing cannot know that nothing changes.

    ``anew`` says that all rows are told, in this message and those that follow: what the page had is of before.
    """
    changed, gone = differences(told, rows)
    items = iter(changed.items())
    yield {"rows": dict(islice(items, ROWS_AT_ONCE_COUNT)), "gone": gone, "count": len(rows), "anew": not told}
    while batch := dict(islice(items, ROWS_AT_ONCE_COUNT)):
        yield {"rows": batch, "gone": [], "count": len(rows), "anew": False}

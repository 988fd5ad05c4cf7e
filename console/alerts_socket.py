"""``/live/alerts``: the alerts of all devices, streamed to every page: at each change, and every other second.

A page that hears nothing cannot know that there is no alert; it says so after a few seconds of silence.
"""

from __future__ import annotations

import asyncio
import contextlib

import msgspec
from fastapi import FastAPI, WebSocket

from console.page_stream import serve, set_from_any_thread
from console.services import Services

SHORTEST_S = 0.1
LONGEST_S = 2.0


def add_routes(app: FastAPI, services: Services) -> None:
    """Add the route."""

    @app.websocket("/live/alerts")
    async def alerts(socket: WebSocket) -> None:
        await serve(socket, services, lambda: _stream(socket, services))


async def _stream(socket: WebSocket, services: Services) -> None:
    changed, loop = asyncio.Event(), asyncio.get_running_loop()
    unsubscribe = services.alerts.subscribe(lambda: set_from_any_thread(loop, changed))
    try:
        while True:
            changed.clear()
            await socket.send_text(msgspec.json.encode({"alerts": services.alerts.views()}).decode())
            await asyncio.sleep(SHORTEST_S)
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(changed.wait(), LONGEST_S - SHORTEST_S)
    finally:
        unsubscribe()

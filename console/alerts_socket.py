"""``/live/alerts``: the alerts of all devices, streamed to every page: at each change, and every other second.

A page that hears nothing cannot know that there is no alert; it says so after a few seconds of silence. With them every
page is told whether the console's disk is full, and whoever can do something about it, where.
"""

from __future__ import annotations

import asyncio
import contextlib
from typing import Any

import msgspec
from fastapi import FastAPI, WebSocket

from console.page_stream import serve, set_from_any_thread
from console.requests import signed_in
from console.roles import MANAGING, Role
from console.services import Services

SHORTEST_S = 0.1
LONGEST_S = 2.0


def add_routes(app: FastAPI, services: Services) -> None:
    """Add the route."""

    @app.websocket("/live/alerts")
    async def alerts(socket: WebSocket) -> None:
        await serve(socket, services, lambda: _stream(socket, services))


async def _stream(socket: WebSocket, services: Services) -> None:
    role, changed, loop = signed_in(socket).role, asyncio.Event(), asyncio.get_running_loop()
    unsubscribe = services.alerts.subscribe(lambda: set_from_any_thread(loop, changed))
    try:
        while True:
            changed.clear()
            told = {"alerts": services.alerts.views(), "full_disk": _full_disk(services, role)}
            await socket.send_text(msgspec.json.encode(told).decode())
            await asyncio.sleep(SHORTEST_S)
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(changed.wait(), LONGEST_S - SHORTEST_S)
    finally:
        unsubscribe()


def _full_disk(services: Services, role: Role) -> dict[str, Any] | None:
    """Return what is told of a disk that is as good as full; None where there is room."""
    if not services.store.is_short_of_room:
        return None
    return {"folder": str(services.config.data_folder.resolve()) if role in MANAGING else ""}

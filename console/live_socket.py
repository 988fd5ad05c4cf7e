"""``/live``: what happens, streamed to the pages at no more than 10 Hz, and at least once a second.

Each message is the whole picture of that instant, so a slow browser skips what is old instead of falling behind.

A page opens it with ``?says=1``, and says every few seconds which devices it shows while somebody can see it:
``{"watching": [device_id, …]}``. Of these it is sent everything, and the walkers are told; of the others only that they
are there. What never says so is sent everything, and counts as watching everything.
"""

from __future__ import annotations

import asyncio
import contextlib
from typing import Any

import msgspec
from fastapi import FastAPI, WebSocket, WebSocketDisconnect

from console.api_versions import presence_view
from console.live import DELAYED_AFTER_S, LOST_AFTER_S, STALE_AFTER_S
from console.live_panel import device_view, unwatched_view
from console.requests import signed_in
from console.services import Services
from console.sockets import SIGNED_OUT_CODE
from console.watching import Watching

SHORTEST_S = 0.1
LONGEST_S = 1.0
MAX_SAID_LENGTH = 16 << 10


class Shown(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What a page says."""

    watching: tuple[str, ...]
    """Ids of the devices that it shows, while somebody can see it."""


def add_routes(app: FastAPI, services: Services) -> None:
    """Add the route."""

    @app.websocket("/live")
    async def live(socket: WebSocket) -> None:
        visitor = signed_in(socket)
        await socket.accept()
        window, watching, said = object(), services.watching, asyncio.Event()
        watching.opened(window, visitor.user_name, says=socket.query_params.get("says") == "1")
        tasks = [
            asyncio.create_task(_stream(socket, services, visitor.user_name, window, said)),
            asyncio.create_task(_listen(socket, watching, window, said)),
        ]
        loop = asyncio.get_running_loop()
        signed_out = asyncio.Event()
        forget = services.sockets.add(visitor.session_id, lambda: _set_from_any_thread(loop, signed_out))
        tasks.append(asyncio.create_task(_wait(signed_out)))
        try:
            await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        finally:
            forget()
            watching.closed(window)
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
            with contextlib.suppress(RuntimeError, WebSocketDisconnect):
                await socket.close(SIGNED_OUT_CODE if signed_out.is_set() else 1000)


def panel_view(services: Services, who: str, window: object) -> dict[str, Any]:
    """Return everything that a window shows to ``who`` at this instant."""
    now_s, model = services.hub.now_s(), services.model
    return {
        "draft_version": model.graph.version,
        "published_version": model.published.version,
        "people": [presence_view(window) | {"you": window.user_name == who} for window in services.presence.windows()],
        "can_undo": model.can_undo(who),
        "can_redo": model.can_redo(who),
        "map_checksum": services.package.checksum,
        "limits": {"delayed": DELAYED_AFTER_S, "stale": STALE_AFTER_S, "lost": LOST_AFTER_S},
        "devices": [
            (device_view if services.watching.sees(window, device.device_id) else unwatched_view)(device, now_s)
            for device in services.hub.devices()
        ],
    }


async def _stream(socket: WebSocket, services: Services, who: str, window: object, changed: asyncio.Event) -> None:
    loop = asyncio.get_running_loop()
    ends = [
        services.hub.subscribe(lambda _: _set_from_any_thread(loop, changed)),
        services.model.subscribe(lambda _: _set_from_any_thread(loop, changed)),
        services.presence.subscribe(lambda: _set_from_any_thread(loop, changed)),
    ]
    try:
        while True:
            changed.clear()
            await socket.send_text(msgspec.json.encode(panel_view(services, who, window)).decode())
            await asyncio.sleep(SHORTEST_S)
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(changed.wait(), LONGEST_S - SHORTEST_S)
    finally:
        for end in ends:
            end()


async def _listen(socket: WebSocket, watching: Watching, window: object, said: asyncio.Event) -> None:
    """Hear what a page shows; what is nothing of the kind ends the stream."""
    with contextlib.suppress(WebSocketDisconnect):
        while True:
            message = await socket.receive()
            if message["type"] == "websocket.disconnect":
                return
            text = message.get("text") or ""
            if len(text) > MAX_SAID_LENGTH:
                return
            try:
                shown = msgspec.json.decode(text, type=Shown)
            except (msgspec.MsgspecError, UnicodeEncodeError, RecursionError):
                return
            if watching.shows(window, frozenset(shown.watching)):
                said.set()


async def _wait(event: asyncio.Event) -> None:
    await event.wait()


def _set_from_any_thread(loop: asyncio.AbstractEventLoop, event: asyncio.Event) -> None:
    with contextlib.suppress(RuntimeError):
        loop.call_soon_threadsafe(event.set)

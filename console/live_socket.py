"""``/live``: what happens, streamed to the pages at no more than 10 Hz, and at least once a second.

Each message is the whole picture of that instant, so a slow browser skips what is old instead of falling behind.
"""

from __future__ import annotations

import asyncio
import contextlib
from typing import Any

import msgspec
from fastapi import FastAPI, WebSocket, WebSocketDisconnect

from console.api_versions import presence_view
from console.live import DELAYED_AFTER_S, LOST_AFTER_S, STALE_AFTER_S
from console.live_panel import device_view
from console.requests import signed_in
from console.services import Services
from console.sockets import SIGNED_OUT_CODE

SHORTEST_S = 0.1
LONGEST_S = 1.0


def add_routes(app: FastAPI, services: Services) -> None:
    """Add the route."""

    @app.websocket("/live")
    async def live(socket: WebSocket) -> None:
        visitor = signed_in(socket)
        await socket.accept()
        tasks = [
            asyncio.create_task(_stream(socket, services, visitor.user_name)),
            asyncio.create_task(_listen(socket)),
        ]
        loop = asyncio.get_running_loop()
        signed_out = asyncio.Event()
        forget = services.sockets.add(visitor.session_id, lambda: _set_from_any_thread(loop, signed_out))
        tasks.append(asyncio.create_task(_wait(signed_out)))
        try:
            await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        finally:
            forget()
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
            with contextlib.suppress(RuntimeError, WebSocketDisconnect):
                await socket.close(SIGNED_OUT_CODE if signed_out.is_set() else 1000)


def panel_view(services: Services, who: str) -> dict[str, Any]:
    """Return everything that the panel shows to ``who`` at this instant."""
    now_s, model = services.hub.now_s(), services.model
    devices, alerts = services.hub.devices(), services.alerts.views()
    return {
        "draft_version": model.graph.version,
        "published_version": model.published.version,
        "people": [presence_view(window) | {"you": window.user_name == who} for window in services.presence.windows()],
        "can_undo": model.can_undo(who),
        "can_redo": model.can_redo(who),
        "map_checksum": services.package.checksum,
        "limits": {"delayed": DELAYED_AFTER_S, "stale": STALE_AFTER_S, "lost": LOST_AFTER_S},
        "devices": [
            device_view(device, now_s, [alert for alert in alerts if alert["device_id"] == device.device_id])
            for device in devices
        ],
        # ``elsewhere``: of devices that have not called since the console started.
        "alerts": {
            "total": len(alerts),
            "unacknowledged": sum(alert["phase"] in ("unacknowledged", "returned") for alert in alerts),
            "elsewhere": [alert for alert in alerts if alert["device_id"] not in {each.device_id for each in devices}],
        },
    }


async def _stream(socket: WebSocket, services: Services, who: str) -> None:
    changed = asyncio.Event()
    loop = asyncio.get_running_loop()
    ends = [
        services.hub.subscribe(lambda _: _set_from_any_thread(loop, changed)),
        services.model.subscribe(lambda _: _set_from_any_thread(loop, changed)),
        services.presence.subscribe(lambda: _set_from_any_thread(loop, changed)),
        services.alerts.subscribe(lambda: _set_from_any_thread(loop, changed)),
    ]
    try:
        while True:
            changed.clear()
            await socket.send_text(msgspec.json.encode(panel_view(services, who)).decode())
            await asyncio.sleep(SHORTEST_S)
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(changed.wait(), LONGEST_S - SHORTEST_S)
    finally:
        for end in ends:
            end()


async def _listen(socket: WebSocket) -> None:
    # Pages say nothing here; reading is how their leaving is noticed.
    with contextlib.suppress(WebSocketDisconnect):
        while (await socket.receive())["type"] != "websocket.disconnect":
            pass


async def _wait(event: asyncio.Event) -> None:
    await event.wait()


def _set_from_any_thread(loop: asyncio.AbstractEventLoop, event: asyncio.Event) -> None:
    with contextlib.suppress(RuntimeError):
        loop.call_soon_threadsafe(event.set)

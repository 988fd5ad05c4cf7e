"""``/live``: what happens, streamed to the pages at no more than 30 Hz, and at least once a second.

Each message is the picture of that instant, so a slow browser skips what is old instead of falling behind; what seldom
changes (:mod:`console.live_pictures`, the roster) is in it only where the page has not been told it yet. A page that
shows one device is told of the others only who they are; ``/live/overview`` (:mod:`console.overview_socket`) is for
many at once.

A page opens it with ``says=1``, and says every few seconds which devices it shows while somebody can see it
(:class:`console.page_stream.Watches`). Of these it is sent everything, and the walkers are told; of the others only
that they are there. What never says so is sent all that it asks for, and counts as watching every device.
"""

from __future__ import annotations

import asyncio
import contextlib
from typing import Annotated, Any, Literal

import msgspec
from fastapi import FastAPI, Query, WebSocket

from console.alerts.lifecycle import Phase
from console.api_versions import presence_view
from console.hub import DeviceHub
from console.live import DELAYED_AFTER_S, LOST_AFTER_S, STALE_AFTER_S, LiveDevice
from console.live_pictures import LivePictures, Picture, Told
from console.page_stream import serve, set_from_any_thread
from console.requests import signed_in
from console.services import Services
from console.watching import Window
from navcore.wire_pace import Pace

RATE_HZ = 30.0
"""At most, for a page of one device. That tells its state at 20 Hz: at no more than that, what has once waited for its
turn would make all that follows wait as long.
"""
RATE_OF_MANY_HZ = 10.0
LONGEST_S = 1.0
LIMITS = {"delayed": DELAYED_AFTER_S, "stale": STALE_AFTER_S, "lost": LOST_AFTER_S}
Scope = Literal["all", "one", "none"]


def add_routes(app: FastAPI, services: Services) -> None:
    """Add the route."""
    pictures = LivePictures(services.alerts)
    services.hub.subscribe_forgotten(pictures.forget)

    @app.websocket("/live")
    async def live(
        socket: WebSocket,
        devices: Scope = "all",
        device: Annotated[str, Query(max_length=120)] = "",
        says: bool = False,
    ) -> None:
        shown = Shown(services.hub, devices, device)
        who = signed_in(socket).user_name
        with services.watching.window(who, says=says) as window:
            changed = asyncio.Event()

            def watches(device_ids: frozenset[str]) -> None:
                if window.shows(device_ids):
                    changed.set()

            await serve(
                socket, services, lambda: _stream(socket, services, pictures, who, shown, window, changed), watches
            )


class Shown:
    """The devices whose whole picture a page is given: all, none, or the one that it names.

    Where it names none, it keeps the one that it was given first, whoever comes: nobody finds another walker below
    their hands.
    """

    def __init__(self, hub: DeviceHub, scope: Scope, device_id: str = "") -> None:
        self._hub = hub
        self._scope = scope
        self._device_id = device_id
        self._told: list[dict[str, Any]] | None = None

    @property
    def rate_hz(self) -> float:
        """How often the page is told something, at most."""
        return RATE_HZ if self._scope == "one" else RATE_OF_MANY_HZ

    def concerns(self, device: LiveDevice) -> bool:
        """Say whether what a device tells is shown."""
        return self._scope == "all" or (self._scope == "one" and self._device_id in ("", device.device_id))

    def devices(self) -> tuple[LiveDevice, ...]:
        """Return the devices that are shown."""
        if self._scope == "none":
            return ()
        devices = self._hub.devices()
        if self._scope == "all":
            return devices
        if not self._device_id and devices:
            self._device_id = next((each for each in devices if each.connected), devices[0]).device_id
        return tuple(device for device in devices if device.device_id == self._device_id)

    def roster_news(self) -> dict[str, Any]:
        """Return who is there and which graph they run, where that is news to the page."""
        roster = [
            {
                "id": device.device_id,
                "name": device.name,
                "connected": device.connected,
                "graph_version": device.graph_version,
                "graph_refusal": device.graph_refusal,
            }
            for device in self._hub.devices()
        ]
        if roster == self._told:
            return {}
        self._told = roster
        return {"roster": roster}


def panel_view(services: Services, who: str, window: Window, pictures: list[Picture]) -> dict[str, Any]:
    """Return what the panel shows to ``who``: the devices, and what concerns them all.

    ``now_s`` is the time of the oldest picture: no age is told to be less than it is.
    """
    model = services.model
    standing = services.alerts.active()
    return {
        "now_s": min((each.made_s for each in pictures), default=services.hub.now_s()),
        "draft_version": model.graph.version,
        "published_version": model.published.version,
        "people": [presence_view(window) | {"you": window.user_name == who} for window in services.presence.windows()],
        "can_undo": model.can_undo(who),
        "can_redo": model.can_redo(who),
        "map_checksum": services.package.checksum,
        "limits": LIMITS,
        "devices": [each.changing for each in pictures],
        "alerts": {
            "total": len(standing),
            "unacknowledged": sum(each.phase in (Phase.UNACKNOWLEDGED, Phase.RETURNED) for each in standing),
        },
    }


async def _stream(
    socket: WebSocket,
    services: Services,
    pictures: LivePictures,
    who: str,
    shown: Shown,
    window: Window,
    changed: asyncio.Event,
) -> None:
    loop, told, pace = asyncio.get_running_loop(), Told(), Pace(shown.rate_hz)

    def wake(_: object = None) -> None:
        set_from_any_thread(loop, changed)

    ends = [
        services.hub.subscribe(lambda device: wake() if shown.concerns(device) else None),
        services.model.subscribe(wake),
        services.presence.subscribe(wake),
        services.alerts.subscribe(wake),
    ]
    try:
        while True:
            await asyncio.sleep(pace.wait_s(loop.time()))
            pace.went(loop.time())
            changed.clear()
            now_s = services.hub.now_s()
            seen = [pictures.of(each, now_s, is_watched=window.sees(each.device_id)) for each in shown.devices()]
            picture = panel_view(services, who, window, seen) | shown.roster_news() | told.news(seen)
            await socket.send_text(msgspec.json.encode(picture).decode())
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(changed.wait(), LONGEST_S)
    finally:
        for end in ends:
            end()

"""``/device``: the console's end of the link to a device, and the map that devices fetch.

A device is taken in by its token. Its events are stored before they are confirmed; it is given the graph, the map and
the settings where it runs others. What it sends cannot be read: the link is closed with the reason, nothing else stops.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
from dataclasses import dataclass

from fastapi import FastAPI, Request, Response, WebSocket, WebSocketDisconnect
from starlette.concurrency import run_in_threadpool

from console.errors import ConflictError
from console.hub import DeviceHub
from console.services import Services
from navcore.errors import WireError
from navcore.wire import (
    PROTOCOL_VERSION,
    ApplySettings,
    ConsoleMessage,
    DeviceMessage,
    Event,
    EventConfirmed,
    Hello,
    MapAvailable,
    MapRunning,
    Ping,
    PublishGraph,
    SettingsRunning,
    Welcome,
    decode_from_device,
    encode,
)

_log = logging.getLogger(__name__)
HELLO_WITHIN_S = 10.0
PING_EVERY_S = 2.0
FIRST_PINGS_COUNT = 3
FIRST_PING_EVERY_S = 0.2
QUEUED_MAX_COUNT = 1000
EVENTS_SHOWN_COUNT = 50
UNREADABLE_CODE = 1007
REFUSED_CODE = 4403
OVERFLOW_CODE = 4408


def add_routes(app: FastAPI, services: Services) -> None:
    """Add the routes."""

    @app.websocket("/device")
    async def device(socket: WebSocket) -> None:
        await socket.accept()
        await _serve(socket, services, str(socket.state.device_name))

    @app.get("/api/device/map/{checksum}", include_in_schema=False)
    def device_map(request: Request, checksum: str) -> Response:
        return Response(services.package.named(checksum), media_type="application/zip")


@dataclass(frozen=True, slots=True)
class _Close:
    code: int
    reason: str


class SocketOutlet:
    """The way to one device: a queue that any thread may fill, and that one task empties into the socket."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self._loop = loop
        self.queue: asyncio.Queue[ConsoleMessage | _Close] = asyncio.Queue()

    def send(self, message: ConsoleMessage) -> None:
        """Queue a message."""
        self._put(message)

    def close(self, code: int, reason: str) -> None:
        """End the link."""
        self._put(_Close(code, reason))

    def _put(self, item: ConsoleMessage | _Close) -> None:
        with contextlib.suppress(RuntimeError):
            self._loop.call_soon_threadsafe(self._put_in_loop, item)

    def _put_in_loop(self, item: ConsoleMessage | _Close) -> None:
        if self.queue.qsize() >= QUEUED_MAX_COUNT:
            item = _Close(OVERFLOW_CODE, "The device takes nothing in.")
        self.queue.put_nowait(item)


async def _serve(socket: WebSocket, services: Services, token_name: str) -> None:
    try:
        hello = await _hello(socket)
        await run_in_threadpool(services.devices.take_in, hello.device_id, token_name)
    except (TimeoutError, WebSocketDisconnect):
        return
    except WireError as error:
        await _close(socket, UNREADABLE_CODE, str(error))
        return
    except ConflictError as error:
        await _close(socket, REFUSED_CODE, str(error))
        return
    await _run(socket, services, hello, token_name)


async def _hello(socket: WebSocket) -> Hello:
    async with asyncio.timeout(HELLO_WITHIN_S):
        message = decode_from_device(await _receive_bytes(socket))
    if not isinstance(message, Hello):
        raise WireError("The device did not begin with a hello: use the same version on both sides.")
    if message.protocol_version != PROTOCOL_VERSION:
        raise ConflictError(
            f"The console speaks protocol {PROTOCOL_VERSION}, this device {message.protocol_version}: update the older"
            " of the two."
        )
    return message


async def _run(socket: WebSocket, services: Services, hello: Hello, token_name: str) -> None:
    hub, outlet = services.hub, SocketOutlet(asyncio.get_running_loop())
    last = await run_in_threadpool(services.devices.last_sequence, hello.device_id)
    events = await run_in_threadpool(services.devices.latest_events, hello.device_id, EVENTS_SHOWN_COUNT)
    outlet.send(Welcome(PROTOCOL_VERSION, last))
    hub.connect(hello, token_name, outlet, events)
    tasks = [
        asyncio.create_task(_send_all(socket, outlet)),
        asyncio.create_task(_receive_all(socket, services, hello.device_id, outlet)),
        asyncio.create_task(_ping(hub, outlet)),
    ]
    try:
        await _bring_up_to_date(services, hello, outlet)
        await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    finally:
        hub.disconnect(hello.device_id, outlet)
        for task in tasks:
            task.cancel()
        for result in await asyncio.gather(*tasks, return_exceptions=True):
            if isinstance(result, Exception):
                _log.error("The link of device %s failed.", hello.device_id, exc_info=result)
        await _close(socket, 1000, "")


async def _bring_up_to_date(services: Services, hello: Hello, outlet: SocketOutlet) -> None:
    """Offer what the device does not run yet: settings, map, and then (on the same map) the graph."""
    wanted = await run_in_threadpool(services.devices.wanted_revision, hello.device_id)
    if wanted is not None and wanted.revision > hello.settings_revision:
        outlet.send(ApplySettings(wanted.revision, dict(wanted.values)))
    package = services.package
    if hello.map_checksum != package.checksum:
        size_bytes = len(await run_in_threadpool(package.content))
        outlet.send(MapAvailable(package.path, package.checksum, size_bytes))
    else:
        _offer_graph(services, hello.graph_version, outlet)


def _offer_graph(services: Services, running_version: int, outlet: SocketOutlet) -> None:
    if services.model.published.version != running_version:
        outlet.send(PublishGraph(services.model.published))


async def _send_all(socket: WebSocket, outlet: SocketOutlet) -> None:
    with contextlib.suppress(WebSocketDisconnect, RuntimeError):
        while True:
            item = await outlet.queue.get()
            if isinstance(item, _Close):
                await _close(socket, item.code, item.reason)
                return
            await socket.send_bytes(encode(item))


async def _receive_all(socket: WebSocket, services: Services, device_id: str, outlet: SocketOutlet) -> None:
    try:
        while True:
            await _take(services, device_id, decode_from_device(await _receive_bytes(socket)), outlet)
    except WebSocketDisconnect:
        return
    except WireError as error:
        _log.warning("The link of device %s is closed: %s", device_id, error)
        await _close(socket, UNREADABLE_CODE, str(error))


async def _take(services: Services, device_id: str, message: DeviceMessage, outlet: SocketOutlet) -> None:
    hub = services.hub
    match message:
        case Hello():
            raise WireError("The device said hello twice: use the same version on both sides.")
        case Event():
            is_new = await run_in_threadpool(services.devices.add_event, device_id, message)
            outlet.send(EventConfirmed(message.sequence))
            if not is_new:
                return
        case SettingsRunning():
            await run_in_threadpool(_note_settings, services, device_id, message)
        case MapRunning(map_checksum, refusal) if not refusal and map_checksum == services.package.checksum:
            _offer_graph(services, hub.device(device_id).graph_version, outlet)
        case _:
            pass
    hub.receive(device_id, message)


def _note_settings(services: Services, device_id: str, message: SettingsRunning) -> None:
    if message.refused_revision is not None:
        services.devices.note_answer(device_id, message.refused_revision, "refused", message.refusal)
    services.devices.note_answer(device_id, message.revision, "running", "")


async def _ping(hub: DeviceHub, outlet: SocketOutlet) -> None:
    count = 0
    while True:
        outlet.send(Ping(hub.now_s()))
        count += 1
        await asyncio.sleep(FIRST_PING_EVERY_S if count < FIRST_PINGS_COUNT else PING_EVERY_S)


async def _receive_bytes(socket: WebSocket) -> bytes:
    message = await socket.receive()
    if message["type"] == "websocket.disconnect":
        raise WebSocketDisconnect(message.get("code", 1006))
    data = message.get("bytes")
    if data is None:
        raise WireError("The device sent text where a message was due: use the same version on both sides.")
    return bytes(data)


async def _close(socket: WebSocket, code: int, reason: str) -> None:
    # The reason of a close frame may have 123 bytes.
    shortened = reason.encode()[:120].decode(errors="ignore")
    with contextlib.suppress(RuntimeError, WebSocketDisconnect):
        await socket.close(code, shortened)

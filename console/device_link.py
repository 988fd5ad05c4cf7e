"""``/device``: the console's end of the link to a device, and the map that devices fetch.

A device is taken in by its token. Its events are stored before they are confirmed; it is given the graph, the map and
the settings where it runs others. Where what it sends cannot be read, or comes more often than the message table says,
the link is closed with the reason, and nothing else stops.
"""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import logging

from fastapi import FastAPI, Response, WebSocket, WebSocketDisconnect
from fastapi.responses import FileResponse
from sqlalchemy.exc import OperationalError
from starlette.concurrency import run_in_threadpool

from console.described import answers_with
from console.errors import ConflictError, TooManyError
from console.event_intake import EventIntake
from console.hub import DeviceHub
from console.outlet import Closing, SocketOutlet
from console.services import Services
from console.shown_events import ShownEvents
from console.storage_trouble import refusal_of
from console.told_once import ToldOnce
from navcore.errors import SiteError, VersionError, WireError
from navcore.jpeg_size import refuse_picture
from navcore.wire import (
    MESSAGES,
    PING_EVERY_S,
    PROTOCOL_VERSION,
    ColourImage,
    DepthImage,
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
    decode_hello,
    encode,
)
from navcore.wire_pace import Allowances
from navcore.wire_row import Direction

_log = logging.getLogger(__name__)
HELLO_WITHIN_S = 10.0
FIRST_PINGS_COUNT = 3
"""So many pings go as fast as the table allows: what a device shows is dated by the first answer."""
EVENTS_SHOWN_COUNT = 50
UNREADABLE_CODE = 1007
TRY_AGAIN_CODE = 1013
REFUSED_CODE = 4403
REVOKED_CODE = 4401


def add_routes(app: FastAPI, services: Services) -> None:
    """Add the routes."""

    told, shown = ToldOnce(services.hub.now_s), ShownEvents()
    services.hub.subscribe_forgotten(shown.forget)

    @app.websocket("/device")
    async def device(socket: WebSocket) -> None:
        await socket.accept()
        await _serve(socket, services, str(socket.state.device_name), str(socket.state.device_token_id), told, shown)

    @app.get("/api/device/map/{sha256}", response_class=Response, responses=answers_with("application/zip"))
    def device_map(sha256: str) -> Response:
        # Ranges are answered, so that a download can go on where it was cut off.
        packed = services.package.named(sha256)
        return FileResponse(packed.file, media_type="application/zip", headers={"ETag": f'"{packed.sha256}"'})


async def _serve(
    socket: WebSocket, services: Services, token_name: str, token_id: str, told: ToldOnce, shown: ShownEvents
) -> None:
    try:
        hello = await _hello(socket)
        await run_in_threadpool(services.devices.take_in, hello.device_id, token_name)
    except (TimeoutError, WebSocketDisconnect):
        return
    except (ConflictError, VersionError) as error:
        await _close(socket, REFUSED_CODE, str(error))
        return
    except OperationalError as error:
        await _close(socket, TRY_AGAIN_CODE, str(refusal_of(error)))
        return
    except WireError as error:
        await _close(socket, UNREADABLE_CODE, str(error))
        return
    await _run(socket, services, hello, token_name, token_id, told, shown)


async def _hello(socket: WebSocket) -> Hello:
    async with asyncio.timeout(HELLO_WITHIN_S):
        return decode_hello(await _receive_bytes(socket))


async def _run(
    socket: WebSocket,
    services: Services,
    hello: Hello,
    token_name: str,
    token_id: str,
    told: ToldOnce,
    shown: ShownEvents,
) -> None:
    hub, outlet = services.hub, SocketOutlet(asyncio.get_running_loop())
    try:
        forget = services.device_sockets.add(token_id, lambda: outlet.close(REVOKED_CODE, "This token was revoked."))
    except TooManyError as error:
        await _close(socket, REFUSED_CODE, str(error))
        return
    last = await run_in_threadpool(services.devices.last_sequence, hello.device_id)
    events = await run_in_threadpool(services.devices.latest_events, hello.device_id, EVENTS_SHOWN_COUNT)
    intake = EventIntake(
        services.devices, hello.device_id, lambda event: outlet.send(EventConfirmed(event.sequence)), shown
    )  # fmt: skip
    outlet.send(Welcome(PROTOCOL_VERSION, last))
    hub.connect(hello, token_name, outlet, events)
    tasks = [
        asyncio.create_task(_send_all(socket, outlet)),
        asyncio.create_task(_receive_all(socket, services, hello.device_id, outlet, intake, told)),
        asyncio.create_task(intake.store_waiting()),
        asyncio.create_task(_ping(hub, hello.device_id, outlet)),
    ]
    try:
        await _bring_up_to_date(services, hello, outlet)
        await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    finally:
        forget()
        hub.disconnect(hello.device_id, outlet)
        for task in tasks:
            task.cancel()
        for result in await asyncio.gather(*tasks, return_exceptions=True):
            if isinstance(result, Exception):
                _log.error("The link of device %s failed.", hello.device_id, exc_info=result)
        await _close(socket, 1000, "")


async def _bring_up_to_date(services: Services, hello: Hello, outlet: SocketOutlet) -> None:
    """Offer what the device does not run yet: settings, map, and then (on the same map) the graph; tell who looked."""
    outlet.send(await run_in_threadpool(services.access.told_to, hello.device_id))
    order = await run_in_threadpool(services.settings.order_at_joining, hello.device_id, hello.settings_revision)
    if order is not None:
        outlet.send(order)
    if hello.map_checksum != services.package.checksum:
        await _offer_map(services, outlet)
    else:
        _offer_graph(services, hello.graph_version, outlet)


async def _offer_map(services: Services, outlet: SocketOutlet) -> None:
    try:
        packed = await run_in_threadpool(services.package.packed)
    except SiteError as error:
        _log.warning("No map is offered: %s", error)
        return
    outlet.send(MapAvailable(packed.path, services.package.checksum, packed.size_bytes, packed.sha256))


def _offer_graph(services: Services, running_version: int, outlet: SocketOutlet) -> None:
    if services.model.published.version != running_version:
        outlet.send(PublishGraph(services.model.for_devices))


async def _send_all(socket: WebSocket, outlet: SocketOutlet) -> None:
    with contextlib.suppress(WebSocketDisconnect, RuntimeError):
        while True:
            item = await outlet.next()
            if isinstance(item, Closing):
                await _close(socket, item.code, item.reason)
                return
            try:
                data = encode(item)
            except WireError as error:
                # Offered again at each joining, it would keep the device from ever being joined.
                _log.error("A message is not sent: %s", error)
                continue
            await socket.send_bytes(data)


async def _receive_all(
    socket: WebSocket, services: Services, device_id: str, outlet: SocketOutlet, intake: EventIntake, told: ToldOnce
) -> None:
    allowances = Allowances(MESSAGES, Direction.UP, services.hub.now_s())
    try:
        while True:
            data = await _receive_bytes(socket)
            message = decode_from_device(data)
            if not allowances.take(type(message), services.hub.now_s()):
                raise WireError(_too_often(message))
            await _take(services, device_id, message, outlet, intake)
            services.incidents.heard(device_id, type(message), data)
            # Whoever sends without a pause would otherwise keep all others waiting: what is there is taken at once.
            await asyncio.sleep(0)
    except WebSocketDisconnect:
        return
    except WireError as error:
        if told.is_due(device_id):
            _log.warning("The link of device %s is closed: %s", device_id, error)
        await _close(socket, UNREADABLE_CODE, str(error))


def _too_often(message: DeviceMessage) -> str:
    row = MESSAGES[type(message)]
    return f"{row.name} comes more often than {row.rate_hz:g} times a second: update the device."


async def _take(
    services: Services, device_id: str, message: DeviceMessage, outlet: SocketOutlet, intake: EventIntake
) -> None:
    hub = services.hub
    match message:
        case Hello():
            raise WireError("The device said hello twice: use the same version on both sides.")
        case Event():
            if not await intake.take(message):
                return
        case DepthImage(jpeg=jpeg) | ColourImage(jpeg=jpeg):
            refuse_picture(jpeg)
        case SettingsRunning():
            await run_in_threadpool(_note_running, services, device_id, message)
        case MapRunning(map_checksum, refusal) if not refusal and map_checksum == services.package.checksum:
            _offer_graph(services, hub.device(device_id).graph_version, outlet)
        case _:
            pass
    hub.receive(device_id, message)


def _note_running(services: Services, device_id: str, told: SettingsRunning) -> None:
    try:
        services.settings.note_running(device_id, told)
    except OperationalError as error:
        # The device says it again at each joining.
        _log.error("What %s runs is shown, and not written down: %s", device_id, error)


async def _ping(hub: DeviceHub, device_id: str, outlet: SocketOutlet) -> None:
    rate_hz = MESSAGES[Ping].rate_hz
    assert rate_hz is not None
    for count in itertools.count(1):
        known = hub.device(device_id)
        offset_s = None if known.clock_uncertainty_s is None else known.clock_offset_s
        outlet.send(Ping(hub.now_s(), offset_s, known.clock_uncertainty_s))
        await asyncio.sleep(1.0 / rate_hz if count < FIRST_PINGS_COUNT else PING_EVERY_S)


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

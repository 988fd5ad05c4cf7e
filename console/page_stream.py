"""The sockets that pages listen on: each is told what happens until it goes or its session ends.

All that a page may say on it is to ask for the console's clock, so that it knows how old is what it shows; and, every
few seconds, which devices it shows while somebody can see it.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Awaitable, Callable

import msgspec
from fastapi import WebSocket, WebSocketDisconnect

from console.errors import TooManyError
from console.requests import signed_in
from console.services import Services
from console.sockets import SIGNED_OUT_CODE, TOO_MANY_CODE
from navcore.wire_pace import Allowance

REFUSED_CODE = 1008
"""WebSocket close code: the page said something that cannot be read, or asks too often."""
MAX_SAID_BYTES = 16 << 10
SAID_HZ = 4.0


class ClockAsked(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag="clock", tag_field="type"):
    """A page asks what time it is here."""

    page_sent_s: float
    """When it asked, on the page's own clock."""


class ClockTold(msgspec.Struct, frozen=True, tag="clock", tag_field="type"):
    """The answer: with the time at which it arrives, all four that :mod:`console.clock_offset` explains."""

    page_sent_s: float
    console_received_s: float
    console_sent_s: float


class Watches(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag="watching", tag_field="type"):
    """A page says what it shows."""

    watching: tuple[str, ...]
    """Ids of the devices that it shows, while somebody can see it; none where nobody can."""


_said_decoder: msgspec.json.Decoder[ClockAsked | Watches] = msgspec.json.Decoder(ClockAsked | Watches)


async def serve(
    socket: WebSocket,
    services: Services,
    stream: Callable[[], Awaitable[None]],
    watches: Callable[[frozenset[str]], object] = lambda device_ids: None,
) -> None:
    """Accept a page's socket and run ``stream`` on it until the page goes, its session ends, or it talks nonsense.

    ``watches`` hears which devices the page shows, each time that it says so.
    """
    visitor = signed_in(socket)
    loop, signed_out = asyncio.get_running_loop(), asyncio.Event()
    try:
        forget = services.sockets.add(visitor.session_id, lambda: set_from_any_thread(loop, signed_out))
    except TooManyError as error:
        await socket.close(TOO_MANY_CODE, str(error))
        return
    await socket.accept()
    listening = asyncio.create_task(_listen(socket, services.hub.now_s, watches))
    tasks = [asyncio.ensure_future(stream()), listening, asyncio.create_task(signed_out.wait())]
    try:
        await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    finally:
        forget()
        code = listening.result() if listening.done() and not listening.cancelled() else 1000
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        with contextlib.suppress(RuntimeError, WebSocketDisconnect):
            await socket.close(SIGNED_OUT_CODE if signed_out.is_set() else code)


def set_from_any_thread(loop: asyncio.AbstractEventLoop, event: asyncio.Event) -> None:
    """Set an event of a loop that may have ended meanwhile."""
    with contextlib.suppress(RuntimeError):
        loop.call_soon_threadsafe(event.set)


async def _listen(socket: WebSocket, now_s: Callable[[], float], watches: Callable[[frozenset[str]], object]) -> int:
    """Answer the page until it goes; return the code to close the socket with."""
    allowance = Allowance(SAID_HZ, now_s())
    while (received := await socket.receive())["type"] != "websocket.disconnect":
        received_s = now_s()
        said = read_said(received.get("text") or "")
        if said is None or not allowance.take(received_s):
            return REFUSED_CODE
        if isinstance(said, Watches):
            watches(frozenset(said.watching))
            continue
        with contextlib.suppress(RuntimeError, WebSocketDisconnect):
            told = ClockTold(said.page_sent_s, received_s, now_s())
            await socket.send_text(msgspec.json.encode(told).decode())
    return 1000


def read_said(text: str) -> ClockAsked | Watches | None:
    """Return what a page says; None where it cannot be read."""
    if len(text) > MAX_SAID_BYTES:
        return None
    try:
        return _said_decoder.decode(text)
    except (msgspec.MsgspecError, UnicodeEncodeError, RecursionError):
        return None

"""Viser inside our own application: no port, no HTTP server, no share tunnel, and a known person on every connection.

Viser offers no way to be mounted in another server, has no sign-in and no check of the Origin. So its WebSocket
handler is taken while it is being built, and run over sockets that our application has accepted. Everything here that
is private to viser holds for exactly the version in ``VISER_VERSION``; ``tests/test_viewer_contract.py`` says at
once when another version changes it.
"""

from __future__ import annotations

import asyncio
import contextlib
import threading
import time
from collections.abc import AsyncGenerator, Awaitable, Callable, Coroutine, Iterator, Sequence
from concurrent.futures import Future
from pathlib import Path
from types import SimpleNamespace, TracebackType
from typing import Any, Protocol, TypeVar

import numpy as np
import rich
import viser
import viser._assignable_props_api as assignable_props
import viser._client_autobuild as client_autobuild
import viser._messages as viser_messages
import viser.infra._infra as viser_infra
import websockets.exceptions
from viser.infra._async_message_buffer import AsyncMessageBuffer
from viser.infra._messages import Message, get_type_hints_cached

from console.roles import SignedIn
from console.viewer.forms import has_form
from console.viewer.guard import InboundGuard, Verdict

VISER_VERSION = "1.1.1"
SUBPROTOCOL = f"viser-v{VISER_VERSION}"
PORTION_BYTES = 4 << 20
"""What is sent at once, about."""
T = TypeVar("T")


class Socket(Protocol):
    """The part of an accepted WebSocket that is needed here."""

    async def send_bytes(self, data: bytes) -> None:
        """Send one binary message."""

    async def receive_bytes(self) -> bytes:
        """Return the next binary message; raises once the socket is closed."""

    async def close(self, code: int = 1000, reason: str | None = None) -> None:
        """Close with a code."""


class Connection:
    """What viser's handler takes for a ``websockets`` connection: lives in its loop, the socket in the application's.

    ``identity`` is who sits at the other end, and ``prefers_light`` which theme their browser asks for; viser keeps
    this object, so it can be asked for later.
    """

    def __init__(
        self, socket: Socket, socket_loop: asyncio.AbstractEventLoop, identity: SignedIn, prefers_light: bool = False
    ) -> None:
        self.identity = identity
        self.prefers_light = prefers_light
        self.subprotocol = SUBPROTOCOL
        self._socket = socket
        self._socket_loop = socket_loop
        self._guard = InboundGuard(identity)

    async def send(self, data: bytes) -> None:
        """Send to the browser; waits while the browser is slow, so that viser skips what has become stale."""
        await self._there(self._socket.send_bytes(data))

    async def recv(self) -> bytes:
        """Return the next message that this person may send."""
        while True:
            raw = await self._there(self._socket.receive_bytes())
            verdict = self._guard.judge(raw, time.monotonic())
            if verdict is Verdict.PASS and has_form(raw):
                return raw
            if verdict is Verdict.CLOSE:
                await self.close(1007, "This message cannot be read.")
                raise websockets.exceptions.ConnectionClosedOK(None, None)

    async def close(self, code: int = 1000, reason: str = "") -> None:
        """Close the socket; a closed one stays closed."""
        with contextlib.suppress(websockets.exceptions.ConnectionClosed):
            await self._there(self._socket.close(code, reason))

    async def _there(self, action: Coroutine[Any, Any, T]) -> T:
        try:
            return await asyncio.wrap_future(asyncio.run_coroutine_threadsafe(action, self._socket_loop))
        except asyncio.CancelledError:
            raise
        except Exception as error:
            # Whatever ends a socket (a disconnect, a server that stops) is for viser a closed connection.
            raise websockets.exceptions.ConnectionClosedOK(None, None) from error


class EmbeddedViser:
    """A viser server without a port, whose connections are handed to it by the application."""

    def __init__(self) -> None:
        if viser.__version__ != VISER_VERSION:
            raise RuntimeError(f"viser {viser.__version__} is installed: this needs exactly {VISER_VERSION}.")
        captured: list[Callable[[Connection], Awaitable[None]]] = []
        with _without_port(captured):
            self.server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
        self._handler = captured[0]
        _send_in_portions(self.server._websock_server._broadcast_buffer)
        # Viser reads the types of properties anew for each node, half of what a node costs: they stay the same.
        vars(assignable_props)["get_type_hints"] = get_type_hints_cached
        for message in (viser_messages.ShareUrlRequest, viser_messages.ShareUrlDisconnect):
            self.server._websock_server.unregister_handler(message)
        self._running: dict[Connection, Future[None]] = {}
        self._lock = threading.Lock()
        self._stopped = False

    @property
    def loop(self) -> asyncio.AbstractEventLoop:
        """The event loop that viser's callbacks run in; it has a thread of its own."""
        loop = self.server._websock_server._background_event_loop
        assert loop is not None
        return loop

    async def serve(self, socket: Socket, visitor: SignedIn, prefers_light: bool = False) -> None:
        """Run viser over an accepted socket, until either side closes it. Called in the application's loop."""
        connection = Connection(socket, asyncio.get_running_loop(), visitor, prefers_light)
        with self._lock:
            if self._stopped:
                return
            running = asyncio.run_coroutine_threadsafe(self._run(connection), self.loop)
            self._running[connection] = running
        try:
            await asyncio.wrap_future(running)
        finally:
            with self._lock:
                self._running.pop(connection, None)

    async def _run(self, connection: Connection) -> None:
        await self._handler(connection)

    def visitor_of(self, client: viser.ClientHandle) -> SignedIn:
        """Return who sits at a client. Raises KeyError where the client has gone."""
        connection: Any = self.server._websock_server._live_connections[client.client_id]
        identity: SignedIn = connection.identity
        return identity

    def is_open(self, client: viser.ClientHandle) -> bool:
        """Whether a client is still connected: when it goes, viser ends its drags as if the mouse had been let go."""
        return client.client_id in self.server._websock_server._live_connections

    def prefers_light(self, client: viser.ClientHandle) -> bool:
        """Whether the browser of a client asks for a light theme."""
        connection = self.server._websock_server._live_connections.get(client.client_id)
        return bool(getattr(connection, "prefers_light", False))

    def close_session(self, session_id: str, code: int = 4401, reason: str = "Signed out.") -> None:
        """Close every socket of a session: after sign-out, or when a role has changed."""
        with self._lock:
            connections = [c for c in self._running if c.identity.session_id == session_id]
        for connection in connections:
            asyncio.run_coroutine_threadsafe(connection.close(code, reason), self.loop)

    def stop(self) -> None:
        """End every connection, then viser itself."""
        with self._lock:
            self._stopped = True
            running = list(self._running.values())
        for task in running:
            task.cancel()
        with _quiet():
            self.server.stop()


def _send_in_portions(buffer: AsyncMessageBuffer) -> None:
    """Let a newcomer get what is shared in portions: viser would send up to 128 messages, the whole map, as one.

    So the first part of the cloud is seen while the others are on their way, and no more than one portion is held in
    memory for each browser.
    """
    whole_windows = buffer.window_generator

    def window_generator(
        client_id: int, backlog_done_message: Message | None = None
    ) -> AsyncGenerator[Sequence[Message], None]:
        return _portions(whole_windows(client_id, backlog_done_message))

    vars(buffer)["window_generator"] = window_generator


async def _portions(windows: AsyncGenerator[Sequence[Message], None]) -> AsyncGenerator[Sequence[Message], None]:
    try:
        async for window in windows:
            for portion in portions(window):
                yield portion
    finally:
        await windows.aclose()


def portions(messages: Sequence[Message], max_bytes: int = PORTION_BYTES) -> Iterator[list[Message]]:
    """Cut messages into portions whose arrays are together no larger than this, unless one alone is."""
    portion: list[Message] = []
    size_bytes = 0
    for message in messages:
        message_bytes = _array_bytes(message)
        if portion and size_bytes + message_bytes > max_bytes:
            yield portion
            portion, size_bytes = [], 0
        portion.append(message)
        size_bytes += message_bytes
    if portion:
        yield portion


def _array_bytes(message: Message) -> int:
    values = vars(getattr(message, "props", message)).values()
    return sum(value.nbytes for value in values if isinstance(value, np.ndarray))


def client_html() -> str:
    """Return viser's client: one HTML file."""
    return (Path(viser.__file__).parent / "client" / "build" / "index.html").read_text(encoding="utf-8")


@contextlib.contextmanager
def _without_port(captured: list[Callable[[Connection], Awaitable[None]]]) -> Iterator[None]:
    """While viser is built here, it opens no port, starts no build of its client, and prints no banner."""

    class Serve:
        """Stands in for ``websockets.asyncio.server.serve``."""

        def __init__(self, handler: Callable[[Connection], Awaitable[None]], *_: object, **__: object) -> None:
            captured.append(handler)

        async def __aenter__(self) -> SimpleNamespace:
            return SimpleNamespace(server=SimpleNamespace(sockets=[]))

        async def __aexit__(
            self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
        ) -> None:
            return None

    real_websockets, real_build = vars(viser_infra)["websockets"], client_autobuild.ensure_client_is_built
    stand_in = SimpleNamespace(
        asyncio=SimpleNamespace(server=SimpleNamespace(serve=Serve)), exceptions=real_websockets.exceptions
    )
    vars(viser_infra)["websockets"] = stand_in
    vars(client_autobuild)["ensure_client_is_built"] = lambda: None
    try:
        with _quiet():
            yield
    finally:
        vars(viser_infra)["websockets"] = real_websockets
        vars(client_autobuild)["ensure_client_is_built"] = real_build


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    terminal = rich.get_console()
    before, terminal.quiet = terminal.quiet, True
    try:
        yield
    finally:
        terminal.quiet = before

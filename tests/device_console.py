"""A small console on a real socket, for tests of the device's link."""

from __future__ import annotations

import asyncio
import contextlib
import threading
import time
from collections.abc import Callable, Iterable

from websockets.asyncio.server import ServerConnection, serve
from websockets.exceptions import ConnectionClosed

from navcore.wire import (
    PROTOCOL_VERSION,
    ConsoleMessage,
    DeviceMessage,
    Event,
    EventConfirmed,
    Welcome,
    decode_from_device,
    encode,
)

TOKEN = "a-token-of-this-test"


class Console:
    """A small console on a real socket: it stores events as the real one does, and can be killed and started again."""

    def __init__(self) -> None:
        self.seen: list[DeviceMessage] = []
        self.stored: list[Event] = []
        self.joins = 0
        self.token = TOKEN
        self.confirms = True
        self.protocol_version = PROTOCOL_VERSION
        self.port = 0
        self._changed = threading.Condition()
        self._sockets: set[ServerConnection] = set()
        self._loop = asyncio.new_event_loop()
        threading.Thread(target=self._loop.run_forever, daemon=True).start()

    def start(self) -> None:
        self._server = self._do(self._serve())
        self.port = self._server.sockets[0].getsockname()[1]

    async def _serve(self):  # type: ignore[no-untyped-def]
        return await serve(self._talk, "127.0.0.1", self.port, process_request=self._check)

    def kill(self) -> None:
        """Break every connection without a good-bye, and listen no more."""

        async def break_all() -> None:
            for socket in list(self._sockets):
                socket.transport.abort()
            self._server.close()
            await self._server.wait_closed()

        self._do(break_all())

    def send(self, message: ConsoleMessage) -> None:
        self.send_raw(encode(message))

    def send_raw(self, data: bytes | str) -> None:
        self.wait_for(lambda: bool(self._sockets))

        async def send() -> None:
            for socket in list(self._sockets):
                # One that the device has just hung up may still be among them, beside the one that it dialled since.
                with contextlib.suppress(ConnectionClosed):
                    await socket.send(data)

        self._do(send())

    def flood(self, messages: Iterable[ConsoleMessage]) -> None:
        """Send on one connection, until the device ends it."""
        self.wait_for(lambda: bool(self._sockets))
        (socket,) = self._sockets

        async def send() -> None:
            with contextlib.suppress(ConnectionClosed):
                for message in messages:
                    await socket.send(encode(message))

        self._do(send())

    def wait_for(self, condition: Callable[[], bool], timeout_s: float = 60.0) -> None:
        deadline_s = time.monotonic() + timeout_s
        with self._changed:
            while not condition():
                assert time.monotonic() < deadline_s, "the console waited in vain"
                # Some look at what changes without telling of it.
                self._changed.wait(0.05)

    def of_type(self, kind: type) -> list:  # type: ignore[type-arg]
        return [message for message in self.seen if isinstance(message, kind)]

    def close(self) -> None:
        self.kill()
        self._loop.call_soon_threadsafe(self._loop.stop)

    def _do(self, work):  # type: ignore[no-untyped-def]
        return asyncio.run_coroutine_threadsafe(work, self._loop).result(60.0)

    def _check(self, socket: ServerConnection, request):  # type: ignore[no-untyped-def]
        if request.headers.get("Authorization") != f"Bearer {self.token}" or request.path != "/device":
            with self._changed:
                self.refused = True
                self._changed.notify_all()
            return socket.respond(401, "no such token\n")
        return None

    refused = False

    async def _talk(self, socket: ServerConnection) -> None:
        # A device may hang up, or be cut off, at every moment: also while it is answered.
        with contextlib.suppress(ConnectionClosed):
            self._note(decode_from_device(await socket.recv()))
            last = self.stored[-1].sequence if self.stored else 0
            await socket.send(encode(Welcome(self.protocol_version, last)))
            self._sockets.add(socket)
            self.joins += 1
            try:
                await self._listen(socket)
            finally:
                self._sockets.discard(socket)

    async def _listen(self, socket: ServerConnection) -> None:
        async for data in socket:
            message = decode_from_device(data)
            if isinstance(message, Event):
                if not self.stored or message.sequence > self.stored[-1].sequence:
                    self.stored.append(message)
                if self.confirms:
                    await socket.send(encode(EventConfirmed(message.sequence)))
            self._note(message)

    def _note(self, message: DeviceMessage) -> None:
        with self._changed:
            self.seen.append(message)
            self._changed.notify_all()

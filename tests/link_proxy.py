"""A network between device and console that can be cut, mended, slowed down and filled: a TCP proxy on a real port."""

from __future__ import annotations

import asyncio
import contextlib
import threading
from collections.abc import Callable, Coroutine
from typing import Any

_PIECE_BYTES = 16_384


class Network:
    """Carries what comes to :attr:`port` to the console's port, until something is done to it."""

    def __init__(self, to_port: int) -> None:
        self.to_port = to_port
        self.up_bytes = self.down_bytes = 0
        """What has come through so far, from and to the device."""
        self.up_delay_s = self.down_delay_s = 0.0
        self.swallows = False
        """Takes connections and bytes, and lets nothing through; nobody is told."""
        self.up_stalled = False
        """Takes connections, and no more bytes from the device than fit into the buffers on the way."""
        self.down_limit_bytes: int | None = None
        """Nothing more comes to the device than up to this count, until it is raised or the network is cut."""
        self.up_limit_bytes: int | None = None
        """The same of what comes from the device."""
        self.dialled_count = 0
        self._changed = threading.Condition()
        self._pairs: set[asyncio.Task[None]] = set()
        self._loop = asyncio.new_event_loop()
        self._loosened = asyncio.Event()
        self._thread = threading.Thread(target=self._loop.run_forever, daemon=True)
        self._thread.start()
        self._server: asyncio.Server | None = None
        self.port = 0
        self.mend()

    def cut(self) -> None:
        """Break every connection without a good-bye, and take no new one."""

        async def cut() -> None:
            assert self._server is not None
            self._server.close()
            for pair in list(self._pairs):
                pair.cancel()
            await asyncio.gather(*self._pairs, return_exceptions=True)

        self._do(cut())

    def mend(self) -> None:
        """Take connections."""

        async def listen() -> None:
            self._server = await asyncio.start_server(self._carry, "127.0.0.1", self.port)
            self.port = self._server.sockets[0].getsockname()[1]

        self._do(listen())

    def loosen(self, down_limit_bytes: int | None = None, *, up_limit_bytes: int | None = None) -> None:
        """Raise the limits of what may come to the device, and from it."""

        async def loosen() -> None:
            self.down_limit_bytes, self.up_limit_bytes = down_limit_bytes, up_limit_bytes
            self._loosened.set()

        self._do(loosen())

    def stall(self, stalled: bool) -> None:
        """Take nothing more from the device, or go on."""

        async def stall() -> None:
            self.up_stalled = stalled
            self._loosened.set()

        self._do(stall())

    def wait_for(self, condition: Callable[[], bool], timeout_s: float = 120.0) -> None:
        """Wait until enough has come through."""
        with self._changed:
            assert self._changed.wait_for(condition, timeout_s), "nothing more came through the network"

    def close(self) -> None:
        """End it."""
        self.cut()
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()

    def _do(self, work: Coroutine[Any, Any, None]) -> None:
        asyncio.run_coroutine_threadsafe(work, self._loop).result(20.0)

    async def _carry(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        pair = asyncio.current_task()
        assert pair is not None
        self._pairs.add(pair)
        with self._changed:
            self.dialled_count += 1
            self._changed.notify_all()
        try:
            await self._join(reader, writer)
        except (OSError, asyncio.CancelledError):
            pass
        finally:
            self._pairs.discard(pair)
            writer.transport.abort()

    async def _join(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        there_reader, there_writer = await asyncio.open_connection("127.0.0.1", self.to_port)
        try:
            ways = [
                asyncio.create_task(self._pump(reader, there_writer, up=True)),
                asyncio.create_task(self._pump(there_reader, writer, up=False)),
            ]
            try:
                await asyncio.wait(ways, return_when=asyncio.FIRST_COMPLETED)
            finally:
                for way in ways:
                    way.cancel()
                await asyncio.gather(*ways, return_exceptions=True)
        finally:
            with contextlib.suppress(OSError):
                there_writer.transport.abort()

    async def _pump(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, *, up: bool) -> None:
        while data := await reader.read(self._room(up)):
            while up and self.up_stalled:
                self._loosened.clear()
                await self._loosened.wait()
            delay_s = self.up_delay_s if up else self.down_delay_s
            if delay_s:
                await asyncio.sleep(delay_s)
            if self.swallows:
                continue
            writer.write(data)
            await writer.drain()
            self._count(len(data), up)
            while self._room(up) == 0:
                self._loosened.clear()
                await self._loosened.wait()

    def _room(self, up: bool) -> int:
        limit_bytes = self.up_limit_bytes if up else self.down_limit_bytes
        if limit_bytes is None:
            return _PIECE_BYTES
        return max(0, min(_PIECE_BYTES, limit_bytes - (self.up_bytes if up else self.down_bytes)))

    def _count(self, count: int, up: bool) -> None:
        with self._changed:
            if up:
                self.up_bytes += count
            else:
                self.down_bytes += count
            self._changed.notify_all()

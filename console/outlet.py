"""The way to one device: what waits for it, in the order of the message table."""

from __future__ import annotations

import asyncio
import contextlib
import heapq
import itertools
from dataclasses import dataclass

from navcore.wire import MESSAGES, ConsoleMessage
from navcore.wire_row import Delivery

QUEUED_MAX_COUNT = 1000
OVERFLOW_CODE = 4408


@dataclass(frozen=True, slots=True)
class Closing:
    """The link is to end."""

    code: int
    reason: str


class SocketOutlet:
    """A queue that any thread may fill, and that one task empties into the socket; a :class:`console.hub.Outlet`."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self._loop = loop
        self._waiting: list[tuple[int, int, ConsoleMessage]] = []
        self._order = itertools.count()
        self._closing: Closing | None = None
        self._filled = asyncio.Event()

    def send(self, message: ConsoleMessage) -> None:
        """Queue a message; where far too many wait, the link is ended instead, and begins anew."""
        self._in_loop(message)

    def close(self, code: int, reason: str) -> None:
        """End the link, after what waits already."""
        self._in_loop(Closing(code, reason))

    async def next(self) -> ConsoleMessage | Closing:
        """Return what is to be sent next, waiting for it."""
        while not self._waiting and self._closing is None:
            self._filled.clear()
            await self._filled.wait()
        if self._waiting:
            return heapq.heappop(self._waiting)[2]
        assert self._closing is not None
        return self._closing

    def _in_loop(self, item: ConsoleMessage | Closing) -> None:
        # The loop is gone once the console has ended; nobody is left to be told.
        with contextlib.suppress(RuntimeError):
            self._loop.call_soon_threadsafe(self._put, item)

    def _put(self, item: ConsoleMessage | Closing) -> None:
        if self._closing is None:
            if isinstance(item, Closing):
                self._closing = item
            elif len(self._waiting) >= QUEUED_MAX_COUNT:
                self._waiting.clear()
                self._closing = Closing(OVERFLOW_CODE, "The device takes nothing in.")
            else:
                self._queue(item)
        self._filled.set()

    def _queue(self, message: ConsoleMessage) -> None:
        row = MESSAGES[type(message)]
        if row.delivery in (Delivery.ANSWER, Delivery.KEPT):
            # The newest says all that the earlier ones of its kind would have said.
            self._waiting = [entry for entry in self._waiting if type(entry[2]) is not type(message)]
            heapq.heapify(self._waiting)
        heapq.heappush(self._waiting, (row.priority, next(self._order), message))

"""Events of one device on their way into the database: stored, then confirmed.

Where the disk takes nothing, an event is shown all the same, and stored and confirmed as soon as it can be: the device
keeps it until then. The link stays, and with it all that is told live. Of very many only the first are kept here: once
they are stored, the link ends, and the device sends the others again.
"""

from __future__ import annotations

import asyncio
import logging
from collections import deque
from collections.abc import Callable

from sqlalchemy.exc import OperationalError
from starlette.concurrency import run_in_threadpool

from console.device_store import DeviceStore
from console.shown_events import ShownEvents
from navcore.wire import Event

RETRY_EVERY_S = 1.0
MAX_WAITING_COUNT = 256
_log = logging.getLogger(__name__)


class EventIntake:
    """Belongs to one link, and to its event loop."""

    def __init__(
        self,
        devices: DeviceStore,
        device_id: str,
        confirm: Callable[[Event], None],
        shown: ShownEvents | None = None,
    ) -> None:
        """``shown`` remembers over the links of a device what people have seen; by default, over this one alone."""
        self._devices, self._device_id, self._confirm = devices, device_id, confirm
        self._shown = shown or ShownEvents()
        self._waiting: deque[Event] = deque()
        self._has_left_out = False
        """Later ones are not kept here: none is confirmed before those in front of it."""

    async def take(self, event: Event) -> bool:
        """Store an event, and confirm it; return whether it is new to whoever watches."""
        return await self._is_new(event) and self._shown.is_new(self._device_id, event)

    async def _is_new(self, event: Event) -> bool:
        """Store an event where that can be; return whether it is not known to be an old one."""
        if self._waiting or self._has_left_out:
            self._wait(event)
            return True
        try:
            return await self._stored(event)
        except OperationalError as error:
            _log.error("Events of %s wait for the database, and are shown all the same: %s", self._device_id, error)
            self._wait(event)
            return True

    def _wait(self, event: Event) -> None:
        if len(self._waiting) >= MAX_WAITING_COUNT or self._has_left_out:
            self._has_left_out = True
        else:
            self._waiting.append(event)

    async def store_waiting(self) -> None:
        """Try again and again to store what waits; returns where the device is to join anew, and send the rest."""
        while self._waiting or not self._has_left_out:
            await asyncio.sleep(RETRY_EVERY_S)
            try:
                while self._waiting:
                    await self._stored(self._waiting[0])
                    self._waiting.popleft()
            except OperationalError:
                continue

    async def _stored(self, event: Event) -> bool:
        is_new = await run_in_threadpool(self._devices.add_event, self._device_id, event)
        self._confirm(event)
        return is_new

"""Events of one device on their way into the database: stored, then confirmed.

Where the disk takes nothing, an event is shown all the same, and stored and confirmed as soon as it can be: the device
keeps it until then. The link stays, and with it all that is told live.
"""

from __future__ import annotations

import asyncio
import logging
from collections import deque
from collections.abc import Callable

from sqlalchemy.exc import OperationalError
from starlette.concurrency import run_in_threadpool

from console.device_store import DeviceStore
from navcore.wire import Event

RETRY_EVERY_S = 1.0
_log = logging.getLogger(__name__)


class EventIntake:
    """Belongs to one link, and to its event loop."""

    def __init__(self, devices: DeviceStore, device_id: str, confirm: Callable[[Event], None]) -> None:
        self._devices, self._device_id, self._confirm = devices, device_id, confirm
        self._waiting: deque[Event] = deque()
        """No more than a device sends before it hears of the first."""

    async def take(self, event: Event) -> bool:
        """Store an event, and confirm it; return whether it is new, as it is where that cannot be known yet."""
        if self._waiting:
            # In order: none is confirmed before those in front of it.
            self._waiting.append(event)
            return True
        try:
            return await self._stored(event)
        except OperationalError as error:
            _log.error("Events of %s wait for the database, and are shown all the same: %s", self._device_id, error)
            self._waiting.append(event)
            return True

    async def store_waiting(self) -> None:
        """Try again and again to store what waits; runs as long as the link."""
        while True:
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

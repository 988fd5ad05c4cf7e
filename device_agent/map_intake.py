"""Taking in the maps that the console offers: one at a time, the newest offer wins, a refusal is told."""

from __future__ import annotations

import asyncio
import logging
import shutil
from collections.abc import Awaitable, Callable
from pathlib import Path

from device_agent.link_settings import LinkedDevice, LinkSettings
from device_agent.map_download import InterruptedFetchError, MapSource, fetch_map
from device_agent.ports import KeptMessage
from navcore.errors import SiteError
from navcore.wire import MapAvailable, MapRunning

_log = logging.getLogger(__name__)


class MapIntake:
    """Fetches in the link's event loop, beside the connection: a download outlives it."""

    def __init__(
        self,
        settings: LinkSettings,
        device: LinkedDevice,
        tell: Callable[[KeptMessage], None],
        pause_s: Callable[[int], float],
        wait: Callable[[float], Awaitable[None]],
    ) -> None:
        """``pause_s`` says how long to wait after so many failures in a row, ``wait`` waits."""
        self._settings = settings
        self._source = MapSource(settings.url, settings.token, settings.tls)
        self._device = device
        self._tell = tell
        self._pause_s = pause_s
        self._wait = wait
        self._task: asyncio.Task[None] | None = None
        self._offer: MapAvailable | None = None
        self._delivered = ""
        self._unfit: tuple[MapAvailable, str] | None = None
        """The offer that turned out to be no map for this device, and why: it is not fetched again to find the same."""

    def take(self, offer: MapAvailable) -> MapRunning | None:
        """Begin to fetch what is offered; return the answer where there is nothing to fetch."""
        running = self._device.hello().map_checksum
        if offer.map_checksum == running:
            return MapRunning(running)
        if self._unfit is not None and offer == self._unfit[0]:
            return MapRunning(running, self._unfit[1])
        if offer.map_checksum == self._delivered:
            # It waits for the end of a walk; which the console hears at each joining.
            return None
        if self._task is not None and not self._task.done():
            if offer == self._offer:
                return None
            self._task.cancel()
        self._offer = offer
        self._task = asyncio.create_task(self._fetch(offer))
        return None

    async def _fetch(self, offer: MapAvailable) -> None:
        try:
            folder = await self._fetched(offer)
            await asyncio.to_thread(self._hand_over, folder, offer.map_checksum)
            self._delivered = offer.map_checksum
        except Exception as error:
            # Whatever is wrong with it, the console is told, and the old map runs on.
            _log.warning("the offered map is not taken: %s", error)
            refusal = str(error)[:500]
            if isinstance(error, SiteError):
                self._unfit = (offer, refusal)
            self._tell(MapRunning(self._device.hello().map_checksum, refusal))

    async def _fetched(self, offer: MapAvailable) -> Path:
        failures = 0
        while True:
            try:
                return await fetch_map(offer, self._source, self._settings.staging, {self._delivered})
            except InterruptedFetchError as error:
                failures += 1
                _log.info("%s", error)
                await self._wait(self._pause_s(failures))

    def _hand_over(self, folder: Path, checksum: str) -> None:
        try:
            self._device.map_arrived(folder, checksum)
        except SiteError:
            shutil.rmtree(folder, ignore_errors=True)
            raise

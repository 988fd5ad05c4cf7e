"""The recordings of map walks that wait for the console's machine: sent one at a time, beside the connection."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable, Callable
from pathlib import Path

import msgspec

from device_agent.link_settings import LinkSettings
from device_agent.map_download import MapSource
from device_agent.map_walk.walk_folder import STATE_FILE, handed_over, read_state, write_state
from device_agent.recording_upload import InterruptedUploadError, send_recording
from device_agent.state import MapWalkTold, Phrase
from navcore.cues.table import CueKind
from navcore.errors import VbrError
from navcore.recording_archive import RecordingArchive
from navcore.recording_upload import RecordingOffer

_log = logging.getLogger(__name__)


class RecordingUploads:
    """Works in the link's event loop. What waits is on the disk: a device that is killed goes on at its next start."""

    def __init__(
        self,
        settings: LinkSettings,
        waits: asyncio.Event,
        until_quiet: Callable[[], Awaitable[None]],
        pause_s: Callable[[int], float],
        wait: Callable[[float], Awaitable[None]],
        tell: Callable[[MapWalkTold], None],
    ) -> None:
        """Put it together.

        Args:
            settings: where the console and the map walks are.
            waits: set when there is another recording.
            until_quiet: returns once nothing more urgent is to be sent.
            pause_s: how long to wait after so many failures in a row.
            wait: waits.
            tell: hears what is to be said.
        """
        self._folder = settings.map_walks
        self._console = MapSource(settings.url, settings.token, settings.tls)
        self._waits, self._until_quiet = waits, until_quiet
        self._pause_s, self._wait, self._tell = pause_s, wait, tell

    async def run(self) -> None:
        """Send what waits, for ever."""
        if self._folder is None:
            return
        while True:
            self._waits.clear()
            for walk in await asyncio.to_thread(handed_over, self._folder):
                await self._send(walk)
            await self._waits.wait()

    async def _send(self, walk: Path) -> None:
        try:
            await self._send_on(walk)
            stage, reason, told = "sent", "", "map_sent"
        except Exception as error:
            # Whatever is wrong with one, the others are sent, and it stays where it is.
            stage, reason, told = "failed", str(error)[:500], "map_not_sent"
            _log.warning("the recording of %s is not sent: %s", walk.name, error)
        try:
            state = msgspec.structs.replace(read_state(walk), stage=stage, reason=reason)
            await asyncio.to_thread(write_state, walk, state)
            self._tell(MapWalkTold(CueKind.MAP_NEWS, (Phrase(told),)))
        except (OSError, VbrError) as error:
            # It is offered again at the next start; the console knows that it has it.
            _log.warning("what has become of %s cannot be kept: %s", walk.name, error)

    async def _send_on(self, walk: Path) -> None:
        """Send a recording, however often that is interrupted."""
        archive = await asyncio.to_thread(RecordingArchive, walk, {STATE_FILE})
        sha256 = await asyncio.to_thread(archive.sha256)
        offer = RecordingOffer("recording", walk.name, archive.size_bytes, sha256, read_state(walk).date)
        failures = 0
        while True:
            try:
                await send_recording(archive, offer, self._console, self._until_quiet)
                return
            except InterruptedUploadError as error:
                failures += 1
                _log.info("%s", error)
                await self._wait(self._pause_s(failures))

"""The recordings of map walks that wait for the console's machine: sent one at a time, beside the connection.

One that is interrupted again and again lets the next go first, and has its turn again when they have had theirs.
"""

from __future__ import annotations

import asyncio
import logging
from collections import Counter
from collections.abc import Awaitable, Callable
from pathlib import Path

import msgspec

from device_agent.link_settings import LinkSettings
from device_agent.map_download import MapSource
from device_agent.map_walk.walk_folder import STATE_FILE, handed_over, read_state, write_state
from device_agent.recording_upload import InterruptedUploadError, send_recording, unhurried
from device_agent.state import MapWalkTold, Phrase
from navcore.cues.table import CueKind
from navcore.errors import VbrError
from navcore.recording_archive import RecordingArchive
from navcore.recording_upload import RecordingOffer

ATTEMPTS_PER_TURN = 3
"""After so many interruptions of one recording the next has its turn."""
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
        self._failures: Counter[Path] = Counter()
        self._checksums: dict[Path, str] = {}

    async def run(self) -> None:
        """Send what waits, for ever."""
        if self._folder is None:
            return
        while True:
            self._waits.clear()
            settled = [await self._settle(walk) for walk in await asyncio.to_thread(handed_over, self._folder)]
            if all(settled):
                await self._waits.wait()

    async def _settle(self, walk: Path) -> bool:
        """Send a recording, and keep what has become of it; False where that is not known yet."""
        try:
            if not await self._sent_in_turn(walk):
                return False
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
        return True

    async def _sent_in_turn(self, walk: Path) -> bool:
        """Send a recording; False where it was interrupted as often as the others can wait for."""
        await self._until_quiet()
        archive = await asyncio.to_thread(RecordingArchive, walk, {STATE_FILE})
        if walk not in self._checksums:
            self._checksums[walk] = await self._checksum(archive)
        offer = RecordingOffer("recording", walk.name, archive.size_bytes, self._checksums[walk], read_state(walk).date)
        for _ in range(ATTEMPTS_PER_TURN):
            try:
                await send_recording(archive, offer, self._console, self._until_quiet)
                return True
            except InterruptedUploadError as error:
                self._failures[walk] += 1
                _log.info("%s", error)
                await self._wait(self._pause_s(self._failures[walk]))
        return False

    async def _checksum(self, archive: RecordingArchive) -> str:
        """Read all of a recording as it would be sent: behind what is more urgent, and given up between two pieces."""
        hashing = archive.hashing()
        while True:
            await self._until_quiet()
            if (sha256 := await unhurried(asyncio.to_thread(hashing))) is not None:
                return sha256

"""The recordings that wait for the console's machine: sent one at a time, beside the connection, map walks first.

One that is interrupted again and again lets the next go first, and has its turn again when they have had theirs.
"""

from __future__ import annotations

import asyncio
import logging
from collections import Counter
from collections.abc import Awaitable, Callable
from functools import partial
from pathlib import Path

from device_agent.link_settings import LinkSettings
from device_agent.map_download import MapSource
from device_agent.recording_queues import MapWalkQueue, RecordingQueue, WalkQueue
from device_agent.recording_upload import (
    InterruptedUploadError,
    NoThreadError,
    in_thread,
    send_recording,
    unhurried,
)
from device_agent.state import MapWalkTold
from navcore.errors import VbrError
from navcore.recording_archive import RecordingArchive
from navcore.recording_upload import RecordingOffer

ATTEMPTS_PER_TURN = 3
"""After so many interruptions of one recording the next has its turn."""
_log = logging.getLogger(__name__)


class _WithdrawnError(VbrError):
    """The walker does not share it any more; it waits until they do."""


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
        shares_walks: Callable[[], bool],
        open_walk: Callable[[], Path | None] = lambda: None,
    ) -> None:
        """Put it together.

        Args:
            settings: where the console, the map walks, and the recorded walks are.
            waits: set when there is another recording.
            until_quiet: returns once nothing more urgent is to be sent.
            pause_s: how long to wait after so many failures in a row.
            wait: waits.
            tell: hears what is to be said.
            shares_walks: whether the walker shares recorded walks just now; asked before each piece.
            open_walk: the file of a walk that is being written just now.
        """
        self._queues: list[RecordingQueue] = []
        if settings.map_walks is not None:
            self._queues.append(MapWalkQueue(settings.map_walks))
        if settings.walks is not None:
            self._queues.append(WalkQueue(settings.walks, shares_walks, open_walk))
        self._console = MapSource(settings.url, settings.token, settings.tls)
        self._waits, self._until_quiet = waits, until_quiet
        self._pause_s, self._wait, self._tell = pause_s, wait, tell
        self._failures: Counter[Path] = Counter()
        self._checksums: dict[Path, str] = {}

    async def run(self) -> None:
        """Send what waits, for ever."""
        failures = 0
        while True:
            self._waits.clear()
            try:
                is_known = all([await self._sent_all(queue) for queue in self._queues])
            except Exception as error:
                # Whatever it was, recordings that are never sent again would be worse.
                failures += 1
                if failures == 1:
                    _log.warning("no recording is sent for now: %s", error)
                await self._wait(self._pause_s(failures))
                continue
            failures = 0
            if is_known:
                await self._waits.wait()

    async def _sent_all(self, queue: RecordingQueue) -> bool:
        """Send what waits of a kind; False where it is not known yet what becomes of some of it."""
        return all([await self._settle(queue, recording) for recording in await in_thread(queue.waiting)])

    async def _settle(self, queue: RecordingQueue, recording: Path) -> bool:
        """Send a recording, and keep what has become of it; False where that is not known yet. Raises NoThreadError."""
        failure = ""
        try:
            if not await self._sent_in_turn(queue, recording):
                return False
        except _WithdrawnError as error:
            _log.info("%s", error)
            return True
        except NoThreadError:
            raise
        except Exception as error:
            # Whatever is wrong with one, the others are sent, and it stays where it is.
            failure = str(error)[:500] or type(error).__name__
            _log.warning("the recording of %s is not sent: %s", recording.name, error)
        try:
            told = await in_thread(partial(queue.settle, recording, failure))
        except NoThreadError:
            raise
        except (OSError, VbrError) as error:
            # It is offered again at the next start; the console knows that it has it.
            _log.warning("what has become of %s cannot be kept: %s", recording.name, error)
            return True
        self._checksums.pop(recording, None)
        self._failures.pop(recording, None)
        if told is not None:
            self._tell(told)
        return True

    async def _sent_in_turn(self, queue: RecordingQueue, recording: Path) -> bool:
        """Send a recording; False where it was interrupted as often as the others can wait for."""

        async def until_quiet() -> None:
            await self._until_quiet()
            if not queue.may_go():
                raise _WithdrawnError(f"{recording.name} stays here: the walker does not share it.")

        await until_quiet()
        archive = await in_thread(partial(queue.archive, recording))
        if recording not in self._checksums:
            self._checksums[recording] = await _checksum(archive, until_quiet)
        date = await in_thread(partial(queue.date, recording))
        name = recording.stem[:120]
        offer = RecordingOffer(queue.kind, name, archive.size_bytes, self._checksums[recording], date)
        for _ in range(ATTEMPTS_PER_TURN):
            try:
                await send_recording(archive, offer, self._console, until_quiet)
                return True
            except InterruptedUploadError as error:
                self._failures[recording] += 1
                _log.info("%s", error)
                await self._wait(self._pause_s(self._failures[recording]))
        return False


async def _checksum(archive: RecordingArchive, until_quiet: Callable[[], Awaitable[None]]) -> str:
    """Read all of a recording as it would be sent: behind what is more urgent, and given up between two pieces."""
    hashing = archive.hashing()
    while True:
        await until_quiet()
        if (sha256 := await unhurried(in_thread(hashing))) is not None:
            return sha256

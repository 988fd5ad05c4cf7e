"""What waits to be sent to the console's machine, and what has become of it: kept on the disk, over every restart."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Protocol

import msgspec

from device_agent.map_walk.walk_folder import STATE_FILE, handed_over, read_state, write_state
from device_agent.recording.settled import Settled, settled_in, write_settled
from device_agent.recording.walk_files import parts_in
from device_agent.state import MapWalkTold, Phrase
from navcore.cues.table import CueKind
from navcore.errors import InputError
from navcore.recording_archive import RecordingArchive
from navcore.recording_upload import RecordingKind
from navcore.walk_file import WalkFile


class RecordingQueue(Protocol):
    """Recordings of one kind that wait. The methods read the disk: not from the link's event loop."""

    kind: RecordingKind

    def may_go(self) -> bool:
        """Whether recordings of this kind may leave the device just now; asked before each piece, reads no disk."""
        ...

    def waiting(self) -> tuple[Path, ...]:
        """Return those that wait, oldest first."""
        ...

    def archive(self, recording: Path) -> RecordingArchive:
        """Return the bytes of one. Raises RecordingError."""
        ...

    def date(self, recording: Path) -> str:
        """Return the day on which one was recorded; empty where that is not known."""
        ...

    def settle(self, recording: Path, failure: str) -> MapWalkTold | None:
        """Keep that one was sent, or (with a reason) that it cannot be; return what the walker hears of it.

        Raises OSError, VbrError.
        """
        ...


class MapWalkQueue:
    """The recordings of map walks that were handed over."""

    kind: RecordingKind = "recording"

    def __init__(self, folder: Path) -> None:
        """``folder`` holds the map walks."""
        self._folder = folder

    def may_go(self) -> bool:
        """Handing them over has said so."""
        return True

    def waiting(self) -> tuple[Path, ...]:
        """Return those that wait, oldest first."""
        return handed_over(self._folder)

    def archive(self, recording: Path) -> RecordingArchive:
        """Return one as an archive."""
        return RecordingArchive(recording, {STATE_FILE})

    def date(self, recording: Path) -> str:
        """Return the day on which it was walked."""
        return read_state(recording).date

    def settle(self, recording: Path, failure: str) -> MapWalkTold | None:
        """Keep it in the walk's own state; the walker hears of it."""
        stage, told = ("failed", "map_not_sent") if failure else ("sent", "map_sent")
        write_state(recording, msgspec.structs.replace(read_state(recording), stage=stage, reason=failure))
        return MapWalkTold(CueKind.MAP_NEWS, (Phrase(told),))


class WalkQueue:
    """The files of recorded walks. Sending one deletes nothing: they go when the recorder makes room, or by age."""

    kind: RecordingKind = "walk"

    def __init__(
        self, folder: Path, is_shared: Callable[[], bool], open_file: Callable[[], Path | None] = lambda: None
    ) -> None:
        """``folder`` is where the recorder writes, and ``open_file`` tells which of its files it writes just now.

        ``is_shared`` tells whether the walker shares them just now.
        """
        self._folder, self._is_shared, self._open_file = folder, is_shared, open_file

    def may_go(self) -> bool:
        """Whether the walker shares them."""
        return self._is_shared()

    def waiting(self) -> tuple[Path, ...]:
        """Return the files of walks that are complete, or that nobody completes any more, oldest first.

        None wait while the walker shares none.
        """
        if not self.may_go():
            return ()
        try:
            files = parts_in(self._folder)
        except InputError:
            # Nothing was recorded yet.
            return ()
        settled = settled_in(self._folder)
        # Asked after the files were listed: none of them is begun later. Their names tell nothing of it, for a device
        # without a clock of its own begins in 1970 until the network tells it the time.
        open_name = None if (path := self._open_file()) is None else path.name
        waiting = [path for path in files if path.name not in settled and path.name != open_name]
        return tuple(path for path in waiting if _is_walk(path))

    def archive(self, recording: Path) -> RecordingArchive:
        """Return one as it is."""
        return RecordingArchive(recording)

    def date(self, recording: Path) -> str:
        """Return the day on which it was recorded."""
        return time.strftime("%Y-%m-%d", time.gmtime(WalkFile(recording).part.began_at_s))

    def settle(self, recording: Path, failure: str) -> MapWalkTold | None:
        """Keep it in ``sent.json``; the walker is not disturbed by it."""
        here = {path.name for path in parts_in(self._folder)}
        settled = {name: what for name, what in settled_in(self._folder).items() if name in here}
        settled[recording.name] = Settled(failure)
        write_settled(self._folder, settled)
        return None


def _is_walk(path: Path) -> bool:
    """Say whether somebody was led in a file; what cannot be read goes nowhere."""
    try:
        return WalkFile(path).part.is_walk
    except InputError:
        return False

"""Maps that are built of the recordings here: one at a time, each a new site, never in the place of another.

::

    FOLDER/
      NAME-1/           the first map of a recording;  NAME-2: the one that was built of it later; imported sites
      .building-…/      the one that is being built, with the recording unpacked

A map is moved to its place in one step when it is complete, and its recording tells beforehand where that is: a console
that is killed between the two finds the map at its next start. What was still being built is cleared away then, and may
be asked for again.
"""

from __future__ import annotations

import contextlib
import itertools
import logging
import os
import shutil
import tempfile
import threading
from collections.abc import Callable
from pathlib import Path

from console.errors import BadRequestError, ConflictError
from console.recordings import RESERVE_BYTES, BuiltMap, Recordings, StoredRecording, plain_name
from navcore.errors import SiteError, VbrError
from navcore.folder_swap import sync_tree
from navcore.map_building import MapBuilding
from navcore.recording_archive import unpack_recording
from navcore.recording_upload import MAX_RECORDING_BYTES
from navcore.site_files import read_manifest

_BROKEN_OFF = "The console has ended meanwhile: build it again."
_PREFIX = ".building-"
MAX_BUILD_S = 12 * 3600.0
"""What is not built by then is given up, for it holds the only place. An hour's walk takes some hours at worst."""
_JOIN_TIMEOUT_S = 10.0
_log = logging.getLogger(__name__)


class MapBuilds:
    """Builds maps in a process beside the console. All methods may be called from any thread."""

    def __init__(
        self,
        recordings: Recordings,
        folder: Path,
        free_bytes: Callable[[Path], int] = lambda folder: shutil.disk_usage(folder).free,
        max_build_s: float = MAX_BUILD_S,
    ) -> None:
        """``folder`` is made when it is needed; ``free_bytes`` tells the room on its disk."""
        self._recordings, self.folder, self._free_bytes = recordings, folder, free_bytes
        self._max_build_s = max_build_s
        self._lock = threading.Lock()
        self._building = MapBuilding()
        self._thread: threading.Thread | None = None
        self._running = ""
        self._percent = 0
        self._clear_up()

    def percent(self, sha256: str) -> int | None:
        """Return how far the map of a recording has come; None where it is not being built."""
        return self._percent if sha256 == self._running else None

    def start(self, sha256: str, who: str) -> None:
        """Begin to build the map of a recording.

        Raises NotFoundError, BadRequestError where no map can be built of it, ConflictError while one is being built or
        there is no room.
        """
        stored = self._recordings.named(sha256)
        self._refuse_unfit(stored)
        with self._lock:
            if self._running:
                raise ConflictError("Another map is being built: wait until it is done.")
            self._recordings.note_map(sha256, BuiltMap("building", who))
            self._running, self._percent = sha256, 0
            self._thread = threading.Thread(target=self._run, args=(stored, who), name="map-build", daemon=True)
            self._thread.start()

    def close(self) -> None:
        """End what is being built; it can be begun anew later."""
        self._building.stop()
        if self._thread is not None:
            self._thread.join(_JOIN_TIMEOUT_S)

    def _refuse_unfit(self, stored: StoredRecording) -> None:
        if not stored.complete:
            raise ConflictError("This recording has not come whole yet: wait until it is here.")
        if stored.entry.offer.kind != "recording":
            raise BadRequestError("This is the record of a walk that was led: a map is built of a map walk.")
        needed_bytes = stored.entry.offer.size_bytes + RESERVE_BYTES
        if self._free_bytes(self._recordings.folder) < needed_bytes:
            raise ConflictError(f"Building this map takes {needed_bytes >> 20} MiB of the disk: free it first.")

    def _run(self, stored: StoredRecording, who: str) -> None:
        sha256 = stored.entry.offer.sha256
        try:
            found = self._built(stored, who)
        except (VbrError, OSError) as error:
            found = BuiltMap("failed", who, reason=str(error)[-400:])
        except Exception as error:
            _log.exception("a map could not be built")
            found = BuiltMap("failed", who, reason=f"{type(error).__name__}: {error}"[:400])
        with contextlib.suppress(VbrError):
            self._recordings.note_map(sha256, found)
        self._running = ""

    def _built(self, stored: StoredRecording, who: str) -> BuiltMap:
        offer = stored.entry.offer
        self.folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        # A name of its own: a process that outlived a console that was killed cannot come in the way.
        work = Path(tempfile.mkdtemp(prefix=_PREFIX, dir=self.folder))
        try:
            unpack_recording(stored.file, work / "recording", MAX_RECORDING_BYTES)
            name = f"{plain_name(offer.name)}-{offer.sha256[:8]}"
            if not self._building.build(
                work / "recording", work / "site", offer.name, offer.date, self._note_percent, self._max_build_s
            ):
                return BuiltMap("failed", who, reason=_BROKEN_OFF)
            report = read_manifest(work / "site").report
            sync_tree(work / "site")
            target = free_place(self.folder, name)
            self._recordings.note_map(offer.sha256, BuiltMap("building", who, target.name))
            os.rename(work / "site", target)
            return BuiltMap("built", who, target.name, report=report)
        finally:
            shutil.rmtree(work, ignore_errors=True)

    def _note_percent(self, percent: int) -> None:
        self._percent = percent

    def _clear_up(self) -> None:
        for work in self.folder.glob(f"{_PREFIX}*"):
            shutil.rmtree(work, ignore_errors=True)
        for stored in self._recordings.all():
            if stored.entry.map.stage == "building":
                with contextlib.suppress(VbrError):
                    self._recordings.note_map(stored.entry.offer.sha256, self._left_by(stored.entry.map))

    def _left_by(self, killed: BuiltMap) -> BuiltMap:
        """Return what a console that was killed has left of a map that it was building."""
        if killed.folder:
            # It is there whole, or it never came to its place.
            with contextlib.suppress(SiteError):
                report = read_manifest(self.folder / killed.folder).report
                return BuiltMap("built", killed.by, killed.folder, report=report)
        return BuiltMap("failed", killed.by, reason=_BROKEN_OFF)


def free_place(folder: Path, name: str) -> Path:
    """Return where in a folder a site of this name can be put: no other is there."""
    return next(free for n in itertools.count(1) if not (free := folder / f"{name}-{n}").exists())

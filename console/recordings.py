"""The recordings that devices have sent to this machine: taken in piece by piece, kept once they are whole.

::

    FOLDER/
      SHA256.json       what was offered, by whom, and what became of the map that was built of it
      SHA256.part       as far as it has come
      SHA256.figures    what was found in a walk (console.walk_figures)
      NAME-SHA256.tar   a recording (NAME-SHA256.mcap: a walk): whole, its checksum fits

A recording gets its last name in one step when its checksum fits, so whoever is killed meanwhile finds it whole, or
goes on with it. What turned out to be damaged is deleted, and walks that are too old (:mod:`console.retention`) with
all that is kept about them: recordings of map walks stay.
"""

from __future__ import annotations

import contextlib
import hashlib
import logging
import os
import re
import shutil
import threading
import weakref
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import msgspec

from console.errors import BadRequestError, ConflictError, NoRoomError, NotFoundError, TooLargeError
from console.retention import UndeletedError
from navcore.folder_swap import sync_path
from navcore.misfit import words_of
from navcore.recording_upload import MAX_RECORDING_BYTES, RecordingHeld, RecordingOffer
from navcore.site_files import clear_half_written, write_whole

RESERVE_BYTES = 1 << 30
"""So much of the disk stays free for the database, and for building maps."""
MAX_UNFINISHED_COUNT = 20
"""More recordings than these are not begun by one device before others have come whole."""
_SUFFIXES = {"recording": ".tar", "walk": ".mcap"}
_NAME_LENGTH = 60
_log = logging.getLogger(__name__)

MapStage = Literal["none", "building", "built", "failed"]


class BuiltMap(msgspec.Struct, frozen=True):
    """What became of the map that was built of a recording last."""

    stage: MapStage = "none"
    by: str = ""
    """Who has asked for it."""
    folder: str = ""
    """Name of its site's folder; while it is still being built, where it is about to be put."""
    reason: str = ""
    """Why there is none."""
    report: dict[str, Any] = {}
    """The site's own figures."""


class RecordingEntry(msgspec.Struct, frozen=True):
    """What is kept beside a recording."""

    offer: RecordingOffer
    device: str
    """Name of the token of the device that sends it."""
    offered_at_s: float
    """Unix time."""
    map: BuiltMap = BuiltMap()


@dataclass(frozen=True, slots=True)
class StoredRecording:
    """A recording, and how far it has come."""

    entry: RecordingEntry
    file: Path
    """Where it is, or will be, once it is whole."""
    complete: bool
    have_bytes: int


def plain_name(name: str, otherwise: str = "recording") -> str:
    """Return a name as far as it makes one of a file: letters, digits and hyphens."""
    return re.sub(r"[^A-Za-z0-9]+", "-", name).strip("-")[:_NAME_LENGTH].lower() or otherwise


def file_name(offer: RecordingOffer) -> str:
    """Return the name of the file of a recording; its whole checksum is in it, so no other has the same."""
    return f"{plain_name(offer.name)}-{offer.sha256}{_SUFFIXES[offer.kind]}"


class Recordings:
    """The recordings in a folder. All methods may be called from any thread."""

    def __init__(
        self,
        folder: Path,
        wall_s: Callable[[], float],
        free_bytes: Callable[[Path], int] = lambda folder: shutil.disk_usage(folder).free,
    ) -> None:
        """``folder`` is made when it is needed; ``free_bytes`` tells the room on its disk."""
        self.folder = folder
        self._wall_s, self._free_bytes = wall_s, free_bytes
        self._locks: weakref.WeakValueDictionary[str, threading.Lock] = weakref.WeakValueDictionary()
        self._beginning = threading.Lock()
        clear_half_written(folder)

    # ------------------------------------------------------------------------------------------------ reading
    def all(self) -> tuple[StoredRecording, ...]:
        """Return every recording, the newest first."""
        entries = [entry for path in self.folder.glob("*.json") if (entry := _read_entry(path)) is not None]
        entries.sort(key=lambda entry: (-entry.offered_at_s, entry.offer.sha256))
        return tuple(map(self._stored, entries))

    def named(self, sha256: str) -> StoredRecording:
        """Return the recording of this checksum. Raises NotFoundError."""
        entry = _read_entry(self._description(sha256)) if re.fullmatch(r"[0-9a-f]{64}", sha256) else None
        if entry is None:
            raise NotFoundError("There is no such recording: offer it first.")
        return self._stored(entry)

    def _stored(self, entry: RecordingEntry) -> StoredRecording:
        file = self.folder / file_name(entry.offer)
        if file.exists():
            return StoredRecording(entry, file, True, entry.offer.size_bytes)
        return StoredRecording(entry, file, False, _size_of(self._part(entry.offer.sha256)))

    # -------------------------------------------------------------------------------------------- from devices
    def offer(self, offer: RecordingOffer, device: str) -> RecordingHeld:
        """Begin to take a recording in, or go on with it; return what is here of it.

        What has not come whole belongs to whoever offered it last: a device that gets another token goes on with what
        it has begun. Who names the checksum has the recording, and what they spoil is found out by it.

        Raises TooLargeError, NoRoomError, ConflictError where this device has begun too many, or BadRequestError.
        """
        if offer.size_bytes > MAX_RECORDING_BYTES:
            raise TooLargeError(
                f"This recording is too large: {MAX_RECORDING_BYTES >> 30} GiB is the most that is taken."
            )
        if offer.size_bytes == 0:
            raise BadRequestError("This recording is empty: record again.")
        with self._beginning:
            self._begin(offer, device)
        with self._lock_of(offer.sha256):
            known = self._taken_over(offer, device)
            if not known.complete:
                self._refuse_without_room(offer.size_bytes - known.have_bytes)
            return self._held(known)

    def add(self, sha256: str, offset: int, piece: bytes) -> RecordingHeld:
        """Take in a piece of a recording that begins at ``offset``; one that does not follow changes nothing.

        Returns what is here then. Raises NotFoundError before it was offered, NoRoomError, or BadRequestError.
        """
        self.named(sha256)
        with self._lock_of(sha256):
            known = self.named(sha256)
            if known.complete or offset != known.have_bytes:
                return self._held(known)
            if offset + len(piece) > known.entry.offer.size_bytes:
                raise BadRequestError("This is more than was offered: offer the recording anew.")
            # Others may have filled the disk since the offer, other recordings among them.
            self._refuse_without_room(len(piece))
            self._append(self._part(sha256), piece)
            return self._held(self.named(sha256))

    def _begin(self, offer: RecordingOffer, device: str) -> None:
        if _read_entry(self._description(offer.sha256)) is not None:
            return
        unfinished = [each for each in self.all() if not each.complete and each.entry.device == device]
        if len(unfinished) >= MAX_UNFINISHED_COUNT:
            raise ConflictError(f"{MAX_UNFINISHED_COUNT} recordings of {device} have not come whole: send those first.")
        with _told_if_full():
            self.folder.mkdir(parents=True, exist_ok=True, mode=0o700)
            self._write(RecordingEntry(offer, device, self._wall_s()))

    def _taken_over(self, offer: RecordingOffer, device: str) -> StoredRecording:
        """Return a recording that was begun; unless it is whole, it is now as this device says."""
        known = self.named(offer.sha256)
        entry = msgspec.structs.replace(known.entry, offer=offer, device=device)
        if known.complete or entry == known.entry:
            return known
        with _told_if_full():
            self._write(entry)
        return self._stored(entry)

    def _refuse_without_room(self, needed_bytes: int) -> None:
        free_bytes = self._free_bytes(self.folder)
        if needed_bytes > 0 and free_bytes < needed_bytes + RESERVE_BYTES:
            raise NoRoomError(
                f"There is no room for this recording on the console's machine ({-(-needed_bytes >> 20)} MiB more, and"
                f" {RESERVE_BYTES >> 20} MiB that stay free; there are {free_bytes >> 20} MiB): free its disk."
            )

    def _append(self, part: Path, piece: bytes) -> None:
        with _told_if_full(), part.open("ab", buffering=0) as out:
            if out.write(piece) != len(piece):
                # What did fit is kept: the device is told from where on to go on.
                _log.warning("The disk of %s is nearly full.", part.parent)

    def _held(self, known: StoredRecording) -> RecordingHeld:
        """Return what is here of a recording; one that has just come whole is checked, and gets its last name."""
        offer = known.entry.offer
        if known.complete:
            return RecordingHeld(offer.size_bytes, True)
        if known.have_bytes < offer.size_bytes:
            return RecordingHeld(known.have_bytes, False)
        part = self._part(offer.sha256)
        if _checked_sha256(part) != offer.sha256:
            _log.warning(
                "The recording %s of %s has come damaged, and is asked for anew.", offer.name, known.entry.device
            )
            part.unlink()
            return RecordingHeld(0, False)
        with _told_if_full():
            os.replace(part, known.file)
            sync_path(self.folder)
        return RecordingHeld(offer.size_bytes, True)

    # ------------------------------------------------------------------------------------------------- the map
    def note_map(self, sha256: str, built: BuiltMap) -> None:
        """Keep what became of the map of a recording. Raises NotFoundError, NoRoomError."""
        with self._lock_of(sha256), _told_if_full():
            self._write(msgspec.structs.replace(self.named(sha256).entry, map=built))

    # --------------------------------------------------------------------------------------------------- keeping
    def companion(self, sha256: str, what: str) -> Path:
        """Return where something about a recording is kept beside it; it is deleted with it."""
        return self.folder / f"{sha256}.{what}"

    def keep_beside(self, sha256: str, what: str, data: bytes) -> None:
        """Keep something about a recording. Raises NotFoundError where it was deleted meanwhile, NoRoomError."""
        with self._lock_of(sha256), _told_if_full():
            self.named(sha256)
            write_whole(self.companion(sha256, what), data)

    def delete_before(self, wall_s: float) -> int:
        """Delete the walks that were offered before a Unix time, what came of them in part, and all that is kept about
        them; return how many. Map walks stay: maps are built of them.

        What nobody describes, for its description is damaged, goes when it was written before then, unless it is the
        recording of a map walk. Raises UndeletedError where some could not be deleted.
        """
        deleted, troubles = 0, list[str]()
        for stored in self.all():
            entry = stored.entry
            if entry.offer.kind != "walk" or entry.offered_at_s >= wall_s:
                continue
            with self._lock_of(entry.offer.sha256):
                try:
                    self._delete(stored)
                except OSError as error:
                    troubles.append(f"{stored.file} ({error.strerror})")
                else:
                    deleted += 1
        for path in self._undescribed_before(wall_s):
            try:
                path.unlink(missing_ok=True)
            except OSError as error:
                troubles.append(f"{path} ({error.strerror})")
            else:
                # Of a walk there are several files; what is counted is the walk itself, as far as it was here.
                deleted += path.suffix in (_SUFFIXES["walk"], ".part")
        if troubles:
            raise UndeletedError(f"delete by hand, or see who may write there: {', '.join(troubles)}.", deleted)
        return deleted

    def _undescribed_before(self, wall_s: float) -> list[Path]:
        """Return the files that belong to no recording that is known, and were last written before a Unix time."""
        found: dict[str, list[Path]] = {}
        for path in self.folder.iterdir() if self.folder.is_dir() else ():
            if (name := re.search(r"(?:^|-)([0-9a-f]{64})\.[a-z]+$", path.name)) is not None:
                found.setdefault(name[1], []).append(path)
        return [
            path
            for sha256, paths in found.items()
            if _read_entry(self._description(sha256)) is None
            and not any(path.suffix == _SUFFIXES["recording"] for path in paths)
            and max(map(_written_at_s, paths)) < wall_s
            for path in paths
        ]

    def _delete(self, stored: StoredRecording) -> None:
        """Delete a recording, its description last, so that what could not be deleted is found again."""
        sha256 = stored.entry.offer.sha256
        description = self._description(sha256)
        beside = [path for path in self.folder.glob(f"{sha256}.*") if path != description]
        for path in (stored.file, *beside, description):
            path.unlink(missing_ok=True)
        sync_path(self.folder)

    # ------------------------------------------------------------------------------------------------ internals
    def _lock_of(self, sha256: str) -> threading.Lock:
        """Return what is held while this recording is changed; it is there while somebody holds it, or waits."""
        return self._locks.setdefault(sha256, threading.Lock())

    def _description(self, sha256: str) -> Path:
        return self.folder / f"{sha256}.json"

    def _part(self, sha256: str) -> Path:
        return self.folder / f"{sha256}.part"

    def _write(self, entry: RecordingEntry) -> None:
        write_whole(self._description(entry.offer.sha256), msgspec.json.encode(entry))


def offer_of(data: bytes) -> RecordingOffer:
    """Return the offer in the body of a request. Raises BadRequestError."""
    try:
        return msgspec.json.decode(data, type=RecordingOffer)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        raise BadRequestError(
            f"This offer of a recording cannot be read ({words_of(error)}): update the device."
        ) from error


def _read_entry(path: Path) -> RecordingEntry | None:
    try:
        return msgspec.json.decode(path.read_bytes(), type=RecordingEntry)
    except FileNotFoundError:
        return None
    except (OSError, msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        _log.warning("%s is passed over, for it cannot be read: %s", path, error)
        return None


def _size_of(path: Path) -> int:
    try:
        return path.stat().st_size
    except FileNotFoundError:
        return 0


def _written_at_s(path: Path) -> float:
    try:
        return path.stat().st_mtime
    except FileNotFoundError:
        return 0.0


def _checked_sha256(path: Path) -> str:
    """Return the checksum of a file of which all is on the disk, not only in its cache."""
    with path.open("rb") as file:
        os.fsync(file.fileno())
        return hashlib.file_digest(file, "sha256").hexdigest()


@contextlib.contextmanager
def _told_if_full() -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise NoRoomError(
            f"The recording cannot be kept on the console's machine ({error.strerror}): free its disk."
        ) from error

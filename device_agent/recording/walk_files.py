"""The files of a walk: which one is written, when the next one begins, which old ones go, and what if the disk fails.

A run is ``NAME-001.mcap``, ``NAME-002.mcap``, …, each whole in itself: it begins with all that the loop remembers. No
two runs have the same name: a device without a clock of its own begins each at about the same second of 1970.

A file ends when it is large or old enough, where cycles are missing, and where a walk begins or ends, so that a walk
has files of its own; each says of which walk it is. Old files go when all together are too large, when the disk gets
full, or after some days (:mod:`device_agent.recording.room`). Only recordings are ever removed, and never what is
written.
"""

from __future__ import annotations

import contextlib
import errno
import logging
import math
import os
import re
import secrets
import shutil
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from importlib import metadata
from pathlib import Path
from typing import BinaryIO

import msgspec

from device_agent.private_folder import make_private
from device_agent.recording.notes import FrameNotes, MapTaken, Opening
from device_agent.recording.options import RecordingOptions
from device_agent.recording.part_writer import DiskSync, PartWriter, create
from device_agent.recording.room import Kept, could_free, make_room, map_walks_that_may_go, remove, walks_that_may_go
from device_agent.recording.transcript import CycleItem, Message, Transcript
from navcore.clock_trust import ClockTrust, looked_at
from navcore.errors import InputError
from navcore.machine_clock import clock_is_synchronised, since_boot_s
from navcore.site_files import write_whole
from navcore.types import CameraIntrinsics, Frame
from navcore.walk_file import FORMAT_VERSION

FLUSH_EVERY_S = 0.5
"""So often everything is handed to the operating system; a crash loses less than a second."""
SYNC_EVERY_S = 1.0
RETRY_AFTER_S = 30.0
_PART_NAME = re.compile(r"(?P<walk>[0-9]{8}T[0-9]{6}Z-[A-Za-z0-9_-]{1,80})-(?P<part>[0-9]{3,6})\.mcap")
_RUN_BYTES = 4
"""In a run's name, by chance; two hexadecimal digits each."""
_CLOCK_FILE = ".clock.json"
"""What was known of the machine's clock when a file was begun last (navcore.clock_trust)."""
_MAX_EARLY = 256
_AFTER_WALK_S = 3.0
"""A walk's last file goes on for so long after it: what is said of its end belongs to it."""
_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class PartName:
    """What the name of a file says."""

    walk_id: str
    part: int

    @staticmethod
    def of(path: Path) -> PartName | None:
        """Return what a file's name says; None where it is no file of ours."""
        match = _PART_NAME.fullmatch(path.name)
        return PartName(match["walk"], int(match["part"])) if match else None

    @property
    def file_name(self) -> str:
        """The name."""
        return f"{self.walk_id}-{self.part:03d}.mcap"


def parts_in(folder: Path) -> list[Path]:
    """Return the files of recordings in a folder, oldest first. Raises InputError where it cannot be read."""
    try:
        found = [(name.walk_id, name.part, path) for path in folder.iterdir() if (name := PartName.of(path))]
    except OSError as error:
        raise InputError(f"{folder} cannot be read ({error.strerror}): name the folder of the recordings.") from error
    return [path for _, _, path in sorted(found)]


class WalkWatch:
    """Tells by the cycles which of them belong to a walk, and to which one of this run."""

    def __init__(self) -> None:
        self.number = 0
        """Of the walk, or of the last one before what lies between two walks."""
        self.is_walk = False
        self._led_s = -math.inf

    def see(self, item: CycleItem) -> bool:
        """Take a cycle in; return whether something else begins with it: a walk, or what lies between two."""
        led_before, led_after = item.state_before.leading, item.state.leading
        stamp_s = item.cycle.stamp_s
        begins = led_after and not led_before
        if led_before or led_after:
            self._led_s = stamp_s
        before, self.is_walk = self.is_walk, stamp_s - self._led_s < _AFTER_WALK_S
        if begins or (self.is_walk and not before):
            self.number += 1
            return True
        return self.is_walk != before


class WalkFiles:
    """Writes cycles and events to the files of a walk. No method raises because of the disk."""

    def __init__(
        self,
        options: RecordingOptions,
        report: Callable[[str], None] = lambda text: None,
        *,
        monotonic_s: Callable[[], float] = since_boot_s,
        wall_s: Callable[[], float] = time.time,
        is_synchronised: Callable[[], bool | None] = clock_is_synchronised,
        open_file: Callable[[Path], BinaryIO] = create,
        free_bytes: Callable[[Path], int] = lambda folder: shutil.disk_usage(folder).free,
        random_hex: Callable[[int], str] = secrets.token_hex,
    ) -> None:
        """``report`` hears, in a sentence, when recording breaks off and when it goes on.

        ``monotonic_s`` is a clock that nobody sets, and that goes on while the machine sleeps; ``random_hex`` gives so
        many bytes by chance.
        """
        self._options = options
        self._report = report
        self._monotonic_s, self._wall_s, self._is_synchronised = monotonic_s, wall_s, is_synchronised
        self._open_file, self._free_bytes = open_file, free_bytes
        self.on_finished: Callable[[], None] = lambda: None
        """Called when a file has been completed."""
        self._walk = WalkWatch()
        self._walk_part = 0
        self._walk_id = time.strftime("%Y%m%dT%H%M%SZ", time.gmtime(wall_s()))
        self._walk_id += f"-{options.device_id}-{random_hex(_RUN_BYTES)}"
        self._part_number = 0
        self._part: PartWriter | None = None
        self._path: Path | None = None
        self._transcript: Transcript | None = None
        self._part_began_s = self._flushed_s = self._synced_s = 0.0
        self._next_number = 0
        self._retry_s: float | None = None
        self._room_made_s = -math.inf
        self._waiting: list[Message] = []
        """What is told of a cycle comes before it, and goes into its file."""
        self._sync = DiskSync()
        self._clock_looked_s: float | None = None
        self.rehearsal: Frame | None = None
        """A picture that the localizer saw before the first cycle."""

    @property
    def path(self) -> Path | None:
        """The file that is written now."""
        return self._path

    def add_cycle(self, item: CycleItem, intrinsics: CameraIntrinsics) -> None:
        """Write a cycle, in the next file where one is due."""
        turns = self._walk.see(item)
        if turns:
            self._walk_part = 0
        if self._retry_s is not None and self._monotonic_s() < self._retry_s:
            return
        try:
            if turns or not self._goes_on(item):
                self._begin_part(item, intrinsics)
            assert self._part is not None
            assert self._transcript is not None
            self._write_waiting(self._part)
            for channel, stamp_s, message in self._transcript.cycle(item):
                self._part.write(channel, stamp_s, message, item.number)
            self._next_number = item.number + 1
        except Exception as error:
            # A value that cannot be encoded is no reason to end the recorder's thread either.
            self._break_off(error)

    def add(self, messages: Iterable[Message]) -> None:
        """Take in what happened beside the cycles: it is written with the next one, or with the next flush."""
        # After the disk has failed there is no file that it belongs to.
        if self._retry_s is None:
            self._waiting = [*self._waiting, *messages][-_MAX_EARLY:]

    def _write_waiting(self, part: PartWriter) -> None:
        waiting, self._waiting = self._waiting, []
        for channel, stamp_s, message in waiting:
            part.write(channel, stamp_s, message)

    def flush_if_due(self) -> None:
        """Hand what was written to the operating system where that is due, and to the disk now and then."""
        now_s = self._monotonic_s()
        if self._part is None or self._path is None or now_s - self._flushed_s < FLUSH_EVERY_S:
            return
        try:
            self._flushed_s = now_s
            self._write_waiting(self._part)
            self._part.flush()
            self._finish_for_want_of_room()
        except Exception as error:
            self._break_off(error)
            return
        if self._path is not None and now_s - self._synced_s >= SYNC_EVERY_S:
            self._synced_s = now_s
            self._sync.request(self._path)

    def close(self) -> None:
        """Complete the file."""
        try:
            if self._part is not None:
                self._write_waiting(self._part)
            self._finish_part()
        except Exception as error:
            self._break_off(error)

    def _goes_on(self, item: CycleItem) -> bool:
        part, options = self._part, self._options
        return (
            part is not None
            and item.number == self._next_number
            and part.size_bytes < options.max_part_bytes
            and self._monotonic_s() - self._part_began_s < options.max_part_s
        )

    def _begin_part(self, item: CycleItem, intrinsics: CameraIntrinsics) -> None:
        self._finish_part()
        make_private(self._options.folder)
        self._remove_old()
        self._check_room()
        self._part_number += 1
        self._walk_part += 1
        rehearsal = self.rehearsal if self._options.pictures and item.number == 1 else None
        opening = _opening(item, intrinsics, self._walk_id, self._part_number, rehearsal)
        path = self._options.folder / PartName(self._walk_id, self._part_number).file_name
        # Before there is such a file: whoever lists the folder is told that it is not complete.
        self._path = path
        part = PartWriter(self._open_file(path), opening, self._description(opening))
        self._part, self._transcript = part, Transcript(opening)
        self._part_began_s = self._flushed_s = self._monotonic_s()
        for channel, stamp_s, message in self._transcript.beginning(item.cycle.stamp_s, rehearsal):
            part.write(channel, stamp_s, message)
        if self._retry_s is not None:
            self._retry_s = None
            self._report(f"Recording goes on, in {path.name}.")

    def _finish_for_want_of_room(self) -> None:
        """Make room where the disk gets full; where none can be made, complete the file while its index fits."""
        is_due = self._monotonic_s() - self._room_made_s >= RETRY_AFTER_S
        if self._is_full() or (is_due and self._wants_room()):
            self._make_room()
        if self._is_full():
            self._finish_part()
            self._check_room()

    def _wants_room(self) -> bool:
        return self._free_bytes(self._options.folder) < self._options.keep_free_bytes

    def _is_full(self) -> bool:
        return self._free_bytes(self._options.folder) < self._options.reserve_bytes

    def _check_room(self) -> None:
        if self._is_full():
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    def _finish_part(self) -> None:
        part, self._part = self._part, None
        if part is None:
            return
        try:
            part.finish()
        except OSError:
            part.abandon()
            raise
        finally:
            self._path = None
        self.on_finished()

    def _break_off(self, error: Exception) -> None:
        """The disk takes nothing more. Guidance goes on without; it is tried again later."""
        if self._part is not None:
            self._part.abandon()
        self._part = self._path = self._transcript = None
        self._waiting = []
        is_news = self._retry_s is None
        self._retry_s = self._monotonic_s() + RETRY_AFTER_S
        _log.warning("recording broke off: %s", error)
        if is_news:
            if isinstance(error, OSError):
                what = f"{error.strerror or error}): free the disk of {self._options.folder}."
            else:
                what = f"{type(error).__name__}: {error}): tell who maintains the device."
            self._report(f"The walk is not recorded any more ({what}")

    def _description(self, opening: Opening) -> dict[str, str]:
        """Return what a file says of itself (:class:`navcore.walk_file.WalkPart`)."""
        walk = self._walk
        return {
            "format_version": str(FORMAT_VERSION),
            "software_version": metadata.version("virtual-blind-road"),
            "device_id": self._options.device_id,
            "walk_id": opening.walk_id,
            "part": str(opening.part),
            "walk_number": str(walk.number) if walk.is_walk else "",
            "walk_part": str(self._walk_part),
            "walking": "yes" if walk.is_walk else "no",
            "began_at_unix_s": f"{self._wall_s():.3f}",
            "pictures": "yes" if self._options.pictures else "no",
            "site_id": opening.state.site_id,
            "map_checksum": opening.state.map_checksum,
            "graph_version": str(opening.state.graph.version),
        }

    def _remove_old(self) -> None:
        """Remove what is too old, and make room, so that all files with the next one stay within what is allowed."""
        options, now_s = self._options, self._trusted_s()
        for each in self._that_may_go():
            if now_s - each.written_s > options.keep_s:
                remove(each)
        kept = self._that_may_go()
        most_bytes = options.max_total_bytes - options.max_part_bytes
        make_room(kept, lambda: sum(each.size_bytes for each in kept if each.path.exists()) <= most_bytes)
        self._make_room()

    def _that_may_go(self) -> list[Kept]:
        return walks_that_may_go(
            self._options.folder, [path for path in parts_in(self._options.folder) if path != self._path]
        )

    def _make_room(self) -> None:
        """Remove old recordings: what the console has for what is to be kept free, others only to go on recording."""
        self._room_made_s = self._monotonic_s()
        if not self._wants_room():
            return
        walks = self._that_may_go()
        confirmed = [each for each in walks if each.confirmed]
        make_room([*confirmed, *map_walks_that_may_go(self._options.map_walks)], lambda: not self._wants_room())
        if self._is_full():
            self._lose([each for each in walks if not each.confirmed])

    def _lose(self, walks: list[Kept]) -> None:
        """Remove walks that are nowhere else, as many as recording needs; none where somebody else fills the disk."""
        options = self._options
        if not could_free(walks, options.reserve_bytes - self._free_bytes(options.folder)):
            return
        if count := make_room(walks, lambda: not self._is_full()):
            self._report(
                f"The disk is full: {count} files of old walks, which the console does not have, were removed. Free"
                f" the disk of {options.folder}, or share walks."
            )

    def _trusted_s(self) -> float:
        """Return the Unix time by which files are old: a clock that leaps ahead is to delete none by that."""
        now_s, monotonic_s = self._wall_s(), self._monotonic_s()
        passed_s = None if self._clock_looked_s is None else monotonic_s - self._clock_looked_s
        self._clock_looked_s = monotonic_s
        kept = self._options.folder / _CLOCK_FILE
        try:
            before = msgspec.json.decode(kept.read_bytes(), type=ClockTrust)
            clock = looked_at(before, now_s, passed_s, synchronised=self._is_synchronised() is True)
        except (OSError, msgspec.MsgspecError, UnicodeDecodeError):
            clock = ClockTrust(now_s, now_s)
        if clock.even_for_s == 0.0:
            self._report(
                "The clock of this device leapt ahead: recordings are kept by the time before, until it has gone on"
                " evenly for a day, or the network tells the time."
            )
        with contextlib.suppress(OSError):
            # A disk that is full must not keep old files from being removed.
            write_whole(kept, msgspec.json.encode(clock))
        return clock.trusted_s


def _opening(
    item: CycleItem, intrinsics: CameraIntrinsics, walk_id: str, part: int, rehearsal: Frame | None
) -> Opening:
    """Return what a replay begins with; what belongs to this process stays out, and is made anew."""
    state = item.state_before
    waiting = None if state.waiting_map is None else MapTaken.of(state.waiting_map)
    state = replace(state, way_finder=None, waiting_map=None)
    return Opening(
        FORMAT_VERSION, walk_id, part, item.number, intrinsics, state, item.voice_before, waiting,
        None if rehearsal is None else FrameNotes.of(rehearsal),
    )  # fmt: skip

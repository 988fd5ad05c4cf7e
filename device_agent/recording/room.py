"""Which recordings go when the disk gets full: what the console has, oldest first; then other walks, oldest first.

A device that records each day would fill any disk. What is being written never goes, and neither does a map walk that
the console has not confirmed: nobody wants to walk through a building twice for one map. Walks that the console does
not have are lost with their files: they go only where nothing could be recorded otherwise, and where that helps.
"""

from __future__ import annotations

import contextlib
import logging
import shutil
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

from device_agent.map_walk.walk_folder import STATE_FILE, read_state, walks_in
from device_agent.recording.settled import settled_in

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class Kept:
    """A recording that may go: the file of a walk, or the folder of a map walk."""

    path: Path
    size_bytes: int
    written_s: float
    """When it was written last, seconds since 1970."""
    confirmed: bool
    """The console has all of it."""


def walks_that_may_go(folder: Path, paths: Iterable[Path]) -> list[Kept]:
    """Return what is known of files of walks in a folder, in the order in which they go."""
    sent = {name for name, what in settled_in(folder).items() if not what.failure}
    return _in_order(_kept(path, path.name in sent) for path in paths)


def map_walks_that_may_go(folder: Path | None) -> list[Kept]:
    """Return the map walks in a folder that the console has."""
    walks = () if folder is None else walks_in(folder)
    return _in_order(_kept(walk, True) for walk in walks if read_state(walk).stage == "sent")


def make_room(kept: Iterable[Kept], is_enough: Callable[[], bool]) -> int:
    """Remove recordings in the order in which they go, until that is enough; return how many. Raises OSError."""
    count = 0
    for each in _in_order(kept):
        if is_enough():
            break
        remove(each)
        count += 1
    return count


def could_free(kept: Iterable[Kept], wanted_bytes: int) -> bool:
    """Tell whether so much would be free if all of these went."""
    return sum(each.size_bytes for each in kept) >= wanted_bytes


def remove(kept: Kept) -> None:
    """Remove a recording. Raises OSError."""
    has = "has" if kept.confirmed else "does not have"
    _log.info("%s is removed to make room (%.1f MB); the console %s it", kept.path, kept.size_bytes / 1e6, has)
    if not kept.path.is_dir():
        kept.path.unlink(missing_ok=True)
        return
    # What says that the console has it goes last: whoever is ended in between finds the rest, and goes on.
    for path in [path for path in kept.path.iterdir() if path.name != STATE_FILE]:
        shutil.rmtree(path) if path.is_dir() else path.unlink()
    shutil.rmtree(kept.path)


def _in_order(kept: Iterable[Kept | None]) -> list[Kept]:
    there = (each for each in kept if each is not None)
    return sorted(there, key=lambda each: (not each.confirmed, each.written_s, each.path.name))


def _kept(path: Path, confirmed: bool) -> Kept | None:
    """Return what is known of a recording; None of one that has just gone."""
    with contextlib.suppress(FileNotFoundError):
        files = [each for each in path.rglob("*") if each.is_file()] if path.is_dir() else [path]
        return Kept(path, sum(each.stat().st_size for each in files), path.stat().st_mtime, confirmed)
    return None

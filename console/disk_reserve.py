"""Room that is put by while there is some, for what must be done though the disk is full.

A console has to start: SQLite needs some files of its own before anything can be read, and whoever watches over walkers
needs the console. While it runs, people sign in and out by it, choose a password by a link, are locked out, and tokens
are taken back.
"""

from __future__ import annotations

import contextlib
import os
import shutil
from pathlib import Path

from console.plain_files import is_plain

RESERVE_BYTES = 4 << 20
_STEP_BYTES = 1 << 12
_FILE = "reserve"


def put_by(folder: Path) -> None:
    """Take the room where it is not all taken yet; where there is not enough, what was put by stays as it is."""
    # A part of it would help nobody who starts, and would take the last room from those who work.
    _grow(folder, RESERVE_BYTES, RESERVE_BYTES)


def put_back(folder: Path, released_bytes: int) -> None:
    """Take again what is left of the room that :func:`release` gave."""
    _grow(folder, min(released_bytes, RESERVE_BYTES), _STEP_BYTES)


def release(folder: Path) -> int:
    """Give the room back; return how much there was."""
    path = folder / _FILE
    try:
        held_bytes = _held_bytes(path.lstat())
        path.unlink()
    except OSError:
        return 0
    return held_bytes


def is_short_of_room(folder: Path, *, was_short: bool) -> bool:
    """Whether the disk has less room left than what is put by: it will soon be full, or is.

    Where it was, that is over with twice as much: people who are told of it are not told anew with every file.
    """
    return shutil.disk_usage(folder).free < RESERVE_BYTES * (2 if was_short else 1)


def _held_bytes(found: os.stat_result) -> int:
    return found.st_blocks * 512


def _grow(folder: Path, most_bytes: int, least_bytes: int) -> None:
    path = folder / _FILE
    # Root opens it too, in a folder of another user's, who may have put a link there to a file of root's.
    flags = os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC
    with contextlib.suppress(OSError), os.fdopen(os.open(path, flags, 0o600), "ab") as out:
        if not is_plain(out.fileno()):
            return
        held_bytes = _held_bytes(os.fstat(out.fileno()))
        for size_bytes in range(most_bytes, max(held_bytes, least_bytes - 1), -_STEP_BYTES):
            try:
                os.posix_fallocate(out.fileno(), 0, size_bytes)
                return
            except OSError:
                os.ftruncate(out.fileno(), held_bytes)
        if held_bytes == 0:
            path.unlink()

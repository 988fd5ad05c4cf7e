"""Replacing a folder as a whole.

A folder cannot be replaced in one step: the old one is moved aside, then the new one takes its place. Whoever crashes
between the two leaves no folder, but the old one under a name that :func:`recover` knows, which is called before
anything is read.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

_ATTEMPTS = 3


def aside(folder: Path) -> Path:
    """Return where the old folder waits while the new one takes its place."""
    return folder.with_name(f".{folder.name}-replaced")


def swap_in(fresh: Path, folder: Path, keep: Path | None = None) -> None:
    """Put a complete folder in the place of another, on the same disk. Raises OSError, and the old one stays then.

    The old one is moved to ``keep``, where that is given, in the place of what is there; else it is removed. Where it
    cannot be kept, nothing is replaced.
    """
    recover(folder)
    if keep is not None:
        # What was replaced before, and could not be kept then.
        keep_aside(folder, keep)
    shutil.rmtree(aside(folder), ignore_errors=True)
    for attempt in range(_ATTEMPTS):
        if folder.exists():
            os.replace(folder, aside(folder))
        try:
            os.replace(fresh, folder)
            break
        except OSError:
            # Somebody who came to read found no folder and has put the old one back.
            recover(folder)
            if attempt == _ATTEMPTS - 1 or not fresh.exists():
                raise
    sync_path(folder.parent)
    if keep is None:
        shutil.rmtree(aside(folder), ignore_errors=True)
        return
    try:
        keep_aside(folder, keep)
    except OSError:
        _swap_back(fresh, folder)
        raise


def _swap_back(fresh: Path, folder: Path) -> None:
    """Undo a replacement; where that fails too, the old folder still waits aside."""
    with contextlib.suppress(OSError):
        os.replace(folder, fresh)
        os.replace(aside(folder), folder)


def keep_aside(folder: Path, keep: Path) -> None:
    """Move what was replaced to ``keep``; also for whoever finds it after an interrupted :func:`swap_in`.

    Raises OSError where it cannot be moved; it waits aside then.
    """
    if folder.exists() and aside(folder).is_dir():
        shutil.rmtree(keep, ignore_errors=True)
        os.replace(aside(folder), keep)


def recover(folder: Path) -> None:
    """Put the old folder back where a replacement was interrupted."""
    if not folder.exists() and aside(folder).is_dir():
        with contextlib.suppress(OSError):
            os.replace(aside(folder), folder)


@contextlib.contextmanager
def fresh_folder(folder: Path) -> Iterator[Path]:
    """Give a new folder beside another, to be filled and put in its place; it is gone afterwards. Raises OSError.

    What a crash has left of earlier ones goes first; what somebody else fills just now stays.
    """
    prefix = f".{folder.name}-fresh-"
    for left_behind in folder.parent.glob(f"{prefix}*"):
        with contextlib.suppress(OSError), _held(left_behind, fcntl.LOCK_EX):
            shutil.rmtree(left_behind, ignore_errors=True)
    fresh = Path(tempfile.mkdtemp(prefix=prefix, dir=folder.parent))
    try:
        with _held(fresh, fcntl.LOCK_SH):
            yield fresh
    finally:
        shutil.rmtree(fresh, ignore_errors=True)


@contextlib.contextmanager
def _held(folder: Path, how: int) -> Iterator[None]:
    """Hold a folder as long as the block runs. Raises OSError where somebody else does."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(handle, how | fcntl.LOCK_NB)
        yield
    finally:
        os.close(handle)


def sync_tree(folder: Path) -> None:
    """See that everything in a folder is on the disk, not only in its cache."""
    for path in sorted(folder.rglob("*")):
        sync_path(path)
    sync_path(folder)


def sync_path(path: Path) -> None:
    """See that a file, or the names in a folder, are on the disk. Raises OSError."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)

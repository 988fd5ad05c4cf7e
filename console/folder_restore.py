"""Putting a restored site and a restored data folder in place together, whoever is killed in the middle.

Two folders cannot be replaced in one step. Both are complete on the disk first; then a note beside the data folder says
which take whose place; then they do, and the note goes. Killed before the note, everything is as it was; after it,
:func:`finish_restore` does the rest, which whoever opens the console's data calls first. While the note is locked,
somebody is at it.
"""

from __future__ import annotations

import fcntl
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import msgspec

from console.data_lock import LOCK_FILE, BusyDataError
from navcore.errors import InputError
from navcore.folder_swap import aside, keep_aside, recover, swap_in, sync_path
from navcore.misfit import words_of


class _Swap(msgspec.Struct, frozen=True):
    fresh: str
    folder: str
    keep: str | None


class _Note(msgspec.Struct, frozen=True):
    swaps: tuple[_Swap, ...]


def fresh_path(folder: Path) -> Path:
    """Return where what is restored to a folder is put together."""
    return folder.with_name(f".{folder.name}-restoring")


def kept_path(folder: Path) -> Path:
    """Return where what was in a folder before a restore is kept."""
    return folder.with_name(f"{folder.name}.before-restore")


def is_occupied(folder: Path) -> bool:
    """Say whether there is anything but a lock."""
    return folder.exists() and (not folder.is_dir() or any(each.name != LOCK_FILE for each in folder.iterdir()))


def put_in_place(site_folder: Path, data_folder: Path) -> None:
    """Let what is complete under :func:`fresh_path` take the place of both folders; what was there is kept.

    Raises OSError; then either nothing has changed, or :func:`finish_restore` goes on.
    """
    folders = site_folder.resolve(), data_folder.resolve()
    for each in folders:
        recover(each)
        shutil.rmtree(aside(each), ignore_errors=True)
    swaps = [
        _Swap(str(fresh_path(each)), str(each), str(kept_path(each)) if is_occupied(each) else None) for each in folders
    ]
    note = _note_path(data_folder)
    begun = note.with_name(f"{note.name}.new")
    handle = os.open(begun, os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC | os.O_NOFOLLOW, 0o600)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX)
        os.write(handle, msgspec.json.encode(_Note(tuple(swaps))))
        os.fsync(handle)
        os.replace(begun, note)
        sync_path(note.parent)
        _swap_all(_Note(tuple(swaps)), note)
    finally:
        os.close(handle)


def finish_restore(data_folder: Path) -> None:
    """Do the rest of a restore that was cut off. Raises BusyDataError while one is under way, InputError."""
    note = _note_path(data_folder)
    try:
        with _locked(note) as handle, os.fdopen(handle, "rb", closefd=False) as file:
            _refuse_of_another(handle, note)
            _swap_all(msgspec.json.decode(file.read(), type=_Note), note)
    except FileNotFoundError:
        return
    except (OSError, msgspec.MsgspecError, UnicodeDecodeError) as error:
        raise InputError(
            f"A backup was being restored here, and that cannot be brought to its end ({words_of(error)}): see to the"
            f" disk, and who may write in {note.parent}, then start again; {note.name} there says what takes whose"
            " place."
        ) from error


def _refuse_of_another(handle: int, note: Path) -> None:
    """See who has left the note: root is not to move folders by that of somebody else. Raises InputError."""
    if os.fstat(handle).st_uid not in (os.geteuid(), 0):
        raise InputError(
            f"Another user has begun to restore a backup here ({note.name} says so): do this as that user, or start the"
            " console as that user first, which brings it to its end."
        )


def _swap_all(note: _Note, path: Path) -> None:
    for each in note.swaps:
        fresh, folder = Path(each.fresh), Path(each.folder)
        keep = None if each.keep is None else Path(each.keep)
        # Whoever swapped before was killed: the old folder may wait aside still, or be kept already.
        if keep is not None:
            keep_aside(folder, keep)
        if fresh.exists():
            swap_in(fresh, folder, None if keep is not None and keep.exists() else keep)
        elif keep is None:
            shutil.rmtree(aside(folder), ignore_errors=True)
    path.unlink()
    sync_path(path.parent)


def _note_path(data_folder: Path) -> Path:
    resolved = data_folder.resolve()
    return resolved.with_name(f".{resolved.name}-restore.json")


@contextmanager
def _locked(note: Path) -> Iterator[int]:
    handle = os.open(note, os.O_RDONLY | os.O_CLOEXEC | os.O_NOFOLLOW)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        # Whoever was at it meanwhile has brought it to its end where the note is gone.
        note.lstat()
        yield handle
    except BlockingIOError as error:
        raise BusyDataError("A backup is being restored here: wait until that is done, then try again.") from error
    finally:
        os.close(handle)

"""Whether the device's own folder can be used: told at the start and by the doctor, in the same sentences.

Guidance hangs on nothing that is kept there: what cannot be read is left out, what cannot be written is lost, and both
are said, with what to do, a colon before it.
"""

from __future__ import annotations

import errno
import os
import pwd
import shlex
from collections.abc import Callable
from pathlib import Path

from device_agent.device_store import DeviceStore
from device_agent.journal import refuse_damaged
from device_agent.private_folder import make_private
from navcore.errors import InputError
from navcore.site_files import write_whole

_FULL = (errno.ENOSPC, errno.EDQUOT)
_FORBIDDEN = (errno.EACCES, errno.EPERM)


def refuse_unwritable(folder: Path) -> None:
    """Make the folder where it is missing, close it to others, and write to it.

    Raises InputError with what is wrong and what to do.
    """
    try:
        make_private(folder)
        probe = folder / ".probe"
        write_whole(probe, b"vbr\n")
        probe.unlink()
    except OSError as error:
        raise InputError(f"{_what_is_wrong(folder, error)}.") from error


def damages(store: DeviceStore) -> list[InputError]:
    """Return what is kept there and cannot be read, but for the calibration, which has a history of its own."""
    found = []
    looks: tuple[Callable[[], object], ...] = (
        store.stored_settings, store.load_consent, lambda: store.load_accesses(0.0),
        lambda: refuse_damaged(store.journal_path),
    )  # fmt: skip
    for look in looks:
        try:
            look()
        except InputError as error:
            found.append(error)
    return found


def largest_folders(folder: Path) -> str:
    """Say how to find what fills the disk of a folder that is there."""
    return f"`sudo du -xh {shlex.quote(str(_mount_point(folder)))} | sort -h | tail` shows the largest folders"


def _what_is_wrong(folder: Path, error: OSError) -> str:
    above = _nearest_that_is_there(folder)
    if isinstance(error, (FileExistsError, NotADirectoryError)):
        return f"{above} is a file, and the device's own folder cannot be there: name a folder with --state DIR"
    if error.errno == errno.EROFS:
        mounted = shlex.quote(str(_mount_point(above)))
        return (
            f"{folder} lies on a disk that can only be read: run `sudo mount -o remount,rw {mounted}`, or name another"
            " folder with --state DIR"
        )
    if error.errno in _FULL:
        return f"{folder} lies on a disk that is full: remove what is not needed; {largest_folders(above)}"
    if error.errno in _FORBIDDEN:
        user = _user()
        return (
            f"{folder} may not be written by the user {user}: run `sudo chown -R {user} {shlex.quote(str(above))}`, or"
            " name another folder with --state DIR"
        )
    return f"{folder} cannot be written ({error.strerror}): name another folder with --state DIR"


def _user() -> str:
    """Return the name of the user who runs this; the number of one who has no entry among the users."""
    try:
        return pwd.getpwuid(os.geteuid()).pw_name
    except KeyError:
        return str(os.geteuid())


def _nearest_that_is_there(path: Path) -> Path:
    return next((each for each in (path.absolute(), *path.absolute().parents) if os.path.lexists(each)), Path("/"))


def _mount_point(path: Path) -> Path:
    return next(each for each in (path.resolve(), *path.resolve().parents) if os.path.ismount(each))

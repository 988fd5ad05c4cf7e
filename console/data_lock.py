"""Who has a console's folder open, so that nothing is swapped from under a console that runs.

Everybody who opens the database shares the lock; who replaces the folder holds it alone. It ends with its process,
however that ends.
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
from pathlib import Path
from types import TracebackType

from console.plain_files import is_plain
from navcore.errors import InputError

LOCK_FILE = "console.lock"


class BusyDataError(InputError):
    """Somebody else has the folder open."""


class DataLock:
    """The lock of a folder that exists; held from the start until :meth:`close`."""

    def __init__(self, folder: Path, *, alone: bool = False) -> None:
        """Take it, without waiting. Raises BusyDataError, or OSError where the folder cannot be written."""
        self._handle = _locked(folder, fcntl.LOCK_EX if alone else fcntl.LOCK_SH)

    def close(self) -> None:
        """Give it back; a second time does nothing."""
        if self._handle is not None:
            os.close(self._handle)
            self._handle = None

    def __enter__(self) -> DataLock:
        """Return the lock."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Give it back."""
        self.close()


def _locked(folder: Path, how: int) -> int | None:
    path = folder / LOCK_FILE
    while True:
        handle = _opened(path)
        try:
            fcntl.flock(handle, how | fcntl.LOCK_NB)
            if os.path.samestat(os.fstat(handle), path.lstat()):
                return handle
        except FileNotFoundError:
            # The folder was replaced meanwhile: its lock is another file now.
            pass
        except BlockingIOError as error:
            os.close(handle)
            raise BusyDataError(
                f"The console's data in {folder} are in use: stop the console, or wait until what runs there (a backup,"
                " a restore) is done, then try again."
            ) from error
        os.close(handle)


def _opened(path: Path) -> int:
    """Open the lock's file, or make it. Raises OSError where something else has its name.

    Root takes it in a folder that is another user's, who may have put a link there to a file of root's.
    """
    flags = os.O_RDWR | os.O_CLOEXEC | os.O_NOFOLLOW
    while True:
        with contextlib.suppress(FileExistsError):
            return _made(path, flags)
        with contextlib.suppress(FileNotFoundError):
            handle = os.open(path, flags | os.O_NONBLOCK)
            if is_plain(handle):
                return handle
            os.close(handle)
            raise OSError(errno.EINVAL, f"{LOCK_FILE} is no plain file of its own: move it away", str(path))


def _made(path: Path, flags: int) -> int:
    handle = os.open(path, flags | os.O_CREAT | os.O_EXCL, 0o600)
    if os.geteuid() == 0:
        # A backup that root makes is not to lock out the user whom the console runs as.
        owner = path.parent.stat()
        os.fchown(handle, owner.st_uid, owner.st_gid)
    return handle

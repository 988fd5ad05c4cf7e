"""Files below a folder that may be another user's, opened as what they are, and through no link.

Root makes backups in the folder of the account that the console runs as. Whoever owns it could put a link there to a
file of root's, also between a look at a name and its opening: so each step of the way is opened by itself.
"""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path
from typing import BinaryIO

from navcore.errors import InputError

_STEP = os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC
# Not waiting: a pipe would keep who opens it waiting for ever.
_LAST = os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC


class LinkedError(InputError):
    """A link lies where a file or a folder of the console's own should be."""


def refuse_link(path: Path) -> None:
    """See that a path is no link itself. Raises LinkedError."""
    if path.is_symlink():
        raise _linked(path)


def open_below(folder: Path, name: str) -> BinaryIO:
    """Open a file to read it, by its name in a folder, as ``recordings/a.mcap``; the folder itself may be a link.

    Raises LinkedError where anything on the way is a link or no plain file, FileNotFoundError, or OSError.
    """
    *parents, last = name.split("/")
    at = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        for parent in parents:
            below = os.open(parent, _STEP, dir_fd=at)
            os.close(at)
            at = below
        handle = os.open(last, _LAST, dir_fd=at)
    except OSError as error:
        if error.errno in (errno.ELOOP, errno.ENOTDIR):
            raise _linked(folder / name) from error
        raise
    finally:
        os.close(at)
    if not stat.S_ISREG(os.fstat(handle).st_mode):
        os.close(handle)
        raise _linked(folder / name)
    return os.fdopen(handle, "rb")


def is_plain(handle: int) -> bool:
    """Say whether what was opened is a file that has no other name: what is written to it changes no other one."""
    found = os.fstat(handle)
    return stat.S_ISREG(found.st_mode) and found.st_nlink <= 1


def _linked(path: Path) -> LinkedError:
    return LinkedError(
        f"{path} is a link, lies behind one, or is no plain file or folder: it could lead out of the console's folders,"
        " and is not followed. Put what it leads to there itself (mount another disk there), then try again."
    )

"""What people are told where the console's disk takes nothing: full, read-only, or failing.

What was acknowledged is there; what cannot be written is refused in a sentence, and works again as soon as there is
room. Whoever is led, and who watches over them, goes on meanwhile: what a device tells is shown before it is stored.
"""

from __future__ import annotations

import errno
import sqlite3

from sqlalchemy.exc import OperationalError

from console.errors import ConsoleError, NoRoomError, UnavailableError

_NO_ROOM = "The disk of the console's machine is full, and nothing was changed: free it, then try again."
_READ_ONLY = (
    "The disk of the console's machine can only be read just now, and nothing was changed: have it looked after, then"
    " try again."
)
_FAILING = "The console's database cannot be used just now ({error}): see its log, then try again."
_BUSY = "The console's database is busy, and nothing was changed: try again in a moment."
_TOO_MANY_FILES = "The console has too many files and connections open just now: try again in a moment."
_PRIMARY_CODE = 0xFF
"""SQLite's extended codes have more above this."""


def refusal_of(error: Exception) -> ConsoleError | None:
    """Return what to tell where a disk or the database failed; None for any other error."""
    if isinstance(error, OperationalError):
        return _of_database(error)
    if isinstance(error, OSError) and error.errno is not None:
        return _of_disk(error.errno)
    return None


def is_for_want_of_room(error: OperationalError) -> bool:
    """Whether the database could not be written because its disk is full."""
    return _code(error) == sqlite3.SQLITE_FULL


def _code(error: OperationalError) -> int:
    return int(getattr(error.orig, "sqlite_errorcode", 0)) & _PRIMARY_CODE


def _of_database(error: OperationalError) -> ConsoleError:
    code = _code(error)
    if code == sqlite3.SQLITE_FULL:
        return NoRoomError(_NO_ROOM)
    if code == sqlite3.SQLITE_READONLY:
        return UnavailableError(_READ_ONLY)
    if code == sqlite3.SQLITE_BUSY:
        return UnavailableError(_BUSY)
    return UnavailableError(_FAILING.format(error=error.orig))


def _of_disk(number: int) -> ConsoleError | None:
    if number in (errno.ENOSPC, errno.EDQUOT):
        return NoRoomError(_NO_ROOM)
    if number == errno.EROFS:
        return UnavailableError(_READ_ONLY)
    if number in (errno.EMFILE, errno.ENFILE):
        return UnavailableError(_TOO_MANY_FILES)
    return None

"""Room that is put by while there is some: a console that has to start on a full disk starts by it.

SQLite needs some files of its own before anything can be read, and whoever watches over walkers needs the console.
"""

from __future__ import annotations

import contextlib
import os
from pathlib import Path

RESERVE_BYTES = 4 << 20
_FILE = "reserve"


def put_by(folder: Path) -> bool:
    """Take the room where it is not taken yet; return whether it is: where there is none, nothing is put by."""
    path = folder / _FILE
    with contextlib.suppress(OSError), path.open("ab") as out:
        if os.fstat(out.fileno()).st_blocks * 512 >= RESERVE_BYTES:
            return True
        try:
            os.posix_fallocate(out.fileno(), 0, RESERVE_BYTES)
        except OSError:
            # Half of it would help nobody.
            path.unlink()
        else:
            return True
    return False


def release(folder: Path) -> bool:
    """Give the room back; return whether there was some."""
    try:
        (folder / _FILE).unlink()
    except OSError:
        return False
    return True

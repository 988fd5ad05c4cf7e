"""Folders that only the device's own user may enter: where the walker went, what was said, and what the cameras saw."""

from __future__ import annotations

import contextlib
import stat
from pathlib import Path


def make_private(folder: Path) -> None:
    """Make a folder where it is missing (0700); close one that every local user may enter. Raises OSError.

    One that is open to a group alone was given to that group on purpose, and stays so; so does one that is everybody's
    (with the sticky bit, as ``/tmp``), or belongs to another user.
    """
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    mode = stat.S_IMODE(folder.stat().st_mode)
    if mode & stat.S_IRWXO and not mode & stat.S_ISVTX:
        # Another user's folder, or a disk that knows no rights: whoever could write to it still can.
        with contextlib.suppress(OSError):
            folder.chmod(0o700)

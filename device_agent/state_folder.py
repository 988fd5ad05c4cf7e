"""Where a device keeps its own files."""

from __future__ import annotations

import os
import re
from pathlib import Path

from navcore.errors import InputError


def default_state_folder(device_id: str) -> Path:
    """Return where a device keeps its own files. Raises InputError for what is no device id."""
    base = os.environ.get("XDG_STATE_HOME") or str(Path.home() / ".local" / "state")
    return Path(base) / "virtual-blind-road" / checked_device_id(device_id)


def checked_device_id(device_id: str) -> str:
    """Return the id. Raises InputError for what is none, or would lead out of the folder."""
    if re.fullmatch(r"[A-Za-z0-9_-]{1,60}", device_id) is None:
        raise InputError(f"{device_id!r} is no device id: use letters, digits, - and _ only.")
    return device_id

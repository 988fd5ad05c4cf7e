"""Where a device keeps its own files."""

from __future__ import annotations

import argparse
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


def add_state_options(parser: argparse.ArgumentParser) -> None:
    """Add ``--device-id`` and ``--state`` for commands that look at what a device keeps."""
    parser.add_argument("--device-id", default="glasses", help="which device it is (default: %(default)s)")
    parser.add_argument("--state", type=Path, metavar="DIR", help="the device's own folder, as in `vbr device`")


def state_folder_of(arguments: argparse.Namespace) -> Path:
    """Return the folder that such options name. Raises InputError."""
    folder: Path | None = arguments.state
    return folder or default_state_folder(arguments.device_id)

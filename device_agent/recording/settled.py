"""What has become of the files of walks on their way to the console: kept beside them in ``sent.json``."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from pathlib import Path

import msgspec

from navcore.site_files import write_whole

SENT_FILE = "sent.json"
"""In the folder of the recorded walks: which of them the console has, or will not have."""
_log = logging.getLogger(__name__)


class Settled(msgspec.Struct, frozen=True):
    """What became of a file."""

    failure: str = ""
    """Why it was not sent; empty where it was."""


def settled_in(folder: Path) -> dict[str, Settled]:
    """Return what became of the files of a folder, by name."""
    path = folder / SENT_FILE
    try:
        return msgspec.json.decode(path.read_bytes(), type=dict[str, Settled])
    except FileNotFoundError:
        return {}
    except (OSError, ValueError, RecursionError, msgspec.MsgspecError) as error:
        # Everything is offered again; the console says at once what it has already.
        _log.warning("%s is passed over, for it cannot be read: %s", path, error)
        return {}


def write_settled(folder: Path, settled: Mapping[str, Settled]) -> None:
    """Keep what became of them. Raises OSError."""
    write_whole(folder / SENT_FILE, msgspec.json.encode(settled))

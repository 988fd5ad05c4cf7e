"""The folder of one map walk: its recording, and in ``walk.json`` how far it has come.

``recording`` → ``recorded`` → ``built``, ``handed_over`` or ``failed``; ``handed_over`` → ``sent`` once the console has
it. What a device finds as ``recording`` or ``recorded`` at its start was broken off.
"""

from __future__ import annotations

import hashlib
import logging
import re
import shutil
from pathlib import Path
from typing import Literal

import msgspec

from device_agent.private_folder import make_private
from navcore.recording_archive import recording_files
from navcore.site_files import write_whole

Stage = Literal["recording", "recorded", "built", "handed_over", "sent", "failed"]
STATE_FILE, CHECKSUMS_FILE = "walk.json", "SHA256SUMS"
BROKEN_OFF: tuple[Stage, ...] = ("recording", "recorded")
"""What a walk that was not brought to an end is found as."""
_log = logging.getLogger(__name__)


class WalkState(msgspec.Struct, frozen=True):
    """What ``walk.json`` says."""

    stage: Stage
    date: str = ""
    """Day on which it was walked."""
    attempts: int = 0
    """How often building its map was begun."""
    reason: str = ""
    """Why it has failed."""


def new_walk(folder: Path, date: str) -> Path:
    """Make the folder of the next walk. Raises OSError."""
    make_private(folder)
    taken = [int(found[1]) for path in folder.iterdir() if (found := re.fullmatch(r"walk-(\d{4,9})", path.name))]
    # In one step: a folder that says nothing of itself would be a walk that failed, for ever.
    fresh = folder / ".new-walk"
    shutil.rmtree(fresh, ignore_errors=True)
    fresh.mkdir()
    write_state(fresh, WalkState("recording", date))
    return fresh.rename(folder / f"walk-{max(taken, default=0) + 1:04d}")


def walks_in(folder: Path) -> tuple[Path, ...]:
    """Return all walks, oldest first; none where the folder cannot be read, for nobody is to wait for a map walk."""
    try:
        return tuple(sorted(path for path in folder.iterdir() if path.name.startswith("walk-")))
    except (FileNotFoundError, NotADirectoryError):
        return ()
    except OSError as error:
        _log.warning("the map walks in %s cannot be listed, and wait: %s", folder, error)
        return ()


def handed_over(folder: Path) -> tuple[Path, ...]:
    """Return the walks whose recordings wait to be sent to the console's machine, oldest first."""
    return tuple(walk for walk in walks_in(folder) if read_state(walk).stage == "handed_over")


def read_state(walk: Path) -> WalkState:
    """Return how far a walk has come; one whose state cannot be read has failed, and its recording is left alone."""
    try:
        return msgspec.json.decode((walk / STATE_FILE).read_bytes(), type=WalkState)
    except (OSError, ValueError, RecursionError, msgspec.MsgspecError):
        # ValueError: what is no UTF-8 is told by Python's own error.
        return WalkState("failed")


def write_state(walk: Path, state: WalkState) -> None:
    """Write how far a walk has come, in one step. Raises OSError."""
    write_whole(walk / STATE_FILE, msgspec.json.encode(state))


def write_checksums(walk: Path) -> None:
    """Write the SHA-256 of every file of a recording, as ``sha256sum --check SHA256SUMS`` reads it. Raises OSError."""
    lines = []
    for path in recording_files(walk, (STATE_FILE, CHECKSUMS_FILE)):
        with path.open("rb") as file:
            lines.append(f"{hashlib.file_digest(file, 'sha256').hexdigest()}  {path.relative_to(walk).as_posix()}\n")
    write_whole(walk / CHECKSUMS_FILE, "".join(lines).encode())

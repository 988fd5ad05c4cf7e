"""What is recorded, where, for how long; and the flags that say so."""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

from navcore.errors import InputError

_GIB = 1 << 30
_DAY_S = 86_400.0


@dataclass(frozen=True, slots=True)
class RecordingOptions:
    """What is recorded, where, and for how long it is kept."""

    folder: Path
    pictures: bool = False
    """Colour, depth and fisheye pictures as well; without them, nobody who was met can be seen."""
    device_id: str = "glasses"
    max_part_bytes: int = _GIB // 2
    """A file ends when it has reached about this size, …"""
    max_part_s: float = 600.0
    """… or this age."""
    max_total_bytes: int = 16 * _GIB
    """All files of recordings in the folder together; old ones are removed (:mod:`device_agent.recording.room`)."""
    keep_s: float = 7 * _DAY_S
    """Older files are removed: a recording is for finding out what happened, not for good."""
    keep_free_bytes: int = 3 * _GIB // 2
    """Where less of the disk is free, recordings that the console has are removed, to have room for a map walk."""
    reserve_bytes: int = _GIB // 4
    """So much of the disk is left to the rest of the device. Where less is free, walks that the console does not have
    are removed as well, if that is enough; else nothing is recorded."""
    map_walks: Path | None = None
    """Folder of the map walks; those that the console has go as well when the disk gets full."""
    shared: bool = False
    """Walks are sent to the console, where people may look at them."""


def add_recording_options(parser: argparse._ActionsContainer) -> None:
    """Add ``--record`` and what belongs to it."""
    parser.add_argument(
        "--record", type=Path, metavar="DIR", help="record the walk as MCAP files (see docs/recording.md)"
    )
    parser.add_argument(
        "--record-pictures", action="store_true", help="record pictures as well: people who are met can be seen in them"
    )
    parser.add_argument(
        "--record-gb", type=float, default=16.0, metavar="GB", help="keep so much, at most (default: %(default)g)"
    )
    parser.add_argument(
        "--record-free-gb",
        type=float,
        default=1.5,
        metavar="GB",
        help="remove recordings that the console has where less of the disk is free; others only where there is no room"
        " to record at all (default: %(default)g)",
    )
    parser.add_argument(
        "--record-days",
        type=float,
        default=7.0,
        metavar="N",
        help="remove recordings after N days (default: %(default)g)",
    )
    parser.add_argument(
        "--share-walks",
        action="store_true",
        help="send recorded walks to the console, unless the walker has said otherwise (`vbr consent`): people there"
        " see where the walker went, and what was said",
    )


def recording_options(arguments: argparse.Namespace, device_id: str = "glasses") -> RecordingOptions | None:
    """Return what the flags say; None where nothing is to be recorded. Raises InputError."""
    folder: Path | None = arguments.record
    if folder is None:
        for flag, given in (("--record-pictures", arguments.record_pictures), ("--share-walks", arguments.share_walks)):
            if given:
                raise InputError(f"{flag} needs a folder for the recording: name it with --record DIR.")
        return None
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder} is a file: name a folder for the recordings.")
    if not 0.1 <= arguments.record_gb <= 100_000.0:
        raise InputError(f"--record-gb cannot be {arguments.record_gb:g}: give 0.1 to 100000.")
    if not 0.0 <= arguments.record_free_gb <= 100_000.0:
        raise InputError(f"--record-free-gb cannot be {arguments.record_free_gb:g}: give 0 to 100000.")
    if not 0.01 <= arguments.record_days <= 3650.0:
        raise InputError(f"--record-days cannot be {arguments.record_days:g}: give 0.01 to 3650.")
    total_bytes = round(arguments.record_gb * _GIB)
    return RecordingOptions(
        folder, arguments.record_pictures, device_id, min(_GIB // 2, total_bytes // 4),
        max_total_bytes=total_bytes, keep_s=arguments.record_days * _DAY_S,
        keep_free_bytes=round(arguments.record_free_gb * _GIB), shared=arguments.share_walks,
    )  # fmt: skip


def recording_flags(options: RecordingOptions | None) -> list[str]:
    """Return the flags that say so, for another process."""
    if options is None:
        return []
    flags = [
        "--record", str(options.folder), "--record-gb", f"{options.max_total_bytes / _GIB!r}",
        "--record-days", f"{options.keep_s / _DAY_S!r}", "--record-free-gb", f"{options.keep_free_bytes / _GIB!r}",
    ]  # fmt: skip
    also = (("--record-pictures", options.pictures), ("--share-walks", options.shared))
    return flags + [flag for flag, given in also if given]

"""What of the console that a restore replaces still holds: which numbers it has given to graphs.

How much is known by it depends on its history. Where it goes on from the backup, it is the console that the backup was
taken of, and has given every number since. Any other (one that was only just installed) tells nothing of what that one
has done since.
"""

from __future__ import annotations

import contextlib
import sqlite3
from dataclasses import dataclass
from pathlib import Path

from console.store import DATABASE_FILE, Store


@dataclass(frozen=True, slots=True)
class ReplacedConsole:
    """A console that is about to be replaced."""

    goes_on: bool
    """Whether it has all that the backup has, and what was done since."""
    newest_versions: dict[str, int]
    """Of the draft of each site, by its :func:`console.graph_store.graph_key`."""


def read_replaced(data_folder: Path, backup: Store) -> ReplacedConsole | None:
    """Return what a backup's database takes the place of; None where there is none, or it cannot be read."""
    if not (data_folder / DATABASE_FILE).is_file():
        return None
    try:
        with contextlib.closing(sqlite3.connect(data_folder / DATABASE_FILE)) as base:
            versions = base.execute("SELECT site_id, max(version) FROM graph_entries GROUP BY site_id").fetchall()
            return ReplacedConsole(_goes_on(base, backup), dict(versions))
    except sqlite3.Error:
        return None


def _goes_on(base: sqlite3.Connection, backup: Store) -> bool:
    """Say whether the last deed of the backup was done here too: deeds are never deleted, nor numbered twice."""
    last = next(iter(backup.latest_audit(1)), None)
    if last is None:
        return False
    same = "SELECT 1 FROM audit WHERE id = ? AND at_s = ? AND who = ? AND action = ?"
    return base.execute(same, (last.id, last.at_s, last.who, last.action)).fetchone() is not None

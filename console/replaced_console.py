"""What of the console that a restore replaces still holds: the numbers of its graphs, and what was taken back.

How much is known by it depends on its history. Where it goes on from the backup, it is the console that the backup was
taken of: it has given every number since, and whom it has locked out since stays so. Any other (one that was only just
installed) tells nothing of what that one has done.
"""

from __future__ import annotations

import contextlib
import sqlite3
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sqlalchemy import update

from console.store import DATABASE_FILE, Store
from console.tables import DeviceTokenRow, UserRow


@dataclass(frozen=True, slots=True)
class ReplacedConsole:
    """A console that is about to be replaced."""

    goes_on: bool
    """Whether it has all that the backup has, and what was done since."""
    newest_versions: dict[str, int]
    """Of the draft of each site, by its :func:`console.graph_store.graph_key`."""
    accounts: tuple[dict[str, Any], ...]
    """Of each its id, and what may have been changed."""
    tokens: tuple[dict[str, Any], ...]
    """Of devices: the name of each, and what may have been changed."""


def read_replaced(data_folder: Path, backup: Store) -> ReplacedConsole | None:
    """Return what a backup's database takes the place of; None where there is none, or it cannot be read."""
    if not (data_folder / DATABASE_FILE).is_file():
        return None
    try:
        with contextlib.closing(sqlite3.connect(data_folder / DATABASE_FILE)) as base:
            versions = base.execute("SELECT site_id, max(version) FROM graph_entries GROUP BY site_id").fetchall()
            base.row_factory = _by_name
            accounts = base.execute("SELECT id, password_hash, role, disabled_at_s FROM users").fetchall()
            tokens = base.execute(
                "SELECT name, token_hash, created_by, created_at_s, revoked_at_s FROM device_tokens"
            ).fetchall()
            return ReplacedConsole(_goes_on(base, backup), dict(versions), tuple(accounts), tuple(tokens))
    except sqlite3.Error:
        return None


def carry_over(replaced: ReplacedConsole, store: Store) -> bool:
    """Let accounts and device tokens that the backup has be as they are now; those made since are not in it.

    Only where the replaced console goes on from the backup: another one's may have the same ids and names. Returns
    whether it does.
    """
    if not replaced.goes_on:
        return False
    with store.writing() as session:
        for account in replaced.accounts:
            session.execute(update(UserRow).where(UserRow.id == account["id"]).values(account))
        for token in replaced.tokens:
            session.execute(update(DeviceTokenRow).where(DeviceTokenRow.name == token["name"]).values(token))
    return True


def _by_name(cursor: sqlite3.Cursor, row: tuple[Any, ...]) -> dict[str, Any]:
    return {column[0]: value for column, value in zip(cursor.description, row, strict=True)}


def _goes_on(base: sqlite3.Connection, backup: Store) -> bool:
    """Say whether the last deed of the backup was done here too: deeds are never deleted, nor numbered twice."""
    last = next(iter(backup.latest_audit(1)), None)
    if last is None:
        return False
    same = "SELECT 1 FROM audit WHERE id = ? AND at_s = ? AND who = ? AND action = ?"
    return base.execute(same, (last.id, last.at_s, last.who, last.action)).fetchone() is not None

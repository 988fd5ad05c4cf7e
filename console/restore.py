"""Restoring a console from a backup: everything is unpacked beside its place and checked before anything changes."""

from __future__ import annotations

import contextlib
import os
import shutil
import sqlite3
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from sqlalchemy import func, select

from console.audit_command import command_line
from console.backup_archive import BackupArchive, BackupError, BackupManifest, Progress, opened_backup
from console.data_lock import LOCK_FILE, DataLock
from console.folder_restore import finish_restore, fresh_path, is_occupied, kept_path, put_in_place
from console.graph_store import graph_key
from console.opening import open_model
from console.plain_files import refuse_link
from console.replaced_console import ReplacedConsole, carry_over, read_replaced
from console.retention import believe_clock
from console.store import DATABASE_FILE, Store
from console.tables import GraphEntryRow
from navcore.errors import InputError
from navcore.folder_swap import recover, sync_tree
from navcore.site import load_site, map_checksum
from navcore.site_files import MANIFEST as SITE_MANIFEST

_UNKNOWN_VERSIONS_COUNT = 1000
"""So many versions may have been made since the backup where nobody can look: devices may run any of them. What is
replaced can be looked at only if it goes on from the backup; a console that was just installed knows of none.
"""
_PARTS = ("site", "data")
_DATABASE = f"data/{DATABASE_FILE}"


@dataclass(frozen=True, slots=True)
class Restored:
    """What was restored, and where what was there before is kept."""

    manifest: BackupManifest
    graph_version: int
    """Of the draft PoI-graph, as it is numbered now: no two graphs share a number."""
    kept: tuple[Path, ...]
    are_rights_of_now: bool
    """Whether what was taken back since the backup stays taken back (:func:`console.replaced_console.carry_over`)."""


def verify_backup(file: Path, progress: Progress = lambda share: None) -> BackupManifest:
    """Check all of a backup without restoring it. Raises BackupError, SiteError or InputError with what is wrong."""
    with opened_backup(file) as archive, tempfile.TemporaryDirectory(prefix="vbr-verify-") as work, _told():
        folders = {part: Path(work) / part for part in _PARTS}
        # Recordings are large, and only looked through.
        wanted = {name for name in archive.manifest.files if name.startswith("site/") or name == _DATABASE}
        _unpack(archive, folders, progress, wanted)
        _check(archive.manifest, folders["site"], folders["data"])
        return archive.manifest


def restore(
    file: Path,
    site_folder: Path,
    data_folder: Path,
    *,
    replace: bool = False,
    wall_s: Callable[[], float] = time.time,
    progress: Progress = lambda share: None,
) -> Restored:
    """Make site and console's folder those of a backup; what is there is replaced only if ``replace``, and kept aside.

    Raises BackupError, SiteError or InputError with what is wrong, BusyDataError while a console runs there; nothing
    has changed then, or, where only the swap itself failed, the next start goes on with it.
    """
    site_folder, data_folder = site_folder.resolve(), data_folder.resolve()
    if site_folder == data_folder or site_folder in data_folder.parents or data_folder in site_folder.parents:
        raise BackupError("Site and data would lie in one another: name two folders with --site and --data.")
    finish_restore(data_folder)
    with opened_backup(file) as archive, _told(), _held(data_folder):
        _refuse_occupied(site_folder, data_folder, replace)
        fresh = {"site": fresh_path(site_folder), "data": fresh_path(data_folder)}
        _make_room(archive, fresh)
        try:
            _unpack(archive, fresh, progress)
            _check(archive.manifest, fresh["site"], fresh["data"])
            are_rights_of_now, graph_version = _prepare(
                archive.manifest, fresh["site"], fresh["data"], data_folder, wall_s
            )
            for folder in fresh.values():
                sync_tree(folder)
            # Somebody may have come meanwhile: unpacking takes long.
            _refuse_occupied(site_folder, data_folder, replace)
            kept = tuple(kept_path(each) for each in (site_folder, data_folder) if is_occupied(each))
            put_in_place(site_folder, data_folder)
        except BaseException:
            _finish_or_clear(data_folder, fresh)
            raise
    return Restored(archive.manifest, graph_version, kept, are_rights_of_now)


def _finish_or_clear(data_folder: Path, fresh: dict[str, Path]) -> None:
    """After a failure: what is not being put in place is cleared away."""
    with contextlib.suppress(InputError):
        finish_restore(data_folder)
        for folder in fresh.values():
            shutil.rmtree(folder, ignore_errors=True)


@contextmanager
def _told() -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise BackupError(
            f"The backup cannot be unpacked ({error.strerror or error}): free the disk, and see who may write beside"
            " the folders that are restored."
        ) from error


@contextmanager
def _held(data_folder: Path) -> Iterator[None]:
    """Keep consoles out of the folder; one that was made for that alone goes again where nothing came into it."""
    was_there = data_folder.exists()
    data_folder.mkdir(parents=True, exist_ok=True, mode=0o700)
    lock = DataLock(data_folder, alone=True)
    try:
        yield
    finally:
        lock.close()
        if not was_there and not is_occupied(data_folder):
            (data_folder / LOCK_FILE).unlink(missing_ok=True)
            data_folder.rmdir()


def _refuse_occupied(site_folder: Path, data_folder: Path, replace: bool) -> None:
    recover(site_folder)
    for folder, sign in ((site_folder, SITE_MANIFEST), (data_folder, DATABASE_FILE)):
        if not is_occupied(folder):
            continue
        refuse_link(folder / sign)
        if not (folder / sign).is_file():
            raise BackupError(f"{folder} holds other files: name an empty folder, or one that a console has used.")
        if not replace:
            raise BackupError(
                f"{folder} is in use already: name another folder, or say --replace; what is there is kept then as"
                f" {kept_path(folder).name}."
            )
        if kept_path(folder).exists():
            raise BackupError(
                f"{kept_path(folder)} is there from an earlier restore: see whether anything in it is still needed, and"
                " move or delete it first."
            )


def _make_room(archive: BackupArchive, fresh: dict[str, Path]) -> None:
    for part, folder in fresh.items():
        # Left behind by a restore that was killed.
        shutil.rmtree(folder, ignore_errors=True)
        folder.parent.mkdir(parents=True, exist_ok=True)
        files = archive.manifest.files.items()
        needed_bytes = sum(entry.size for name, entry in files if name.startswith(f"{part}/"))
        free_bytes = shutil.disk_usage(folder.parent).free
        if free_bytes < needed_bytes:
            raise BackupError(
                f"There is no room for the backup in {folder.parent}: it takes {-(-needed_bytes >> 20)} MiB and there"
                f" are {free_bytes >> 20} MiB; free the disk."
            )


def _unpack(
    archive: BackupArchive, folders: dict[str, Path], progress: Progress, wanted: set[str] | None = None
) -> None:
    """Unpack everything, or what is wanted, and read the rest: all of it is held against the list."""
    total_bytes, done_bytes = max(1, archive.size_bytes), 0

    def on_bytes(count: int) -> None:
        nonlocal done_bytes
        done_bytes += count
        progress(min(1.0, done_bytes / total_bytes))

    folders["site"].mkdir(mode=0o755, parents=True)
    folders["data"].mkdir(mode=0o700, parents=True)
    for name in archive.manifest.files:
        if wanted is not None and name not in wanted:
            archive.extract(name, None, on_bytes)
            continue
        part, _, rest = name.partition("/")
        target = folders[part] / rest
        target.parent.mkdir(parents=True, exist_ok=True, mode=0o700 if part == "data" else 0o755)
        mode = 0o600 if part == "data" else 0o644
        handle = os.open(target, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, mode)
        with os.fdopen(handle, "wb") as out:
            archive.extract(name, out, on_bytes)


def _check(manifest: BackupManifest, site_folder: Path, data_folder: Path) -> None:
    """See that a console can serve what was unpacked. Raises BackupError, SiteError, InputError."""
    if _DATABASE not in manifest.files or f"site/{SITE_MANIFEST}" not in manifest.files:
        raise BackupError("The backup lacks the database or the site: take another backup.")
    load_site(site_folder)
    if map_checksum(site_folder) != manifest.map_sha256:
        raise BackupError("The backup holds another map than it says: take another backup.")
    try:
        with contextlib.closing(sqlite3.connect(data_folder / DATABASE_FILE)) as base:
            base.execute("PRAGMA trusted_schema=OFF")
            found = base.execute("PRAGMA integrity_check(1)").fetchone()[0]
            loose = base.execute("PRAGMA foreign_key_check").fetchone()
    except sqlite3.Error as error:
        raise BackupError(f"The database in the backup cannot be read ({error}): take another backup.") from error
    if found != "ok" or loose is not None:
        raise BackupError("The database in the backup is damaged: take another backup.")
    # Brings an older database up to this program's version, and refuses a newer one.
    Store.open(data_folder).close()


def _prepare(
    manifest: BackupManifest,
    site_folder: Path,
    data_folder: Path,
    replaced_folder: Path,
    wall_s: Callable[[], float],
) -> tuple[bool, int]:
    """Make what was unpacked the console's of now: devices may run a later graph than any that it knows.

    Returns whether accounts and device tokens are those of now, and the version of the draft.
    """
    store = Store.open(data_folder, wall_s)
    try:
        site = load_site(site_folder)
        key = graph_key(site.site_id, manifest.map_sha256)
        replaced = read_replaced(replaced_folder, store)
        are_rights_of_now = replaced is not None and carry_over(replaced, store)
        known = _newest_known(store, key, replaced)
        model = open_model(store, site, site_folder)
        model.number_beyond(known)
        believe_clock(store)
        when = time.strftime("%Y-%m-%d %H:%M UTC", time.gmtime(manifest.made_at_s))
        store.audit(command_line(), "restored", f"a backup of {when}")
        return are_rights_of_now, model.graph.version
    finally:
        store.close()


def _newest_known(store: Store, key: str, replaced: ReplacedConsole | None) -> int:
    """Return the highest version that any device may run of the site."""
    with store.reading() as session:
        newest = session.scalar(select(func.max(GraphEntryRow.version)).where(GraphEntryRow.site_id == key)) or 0
    if replaced is None or not replaced.goes_on:
        newest += _UNKNOWN_VERSIONS_COUNT
    return newest if replaced is None else max(newest, replaced.newest_versions.get(key, 0))

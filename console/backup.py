"""Making a backup of a console, also while it runs and people edit.

The database is copied as it was at one instant (SQLite's own online backup); the PoI-graph in the site is the one that
was published at that instant, and the other files are those of then or a moment later: a recording that has come since,
more messages of an incident that is being kept. What is made anew by itself is left out.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import shutil
import sqlite3
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

from sqlalchemy import delete

from console.backup_archive import (
    FORMAT,
    SCHEMA_VERSION,
    BackupError,
    BackupManifest,
    BackupWriter,
    Progress,
    is_backup_name,
)
from console.data_lock import DataLock
from console.folder_restore import finish_restore
from console.graph_store import StoredGraphLog, graph_key
from console.plain_files import open_below, refuse_link
from console.store import DATABASE_FILE, Store
from console.tables import SCHEMA_VERSION as DATABASE_SCHEMA
from console.tables import OneTimeLinkRow, SessionRow
from navcore.errors import SiteError
from navcore.folder_swap import recover, sync_path
from navcore.site import GRAPH_FILE, load_poi_graph, map_checksum, save_poi_graph
from navcore.site_files import MANIFEST as SITE_MANIFEST
from navcore.site_files import Manifest, read_manifest

KEPT_FOLDERS = ("recordings", "incidents", "maps")
"""Of the console's folder, beside the database."""
MADE_ANEW = ("package", "surveys", "what-if")
"""These are not kept: the console makes them again when they are needed."""
_UNFINISHED = ".part"
_LOCK_WAIT_S = 10.0


@dataclass(frozen=True, slots=True)
class BackupMade:
    """A backup that is whole on the disk."""

    file: Path
    size_bytes: int
    manifest: BackupManifest
    left_out: tuple[Path, ...]
    """Files that are none of the console's: with names that it gives to none, links, and folders that it does not know.
    """


@dataclass(frozen=True, slots=True)
class _Source:
    part: str
    folder: Path
    name: str
    """In the folder."""
    size_bytes: int


def back_up(
    site_folder: Path,
    data_folder: Path,
    file: Path,
    *,
    wall_s: Callable[[], float] = time.time,
    progress: Progress = lambda share: None,
) -> BackupMade:
    """Write a backup to a new file. The console may run.

    Raises BackupError where it cannot be written or there is such a file, SiteError, or InputError where the database
    is damaged, or a link lies where it or one of the folders should; then there is no new file.
    """
    if file.exists():
        raise BackupError(f"{file} is there already: name a new file.")
    if not file.parent.is_dir():
        raise BackupError(f"There is no folder {file.parent} for the backup: make it, or name a file in another one.")
    if not (data_folder / DATABASE_FILE).is_file():
        raise BackupError(f"There is no console's database in {data_folder}: name its folder with --data.")
    finish_restore(data_folder)
    try:
        with DataLock(data_folder), _work_folder(file) as work:
            return _backed_up(site_folder, data_folder, file, work, wall_s, progress)
    except OSError as error:
        raise BackupError(
            f"The backup {file} cannot be written ({error.strerror or error}): free the disk, or name another one's"
            " folder."
        ) from error


def _backed_up(
    site_folder: Path, data_folder: Path, file: Path, work: Path, wall_s: Callable[[], float], progress: Progress
) -> BackupMade:
    recover(site_folder)
    _refuse_links(site_folder, data_folder)
    site, map_sha256 = read_manifest(site_folder), map_checksum(site_folder)
    made_at_s = wall_s()
    _copy_database(data_folder / DATABASE_FILE, work / DATABASE_FILE)
    graph_folder, versions = _prepared(work, site_folder, site, graph_key(site.site_id, map_sha256))
    kept, left_out = _kept_files(data_folder)
    sources = [*_site_files(site_folder, site, graph_folder), _source("data", work, DATABASE_FILE), *kept]
    _refuse_without_room(work, sources)
    archive = work / "backup.zip"
    with archive.open("xb") as out, contextlib.closing(BackupWriter(out)) as writer:
        _add_all(writer, sources, progress)
        _check_site(writer, site_folder, site)
        manifest = BackupManifest(
            FORMAT, SCHEMA_VERSION, metadata.version("virtual-blind-road"), DATABASE_SCHEMA, made_at_s, site.site_id,
            site.name, map_sha256, *versions, writer.files,
        )  # fmt: skip
        writer.finish(manifest)
    archive.chmod(0o600)
    sync_path(archive)
    os.replace(archive, file)
    sync_path(file.absolute().parent)
    return BackupMade(file, file.stat().st_size, manifest, tuple(left_out))


@contextlib.contextmanager
def _work_folder(file: Path) -> Iterator[Path]:
    """Give a folder beside the file, for this backup alone; who is killed leaves it to the next. Raises OSError."""
    work = file.with_name(f".{file.name}.work")
    work.mkdir(mode=0o700, exist_ok=True)
    handle = os.open(work, os.O_RDONLY | os.O_CLOEXEC)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        os.close(handle)
        raise BackupError(f"The backup {file} is being made already: wait for it, or name another file.") from error
    try:
        for left in work.iterdir():
            shutil.rmtree(left) if left.is_dir() else left.unlink()
        yield work
    finally:
        shutil.rmtree(work, ignore_errors=True)
        os.close(handle)


# ------------------------------------------------------------------------------------------------------ the instant
def _copy_database(source: Path, target: Path) -> None:
    """Copy a database as it is at one instant, whoever writes meanwhile, and see that it is sound."""
    try:
        with (
            contextlib.closing(sqlite3.connect(source, timeout=_LOCK_WAIT_S)) as live,
            contextlib.closing(sqlite3.connect(target)) as copy,
        ):
            # One read transaction around all steps: what is written meanwhile goes into the log, and not into the copy.
            live.execute("BEGIN")
            live.execute("SELECT count(*) FROM sqlite_master").fetchone()
            live.backup(copy, pages=-1)
            live.rollback()
            found = copy.execute("PRAGMA integrity_check(1)").fetchone()[0]
    except sqlite3.Error as error:
        raise BackupError(
            f"The database {source} cannot be read ({error}): see to the disk; what it was is in an earlier backup."
        ) from error
    if found != "ok":
        raise BackupError(f"The database {source} is damaged ({found}): restore it from an earlier backup.")


def _prepared(work: Path, site_folder: Path, site: Manifest, key: str) -> tuple[Path, tuple[int, int]]:
    """Take out of the copied database what must not come back, and write the graph that was published then.

    Returns the folder with that graph, and the versions of draft and published graph.
    """
    store = Store.open(work)
    try:
        with store.writing() as session:
            # Who has signed out, or used a link, since must not be let in again by a restore.
            session.execute(delete(SessionRow))
            session.execute(delete(OneTimeLinkRow))
        log = StoredGraphLog(store, key, site.name)
        published, newest = log.published(), next(iter(log.newest(1)), None)
    finally:
        store.forget_deleted()
        store.close()
    graph = load_poi_graph(site_folder) if published is None else published.graph
    graph_folder = work / "graph"
    graph_folder.mkdir()
    save_poi_graph(graph, graph_folder)
    return graph_folder, (0 if newest is None else newest.version, graph.version)


# -------------------------------------------------------------------------------------------------------- the files
def _source(part: str, folder: Path, name: str) -> _Source:
    return _Source(part, folder, name, (folder / name).lstat().st_size)


def _refuse_links(site_folder: Path, data_folder: Path) -> None:
    """See that what is read by its path is no link, and that none takes the place of a whole folder's files."""
    for path in (site_folder / SITE_MANIFEST, site_folder / GRAPH_FILE, data_folder / DATABASE_FILE):
        refuse_link(path)
    for name in KEPT_FOLDERS:
        refuse_link(data_folder / name)


def _site_files(site_folder: Path, site: Manifest, graph_folder: Path) -> list[_Source]:
    names = [SITE_MANIFEST, *sorted(site.files)]
    if strange := [name for name in names if not is_backup_name(f"site/{name}")]:
        raise SiteError(f"The site {site_folder} names a file {strange[0][:100]!r} that is none of a site.")
    try:
        return [*(_source("site", site_folder, name) for name in names), _source("site", graph_folder, GRAPH_FILE)]
    except FileNotFoundError as error:
        raise SiteError(f"The site {site_folder} lacks {error.filename}: build the map again.") from error


def _kept_files(data_folder: Path) -> tuple[list[_Source], list[Path]]:
    """Return what is kept of the console's folder, and what nobody knows there."""
    kept, strange = list[_Source](), list[Path]()
    for folder in KEPT_FOLDERS:
        for path in _files_below(data_folder / folder):
            name = path.relative_to(data_folder).as_posix()
            if path.is_symlink() or not is_backup_name(f"data/{name}"):
                strange.append(path)
            elif not (folder == "recordings" and path.suffix == _UNFINISHED):
                # It may be deleted meanwhile, as what is too old is.
                with contextlib.suppress(FileNotFoundError):
                    kept.append(_source("data", data_folder, name))
    known = {*KEPT_FOLDERS, *MADE_ANEW}
    strange += [path for path in sorted(data_folder.iterdir()) if path.is_dir() and path.name not in known]
    return kept, strange


def _files_below(folder: Path) -> Iterator[Path]:
    """Give every file, and links; not what begins with a dot, as all does that is being written."""
    for parent, folders, files in os.walk(folder):
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        # Nobody goes into a folder that is a link.
        for name in sorted([*files, *(name for name in folders if (Path(parent) / name).is_symlink())]):
            if not name.startswith("."):
                yield Path(parent) / name


def _refuse_without_room(work: Path, sources: list[_Source]) -> None:
    needed_bytes, free_bytes = sum(source.size_bytes for source in sources), shutil.disk_usage(work).free
    if free_bytes < needed_bytes:
        raise BackupError(
            f"There is no room for the backup: it takes {-(-needed_bytes >> 20)} MiB and {work.parent.absolute()} has"
            f" {free_bytes >> 20} MiB; free the disk, or name a file on another one."
        )


def _add_all(writer: BackupWriter, sources: list[_Source], progress: Progress) -> None:
    total_bytes, done_bytes = max(1, sum(source.size_bytes for source in sources)), 0

    def on_bytes(count: int) -> None:
        nonlocal done_bytes
        done_bytes += count
        progress(min(1.0, done_bytes / total_bytes))

    for source in sources:
        # Deleted since it was seen: then it is not kept, as if it had been deleted a moment earlier.
        with contextlib.suppress(FileNotFoundError), open_below(source.folder, source.name) as file:
            writer.add(f"{source.part}/{source.name}", file, source.size_bytes, on_bytes)


def _check_site(writer: BackupWriter, site_folder: Path, site: Manifest) -> None:
    for name, entry in site.files.items():
        if writer.files.get(f"site/{name}") != entry:
            raise SiteError(f"{name} of the site {site_folder} is damaged, or has just been replaced: try again.")

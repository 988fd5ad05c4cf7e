"""A backup of a console as one file: a zip archive with a list of all that is in it.

::

    BACKUP.zip
      site/…            the site's folder (see navcore.site), with the PoI-graph that was published at the instant
      data/…            the console's folder: console.sqlite3, recordings/, incidents/, maps/
      backup.json       format, schema version, when and of which site it was made; of each file its size and SHA-256

Nothing is packed: recordings are already, so what an archive unpacks to is no larger than the archive is. Reading
believes nothing: names, kinds and sizes are looked at before anything is written, and each file is held against the
list while it is read. The list shows damage, not malice: who can change the archive can change its list. Files pass
through memory in pieces, of any size.
"""

from __future__ import annotations

import contextlib
import hashlib
import re
import stat
import struct
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

import msgspec

from navcore.errors import InputError
from navcore.misfit import words_of
from navcore.site_files import FileEntry
from navcore.zip_end import read_zip_end

FORMAT = "vbr-console-backup"
SCHEMA_VERSION = 1
MANIFEST = "backup.json"
MAX_FILE_COUNT = 200_000
_MAX_LIST_BYTES = 64 << 20
"""Of the archive's own list, and of ours."""
_NAME = re.compile(r"(site|data)(/[A-Za-z0-9_][A-Za-z0-9_.+-]{0,199}){1,4}")
_PIECE_BYTES = 1 << 20
_ENCRYPTED = 0x1
_OTHER = "take another backup"

Progress = Callable[[float], None]
"""Hears which share is done."""


class BackupError(InputError):
    """A backup is damaged, newer than this program, or none; or it cannot be made or restored."""


class BackupManifest(msgspec.Struct, frozen=True):
    """What a backup says of itself."""

    format: str
    schema_version: int
    software_version: str
    database_schema: int
    """:data:`console.tables.SCHEMA_VERSION` of the database in it."""
    made_at_s: float
    """Unix time of the instant that it shows."""
    site_id: str
    site_name: str
    map_sha256: str
    """As :func:`navcore.site.map_checksum` has it."""
    graph_version: int
    """Of the draft PoI-graph; 0 where nobody has opened this map yet."""
    published_version: int
    """Of the PoI-graph that devices were given; 0 where there was none."""
    files: dict[str, FileEntry]


def is_backup_name(name: str) -> bool:
    """Say whether a file of this name can be in a backup."""
    return _NAME.fullmatch(name) is not None


class BackupWriter:
    """Writes an archive, file by file, and its list at last."""

    def __init__(self, out: BinaryIO) -> None:
        self._archive = zipfile.ZipFile(out, "w", zipfile.ZIP_STORED)
        self.files: dict[str, FileEntry] = {}

    def add(self, name: str, source: BinaryIO, size_bytes: int, on_bytes: Callable[[int], None]) -> FileEntry:
        """Copy the first ``size_bytes`` of a file; a shorter one goes as it is. Raises OSError."""
        digest, copied_bytes = hashlib.sha256(), 0
        with self._archive.open(_member(name), "w", force_zip64=size_bytes >= zipfile.ZIP64_LIMIT) as target:
            while piece := source.read(min(_PIECE_BYTES, size_bytes - copied_bytes)):
                target.write(piece)
                digest.update(piece)
                copied_bytes += len(piece)
                on_bytes(len(piece))
        self.files[name] = entry = FileEntry(copied_bytes, digest.hexdigest())
        return entry

    def finish(self, manifest: BackupManifest) -> None:
        """Write the list and end. Raises OSError."""
        with self._archive.open(_member(MANIFEST), "w") as target:
            target.write(msgspec.json.format(msgspec.json.encode(manifest), indent=1))
        self._archive.close()

    def close(self) -> None:
        """Let go of the file while it is open; without its list before, it is no backup."""
        with contextlib.suppress(OSError):
            self._archive.close()


def _member(name: str) -> zipfile.ZipInfo:
    member = zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0))
    member.create_system, member.external_attr = 3, 0o100600 << 16
    return member


class BackupArchive:
    """A backup that was opened: its list fits what is in it; the files themselves are checked as they are read."""

    def __init__(self, archive: zipfile.ZipFile, manifest: BackupManifest) -> None:
        self._archive, self.manifest = archive, manifest
        self.size_bytes = sum(entry.size for entry in manifest.files.values())
        """All files together."""

    def extract(self, name: str, out: BinaryIO | None, on_bytes: Callable[[int], None]) -> None:
        """Copy a file, or only read it, and hold it against the list. Raises BackupError where it differs, OSError."""
        entry, digest, left_bytes = self.manifest.files[name], hashlib.sha256(), self.manifest.files[name].size
        try:
            with self._archive.open(name) as source:
                while piece := source.read(min(_PIECE_BYTES, left_bytes)):
                    digest.update(piece)
                    left_bytes -= len(piece)
                    on_bytes(len(piece))
                    if out is not None:
                        out.write(piece)
        except (zipfile.BadZipFile, EOFError, ValueError, NotImplementedError, struct.error) as error:
            raise BackupError(f"{name} of the backup is damaged ({error}): {_OTHER}.") from error
        if left_bytes or digest.hexdigest() != entry.sha256:
            raise BackupError(f"{name} of the backup is damaged (its checksum is another): {_OTHER}.")


@contextmanager
def opened_backup(path: Path) -> Iterator[BackupArchive]:
    """Open a backup and look at its list. Raises BackupError."""
    try:
        file = path.open("rb")
    except OSError as error:
        raise BackupError(f"The backup {path} cannot be read ({error.strerror}): name another file.") from error
    with file:
        try:
            _refuse_long_list(file)
            archive = zipfile.ZipFile(file)
        except (zipfile.BadZipFile, struct.error, OSError, ValueError, NotImplementedError) as error:
            raise BackupError(f"{path} is no backup, or is cut off ({error}): {_OTHER}.") from error
        with archive:
            members = _checked_members(archive, path.stat().st_size)
            manifest = _read_manifest(archive, members)
            _check_list(members, manifest)
            yield BackupArchive(archive, manifest)


def _refuse_long_list(file: BinaryIO) -> None:
    """See how long the archive's list is before it is taken into memory. Raises BadZipFile."""
    end = read_zip_end(file)
    if end.count > MAX_FILE_COUNT + 1 or end.list_bytes > _MAX_LIST_BYTES:
        raise zipfile.BadZipFile("its list is longer than that of a backup")
    file.seek(0)


def _checked_members(archive: zipfile.ZipFile, size_bytes: int) -> dict[str, zipfile.ZipInfo]:
    members: dict[str, zipfile.ZipInfo] = {}
    for member in archive.infolist():
        name = member.filename
        if not (name == MANIFEST or is_backup_name(name)) or name != member.orig_filename:
            raise BackupError(f"The backup holds {name[:100]!r}, which is no file of a backup: {_OTHER}.")
        if name in members:
            raise BackupError(f"The backup holds {name} twice: {_OTHER}.")
        mode = member.external_attr >> 16
        if member.flag_bits & _ENCRYPTED or member.compress_type != zipfile.ZIP_STORED or stat.S_ISLNK(mode):
            raise BackupError(f"{name} of the backup is not stored as backups are: {_OTHER}.")
        members[name] = member
    if sum(member.file_size for member in members.values()) > size_bytes:
        raise BackupError(f"The backup claims to hold more than it is large: {_OTHER}.")
    return members


class _Version(msgspec.Struct, frozen=True):
    """Looked at first: a newer list may have another form."""

    format: str
    schema_version: int


def _read_manifest(archive: zipfile.ZipFile, members: dict[str, zipfile.ZipInfo]) -> BackupManifest:
    if MANIFEST not in members or members[MANIFEST].file_size > _MAX_LIST_BYTES:
        raise BackupError(f"The file is no backup of a console (it has no {MANIFEST} of its own): {_OTHER}.")
    try:
        data = archive.read(MANIFEST)
        version = msgspec.json.decode(data, type=_Version)
        if version.format == FORMAT and version.schema_version > SCHEMA_VERSION:
            raise BackupError(
                f"The backup was made by a newer program (schema {version.schema_version}, this one knows"
                f" {SCHEMA_VERSION}): update this program."
            )
        manifest = msgspec.json.decode(data, type=BackupManifest)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError, zipfile.BadZipFile, EOFError) as error:
        raise BackupError(f"The list of files in the backup cannot be read ({words_of(error)}): {_OTHER}.") from error
    if manifest.format != FORMAT or manifest.schema_version < 1:
        raise BackupError(f"The file is no backup of a console: {_OTHER}.")
    return manifest


def _check_list(members: dict[str, zipfile.ZipInfo], manifest: BackupManifest) -> None:
    inside = set(members) - {MANIFEST}
    if missing := sorted(set(manifest.files) - inside):
        raise BackupError(f"The backup lacks {missing[0][:100]}: {_OTHER}.")
    if extra := sorted(inside - set(manifest.files)):
        raise BackupError(f"The backup holds {extra[0]}, which its own list does not name: {_OTHER}.")
    parts = {parent for name in inside for parent in _folders_of(name)}
    if both := sorted(parts & inside):
        raise BackupError(f"{both[0]} is a file and a folder in the backup: {_OTHER}.")
    for name, entry in manifest.files.items():
        if members[name].file_size != entry.size:
            raise BackupError(f"{name} of the backup is not as large as its own list says: {_OTHER}.")


def _folders_of(name: str) -> Iterator[str]:
    parts = name.split("/")
    return ("/".join(parts[:count]) for count in range(1, len(parts)))

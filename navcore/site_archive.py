"""The whole site as one file: a zip archive to keep, to hand on, and to make a site of again.

::

    SITE.zip
      archive.json      format, schema version, id, parent id, site id and name, checksum of the map, version of the
                        published PoI-graph, and of every file its size and SHA-256
      site/…            the files of the site's folder (see navcore.site)

The id is a checksum of all the files: two archives with the same id hold the same site. The parent is the archive that
the site was unpacked from, where it has changed since. The same site gives the same bytes; an archive that is unpacked
and written again is the same archive.

Reading believes nothing: all names, kinds and sizes are looked at before a byte is unpacked, and everything is unpacked
beside the target, checked, and put in its place in one step. Whatever is wrong is a SiteError of its own, and nothing
is changed then. Files pass through memory in pieces.
"""

from __future__ import annotations

import hashlib
import re
import stat
import zipfile
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import BinaryIO

import msgspec

from navcore.errors import InputError, SiteError
from navcore.folder_swap import fresh_folder, recover, swap_in, sync_tree
from navcore.misfit import words_of
from navcore.planning.edits import validate
from navcore.site import GRAPH_FILE, load_poi_graph, load_site, map_checksum, prepare_site_folder
from navcore.site_files import FILE_NAME, MANIFEST, MAX_SITE_BYTES, FileEntry, read_manifest, write_whole
from navcore.zip_reading import AGAIN, copied, opened_zip, told_of_damage

FORMAT = "vbr-site-archive"
SCHEMA_VERSION = 1
ARCHIVE_MANIFEST = "archive.json"
ORIGIN_FILE = "origin.json"
"""In a site's folder, beside what belongs to the site: which archive it was unpacked from."""
MAX_ARCHIVE_BYTES = MAX_SITE_BYTES + (8 << 20)
"""What cannot be packed is stored as it is; the rest is for the list of files."""
_MAX_MANIFEST_BYTES = 4 << 20
_MEMBER = re.compile(rf"archive\.json|site/(?:{FILE_NAME.pattern})")
_PREFIX = "site/"
_WHAT = "The site archive"
_ENCRYPTED = 0x1


class Origin(msgspec.Struct, frozen=True):
    """Which archive a site's folder was unpacked from."""

    id: str
    parent_id: str | None = None


class ArchiveManifest(msgspec.Struct, frozen=True):
    """What an archive says of itself."""

    format: str
    schema_version: int
    id: str
    """SHA-256 (hex) over names and checksums of the files."""
    parent_id: str | None
    """Id of the archive that this site was made from; None where it was not made from one."""
    site_id: str
    name: str
    map_sha256: str
    """As :func:`navcore.site.map_checksum` has it."""
    graph_version: int
    """Of the published PoI-graph; 0 where there is none."""
    files: dict[str, FileEntry]


# ------------------------------------------------------------------------------------------------------- writing
def write_site_archive(folder: Path, out: BinaryIO) -> ArchiveManifest:
    """Write the site in a folder, with its published PoI-graph, as an archive; return what it says of itself.

    Raises SiteError where the site is damaged or changes meanwhile; what was written is worth nothing then.
    """
    manifest = _archive_manifest(folder)
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        with archive.open(_member(ARCHIVE_MANIFEST), "w") as target:
            target.write(msgspec.json.format(msgspec.json.encode(manifest), indent=1))
        for name, entry in manifest.files.items():
            with (folder / name.removeprefix(_PREFIX)).open("rb") as source:
                with archive.open(_member(name), "w") as target:
                    found = copied(source, target, entry.size)
                if found != entry:
                    raise SiteError(f"{name} has changed while the site was exported: {AGAIN}.")
    return manifest


def _member(name: str) -> zipfile.ZipInfo:
    # A fixed date and system, so that the bytes tell of the contents alone.
    member = zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0))
    member.compress_type, member.create_system, member.external_attr = zipfile.ZIP_DEFLATED, 3, 0o100644 << 16
    return member


def _archive_manifest(folder: Path) -> ArchiveManifest:
    recover(folder)
    site = read_manifest(folder)
    graph = load_poi_graph(folder)
    names = [MANIFEST, *sorted(site.files), *([GRAPH_FILE] if (folder / GRAPH_FILE).exists() else [])]
    files: dict[str, FileEntry] = {}
    for name in names:
        if _MEMBER.fullmatch(_PREFIX + name) is None:
            raise SiteError(
                f"The site {folder} names a file {name[:100]!r} that is none of a site: build the map again."
            )
        files[_PREFIX + name] = found = _entry_of(folder, name)
        if site.files.get(name, found) != found:
            raise SiteError(f"{name} of the site {folder} is damaged: build the map again, or take it from a backup.")
    identity = _identity(files)
    return ArchiveManifest(
        FORMAT, SCHEMA_VERSION, identity, _parent_of(folder, identity), site.site_id, site.name, map_checksum(folder),
        graph.version, files,
    )  # fmt: skip


def _entry_of(folder: Path, name: str) -> FileEntry:
    try:
        with (folder / name).open("rb") as source:
            return copied(source, None, MAX_SITE_BYTES)
    except OSError as error:
        raise SiteError(f"{name} of the site {folder} cannot be read ({error.strerror}): see to the disk.") from error


def _identity(files: Mapping[str, FileEntry]) -> str:
    lines = (f"{name}\n{files[name].sha256}\n" for name in sorted(files))
    return hashlib.sha256("".join(lines).encode()).hexdigest()


def _parent_of(folder: Path, identity: str) -> str | None:
    """Return what a site was made from: a site that has not changed since is still the archive it came from."""
    try:
        origin = msgspec.json.decode((folder / ORIGIN_FILE).read_bytes(), type=Origin)
    except (OSError, msgspec.MsgspecError, UnicodeDecodeError):
        return None
    return origin.parent_id if origin.id == identity else origin.id


# ------------------------------------------------------------------------------------------------------- reading
def unpack_site_archive(source: Path, folder: Path, *, replace: bool = False) -> ArchiveManifest:
    """Make an archive into a site's folder; return what the archive says of itself.

    With ``replace`` it takes the place of a site that is there. Raises SiteError, and changes nothing then.
    """
    if folder.exists() and not replace:
        raise SiteError(f"{folder} exists already: name a new folder.")
    if not source.is_file():
        raise SiteError(f"There is no site archive at {source}: name a file that is there.")
    prepare_site_folder(folder)
    try:
        with fresh_folder(folder) as fresh:
            manifest = _unpack(source, fresh)
            _check_site(fresh, manifest)
            write_whole(fresh / ORIGIN_FILE, msgspec.json.encode(Origin(manifest.id, manifest.parent_id)))
            fresh.chmod(0o755)
            sync_tree(fresh)
            swap_in(fresh, folder)
    except OSError as error:
        raise SiteError(
            f"The site archive cannot be unpacked to {folder} ({error.strerror}): see whether the disk has room."
        ) from error
    return manifest


def _unpack(source: Path, fresh: Path) -> ArchiveManifest:
    with source.open("rb") as file, opened_zip(file, _WHAT, MAX_ARCHIVE_BYTES) as archive:
        members = _checked_members(archive)
        manifest = _read_manifest(archive, members)
        _check_sizes(members, manifest)
        for name, entry in manifest.files.items():
            target = fresh / name.removeprefix(_PREFIX)
            target.parent.mkdir(exist_ok=True)
            with target.open("xb") as out:
                found = told_of_damage(partial(_read_member, archive, name, out), f"{name} of the site archive")
            if found != entry:
                raise SiteError(f"{name} of the site archive has another checksum than it should: {AGAIN}.")
    return manifest


def _checked_members(archive: zipfile.ZipFile) -> dict[str, zipfile.ZipInfo]:
    members: dict[str, zipfile.ZipInfo] = {}
    for member in archive.infolist():
        name = member.filename
        if stat.S_ISLNK(member.external_attr >> 16):
            raise SiteError(f"The site archive holds a link ({name[:100]!r}), and files alone are taken: {AGAIN}.")
        if _MEMBER.fullmatch(name) is None or name != member.orig_filename:
            raise SiteError(f"The site archive holds {name[:100]!r}, which is no file of a site: {AGAIN}.")
        if name in members:
            raise SiteError(f"The site archive holds {name} twice: {AGAIN}.")
        if member.flag_bits & _ENCRYPTED:
            raise SiteError(f"{name} of the site archive is encrypted: export the site without a password.")
        if member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
            raise SiteError(f"{name} of the site archive is packed in a way that is not known here: {AGAIN}.")
        members[name] = member
    if sum(member.file_size for member in members.values()) > MAX_SITE_BYTES:
        raise SiteError("The site archive unpacks to more than 1 GiB: export it again with a smaller cloud.")
    return members


def _read_manifest(archive: zipfile.ZipFile, members: Mapping[str, zipfile.ZipInfo]) -> ArchiveManifest:
    if ARCHIVE_MANIFEST not in members:
        raise SiteError(f"The zip file is no site archive (it has no {ARCHIVE_MANIFEST}): name one that was exported.")
    if members[ARCHIVE_MANIFEST].file_size > _MAX_MANIFEST_BYTES:
        raise SiteError(f"The list of files in the site archive is larger than a site's: {AGAIN}.")
    data = told_of_damage(lambda: archive.read(ARCHIVE_MANIFEST), f"{ARCHIVE_MANIFEST} of the site archive")
    try:
        version = msgspec.json.decode(data, type=_Version)
        if version.format == FORMAT and version.schema_version > SCHEMA_VERSION:
            raise SiteError(
                f"The site archive was written by a newer program (schema {version.schema_version}, this one knows"
                f" {SCHEMA_VERSION}): update this program."
            )
        manifest = msgspec.json.decode(data, type=ArchiveManifest)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        raise SiteError(
            f"The list of files in the site archive cannot be read ({words_of(error)}): {AGAIN}."
        ) from error
    if manifest.format != FORMAT or manifest.schema_version < 1 or manifest.id != _identity(manifest.files):
        raise SiteError(f"The list of files in the site archive contradicts itself: {AGAIN}.")
    return manifest


class _Version(msgspec.Struct, frozen=True):
    """Looked at first: a newer manifest may have another form."""

    format: str
    schema_version: int


def _check_sizes(members: Mapping[str, zipfile.ZipInfo], manifest: ArchiveManifest) -> None:
    listed = set(manifest.files)
    if missing := sorted(listed - set(members)):
        raise SiteError(f"The site archive lacks {missing[0][:100]}: {AGAIN}.")
    if extra := sorted(set(members) - listed - {ARCHIVE_MANIFEST}):
        raise SiteError(f"The site archive holds {extra[0]}, which its own list does not name: {AGAIN}.")
    for name, entry in manifest.files.items():
        if members[name].file_size != entry.size:
            raise SiteError(f"{name} of the site archive is not as large as its own list says: {AGAIN}.")


def _read_member(archive: zipfile.ZipFile, name: str, out: BinaryIO) -> FileEntry:
    """Unpack a member: never more than the size that was agreed on, whatever its packed bytes come to."""
    with archive.open(name) as packed:
        return copied(packed, out, archive.getinfo(name).file_size)


def _check_site(fresh: Path, manifest: ArchiveManifest) -> None:
    """See that what was unpacked is a site that can be served. Raises SiteError."""
    try:
        site = load_site(fresh)
        validate(site.poi_graph)
    except SiteError as error:
        # Its sentences name the folder that is about to go.
        raise SiteError(str(error).replace(str(fresh), "in the archive")) from error
    except InputError as error:
        raise SiteError(f"The PoI-graph in the site archive cannot be used: {error}") from error
    found = (site.site_id, map_checksum(fresh), site.poi_graph.version)
    if found != (manifest.site_id, manifest.map_sha256, manifest.graph_version):
        raise SiteError(f"The site archive holds another site than it says: {AGAIN}.")

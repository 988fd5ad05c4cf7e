"""The files of a site folder: what the manifest says of each, and reading them no further than that holds.

The manifest names every map file with its size and SHA-256, and carries a checksum of itself, so a flipped bit anywhere
is found. Arrays are plain ``.npy`` files whose header must account for every byte that follows it: nothing is
unpickled, and no header can ask for memory that the file does not fill.
"""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import io
import json
import math
import os
import re
import tempfile
import tokenize
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from navcore.errors import SiteError

FORMAT = "vbr-site"
SCHEMA_VERSION = 3
"""1: one recording. 2: recordings as sessions; who saw each point of the cloud; the manifest's own checksum. 3: how far
the map can be wrong, key frame by key frame. Older ones are read, newer ones are not."""
MANIFEST = "manifest.json"
MAX_SITE_BYTES = 1 << 30
"""All files of a site together, at most."""
FILE_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,99}(?:/[A-Za-z0-9_][A-Za-z0-9_.-]{0,99})?")
"""What files of a site may be called, folders of theirs included: nothing leads out of it."""
_ADVICE = "build the map again, or take it from a backup"
_HALF_WRITTEN = ".half"
"""Ending of what is being written."""


class FileEntry(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What the manifest says of a file."""

    size: int
    sha256: str


class Manifest(msgspec.Struct, frozen=True):
    """What a site holds."""

    format: str
    schema_version: int
    site_id: str
    name: str
    files: dict[str, FileEntry]
    report: dict[str, Any] = {}
    sha256: str = ""
    """Of the manifest itself, with this left empty; empty in the first schema."""


def entry_of(data: bytes) -> FileEntry:
    """Return what the manifest says of a file with these contents."""
    return FileEntry(len(data), hashlib.sha256(data).hexdigest())


def manifest_bytes(manifest: Manifest) -> bytes:
    """Return the manifest as it is written, with its checksum."""
    sealed = msgspec.structs.replace(manifest, sha256=_checksum(manifest))
    return msgspec.json.format(msgspec.json.encode(sealed), indent=1)


def _checksum(manifest: Manifest) -> str:
    plain = msgspec.structs.replace(manifest, sha256="")
    return hashlib.sha256(msgspec.json.encode(plain, order="deterministic")).hexdigest()


def read_manifest(folder: Path) -> Manifest:
    """Read and check the manifest of a site. Raises SiteError."""
    path = folder / MANIFEST
    if not path.exists():
        raise SiteError(f"There is no site at {folder}: build one with `vbr map build RECORDING --site {folder}`.")
    try:
        raw = json.loads(path.read_bytes())
        _refuse_newer(folder, raw)
        manifest = msgspec.convert(raw, Manifest)
        checksum = _checksum(manifest)
    except (OSError, ValueError, OverflowError, RecursionError) as error:
        raise SiteError(f"{path} is damaged ({error}): {_ADVICE}.") from error
    if manifest.format != FORMAT or manifest.schema_version < 1:
        raise SiteError(f"{folder} is not a site of this program: name a folder made by `vbr map build`.")
    if manifest.schema_version > 1 and manifest.sha256 != checksum:
        raise SiteError(f"{path} is damaged (its checksum is another): {_ADVICE}.")
    if (foreign := next((name for name in manifest.files if FILE_NAME.fullmatch(name) is None), None)) is not None:
        raise SiteError(f"The site {folder} names a file outside itself ({foreign[:100]!r}): build the map again.")
    if sum(entry.size for entry in manifest.files.values()) > MAX_SITE_BYTES:
        raise SiteError(f"The site {folder} says that it is larger than 1 GiB: {_ADVICE}.")
    return manifest


def _refuse_newer(folder: Path, raw: object) -> None:
    """A newer manifest may have another form: its version is looked at before anything else."""
    version = raw.get("schema_version") if isinstance(raw, dict) and raw.get("format") == FORMAT else None
    if isinstance(version, int) and version > SCHEMA_VERSION:
        raise SiteError(
            f"The site {folder} was written by a newer program (schema {version}, this one knows"
            f" {SCHEMA_VERSION}): update this program."
        )


def read_checked(folder: Path, name: str, entry: FileEntry) -> bytearray:
    """Read a file of a checked manifest, which must be what that says. Raises SiteError."""
    path = folder / name
    try:
        # Looked at first: a file that has grown without bound is not read.
        data = bytearray(path.stat().st_size if entry.size >= 0 else 0)
        if len(data) == entry.size:
            with path.open("rb") as file:
                file.readinto(data)
    except (OSError, MemoryError) as error:
        raise SiteError(f"The site {folder} lacks {name}: {_ADVICE}.") from error
    if len(data) != entry.size or hashlib.sha256(data).hexdigest() != entry.sha256:
        raise SiteError(f"{name} of the site {folder} is damaged: {_ADVICE}.")
    return data


def npy_bytes(array: NDArray[Any]) -> bytes:
    """Return an array as the bytes of a ``.npy`` file."""
    out = io.BytesIO()
    np.lib.format.write_array(out, np.ascontiguousarray(array), version=(1, 0), allow_pickle=False)
    return out.getvalue()


_NO_ARRAY = (ValueError, EOFError, OverflowError, SyntaxError, RecursionError, MemoryError, tokenize.TokenError)
"""What NumPy raises for a header that says nothing: it is read as a piece of Python."""


def array_of(folder: Path, name: str, data: bytearray) -> NDArray[Any]:
    """Return the array of a ``.npy`` file; it uses the memory of ``data``. Raises SiteError."""
    head = io.BytesIO(memoryview(data)[:4096])
    try:
        if np.lib.format.read_magic(head) != (1, 0):
            raise ValueError("its form is not the one that sites use")
        shape, is_fortran, dtype = np.lib.format.read_array_header_1_0(head)
        if dtype.hasobject or is_fortran or dtype.kind not in "biuf":
            raise ValueError("it holds something other than numbers")
        if math.prod(shape) * dtype.itemsize != len(data) - head.tell():
            raise ValueError("its size is not that of its numbers")
        return np.frombuffer(data, dtype, offset=head.tell()).reshape(shape)
    except _NO_ARRAY as error:
        raise SiteError(f"{name} of the site {folder} is no array ({error}): build the map again.") from error


def write_whole(path: Path, data: bytes) -> None:
    """Replace a file in one step: a reader, or a crash, meets the old one or the new one. Raises OSError.

    What a crash leaves half-written goes with :func:`clear_half_written`.
    """
    handle, name = _held_file(path)
    try:
        with os.fdopen(handle, "wb") as out:
            out.write(data)
            out.flush()
            os.fsync(out.fileno())
            os.chmod(name, 0o644)
            os.replace(name, path)
    except BaseException:
        # A disk that is full is not to fill with what did not find room.
        with contextlib.suppress(OSError):
            os.unlink(name)
        raise


def _held_file(path: Path) -> tuple[int, str]:
    """Return a new file beside another, held by the living: whoever clears up sees that it is not left behind."""
    while True:
        handle, name = tempfile.mkstemp(_HALF_WRITTEN, f".{path.name}-", path.parent)
        # Not every disk knows locks. Where this one waits, somebody who clears up was faster, and takes the file away.
        with contextlib.suppress(OSError):
            fcntl.flock(handle, fcntl.LOCK_SH)
        if os.path.exists(name):
            return handle, name
        os.close(handle)


def clear_half_written(folder: Path) -> None:
    """Delete what :func:`write_whole` left in a folder where it was killed; what somebody writes just now stays."""
    for path in folder.glob(f".*{_HALF_WRITTEN}"):
        with contextlib.suppress(OSError), path.open("rb") as file:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            path.unlink()

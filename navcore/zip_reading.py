"""Zip files that come from elsewhere, read with care: what they say of themselves is looked at before it is believed.

``what`` names the file in the sentences of the errors, as "The site archive".
"""

from __future__ import annotations

import hashlib
import struct
import zipfile
import zlib
from collections.abc import Callable, Iterator
from typing import IO, BinaryIO, TypeVar

from navcore.errors import SiteError
from navcore.site_files import FileEntry
from navcore.zip_end import read_zip_end

Result = TypeVar("Result")
AGAIN = "export the site again"
MAX_FILE_COUNT = 4096
_MAX_DIRECTORY_BYTES = 1 << 20
_PIECE_BYTES = 1 << 20


def opened_zip(file: BinaryIO, what: str, max_bytes: int) -> zipfile.ZipFile:
    """Open a zip file of at most so many bytes. Raises SiteError."""
    _check_end(file, what, max_bytes)
    return told_of_damage(lambda: zipfile.ZipFile(file), what)


def _check_end(file: BinaryIO, what: str, max_bytes: int) -> None:
    """Look at the record at the end before anything else reads the list of files: it says how long that is."""
    size_bytes = file.seek(0, 2)
    if size_bytes > max_bytes:
        raise SiteError(f"{what} is larger than 1 GiB: export it again with a smaller cloud.")
    try:
        end = read_zip_end(file)
    except zipfile.BadZipFile as error:
        kind = what.lower().removeprefix("the ")
        raise SiteError(f"The file is no {kind}, or its end is missing: send it again, or {AGAIN}.") from error
    if not end.is_plain:
        raise SiteError(f"{what} is damaged (its list of files is not where it should be): {AGAIN}.")
    if end.count > MAX_FILE_COUNT or end.list_bytes > _MAX_DIRECTORY_BYTES:
        raise SiteError(f"{what} lists more files than a site has: {AGAIN}.")


def told_of_damage(read: Callable[[], Result], what: str) -> Result:
    """Read from a zip file; whatever its bytes make the reader raise is a SiteError."""
    try:
        return read()
    except (
        zipfile.BadZipFile,
        zlib.error,
        struct.error,
        EOFError,
        ValueError,
        OverflowError,
        NotImplementedError,
        RuntimeError,
    ) as error:
        raise SiteError(f"{what} is damaged ({error}): {AGAIN}.") from error


def copied(source: IO[bytes], out: IO[bytes] | None, max_bytes: int) -> FileEntry:
    """Copy up to ``max_bytes``, and one piece at most beyond; return what has been copied."""
    digest, size_bytes = hashlib.sha256(), 0
    for piece in _pieces(source):
        digest.update(piece)
        size_bytes += len(piece)
        if out is not None:
            out.write(piece)
        if size_bytes > max_bytes:
            break
    return FileEntry(size_bytes, digest.hexdigest())


def _pieces(source: IO[bytes]) -> Iterator[bytes]:
    while piece := source.read(_PIECE_BYTES):
        yield piece

"""The end of a zip file, which says how long its list of files is: looked at before that is taken into memory."""

from __future__ import annotations

import struct
import zipfile
from dataclasses import dataclass
from typing import BinaryIO

# The record at the very end; before it, in large archives, one that says where a longer one is.
_END, _END_SIGN = struct.Struct("<4s4H2LH"), b"PK\x05\x06"
_LOCATOR, _LOCATOR_SIGN = struct.Struct("<4sLQL"), b"PK\x06\x07"
_LONG_END = struct.Struct("<4sQ2H2L4Q")


@dataclass(frozen=True, slots=True)
class ZipEnd:
    """What a zip file says of its list."""

    count: int
    """Of files."""
    list_bytes: int
    is_plain: bool
    """Whether the list lies right before the end, of one file on one disk, as in archives below 4 GiB."""


def read_zip_end(file: BinaryIO) -> ZipEnd:
    """Read the end of an archive without a comment. Raises BadZipFile where there is none."""
    size_bytes = file.seek(0, 2)
    file.seek(max(0, size_bytes - _LOCATOR.size - _END.size))
    before, record = (tail := file.read())[: -_END.size], tail[-_END.size :]
    if len(record) < _END.size or record[:4] != _END_SIGN:
        raise zipfile.BadZipFile("its end is not that of an archive")
    _, disk, first_disk, here, count, list_bytes, offset, comment_bytes = _END.unpack(record)
    if comment_bytes:
        raise zipfile.BadZipFile("its end is not that of an archive")
    if before[:4] == _LOCATOR_SIGN:
        return _long_end(file, _LOCATOR.unpack(before)[2], size_bytes)
    is_whole = offset + list_bytes + _END.size == size_bytes and (disk, first_disk) == (0, 0)
    return ZipEnd(count, list_bytes, is_whole and here == count)


def _long_end(file: BinaryIO, offset: int, size_bytes: int) -> ZipEnd:
    if offset > size_bytes - _LONG_END.size:
        raise zipfile.BadZipFile("its longer end is not where it should be")
    file.seek(offset)
    count, list_bytes = _LONG_END.unpack(file.read(_LONG_END.size))[7:9]
    return ZipEnd(count, list_bytes, is_plain=False)

"""The end of a zip file: read as it is, refused where it is another, whatever it says of itself."""

from __future__ import annotations

import io
import struct
import zipfile
from pathlib import Path

import pytest

from console.backup_archive import BackupError, opened_backup
from navcore.errors import SiteError
from navcore.zip_end import ZipEnd, read_zip_end
from navcore.zip_reading import opened_zip


def archive(count: int) -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as made:
        for number in range(count):
            made.writestr(f"{number}", b"")
    return out.getvalue()


def with_long_end(data: bytes, count: int, list_bytes: int, offset: int | None = None) -> bytes:
    """Give an archive the longer end of large ones, and a locator that says where it is."""
    where = len(data) - 22
    end = struct.pack("<4sQ2H2L4Q", b"PK\x06\x06", 44, 45, 45, 0, 0, count, count, list_bytes, 0)
    locator = struct.pack("<4sLQL", b"PK\x06\x07", 0, where if offset is None else offset, 1)
    return data[:where] + end + locator + data[where:]


def test_the_end_says_how_long_the_list_is() -> None:
    data = archive(3)
    assert read_zip_end(io.BytesIO(data)) == ZipEnd(3, 3 * 47, is_plain=True)
    assert read_zip_end(io.BytesIO(with_long_end(data, 1 << 40, 1 << 50))) == ZipEnd(1 << 40, 1 << 50, is_plain=False)
    assert not read_zip_end(io.BytesIO(b"more" + data)).is_plain


@pytest.mark.parametrize("offset", [2**64 - 1, 2**63, 10**6])
def test_a_longer_end_that_is_nowhere_is_told(tmp_path: Path, offset: int) -> None:
    data = with_long_end(archive(3), 3, 141, offset)
    (tmp_path / "b.zip").write_bytes(data)
    with pytest.raises(BackupError, match="no backup"), opened_backup(tmp_path / "b.zip"):
        pass
    with pytest.raises(SiteError, match="no site archive"):
        opened_zip(io.BytesIO(data), "The site archive", 1 << 20)


@pytest.mark.parametrize(
    "data",
    [b"", b"PK\x05\x06", archive(1)[:-1], archive(1)[:-2] + b"\x01\x00", b"\0" * 100],
    # Not by their bytes: an archive holds the time, and two processes must collect the same tests.
    ids=["nothing", "four bytes", "cut short", "a comment that is nowhere", "zeros"],
)
def test_what_does_not_end_as_an_archive_is_none(data: bytes) -> None:
    with pytest.raises(zipfile.BadZipFile):
        read_zip_end(io.BytesIO(data))

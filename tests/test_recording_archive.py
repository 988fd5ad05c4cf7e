"""A recording as one stream of bytes: the same every time, readable from anywhere, and never more than files."""

from __future__ import annotations

import hashlib
import io
import os
import tarfile
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from navcore.errors import RecordingError
from navcore.recording_archive import RecordingArchive, unpack_recording

LIMIT_BYTES = 1 << 20


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("archive") / "walk"
    (folder / "rgb").mkdir(parents=True)
    for name, size_bytes in (("associations.txt", 0), ("calib.txt", 511), ("rgb/1.png", 512), ("rgb/2.5.png", 1300)):
        (folder / name).write_bytes(bytes(index % 251 for index in range(size_bytes)))
    (folder / "walk.json").write_text("changes")
    return folder


@pytest.fixture(scope="module")
def whole(folder: Path) -> bytes:
    archive = RecordingArchive(folder, {"walk.json"})
    return archive.read(0, archive.size_bytes)


def files_in(folder: Path) -> dict[str, bytes]:
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_what_was_packed_is_what_is_unpacked(folder: Path, whole: bytes, tmp_path: Path) -> None:
    (tmp_path / "a.tar").write_bytes(whole)
    unpack_recording(tmp_path / "a.tar", tmp_path / "again", LIMIT_BYTES)
    expected = files_in(folder)
    del expected["walk.json"]
    assert files_in(tmp_path / "again") == expected
    with tarfile.open(tmp_path / "a.tar") as tar:
        assert sorted(tar.getnames()) == sorted(expected), "any other program reads it as well"


def test_its_checksum_is_that_of_its_bytes_and_follows_from_its_files_alone(folder: Path, whole: bytes) -> None:
    os.utime(folder / "calib.txt", (1.0, 1.0))
    (folder / "walk.json").write_text("has changed")
    archive = RecordingArchive(folder, {"walk.json"})
    assert archive.size_bytes == len(whole)
    assert archive.sha256() == hashlib.sha256(whole).hexdigest()


@settings(deadline=None)
@given(offset=st.integers(0, 6000), count=st.integers(0, 3000))
def test_any_piece_is_the_piece_of_the_whole(folder: Path, whole: bytes, offset: int, count: int) -> None:
    assert RecordingArchive(folder, {"walk.json"}).read(offset, count) == whole[offset : offset + count]


def test_a_file_is_sent_as_it_is(tmp_path: Path) -> None:
    (tmp_path / "walk.mcap").write_bytes(b"abcdef")
    archive = RecordingArchive(tmp_path / "walk.mcap")
    assert (archive.size_bytes, archive.read(2, 100)) == (6, b"cdef")
    (tmp_path / "walk.mcap").write_bytes(b"abc")
    with pytest.raises(RecordingError, match="has become shorter"):
        archive.read(2, 4)


def test_what_is_no_recording_is_refused_with_a_sentence(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="There is no recording at"):
        RecordingArchive(tmp_path / "nowhere")
    (tmp_path / "empty").mkdir()
    with pytest.raises(RecordingError, match="holds nothing"):
        RecordingArchive(tmp_path / "empty")
    (tmp_path / "empty" / "Grüße.png").touch()
    with pytest.raises(RecordingError, match="plain name"):
        RecordingArchive(tmp_path / "empty")


def test_no_more_files_are_unpacked_than_a_recording_has(whole: bytes, tmp_path: Path) -> None:
    (tmp_path / "a.tar").write_bytes(whole)
    unpack_recording(tmp_path / "a.tar", tmp_path / "four", LIMIT_BYTES, max_file_count=4)
    with pytest.raises(RecordingError, match="more than 3 files"):
        unpack_recording(tmp_path / "a.tar", tmp_path / "three", LIMIT_BYTES, max_file_count=3)
    assert len(files_in(tmp_path / "three")) == 3


def member(name: str, data: bytes = b"", kind: bytes = tarfile.REGTYPE, pax: bool = False) -> bytes:
    out = io.BytesIO()
    with tarfile.open(fileobj=out, mode="w", format=tarfile.PAX_FORMAT if pax else tarfile.USTAR_FORMAT) as tar:
        info = tarfile.TarInfo(name)
        info.size, info.type, info.linkname = len(data), kind, "/etc/passwd"
        tar.addfile(info, io.BytesIO(data))
    return out.getvalue()


@pytest.mark.parametrize(
    "archive",
    [
        pytest.param(member("../outside", b"x"), id="outside"),
        pytest.param(member("/tmp/outside", b"x"), id="absolute"),
        pytest.param(member("rgb/../../outside", b"x"), id="up and out"),
        pytest.param(member("link", kind=tarfile.SYMTYPE), id="symbolic link"),
        pytest.param(member("link", kind=tarfile.LNKTYPE), id="hard link"),
        pytest.param(member("device", kind=tarfile.CHRTYPE), id="device"),
        pytest.param(member("Grüße" * 50, b"x", pax=True), id="long name"),
        pytest.param(member("large", bytes(LIMIT_BYTES + 1)), id="too large"),
        pytest.param(member("torn", bytes(5000))[:3000], id="torn"),
        pytest.param(b"no archive at all", id="no archive"),
        pytest.param(b"", id="nothing"),
    ],
)
def test_what_no_recording_holds_is_not_unpacked(archive: bytes, tmp_path: Path) -> None:
    (tmp_path / "a.tar").write_bytes(archive)
    with pytest.raises(RecordingError):
        unpack_recording(tmp_path / "a.tar", tmp_path / "deep" / "here", LIMIT_BYTES)
    assert not (tmp_path / "outside").exists()
    assert not (tmp_path / "deep" / "outside").exists()
    assert all(not path.is_symlink() for path in tmp_path.rglob("*"))

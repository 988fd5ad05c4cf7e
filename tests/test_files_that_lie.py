"""Files that say of themselves what is not so: looked at before they are believed, and nothing outside is touched."""

from __future__ import annotations

import os
import struct
import tarfile
import zipfile
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest
import zstandard
from fuzz import seeds
from fuzz.bundle import write_bundle
from mcap.opcode import Opcode

from navcore.errors import LONGEST_LINE, InputError, RecordingError, SiteError
from navcore.live_recording import mend_recording
from navcore.recorded_files import MAX_PIXEL_COUNT, read_image
from navcore.recording import open_recording
from navcore.recording_archive import unpack_recording
from navcore.site import load_site, unpack_site
from navcore.walk_file import WalkFile


def black_png(width_px: int, height_px: int) -> bytes:
    """A valid picture, one bit for each pixel: a hundredth of a byte when it is packed."""

    def chunk(kind: bytes, content: bytes) -> bytes:
        return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))

    head = struct.pack(">IIBBBBB", width_px, height_px, 1, 0, 0, 0, 0)
    rows = zlib.compress(bytes((width_px // 8 + 1) * height_px), 9)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", rows) + chunk(b"IEND", b"")


def test_a_picture_is_decoded_only_where_its_size_is_one_that_cameras_have(tmp_path: Path) -> None:
    for width_px, height_px, is_read in ((64, 48, True), (4096, 4096, True), (16_384, 16_384, False)):
        data = black_png(width_px, height_px)
        assert len(data) < 200_000
        (tmp_path / "1.png").write_bytes(data)
        found = read_image(tmp_path / "1.png", cv2.IMREAD_UNCHANGED)
        assert (found is not None) == is_read == (width_px * height_px <= MAX_PIXEL_COUNT)
        assert found is None or found.shape == (height_px, width_px)


def test_every_form_of_jpeg_says_its_size(tmp_path: Path) -> None:
    picture = np.zeros((48, 64, 3), np.uint8)
    for progressive in (0, 1):
        data = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_PROGRESSIVE, progressive])[1].tobytes()
        # As cameras write them: with a thumbnail's segment before the picture's size, and bytes that fill up.
        filled = data[:2] + b"\xff\xe1\x00\x08Exif\x00\x00" + b"\xff\xff" + data[2:]
        # TEM is a marker without a length.
        alone = data[:2] + b"\xff\x01" + data[2:]
        for each in (data, filled, alone):
            (tmp_path / "1.jpg").write_bytes(each)
            found = read_image(tmp_path / "1.jpg", cv2.IMREAD_COLOR)
            assert found is not None
            assert found.shape == (48, 64, 3)


def header(name: str, size_bytes: int) -> bytes:
    """A tar header; sizes below nothing are told in binary, as GNU tar has it."""
    info = tarfile.TarInfo(name)
    info.size = size_bytes
    return info.tobuf(tarfile.GNU_FORMAT)


def test_sizes_below_nothing_make_no_room_for_more(tmp_path: Path) -> None:
    block = bytes(512)
    (tmp_path / "walk.tar").write_bytes(
        header("a", -512) + header("b", 512) + block + header("c", 512) + block + 2 * block
    )
    with pytest.raises(RecordingError, match="below nothing"):
        unpack_recording(tmp_path / "walk.tar", tmp_path / "new", 512)


def test_links_lead_nowhere_and_nothing_outside_a_recording_is_read(tmp_path: Path) -> None:
    folder = tmp_path / "walk"
    write_bundle(seeds.recordings()[0], folder)
    lines = (folder / "associations.txt").read_text().splitlines()
    for number, name in enumerate(("rgb/round.jpg", "/dev/zero", "../outside.jpg")):
        lines.append(lines[1].replace("1.100000 rgb/1.100000.jpg", f"{2 + number}.0 {name}"))
    os.symlink("round.jpg", folder / "rgb" / "round.jpg")
    (tmp_path / "outside.jpg").write_bytes(seeds.pictures()[0])
    (folder / "associations.txt").write_text("\n".join(lines) + "\n")
    with pytest.raises(RecordingError, match=r"line 3: .* lies outside the recording"):
        open_recording(folder)
    assert mend_recording(folder) == 2, "what lies outside is no frame"
    assert len(open_recording(folder)) == 2


def test_a_package_is_no_other_than_what_is_packed(tmp_path: Path) -> None:
    (package,) = seeds.site_packages()
    for number, (data, told) in enumerate(
        (
            (package + package, "not where it should be"),
            (b"#!/bin/sh\n" + package, "not where it should be"),
            (package[:-1], "its end is missing"),
            (package[:-2] + b"\x04\x00rm -", "its end is missing"),
            (_with_twice(tmp_path, package), "damaged"),
        )
    ):
        with pytest.raises(SiteError, match=told):
            unpack_site(data, tmp_path / f"site-{number}")
    unpack_site(package, tmp_path / "site")
    assert load_site(tmp_path / "site").name == "Small site"
    assert {path.name for path in tmp_path.iterdir()} == {"site", "twice.zip"}


def _with_twice(folder: Path, package: bytes) -> bytes:
    (folder / "twice.zip").write_bytes(package)
    with zipfile.ZipFile(folder / "twice.zip", "a") as archive, pytest.warns(UserWarning, match="Duplicate"):
        archive.writestr("camera.json", b"{}")
    return (folder / "twice.zip").read_bytes()


def test_whatever_stands_in_an_error_it_can_be_read() -> None:
    assert (
        str(InputError("A\x1b[2J\u202eB\ud800 – 0.5\u00a0m: ‹Bär›\nC."))
        == "A\\x1b[2J\\u202eB\\ud800 – 0.5\u00a0m: ‹Bär›\nC."
    )
    long = str(InputError(f"There is no {'x' * 10_000_000}: choose another."))
    assert len(long) <= LONGEST_LINE
    assert long.startswith("There is no x")
    assert long.endswith("x: choose another.")
    listed = "\n".join(["It has errors:"] + ["x" * 300] * 9)
    assert str(InputError(listed)) == listed


def walk_of(chunk: bytes, count: int) -> bytes:
    """The beginning of a stored walk, and then chunks of what takes little room while it is packed."""
    whole = seeds.STORED_WALK.read_bytes()
    packed = zstandard.compress(chunk)
    head = struct.pack("<QQQII4sQ", 0, 0, len(chunk), zlib.crc32(chunk), 4, b"zstd", len(packed))
    begin = next(offset for offset, records in WalkFile(seeds.STORED_WALK).blocks() if len(records) > 1)
    return whole[:begin] + (struct.pack("<BQ", Opcode.CHUNK, len(head + packed)) + head + packed) * count


@pytest.mark.parametrize(
    ("record", "told"),
    [
        (struct.pack("<BQ", 0x7F, 0), "unknown kind 127"),
        (struct.pack("<BQHIQQ", Opcode.MESSAGE, 22, 1, 0, 0, 0), "more than 100000 records"),
    ],
)
def test_a_walk_that_unpacks_into_millions_of_nothings_ends_there(tmp_path: Path, record: bytes, told: str) -> None:
    data = walk_of(record * 1_000_000, 40)
    assert len(data) < 1 << 20
    (tmp_path / "walk.mcap").write_bytes(data)
    file = WalkFile(tmp_path / "walk.mcap")
    assert sum(1 for _ in file.records()) < 100
    assert told in file.damage

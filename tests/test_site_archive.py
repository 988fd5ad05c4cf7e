"""The whole site as one file: it comes back as it was, and whatever is wrong with it is refused and changes nothing."""

from __future__ import annotations

import io
import json
import stat
import struct
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest

from navcore.errors import SiteError
from navcore.planning.poi_graph import Edge, Poi, PoiGraph, Road
from navcore.site import Site, load_site, save_poi_graph, save_site
from navcore.site_archive import (
    ORIGIN_FILE,
    ArchiveManifest,
    unpack_site_archive,
    write_site_archive,
)
from navcore.zip_reading import MAX_FILE_COUNT

GRAPH = PoiGraph(
    7,
    {"a": Poi("a", "Hall", "hall", 0.0, 0.0), "b": Poi("b", "Bar", "bar", 6.0, 0.0, notes="to the left\n")},
    {"e1": Edge("e1", "a", "b", ((0.0, 0.0), (6.0, 0.0)), 6.0, width_m=0.9, caution_side="left")},
    {"r1": Road("r1", ((0.0, 0.0), (6.0, 0.0)), "drawn")},
)


def written(folder: Path) -> tuple[bytes, ArchiveManifest]:
    out = io.BytesIO()
    manifest = write_site_archive(folder, out)
    return out.getvalue(), manifest


def files_below(folder: Path) -> dict[str, bytes]:
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.fixture
def site_folder(tmp_path: Path, small_site: Site) -> Path:
    save_site(small_site, tmp_path / "here" / "site")
    save_poi_graph(GRAPH, tmp_path / "here" / "site")
    return tmp_path / "here" / "site"


@pytest.fixture
def good(site_folder: Path) -> bytes:
    return written(site_folder)[0]


@pytest.fixture
def there(tmp_path: Path) -> Path:
    """Where archives are unpacked: nothing but what is named may ever be found in it."""
    folder = tmp_path / "there"
    folder.mkdir()
    return folder


def unpack(data: bytes, there: Path, *, replace: bool = False) -> ArchiveManifest:
    source = there.parent / "upload.zip"
    source.write_bytes(data)
    return unpack_site_archive(source, there / "site", replace=replace)


def refused(data: bytes, there: Path) -> str:
    """Return the sentence by which an archive is refused: over a site that is there, which stays as it is."""
    before = files_below(there)
    with pytest.raises(SiteError) as caught:
        unpack(data, there, replace=True)
    assert files_below(there) == before
    assert not list(there.glob(".*")), "something was left behind"
    return str(caught.value)


def with_members(
    change: Callable[[dict[str, bytes]], None], data: bytes, edit: Callable[[zipfile.ZipInfo], None] = lambda _: None
) -> bytes:
    """Return the archive with other files in it."""
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    change(members)
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in members.items():
            info = zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0))
            info.compress_type = zipfile.ZIP_DEFLATED
            edit(info)
            archive.writestr(info, content)
    return out.getvalue()


# ----------------------------------------------------------------------------------------------------- as it was
def test_a_site_comes_back_as_it_was_with_its_graph(site_folder: Path, there: Path) -> None:
    data, manifest = written(site_folder)
    assert unpack(data, there) == manifest
    own = files_below(there / "site")
    del own[ORIGIN_FILE]
    assert own == files_below(site_folder)
    assert load_site(there / "site").poi_graph == GRAPH
    assert (manifest.site_id, manifest.graph_version, manifest.parent_id) == ("small", 7, None)


def test_the_same_site_gives_the_same_bytes_also_after_it_was_unpacked(site_folder: Path, there: Path) -> None:
    data, _ = written(site_folder)
    assert written(site_folder)[0] == data
    unpack(data, there)
    assert written(there / "site")[0] == data


def test_a_site_that_has_changed_names_its_parent(site_folder: Path, there: Path) -> None:
    first, manifest = written(site_folder)
    unpack(first, there)
    save_poi_graph(PoiGraph(8, GRAPH.pois), there / "site")
    second, changed = written(there / "site")
    assert changed.parent_id == manifest.id != changed.id
    unpack(second, there, replace=True)
    again, same = written(there / "site")
    assert (again, same.parent_id) == (second, manifest.id)


def test_it_is_written_to_what_cannot_be_wound_back(site_folder: Path, there: Path) -> None:
    class Pipe(io.RawIOBase):
        def __init__(self) -> None:
            self.data = b""

        def writable(self) -> bool:
            return True

        def write(self, piece: bytes) -> int:  # type: ignore[override]
            self.data += bytes(piece)
            return len(piece)

    pipe = Pipe()
    write_site_archive(site_folder, pipe)  # type: ignore[arg-type]
    unpack(pipe.data, there)
    assert load_site(there / "site").poi_graph == GRAPH


def test_a_damaged_site_is_not_exported(site_folder: Path) -> None:
    cloud = site_folder / "cloud" / "points_m.npy"
    cloud.write_bytes(cloud.read_bytes()[:-1] + b"\x7f")
    with pytest.raises(SiteError, match=r"points_m.npy .* is damaged"):
        written(site_folder)


def test_a_new_site_is_never_put_over_another_unless_that_is_wished(good: bytes, there: Path) -> None:
    unpack(good, there)
    before = files_below(there)
    with pytest.raises(SiteError, match="exists already"):
        unpack(good, there)
    assert files_below(there) == before


# ------------------------------------------------------------------------------------------------------- refused
@pytest.fixture
def settled(there: Path, small_site: Site) -> Path:
    """A folder with another site in it."""
    save_site(small_site, there / "site")
    return there


def test_wherever_it_is_cut_it_is_refused(good: bytes, settled: Path) -> None:
    with zipfile.ZipFile(io.BytesIO(good)) as archive:
        starts = [member.header_offset for member in archive.infolist()]
        cuts = {0, 1, 21, 22, archive.start_dir, archive.start_dir + 7, len(good) - 22, len(good) - 1}
    cuts |= {start + more for start in starts for more in (0, 5, 40)}
    for cut in sorted(cuts):
        assert "end is missing" in refused(good[:cut], settled), cut


def test_wherever_a_byte_is_flipped_it_is_refused_or_makes_no_difference(
    good: bytes, settled: Path, site_folder: Path
) -> None:
    there_is = files_below(site_folder)
    same = 0
    for at in range(0, len(good), max(1, len(good) // 120)):
        data = bytearray(good)
        data[at] ^= 0x55
        try:
            unpack(bytes(data), settled, replace=True)
        except SiteError:
            continue
        # A date in a header, say.
        same += 1
        found = files_below(settled / "site")
        del found[ORIGIN_FILE]
        assert found == there_is, f"byte {at}"
    assert same < 40


def test_a_checksum_that_does_not_fit_is_told_by_name(good: bytes, settled: Path) -> None:
    def change(members: dict[str, bytes]) -> None:
        members["site/camera.json"] = members["site/camera.json"].replace(b"320", b"321")

    assert "site/camera.json of the site archive has another checksum" in refused(with_members(change, good), settled)


@pytest.mark.parametrize(
    "name", ["../evil", "/etc/evil", "site/../../evil", "site/map/../../../evil", "site\\..\\evil", "C:\\evil",
             "site/./camera.json", "site/a/b/c", "site/.hidden", "evil", "site/map/", "site/é"]
)  # fmt: skip
def test_no_name_leads_out_of_the_site(good: bytes, settled: Path, name: str) -> None:
    data = with_members(lambda members: members.update({name: b"evil"}), good)
    assert "which is no file of a site" in refused(data, settled)
    assert not list(settled.parent.rglob("evil*"))


def test_links_are_refused(good: bytes, settled: Path) -> None:
    def edit(info: zipfile.ZipInfo) -> None:
        if info.filename == "site/camera.json":
            info.external_attr = (stat.S_IFLNK | 0o777) << 16

    assert "holds a link" in refused(with_members(lambda _: None, good, edit), settled)


def test_a_name_that_stands_twice_is_refused(good: bytes, settled: Path) -> None:
    out = io.BytesIO(good)
    with zipfile.ZipFile(out, "a") as archive, pytest.warns(UserWarning, match="Duplicate"):
        archive.writestr("site/camera.json", b"{}")
    assert "holds site/camera.json twice" in refused(out.getvalue(), settled)


def test_encrypted_files_are_refused(good: bytes, settled: Path) -> None:
    assert "export the site without a password" in refused(in_every_entry(good, 8, 6, "<H", 1), settled)


def test_other_ways_of_packing_are_refused(good: bytes, settled: Path) -> None:
    assert "packed in a way" in refused(in_every_entry(good, 10, 8, "<H", 12), settled)


def in_every_entry(data: bytes, central: int, local: int, form: str, value: int) -> bytes:
    """Return the archive with a field of every header written over, in the list and before the file."""
    changed = bytearray(data)
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        position = archive.start_dir
        for member in archive.infolist():
            struct.pack_into(form, changed, position + central, value)
            struct.pack_into(form, changed, member.header_offset + local, value)
            name, extra, comment = struct.unpack_from("<3H", changed, position + 28)
            position += 46 + name + extra + comment
    return bytes(changed)


def test_a_bomb_that_says_its_size_is_not_unpacked(good: bytes, settled: Path) -> None:
    assert "more than 1 GiB" in refused(in_every_entry(good, 24, 22, "<L", 1 << 30), settled)


def test_a_bomb_whose_headers_lie_is_not_unpacked(good: bytes, settled: Path) -> None:
    """64 MiB of zeros that say they are as large as what they stand for: no more than that is ever written."""
    with zipfile.ZipFile(io.BytesIO(good)) as archive:
        size = archive.getinfo("site/cloud/weights.npy").file_size
    big = with_members(lambda members: members.update({"site/cloud/weights.npy": bytes(64 << 20)}), good)
    assert "not as large as its own list says" in refused(big, settled)
    lying = bytearray(big)
    with zipfile.ZipFile(io.BytesIO(big)) as archive:
        position = archive.start_dir
        for member in archive.infolist():
            if member.filename == "site/cloud/weights.npy":
                struct.pack_into("<L", lying, position + 24, size)
                struct.pack_into("<L", lying, member.header_offset + 22, size)
            position += 46 + sum(struct.unpack_from("<3H", big, position + 28))
    assert "site/cloud/weights.npy of the site archive" in refused(bytes(lying), settled)


def test_more_files_than_a_site_has_are_not_even_listed(settled: Path) -> None:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        for number in range(MAX_FILE_COUNT + 1):
            archive.writestr(f"site/{number}", b"")
    assert "more files than a site has" in refused(out.getvalue(), settled)


def test_a_list_of_files_elsewhere_is_refused(good: bytes, settled: Path) -> None:
    assert "not where it should be" in refused(b"#!/bin/sh\n" + good, settled)
    # The record of archives above 4 GiB would be believed instead of the one that was looked at.
    record = good[-22:]
    end64 = struct.pack("<4sLQL", b"PK\x06\x07", 0, 0, 1)
    offset = struct.unpack_from("<L", record, 16)[0]
    size = len(good) - 22 + len(end64) - offset
    assert "not where" in refused(good[:-22] + end64 + record[:12] + struct.pack("<L", size) + record[16:], settled)


def test_a_newer_schema_says_so(good: bytes, settled: Path) -> None:
    def newer(members: dict[str, bytes]) -> None:
        members["archive.json"] = json.dumps({"format": "vbr-site-archive", "schema_version": 2, "files": 3}).encode()

    assert "written by a newer program (schema 2" in refused(with_members(newer, good), settled)


def test_what_lacks_or_adds_a_file_is_refused_by_name(good: bytes, settled: Path) -> None:
    lacking = with_members(lambda members: members.pop("site/camera.json"), good)
    assert "lacks site/camera.json" in refused(lacking, settled)
    adding = with_members(lambda members: members.update({"site/map/extra.npy": b"x"}), good)
    assert "holds site/map/extra.npy, which its own list does not name" in refused(adding, settled)
    assert "has no archive.json" in refused(with_members(lambda members: members.pop("archive.json"), good), settled)


def test_a_site_whose_graph_breaks_a_law_is_refused_naming_it(site_folder: Path, settled: Path) -> None:
    longer = {"e1": Edge("e1", "a", "b", ((0.0, 0.0), (6.0, 0.0)), 7.0)}
    save_poi_graph(PoiGraph(8, GRAPH.pois, longer), site_folder)
    assert "length of edge e1" in refused(written(site_folder)[0], settled)


def test_other_files_are_no_archives(settled: Path) -> None:
    for data in (b"", b"PK", b"not a zip file" * 100, b"PK\x05\x06" + bytes(18)):
        assert "archive" in refused(data, settled)

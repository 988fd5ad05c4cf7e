"""The site format: what is written can be read back, and what is damaged is refused."""

import io
import zipfile
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest

from navcore.errors import SiteError
from navcore.planning.poi_graph import PoiGraph
from navcore.site import (
    Site,
    load_poi_graph,
    load_site,
    map_checksum,
    pack_site,
    save_poi_graph,
    save_site,
    unpack_site,
)
from navcore.site_files import FileEntry, entry_of, manifest_bytes, read_manifest


def test_what_is_written_is_read_back(small_site: Site, tmp_path: Path) -> None:
    save_site(small_site, tmp_path / "site")
    back = load_site(tmp_path / "site")
    assert back.poi_graph == small_site.poi_graph
    assert back.intrinsics == small_site.intrinsics
    assert (back.site_id, back.name, dict(back.report)) == ("small", "Small site", {"keyframes": 2})
    for name, array in small_site.map_arrays.items():
        np.testing.assert_array_equal(back.map_arrays[name], array)
        assert back.map_arrays[name].dtype == array.dtype
    np.testing.assert_array_equal(back.roads_m[0], small_site.roads_m[0])
    np.testing.assert_array_equal(back.cloud_points_m, small_site.cloud_points_m)


def test_the_same_site_gives_the_same_bytes(small_site: Site, tmp_path: Path) -> None:
    save_site(small_site, tmp_path / "one")
    save_site(small_site, tmp_path / "two")
    assert pack_site(tmp_path / "one") == pack_site(tmp_path / "two")
    assert map_checksum(tmp_path / "one") == map_checksum(tmp_path / "two")


def test_the_poi_graph_changes_without_the_map(small_site: Site, tmp_path: Path) -> None:
    save_site(small_site, tmp_path / "site")
    before = map_checksum(tmp_path / "site")
    save_poi_graph(PoiGraph(version=7), tmp_path / "site")
    assert load_poi_graph(tmp_path / "site").version == 7
    assert map_checksum(tmp_path / "site") == before


def test_a_package_comes_back_as_the_same_site(small_site: Site, tmp_path: Path) -> None:
    save_site(small_site, tmp_path / "site")
    unpack_site(pack_site(tmp_path / "site"), tmp_path / "copy")
    assert map_checksum(tmp_path / "copy") == map_checksum(tmp_path / "site")
    with pytest.raises(SiteError, match="exists already"):
        unpack_site(pack_site(tmp_path / "site"), tmp_path / "copy")


@pytest.mark.parametrize("name", ["map/keyframe_poses.npy", "camera.json", "cloud/points_m.npy", "road/000.npy"])
@pytest.mark.parametrize("how", ["cut", "flip", "remove"])
def test_damage_is_refused(small_site: Site, tmp_path: Path, name: str, how: str) -> None:
    save_site(small_site, tmp_path / "site")
    file = tmp_path / "site" / name
    data = bytearray(file.read_bytes())
    if how == "remove":
        file.unlink()
    else:
        data[-1] ^= 1
        file.write_bytes(data[:-5] if how == "cut" else data)
    with pytest.raises(SiteError, match=name):
        load_site(tmp_path / "site")


@pytest.mark.parametrize(
    ("manifest", "sentence"),
    [
        (b"{", "damaged"),
        (b"[]", "damaged"),
        (b'{"format": "other", "schema_version": 1, "site_id": "", "name": "", "files": {}}', "not a site"),
        (b'{"format": "vbr-site", "schema_version": 99, "wholly": "different"}', "newer program"),
        (b'{"format": "vbr-site", "schema_version": 1, "site_id": "", "name": "", "files": {}}', "incomplete"),
    ],
)
def test_a_strange_manifest_is_refused(tmp_path: Path, manifest: bytes, sentence: str) -> None:
    (tmp_path / "manifest.json").write_bytes(manifest)
    with pytest.raises(SiteError, match=sentence):
        load_site(tmp_path)


def sealed_again(folder: Path, name: str, entry: FileEntry) -> None:
    """Change what the manifest says of a file, as somebody would who knows how its checksum is made."""
    manifest = read_manifest(folder)
    changed = msgspec.structs.replace(manifest, files={**manifest.files, name: entry})
    (folder / "manifest.json").write_bytes(manifest_bytes(changed))


def test_a_manifest_that_names_files_outside_is_refused(small_site: Site, tmp_path: Path) -> None:
    save_site(small_site, tmp_path / "site")
    sealed_again(tmp_path / "site", "../secret.npy", entry_of(b"x"))
    with pytest.raises(SiteError, match="outside itself"):
        load_site(tmp_path / "site")


def test_an_object_array_is_never_unpickled(small_site: Site, tmp_path: Path) -> None:
    save_site(small_site, tmp_path / "site")
    out = io.BytesIO()
    np.save(out, np.array([{"a": 1}], dtype=object), allow_pickle=True)
    sealed_again(tmp_path / "site", "map/keyframe_poses.npy", entry_of(out.getvalue()))
    (tmp_path / "site" / "map" / "keyframe_poses.npy").write_bytes(out.getvalue())
    with pytest.raises(SiteError, match="no array"):
        load_site(tmp_path / "site")


@pytest.mark.parametrize("name", ["../outside", "/etc/outside", "a/b/c"])
def test_a_package_cannot_write_outside(tmp_path: Path, name: str) -> None:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as package:
        package.writestr(name, b"x")
    with pytest.raises(SiteError):
        unpack_site(out.getvalue(), tmp_path / "new")
    assert list(tmp_path.iterdir()) == []


def test_a_broken_package_leaves_nothing_behind(small_site: Site, tmp_path: Path) -> None:
    save_site(small_site, tmp_path / "site")
    data = pack_site(tmp_path / "site")
    for broken in (b"", b"not a zip", data[: len(data) // 2]):
        with pytest.raises(SiteError):
            unpack_site(broken, tmp_path / "new")
    assert [entry.name for entry in tmp_path.iterdir()] == ["site"]


def test_a_folder_with_other_files_is_not_overwritten(small_site: Site, tmp_path: Path) -> None:
    (tmp_path / "letter.txt").write_text("dear")
    with pytest.raises(SiteError, match="other files"):
        save_site(small_site, tmp_path)
    assert (tmp_path / "letter.txt").read_text() == "dear"
    with pytest.raises(SiteError, match="no site at"):
        load_site(tmp_path)


def test_a_damaged_poi_graph_is_refused(small_site: Site, tmp_path: Path) -> None:
    save_site(small_site, tmp_path / "site")
    (tmp_path / "site" / "poi_graph.json").write_text('{"pois": {"a": {"id": "a"}}}')
    with pytest.raises(SiteError, match="damaged"):
        load_poi_graph(tmp_path / "site")
    assert msgspec.json.encode(small_site.poi_graph)


def test_a_cloud_whose_columns_differ_in_length_is_refused_before_it_is_written(small_site: Site) -> None:
    with pytest.raises(SiteError, match="49 cloud_sessions: give one for each point"):
        replace(small_site, cloud_sessions=small_site.cloud_sessions[1:])

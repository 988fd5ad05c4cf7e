"""The site format: every file of a site that is damaged is found, and what is absurd is refused with one sentence."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from navcore import folder_swap, site
from navcore.errors import SiteError
from navcore.folder_swap import aside, swap_in
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
from navcore.site_files import Manifest, entry_of, manifest_bytes, npy_bytes, read_manifest
from navcore.slam.rehearsal import rehearse
from navcore.slam.slam_map import SlamMap
from navcore.types import CameraIntrinsics


@pytest.fixture(scope="module")
def wall_map() -> SlamMap:
    return rehearse(30)[0].finish()


@pytest.fixture(scope="module")
def mapped(wall_map: SlamMap, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A site with a real map."""
    folder = tmp_path_factory.mktemp("format") / "site"
    rng = np.random.default_rng(0)
    save_site(
        Site(
            "wall", "Wall", wall_map_camera(wall_map), wall_map.to_arrays(), (np.zeros((3, 3)),),
            rng.normal(size=(20, 3)).astype(np.float32), rng.integers(0, 256, (20, 3)).astype(np.uint8),
        ),
        folder,
    )  # fmt: skip
    return folder


def wall_map_camera(slam_map: SlamMap) -> CameraIntrinsics:
    camera = slam_map.camera
    return CameraIntrinsics(camera.width_px, camera.height_px, camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px)


def read_whole(folder: Path) -> Site:
    found = load_site(folder)
    SlamMap.from_arrays(found.map_arrays)
    return found


def outcome(folder: Path) -> tuple[Site | None, str]:
    """What is read of a site, or the sentence that refuses it."""
    try:
        return read_whole(folder), ""
    except SiteError as error:
        return None, str(error)


def files_of(folder: Path) -> list[str]:
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file())


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_no_file_can_be_damaged_unnoticed(mapped: Path, tmp_path: Path, data: st.DataObject) -> None:
    folder = tmp_path / "site"
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(mapped, folder)
    name = data.draw(st.sampled_from(files_of(folder)))
    how = data.draw(st.sampled_from(["cut", "flip", "lengthen", "remove"]))
    path = folder / name
    content = bytearray(path.read_bytes())
    whole = load_site(folder)
    if how == "remove":
        path.unlink()
    elif how == "cut":
        path.write_bytes(content[: data.draw(st.integers(0, len(content) - 1))])
    elif how == "lengthen":
        path.write_bytes(bytes(content) + b"\0")
    else:
        content[data.draw(st.integers(0, len(content) - 1))] ^= 1 << data.draw(st.integers(0, 7))
        path.write_bytes(content)
    found, sentence = outcome(folder)
    if found is None:
        # A manifest that is gone leaves no site at all.
        assert sentence.endswith(".")
        assert name in sentence or name == "manifest.json"
        return
    # A site whose graph was never published has none; and a space more or less in a text says the same.
    assert name in ("poi_graph.json", "manifest.json")
    assert how in ("remove", "flip", "cut")
    assert found.poi_graph == (whole.poi_graph if how != "remove" else load_poi_graph(folder))
    assert (found.name, found.site_id) == (whole.name, whole.site_id)


def test_a_changed_manifest_is_found(mapped: Path, tmp_path: Path) -> None:
    shutil.copytree(mapped, tmp_path / "site")
    path = tmp_path / "site" / "manifest.json"
    path.write_bytes(path.read_bytes().replace(b'"Wall"', b'"Hall"'))
    with pytest.raises(SiteError, match="checksum"):
        load_site(tmp_path / "site")


def test_a_changed_graph_is_found(small_site: Site, tmp_path: Path) -> None:
    save_site(small_site, tmp_path / "site")
    path = tmp_path / "site" / "poi_graph.json"
    path.write_bytes(path.read_bytes().replace(b'"Hall"', b'"Wall"'))
    with pytest.raises(SiteError, match="checksum"):
        load_poi_graph(tmp_path / "site")


def broken(slam_map: SlamMap, name: str, index: object, value: float) -> dict[str, np.ndarray]:
    arrays = {key: array.copy() for key, array in slam_map.to_arrays().items()}
    arrays[name][index] = value
    return arrays


@pytest.mark.parametrize(
    ("name", "index", "value"),
    [
        ("camera_from_world", (0, 0, 0), np.nan),
        ("camera_from_world", (0, 0, 3), np.inf),
        ("camera_from_world", (0, 0, 0), 3.0),
        ("camera_from_world", (1, 3, 3), 2.0),
        ("trajectory", (1, 1, 1), -5.0),
        ("trajectory_stamp_s", 1, -1.0),
        ("keyframe_stamp_s", 0, np.nan),
        ("positions", (0, 0), 1e9),
        ("normals", (0, 0), np.nan),
        ("reach", 0, np.inf),
        ("feature_landmark", 0, 1_000_000),
        ("feature_landmark", 0, -7),
        ("feature_uvr_px", (0, 0), np.nan),
        ("feature_uvr_px", (0, 1), 1e30),
        ("feature_octave", 0, 200),
        ("feature_start", 1, -1),
        ("feature_start", -1, 5),
        ("keyframe_session", -1, 64),
        ("keyframe_session", 0, 1),
        ("trajectory_session", 0, -1),
        ("parent", 0, 10_000),
        ("camera", 0, 1e12),
        ("camera", 2, -1.0),
        ("place_image_ids", 0, 999),
        ("place_image_words", 0, 9_999_999),
        ("place_image_end", -1, 1),
    ],
)
def test_absurd_numbers_are_refused(wall_map: SlamMap, name: str, index: object, value: float) -> None:
    with pytest.raises(SiteError, match="The map is damaged"):
        SlamMap.from_arrays(broken(wall_map, name, index, value))


SINCE_LATER_SCHEMAS = (
    "keyframe_session",
    "trajectory_session",
    "keyframe_depth",
    "keyframe_grey",
    "keyframe_covariance",
    "keyframe_drift",
    "readout_s",
)


def test_arrays_of_another_form_or_none_are_refused(wall_map: SlamMap) -> None:
    for name, array in wall_map.to_arrays().items():
        without = {key: value for key, value in wall_map.to_arrays().items() if key != name}
        if name not in SINCE_LATER_SCHEMAS:
            with pytest.raises(SiteError, match="The map "):
                SlamMap.from_arrays(without)
        # There may be any number of loops; of all else the number is known.
        shorter = () if name == "loop_edges" else (array[:-1],)
        for changed in (*shorter, array.astype(np.complex64), array.reshape(-1, 1, 1, 1, 1)):
            with pytest.raises(SiteError, match="The map "):
                SlamMap.from_arrays({**without, name: changed})


def test_a_map_with_descriptors_of_another_kind_is_refused(wall_map: SlamMap) -> None:
    with pytest.raises(SiteError, match="build it again from its recordings"):
        SlamMap.from_arrays(broken(wall_map, "descriptor_kind", 0, 1 ^ int(wall_map.to_arrays()["descriptor_kind"][0])))


def test_no_header_can_ask_for_memory(mapped: Path, tmp_path: Path) -> None:
    """Three numbers of which the header says that they are a million million."""
    shutil.copytree(mapped, tmp_path / "site")
    honest = npy_bytes(np.zeros(3))
    lie = honest.replace(b"'shape': (3,), }            ", b"'shape': (1000000000000,), }")
    assert len(lie) == len(honest)
    assert lie != honest
    replaced_file(tmp_path / "site", "map/reach.npy", lie)
    with pytest.raises(SiteError, match="no array"):
        load_site(tmp_path / "site")


def replaced_file(folder: Path, name: str, content: bytes) -> None:
    """Put another file in, and seal the manifest again, as a faulty program would."""
    manifest = read_manifest(folder)
    changed = msgspec.structs.replace(manifest, files={**manifest.files, name: entry_of(content)})
    (folder / "manifest.json").write_bytes(manifest_bytes(changed))
    (folder / name).write_bytes(content)


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("cloud/points_m.npy", npy_bytes(np.full((20, 3), np.nan, np.float32))),
        ("cloud/points_m.npy", npy_bytes(np.zeros((19, 3), np.float32))),
        ("cloud/sessions.npy", npy_bytes(np.ones(20, np.int64))),
        ("cloud/sessions.npy", npy_bytes(np.full(20, 2, np.uint64))),
        ("cloud/sessions.npy", npy_bytes(np.zeros(20, np.uint64))),
        ("cloud/extra.npy", npy_bytes(np.ones(20))),
        ("road/000.npy", npy_bytes(np.full((4, 3), np.inf))),
        ("road/000.npy", npy_bytes(np.zeros((4, 2)))),
        ("camera.json", b'{"width_px": 320}'),
        ("sessions.json", b'{"sessions": []}'),
        ("sessions.json", b'{"sessions": [{"id": "1", "name": "x"}], "road_sessions": [3]}'),
    ],
)
def test_files_that_are_whole_but_wrong_are_refused(mapped: Path, tmp_path: Path, name: str, content: bytes) -> None:
    shutil.copytree(mapped, tmp_path / "site")
    replaced_file(tmp_path / "site", name, content)
    with pytest.raises(SiteError):
        load_site(tmp_path / "site")


def test_a_site_larger_than_any_is_not_read(mapped: Path, tmp_path: Path) -> None:
    shutil.copytree(mapped, tmp_path / "site")
    manifest = read_manifest(tmp_path / "site")
    huge = msgspec.structs.replace(entry_of(b""), size=1 << 40)
    changed = msgspec.structs.replace(manifest, files={**manifest.files, "map/reach.npy": huge})
    (tmp_path / "site" / "manifest.json").write_bytes(manifest_bytes(changed))
    with pytest.raises(SiteError, match="larger than 1 GiB"):
        load_site(tmp_path / "site")


def test_a_site_of_the_first_schema_is_read_as_one_recording(mapped: Path, tmp_path: Path) -> None:
    folder = tmp_path / "site"
    shutil.copytree(mapped, folder)
    newer = {"sessions.json", *(f"cloud/{name}.npy" for name in ("weights", "view_counts", "sessions"))}
    newer |= {f"map/{name}_session.npy" for name in ("keyframe", "trajectory")} | {"map/keyframe_covariance.npy"}
    manifest = read_manifest(folder)
    files = {name: entry for name, entry in manifest.files.items() if name not in newer}
    for name in newer:
        (folder / name).unlink()
    old = Manifest("vbr-site", 1, "wall", "Wall", files, {"frames": 30})
    (folder / "manifest.json").write_bytes(msgspec.json.encode(old))
    found = load_site(folder)
    assert [(session.name, session.frame_count) for session in found.sessions] == [("Wall", 30)]
    slam_map = SlamMap.from_arrays(found.map_arrays)
    assert not slam_map.keyframe_session.any()
    # How far it can be wrong follows from what it holds.
    known = SlamMap.from_arrays(load_site(mapped).map_arrays)
    np.testing.assert_array_equal(slam_map.keyframe_covariance, known.keyframe_covariance)
    assert set(found.cloud_sessions.tolist()) == {1}


def test_sessions_go_along_in_a_package(mapped: Path, tmp_path: Path) -> None:
    unpack_site(pack_site(mapped), tmp_path / "copy")
    assert map_checksum(tmp_path / "copy") == map_checksum(mapped)
    assert load_site(tmp_path / "copy").sessions == load_site(mapped).sessions


# ------------------------------------------------------------------------------------------------- interruptions
class PulledOut(BaseException):
    """The plug."""


@pytest.mark.parametrize("steps", range(6))
def test_a_crash_while_a_site_is_replaced_leaves_one_of_the_two(
    small_site: Site, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, steps: int
) -> None:
    folder = tmp_path / "site"
    save_site(small_site, folder)
    done = 0

    def until(real: Callable[..., object]) -> Callable[..., object]:
        def step(*arguments: object, **options: object) -> object:
            nonlocal done
            if done >= steps:
                raise PulledOut
            done += 1
            return real(*arguments, **options)

        return step

    monkeypatch.setattr(os, "replace", until(os.replace))
    monkeypatch.setattr(shutil, "rmtree", until(shutil.rmtree))
    monkeypatch.setattr(folder_swap, "sync_tree", until(folder_swap.sync_tree))
    monkeypatch.setattr(site, "sync_tree", until(site.sync_tree))
    try:
        save_site(replace(small_site, name="Newer"), folder)
        finished = True
    except PulledOut:
        finished = False
    monkeypatch.undo()
    found = load_site(folder)
    assert found.name == "Newer" if finished else found.name in ("Small site", "Newer")
    # And it can be replaced again.
    save_site(replace(small_site, name="Newest"), folder)
    assert load_site(folder).name == "Newest"
    assert not aside(folder).exists()


def test_a_reader_who_puts_the_old_folder_back_does_not_stop_the_new_one(tmp_path: Path) -> None:
    for name in ("site", "fresh"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "name").write_text(name)
    os.replace(tmp_path / "site", aside(tmp_path / "site"))
    swap_in(tmp_path / "fresh", tmp_path / "site")
    assert (tmp_path / "site" / "name").read_text() == "fresh"


def test_a_graph_is_replaced_in_one_step(small_site: Site, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    save_site(small_site, tmp_path / "site")

    def pulled_out(*_: object) -> None:
        raise PulledOut

    monkeypatch.setattr(os, "replace", pulled_out)
    with pytest.raises(PulledOut):
        save_poi_graph(msgspec.structs.replace(small_site.poi_graph, version=9), tmp_path / "site")
    monkeypatch.undo()
    assert load_poi_graph(tmp_path / "site") == small_site.poi_graph

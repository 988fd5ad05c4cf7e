"""``vbr map extend``, ``sessions``, ``remove-session``, ``export`` and ``import``, on recordings of a painted wall."""

from __future__ import annotations

import hashlib
import json
import shutil
import threading
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from itertools import islice
from pathlib import Path

import numpy as np
import pytest

from device_agent import map_growth_commands
from device_agent.cli import main
from navcore.cloud_files import read_cloud
from navcore.recording import Mark, RecordingWriter, read_trajectory
from navcore.site import load_site, map_checksum
from navcore.slam.rehearsal import REHEARSAL_CAMERA, sliding_frames

FRAMES = 64


def record(folder: Path, first: int, last: int, seed: int, *marks: Mark) -> Path:
    """Record part of a slide along a wall that is painted by the seed."""
    writer = RecordingWriter(folder, REHEARSAL_CAMERA)
    for frame, pose in islice(sliding_frames(FRAMES, seed=seed), first, last):
        writer.add(frame, pose)
    for mark in marks:
        writer.mark(mark)
    writer.close()
    return folder


@pytest.fixture(scope="module")
def left(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("walls") / "left"
    return record(folder, 0, 42, 0, Mark(0.5, "hall", "Hall"), Mark(3.5, "room", "Room 1"))


@pytest.fixture(scope="module")
def right(left: Path) -> Path:
    return record(left.parent / "right", 20, FRAMES, 0, Mark(6.0, "bar", "Bar"))


@pytest.fixture(scope="module")
def elsewhere(left: Path) -> Path:
    return record(left.parent / "elsewhere", 0, 30, 7)


@pytest.fixture(scope="module")
def built(left: Path) -> Path:
    folder = left.parent / "built"
    assert main(["map", "build", str(left), "--site", str(folder), "--date", "2026-01-02", "--json"]) == 0
    return folder


@pytest.fixture(scope="module")
def extended(built: Path, right: Path) -> Path:
    folder = built.parent / "extended"
    shutil.copytree(built, folder)
    assert main(["map", "extend", str(folder), str(right), "--name", "Right part"]) == 0
    return folder


@pytest.fixture
def site(extended: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(extended, tmp_path / "site"))


def bytes_of(folder: Path) -> str:
    digest = hashlib.sha256()
    for path in sorted(folder.rglob("*")):
        if path.is_file():
            digest.update(str(path.relative_to(folder)).encode() + path.read_bytes())
    return digest.hexdigest()


def sessions(folder: Path, capsys: pytest.CaptureFixture[str]) -> list[dict[str, object]]:
    capsys.readouterr()
    assert main(["map", "sessions", str(folder), "--json"]) == 0
    rows: list[dict[str, object]] = json.loads(capsys.readouterr().out)
    return rows


def refused(capsys: pytest.CaptureFixture[str], *words: object) -> str:
    capsys.readouterr()
    assert main([str(word) for word in words]) != 0
    sentence = capsys.readouterr().err.strip().splitlines()[-1]
    assert sentence.startswith("vbr: ")
    return sentence


def test_sessions_are_listed_with_what_was_said_of_them(site: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rows = sessions(site, capsys)
    assert [(row["name"], row["date"], row["frames"], row["camera"]) for row in rows] == [
        ("left", "2026-01-02", 42, "320x240"),
        ("Right part", "", 44, "320x240"),
    ]
    assert main(["map", "sessions", str(site)]) == 0
    assert "Right part" in capsys.readouterr().out


def test_the_extended_site_holds_both_parts(site: Path, built: Path) -> None:
    before, after = load_site(built), load_site(site)
    assert {poi.name for poi in after.poi_graph.pois.values()} >= {"Hall", "Room 1", "Bar"}
    assert after.site_id == before.site_id
    assert map_checksum(site) != map_checksum(built)
    # The camera slid by 8 px a frame, 2 m in front of the wall.
    true_m = (FRAMES - 1) * 8 * 2.0 / REHEARSAL_CAMERA.fx_px
    reach = np.concatenate([road[:, :2] for road in after.roads_m])
    assert np.linalg.norm(reach.max(axis=0) - reach.min(axis=0)) == pytest.approx(true_m, abs=0.1)


def test_a_recording_is_mapped_beside_tracking_when_a_site_grows(
    built: Path, right: Path, extended: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    works = threading.Event()
    monkeypatch.setattr(map_growth_commands, "ThreadPoolExecutor", partial(ThreadPoolExecutor, initializer=works.set))
    site = Path(shutil.copytree(built, tmp_path / "site"))
    assert main(["map", "extend", str(site), str(right), "--name", "Right part"]) == 0
    assert works.is_set()
    assert bytes_of(site) == bytes_of(extended)


def test_the_same_recordings_give_the_same_site(extended: Path, left: Path, right: Path, tmp_path: Path) -> None:
    assert (
        main(["map", "build", str(left), "--site", str(tmp_path / "s"), "--name", "built", "--date", "2026-01-02"]) == 0
    )
    assert main(["map", "extend", str(tmp_path / "s"), str(right), "--name", "Right part"]) == 0
    assert bytes_of(tmp_path / "s") == bytes_of(extended)


def test_what_does_not_overlap_changes_nothing(
    site: Path, elsewhere: Path, right: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = bytes_of(site)
    assert "begins at, or passes through" in refused(capsys, "map", "extend", site, elsewhere)
    assert "already part of the site" in refused(capsys, "map", "extend", site, right)
    assert bytes_of(site) == before
    assert [path.name for path in site.parent.iterdir()] == ["site"]


def test_a_session_is_removed_and_the_last_is_not(site: Path, capsys: pytest.CaptureFixture[str]) -> None:
    first = str(sessions(site, capsys)[0]["id"])
    assert main(["map", "remove-session", str(site), first, "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["places_off_road"] == ["Hall"]
    (row,) = sessions(site, capsys)
    assert row["name"] == "Right part"
    before = bytes_of(site)
    assert "only recording" in refused(capsys, "map", "remove-session", site, row["id"])
    assert "no session" in refused(capsys, "map", "remove-session", site, first)
    assert bytes_of(site) == before


def test_what_is_exported_can_be_imported(
    site: Path, right: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    second = str(sessions(site, capsys)[1]["id"])
    cloud, poses, road = tmp_path / "c.pcd", tmp_path / "t.txt", tmp_path / "r.csv"
    export = ["map", "export", str(site), "--cloud", str(cloud), "--road", str(road)]
    assert main([*export, "--trajectory", str(poses), "--session", second]) == 0
    before = load_site(site)
    np.testing.assert_array_equal(read_cloud(cloud).points_m, before.cloud_points_m)
    stamps, _ = read_trajectory(poses)
    np.testing.assert_allclose(stamps, read_trajectory(right / "groundtruth.txt")[0], atol=1e-6)
    assert len(road.read_text().splitlines()) == 1 + sum(len(points) for points in before.roads_m)

    assert main(["map", "import", str(site), "--cloud", str(cloud), "--replace", "--name", "Cleaned"]) == 0
    after = load_site(site)
    np.testing.assert_array_equal(after.cloud_sessions, before.cloud_sessions)
    assert main(["map", "import", str(site), "--trajectory", str(poses)]) == 0
    assert [session.kind for session in load_site(site).sessions] == ["recording", "recording", "import", "import"]
    imported = str(sessions(site, capsys)[3]["id"])
    assert main(["map", "remove-session", str(site), imported]) == 0
    assert len(load_site(site).roads_m) == len(before.roads_m)


def test_a_recording_joins_a_site_that_holds_an_import(
    built: Path, right: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    site = Path(shutil.copytree(built, tmp_path / "site"))
    assert main(["map", "export", str(site), "--cloud", str(tmp_path / "c.ply")]) == 0
    assert main(["map", "import", str(site), "--cloud", str(tmp_path / "c.ply"), "--name", "Scan"]) == 0
    assert main(["map", "extend", str(site), str(right)]) == 0
    assert [row["kind"] for row in sessions(site, capsys)] == ["recording", "import", "recording"]
    scan = str(sessions(site, capsys)[1]["id"])
    assert main(["map", "remove-session", str(site), scan]) == 0
    assert set(load_site(site).map_arrays["keyframe_session"].tolist()) == {0, 1}
    assert set(load_site(site).road_sessions) == {0, 1}


def test_bad_wishes_are_refused(site: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = bytes_of(site)
    (tmp_path / "c.ply").write_text("ply")
    (tmp_path / "t.txt").write_text("0 0 0 0 0 0 0 1\n1 0.1 0 0 0 0 0 1\n")
    assert "Nothing to export" in refused(capsys, "map", "export", site)
    assert "--session" in refused(capsys, "map", "export", site, "--trajectory", tmp_path / "out.txt")
    assert ".ply or .pcd" in refused(capsys, "map", "export", site, "--cloud", tmp_path / "out.xyz")
    assert "cannot be written" in refused(capsys, "map", "export", site, "--road", tmp_path / "none" / "r.csv")
    assert "PLY" in refused(capsys, "map", "import", site, "--cloud", tmp_path / "c.ply")
    assert "leads nowhere" in refused(capsys, "map", "import", site, "--trajectory", tmp_path / "t.txt")
    wish = ("map", "import", site, "--trajectory", tmp_path / "t.txt", "--replace")
    assert "leave --replace out" in refused(capsys, *wish)
    assert "no site at" in refused(capsys, "map", "extend", tmp_path / "none", tmp_path)
    assert bytes_of(site) == before

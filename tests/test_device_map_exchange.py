"""``vbr map export`` and ``import`` of whole sites, PoI-graphs and roads."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from device_agent.cli import main
from navcore.planning.poi_graph import PoiGraph, Road
from navcore.recording import read_trajectory
from navcore.site import Site, load_poi_graph, load_site, save_poi_graph, save_site
from navcore.site_archive import ORIGIN_FILE

FOREIGN = {
    "type": "FeatureCollection",
    "features": [
        {"geometry": {"type": "Point", "coordinates": [3.0, 0.1]}, "properties": {"name": "Lift", "kind": "lift"}},
        {"geometry": {"type": "Polygon", "coordinates": []}, "properties": {"name": "Room 3"}},
    ],
}


@pytest.fixture
def site(tmp_path: Path, small_site: Site) -> Path:
    save_site(small_site, tmp_path / "site")
    return tmp_path / "site"


def bytes_of(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def refused(capsys: pytest.CaptureFixture[str], *words: object) -> str:
    assert main([str(word) for word in words]) != 0
    return capsys.readouterr().err


def test_a_site_goes_out_and_in_as_one_file(site: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    archive, copy = tmp_path / "site.zip", tmp_path / "copies" / "one"
    assert main(["map", "export", str(site), "--archive", str(archive)]) == 0
    assert main(["map", "import", str(copy), "--archive", str(archive)]) == 0
    own = bytes_of(copy)
    del own[ORIGIN_FILE]
    assert own == bytes_of(site)
    assert "name a new folder" in refused(capsys, "map", "import", copy, "--archive", archive)
    save_poi_graph(PoiGraph(9), copy)
    assert main(["map", "import", str(copy), "--archive", str(archive), "--replace"]) == 0
    assert load_poi_graph(copy) == load_poi_graph(site)


@pytest.mark.parametrize("ending", ["geojson", "graphml"])
def test_a_graph_goes_out_and_in(site: Path, tmp_path: Path, ending: str) -> None:
    before = load_poi_graph(site)
    assert main(["map", "export", str(site), "--graph", str(tmp_path / f"g.{ending}")]) == 0
    save_poi_graph(PoiGraph(5), site)
    assert main(["map", "import", str(site), "--graph", str(tmp_path / f"g.{ending}")]) == 0
    after = load_site(site).poi_graph
    assert (after.version, after.pois, after.edges) == (6, before.pois, before.edges)
    assert after.roads == {}, "roads that nobody has edited stay the map's"


def test_a_graph_of_another_program_is_added_and_the_rest_is_told(
    site: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "plan.json").write_text(json.dumps(FOREIGN))
    before = bytes_of(site)
    said = refused(capsys, "map", "import", site, "--graph", tmp_path / "plan.json")
    assert "Lift" in said, "no edge leads there"
    assert "--confirmed" in said
    assert bytes_of(site) == before
    assert main(["map", "import", str(site), "--graph", str(tmp_path / "plan.json"), "--confirmed"]) == 0
    assert "Room 3" in capsys.readouterr().err
    assert [poi.name for poi in load_poi_graph(site).pois.values()] == ["Hall", "Bar", "Lift"]


def test_the_road_goes_out_as_it_was_edited(site: Path, tmp_path: Path) -> None:
    graph = load_poi_graph(site)
    drawn = {"r1": Road("r1", ((0.0, 0.0), (6.0, 0.0))), "r2": Road("r2", ((3.0, 0.0), (3.0, 4.0)), "drawn")}
    save_poi_graph(PoiGraph(graph.version, graph.pois, graph.edges, drawn), site)
    assert main(["map", "export", str(site), "--road", str(tmp_path / "road.tum")]) == 0
    stamps_s, poses = read_trajectory(tmp_path / "road.tum")
    assert np.diff(stamps_s).max() == pytest.approx(10.0)
    assert poses[-1].translation == pytest.approx([3.0, 4.0, 0.0])


def test_bad_wishes_change_nothing(site: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    archive = tmp_path / "site.zip"
    assert main(["map", "export", str(site), "--archive", str(archive)]) == 0
    before = bytes_of(tmp_path)
    assert ".geojson or .graphml" in refused(capsys, "map", "export", site, "--graph", tmp_path / "g.json")
    half = tmp_path.parent / "half.zip"
    half.write_bytes(archive.read_bytes()[:-40])
    assert "end is missing" in refused(capsys, "map", "import", site, "--archive", half, "--replace")
    assert "no site archive at" in refused(capsys, "map", "import", tmp_path / "new", "--archive", tmp_path / "none")
    assert "no text in UTF-8" in refused(capsys, "map", "import", site, "--graph", archive)
    assert "cannot be imported" in refused(capsys, "map", "import", site, "--graph", tmp_path / "none")
    assert bytes_of(tmp_path) == before


def test_a_graph_that_a_console_keeps_is_not_changed_behind_its_back(
    site: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "plan.json").write_text(json.dumps(FOREIGN))
    (tmp_path / "site.console").mkdir()
    before = bytes_of(site)
    assert "in the console" in refused(capsys, "map", "import", site, "--graph", tmp_path / "plan.json")
    assert bytes_of(site) == before

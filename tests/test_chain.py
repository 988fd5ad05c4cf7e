"""The whole chain, headless: a recorded walk becomes a map, and a walker who only hears cues is led through it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from device_agent.cli import main
from device_agent.simulation.building import Building
from device_agent.simulation.renderer import Renderer
from device_agent.simulation.walk_recording import record_walk
from device_agent.walk import run_walk
from navcore.evaluation import absolute_trajectory_error
from navcore.planning.edits import validate
from navcore.recording import open_recording, read_trajectory
from navcore.site import load_site


def test_the_map_is_level_true_to_scale_and_tagged(office_site: Path) -> None:
    site = load_site(office_site)
    validate(site.poi_graph)
    assert {"Hall", "Wash room"} <= {poi.name for poi in site.poi_graph.pois.values()}
    assert site.report["tracked_share"] == 1.0
    floor_m = site.cloud_points_m[np.abs(site.cloud_points_m[:, 2]) < 0.15, 2]
    assert abs(float(np.median(floor_m))) < 0.03
    assert len(floor_m) > 1000
    assert sum(len(road) for road in site.roads_m) * 0.1 == pytest.approx(20.0, abs=1.5)


def test_another_walk_is_located_in_the_map(
    office_site: Path, office: Building, office_renderer: Renderer, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Another gait and other noise than those of the map, by the command, and against the truth."""
    recording, out = tmp_path / "walk", tmp_path / "poses.txt"
    record_walk(recording, seed=7, max_length_m=8.0, building=office, renderer=office_renderer)
    command = ["localize", "--site", str(office_site), str(recording), "--trajectory", str(out), "--json"]
    assert main(command) == 0
    figures = json.loads(capsys.readouterr().out)
    assert figures["tracked_share"] >= 0.95
    stamps_s, poses = read_trajectory(out)
    assert len(poses) == pytest.approx(figures["tracked_share"] * len(open_recording(recording)), abs=0.5)
    true_stamps_s, true_poses = read_trajectory(recording / "groundtruth.txt")
    error = absolute_trajectory_error(
        stamps_s,
        np.array([pose.translation for pose in poses]),
        true_stamps_s,
        np.array([pose.translation for pose in true_poses]),
    )
    assert error.rmse_m < 0.10
    assert figures["ate_rmse_m"] == pytest.approx(error.rmse_m, abs=1e-3)


def test_a_walker_is_led_to_the_wash_room_by_what_they_hear(
    office_site: Path, office: Building, office_renderer: Renderer
) -> None:
    result = run_walk(
        load_site(office_site), office, "Hall", "Wash room", seed=1, max_s=120.0, renderer=office_renderer
    )
    assert result.outcome == "arrived"
    assert result.arrived
    assert result.contacts == 0
    assert result.deviation_max_m < 1.0
    assert result.localization_rmse_m < 0.15
    texts = [cue.text for cue in result.cues if cue.text]
    assert "Wash room" in texts[-1]
    assert any(text.startswith("Turn ") for text in texts)


def test_the_same_seed_gives_the_same_walk(office_site: Path, office: Building, office_renderer: Renderer) -> None:
    site = load_site(office_site)
    first, second = (
        run_walk(site, office, "Hall", "Wash room", seed=5, max_s=6.0, renderer=office_renderer) for _ in range(2)
    )
    assert first.cues == second.cues
    np.testing.assert_array_equal(first.path_m, second.path_m)
    other = run_walk(site, office, "Hall", "Wash room", seed=6, max_s=6.0, renderer=office_renderer)
    assert not np.array_equal(first.path_m[: len(other.path_m)], other.path_m[: len(first.path_m)])

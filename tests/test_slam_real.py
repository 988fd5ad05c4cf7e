"""The real recording fr1_rpy: hand-held, fast rotation, blur."""

import contextlib
import io
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from device_agent.cli import main
from navcore.evaluation import absolute_trajectory_error
from navcore.recording import open_recording, read_trajectory
from navcore.settings import LocalizationSettings
from navcore.slam.features import feature_count_for
from navcore.slam.keyframes import SlamCamera
from navcore.slam.map_build import BF_PX_M
from navcore.slam.mapper import Mapper

MAX_ATE_M = 0.022
"""RMSE of the finished map, and of localization in it; ORB-SLAM2's is 0.026 m and more."""
MAX_ATE_WHILE_RUNNING_M = 0.026
"""The same of each pose as it was known when its frame came; ORB-SLAM2's is 0.027 m and more."""


@pytest.fixture(scope="module")
def built(fr1_rpy: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """The site, and what building it said."""
    folder = tmp_path_factory.mktemp("real") / "site"
    with contextlib.redirect_stdout(io.StringIO()) as said:
        assert main(["map", "build", str(fr1_rpy), "--site", str(folder), "--name", "Desk", "--json"]) == 0
    return folder, json.loads(said.getvalue())


def test_map_and_localization_are_accurate(
    built: tuple[Path, dict[str, Any]], fr1_rpy: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    site, report = built
    manifest = json.loads((site / "manifest.json").read_text())
    assert manifest["name"] == "Desk"
    assert manifest["report"]["tracked_share"] >= 0.95
    assert report["ate_rmse_m"] <= MAX_ATE_M
    out = tmp_path / "out.txt"
    capsys.readouterr()
    assert main(["localize", "--site", str(site), str(fr1_rpy), "--trajectory", str(out), "--json"]) == 0
    figures = json.loads(capsys.readouterr().out)
    assert figures["tracked_share"] >= 0.95
    assert figures["ate_rmse_m"] <= MAX_ATE_M
    stamps, poses = read_trajectory(out)
    assert len(stamps) == len(poses) >= 0.95 * 350


def test_poses_are_accurate_as_they_come(fr1_rpy: Path) -> None:
    recording = open_recording(fr1_rpy)
    intrinsics = recording.intrinsics
    count = feature_count_for(intrinsics.width_px, intrinsics.height_px, LocalizationSettings().feature_count)
    mapper = Mapper(intrinsics, SlamCamera.of(intrinsics, BF_PX_M), count)
    stamps_s, positions = [], []
    for frame in recording.frames():
        if mapper.add(frame):
            stamps_s.append(frame.stamp_s)
            positions.append(mapper.world_from_camera[:3, 3].copy())
    assert len(stamps_s) >= 0.95 * len(recording)
    true_s, true_poses = read_trajectory(fr1_rpy / "groundtruth.txt")
    truth = np.array([pose.translation for pose in true_poses])
    error = absolute_trajectory_error(np.array(stamps_s), np.array(positions), true_s, truth)
    assert error.rmse_m <= MAX_ATE_WHILE_RUNNING_M


def test_missing_recording_is_one_sentence(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["map", "build", str(tmp_path / "nothing"), "--site", str(tmp_path / "site")]) == 2
    message = capsys.readouterr().err.strip().splitlines()[-1]
    assert "There is no recording" in message
    assert not (tmp_path / "site").exists()


def test_a_folder_with_other_files_is_not_overwritten(
    fr1_rpy: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "diary.txt").write_text("mine")
    assert main(["map", "build", str(fr1_rpy), "--site", str(tmp_path)]) == 2
    assert "holds other files" in capsys.readouterr().err
    assert (tmp_path / "diary.txt").read_text() == "mine"

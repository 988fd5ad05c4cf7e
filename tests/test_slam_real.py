"""The real recording fr1_rpy: hand-held, fast rotation, blur."""

import json
from pathlib import Path

import pytest

from device_agent.cli import main
from navcore.recording import read_trajectory


@pytest.fixture(scope="module")
def site(fr1_rpy: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("real") / "site"
    assert main(["map", "build", str(fr1_rpy), "--site", str(folder), "--name", "Desk", "--json"]) == 0
    return folder


def test_map_and_localization_are_accurate(
    site: Path, fr1_rpy: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    manifest = json.loads((site / "manifest.json").read_text())
    assert manifest["name"] == "Desk"
    assert manifest["report"]["tracked_share"] >= 0.95
    out = tmp_path / "out.txt"
    capsys.readouterr()
    assert main(["localize", "--site", str(site), str(fr1_rpy), "--trajectory", str(out), "--json"]) == 0
    figures = json.loads(capsys.readouterr().out)
    assert figures["tracked_share"] >= 0.95
    assert figures["ate_rmse_m"] <= 0.04
    stamps, poses = read_trajectory(out)
    assert len(stamps) == len(poses) >= 0.95 * 350


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

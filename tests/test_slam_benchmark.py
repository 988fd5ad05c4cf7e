"""The SLAM benchmark answers with JSON for any recording, also where no map comes of it."""

import json
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from navcore.geometry import Transform
from navcore.recording import RecordingWriter
from navcore.slam.rehearsal import REHEARSAL_CAMERA, sliding_frames
from navcore.types import Frame

ROOT = Path(__file__).parent.parent


def _record(folder: Path, frames: Iterable[tuple[Frame, Transform | None]]) -> Path:
    writer = RecordingWriter(folder, REHEARSAL_CAMERA)
    for frame, world_from_camera in frames:
        writer.add(frame, world_from_camera)
    writer.close()
    return folder


def _benchmark(recording: Path) -> dict[str, Any]:
    command = [sys.executable, "-m", "benchmarks.slam", str(recording), "--cold", "5"]
    run = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    assert "Traceback" not in run.stderr
    figures: dict[str, Any] = json.loads(run.stdout)
    return figures


@pytest.fixture(scope="module")
def wall(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    return _benchmark(_record(tmp_path_factory.mktemp("wall") / "walk", sliding_frames(24)))


def test_figures_of_a_wall_that_slides_by(wall: dict[str, Any]) -> None:
    assert wall["mapping_tracked_share"] == wall["localization_tracked_share"] == 1.0
    assert wall["ate_final_m"] < 0.02
    assert wall["ate_while_running_m"] < 0.02
    assert wall["cold_tried"] == wall["cold_found"] == 5
    assert wall["cold_wrong"] == 0
    assert 0 < wall["mapping_ms_median"] <= wall["mapping_ms_p95"]
    assert wall["mapping_median_over_cv2_orb"] == pytest.approx(
        wall["mapping_ms_median"] / wall["cv2_orb_ms"], abs=0.02
    )


def test_start_up_is_told_by_stages(wall: dict[str, Any]) -> None:
    start_up = wall["start_up"]
    assert start_up["keyframes"] == wall["keyframes"]
    assert start_up["ready_s"] == pytest.approx(start_up["imports_s"] + start_up["map_load_s"], abs=0.02)
    assert start_up["ready_cpu_s"] > 0
    assert 50 < start_up["memory_mb"] < 1000


def test_blank_wall_is_reported_and_nothing_is_made_up(tmp_path: Path) -> None:
    blank = np.full((240, 320, 3), 128, np.uint8)
    nothing = np.full((240, 320), np.nan, np.float32)
    figures = _benchmark(_record(tmp_path / "blank", ((Frame(0.1 * i, blank, nothing), None) for i in range(12))))
    assert figures["mapping_tracked_share"] == 0.0
    assert "could be followed" in figures["outcome"]
    for name in ("ate_final_m", "ate_while_running_m", "ate_localization_m", "localization_ms_median", "cold_found"):
        assert figures[name] is None
    assert figures["start_up"] is None
    assert figures["mapping_ms_median"] > 0


def test_without_ground_truth_there_is_no_error_figure(tmp_path: Path) -> None:
    figures = _benchmark(_record(tmp_path / "untrue", ((frame, None) for frame, _ in sliding_frames(12))))
    assert figures["mapping_tracked_share"] == 1.0
    for name in ("ate_final_m", "ate_while_running_m", "ate_localization_m"):
        assert figures[name] is None

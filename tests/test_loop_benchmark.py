"""The parts of the loop's benchmark: frames come back as they were, and a quota leaves nothing behind."""

from __future__ import annotations

import itertools
import os
import time
from pathlib import Path

import numpy as np
import pytest

from benchmarks import cpu_quota
from benchmarks.prepared_frames import PreparedCamera, back_and_forth, prepared
from device_agent.adapters.clocks import SteppedClock
from navcore.errors import SensorError
from navcore.recording import RecordingWriter, open_recording
from navcore.types import CameraIntrinsics, Frame

CAMERA = CameraIntrinsics(64, 48, 50.0, 50.0, 31.5, 23.5)


@pytest.fixture
def recording(tmp_path: Path) -> tuple[Path, list[Frame]]:
    """Four frames of noise, some of their depth missing, as they are read from disk."""
    rng = np.random.default_rng(1)
    writer = RecordingWriter(tmp_path / "recording", CAMERA)
    for number in range(4):
        depth_m = (rng.integers(500, 8000, (48, 64)) / 1000.0).astype(np.float32)
        depth_m[rng.random(depth_m.shape) < 0.1] = np.nan
        writer.add(Frame(0.1 * number, rng.integers(0, 256, (48, 64, 3), np.uint8), depth_m))
    writer.close()
    return tmp_path / "recording", list(open_recording(tmp_path / "recording").frames())


def test_frames_come_back_and_forth_as_they_were(recording: tuple[Path, list[Frame]], tmp_path: Path) -> None:
    folder, frames = recording
    clock = SteppedClock(100.0)
    unpacked = prepared(folder, tmp_path / "walk.frames")
    assert unpacked.count == 4
    camera = PreparedCamera(unpacked, clock, 10.0)
    for number, index in enumerate((0, 1, 2, 3, 2, 1, 0, 1)):
        given = camera.read()
        assert given.stamp_s == pytest.approx(100.1 + 0.1 * number)
        assert camera.index_at(given.stamp_s) == index
        np.testing.assert_array_equal(given.colour_rgb, frames[index].colour_rgb)
        np.testing.assert_allclose(given.depth_m, frames[index].depth_m, atol=0.0006)
    camera.close()
    with pytest.raises(SensorError, match="closed"):
        camera.read()


def test_what_the_reader_is_too_slow_for_is_skipped_and_counted(
    recording: tuple[Path, list[Frame]], tmp_path: Path
) -> None:
    clock = SteppedClock(100.0)
    camera = PreparedCamera(prepared(recording[0], tmp_path / "walk.frames"), clock, 10.0)
    camera.read()
    clock.sleep_until(101.05)
    given = camera.read()
    assert clock.now_s() - given.stamp_s <= 0.1
    assert camera.captured_count == 10
    camera.close()


def test_the_walk_has_no_leap() -> None:
    order = list(itertools.islice(back_and_forth(5), 40))
    assert set(order) == set(range(5))
    assert all(abs(later - earlier) == 1 for earlier, later in itertools.pairwise(order))


def test_a_quota_is_lifted_again(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Where no group can be made, a child takes turns with this process, and is gone afterwards."""
    monkeypatch.setattr(cpu_quota, "CGROUPS", tmp_path)
    with cpu_quota.limited(0.5) as how:
        assert how == "SIGSTOP and SIGCONT"
        # Some turns pass; that we get here at all is what is tested.
        until_s = time.thread_time() + 0.05
        while time.thread_time() < until_s:
            pass
    assert list(tmp_path.iterdir()) == []
    with cpu_quota.limited(1.0) as how:
        assert how == "no limit"


def own_groups() -> list[Path]:
    return [path for folder in (".", "cpu") for path in cpu_quota.CGROUPS.glob(f"{folder}/vbr-quota-{os.getpid()}")]


def test_a_group_that_is_made_is_taken_away(monkeypatch: pytest.MonkeyPatch) -> None:
    try:
        with cpu_quota.limited(0.9) as how:
            if "cgroup" not in how:
                pytest.skip("no cgroup with a quota can be made here")
            assert len(own_groups()) == 1
    finally:
        assert own_groups() == []

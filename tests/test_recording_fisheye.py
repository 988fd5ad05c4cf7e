"""The second camera of a recording: read back as written, refused where it is broken, absent without harm."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from device_agent.adapters.clocks import FakeClock
from device_agent.adapters.recorded import RecordedCamera
from navcore.errors import RecordingError
from navcore.geometry import Transform
from navcore.recording import RecordingWriter, open_recording
from navcore.types import CameraIntrinsics, FisheyeCamera, FisheyeImage, FisheyeIntrinsics, Frame

CAMERA = CameraIntrinsics(32, 24, 30.0, 30.5, 16.0, 12.0)
LENS = FisheyeIntrinsics(40, 30, 14.0, 14.5, 20.0, 15.0, -0.01, 0.02, 0.003, -0.0004, math.radians(80.0))
MOUNTED = Transform.from_quat_xyzw(np.array([0.1, 0.0, 0.02, 0.99]), np.array([-0.08, 0.02, 0.0]))


def frame(stamp_s: float, fisheye_stamp_s: float | None) -> Frame:
    colour, depth = np.full((24, 32, 3), 90, np.uint8), np.full((24, 32), 2.0, np.float32)
    if fisheye_stamp_s is None:
        return Frame(stamp_s, colour, depth)
    grey = np.tile(np.linspace(40, 200, 40).astype(np.uint8), (30, 1))
    return Frame(stamp_s, colour, depth, FisheyeImage(fisheye_stamp_s, grey, FisheyeCamera(LENS, MOUNTED)))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    writer = RecordingWriter(tmp_path / "walk", CAMERA, fisheye=FisheyeCamera(LENS, MOUNTED))
    for stamps in ((1.0, 1.01), (1.1, None), (1.2, 1.21)):
        writer.add(frame(*stamps))
    writer.close()
    return tmp_path / "walk"


def test_what_is_written_is_read_back(folder: Path) -> None:
    recording = open_recording(folder)
    assert recording.fisheye is not None
    camera = recording.fisheye.camera
    assert camera.intrinsics == LENS
    np.testing.assert_allclose(camera.fisheye_from_camera.matrix, MOUNTED.matrix, atol=1e-12)
    frames = list(recording.frames())
    assert [f.fisheye is not None for f in frames] == [True, False, True]
    first = frames[0].fisheye
    assert first is not None
    assert first.stamp_s == 1.01
    expected = frame(1.0, 1.0).fisheye
    assert expected is not None
    assert np.abs(first.grey.astype(int) - expected.grey).max() <= 4


def test_a_recording_without_it_is_whole(folder: Path, tmp_path: Path) -> None:
    writer = RecordingWriter(tmp_path / "plain", CAMERA)
    for stamps in ((1.0, 1.01), (1.1, None), (1.2, 1.21)):
        writer.add(frame(*stamps))
    writer.close()
    plain = open_recording(tmp_path / "plain")
    assert plain.fisheye is None
    assert all(f.fisheye is None for f in plain.frames())
    assert not (tmp_path / "plain" / "fisheye").exists()
    for name in ("calib.txt", "associations.txt"):
        assert (tmp_path / "plain" / name).read_bytes() == (folder / name).read_bytes()


def test_played_again_the_picture_keeps_its_distance_in_time(folder: Path) -> None:
    camera = RecordedCamera(open_recording(folder), FakeClock(50.0))
    first = camera.read()
    assert first.fisheye is not None
    assert first.stamp_s == pytest.approx(50.0)
    assert first.fisheye.stamp_s == pytest.approx(50.01)


def rewrite_calibration(old: str, new: str) -> Callable[[Path], None]:
    def change(folder: Path) -> None:
        path = folder / "fisheye_calib.txt"
        text = path.read_text()
        assert old in text
        path.write_text(text.replace(old, new))

    return change


def cut_first_picture(folder: Path) -> None:
    file = min((folder / "fisheye").iterdir())
    file.write_bytes(file.read_bytes()[:50])


def shrink_last_picture(folder: Path) -> None:
    cv2.imwrite(str(max((folder / "fisheye").iterdir())), np.zeros((10, 10), np.uint8))


def write_table(text: str) -> Callable[[Path], None]:
    return lambda folder: (folder / "fisheye.txt").write_text(text) and None


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (cut_first_picture, "missing or damaged"),
        (shrink_last_picture, "10×10"),
        (rewrite_calibration("k2 0.02", ""), "has no k2"),
        (rewrite_calibration("fx 14.0", "fx many"), "line 1"),
        (rewrite_calibration("k1 -0.01", "k1 -9"), "fold"),
        (rewrite_calibration("cx 20.0", "cx 200"), "optical axis"),
        (rewrite_calibration("max_angle_deg 80.0", "max_angle_deg 400"), "off its axis"),
        (lambda folder: (folder / "fisheye_calib.txt").unlink(), "cannot be read"),
        (write_table(""), "lists no pictures"),
        (write_table("1.0\n"), "line 1"),
        (write_table("1.0 ../../elsewhere.jpg\n"), "outside"),
        (write_table("1.0 fisheye/none.jpg\n"), "missing or damaged"),
    ],
)
def test_what_is_broken_is_refused_with_a_sentence(folder: Path, damage: Callable[[Path], None], message: str) -> None:
    damage(folder)
    with pytest.raises(RecordingError, match=message):
        list(open_recording(folder).frames())

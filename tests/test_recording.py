"""Recordings in the TUM layout: read back what is written, refuse what is broken."""

from pathlib import Path

import numpy as np
import pytest

from navcore.errors import RecordingError
from navcore.geometry import world_from_camera_at
from navcore.recording import Mark, RecordingWriter, open_recording, read_marks, read_trajectory
from navcore.types import CameraIntrinsics, Frame

CAMERA = CameraIntrinsics(32, 24, 30.0, 30.5, 16.0, 12.0)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    writer = RecordingWriter(tmp_path / "walk", CAMERA)
    rng = np.random.default_rng(1)
    for index in range(3):
        depth = rng.uniform(0.3, 8.0, (24, 32)).astype(np.float32)
        depth[0, 0] = np.nan
        colour = np.full((24, 32, 3), (200, 100, 50), np.uint8)
        writer.add(Frame(1.0 + 0.1 * index, colour, depth), world_from_camera_at((index, 0, 1.6), 0.1 * index, 0.2))
    writer.mark(Mark(1.1, "room", "Room 3308"))
    writer.close()
    return tmp_path / "walk"


def test_what_is_written_is_read_back(folder: Path) -> None:
    recording = open_recording(folder)
    assert len(recording) == 3
    assert recording.intrinsics == CAMERA
    expected = np.random.default_rng(1).uniform(0.3, 8.0, (24, 32)).astype(np.float32)
    frame = next(recording.frames())
    assert np.isnan(frame.depth_m[0, 0])
    np.testing.assert_allclose(frame.depth_m[1:], expected[1:], atol=0.0006)  # stored in millimetres
    assert np.abs(frame.colour_rgb.reshape(-1, 3).mean(axis=0) - (200, 100, 50)).max() < 3  # red first
    stamps, poses = read_trajectory(folder / "groundtruth.txt")
    assert stamps.tolist() == pytest.approx([1.0, 1.1, 1.2])
    np.testing.assert_allclose(poses[2].matrix, world_from_camera_at((2, 0, 1.6), 0.2, 0.2).matrix, atol=1e-5)


def test_where_down_is_is_read_back_for_the_frames_that_knew_it(tmp_path: Path) -> None:
    writer = RecordingWriter(tmp_path, CAMERA)
    colour, depth = np.zeros((24, 32, 3), np.uint8), np.ones((24, 32), np.float32)
    down = np.array([0.1, 0.9, 0.4]) / np.linalg.norm([0.1, 0.9, 0.4])
    for stamp_s, gravity in ((1.0, None), (1.1, down), (1.2, None)):
        writer.add(Frame(stamp_s, colour, depth, gravity=gravity))
    writer.close()
    read = [frame.gravity for frame in open_recording(tmp_path).frames()]
    assert read[0] is None
    assert read[2] is None
    assert read[1] == pytest.approx(down, abs=1e-5)
    assert np.linalg.norm(read[1]) == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize("line", ["1.1 0 1", "1.1 0 down 0", "1.1 0 0 0", "1.1 0 9.81 0", "1.1 nan 1 0"])
def test_what_does_not_point_down_is_refused_with_the_line(folder: Path, line: str) -> None:
    (folder / "gravity.txt").write_text(f"1.0 0 1 0\n{line}\n")
    with pytest.raises(RecordingError, match=r"gravity.txt, line 2"):
        open_recording(folder)


def test_named_places_are_read_back(folder: Path) -> None:
    assert read_marks(folder / "marks.txt") == (Mark(1.1, "room", "Room 3308"),)
    assert read_marks(folder / "none.txt") == ()


@pytest.mark.parametrize("line", ["1.0 room", "x room Bar", "1.0 castle Bar", "1.0 room " + "x" * 81])
def test_a_broken_mark_is_refused_with_the_line(tmp_path: Path, line: str) -> None:
    (tmp_path / "marks.txt").write_text(line + "\n")
    with pytest.raises(RecordingError, match="line 1"):
        read_marks(tmp_path / "marks.txt")


def test_a_missing_recording_says_what_is_expected(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="no recording at"):
        open_recording(tmp_path / "nowhere")


def spoil(name: str, text: str) -> object:
    def change(folder: Path) -> None:
        (folder / name).write_text(text)

    return change


def truncate_first_depth(folder: Path) -> None:
    file = min((folder / "depth").iterdir())
    file.write_bytes(file.read_bytes()[:20])


def remove_first_colour(folder: Path) -> None:
    min((folder / "rgb").iterdir()).unlink()


LINE = "1.0 rgb/1.000000.jpg 1.0 depth/1.000000.png\n"


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (spoil("calib.txt", ""), "has no fx"),
        (spoil("calib.txt", "fx 30\nfy 30\ncx 16\ncy twelve\n"), "line 4"),
        (spoil("calib.txt", "fx -30\nfy 30\ncx 16\ncy 12\n"), "greater than 0"),
        (spoil("calib.txt", "fx 30\nfy 30\ncx 160\ncy 12\n"), "far from the middle"),
        (spoil("associations.txt", ""), "lists no frames"),
        (spoil("associations.txt", "nonsense\n"), "line 1"),
        (spoil("associations.txt", LINE + LINE), "times must grow"),
        (spoil("associations.txt", "1.0 ../../secret.jpg 1.0 depth/1.000000.png\n"), "outside the recording"),
        (truncate_first_depth, "damaged"),
        (remove_first_colour, "missing"),
    ],
)
def test_a_broken_recording_is_refused_with_the_place(folder: Path, change: object, sentence: str) -> None:
    change(folder)  # type: ignore[operator]
    with pytest.raises(RecordingError, match=sentence):
        list(open_recording(folder).frames())


@pytest.mark.parametrize("line", ["1 2 3", "1 0 0 0 0 0 0 0", "1 0 0 x 0 0 0 1", "1 0 0 nan 0 0 0 1"])
def test_a_broken_trajectory_is_refused_with_the_line(tmp_path: Path, line: str) -> None:
    (tmp_path / "t.txt").write_text("# t tx ty tz qx qy qz qw\n" + line + "\n")
    with pytest.raises(RecordingError, match="line 2"):
        read_trajectory(tmp_path / "t.txt")


def test_real_recordings_open(fr1_rpy: Path, fr3_cabinet: Path) -> None:
    assert len(open_recording(fr1_rpy)) == 350
    assert len(open_recording(fr1_rpy).intrinsics.distortion) == 5
    frame = next(open_recording(fr3_cabinet).frames())
    assert np.isfinite(frame.depth_m).mean() > 0.5

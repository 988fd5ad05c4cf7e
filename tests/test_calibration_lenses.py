"""Lenses are found from views of a board, in pictures that are really drawn; poor sets are refused with what to do."""

from __future__ import annotations

import json
import math
import zlib
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

from device_agent.calibration_store import CalibrationStore
from device_agent.cli import main
from navcore.calibrating.boards import (
    DOTS_PER_INCH,
    Board,
    BoardView,
    board_named,
    board_picture,
    find_board,
    pdf_bytes,
    png_bytes,
)
from navcore.calibrating.lenses import measured_fisheye, measured_pinhole
from navcore.calibration import Calibration, SonarAlignment
from navcore.errors import InputError
from navcore.fisheye_recording import FisheyeWriter, read_fisheye_camera
from navcore.geometry import Transform, rotation_from_rotvec
from navcore.slam.fisheye import project, unproject
from navcore.types import CameraIntrinsics, FisheyeCamera, FisheyeImage, FisheyeIntrinsics

CHARUCO = board_named("charuco:8x6:30mm:22mm")
CHECKERBOARD = board_named("checkerboard:10x7:25mm")
WIDTH_PX, HEIGHT_PX = 640, 480
PINHOLE = CameraIntrinsics(WIDTH_PX, HEIGHT_PX, 520.0, 515.0, 326.0, 236.0, (0.08, -0.12, 0.001, -0.001, 0.0))
LENS = FisheyeIntrinsics(WIDTH_PX, HEIGHT_PX, 210.0, 208.0, 322.0, 238.0, 0.02, -0.004, 0.0, 0.0, math.radians(95.0))
Pose = tuple[np.ndarray, np.ndarray]
"""Rotation (3, 3) and translation (3,) of the board in the camera's frame."""


def poses(board: Board, away_m: float, reach: float, tilted: bool = True) -> Iterator[Pose]:
    """Yield places of the board's middle all over the picture; ``reach`` in tangents of the angle to the side."""
    middle = np.array([board.size_m[0] / 2, board.size_m[1] / 2, 0.0])
    for number, (x, y) in enumerate((x, y) for y in (-0.75, 0.0, 0.75) for x in (-1.0, -0.5, 0.0, 0.5, 1.0)):
        lean = 0.5 * np.array([math.sin(2.1 * number), math.cos(1.3 * number), 0.3]) if tilted else np.zeros(3)
        turn = rotation_from_rotvec(lean)
        z = away_m * (1.0 + 0.25 * math.sin(1.7 * number))
        yield turn, np.array([reach * x * z, reach * y * z, z]) - turn @ middle


def seen_by_pinhole(board: Board, pose: Pose, camera: CameraIntrinsics = PINHOLE) -> np.ndarray:
    """Draw what a pinhole camera sees of the printed board: each pixel's ray is followed to the paper."""
    u, v = np.meshgrid(np.arange(camera.width_px, dtype=np.float64), np.arange(camera.height_px, dtype=np.float64))
    pixels = np.stack([u.ravel(), v.ravel()], axis=1).reshape(-1, 1, 2)
    flat = cv2.undistortPoints(pixels, camera.matrix, np.array(camera.distortion)).reshape(-1, 2)
    rays = np.column_stack([flat, np.ones(len(flat))])
    return on_paper(board, pose, rays, u.shape)


def seen_by_fisheye(board: Board, pose: Pose) -> np.ndarray:
    u, v = np.meshgrid(np.arange(WIDTH_PX, dtype=np.float64), np.arange(HEIGHT_PX, dtype=np.float64))
    return on_paper(board, pose, unproject(LENS, np.stack([u.ravel(), v.ravel()], axis=1)), u.shape)


def on_paper(board: Board, pose: Pose, rays: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    paper = cv2.GaussianBlur(board_picture(board, 150.0), (0, 0), 1.5)
    dots_per_m = 150.0 / 0.0254
    turn, place = pose
    with np.errstate(divide="ignore", invalid="ignore"):
        along = (turn[:, 2] @ place) / (rays @ turn[:, 2])
        met = (rays * along[:, None] - place) @ turn
    met[~(along > 0.0)] = np.nan
    at = (met[:, :2] * dots_per_m + round(0.01 * dots_per_m) - 0.5).reshape(*shape, 2).astype(np.float32)
    at = np.nan_to_num(at, nan=-1e6)
    return cv2.remap(paper, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderValue=128)


def views_of_points(board: Board, lens: FisheyeIntrinsics, seed: int, noise_px: float) -> list[BoardView]:
    """Return corners as a fisheye lens shows them, without drawing: the law alone."""
    columns, rows = np.meshgrid(np.arange(1, board.columns), np.arange(1, board.rows))
    corners = np.stack([columns.ravel(), rows.ravel(), np.zeros(columns.size)], axis=1) * board.square_m
    rng, views = np.random.default_rng(seed), []
    for number, (turn, place) in enumerate(poses(board, 0.22, 1.3)):
        pixels = project(lens, corners @ turn.T + place) + rng.normal(0.0, noise_px, (len(corners), 2))
        inside = (pixels > 0).all(axis=1) & (pixels < (WIDTH_PX, HEIGHT_PX)).all(axis=1)
        if inside.sum() >= 8:
            views.append(BoardView(f"view {number}", corners[inside], pixels[inside]))
    return views


# ---------------------------------------------------------------------------------------------------- boards
@pytest.mark.parametrize("board", [CHARUCO, CHECKERBOARD], ids=["charuco", "checkerboard"])
def test_a_board_that_is_printed_is_found_where_it_is(board: Board) -> None:
    turn, place = list(poses(board, 0.5, 0.0))[3]
    view = find_board(board, seen_by_pinhole(board, (turn, place)), "a picture")
    assert view is not None
    truth = cv2.projectPoints(
        view.corners_m + (0.0 if board is CHARUCO else board.square_m) * np.array([1.0, 1.0, 0.0]),
        cv2.Rodrigues(turn)[0], place, PINHOLE.matrix, np.array(PINHOLE.distortion),
    )[0].reshape(-1, 2)  # fmt: skip
    if board is CHECKERBOARD and np.linalg.norm(truth[0] - view.pixels[0]) > 50.0:
        truth = truth[::-1]
    assert np.abs(truth - view.pixels).max() < 1.0
    assert find_board(board, np.full((HEIGHT_PX, WIDTH_PX), 90, np.uint8), "nothing") is None


def test_files_to_print_say_how_large_they_are() -> None:
    picture = board_picture(CHARUCO)
    width_px = picture.shape[1]
    png = png_bytes(picture)
    at = png.index(b"pHYs")
    per_m = int.from_bytes(png[at + 4 : at + 8], "big")
    assert width_px / per_m == pytest.approx(0.260, abs=0.001)
    assert png.count(b"pHYs") == 1
    assert zlib.crc32(png[at : at + 13]) == int.from_bytes(png[at + 13 : at + 17], "big")
    again = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_GRAYSCALE)
    assert np.array_equal(again, picture)
    pdf = pdf_bytes(picture)
    box = pdf[pdf.index(b"/MediaBox [") + 11 :].split(b"]")[0].split()
    assert float(box[2]) / 72.0 * 25.4 == pytest.approx(260.0, abs=1.0)
    data = pdf[pdf.index(b"stream\n", pdf.index(b"/FlateDecode")) + 7 :]
    assert zlib.decompressobj().decompress(data) == picture.tobytes()
    offset = int(pdf.rsplit(b"startxref\n", 1)[1].split()[0])
    assert pdf[offset : offset + 4] == b"xref"
    assert DOTS_PER_INCH == 300


@pytest.mark.parametrize(
    "text",
    [
        "", "chessboard:9x6:25mm", "charuco:8x6:30mm", "checkerboard:9x7:25mm", "charuco:8x6:30mm:40mm",
        "charuco:2x2:3mm:2mm",
    ],
)  # fmt: skip
def test_what_is_no_board_is_refused(text: str) -> None:
    with pytest.raises(InputError):
        board_named(text)
    assert board_named(CHARUCO.words()) == CHARUCO


# ----------------------------------------------------------------------------------------------------- lenses
@pytest.fixture(scope="module")
def pictures(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with pictures of a ChArUco board, as a pinhole camera takes them."""
    folder = tmp_path_factory.mktemp("pictures")
    for number, pose in enumerate(poses(CHARUCO, 0.42, 0.42)):
        cv2.imwrite(str(folder / f"{number:02d}.png"), seen_by_pinhole(CHARUCO, pose))
    return folder


def test_the_pinhole_is_measured_from_a_folder_and_stored(
    pictures: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["calibrate", "intrinsics", "--pictures", str(pictures), "--board", CHARUCO.words(), "--json"]
    assert main([*command, "--state", str(tmp_path)]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["revision"] == 1
    stored = CalibrationStore(tmp_path).load()
    assert stored is not None
    assert stored.calibration.pinhole is not None
    found, quality = stored.calibration.pinhole.intrinsics, stored.calibration.pinhole.quality
    assert (found.fx_px, found.fy_px) == pytest.approx((PINHOLE.fx_px, PINHOLE.fy_px), rel=0.01)
    assert (found.cx_px, found.cy_px) == pytest.approx((PINHOLE.cx_px, PINHOLE.cy_px), abs=5.0)
    assert found.distortion[0] == pytest.approx(0.08, abs=0.05)
    assert quality.rms_px < 0.5
    assert quality.coverage > 0.5


def test_a_damaged_file_is_replaced_by_measuring_again_and_the_parts_that_are_kept_stay(
    pictures: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["calibrate", "intrinsics", "--pictures", str(pictures), "--board", CHARUCO.words()]
    store = CalibrationStore(tmp_path)
    store.store(Calibration(sonar=SonarAlignment(5.0, 0.1, 0.01, 0.02, 0.0, 0.0, 60)), 1.0)
    store.path.write_text("garbage")
    assert main([*command, "--state", str(tmp_path)]) == 0
    assert "replaced; its other parts are those of revision 1" in capsys.readouterr().out
    stored = store.load()
    assert stored is not None
    assert stored.calibration.sonar is not None
    assert stored.calibration.pinhole is not None


@pytest.mark.parametrize("blur_px", [2.0, 6.0])
def test_one_bad_picture_is_left_out_and_named(blur_px: float) -> None:
    views = views_of_points(CHARUCO, LENS, 1, 0.1)
    bad = views[4]
    rng = np.random.default_rng(5)
    views[4] = BoardView("blurred", bad.corners_m, bad.pixels + rng.normal(0.0, blur_px, bad.pixels.shape))
    report = measured_fisheye(views, WIDTH_PX, HEIGHT_PX, 0.0)
    assert report.left_out == ("blurred",)
    assert report.calibration.quality.rms_px < 0.3


@pytest.mark.parametrize("seed", range(3))
def test_the_fisheye_lens_is_the_one_that_took_the_views(seed: int) -> None:
    report = measured_fisheye(views_of_points(CHARUCO, LENS, seed, 0.1), WIDTH_PX, HEIGHT_PX, 0.0)
    found = report.calibration.intrinsics
    angles = np.linspace(0.05, found.max_angle_rad - math.radians(6.0), 20)
    rays = np.stack([np.sin(angles), np.zeros(20), np.cos(angles)], axis=1)
    assert found.max_angle_rad > math.radians(50.0)
    assert np.abs(project(found, rays) - project(LENS, rays)).max() < 2.5


def test_the_fisheye_is_measured_from_drawn_pictures_and_its_mounting_is_taken_over(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for number, pose in enumerate(poses(CHARUCO, 0.2, 1.0)):
        cv2.imwrite(str(tmp_path / f"{number:02d}.png"), seen_by_fisheye(CHARUCO, pose))
    mounting = Transform.from_rotation_translation(np.eye(3), np.array([0.0, 0.03, 0.0]))
    camera = FisheyeCamera(LENS, mounting)
    writer = FisheyeWriter(tmp_path / "old", camera)
    writer.add(FisheyeImage(1.0, np.zeros((HEIGHT_PX, WIDTH_PX), np.uint8), camera))
    writer.close()
    code = main(
        [
            "calibrate", "fisheye", "--pictures", str(tmp_path), "--board", CHARUCO.words(), "--state",
            str(tmp_path / "state"), "--mounting", str(tmp_path / "old" / "fisheye_calib.txt"),
        ]
    )  # fmt: skip
    assert code == 0, capsys.readouterr().err
    stored = CalibrationStore(tmp_path / "state").load()
    assert stored is not None
    assert stored.calibration.fisheye is not None
    measured = stored.calibration.fisheye.camera
    assert measured is not None
    assert np.allclose(measured.fisheye_from_camera.matrix, mounting.matrix)
    assert measured.intrinsics.fx_px == pytest.approx(LENS.fx_px, rel=0.02)
    assert read_fisheye_camera(tmp_path / "old" / "fisheye_calib.txt").intrinsics == LENS


def test_poor_sets_are_refused_with_what_to_do() -> None:
    good = views_of_points(CHARUCO, LENS, 0, 0.1)
    with pytest.raises(InputError, match="8 are needed"):
        measured_pinhole(good[:5], WIDTH_PX, HEIGHT_PX, 0.0)
    corner = [BoardView(f"{n}", good[0].corners_m, good[0].pixels * 0.3) for n in range(10)]
    with pytest.raises(InputError, match=r"of the picture only.*lower right|right"):
        measured_pinhole(corner, WIDTH_PX, HEIGHT_PX, 0.0)
    rng = np.random.default_rng(8)
    shaken = [BoardView(v.name, v.corners_m, v.pixels + rng.normal(0.0, 4.0, v.pixels.shape)) for v in good[::2]]
    with pytest.raises(InputError, match=r"take again view|take them again"):
        measured_fisheye(shaken, WIDTH_PX, HEIGHT_PX, 0.0)
    square_on = []
    for number, (turn, place) in enumerate(poses(CHECKERBOARD, 0.45, 0.42, tilted=False)):
        columns, rows = np.meshgrid(np.arange(9), np.arange(6))
        corners = np.stack([columns.ravel(), rows.ravel(), np.zeros(54)], axis=1) * 0.025
        pixels = cv2.projectPoints(corners, cv2.Rodrigues(turn)[0], place, PINHOLE.matrix, None)[0].reshape(-1, 2)
        square_on.append(BoardView(str(number), corners, pixels))
    with pytest.raises(InputError, match="held the same way"):
        measured_pinhole(square_on, WIDTH_PX, HEIGHT_PX, 0.0)


def test_a_folder_without_pictures_or_with_a_damaged_one_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["calibrate", "intrinsics", "--board", CHARUCO.words(), "--state", str(tmp_path / "s"), "--pictures"]
    assert main([*command, str(tmp_path / "gone")]) == 2
    assert main([*command, str(tmp_path)]) == 2
    (tmp_path / "a.png").write_bytes(b"\x89PNG broken")
    assert main([*command, str(tmp_path)]) == 2
    errors = capsys.readouterr().err.strip().splitlines()
    assert [
        word in line for word, line in zip(("no folder", "no pictures", "a.png is damaged"), errors, strict=True)
    ] == [True] * 3

"""Features and matching: what they find, and where."""

import dataclasses

import cv2
import numpy as np
import pytest

from navcore.slam.corners import BORDER_PX, CELL_PX, find_corners, score_row
from navcore.slam.descriptors import as_words, bit_distance, box_sums, direction, disc_weights, orientation
from navcore.slam.features import FeatureExtractor, feature_count_for
from navcore.slam.keyframes import Features, SlamCamera
from navcore.slam.matching import match_all, match_projected
from navcore.slam.rehearsal import REHEARSAL_CAMERA, sliding_frames
from navcore.types import CameraIntrinsics, Frame

CAMERA = SlamCamera.of(REHEARSAL_CAMERA, 100.0)


def _extract(frame: Frame, intrinsics: CameraIntrinsics = REHEARSAL_CAMERA, count: int = 600) -> Features:
    return FeatureExtractor(intrinsics, SlamCamera.of(intrinsics, 100.0), count).extract(frame)


@pytest.fixture(scope="module")
def frames() -> list[Frame]:
    return [frame for frame, _ in sliding_frames(3)]


CIRCLE = [(0, -3), (1, -3), (2, -2), (3, -1), (3, 0), (3, 1), (2, 2), (1, 3)]
CIRCLE += [(-dx, -dy) for dx, dy in CIRCLE]


def _score_by_definition(image: np.ndarray, x: int, y: int) -> int:
    """Return the largest t for which nine contiguous pixels of the circle differ from the centre by t, one way."""
    ring = np.array([int(image[y + dy, x + dx]) for dx, dy in CIRCLE]) - int(image[y, x])
    arcs = [ring[np.arange(start, start + 9) % 16] for start in range(16)]
    return max(0, *(int(arc.min()) for arc in arcs), *(int((-arc).min()) for arc in arcs))


def test_score_is_that_of_the_definition() -> None:
    image = cv2.GaussianBlur(np.random.default_rng(1).integers(0, 256, (60, 75)).astype(np.uint8), (3, 3), 0.8)
    image = np.ascontiguousarray(image, dtype=np.uint8)
    score = np.zeros_like(image)
    inside = (slice(BORDER_PX, 60 - BORDER_PX), slice(BORDER_PX, 75 - BORDER_PX))
    for y in range(BORDER_PX, 60 - BORDER_PX):
        score_row(image, y, score)
    expected = np.zeros_like(image)
    for y in range(BORDER_PX, 60 - BORDER_PX):
        for x in range(BORDER_PX, 75 - BORDER_PX):
            expected[y, x] = _score_by_definition(image, x, y)
    assert np.count_nonzero(expected) > 100
    np.testing.assert_array_equal(score, expected)
    score[inside] = 0
    assert not score.any()


def test_corners_are_those_of_opencv(frames: list[Frame]) -> None:
    image = np.ascontiguousarray(cv2.cvtColor(frames[0].colour_rgb, cv2.COLOR_RGB2GRAY), dtype=np.uint8)
    ours = {(int(x), int(y)): int(s) for x, y, s in find_corners(image, np.zeros_like(image), 20, 20, 100_000)}
    anywhere = cv2.FastFeatureDetector_create(20, False).detect(image, None)  # type: ignore[call-overload]
    assert len(ours) > 300
    assert ours.keys() <= {(round(k.pt[0]), round(k.pt[1])) for k in anywhere}
    # Of two equal neighbours OpenCV drops both, we one; it calls the largest threshold that a corner passes its score.
    peaks = cv2.FastFeatureDetector_create(20, True).detect(image, None)  # type: ignore[call-overload]
    theirs = {(round(k.pt[0]), round(k.pt[1])): int(k.response) + 1 for k in peaks}
    common = ours.keys() & theirs.keys()
    assert len(common) > 300
    assert [ours[place] for place in common] == [theirs[place] for place in common]


def test_a_plain_cell_gives_its_faint_corners_and_a_busy_one_does_not() -> None:
    image = np.full((48 + 2 * BORDER_PX, 96 + 2 * BORDER_PX), 100, np.uint8)
    cell = BORDER_PX + np.array([4, 14])
    image[cell[0], cell] = [112, 160]
    image[cell[0], cell + 2 * CELL_PX] = 112
    corners = find_corners(image, np.zeros_like(image), 20, 7, 100)
    found = {(int(x), int(s)) for x, _, s in corners}
    assert found == {(int(cell[1]), 60), (int(cell[0]) + 2 * CELL_PX, 12), (int(cell[1]) + 2 * CELL_PX, 12)}


def test_quota_goes_round_the_cells_best_first() -> None:
    rng = np.random.default_rng(2)
    image = rng.integers(0, 256, (5 * CELL_PX + 2 * BORDER_PX, 5 * CELL_PX + 2 * BORDER_PX)).astype(np.uint8)
    few = find_corners(image, np.zeros_like(image), 20, 7, 25)
    assert len({((x - BORDER_PX) // CELL_PX, (y - BORDER_PX) // CELL_PX) for x, y, _ in few}) == 25
    fewer = find_corners(image, np.zeros_like(image), 20, 7, 10)
    assert sorted(fewer[:, 2]) == sorted(few[:, 2])[-10:]


def test_smoothing_sums_five_by_five() -> None:
    image = np.random.default_rng(3).integers(0, 256, (41, 67)).astype(np.uint8)
    sums = np.zeros(image.shape, np.uint16)
    box_sums(image, sums)
    expected = cv2.boxFilter(image, cv2.CV_16U, (5, 5), normalize=False)
    np.testing.assert_array_equal(sums[2:-2, 2:-2], expected[2:-2, 2:-2])


def test_orientation_is_that_of_the_intensity_centroid() -> None:
    rng = np.random.default_rng(4)
    y, x = np.mgrid[-20:21, -20:21]
    disc = x**2 + y**2 <= 15.5**2
    for _ in range(20):
        image = rng.integers(0, 256, (41, 41)).astype(np.uint8)
        expected = np.arctan2((y * image)[disc].sum(), (x * image)[disc].sum())
        assert orientation(image, 20, 20, *disc_weights()) == pytest.approx(expected, abs=2e-6)


def test_direction_is_the_arctangent_all_round() -> None:
    for angle in np.linspace(-3.14159, 3.14159, 721):
        assert direction(5.0 * np.cos(angle), 5.0 * np.sin(angle)) == pytest.approx(angle, abs=2e-6)
    assert direction(0.0, 0.0) == 0.0
    assert [direction(-1.0, 0.0), direction(0.0, -1.0)] == pytest.approx([np.pi, -np.pi / 2], abs=2e-6)


def test_feature_counts_by_size() -> None:
    assert feature_count_for(320, 240, 600) == 600
    assert feature_count_for(640, 480, 600) == pytest.approx(1000, abs=20)


def test_features_are_spread_and_inside(frames: list[Frame]) -> None:
    features = _extract(frames[0])
    assert len(features) == 600
    uv = features.uv_px
    assert (uv >= 0).all()
    assert (uv < [320, 240]).all()
    quarters, _, _ = np.histogram2d(uv[:, 0], uv[:, 1], bins=4, range=[[0, 320], [0, 240]])
    assert quarters.min() > 0.2 * quarters.mean()


def test_same_frame_same_features(frames: list[Frame]) -> None:
    first, second = _extract(frames[0]), _extract(frames[0])
    np.testing.assert_array_equal(first.descriptors, second.descriptors)
    np.testing.assert_array_equal(first.uvr_px, second.uvr_px)


def test_blank_image_has_no_features() -> None:
    blank = Frame(0.0, np.full((240, 320, 3), 128, np.uint8), np.full((240, 320), 2.0, np.float32))
    assert len(_extract(blank)) == 0


def test_cells_hold_their_features(frames: list[Frame]) -> None:
    features = _extract(frames[0])
    for cell in (0, 7, 55, 170, 299):
        members = slice(features.cell_start[cell], features.cell_start[cell + 1])
        row, column = divmod(cell, features.cell_columns)
        assert (np.floor(features.uv_px[members] / 16) == [column, row]).all()
    assert features.cell_start[-1] == len(features)


def test_depth_and_virtual_right_coordinate(frames: list[Frame]) -> None:
    features = _extract(frames[0])
    assert features.depth_m == pytest.approx(2.0)
    assert features.uvr_px[:, 2] == pytest.approx(features.uvr_px[:, 0] - 100.0 / 2.0)


def test_no_depth_is_nan(frames: list[Frame]) -> None:
    hole = dataclasses.replace(frames[0], depth_m=np.full((240, 320), np.nan, np.float32))
    features = _extract(hole)
    assert np.isnan(features.depth_m).all()
    assert np.isnan(features.uvr_px[:, 2]).all()


def test_distortion_is_removed(frames: list[Frame]) -> None:
    distorted = dataclasses.replace(REHEARSAL_CAMERA, distortion=(0.1, -0.05, 0.001, -0.002, 0.0))
    raw, ideal = _extract(frames[0]), _extract(frames[0], distorted)
    by_descriptor = {row.tobytes(): uv for row, uv in zip(ideal.descriptors, ideal.uv_px, strict=True)}
    expected = cv2.undistortPoints(
        raw.uv_px.reshape(-1, 1, 2), distorted.matrix, np.array(distorted.distortion), P=distorted.matrix
    ).reshape(-1, 2)
    errors = [
        np.linalg.norm(by_descriptor[row.tobytes()] - uv)
        for row, uv in zip(raw.descriptors, expected, strict=True)
        if row.tobytes() in by_descriptor
    ]
    assert len(errors) > 500
    assert np.median(errors) < 0.02


def test_bit_distance_counts_bits() -> None:
    rng = np.random.default_rng(0)
    a, b = rng.integers(0, 256, (2, 50, 32)).astype(np.uint8)
    expected = np.unpackbits(a ^ b, axis=1).sum(axis=1)
    words_a, words_b = as_words(a), as_words(b)
    assert [bit_distance(words_a[i], words_b[i]) for i in range(50)] == expected.tolist()


def test_matching_follows_the_shift(frames: list[Frame]) -> None:
    first, second = _extract(frames[0]), _extract(frames[1])
    match = match_all(first.descriptors, second.descriptors, 64, 0.8, first.angle_rad, second.angle_rad)
    found = match >= 0
    shift = second.uv_px[match[found]] - first.uv_px[found]
    right = (np.abs(shift - [-8, 0]) < 2.5 * 1.2 ** first.octave[found][:, None]).all(axis=1)
    assert found.sum() > 250
    assert right.mean() > 0.97


def test_projection_matching_respects_window_octave_and_taken(frames: list[Frame]) -> None:
    features = _extract(frames[0])
    everything = np.arange(len(features))
    arguments = (np.full(len(features), np.nan), np.full(len(features), 3.0), features.octave, features.octave)
    free = np.zeros(len(features), np.bool_)
    same = match_projected(features, features.uv_px, *arguments, features.descriptors, free)
    assert (same == everything).mean() > 0.98
    taken = match_projected(features, features.uv_px, *arguments, features.descriptors, ~free)
    assert (taken == -1).all()
    away = match_projected(features, features.uv_px + 1000.0, *arguments, features.descriptors, free)
    assert (away == -1).all()


def test_turned_image_is_matched() -> None:
    frame = next(iter(sliding_frames(1)))[0]
    turned = np.ascontiguousarray(cv2.warpAffine(
        frame.colour_rgb, cv2.getRotationMatrix2D((159.5, 119.5), 33.0, 1.0), (320, 240)
    ), dtype=np.uint8)  # fmt: skip
    first, second = _extract(frame), _extract(dataclasses.replace(frame, colour_rgb=turned))
    match = match_all(first.descriptors, second.descriptors, 64, 0.8, first.angle_rad, second.angle_rad)
    found = np.flatnonzero(match >= 0)
    c, s = np.cos(np.radians(33.0)), np.sin(np.radians(33.0))
    centred = first.uv_px[found] - [159.5, 119.5]
    x, y = centred.T
    expected = np.stack([c * x + s * y + 159.5, -s * x + c * y + 119.5], axis=1)
    near = np.linalg.norm(second.uv_px[match[found]] - expected, axis=1) < 4.0
    assert near.sum() > 80
    assert near.mean() > 0.8

"""Nobody who walks through the view leads the camera: what few key frames have seen decides nothing alone."""

from dataclasses import replace

import numpy as np
import pytest

from navcore.slam.features import feature_count_for
from navcore.slam.keyframes import NO_LANDMARK, Features, SlamCamera
from navcore.slam.mapper import Mapper
from navcore.slam.rehearsal import REHEARSAL_CAMERA, sliding_frames
from navcore.slam.tracking import project_points, refined
from navcore.types import Frame

CAMERA = SlamCamera.of(REHEARSAL_CAMERA, 100.0)
COUNT = 50
ARRIVES = 20
"""The frame from which somebody walks ahead."""


def _with_somebody_ahead(frame: Frame) -> Frame:
    """Return the frame with a figure in the middle that keeps its distance, in clothes with texture."""
    rng = np.random.default_rng(7)
    clothes = np.kron(rng.integers(0, 256, (30, 22, 3)), np.ones((6, 6, 1))).astype(np.uint8)
    colour_rgb, depth_m = frame.colour_rgb.copy(), frame.depth_m.copy()
    colour_rgb[50:230, 100:232] = clothes
    depth_m[50:230, 100:232] = 1.2
    return replace(frame, colour_rgb=colour_rgb, depth_m=depth_m)


def test_the_camera_does_not_follow_somebody_who_walks_ahead() -> None:
    mapper = Mapper(REHEARSAL_CAMERA, CAMERA, feature_count_for(320, 240, 600))
    errors_m = []
    for number, (frame, world_from_camera) in enumerate(sliding_frames(COUNT)):
        assert mapper.add(_with_somebody_ahead(frame) if number >= ARRIVES else frame)
        errors_m.append(np.linalg.norm(mapper.world_from_camera[:3, 3] - world_from_camera.translation))
    assert max(errors_m) < 0.05


def _seen(rng: np.random.Generator, shift_m: float, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return world points (count, 3), and where a camera at the origin sees them after they moved sideways."""
    points = np.column_stack([rng.uniform(-0.8, 0.8, count), rng.uniform(-0.6, 0.6, count), rng.uniform(1.5, 3, count)])
    return points, project_points(np.eye(4), points + np.array([shift_m, 0.0, 0.0]), CAMERA)


@pytest.mark.parametrize("shift_m", [0.1, 0.3])
def test_many_points_that_move_as_one_are_outvoted_by_few_that_are_settled(shift_m: float) -> None:
    rng = np.random.default_rng(3)
    still, still_uvr = _seen(rng, 0.0, 40)
    moving, moving_uvr = _seen(rng, shift_m, 160)
    points, uvr = np.concatenate([still, moving]), np.concatenate([still_uvr, moving_uvr])
    count = len(points)
    features = Features(
        uvr,
        points[:, 2],
        np.zeros(count, np.int32),
        np.zeros(count),
        np.zeros((count, 32), np.uint8),
        np.zeros(2, np.int32),
        1,
    )
    index, landmarks = np.arange(count, dtype=np.int32), np.arange(count, dtype=np.int32)
    guess = np.eye(4)
    guess[0, 3] = shift_m / 2

    def found(settled: np.ndarray) -> tuple[float, np.ndarray]:
        match = refined(0.0, features, guess, index, points, landmarks, CAMERA, settled=settled)
        return abs(float(match.track.camera_from_world[0, 3])), match.track.landmark_of

    off_m, seen = found(landmarks < len(still))
    assert off_m < 0.002
    assert (seen[: len(still)] == landmarks[: len(still)]).all()
    assert (seen[len(still) :] == NO_LANDMARK).all()
    off_m, _ = found(np.ones(count, np.bool_))
    assert off_m > shift_m / 2

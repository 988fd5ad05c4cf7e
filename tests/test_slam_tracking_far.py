"""A frame far from the last one is found by looks and depth; a loop may correct no more than its gate admits."""

import numpy as np
import pytest

from navcore.slam.features import FeatureExtractor, feature_count_for
from navcore.slam.keyframes import Features, SlamCamera
from navcore.slam.loop_closing import DRIFT_OF_A_WALK, DriftGate
from navcore.slam.map import MapBuilder
from navcore.slam.mapping import add_landmarks_from_depth
from navcore.slam.rehearsal import REHEARSAL_CAMERA, sliding_frames
from navcore.slam.tracking import Track, track_last_frame

CAMERA = SlamCamera.of(REHEARSAL_CAMERA, 100.0)
COUNT = feature_count_for(REHEARSAL_CAMERA.width_px, REHEARSAL_CAMERA.height_px, 600)


def _started(features: Features) -> tuple[MapBuilder, Track]:
    """A map of one key frame, and the track of that."""
    builder = MapBuilder(CAMERA, COUNT)
    index = builder.add_keyframe(0.0, features, np.eye(4), np.full(len(features), -1, np.int32))
    add_landmarks_from_depth(builder, index)
    row = builder.landmark_of[index, : len(features)].copy()
    return builder, Track(0.0, features, np.eye(4), row, np.zeros((6, 6)))


@pytest.mark.parametrize("frames_between", [8, 16, 22])
def test_a_far_frame_is_found_without_a_guess(frames_between: int) -> None:
    extractor = FeatureExtractor(REHEARSAL_CAMERA, CAMERA, COUNT)
    frames = list(sliding_frames(30))
    (first, _), (second, truth) = frames[0], frames[frames_between]
    builder, last = _started(extractor.extract(first))
    found = track_last_frame(builder, last, extractor.extract(second), second.stamp_s, last.camera_from_world)
    assert found is not None
    centre = -found.track.camera_from_world[:3, :3].T @ found.track.camera_from_world[:3, 3]
    np.testing.assert_allclose(centre, truth.translation, atol=0.03)


def test_another_place_is_not_taken_for_the_last_one() -> None:
    extractor = FeatureExtractor(REHEARSAL_CAMERA, CAMERA, COUNT)
    first, second = next(sliding_frames(1, seed=1))[0], next(sliding_frames(1, seed=2))[0]
    builder, last = _started(extractor.extract(first))
    assert track_last_frame(builder, last, extractor.extract(second), 0.7, np.eye(4)) is None


def test_the_gate_widens_with_the_walk_and_by_request() -> None:
    assert DRIFT_OF_A_WALK.admits(0.39, 0.1, 0.0)
    assert not DRIFT_OF_A_WALK.admits(0.6, 0.1, 0.0)
    assert DRIFT_OF_A_WALK.admits(0.6, 0.1, 10.0)
    assert not DRIFT_OF_A_WALK.admits(0.1, 0.5, 10.0)
    assert DriftGate(shift_m=5.0, turn_rad=0.6).admits(4.0, 0.5, 0.0)

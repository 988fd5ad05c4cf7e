"""A recording continues a map: it is placed by two frames, followed both ways from there, and refused elsewhere."""

from dataclasses import replace

import numpy as np
import pytest

from navcore.errors import MappingError
from navcore.slam.features import feature_count_for
from navcore.slam.keyframes import SlamCamera
from navcore.slam.mapper import Mapper
from navcore.slam.rehearsal import REHEARSAL_CAMERA, sliding_frames

CAMERA = SlamCamera.of(REHEARSAL_CAMERA, 100.0)
COUNT = feature_count_for(REHEARSAL_CAMERA.width_px, REHEARSAL_CAMERA.height_px, 600)
LATER_S = 100.0


def _first_half() -> tuple[Mapper, list, np.ndarray]:
    """A map of the right half of a wall, all frames of the wall as of a later visit, and where they truly are."""
    frames = list(sliding_frames(90))
    mapper = Mapper(REHEARSAL_CAMERA, CAMERA, COUNT)
    for frame, _ in frames[45:]:
        mapper.add(frame)
    mapper.finish()
    later = [replace(frame, stamp_s=frame.stamp_s + LATER_S) for frame, _ in frames]
    start_m = frames[45][1].translation
    return mapper, later, np.array([truth.translation - start_m for _, truth in frames])


@pytest.fixture(scope="module")
def continued() -> tuple[Mapper, Mapper, np.ndarray]:
    first, later, truth = _first_half()
    second = Mapper.continuing(first.builder, REHEARSAL_CAMERA, CAMERA, COUNT, earlier=first.frame_poses)
    for frame in later[:70]:
        second.add(frame)
    second.finish()
    return first, second, truth


def test_frames_before_the_map_is_recognised_are_followed_too(continued) -> None:
    first, second, truth = continued
    own = second.trajectory()[len(first.trajectory()) :]
    stamps_s = [stamp_s for stamp_s, _ in own]
    assert stamps_s == sorted(stamps_s)
    numbers = np.rint((np.array(stamps_s) - LATER_S) / 0.1).astype(int)
    assert set(range(70)) - set(numbers.tolist()) <= {0, 1}, "all but what the map's margin hides are found"
    error_m = [np.linalg.norm(pose[:3, 3] - truth[n]) for n, (_, pose) in zip(numbers, own, strict=True)]
    assert max(error_m) < 0.05
    assert second.held_count == second.dropped_count == 0


def test_both_recordings_share_landmarks(continued) -> None:
    first, second, _ = continued
    alive = np.flatnonzero(second.builder.keyframe_alive)
    fresh = [k for k in alive if second.builder.keyframes[k].stamp_s >= LATER_S]
    old = {k for k in alive if second.builder.keyframes[k].stamp_s < LATER_S}
    assert fresh
    assert old
    assert any(old & set(second.builder.covisible(int(k), 15)[0].tolist()) for k in fresh)
    assert second.builder is first.builder


def test_another_place_is_refused_with_advice() -> None:
    first, _, _ = _first_half()
    before = first.builder.keyframe_alive.copy()
    second = Mapper.continuing(first.builder, REHEARSAL_CAMERA, CAMERA, COUNT)
    for frame, _ in sliding_frames(12, seed=7):
        assert not second.add(frame)
    assert not second.is_anchored
    assert second.held_count == 12
    np.testing.assert_array_equal(first.builder.keyframe_alive, before)
    with pytest.raises(MappingError, match="recognised"):
        second.finish()


def test_another_camera_is_refused() -> None:
    first, _, _ = _first_half()
    with pytest.raises(MappingError, match="another camera"):
        Mapper.continuing(first.builder, REHEARSAL_CAMERA, replace(CAMERA, fx_px=240.0), COUNT)

"""The growing map keeps its two tables in step; the frozen one is stored, checked and moved."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from navcore.errors import SiteError
from navcore.slam.features import feature_count_for
from navcore.slam.keyframes import SlamCamera
from navcore.slam.local_mapping import LocalMapping
from navcore.slam.loop_closing import LoopCloser
from navcore.slam.map import MapBuilder
from navcore.slam.mapper import Mapper
from navcore.slam.rehearsal import REHEARSAL_CAMERA, rehearse, sliding_frames
from navcore.slam.slam_map import SlamMap


@pytest.fixture(scope="module")
def wall() -> tuple[Mapper, SlamMap, np.ndarray]:
    mapper, localizer, truth = rehearse(60)
    del localizer
    return mapper, mapper.finish(), truth


def _assert_tables_agree(builder: MapBuilder) -> None:
    rows = builder.landmark_of[builder.keyframe_alive]
    counts = np.bincount(rows[rows >= 0], minlength=builder.landmark_count)
    np.testing.assert_array_equal(builder.observation_counts(), counts)
    assert builder.landmark_alive[np.unique(rows[rows >= 0])].all()
    for row in rows:
        seen = row[row >= 0]
        assert len(seen) == len(np.unique(seen))


def test_trajectory_is_the_true_one(wall: tuple[Mapper, SlamMap, np.ndarray]) -> None:
    _, slam_map, truth = wall
    assert len(slam_map.trajectory) == len(truth)
    error = np.linalg.norm(slam_map.trajectory[:, :3, 3] - truth, axis=1)
    assert error.max() < 0.03
    assert slam_map.keyframe_count >= 4


def test_tables_agree_after_mapping(wall: tuple[Mapper, SlamMap, np.ndarray]) -> None:
    _assert_tables_agree(wall[0].builder)


def test_tables_agree_after_every_change() -> None:
    builder = rehearse(40)[0].builder
    rng = np.random.default_rng(0)
    alive = np.flatnonzero(builder.landmark_alive).astype(np.int32)
    chosen = rng.permutation(alive)
    builder.fuse_landmarks(chosen[:50], chosen[50:100])
    _assert_tables_agree(builder)
    builder.remove_landmarks(chosen[100:150])
    _assert_tables_agree(builder)
    keyframe = int(np.flatnonzero(builder.keyframe_alive)[1])
    builder.disconnect(np.full(20, keyframe, np.int32), np.arange(20, dtype=np.int32))
    _assert_tables_agree(builder)
    before = builder.pose_of(keyframe)
    builder.remove_keyframe(keyframe)
    _assert_tables_agree(builder)
    np.testing.assert_allclose(builder.pose_of(keyframe), before, atol=1e-9)


def test_a_fused_landmark_is_seen_by_all_who_saw_either() -> None:
    builder = rehearse(40)[0].builder
    counts = builder.observation_counts()
    old, new = (int(n) for n in np.flatnonzero(builder.landmark_alive & (counts >= 2))[:2])
    of_either = set(np.flatnonzero(((builder.landmark_of == old) | (builder.landmark_of == new)).any(axis=1)))
    builder.fuse_landmarks(np.array([old], np.int32), np.array([new], np.int32))
    assert set(np.flatnonzero((builder.landmark_of == new).any(axis=1))) == of_either
    assert not (builder.landmark_of == old).any()


def test_the_same_frames_give_the_same_bytes() -> None:
    first, second = (rehearse(30)[0].finish().to_arrays() for _ in range(2))
    assert first.keys() == second.keys()
    for name in first:
        assert first[name].tobytes() == second[name].tobytes(), name


def test_mapping_beside_tracking_gives_the_same_bytes() -> None:
    def mapped(executor: ThreadPoolExecutor | None) -> tuple[Mapper, list[bytes]]:
        count = feature_count_for(REHEARSAL_CAMERA.width_px, REHEARSAL_CAMERA.height_px, 600)
        mapper = Mapper(REHEARSAL_CAMERA, SlamCamera.of(REHEARSAL_CAMERA, 100.0), count, executor=executor)
        poses = []
        for frame, _ in sliding_frames(60):
            mapper.add(frame)
            poses.append(mapper.world_from_camera.tobytes())
        return mapper, poses

    in_line, poses_in_line = mapped(None)
    with ThreadPoolExecutor(1) as executor:
        beside, poses_beside = mapped(executor)
        assert poses_beside == poses_in_line, "what is known while running is the same, too"
        first, second = in_line.finish().to_arrays(), beside.finish().to_arrays()
    assert first.keys() == second.keys()
    for name in first:
        assert first[name].tobytes() == second[name].tobytes(), name


def test_an_error_of_mapping_reaches_the_caller() -> None:
    builder = rehearse(30)[0].builder
    with ThreadPoolExecutor(1) as executor:
        local = LocalMapping(builder, LoopCloser(builder), executor)
        local.begin(10**6)
        with pytest.raises(IndexError):
            local.settle()
        assert local.settle() is None


def test_arrays_can_be_read_back(wall: tuple[Mapper, SlamMap, np.ndarray]) -> None:
    _, slam_map, _ = wall
    back = SlamMap.from_arrays(slam_map.to_arrays())
    assert back.camera == slam_map.camera
    for name, array in slam_map.to_arrays().items():
        np.testing.assert_array_equal(back.to_arrays()[name], array)
    np.testing.assert_array_equal(back.landmark_of, slam_map.landmark_of)


@pytest.mark.parametrize("name", ["positions", "feature_start", "camera", "place_vocabulary", "feature_landmark"])
def test_a_missing_array_is_refused(wall: tuple[Mapper, SlamMap, np.ndarray], name: str) -> None:
    arrays = wall[1].to_arrays()
    del arrays[name]
    with pytest.raises(SiteError, match="damaged"):
        SlamMap.from_arrays(arrays)


def test_wrong_shapes_numbers_and_indices_are_refused(wall: tuple[Mapper, SlamMap, np.ndarray]) -> None:
    good = wall[1].to_arrays()
    beyond = good["feature_landmark"].copy()
    beyond[0] = len(good["positions"])
    holes = good["positions"].copy()
    holes[0, 0] = np.nan
    for change in (
        {"positions": good["positions"][:-1]},
        {"positions": good["positions"].astype(np.float32)},
        {"positions": holes},
        {"feature_landmark": beyond},
        {"feature_start": good["feature_start"][::-1].copy()},
        {"camera": good["camera"][:3]},
        {"camera_from_world": good["camera_from_world"][:, :3]},
    ):
        with pytest.raises(SiteError, match="damaged"):
            SlamMap.from_arrays(good | change)


def test_moving_the_world_moves_everything(wall: tuple[Mapper, SlamMap, np.ndarray]) -> None:
    _, slam_map, _ = wall
    turn = np.array([[0.0, -1, 0, 3], [1, 0, 0, -2], [0, 0, 1, 1], [0, 0, 0, 1]])
    moved = slam_map.transformed(turn)
    k, n = 1, slam_map.landmark_of[1][slam_map.landmark_of[1] >= 0][0]
    before = slam_map.camera_from_world[k] @ np.append(slam_map.positions[n], 1)
    after = moved.camera_from_world[k] @ np.append(moved.positions[n], 1)
    np.testing.assert_allclose(after, before, atol=1e-9)
    np.testing.assert_allclose(moved.trajectory[5], turn @ slam_map.trajectory[5], atol=1e-12)

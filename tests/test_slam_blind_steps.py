"""What the motion model led along is remembered, and the map is less sure of it there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from navcore.slam.blind_steps import BlindSteps
from navcore.slam.depth_alignment import LEVER_M
from navcore.slam.depth_tracking import MOTION_SIGMA_M_S, MOTION_SIGMA_RAD_S, motion_covariance
from navcore.slam.freezing import freeze
from navcore.slam.map_uncertainty import keyframe_covariances
from navcore.slam.mapping import cull_redundant_keyframes
from navcore.slam.nearest import nearest_index
from navcore.slam.rehearsal import rehearse
from navcore.slam.slam_map import SlamMap
from navcore.slam.thawing import thaw

ALONG = np.eye(6)[2:3]
"""Forward, as the camera sees it."""
NOTHING_OPEN = np.zeros((0, 6))


def quarter_turn() -> np.ndarray:
    """A camera (4, 4) that looks along the world's x axis."""
    pose = np.eye(4)
    pose[:3, :3] = [[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]]
    return pose


def test_a_second_of_the_motion_model_is_as_sure_as_it_says() -> None:
    along = motion_covariance(ALONG)
    assert along[2, 2] == pytest.approx(MOTION_SIGMA_M_S**2)
    assert np.count_nonzero(along) == 1
    turning = np.zeros((1, 6))
    turning[0, 4] = 1.0
    assert motion_covariance(turning)[4, 4] == pytest.approx(MOTION_SIGMA_RAD_S**2)
    # A step sideways that goes with a turn: what both allow.
    both = np.zeros((1, 6))
    both[0, 0] = both[0, 4] = np.sqrt(0.5)
    assert motion_covariance(both)[0, 0] == pytest.approx(LEVER_M**2 * motion_covariance(both)[4, 4])


def test_a_wrong_velocity_stays_wrong() -> None:
    for frames in (1, 5, 20):
        steps = BlindSteps()
        for _ in range(frames):
            steps.note(np.eye(4), 0.1, ALONG)
        assert steps.taken(np.eye(4))[2, 2] == pytest.approx((0.1 * frames * MOTION_SIGMA_M_S) ** 2)


def test_key_frames_on_the_way_share_the_drift_and_what_is_seen_ends_it() -> None:
    steps = BlindSteps()
    parts = []
    for _ in range(3):
        for _ in range(4):
            steps.note(np.eye(4), 0.1, ALONG)
        parts.append(steps.taken(np.eye(4)))
    assert sum(part[2, 2] for part in parts) == pytest.approx((1.2 * MOTION_SIGMA_M_S) ** 2)
    steps.note(np.eye(4), 0.1, NOTHING_OPEN)
    assert not steps.taken(np.eye(4)).any()
    steps.note(np.eye(4), 0.1, ALONG)
    assert steps.taken(np.eye(4))[2, 2] == pytest.approx((0.1 * MOTION_SIGMA_M_S) ** 2)


def test_what_was_open_stays_where_it_was_in_the_world() -> None:
    steps = BlindSteps()
    steps.note(quarter_turn(), 0.5, ALONG)
    drift = steps.taken(np.eye(4))
    assert drift[0, 0] == pytest.approx((0.5 * MOTION_SIGMA_M_S) ** 2)
    assert drift[2, 2] == pytest.approx(0.0)


@pytest.fixture(scope="module")
def slam_map() -> SlamMap:
    return rehearse(60)[0].finish()


def with_drift(slam_map: SlamMap, keyframe: int, sigma_m: float) -> SlamMap:
    drifts = np.zeros((slam_map.keyframe_count, 6, 6))
    drifts[keyframe, 2, 2] = sigma_m**2
    return replace(slam_map, keyframe_drift=drifts)


def without_landmarks_across(slam_map: SlamMap, keyframe: int) -> SlamMap:
    """The map with nothing in it that key frames on both sides of a step see."""
    of_feature = np.repeat(np.arange(slam_map.keyframe_count), np.diff(slam_map.feature_start))
    shown = slam_map.feature_landmark
    before = np.unique(shown[(of_feature < keyframe) & (shown >= 0)])
    cut = (of_feature >= keyframe) & np.isin(shown, before)
    return replace(slam_map, feature_landmark=np.where(cut, -1, shown).astype(np.int32))


def test_the_map_is_less_sure_beyond_such_a_step_along_what_was_open(slam_map: SlamMap) -> None:
    middle = slam_map.keyframe_count // 2
    cut = without_landmarks_across(slam_map, middle)
    known = keyframe_covariances(cut)
    drifted = keyframe_covariances(with_drift(cut, middle, 0.8))
    rotation = cut.camera_from_world[middle, :3, :3]
    first, last = rotation @ (drifted - known)[[0, -1], :3, :3] @ rotation.T
    # Laid onto the truth, the larger part of the map stays, and the smaller one lies where the step has led it.
    assert np.sqrt(first[2, 2]) + np.sqrt(last[2, 2]) > 0.12
    assert abs(first[0, 0] + last[0, 0]) < 0.1 * (first[2, 2] + last[2, 2])


@pytest.mark.parametrize("leap", ["drift", "session"])
def test_no_key_frame_takes_the_covariance_of_one_beyond_a_leap(
    slam_map: SlamMap, monkeypatch: pytest.MonkeyPatch, leap: str
) -> None:
    """However few are computed: here two, so that by number alone the nearest would lie beyond."""
    begin = slam_map.keyframe_count - 2
    cut = without_landmarks_across(slam_map, begin)
    if leap == "drift":
        cut = with_drift(cut, begin, 0.8)
    else:
        sessions = cut.keyframe_session.copy()
        sessions[begin:] += 1
        cut = replace(cut, keyframe_session=sessions)
    exact = keyframe_covariances(cut)
    monkeypatch.setattr("navcore.slam.map_uncertainty.SAMPLED_KEYFRAMES", 2)
    np.testing.assert_allclose(keyframe_covariances(cut)[[begin - 1, begin]], exact[[begin - 1, begin]], rtol=1e-6)


def test_the_nearest_is_that_of_the_table_of_all_differences() -> None:
    rng = np.random.default_rng(8)
    for count in (1, 2, 3, 40):
        # Whole numbers: many are there twice, and many are equally near.
        values, at = rng.integers(0, 30, count).astype(float), rng.integers(-5, 70, 200) / 2.0
        expected = np.abs(at[:, None] - values).argmin(axis=1)
        np.testing.assert_array_equal(nearest_index(values, at), expected)


def test_where_landmarks_hold_both_sides_together_it_matters_little(slam_map: SlamMap) -> None:
    middle = slam_map.keyframe_count // 2
    known = keyframe_covariances(slam_map)
    drifted = keyframe_covariances(with_drift(slam_map, middle, 0.8))
    assert np.sqrt(drifted[:, 2, 2]).max() < 1.2 * np.sqrt(known[:, 2, 2]).max()


@pytest.mark.parametrize("has_drifted", [False, True])
def test_a_key_frame_that_shows_nothing_new_stays_for_its_drift(has_drifted: bool) -> None:
    builder = rehearse(30)[0].builder
    kept = len(builder.keyframes) - 1
    seen = builder.keyframes[kept].features
    again = [
        builder.add_keyframe(10.0 + n, seen, builder.camera_from_world[kept], builder.landmark_of[kept, : len(seen)])
        for n in range(5)
    ]
    if has_drifted:
        builder.drifts[again[1]] = np.eye(6)
    cull_redundant_keyframes(builder, again[-1])
    assert bool(builder.keyframe_alive[again[1]]) is has_drifted


def test_it_is_stored_and_goes_along_when_the_map_grows(slam_map: SlamMap) -> None:
    known = with_drift(slam_map, 2, 0.5)
    read = SlamMap.from_arrays(known.to_arrays())
    np.testing.assert_array_equal(read.keyframe_drift, known.keyframe_drift)
    again = freeze(thaw(read), read.places, [(0.0, np.eye(4))])
    np.testing.assert_array_equal(again.keyframe_drift, known.keyframe_drift)
    old = {name: array for name, array in known.to_arrays().items() if name != "keyframe_drift"}
    assert not SlamMap.from_arrays(old).keyframe_drift.any()

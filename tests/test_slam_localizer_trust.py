"""What a pose says of itself: the covariance holds the truth, evidence tells right from wrong, the same again."""

import dataclasses
import itertools

import numpy as np
import pytest

from navcore.geometry import FloatArray, Transform
from navcore.settings import LocalizationSettings
from navcore.slam.keyframes import SlamCamera
from navcore.slam.lie import exp_se3
from navcore.slam.localizer import Localizer
from navcore.slam.map_evidence import CELL_COLUMNS, CELL_ROWS, MapEvidence, evidence_for
from navcore.slam.map_uncertainty import LEAST_VARIANCE, positive, with_covariances
from navcore.slam.mapper import Mapper
from navcore.slam.pose import covariance_in_world
from navcore.slam.pose_uncertainty import (
    LEAST_MISFIT,
    covariance_of,
    drifted,
    is_walkable,
    map_factor,
    misfit,
    odometry_factor,
    weighed_by_misfit,
)
from navcore.slam.rehearsal import REHEARSAL_CAMERA, rehearse, sliding_frames
from navcore.slam.relocalization import is_same_place, proposals
from navcore.slam.rolling_shutter import sorted_anew
from navcore.slam.slam_map import SlamMap
from navcore.slam.tracking import Track, local_keyframes, local_landmarks, track_last_frame
from navcore.types import Frame, LocalizationQuality

CHI2_3 = 7.815


@pytest.fixture(scope="module")
def slam_map() -> SlamMap:
    return rehearse(60)[0].finish()


@pytest.fixture(scope="module")
def walk() -> list[tuple[Frame, Transform]]:
    return list(sliding_frames(60))


def _localizer(slam_map: SlamMap) -> Localizer:
    return Localizer(slam_map, REHEARSAL_CAMERA, LocalizationSettings())


def _followed(slam_map: SlamMap, walk: list[tuple[Frame, Transform]], count: int) -> Track:
    localizer = _localizer(slam_map)
    for frame, _ in walk[:count]:
        localizer.locate(frame)
    assert localizer.state is not None
    return localizer.state.last


def _displaced(track: Track, *shift_m: float) -> Track:
    twist = np.array([*shift_m, 0.0, 0.0, 0.0])
    return dataclasses.replace(track, camera_from_world=exp_se3(twist) @ track.camera_from_world)


def _evidence(slam_map: SlamMap, track: Track, frame: Frame) -> MapEvidence:
    around = local_landmarks(slam_map, local_keyframes(slam_map, track.landmarks))
    return evidence_for(slam_map, track, around, frame.depth_m)


# ------------------------------------------------------------------------------------------------- uncertainty
def test_the_covariance_holds_the_truth(slam_map: SlamMap, walk: list[tuple[Frame, Transform]]) -> None:
    localizer = _localizer(slam_map)
    held = []
    for frame, truth in walk:
        found = localizer.locate(frame)
        assert found.world_from_camera is not None
        assert found.covariance is not None
        error = found.world_from_camera.translation - truth.translation
        held.append(error @ np.linalg.solve(found.covariance[:3, :3], error) < CHI2_3)
    assert np.mean(held) >= 0.9


def test_pixels_that_err_together_widen_the_covariance(slam_map: SlamMap, walk: list[tuple[Frame, Transform]]) -> None:
    track = _followed(slam_map, walk, 20)
    assert misfit(slam_map, track) < 2.0
    uvr = track.features.uvr_px.copy()
    # As a rolling shutter does: the lower the row, the farther to the side.
    uvr[:, 0] += 3.0 * (uvr[:, 1] / REHEARSAL_CAMERA.height_px - 0.5)
    sheared = dataclasses.replace(track, features=dataclasses.replace(track.features, uvr_px=uvr))
    assert misfit(slam_map, sheared) > 3.0 * misfit(slam_map, track)


def test_independent_pixel_noise_of_nominal_size_is_no_misfit(
    slam_map: SlamMap, walk: list[tuple[Frame, Transform]]
) -> None:
    track = _followed(slam_map, walk, 20)
    rng = np.random.default_rng(3)
    factors = []
    for _ in range(20):
        seen = np.flatnonzero(track.landmark_of >= 0)
        uvr = track.features.uvr_px.copy()
        uvr[seen] = _projected(track, slam_map, seen)
        uvr[seen] += rng.normal(size=(len(seen), 3)) / np.sqrt(track.features.inv_sigma2[seen, None])
        noisy = dataclasses.replace(track, features=dataclasses.replace(track.features, uvr_px=uvr))
        factors.append(misfit(slam_map, noisy))
    assert LEAST_MISFIT <= np.mean(factors) < 1.6


def _projected(track: Track, slam_map: SlamMap, seen: np.ndarray) -> FloatArray:
    camera, pose = slam_map.camera, track.camera_from_world
    x, y, z = (slam_map.positions[track.landmark_of[seen]] @ pose[:3, :3].T + pose[:3, 3]).T
    u = camera.fx_px * x / z + camera.cx_px
    return np.stack([u, camera.fy_px * y / z + camera.cy_px, u - camera.bf_px_m / z], axis=1)


def test_the_map_is_surest_in_its_middle(slam_map: SlamMap) -> None:
    covariances = slam_map.keyframe_covariance
    assert covariances.shape == (slam_map.keyframe_count, 6, 6)
    assert np.linalg.eigvalsh(covariances).min() > 0
    spread = np.trace(covariances[:, :3, :3], axis1=1, axis2=2)
    middle = len(spread) // 2
    # A walk along a wall without any loop: its ends are known worst.
    assert spread[0] > spread[middle]
    assert spread[-1] > spread[middle]


def test_the_maps_covariance_turns_with_the_map(slam_map: SlamMap) -> None:
    turn = np.eye(4)
    turn[:2, :2] = [[0.0, -1.0], [1.0, 0.0]]
    turn[:3, 3] = (5.0, -2.0, 1.0)
    turned = slam_map.transformed(turn)
    anew = with_covariances(turned).keyframe_covariance
    np.testing.assert_allclose(turned.keyframe_covariance, anew, rtol=1e-3, atol=1e-9)


def test_no_axis_of_a_key_frame_is_left_negative_by_rounding() -> None:
    turn = np.linalg.qr(np.random.default_rng(7).normal(size=(6, 6)))[0]
    variances = np.array([-7e-8, 1e-8, 1e-7, 3e-7, 6e-7, 9e-7])
    held = positive((turn * variances @ turn.T)[None])
    found = np.linalg.eigvalsh(held[0])
    assert found[0] >= 0.99 * LEAST_VARIANCE
    np.testing.assert_allclose(found[1:], variances[1:], rtol=1e-6)
    assert np.array_equal(held, held.transpose(0, 2, 1))


def test_odometry_grows_by_what_is_moved_and_weighs_less_then(
    slam_map: SlamMap, walk: list[tuple[Frame, Transform]]
) -> None:
    track = _followed(slam_map, walk, 20)
    covariance = np.diag([1e-4] * 3 + [1e-5] * 3)
    stood = drifted(covariance, track, track)
    moved = drifted(covariance, track, _displaced(track, 0.5, 0.0, 0.0))
    assert np.trace(moved) > np.trace(stood) > np.trace(covariance)
    near = odometry_factor(covariance, track, track).information
    far = odometry_factor(covariance, track, _displaced(track, 0.5, 0.0, 0.0)).information
    assert np.linalg.eigvalsh(near - far).min() > -1e-6 * np.trace(near)
    assert np.trace(far) < np.trace(near)


def test_odometry_that_few_points_carry_drifts_by_what_they_leave_open(
    slam_map: SlamMap, walk: list[tuple[Frame, Transform]]
) -> None:
    track = _followed(slam_map, walk, 20)
    covariance = np.diag([1e-4] * 3 + [1e-5] * 3)
    nothing_followed = dataclasses.replace(track, information=np.zeros((6, 6)))
    few = dataclasses.replace(track, information=track.information / 1e3)
    grown = [np.trace(drifted(covariance, track, after)[:3, :3]) for after in (nothing_followed, track, few)]
    assert grown[0] < grown[1] < grown[2]
    by_few = drifted(covariance, track, few) - drifted(covariance, track, nothing_followed)
    np.testing.assert_allclose(by_few, covariance_in_world(few.camera_from_world, few.information), atol=1e-12)


def test_points_that_err_together_are_worth_less_to_odometry(
    slam_map: SlamMap, walk: list[tuple[Frame, Transform]]
) -> None:
    track = _followed(slam_map, walk, 20)
    points = np.full((len(track.features), 3), np.nan)
    seen = np.flatnonzero(track.landmark_of >= 0)
    points[seen] = slam_map.positions[track.landmark_of[seen]]
    followed = dataclasses.replace(track, carried_points=points)
    uvr = track.features.uvr_px.copy()
    uvr[:, 0] += 3.0 * (uvr[:, 1] / REHEARSAL_CAMERA.height_px - 0.5)
    sheared = dataclasses.replace(followed, features=dataclasses.replace(track.features, uvr_px=uvr))
    whole, less = (np.trace(weighed_by_misfit(slam_map.camera, t).information) for t in (followed, sheared))
    assert whole <= np.trace(track.information)
    assert less < 0.3 * whole


@pytest.mark.parametrize(("staying", "is_followed"), [(0.3, False), (0.9, True)])
def test_a_minority_of_the_matches_is_not_followed(
    slam_map: SlamMap, walk: list[tuple[Frame, Transform]], staying: float, is_followed: bool
) -> None:
    """In the dark most features are noise that matches noise, each with a motion of its own."""
    track = dataclasses.replace(_followed(slam_map, walk, 20), carried_points=None)
    rng = np.random.default_rng(4)
    moves = rng.random(len(track.features)) > staying
    uvr = track.features.uvr_px.copy()
    angle_rad = rng.uniform(0.0, 2 * np.pi, len(uvr))
    away_px = 6.0 * moves * 1.2**track.features.octave
    uvr[:, 0] += away_px * np.cos(angle_rad)
    uvr[:, 1] += away_px * np.sin(angle_rad)
    uvr[:, 2] += away_px * np.cos(angle_rad)
    features = sorted_anew(dataclasses.replace(track.features, uvr_px=uvr), slam_map.camera)[0]
    found = track_last_frame(slam_map, track, features, track.stamp_s + 0.1, track.camera_from_world)
    assert (found is not None) is is_followed


def test_nobody_jumps(slam_map: SlamMap, walk: list[tuple[Frame, Transform]]) -> None:
    track = _followed(slam_map, walk, 20)
    later = dataclasses.replace(track, stamp_s=track.stamp_s + 0.1)
    assert is_walkable(track, _displaced(later, 0.2, 0.0, 0.0))
    assert not is_walkable(track, _displaced(later, 0.8, 0.0, 0.0))


# ---------------------------------------------------------------------------------------------------- evidence
def test_the_right_pose_convinces(slam_map: SlamMap, walk: list[tuple[Frame, Transform]]) -> None:
    evidence = _evidence(slam_map, _followed(slam_map, walk, 20), walk[19][0])
    assert evidence.is_convincing
    assert evidence.is_plausible
    assert evidence.cells <= CELL_COLUMNS * CELL_ROWS


def test_a_surface_behind_the_landmarks_contradicts(slam_map: SlamMap, walk: list[tuple[Frame, Transform]]) -> None:
    track, frame = _followed(slam_map, walk, 20), walk[19][0]
    farther = dataclasses.replace(frame, depth_m=frame.depth_m + np.float32(1.0))
    assert not _evidence(slam_map, track, farther).is_plausible


def test_what_hides_the_landmarks_says_nothing(slam_map: SlamMap, walk: list[tuple[Frame, Transform]]) -> None:
    track, frame = _followed(slam_map, walk, 20), walk[19][0]
    depth_m = frame.depth_m.copy()
    depth_m[:, :100] = 0.6
    assert _evidence(slam_map, track, dataclasses.replace(frame, depth_m=depth_m)).is_convincing


def test_landmarks_found_in_one_corner_only_do_not_convince(
    slam_map: SlamMap, walk: list[tuple[Frame, Transform]]
) -> None:
    track, frame = _followed(slam_map, walk, 20), walk[19][0]
    corner = (track.features.uv_px[:, 0] < 120) & (track.features.uv_px[:, 1] < 120)
    sparse = dataclasses.replace(track, landmark_of=np.where(corner, track.landmark_of, -1).astype(np.int32))
    around = local_landmarks(slam_map, local_keyframes(slam_map, track.landmarks))
    assert not evidence_for(slam_map, sparse, around, frame.depth_m).is_convincing


# ---------------------------------------------------------------------------------------------------- searching
def test_every_frame_of_the_walk_is_found_without_a_guess(
    slam_map: SlamMap, walk: list[tuple[Frame, Transform]]
) -> None:
    localizer = _localizer(slam_map)
    for frame, truth in walk[::3]:
        localizer.reset()
        found = localizer.locate(frame)
        assert found.world_from_camera is not None
        assert np.linalg.norm(found.world_from_camera.translation - truth.translation) < 0.05


def test_proposals_are_different_places(slam_map: SlamMap, walk: list[tuple[Frame, Transform]]) -> None:
    features = _followed(slam_map, walk, 30).features
    everywhere = range(slam_map.keyframe_count)
    tracks = [found.track for found in proposals(slam_map, features, 0.0, everywhere, 20)]
    assert tracks
    for number, track in enumerate(tracks):
        assert not any(is_same_place(track, other) for other in tracks[:number])


@pytest.fixture(scope="module")
def single(walk: list[tuple[Frame, Transform]]) -> SlamMap:
    mapper = Mapper(REHEARSAL_CAMERA, SlamCamera.of(REHEARSAL_CAMERA, 100.0), 600)
    for frame, _ in walk[:30]:
        mapper.add(frame)
    return mapper.finish()


def test_two_places_that_look_alike_are_not_told_apart(single: SlamMap, walk: list[tuple[Frame, Transform]]) -> None:
    """The same wall twice in a building, four metres higher the second time: which one it is, nobody can say."""
    assert _localizer(single).locate(walk[10][0]).world_from_camera is not None
    assert _localizer(_doubled(single)).locate(walk[10][0]).quality is LocalizationQuality.LOST


def _qualities_after_gap(
    single: SlamMap, walk: list[tuple[Frame, Transform]], gap_s: float
) -> list[LocalizationQuality]:
    """Follow the lower one of two walls that are alike; return what is said of the frames after a gap."""
    below, localizer = _localizer(single), _localizer(_doubled(single))
    for frame, _ in walk[:6]:
        below.locate(frame)
    # The double holds the single map's key frames and landmarks under the same numbers.
    localizer._state = below.state
    assert localizer.locate(walk[6][0]).quality is LocalizationQuality.LOCALIZED
    later = [dataclasses.replace(frame, stamp_s=frame.stamp_s + gap_s) for frame, _ in walk[7:12]]
    return [localizer.locate(frame).quality for frame in later]


@pytest.mark.parametrize("gap_s", [2.5, 11.0, 3600.0, -0.5])
def test_after_a_long_gap_or_with_time_turned_back_every_place_is_possible_again(
    single: SlamMap, walk: list[tuple[Frame, Transform]], gap_s: float
) -> None:
    assert set(_qualities_after_gap(single, walk, gap_s)) == {LocalizationQuality.LOST}


def test_after_a_short_gap_a_pose_is_confirmed_anew(single: SlamMap, walk: list[tuple[Frame, Transform]]) -> None:
    assert set(_qualities_after_gap(single, walk, 0.5)) == {LocalizationQuality.LOCALIZED}
    after = _qualities_after_gap(single, walk, 1.5)
    assert after[:2] == [LocalizationQuality.UNCERTAIN] * 2
    assert after[-1] is LocalizationQuality.LOCALIZED


def _covered(frame: Frame, columns: list[tuple[int, int]], rng: np.random.Generator) -> Frame:
    """Return a frame with noise in some columns."""
    colour = frame.colour_rgb.copy()
    for first, last in columns:
        colour[:, first:last] = rng.integers(0, 256, (colour.shape[0], last - first, 3))
    return dataclasses.replace(frame, colour_rgb=colour)


def test_a_match_that_convinces_half_does_not_make_a_drifted_pose_a_sure_one(
    slam_map: SlamMap, walk: list[tuple[Frame, Transform]]
) -> None:
    drift = np.diag([0.1**2] * 3 + [0.02**2] * 3)
    spread = {}
    for covered in ([], [(0, 225)]):
        localizer = _localizer(slam_map)
        for frame, _ in walk[:20]:
            localizer.locate(frame)
        known = localizer.state
        assert known is not None
        localizer._state = dataclasses.replace(known, covariance=known.covariance + drift)
        localizer.locate(_covered(walk[20][0], covered, np.random.default_rng(6)))
        state = localizer.state
        assert state is not None
        assert state.matched_s == walk[20][0].stamp_s
        own = covariance_of(map_factor(state.last, state.misfit))
        spread[len(covered)] = np.trace((state.covariance - state.shared_covariance)[:3, :3]) / np.trace(own[:3, :3])
    assert spread[0] == pytest.approx(1.0, rel=0.05)
    assert spread[1] > 1.5


def _doubled(slam_map: SlamMap) -> SlamMap:
    arrays = slam_map.to_arrays()
    lift = np.eye(4)
    lift[1, 3] = 4.0
    upper = slam_map.transformed(lift).to_arrays()
    count, landmarks, features = slam_map.keyframe_count, len(slam_map.positions), int(slam_map.feature_start[-1])
    joined = {name: np.concatenate([array, upper[name]]) for name, array in arrays.items() if name not in _WHOLE}
    joined |= {name: arrays[name] for name in _WHOLE if name in arrays}
    joined["feature_start"] = np.concatenate([arrays["feature_start"], arrays["feature_start"][1:] + features])
    shown = arrays["feature_landmark"]
    joined["feature_landmark"] = np.concatenate([shown, np.where(shown < 0, -1, shown + landmarks).astype(np.int32)])
    joined["parent"] = np.concatenate(
        [arrays["parent"], np.where(arrays["parent"] < 0, -1, arrays["parent"] + count).astype(np.int32)]
    )
    joined["loop_edges"] = np.concatenate([arrays["loop_edges"], arrays["loop_edges"] + np.int32(count)])
    ids, end = arrays["place_image_ids"], arrays["place_image_end"]
    joined["place_image_ids"] = np.concatenate([ids, ids + np.int32(count)])
    joined["place_image_end"] = np.concatenate([end, end[1:] + end[-1]])
    return SlamMap.from_arrays(joined)


_WHOLE = (
    "camera",
    "readout_s",
    "descriptor_kind",
    "place_vocabulary",
    "trajectory",
    "trajectory_stamp_s",
    "trajectory_session",
)


# ------------------------------------------------------------------------------------------------ whole story
def test_the_middle_is_unknown_the_covariance_grows_holds_the_truth_and_drops_again(
    walk: list[tuple[Frame, Transform]],
) -> None:
    """The map knows both ends of the walk; in between only odometry does."""
    slam_map = rehearse(60)[0].finish()
    unknown = [k for k, stamp_s in enumerate(slam_map.keyframe_stamp_s.tolist()) if 1.2 < stamp_s < 4.6]
    localizer = _localizer(_without(slam_map, unknown))
    spread, matched = [], []
    for frame, truth in walk:
        found = localizer.locate(frame)
        assert found.world_from_camera is not None
        assert found.covariance is not None
        assert localizer.state is not None
        error = found.world_from_camera.translation - truth.translation
        assert error @ np.linalg.solve(found.covariance[:3, :3], error) < 2 * CHI2_3
        # Along the wall, for how far away it is, its surface shows; and relative to the map.
        spread.append(float((localizer.state.covariance - localizer.state.shared_covariance)[0, 0]))
        matched.append(localizer.state.matched_s == frame.stamp_s)
    runs = [list(run) for known, run in itertools.groupby(range(len(walk)), matched.__getitem__) if not known]
    blind = max(runs, key=len)
    assert len(blind) >= 5
    assert np.all(np.diff([spread[b] for b in blind]) > 0)
    assert spread[blind[-1]] > 2 * spread[5]
    assert spread[-1] < 0.5 * spread[blind[-1]]


def _without(slam_map: SlamMap, keyframes: list[int]) -> SlamMap:
    """Return the map without the landmarks that these key frames see."""
    gone = np.unique(slam_map.landmark_of[keyframes])
    shown = slam_map.feature_landmark.copy()
    shown[np.isin(shown, gone[gone >= 0])] = -1
    return SlamMap.from_arrays(slam_map.to_arrays() | {"feature_landmark": shown})


def test_the_same_frames_give_the_same_poses(slam_map: SlamMap, walk: list[tuple[Frame, Transform]]) -> None:
    def poses() -> list[bytes]:
        localizer = _localizer(slam_map)
        frames = [*walk[:8], *list(sliding_frames(3, seed=9)), *walk[30:40]]
        located = [localizer.locate(frame) for frame, _ in frames]
        return [b"" if f.world_from_camera is None else f.world_from_camera.matrix.tobytes() for f in located]

    assert poses() == poses()


def test_another_direction_is_another_place(slam_map: SlamMap, walk: list[tuple[Frame, Transform]]) -> None:
    track = _followed(slam_map, walk, 10)
    assert is_same_place(track, _displaced(track, 0.1, 0.0, 0.0))
    assert not is_same_place(track, _displaced(track, 0.0, 0.0, 0.5))
    about = np.diag([-1.0, 1.0, -1.0, 1.0]) @ track.camera_from_world
    assert not is_same_place(track, dataclasses.replace(track, camera_from_world=about))

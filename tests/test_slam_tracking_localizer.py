"""The localizer finds, follows, and never claims what it does not know."""

import dataclasses

import numpy as np
import pytest

from navcore.errors import MappingError
from navcore.geometry import Transform
from navcore.settings import LocalizationSettings
from navcore.slam.features import FeatureExtractor, feature_count_for
from navcore.slam.keyframes import Features, SlamCamera
from navcore.slam.localizer import Localizer
from navcore.slam.mapper import Mapper
from navcore.slam.rehearsal import REHEARSAL_CAMERA, rehearse, sliding_frames
from navcore.slam.slam_map import SlamMap
from navcore.types import Frame, LocalizationQuality


@pytest.fixture(scope="module")
def slam_map() -> SlamMap:
    return rehearse(60)[0].finish()


@pytest.fixture
def localizer(slam_map: SlamMap) -> Localizer:
    return Localizer(slam_map, REHEARSAL_CAMERA, LocalizationSettings())


@pytest.fixture(scope="module")
def walk() -> list[tuple[Frame, Transform]]:
    return list(sliding_frames(60))


def test_follows_the_walk(localizer: Localizer, walk: list[tuple[Frame, Transform]]) -> None:
    located = [localizer.locate(frame) for frame, _ in walk]
    for found, (_, truth) in zip(located[3:], walk[3:], strict=True):
        assert found.quality is LocalizationQuality.LOCALIZED
        assert found.world_from_camera is not None
        assert np.linalg.norm(found.world_from_camera.translation - truth.translation) < 0.03
        assert found.covariance is not None
        assert np.linalg.eigvalsh(found.covariance).min() > 0


def test_a_pose_found_without_a_guess_must_be_confirmed(
    localizer: Localizer, walk: list[tuple[Frame, Transform]]
) -> None:
    first = localizer.locate(walk[30][0])
    assert first.quality is LocalizationQuality.UNCERTAIN
    assert first.world_from_camera is not None
    assert np.linalg.norm(first.world_from_camera.translation - walk[30][1].translation) < 0.05


@pytest.mark.parametrize(("distinct", "is_found"), [(30, False), (60, True)])
def test_edges_do_not_tell_a_place(
    localizer: Localizer,
    walk: list[tuple[Frame, Transform]],
    monkeypatch: pytest.MonkeyPatch,
    distinct: int,
    is_found: bool,
) -> None:
    """Bare corridors have the same edges; where there was no guess, enough of what agrees must be no edge."""
    localizer.locate(walk[30][0])
    assert localizer.state is not None
    found = localizer.state.last
    seen = np.flatnonzero(found.landmark_of >= 0)
    slides = np.tile([1.0, 0.0, 1.0], (len(found.features), 1)) / np.sqrt(2.0)
    slides[seen[np.linspace(0, len(seen) - 1, distinct).astype(int)]] = 0.0
    features = dataclasses.replace(found.features, slides=slides)
    monkeypatch.setattr(FeatureExtractor, "extract_grey", lambda *_: features)
    # The wall of this walk leaves much open; in a corridor with corners surfaces would not object.
    monkeypatch.setattr(Localizer, "_is_undisputed", lambda *_: True)
    localizer.reset()
    assert (localizer.locate(walk[30][0]).quality is not LocalizationQuality.LOST) is is_found


def test_dropped_frames_are_bridged(localizer: Localizer, walk: list[tuple[Frame, Transform]]) -> None:
    for frame, truth in walk[::4]:
        found = localizer.locate(frame)
        assert found.world_from_camera is not None
        assert np.linalg.norm(found.world_from_camera.translation - truth.translation) < 0.05


def test_fewer_features_and_all_again_lose_nothing(
    localizer: Localizer, walk: list[tuple[Frame, Transform]], monkeypatch: pytest.MonkeyPatch
) -> None:
    extracted: list[int] = []
    extract = FeatureExtractor.extract_grey

    def counted(extractor: FeatureExtractor, grey: np.ndarray, depth_m: np.ndarray) -> Features:
        features = extract(extractor, grey, depth_m)
        extracted.append(len(features))
        return features

    monkeypatch.setattr(FeatureExtractor, "extract_grey", counted)
    for number, (frame, truth) in enumerate(walk):
        localizer.use_features(0.5 if 20 <= number < 40 else 1.0)
        found = localizer.locate(frame)
        if number >= 3:
            assert found.quality is LocalizationQuality.LOCALIZED
            assert found.world_from_camera is not None
            assert np.linalg.norm(found.world_from_camera.translation - truth.translation) < 0.03
    assert max(extracted[20:40]) < 0.6 * min(extracted[:20])
    assert min(extracted[40:]) > 0.9 * min(extracted[:20])


@pytest.mark.parametrize(("fraction", "count"), [(1.0, 600), (0.6, 360), (0.1, 300), (0.0, 300)])
def test_some_features_are_always_looked_for(localizer: Localizer, fraction: float, count: int) -> None:
    localizer.use_features(fraction)
    assert localizer._extractor.count == feature_count_for(320, 240, count)


def test_another_place_is_lost(localizer: Localizer) -> None:
    for frame, _ in sliding_frames(5, seed=9):
        assert localizer.locate(frame).quality is LocalizationQuality.LOST


def test_covered_camera_is_lost_and_then_found_again(localizer: Localizer, walk: list[tuple[Frame, Transform]]) -> None:
    for frame, _ in walk[:10]:
        localizer.locate(frame)
    for frame, _ in walk[10:15]:
        nothing = np.full_like(frame.depth_m, np.nan)
        covered = dataclasses.replace(frame, colour_rgb=np.zeros_like(frame.colour_rgb), depth_m=nothing)
        found = localizer.locate(covered)
        assert found.quality is LocalizationQuality.LOST
        assert found.world_from_camera is None
        assert found.covariance is None
    qualities = [localizer.locate(frame).quality for frame, _ in walk[40:45]]
    assert qualities[0] is LocalizationQuality.UNCERTAIN
    assert qualities[-1] is LocalizationQuality.LOCALIZED


def test_beyond_the_map_odometry_goes_on_and_uncertainty_grows(walk: list[tuple[Frame, Transform]]) -> None:
    short = Mapper(REHEARSAL_CAMERA, SlamCamera.of(REHEARSAL_CAMERA, 100.0), 600)
    for frame, _ in walk[:12]:
        short.add(frame)
    localizer = Localizer(short.finish(), REHEARSAL_CAMERA, LocalizationSettings())
    sigmas, qualities = [], []
    for frame, truth in walk:
        found = localizer.locate(frame)
        assert found.world_from_camera is not None
        assert found.covariance is not None
        assert np.linalg.norm(found.world_from_camera.translation - truth.translation) < 0.1
        sigmas.append(float(np.trace(found.covariance[:3, :3])))
        qualities.append(found.quality)
    assert LocalizationQuality.LOCALIZED in qualities[:12]
    assert qualities[-1] is LocalizationQuality.UNCERTAIN
    assert sigmas[-1] > sigmas[-10] > sigmas[5]


def test_reset_forgets(localizer: Localizer, walk: list[tuple[Frame, Transform]]) -> None:
    for frame, _ in walk[:5]:
        localizer.locate(frame)
    localizer.reset()
    assert localizer.state is None
    assert localizer.locate(walk[20][0]).quality is LocalizationQuality.UNCERTAIN


def test_nothing_to_follow_is_a_mapping_error() -> None:
    mapper = Mapper(REHEARSAL_CAMERA, SlamCamera.of(REHEARSAL_CAMERA, 100.0), 600)
    blank = Frame(0.0, np.full((240, 320, 3), 90, np.uint8), np.full((240, 320), 2.0, np.float32))
    for number in range(20):
        mapper.add(dataclasses.replace(blank, stamp_s=0.1 * number))
    with pytest.raises(MappingError, match="record again"):
        mapper.finish()

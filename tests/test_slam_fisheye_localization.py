"""The fisheye picture shows the map where the front view shows nothing, and is believed only where it does."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from device_agent.simulation.building import Building
from device_agent.simulation.fisheye_sensor import FisheyeModel, head_fisheye
from device_agent.simulation.renderer import Renderer
from device_agent.simulation.sensors import CameraModel, head_camera
from navcore.geometry import Transform, world_from_camera_at
from navcore.settings import LocalizationSettings
from navcore.slam.fisheye import project, unproject
from navcore.slam.fisheye_localization import FisheyeAid
from navcore.slam.fisheye_tracking import FisheyeMatch
from navcore.slam.fisheye_view import FisheyeView
from navcore.slam.keyframes import NO_LANDMARK, SlamCamera
from navcore.slam.localizer import Localizer
from navcore.slam.localizer_state import MapMatch
from navcore.slam.map_evidence import evidence_for
from navcore.slam.mapper import Mapper
from navcore.slam.slam_map import SlamMap
from navcore.slam.tracking import Track
from navcore.types import Frame, LocalizationQuality

CAMERA = head_camera(320, 240)
FISHEYE = head_fisheye()
FEATURES = 600


def poses(first_deg: float, last_deg: float, count: int) -> list[Transform]:
    """Somebody in the lounge, who turns on the spot and sways a little."""
    angles = np.radians(np.linspace(first_deg, last_deg, count))
    return [
        world_from_camera_at((17.5 + 0.15 * math.sin(3 * a), 17.2 + 0.1 * math.cos(2 * a), 1.6), a, math.radians(12))
        for a in angles.tolist()
    ]


def frames(renderer: Renderer, walked: list[Transform], seed: int) -> Iterator[Frame]:
    front, wide = CameraModel(CAMERA, seed), FisheyeModel(FISHEYE, seed)
    for number, pose in enumerate(walked):
        frame = front.capture(renderer.render(CAMERA, pose), 0.1 * number, number)
        yield replace(frame, fisheye=wide.capture(renderer, pose, 0.1 * number, number))


@pytest.fixture(scope="module")
def mapped(office: Building, office_renderer: Renderer) -> SlamMap:
    """A map of half the lounge, in the building's frame."""
    walked = poses(20.0, 160.0, 50)
    mapper = Mapper(CAMERA, SlamCamera.of(CAMERA, 100.0), FEATURES)
    for frame in frames(office_renderer, walked, 1):
        mapper.add(replace(frame, fisheye=None))
    return mapper.finish().transformed(np.array(walked[0].matrix))


def blinded(frame: Frame) -> Frame:
    """Somebody stands in front of the depth camera: grey, and too near to be measured."""
    return replace(frame, colour_rgb=np.full_like(frame.colour_rgb, 90), depth_m=np.full_like(frame.depth_m, np.nan))


def error_m(found: Transform | None, truth: Transform) -> float:
    return math.inf if found is None else float(np.linalg.norm(found.translation - truth.translation))


def test_every_place_on_the_cylinder_is_a_place_in_the_picture_and_back() -> None:
    view = FisheyeView(FISHEYE, FEATURES)
    uv = np.random.default_rng(0).uniform((0, 0), (view.cylinder.width_px, view.cylinder.height_px), (200, 2))
    rays = view.rays_of(uv)
    np.testing.assert_allclose(unproject(FISHEYE.intrinsics, project(FISHEYE.intrinsics, rays)), rays, atol=1e-9)
    points, normals = 3.0 * rays, rays
    again, octave, cosine = view.project_landmarks(np.eye(4), points, normals, np.full(200, 3.0 * 1.2**3 / 150.0))
    seen = octave >= 0
    assert seen.mean() > 0.6
    np.testing.assert_allclose(again[seen], uv[seen], atol=1e-6)
    np.testing.assert_allclose(cosine[seen], 1.0, atol=1e-9)


def test_with_the_front_covered_the_fisheye_carries_the_pose(mapped: SlamMap, office_renderer: Renderer) -> None:
    walked = poses(40.0, 130.0, 30)
    for use, at_least, at_most in ((True, 0.9, 1.0), (False, 0.0, 0.25)):
        localizer = Localizer(mapped, CAMERA, LocalizationSettings(use_fisheye=use))
        localized = 0
        for number, frame in enumerate(frames(office_renderer, walked, 2)):
            found = localizer.locate(frame if number < 6 else blinded(frame))
            if number >= 6 and found.quality is LocalizationQuality.LOCALIZED:
                localized += 1
                assert error_m(found.world_from_camera, walked[number]) < 0.15
        assert at_least <= localized / 24 <= at_most


def test_a_pose_is_found_when_the_front_looks_where_nothing_is_mapped(
    mapped: SlamMap, office_renderer: Renderer
) -> None:
    walked = poses(-25.0, -20.0, 4)
    found = {}
    for use in (True, False):
        localizer = Localizer(mapped, CAMERA, LocalizationSettings(use_fisheye=use))
        found[use] = [localizer.locate(frame).world_from_camera for frame in frames(office_renderer, walked, 3)]
    assert all(error_m(pose, truth) < 0.25 for pose, truth in zip(found[True], walked, strict=True))
    assert all(pose is None or error_m(pose, truth) < 0.25 for pose, truth in zip(found[False], walked, strict=True))


@pytest.mark.parametrize(
    ("found_count", "aside_m", "is_believed"), [(30, 0.4, False), (30, 0.0, True), (200, 0.4, True)]
)
def test_few_landmarks_of_the_fisheye_are_not_believed_where_surfaces_see_the_camera_elsewhere(
    mapped: SlamMap, office_renderer: Renderer, found_count: int, aside_m: float, is_believed: bool
) -> None:
    localizer = Localizer(mapped, CAMERA, LocalizationSettings(use_fisheye=False))
    frame, *_ = frames(office_renderer, poses(60.0, 66.0, 3), 6)
    localizer.locate(frame)
    assert localizer.state is not None
    last = localizer.state.last
    aside = last.camera_from_world.copy()
    aside[0, 3] += aside_m
    nothing = np.full(len(last.features), NO_LANDMARK, np.int32)
    track = replace(last, camera_from_world=aside, landmark_of=nothing, carried_points=None)
    shown = FisheyeMatch(track, np.arange(found_count, dtype=np.int32), found_count, 2 * found_count)
    match = MapMatch(track, evidence_for(mapped, track, shown.landmarks, frame.depth_m), shown)
    assert match.is_sparse is (found_count < 80)
    assert localizer._is_undisputed(match, 0.0) is is_believed


@pytest.mark.parametrize(("found_count", "counts"), [(30, False), (200, True)])
def test_few_landmarks_of_the_fisheye_confirm_no_place(
    mapped: SlamMap, office_renderer: Renderer, found_count: int, counts: bool
) -> None:
    localizer = Localizer(mapped, CAMERA, LocalizationSettings(use_fisheye=False))
    first, second, _ = frames(office_renderer, poses(60.0, 75.0, 3), 6)
    localizer.locate(first)
    found = localizer.state
    assert found is not None
    localizer.locate(second)
    assert localizer.state is not None
    seen = localizer.state.last
    nothing = np.full(len(seen.features), NO_LANDMARK, np.int32)
    track = replace(seen, landmark_of=nothing, carried_points=None)
    shown = FisheyeMatch(track, np.arange(found_count, dtype=np.int32), found_count, 2 * found_count)
    match = MapMatch(track, evidence_for(mapped, track, shown.landmarks, second.depth_m), shown)
    after = localizer._with_map(found, seen, match, second)
    assert after.confirmations == found.confirmations + int(counts)


def test_another_place_is_no_evidence(mapped: SlamMap, office_renderer: Renderer) -> None:
    elsewhere = [world_from_camera_at((7.0, 8.0 + 0.3 * k, 1.6), 1.5, math.radians(12)) for k in range(4)]
    localizer = Localizer(mapped, CAMERA, LocalizationSettings())
    for frame in frames(office_renderer, elsewhere, 4):
        assert localizer.locate(frame).quality is not LocalizationQuality.LOCALIZED


def test_a_picture_taken_later_is_placed_by_the_motion_between(mapped: SlamMap, office_renderer: Renderer) -> None:
    walked = poses(60.0, 66.0, 3)
    front, *_ = frames(office_renderer, walked[2:], 5)
    later = FisheyeModel(FISHEYE, 5).capture(office_renderer, poses(60.0, 69.0, 4)[3], 0.3, 9)
    frame = replace(front, stamp_s=0.2, fisheye=later)
    aid, found = FisheyeAid(mapped, FEATURES), {}
    features = Localizer(mapped, CAMERA, LocalizationSettings())._extractor.extract(front)
    unseen = np.full(len(features), NO_LANDMARK, np.int32)
    tracks = [
        Track(0.1 * k, features, np.array(pose.inverse().matrix), unseen, np.zeros((6, 6)))
        for k, pose in enumerate(walked)
    ]
    for moves in (True, False):
        aid.look(frame, *((tracks[1], tracks[0]) if moves else (None, None)))
        match = aid.join(tracks[2], 2.0)
        assert match is not None
        world_from_camera = Transform(np.linalg.inv(match.track.camera_from_world))
        turned = world_from_camera.rotation.T @ walked[2].rotation
        found[moves] = math.acos(min(1.0, 0.5 * (float(np.trace(turned)) - 1.0)))
    assert found[True] < math.radians(0.6)
    assert found[False] > math.radians(2.0)

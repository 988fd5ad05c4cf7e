"""Two recordings of overlapping parts of a building become one map, and one can be taken out again."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial import cKDTree

from navcore.errors import InputError, MappingError
from navcore.geometry import FloatArray
from navcore.planning.edits import validate
from navcore.planning.road_network import RoadNetwork
from navcore.recording import Recording, open_recording, read_trajectory
from navcore.settings import LocalizationSettings
from navcore.site import Site, load_site, map_checksum, save_site
from navcore.site_building import build_site
from navcore.site_growth import Growth, extend_site, recording_session, remove_session, slam_map_of
from navcore.slam.covisibility import session_groups, spanning_parents
from navcore.slam.deformation import Deformation, frame_kept, rigid_fit
from navcore.slam.freezing import freeze
from navcore.slam.joining import join
from navcore.slam.keyframes import SlamCamera
from navcore.slam.lie import exp_se3
from navcore.slam.localizer import Localizer
from navcore.slam.map_build import LevelMap, build_level_map
from navcore.slam.mapper import Mapper
from navcore.slam.rehearsal import REHEARSAL_CAMERA, WALL_M, rehearse
from navcore.slam.session_removal import renumbered, separated_by_removal, without_key_frames
from navcore.slam.slam_map import SlamMap
from navcore.slam.thawing import thaw
from navcore.types import Frame, LocalizationQuality

SETTINGS = LocalizationSettings()


def silent(share: float, text: str) -> None:
    del share, text


def part(recording: Recording, first: float, last: float) -> Recording:
    count = len(recording)
    # Every second frame will do, and takes half the time.
    return replace(recording, entries=recording.entries[int(first * count) : int(last * count) : 2])


@pytest.fixture(scope="module")
def halves(office_recording: Path) -> tuple[Recording, Recording]:
    """The walk from the hall to the wash room in two parts, of which both hold the middle."""
    whole = open_recording(office_recording)
    return part(whole, 0.0, 0.6), part(whole, 0.4, 1.0)


@pytest.fixture(scope="module")
def first_site(halves: tuple[Recording, Recording]) -> Site:
    return build_site(halves[0], "Office floor", SETTINGS, silent)[0]


@pytest.fixture(scope="module")
def grown(first_site: Site, halves: tuple[Recording, Recording]) -> Growth:
    session = recording_session(halves[1], "Second half", "2026-11-22")
    return extend_site(first_site, halves[1], session, SETTINGS, silent)


def truth_at(folder: Path, stamps_s: FloatArray) -> FloatArray:
    """True camera positions (n, 3)."""
    true_s, poses = read_trajectory(folder / "groundtruth.txt")
    nearest = [int(np.argmin(np.abs(true_s - stamp))) for stamp in stamps_s]
    return np.array([poses[i].translation for i in nearest])


def test_both_recordings_are_one_map_in_the_first_ones_frame(
    first_site: Site, grown: Growth, office_recording: Path
) -> None:
    known, slam_map = slam_map_of(first_site), slam_map_of(grown.site)
    assert [session.name for session in grown.site.sessions] == ["recording", "Second half"]
    assert set(session_groups(slam_map).values()) == {0}
    places, session = slam_map.trajectory[:, :3, 3], slam_map.trajectory_session
    true_places = np.concatenate(
        [truth_at(office_recording, slam_map.trajectory_stamp_s[session == number]) for number in (0, 1)]
    )
    world_from_map = rigid_fit(places[session == 0], true_places[session == 0])
    off_m = np.linalg.norm(places @ world_from_map[:3, :3].T + world_from_map[:3, 3] - true_places, axis=1)
    assert off_m[session == 0].max() < 0.1
    assert off_m[session == 1].max() < 0.2
    moved = Deformation(known.camera_from_world, slam_map.camera_from_world[: known.keyframe_count])
    assert moved.largest_step_m < 0.1
    np.testing.assert_allclose(frame_kept(moved), np.eye(4), atol=1e-6)


def test_a_frame_of_both_recordings_has_one_place(grown: Growth) -> None:
    slam_map = slam_map_of(grown.site)
    at = [
        dict(zip(slam_map.trajectory_stamp_s[own].tolist(), slam_map.trajectory[own], strict=True))
        for own in (slam_map.trajectory_session == 0, slam_map.trajectory_session == 1)
    ]
    common = sorted(set(at[0]) & set(at[1]))
    assert len(common) > 10
    apart_m = [float(np.linalg.norm(at[0][stamp][:3, 3] - at[1][stamp][:3, 3])) for stamp in common]
    assert max(apart_m) < 0.06


def test_a_stretch_walked_in_both_is_one_road(grown: Growth, office_recording: Path) -> None:
    slam_map = slam_map_of(grown.site)
    assert set(grown.site.road_sessions) == {0, 1}
    network = RoadNetwork.from_roads(grown.site.roads_m)
    assert network.component_count() == 1
    walked = truth_at(office_recording, np.unique(slam_map.trajectory_stamp_s))
    alone = RoadNetwork.from_roads([walked])
    assert network.length_m == pytest.approx(alone.length_m, rel=0.06)


def gap_m(first: np.ndarray, second: np.ndarray) -> float:
    """How far what the second recording saw lies from what the first one saw, where both saw something."""
    distance_m, _ = cKDTree(first).query(second)
    return float(np.median(distance_m[distance_m < 0.25]))


def test_walls_are_not_doubled_where_both_saw_them(grown: Growth) -> None:
    site = grown.site
    points, seen_by = site.cloud_points_m, site.cloud_sessions
    assert np.count_nonzero(seen_by == 3) > 0.05 * len(points)
    first, only_second = points[seen_by != 2], points[seen_by == 2]
    assert gap_m(first, only_second) < 0.06
    # A wall that stands twice is seen by this measure.
    assert gap_m(first, points[seen_by != 1] + np.array([0.1, 0.1, 0.0])) > 0.06


def test_places_stay_and_those_of_the_new_recording_join_them(first_site: Site, grown: Growth) -> None:
    before, after = first_site.poi_graph, grown.site.poi_graph
    assert before.pois
    validate(after)
    network = RoadNetwork.from_roads(grown.site.roads_m)
    for key, poi in before.pois.items():
        assert (after.pois[key].name, after.pois[key].kind, after.pois[key].on_road) == (poi.name, poi.kind, True)
        assert np.hypot(after.pois[key].x_m - poi.x_m, after.pois[key].y_m - poi.y_m) < 0.25
    for poi in after.pois.values():
        assert network.nearest(poi.x_m, poi.y_m).distance_m < 0.01
    assert after.version > before.version
    assert grown.off_road == ()


def located(slam_map: SlamMap, recording: Recording, first: int) -> np.ndarray | None:
    """Where a few frames in a row lead: the last one's position, None unless it is sure."""
    localizer = Localizer(slam_map, recording.intrinsics, SETTINGS)
    found = [localizer.locate(recording.read(entry)) for entry in recording.entries[first : first + 8]]
    last = found[-1]
    if last.quality is not LocalizationQuality.LOCALIZED or last.world_from_camera is None:
        return None
    return np.asarray(last.world_from_camera.translation)


def test_both_parts_are_recognised_in_the_joined_map(grown: Growth, halves: tuple[Recording, Recording]) -> None:
    slam_map = slam_map_of(grown.site)
    for session, (recording, first) in enumerate(zip(halves, (10, len(halves[1]) - 30), strict=True)):
        place = located(slam_map, recording, first)
        own = slam_map.trajectory_session == session
        frame = int(np.argmin(np.abs(slam_map.trajectory_stamp_s[own] - recording.entries[first + 7].stamp_s)))
        assert place is not None
        np.testing.assert_allclose(place, slam_map.trajectory[own][frame, :3, 3], atol=0.06)


def test_the_same_recording_is_taken_in_once(grown: Growth, halves: tuple[Recording, Recording]) -> None:
    session = recording_session(halves[1], "Again", "")
    with pytest.raises(InputError, match="already part of the site"):
        extend_site(grown.site, halves[1], session, SETTINGS, silent)


def test_the_same_recordings_give_the_same_bytes(
    grown: Growth, first_site: Site, halves: tuple[Recording, Recording], tmp_path: Path
) -> None:
    session = recording_session(halves[1], "Second half", "2026-11-22")
    again = extend_site(first_site, halves[1], session, SETTINGS, silent)
    save_site(grown.site, tmp_path / "one")
    save_site(again.site, tmp_path / "two")
    assert map_checksum(tmp_path / "one") == map_checksum(tmp_path / "two")
    assert load_site(tmp_path / "one").sessions == grown.site.sessions


# ---------------------------------------------------------------------------------------------------- removing
def test_a_removed_recording_takes_along_what_it_alone_saw(
    grown: Growth, halves: tuple[Recording, Recording], tmp_path: Path
) -> None:
    left = remove_session(grown.site, grown.site.sessions[0].id)
    whole, rest = slam_map_of(grown.site), slam_map_of(left.site)
    own = whole.keyframe_session == 1
    np.testing.assert_array_equal(rest.camera_from_world, whole.camera_from_world[own])
    assert not rest.keyframe_session.any()
    seen = np.unique(whole.landmark_of[own])
    assert len(rest.positions) == np.count_nonzero(seen >= 0)
    assert [session.name for session in left.site.sessions] == ["Second half"]
    assert set(left.site.cloud_sessions.tolist()) == {1}
    assert 0 < len(left.site.cloud_points_m) < len(grown.site.cloud_points_m)
    assert RoadNetwork.from_roads(left.site.roads_m).length_m < RoadNetwork.from_roads(grown.site.roads_m).length_m
    validate(left.site.poi_graph)
    assert left.site.poi_graph.pois.keys() == grown.site.poi_graph.pois.keys()
    assert located(rest, halves[1], len(halves[1]) - 30) is not None
    save_site(left.site, tmp_path / "site")
    SlamMap.from_arrays(load_site(tmp_path / "site").map_arrays)


def test_the_only_recording_and_one_that_is_not_there_are_not_removed(first_site: Site) -> None:
    with pytest.raises(InputError, match="only recording"):
        remove_session(first_site, first_site.sessions[0].id)
    with pytest.raises(InputError, match="no session"):
        remove_session(first_site, "elsewhere")


# ------------------------------------------------------------------------------------- on painted walls, quickly
def wall_frames(picture: np.ndarray, step_px: int = 8) -> Iterator[Frame]:
    """Frames of a camera that slides along a picture (240, w, 3)."""
    depth_m = np.full((REHEARSAL_CAMERA.height_px, REHEARSAL_CAMERA.width_px), WALL_M, np.float32)
    last_px = picture.shape[1] - REHEARSAL_CAMERA.width_px
    for number, left in enumerate(range(0, last_px + 1, step_px)):
        yield Frame(0.1 * number, np.ascontiguousarray(picture[:, left : left + REHEARSAL_CAMERA.width_px]), depth_m)


def painted(width_px: int, seed: int) -> np.ndarray:
    coarse = np.random.default_rng(seed).integers(0, 256, (41, width_px // 6 + 1, 3)).astype(np.uint8)
    wall = cv2.resize(coarse, (width_px, REHEARSAL_CAMERA.height_px), interpolation=cv2.INTER_NEAREST)
    return np.asarray(cv2.GaussianBlur(wall, (3, 3), 0.8), dtype=np.uint8)


def wall_map(picture: np.ndarray) -> SlamMap:
    mapper = Mapper(REHEARSAL_CAMERA, SlamCamera.of(REHEARSAL_CAMERA, 100.0), 600)
    for frame in wall_frames(picture):
        mapper.add(frame)
    return mapper.finish()


@pytest.fixture(scope="module")
def long_wall() -> SlamMap:
    """So long that its first and its last third show nothing in common."""
    return rehearse(126)[0].finish()


def test_a_thawed_map_freezes_to_the_same_bytes(long_wall: SlamMap) -> None:
    stamped = list(zip(long_wall.trajectory_stamp_s, long_wall.trajectory, strict=True))
    again = freeze(thaw(long_wall), long_wall.places, stamped, long_wall.trajectory_session).to_arrays()
    for name, array in long_wall.to_arrays().items():
        assert again[name].tobytes() == array.tobytes(), name


def test_maps_in_different_frames_come_together() -> None:
    picture = painted(320 + 8 * 60, 5)
    known, new = wall_map(picture[:, : 320 + 8 * 40]), wall_map(picture[:, 8 * 20 :])
    elsewhere = exp_se3(np.array([3.0, -2.0, 0.1, 0.0, 0.0, 2.5]))
    joined = join(known, new.transformed(elsewhere), 1)
    step_m = 8 * WALL_M / REHEARSAL_CAMERA.fx_px
    own = joined.slam_map.trajectory_session == 1
    true_x = step_m * (20 + np.arange(np.count_nonzero(own)))
    found = joined.slam_map.trajectory[own][:, :3, 3]
    np.testing.assert_allclose(found, np.column_stack([true_x, 0 * true_x, 0 * true_x]), atol=0.05)
    assert joined.matches >= 3


def test_nothing_in_common_is_no_join() -> None:
    with pytest.raises(MappingError, match="begins at, or passes through"):
        join(wall_map(painted(480, 1)), wall_map(painted(480, 2)), 1)


def test_a_place_that_is_there_twice_is_not_guessed() -> None:
    same, between = painted(800, 3), painted(480, 4)
    with pytest.raises(MappingError, match="two places that look alike"):
        join(wall_map(np.concatenate([same, between, same], axis=1)), wall_map(same), 1)


def test_another_kind_of_camera_is_refused(long_wall: SlamMap) -> None:
    other = replace(long_wall, camera=replace(long_wall.camera, fx_px=2 * long_wall.camera.fx_px))
    with pytest.raises(MappingError, match="focal length"):
        join(long_wall, other, 1)


def in_three(slam_map: SlamMap) -> SlamMap:
    """The same map as if three recordings had made it, one after the other."""

    def thirds(count: int) -> np.ndarray:
        return (3 * np.arange(count) // count).astype(np.int32)

    return replace(
        slam_map,
        keyframe_session=thirds(slam_map.keyframe_count),
        trajectory_session=thirds(len(slam_map.trajectory)),
    )


def test_what_a_recording_alone_holds_together_is_told(long_wall: SlamMap) -> None:
    slam_map = in_three(long_wall)
    assert set(session_groups(slam_map).values()) == {0}
    assert separated_by_removal(slam_map, 1) == (2,)
    assert separated_by_removal(slam_map, 2) == ()


def test_those_that_stay_move_up(long_wall: SlamMap) -> None:
    slam_map = in_three(long_wall)
    rest = renumbered(without_key_frames(slam_map, 0), 0)
    assert sorted(set(rest.keyframe_session.tolist())) == [0, 1]
    assert sorted(set(rest.trajectory_session.tolist())) == [0, 1]
    assert rest.keyframe_count == np.count_nonzero(slam_map.keyframe_session > 0)
    SlamMap.from_arrays(rest.to_arrays())


def test_the_spanning_tree_reaches_every_key_frame_from_the_first(long_wall: SlamMap) -> None:
    parent = spanning_parents(long_wall)
    assert parent[0] == -1
    for keyframe in range(1, len(parent)):
        steps = 0
        while keyframe:
            keyframe, steps = int(parent[keyframe]), steps + 1
            assert keyframe >= 0
            assert steps <= len(parent)


# ---------------------------------------------------------------------------------------------------- levelling
def test_a_walk_that_begins_askew_is_levelled_along_the_walls(
    halves: tuple[Recording, Recording], grown: Growth, office_recording: Path
) -> None:
    """The office's walls follow the axes of its world; the second half begins in the middle of the walk."""
    level_map: LevelMap = build_level_map(part_between_turns(halves[1]), SETTINGS.feature_count, silent)
    true_s, poses = read_trajectory(office_recording / "groundtruth.txt")
    for slam_map in (level_map.slam_map, slam_map_of(grown.site)):
        own = slam_map.trajectory_session == 0
        stamps = slam_map.trajectory_stamp_s[own]
        truth = np.array([poses[int(np.argmin(np.abs(true_s - stamp)))].matrix for stamp in stamps])
        world_from_map = rigid_fit(slam_map.trajectory[own][:, :3, 3], truth[:, :3, 3])
        yaw_deg = np.degrees(np.arctan2(world_from_map[1, 0], world_from_map[0, 0]))
        assert abs((yaw_deg + 45.0) % 90.0 - 45.0) < 1.0
        assert np.degrees(np.arccos(world_from_map[2, 2])) < 0.7
        floor_m = (np.linalg.inv(world_from_map) @ [*truth[0, :2, 3], 0.0, 1.0])[2]
        assert abs(floor_m) < 0.05


def part_between_turns(recording: Recording) -> Recording:
    """The recording from where the walker has turned half way into the next corridor."""
    _, poses = read_trajectory(recording.folder / "groundtruth.txt")
    true_s, _ = read_trajectory(recording.folder / "groundtruth.txt")
    stamps = [entry.stamp_s for entry in recording.entries]
    heading = [
        np.degrees(np.arctan2(*poses[int(np.argmin(np.abs(true_s - stamp)))].matrix[1::-1, 2])) % 90.0
        for stamp in stamps
    ]
    askew = [i for i, angle in enumerate(heading[: len(heading) // 2]) if 15.0 < angle < 75.0]
    assert askew
    return replace(recording, entries=recording.entries[askew[len(askew) // 2] :])

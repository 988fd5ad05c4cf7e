"""What a finished map becomes for people: level, with a road and a coloured cloud."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from navcore.geometry import Transform, rotation_about_z, world_from_camera_at
from navcore.recording import open_recording, read_trajectory
from navcore.slam import dense_cloud, leveling, road
from navcore.slam.leveling import FloorEvidence
from navcore.types import CameraIntrinsics

CAMERA = CameraIntrinsics(160, 120, 120.0, 120.0, 80.0, 60.0)
ROOM = np.array([[0.0, 6.0], [0.0, 4.0], [0.0, 2.6]])
"""Inside of a room: x, y, z from and to."""
DESK = np.array([[3.5, 5.5], [0.5, 3.5], [0.0, 0.75]])


def depth_of(world_from_camera: np.ndarray, boxes: list[np.ndarray], seed: int = 0) -> np.ndarray:
    """Depth image of a room with things in it, by intersecting each pixel's ray with axis-aligned boxes."""
    v, u = np.mgrid[0 : CAMERA.height_px, 0 : CAMERA.width_px]
    rays = np.stack([(u - CAMERA.cx_px) / CAMERA.fx_px, (v - CAMERA.cy_px) / CAMERA.fy_px, np.ones(u.shape)], axis=-1)
    directions = rays @ world_from_camera[:3, :3].T
    directions[np.abs(directions) < 1e-9] = 1e-9
    origin = world_from_camera[:3, 3]
    depth = np.full(u.shape, np.inf)
    for number, box in enumerate(boxes):
        first, second = (box[:, 0] - origin) / directions, (box[:, 1] - origin) / directions
        enter, leave = np.minimum(first, second).max(axis=-1), np.maximum(first, second).min(axis=-1)
        hit = leave if number == 0 else np.where((enter < leave) & (enter > 0), enter, np.inf)
        depth = np.minimum(depth, hit)
    noise = np.random.default_rng(seed).normal(0, 0.002, depth.shape) * depth**2
    return (depth + noise).astype(np.float32)


def looking_around(pitch_rad: float = 0.35) -> list[np.ndarray]:
    headings = np.arange(0.3, 2 * np.pi, 0.5)
    return [world_from_camera_at((2.5, 2.0, 1.6), h, pitch_rad, 0.05 * np.sin(h)).matrix for h in headings]


def tilted_map() -> np.ndarray:
    """``map_from_world``: a SLAM map begins anywhere, and leans."""
    rotation = world_from_camera_at((0.0, 0.0, 0.0), 0.7, 0.2, -0.1).rotation @ rotation_about_z(0.4)
    return Transform.from_rotation_translation(rotation, np.array([1.0, -2.0, 0.5])).matrix


def level_room(boxes: list[np.ndarray], poses: list[np.ndarray]) -> tuple[leveling.Leveling, np.ndarray]:
    map_from_world = tilted_map()
    views = [(depth_of(pose, boxes, k), map_from_world @ pose) for k, pose in enumerate(poses)]
    result = leveling.level(views, CAMERA.fx_px, CAMERA.fy_px, CAMERA.cx_px, CAMERA.cy_px)
    return result, result.level_from_map.matrix @ map_from_world


def test_floor_gravity_and_walls_of_a_room_with_desks() -> None:
    result, level_from_world = level_room([ROOM, DESK], looking_around())
    assert result.evidence is FloorEvidence.FLOOR
    assert result.is_along_walls
    assert np.degrees(np.arccos(level_from_world[2, 2])) < 0.5
    assert abs(level_from_world[2, 3]) < 0.02
    yaw_deg = np.degrees(np.arctan2(level_from_world[1, 0], level_from_world[0, 0]))
    assert abs((yaw_deg + 45) % 90 - 45) < 1.0
    assert result.camera_height_m == pytest.approx(1.6, abs=0.03)
    assert "floor" in result.note


def test_first_camera_stands_over_the_origin_and_looks_towards_x() -> None:
    poses = looking_around()
    _, level_from_world = level_room([ROOM, DESK], poses)
    first = level_from_world @ poses[0]
    assert np.allclose(first[:2, 3], 0.0, atol=1e-9)
    assert first[0, 2] > abs(first[1, 2])


def test_a_desk_is_not_taken_for_the_floor_when_no_floor_is_seen() -> None:
    wide_desk = np.array([[0.0, 6.0], [0.0, 4.0], [0.0, 0.75]])
    result, level_from_world = level_room([ROOM, wide_desk], looking_around(0.6))
    assert result.evidence is FloorEvidence.HORIZONTAL_SURFACES
    assert np.degrees(np.arccos(level_from_world[2, 2])) < 0.7
    assert result.camera_height_m == pytest.approx(leveling.ASSUMED_HEIGHT_M)
    assert "assumed" in result.note


def test_without_any_surface_up_is_how_the_camera_was_held() -> None:
    empty = np.full((120, 160), np.nan, np.float32)
    poses = [world_from_camera_at((0.0, 0.0, 1.5), h).matrix for h in (0.0, 1.0, 2.0)]
    result = leveling.level([(empty, pose) for pose in poses], 120.0, 120.0, 80.0, 60.0)
    assert result.evidence is FloorEvidence.CAMERA_UP
    assert not result.is_along_walls
    assert np.allclose(result.level_from_map.rotation, np.eye(3), atol=1e-6)
    with pytest.raises(ValueError, match="view"):
        leveling.level([], 120.0, 120.0, 80.0, 60.0)


@pytest.mark.real_data
def test_a_real_floor_is_level(fr3_cabinet: Path) -> None:
    recording = open_recording(fr3_cabinet)
    stamps, truth = read_trajectory(fr3_cabinet / "groundtruth.txt")
    camera = recording.intrinsics
    start = truth[0].inverse().matrix
    views = []
    for entry in recording.entries[::3]:
        pose = truth[int(np.argmin(np.abs(stamps - entry.stamp_s)))].matrix
        views.append((recording.read(entry).depth_m, start @ pose))
    result = leveling.level(views, camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px)
    level_from_world = result.level_from_map.matrix @ start
    assert result.evidence is FloorEvidence.FLOOR
    assert np.degrees(np.arccos(level_from_world[2, 2])) < 1.0
    assert abs(level_from_world[2, 3]) < 0.04


# ------------------------------------------------------------------------------------------------------ road
def gait(points: np.ndarray, speed_m_s: float = 0.9, sway_m: float = 0.03) -> tuple[np.ndarray, np.ndarray]:
    """Stamps and positions (n, 3) of a head that walks along a polyline (m, 2) and sways with the steps."""
    dense = road.resample(points, 0.03)
    s = road.arc_length(dense)
    direction = np.gradient(dense, axis=0)
    direction /= np.maximum(np.linalg.norm(direction, axis=1, keepdims=True), 1e-9)
    left = np.column_stack([-direction[:, 1], direction[:, 0]])
    swaying = dense + sway_m * np.sin(2 * np.pi * s / 1.4)[:, None] * left
    return s / speed_m_s, np.column_stack([swaying, 1.6 + 0.02 * np.sin(4 * np.pi * s / 1.4)])


def test_the_sway_of_the_gait_is_taken_out() -> None:
    stamps, positions = gait(np.array([[0.0, 0.0], [12.0, 0.0]]))
    (walked,) = road.build_roads(stamps, positions)
    assert np.abs(positions[:, 1]).max() > 0.025
    assert np.abs(walked[5:-5, 1]).max() < 0.015
    assert road.arc_length(walked)[-1] == pytest.approx(12.0, abs=0.05)


def test_points_are_evenly_spaced_on_the_floor() -> None:
    stamps, positions = gait(np.array([[0.0, 0.0], [6.0, 0.0], [6.0, 4.0]]))
    (walked,) = road.build_roads(stamps, positions)
    steps = np.linalg.norm(np.diff(walked, axis=0), axis=1)
    assert np.all(walked[:, 2] == 0.0)
    assert np.allclose(steps, 0.1, atol=0.01)
    assert walked.dtype == np.float64


def test_a_corner_is_cut_by_less_than_a_foot() -> None:
    stamps, positions = gait(np.array([[0.0, 0.0], [6.0, 0.0], [6.0, 4.0]]))
    (walked,) = road.build_roads(stamps, positions)
    assert np.linalg.norm(walked[:, :2] - [6.0, 0.0], axis=1).min() < 0.2


def test_standing_and_turning_on_the_spot_leave_no_knot() -> None:
    stamps, positions = gait(np.array([[0.0, 0.0], [8.0, 0.0]]))
    half = len(stamps) // 2
    t = np.arange(0, 20, 1 / 15)
    # The head goes round in a circle of 6 cm while the walker looks about.
    looking = positions[half] + np.column_stack([0.06 * np.cos(t), 0.06 * np.sin(t), 0 * t])
    paused = np.concatenate([positions[:half], looking, positions[half:]])
    times = np.concatenate([stamps[:half], stamps[half] + t, stamps[half:] + t[-1] + 1 / 15])
    (walked,) = road.build_roads(times, paused)
    assert road.arc_length(walked)[-1] == pytest.approx(8.0, abs=0.1)
    assert np.all(np.diff(walked[:, 0]) > 0.0)


def test_the_end_of_a_dead_end_stays_where_the_walker_turned_back() -> None:
    stamps, positions = gait(np.array([[0.0, 0.0], [5.0, 0.0], [0.0, 0.0]]))
    (walked,) = road.build_roads(stamps, positions)
    assert walked[:, 0].max() > 4.75


def test_a_lost_stretch_splits_the_road() -> None:
    stamps, positions = gait(np.array([[0.0, 0.0], [10.0, 0.0]]))
    kept = (positions[:, 0] < 4.0) | (positions[:, 0] > 6.0)
    roads = road.build_roads(stamps[kept], positions[kept])
    assert len(roads) == 2
    assert roads[0][-1, 0] < 4.1
    assert roads[1][0, 0] > 5.9


def test_nothing_walked_is_no_road() -> None:
    stamps = np.arange(50) / 15
    positions = np.random.default_rng(0).normal(0, 0.02, (50, 3))
    assert road.build_roads(stamps, positions) == ()
    assert road.build_roads(np.zeros(0), np.zeros((0, 3))) == ()


# ----------------------------------------------------------------------------------------------------- cloud
RED, BLUE = np.array([200, 30, 30], np.uint8), np.array([30, 30, 200], np.uint8)


def room_views(poses: list[np.ndarray]) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    views = []
    for k, pose in enumerate(poses):
        depth = depth_of(pose, [ROOM], k)
        v, u = np.mgrid[0:120, 0:160]
        rays = np.stack([(u - 80) / 120, (v - 60) / 120, np.ones(u.shape)], axis=-1) * depth[:, :, None]
        x = (rays @ pose[:3, :3].T + pose[:3, 3])[:, :, 0]
        views.append((np.where(x[:, :, None] < 3.0, RED, BLUE), depth, pose))
    return views


def test_the_cloud_lies_on_the_walls_and_has_their_colours() -> None:
    cloud = dense_cloud.fuse(room_views(looking_around(0.1)), CAMERA)
    p = cloud.points_m
    assert p.dtype == np.float32
    assert cloud.colours_rgb.dtype == np.uint8
    off_wall = np.min(np.abs(np.concatenate([p - ROOM[:, 0], p - ROOM[:, 1]], axis=1)), axis=1)
    assert np.percentile(off_wall, 95) < 0.03
    left, right = p[:, 0] < 2.9, p[:, 0] > 3.1
    assert np.all(np.abs(cloud.colours_rgb[left].astype(int) - RED) <= 1)
    assert np.all(np.abs(cloud.colours_rgb[right].astype(int) - BLUE) <= 1)


def test_the_ceiling_is_flagged_and_can_be_left_out() -> None:
    cloud = dense_cloud.fuse(room_views(looking_around(-0.2)), CAMERA)
    assert np.array_equal(cloud.is_ceiling, cloud.points_m[:, 2] > dense_cloud.CEILING_M)
    assert cloud.is_ceiling.any()
    assert cloud.below_ceiling().points_m[:, 2].max() <= dense_cloud.CEILING_M


def test_somebody_seen_once_from_afar_is_left_out() -> None:
    views = room_views(looking_around(0.1))
    colour, depth, pose = views[0]
    passing = depth.copy()
    passing[30:90, 70:90] = np.minimum(passing[30:90, 70:90], 2.0)
    with_person = dense_cloud.fuse([(colour, passing, pose), *views[1:]], CAMERA)
    eye = pose[:3, 3]
    along = (with_person.points_m - eye) @ pose[:3, 2]
    aside = np.linalg.norm(with_person.points_m - eye - along[:, None] * pose[:3, 2], axis=1)
    assert not np.any((np.abs(along - 2.0) < 0.05) & (aside < 0.15))


def test_somebody_who_stood_there_for_a_while_is_seen_through_later() -> None:
    """Two key frames see the same person; from all the others the wall behind shows."""
    poses = [looking_around(0.1)[0]] * 8
    views = room_views(poses)
    for k in (2, 3):
        views[k][1][20:90, 60:100] = 1.8
    cloud = dense_cloud.fuse(views, CAMERA)
    eye, forward = poses[0][:3, 3], poses[0][:3, 2]
    along = (cloud.points_m - eye) @ forward
    aside = np.linalg.norm(cloud.points_m - eye - along[:, None] * forward, axis=1)
    assert not np.any((np.abs(along - 1.8) < 0.05) & (aside < 0.2))
    assert len(cloud) > 0.9 * len(dense_cloud.fuse(room_views(poses), CAMERA))


def test_the_number_of_points_is_bounded_and_the_cloud_repeatable() -> None:
    views = room_views(looking_around(0.1))
    whole = dense_cloud.fuse(views, CAMERA)
    small = dense_cloud.fuse(views, CAMERA, max_points=2000)
    assert len(whole) > 2000 >= len(small) > 500
    again = dense_cloud.fuse(views, CAMERA)
    assert np.array_equal(whole.points_m, again.points_m)
    assert np.array_equal(whole.colours_rgb, again.colours_rgb)


def test_many_views_outgrow_the_first_table() -> None:
    """A building's worth of voxels does not fit where the first view was put."""
    fusion = dense_cloud.VoxelFusion(CAMERA, 0.01)
    colour, depth, pose = room_views(looking_around()[:1])[0]
    for k in range(12):
        moved = pose.copy()
        moved[0, 3] += 20.0 * k
        fusion.add(colour, depth, moved)
        fusion.add(colour, depth, moved)
    cloud = fusion.cloud()
    for k in range(12):
        assert np.count_nonzero(np.abs(cloud.points_m[:, 0] - 3.0 - 20.0 * k) < 4.0) > 3000

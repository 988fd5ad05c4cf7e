"""Blank walls: a map is begun, followed and used by depth alone, and what depth leaves open is said to be open."""

from __future__ import annotations

import numpy as np
import pytest
from slam_blank_room import CAMERA, FLOOR, Plane, camera_at, corridor_planes, depth_of, room_planes

from navcore.slam.depth_localization import SURE_CONTRADICTED, DepthAid, DepthPlace
from navcore.slam.depth_tracking import DepthView
from navcore.slam.keyframes import Features
from navcore.slam.localizer_state import LocalizerState
from navcore.slam.map import MapBuilder
from navcore.slam.mapper import Mapper
from navcore.slam.mapping import adjust
from navcore.slam.slam_map import SlamMap
from navcore.slam.thawing import thaw
from navcore.slam.tracking import Track
from navcore.types import CameraIntrinsics, Frame

INTRINSICS = CameraIntrinsics(320, 240, CAMERA.fx_px, CAMERA.fy_px, CAMERA.cx_px, CAMERA.cy_px)
END = Plane((1.0, 0.0, 0.0), 4.0)
"""A wall across the corridor."""
STEP_S = 0.1
TURN_RAD = 1.0


def walk(planes: list[Plane], places: list[tuple[tuple[float, float, float], float]]) -> list[tuple[Frame, np.ndarray]]:
    """Grey frames with a little noise, and where they were taken (camera_from_world)."""
    rng = np.random.default_rng(0)
    frames = []
    for number, (place, heading_rad) in enumerate(places):
        pose = camera_at(place, heading_rad)
        grey = 128 + rng.integers(-1, 2, (CAMERA.height_px, CAMERA.width_px, 1))
        colour = np.repeat(grey, 3, axis=2).astype(np.uint8)
        frames.append((Frame(STEP_S * number, colour, depth_of(planes, pose, 0.002, rng)), pose))
    return frames


@pytest.fixture(scope="module")
def room_walk() -> list[tuple[Frame, np.ndarray]]:
    """An arc through a bare room, turning by 0.6 rad, one of its corners in view."""
    share = np.linspace(0.0, 1.0, 36)
    return walk(
        room_planes(),
        [((-0.8 + 1.2 * s, 0.4 * np.sin(2 * s), 1.0), float(TURN_RAD - 0.6 * s)) for s in share],
    )


@pytest.fixture(scope="module")
def room_map(room_walk: list[tuple[Frame, np.ndarray]]) -> tuple[Mapper, SlamMap]:
    mapper = Mapper(INTRINSICS, CAMERA, 300)
    for frame, _ in room_walk:
        assert mapper.add(frame)
    return mapper, mapper.finish()


def position(camera_from_world: np.ndarray) -> np.ndarray:
    return -camera_from_world[:3, :3].T @ camera_from_world[:3, 3]


def errors_m(trajectory: np.ndarray, walked: list[tuple[Frame, np.ndarray]]) -> np.ndarray:
    """Distances (n,) of world_from_camera poses (n, 4, 4), whose world is the first camera, from the truth."""
    first = walked[0][1]
    return np.array(
        [
            np.linalg.norm((first @ np.append(position(truth), 1.0))[:3] - pose[:3, 3])
            for pose, (_, truth) in zip(trajectory, walked, strict=True)
        ]
    )


def test_a_bare_room_is_mapped_by_depth_alone(
    room_map: tuple[Mapper, SlamMap], room_walk: list[tuple[Frame, np.ndarray]]
) -> None:
    mapper, slam_map = room_map
    assert len(slam_map.positions) < 25
    assert errors_m(slam_map.trajectory, room_walk).max() < 0.03
    assert 2 <= slam_map.keyframe_count <= 12
    assert slam_map.keyframe_depth.any(axis=(1, 2)).all()
    assert mapper.keyframe_count == slam_map.keyframe_count


def test_a_map_of_surfaces_is_stored_and_continued(room_map: tuple[Mapper, SlamMap]) -> None:
    _, slam_map = room_map
    again = SlamMap.from_arrays(slam_map.to_arrays())
    assert np.array_equal(again.keyframe_depth, slam_map.keyframe_depth)
    builder = thaw(again)
    assert sorted(builder.depth_grids) == list(range(slam_map.keyframe_count))
    old = {name: array for name, array in slam_map.to_arrays().items() if name != "keyframe_depth"}
    assert not SlamMap.from_arrays(old).keyframe_depth.any()


def test_one_blank_wall_begins_no_map() -> None:
    mapper = Mapper(INTRINSICS, CAMERA, 300)
    for frame, _ in walk([Plane((1.0, 0.0, 0.0), 2.0)], [((0.0, 0.02 * n, 1.0), 0.0) for n in range(3)]):
        assert not mapper.add(frame)
    assert mapper.keyframe_count == 0


def test_an_endless_corridor_is_not_followed_for_long() -> None:
    """What nothing fixes is filled by the motion model for a moment only; then the frame counts as lost."""
    backwards = [((-0.15 * n, 0.0, 1.0), 0.0) for n in range(58)]
    mapper = Mapper(INTRINSICS, CAMERA, 300)
    followed = [mapper.add(frame) for frame, _ in walk([*corridor_planes(), END], backwards)]
    # The wall across fades into the noise, and goes out of reach after 27 frames.
    assert all(followed[:6])
    assert not any(followed[52:])


def test_adjustment_leaves_alone_what_depth_has_placed() -> None:
    builder = MapBuilder(CAMERA, 50)
    rng = np.random.default_rng(1)
    seen = rng.uniform(20, 200, (8, 2))
    depth = rng.uniform(1.5, 3.0, 8)
    uvr = np.column_stack([seen, seen[:, 0] - CAMERA.bf_px_m / depth])
    features = Features(
        uvr,
        depth,
        np.zeros(8, np.int32),
        np.zeros(8),
        rng.integers(0, 256, (8, 32)).astype(np.uint8),
        np.zeros(2, np.int32),
        1,
    )
    nothing = np.full(8, -1, np.int32)
    first = builder.add_keyframe(0.0, features, np.eye(4), nothing)
    landmarks = builder.add_landmarks(first, np.arange(8, dtype=np.int32), features.points_in_camera(CAMERA))
    moved = np.eye(4)
    moved[0, 3] = 0.01
    second = builder.add_keyframe(1.0, features, moved, landmarks)
    builder.depth_carried.add(second)
    adjust(builder, np.array([first, second], np.int32), 5)
    assert np.array_equal(builder.camera_from_world[second], moved)


def test_room_of_planes_is_what_it_says() -> None:
    depth_m = depth_of([FLOOR], camera_at((0.0, 0.0, 1.0), 0.0), 0.0, np.random.default_rng(0))
    assert np.isnan(depth_m[:120]).all()
    lowest = 1.0 / ((239 - CAMERA.cy_px) / CAMERA.fy_px)
    assert np.isclose(depth_m[239, 160], lowest, rtol=1e-4)


def test_surfaces_that_are_partly_elsewhere_make_nobody_surer(
    room_map: tuple[Mapper, SlamMap], room_walk: list[tuple[Frame, np.ndarray]]
) -> None:
    """Somebody who walks along, or furniture that was moved, looks like a wall of the room that is nearer."""
    _, slam_map = room_map
    frame, pose = room_walk[20]
    assert frame.depth_m is not None
    someone = frame.depth_m.copy()
    someone[80:, 110:180] = np.where(np.isnan(someone[80:, 110:180]), np.nan, 0.75 * someone[80:, 110:180])
    in_map = pose @ np.linalg.inv(room_walk[0][1])
    expected = np.diag([0.04**2] * 3 + [0.02**2] * 3)
    as_it_was = _placed(slam_map, frame.depth_m, in_map, expected)
    changed = _placed(slam_map, someone, in_map, expected)
    carried = DepthAid(slam_map).carried(DepthView(CAMERA, someone), in_map, STEP_S)
    assert carried is not None
    assert carried.alignment.contradicted > SURE_CONTRADICTED
    assert as_it_was.is_sure
    assert np.linalg.eigvalsh(as_it_was.covariance - as_it_was.shared_covariance)[-1] < 0.04**2
    assert not changed.is_sure
    assert np.linalg.eigvalsh(changed.covariance - changed.shared_covariance - expected)[0] > -1e-12


def _placed(slam_map: SlamMap, depth_m: np.ndarray, camera_from_world: np.ndarray, expected: np.ndarray) -> DepthPlace:
    """Where surfaces place a frame that odometry followed from the same place, with an uncertainty (6, 6)."""
    nothing = Features(
        np.zeros((0, 3)), np.zeros(0), np.zeros(0, np.int32), np.zeros(0), np.zeros((0, 32), np.uint8),
        np.zeros(2, np.int32), 1,
    )  # fmt: skip
    before = Track(0.0, nothing, camera_from_world, np.zeros(0, np.int32), np.zeros((6, 6)))
    state = LocalizerState(before, None, expected, np.zeros((6, 6)), 0.0, 3, 1.0)
    placed = DepthAid(slam_map).place(DepthView(CAMERA, depth_m), state, before, before, is_pace_known=True)
    assert placed is not None
    return placed

"""Loop closing: true loops take the drift out, look-alikes are left alone."""

from __future__ import annotations

import numpy as np
import pytest
from slam_corridor import CAMERA, Odometry, World, centres, corridor, drifted, look, poses_along

from navcore.slam.loop_closing import LoopCloser, difference
from navcore.slam.loop_correction import essential_edges
from navcore.slam.loop_verification import verify

RING = np.array([[0.0, 0.0], [14.0, 0.0], [14.0, 9.0], [0.0, 9.0], [0.0, 0.0], [5.0, 0.0]])


def walk(world: World, path: np.ndarray, seed: int, yaw_rad: float = 0.004, scale: float = 1.005):
    """Walk a path with loop closing; return the odometry, the closer, and the true poses."""
    truth = poses_along(path, 0.5)
    guess = drifted(truth, np.random.default_rng(seed), yaw_rad, scale)
    odometry = Odometry(world, seed)
    closer = LoopCloser(odometry.builder)
    errors = []
    for k in range(len(truth)):
        index = odometry.add(truth[k], guess[k] @ np.linalg.inv(guess[k - 1]) if k else None)
        closer.add(index)
        errors.append(float(np.linalg.norm(centres(odometry.builder.camera_from_world)[-1] - centres(truth)[k])))
    return odometry, closer, truth, errors


@pytest.fixture(scope="module")
def ring_walk():
    return walk(corridor(RING[:5], np.random.default_rng(1)), RING, seed=2)


def test_a_closed_loop_takes_the_drift_out(ring_walk) -> None:
    odometry, closer, truth, errors = ring_walk
    assert closer.closures, "the walk came back to where it began"
    drift_before = max(errors)
    error = np.linalg.norm(centres(odometry.builder.camera_from_world) - centres(truth), axis=1)
    assert drift_before > 0.3
    assert error.max() < 0.4 * drift_before
    assert error[-1] < 0.08


def test_a_closed_loop_connects_both_ends(ring_walk) -> None:
    odometry, closer, _, _ = ring_walk
    last = closer.closures[-1]
    shared, _ = odometry.builder.covisible(last.keyframe, 20)
    assert np.any(shared < 15), "key frames of the first pass now share landmarks with those of the second"
    assert odometry.builder.version == len(closer.closures)


def test_landmarks_stay_where_their_key_frames_see_them(ring_walk) -> None:
    odometry, _, _, _ = ring_walk
    builder = odometry.builder
    seen = builder.observations(np.flatnonzero(builder.keyframe_alive).astype(np.int32))
    pose = builder.camera_from_world[seen.keyframe]
    p = np.einsum("nij,nj->ni", pose[:, :3, :3], builder.positions[seen.landmark]) + pose[:, :3, 3]
    u = CAMERA.fx_px * p[:, 0] / p[:, 2] + CAMERA.cx_px
    assert np.median(np.abs(u - seen.uvr_px[:, 0])) < 1.0


def test_the_same_walk_gives_the_same_map(ring_walk) -> None:
    again, closer, _, _ = walk(corridor(RING[:5], np.random.default_rng(1)), RING, seed=2)
    assert closer.closures == ring_walk[1].closures
    assert np.array_equal(again.builder.camera_from_world, ring_walk[0].builder.camera_from_world)
    assert np.array_equal(again.builder.positions, ring_walk[0].builder.positions)


def test_a_loop_is_found_at_the_end_that_was_not_looked_for_on_the_way() -> None:
    world = corridor(RING[:5], np.random.default_rng(1))
    truth = poses_along(RING, 0.5)
    guess = drifted(truth, np.random.default_rng(2), 0.004, 1.005)
    odometry = Odometry(world, 2)
    for k in range(len(truth)):
        odometry.add(truth[k], guess[k] @ np.linalg.inv(guess[k - 1]) if k else None)
    closer = LoopCloser(odometry.builder)
    assert closer.finish()
    error = np.linalg.norm(centres(odometry.builder.camera_from_world) - centres(truth), axis=1)
    assert error[-1] < 0.08


def test_a_straight_walk_closes_nothing() -> None:
    path = np.array([[0.0, 0.0], [25.0, 0.0]])
    _, closer, _, _ = walk(corridor(path, np.random.default_rng(4)), path, seed=4)
    assert closer.closures == []
    assert closer.finish() == []


def test_a_room_that_looks_exactly_alike_is_not_taken_for_the_first() -> None:
    """Two stretches of corridor 18 m apart are the same to the last bit; no walk drifts that far."""
    path = np.array([[0.0, 0.0], [30.0, 0.0]])
    world = corridor(path, np.random.default_rng(5))
    kept = (world.points[:, 0] < 20.0) | (world.points[:, 0] > 28.0)
    twin = (world.points[:, 0] > 2.0) & (world.points[:, 0] < 10.0)
    points = np.concatenate([world.points[kept], world.points[twin] + [18.0, 0.0, 0.0]])
    world = World(points, np.concatenate([world.descriptors[kept], world.descriptors[twin]]))
    odometry, closer, truth, _ = walk(world, path, seed=6, yaw_rad=0.0, scale=1.0)
    assert closer.closures == []
    assert closer.finish() == []
    # The geometry itself would have been convinced: it is the drift that says no.
    alike = [(40, 4), (42, 6), (44, 8)]
    assert any(verify(odometry.builder, k, c) is not None for k, c in alike)
    assert np.linalg.norm(centres(odometry.builder.camera_from_world) - centres(truth), axis=1).max() < 0.3


def test_a_poster_that_hangs_in_two_places_is_no_loop() -> None:
    """A patch of wall is repeated, its surroundings are not: too few landmarks, in too small a part of the image."""
    path = np.array([[0.0, 0.0], [16.0, 0.0]])
    rng = np.random.default_rng(7)
    world = corridor(path, rng)
    poster = np.column_stack([rng.uniform(4.5, 5.2, 70), np.full(70, 1.2), rng.uniform(1.2, 1.9, 70)])
    look_of_poster = rng.integers(0, 256, (70, 32), dtype=np.uint8)
    points = np.concatenate([world.points, poster, poster + np.array([8.0, 0.0, 0.0])])
    world = World(points, np.concatenate([world.descriptors, look_of_poster, look_of_poster]))
    odometry, closer, _, _ = walk(world, path, seed=8, yaw_rad=0.0, scale=1.0)
    assert closer.closures == []
    assert all(verify(odometry.builder, k + 16, k) is None for k in range(2, 9))


def test_a_place_that_depth_contradicts_is_no_loop() -> None:
    """The same landmarks, but the camera now looks through most of them: something else stands here."""
    path = np.array([[0.0, 0.0], [6.0, 0.0]])
    world = corridor(path, np.random.default_rng(9), per_metre=120)
    odometry = Odometry(world, 9)
    truth = poses_along(path, 0.5)
    for k in range(4):
        odometry.add(truth[k], None if k == 0 else truth[k] @ np.linalg.inv(truth[k - 1]))
    assert _seen_again(odometry, world, truth[1]) is not None
    # Most of the walls' points now lie farther away along the same line of sight.
    rng = np.random.default_rng(10)
    moved = rng.random(len(world.points)) < 0.7
    eye = centres(truth[1:2])[0]
    farther = World(world.points.copy(), world.descriptors)
    farther.points[moved] = eye + 1.4 * (world.points[moved] - eye)
    assert _seen_again(odometry, farther, truth[1]) is None


def _seen_again(odometry: Odometry, world: World, pose: np.ndarray):
    features, _ = look(world, pose, np.random.default_rng(11))
    builder = odometry.builder
    index = builder.add_keyframe(99.0, features, pose, np.full(len(features), -1, np.int32))
    loop = verify(builder, index, 1)
    if loop is not None:
        assert difference(loop.camera_from_world, pose)[0] < 0.05
    return loop


def test_the_essential_graph_is_connected_and_consistent(ring_walk) -> None:
    builder = ring_walk[0].builder
    i, j, relative = essential_edges(builder)
    reached = {0}
    for _ in range(len(builder.keyframes)):
        reached |= {int(a) for a, b in zip(i, j, strict=True) if int(b) in reached}
        reached |= {int(b) for a, b in zip(i, j, strict=True) if int(a) in reached}
    assert reached == set(np.flatnonzero(builder.keyframe_alive).tolist())
    poses = builder.camera_from_world
    assert np.allclose(relative @ poses[j], poses[i])

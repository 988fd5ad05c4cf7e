"""Pictures that are read row by row: taken out of the features, and the readout time found from the map itself."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import cv2
import numpy as np
import pytest

from navcore.errors import SiteError
from navcore.evaluation import absolute_trajectory_error
from navcore.geometry import FloatArray
from navcore.settings import LocalizationSettings
from navcore.slam.bundle_adjustment import bundle_adjust
from navcore.slam.features import GRID_PX, sort_into_cells
from navcore.slam.keyframes import MAX_READOUT_S, Features, SlamCamera
from navcore.slam.lie import exp_se3, inverse_se3
from navcore.slam.localizer import Localizer
from navcore.slam.mapper import Mapper
from navcore.slam.readout_estimation import parameter_step
from navcore.slam.rolling_shutter import (
    MAX_VELOCITY_GAP_S,
    ReadoutTime,
    sorted_anew,
    unroll,
    unrolled,
    velocity_between,
)
from navcore.slam.slam_map import SlamMap
from navcore.slam.thawing import thaw
from navcore.types import CameraIntrinsics, Frame

INTRINSICS = CameraIntrinsics(320, 240, 260.0, 260.0, 159.5, 119.5)
CAMERA = SlamCamera.of(INTRINSICS, 100.0)
READOUT_S = 0.02


def rolled_view(points: FloatArray, pose: FloatArray, velocity: FloatArray, readout_s: float) -> FloatArray:
    """Return u, v, u_r (n, 3) of world points as a camera sees them that reads row by row, each at its own time."""
    uvr = np.empty((len(points), 3))
    for i, point in enumerate(points):
        late_s = 0.0
        for _ in range(6):
            moved = exp_se3(velocity * late_s) @ pose
            x, y, z = moved[:3, :3] @ point + moved[:3, 3]
            u, v = CAMERA.fx_px * x / z + CAMERA.cx_px, CAMERA.fy_px * y / z + CAMERA.cy_px
            late_s = readout_s * (v / CAMERA.height_px - 0.5)
        uvr[i] = u, v, u - CAMERA.bf_px_m / z
    return uvr


def features_at(uvr: FloatArray) -> Features:
    count = len(uvr)
    columns, rows = -(-CAMERA.width_px // GRID_PX), -(-CAMERA.height_px // GRID_PX)
    order, cell_start = sort_into_cells(uvr, columns, rows)
    seen = np.ascontiguousarray(uvr[order])
    depth_m = CAMERA.bf_px_m / (seen[:, 0] - seen[:, 2])
    numbers = order.astype("<u8")[:, None].repeat(4, axis=1).copy().view(np.uint8)
    return Features(seen, depth_m, np.zeros(count, np.int32), np.zeros(count), numbers, cell_start, columns)


def points_in_view(rng: np.random.Generator, count: int) -> FloatArray:
    z = rng.uniform(1.0, 4.0, count)
    return np.stack([rng.uniform(-0.4, 0.4, count) * z, rng.uniform(-0.3, 0.3, count) * z, z], axis=1)


VELOCITY = np.array([0.3, -0.2, 0.25, 0.4, -1.4, 0.6])


# ---------------------------------------------------------------------------------------------------- one frame
def test_unrolled_features_lie_where_a_camera_without_readout_sees_them() -> None:
    points = points_in_view(np.random.default_rng(0), 200)
    seen = features_at(rolled_view(points, np.eye(4), VELOCITY, READOUT_S))
    number = seen.descriptors.view("<u8")[:, 0].astype(int)
    ideal = rolled_view(points, np.eye(4), VELOCITY, 0.0)[number]
    bent_px = np.linalg.norm((seen.uvr_px - ideal)[:, :2], axis=1)
    left_px = np.linalg.norm((unrolled(seen, VELOCITY, READOUT_S, CAMERA).uvr_px - ideal)[:, :2], axis=1)
    assert bent_px.max() > 2.5
    assert left_px.max() < 0.1


def test_a_picture_taken_at_once_stays_as_it_is() -> None:
    seen = features_at(rolled_view(points_in_view(np.random.default_rng(1), 50), np.eye(4), VELOCITY, 0.0))
    assert np.allclose(unrolled(seen, VELOCITY, 0.0, CAMERA).uvr_px, seen.uvr_px)
    assert np.allclose(unrolled(seen, np.zeros(6), READOUT_S, CAMERA).uvr_px, seen.uvr_px)


def test_unrolling_begins_with_what_was_seen_each_time() -> None:
    seen = features_at(rolled_view(points_in_view(np.random.default_rng(2), 50), np.eye(4), VELOCITY, READOUT_S))
    once = unrolled(seen, VELOCITY, READOUT_S, CAMERA)
    after_a_mistake = unrolled(unrolled(seen, -VELOCITY, 0.04, CAMERA), VELOCITY, READOUT_S, CAMERA)
    assert np.array_equal(once.uvr_px, after_a_mistake.uvr_px)
    assert np.array_equal(once.depth_m, after_a_mistake.depth_m)


def test_features_without_depth_are_turned_back_and_stay_without_depth() -> None:
    points = 100.0 * points_in_view(np.random.default_rng(3), 50)
    uvr = rolled_view(points, np.eye(4), VELOCITY, READOUT_S)
    uvr[:, 2] = np.nan
    seen = features_at(uvr)
    number = seen.descriptors.view("<u8")[:, 0].astype(int)
    straight = unrolled(seen, VELOCITY, READOUT_S, CAMERA)
    ideal = rolled_view(points, np.eye(4), VELOCITY, 0.0)[number]
    assert np.linalg.norm((straight.uvr_px - ideal)[:, :2], axis=1).max() < 0.1
    assert np.isnan(straight.depth_m).all()
    assert np.isnan(straight.uvr_px[:, 2]).all()


def test_sorting_anew_keeps_each_feature_whole_and_puts_it_into_its_cell() -> None:
    seen = features_at(rolled_view(points_in_view(np.random.default_rng(4), 300), np.eye(4), VELOCITY, READOUT_S))
    straight, order = sorted_anew(unrolled(seen, VELOCITY, READOUT_S, CAMERA), CAMERA)
    assert np.array_equal(straight.descriptors, seen.descriptors[order])
    before = {bytes(d): tuple(p) for d, p in zip(seen.descriptors, seen.uvr_px, strict=True)}
    assert straight.rolled_uvr_px is not None
    assert all(before[bytes(d)] == tuple(p) for d, p in zip(straight.descriptors, straight.rolled_uvr_px, strict=True))
    cell = np.repeat(np.arange(len(straight.cell_start) - 1), np.diff(straight.cell_start))
    column = np.clip(straight.uvr_px[:, 0] // GRID_PX, 0, straight.cell_columns - 1)
    assert np.array_equal(cell % straight.cell_columns, column)


def test_a_velocity_leads_from_one_pose_to_the_other_unless_the_time_between_is_too_long() -> None:
    before = exp_se3(np.array([0.1, 0.2, -0.3, 0.3, 0.1, -0.2]))
    after = exp_se3(0.03 * VELOCITY) @ before
    assert np.allclose(velocity_between(before, after, 0.03), VELOCITY)
    assert np.allclose(velocity_between(after, before, -0.03), VELOCITY)
    assert not velocity_between(before, after, 1.01 * MAX_VELOCITY_GAP_S).any()
    assert not velocity_between(before, before, 0.0).any()


# ------------------------------------------------------------------------------------------------- readout time
def adjusted(readout_s: float, with_velocity: bool = True) -> tuple[float, float]:
    """Adjust key frames unrolled with one readout time that were taken with READOUT_S; return the step and its σ."""
    rng = np.random.default_rng(5)
    points = points_in_view(rng, 150)
    poses = np.stack([exp_se3(rng.normal(0, 0.05, 6)) for _ in range(8)])
    seen, per_s = [], []
    for pose in poses:
        velocity = np.r_[rng.normal(0, 0.2, 3), rng.normal(0, 1.0, 3)]
        uvr = rolled_view(points, pose, velocity, READOUT_S)
        uvr[:, :2] += rng.normal(0, 0.3, (len(points), 2))
        uvr[:, 2] = uvr[:, 0] - CAMERA.bf_px_m / (CAMERA.bf_px_m / (uvr[:, 0] - uvr[:, 2]))
        known = velocity if with_velocity else np.zeros(6)
        features = replace(features_at(uvr), uvr_px=uvr)
        longer, now = (unrolled(features, known, readout_s + more, CAMERA).uvr_px for more in (1e-3, 0.0))
        seen.append(now)
        per_s.append(1e3 * (longer - now))
    keyframe = np.repeat(np.arange(len(poses), dtype=np.int32), len(points))
    point = np.tile(np.arange(len(points), dtype=np.int32), len(poses))
    fixed = np.arange(len(poses)) == 0
    pinhole = (CAMERA.fx_px, CAMERA.fy_px, CAMERA.cx_px, CAMERA.cy_px, CAMERA.bf_px_m)
    observed, weight = np.concatenate(seen), np.full(len(keyframe), 1 / 0.3**2)
    found = bundle_adjust(*pinhole, poses, fixed, points, keyframe, point, observed, 0.01 * weight, 30)
    step_s, information = parameter_step(
        np.array(pinhole),
        found.poses,
        fixed,
        found.points,
        keyframe,
        point,
        observed,
        np.concatenate(per_s),
        weight,
        np.ones(len(keyframe), np.bool_),
    )
    return step_s, float(information**-0.5) if information > 0 else np.inf


@pytest.mark.parametrize("readout_s", [0.0, 0.015, 0.03])
def test_an_adjusted_map_tells_how_long_the_readout_took(readout_s: float) -> None:
    step_s, sigma_s = adjusted(readout_s)
    assert abs(readout_s + step_s - READOUT_S) < 1e-3
    assert sigma_s < 1e-3


def test_a_map_without_velocities_tells_nothing_of_the_readout() -> None:
    assert adjusted(0.0, with_velocity=False) == (0.0, np.inf)


def test_a_readout_time_moves_by_what_the_map_knows_and_stays_possible() -> None:
    start = ReadoutTime()
    assert start.refined(0.02, 0.0).seconds == 0.0
    assert 0.0 < start.refined(0.02, start.information).seconds < 0.02
    assert start.refined(0.02, 1e9).seconds == pytest.approx(0.02, rel=1e-3)
    assert start.refined(1.0, 1e12).seconds == MAX_READOUT_S
    assert start.refined(-1.0, 1e12).seconds == -MAX_READOUT_S


# ------------------------------------------------------------------------------------------------------ mapping
WALL_M = 2.0
PIXELS_PER_M = 300.0


def turning_head(time_s: float) -> FloatArray:
    """Return camera_from_world (4, 4) of somebody who looks to and fro in front of a painted wall."""
    yaw, pitch = 0.22 * np.sin(2 * np.pi * 0.9 * time_s), 0.12 * np.sin(2 * np.pi * 1.3 * time_s)
    turned = exp_se3(np.array([0.0, 0.0, 0.0, pitch, yaw, 0.0]))
    turned[:3, 3] = turned[:3, :3] @ np.array([-0.1 * np.sin(2 * np.pi * 0.3 * time_s), -0.05 * time_s, 0.0])
    return turned


def drawn_frames(count: int, readout_s: float) -> Iterator[tuple[Frame, FloatArray]]:
    """Yield frames whose rows are drawn each at its own time, and the true positions (3,) at the middle row's."""
    rng = np.random.default_rng(6)
    side = int(6 * PIXELS_PER_M)
    coarse = rng.integers(0, 256, (side // 8, side // 8, 3)).astype(np.uint8)
    wall = cv2.GaussianBlur(cv2.resize(coarse, (side, side), interpolation=cv2.INTER_NEAREST), (5, 5), 1.2)
    columns = (np.arange(320) - INTRINSICS.cx_px) / INTRINSICS.fx_px
    for number in range(count):
        time_s = number / 30.0
        where = np.empty((240, 320, 2), np.float32)
        depth_m = np.empty((240, 320), np.float32)
        for row in range(240):
            rays = np.stack([columns, np.full(320, (row - INTRINSICS.cy_px) / INTRINSICS.fy_px), np.ones(320)])
            for is_depth, row_s in ((False, time_s + readout_s * (row / 240 - 0.5)), (True, time_s)):
                world_from_camera = inverse_se3(turning_head(row_s))
                directions = world_from_camera[:3, :3] @ rays
                reach = (WALL_M - world_from_camera[2, 3]) / directions[2]
                if is_depth:
                    depth_m[row] = reach
                else:
                    hit = world_from_camera[:2, 3, None] + reach * directions[:2]
                    where[row] = (hit.T + 3.0) * PIXELS_PER_M
        colour = cv2.remap(wall, where[..., 0], where[..., 1], cv2.INTER_LINEAR)
        yield Frame(time_s, np.ascontiguousarray(colour, np.uint8), depth_m), inverse_se3(turning_head(time_s))[:3, 3]


@pytest.fixture(scope="module")
def drawn() -> list[tuple[Frame, FloatArray]]:
    return list(drawn_frames(75, READOUT_S))


@pytest.fixture(scope="module")
def drawn_at_once() -> list[tuple[Frame, FloatArray]]:
    return list(drawn_frames(75, 0.0))


def mapped(frames: list[tuple[Frame, FloatArray]]) -> tuple[Mapper, SlamMap, float, float]:
    """Return a mapper that has seen frames, its map, and the errors of its trajectory, while running and final."""
    mapper = Mapper(INTRINSICS, CAMERA, 500)
    running = []
    for frame, _ in frames:
        assert mapper.add(frame)
        running.append(mapper.world_from_camera[:3, 3])
    slam_map = mapper.finish()
    return mapper, slam_map, error_m(frames, running), error_m(frames, list(slam_map.trajectory[:, :3, 3]))


def error_m(frames: list[tuple[Frame, FloatArray]], positions: list[FloatArray]) -> float:
    stamps_s = np.array([frame.stamp_s for frame, _ in frames])
    truth = np.array([position for _, position in frames])
    return absolute_trajectory_error(stamps_s, np.array(positions), stamps_s, truth).rmse_m


def located(frames: list[tuple[Frame, FloatArray]], slam_map: SlamMap) -> float:
    """Return the error of the poses that a localizer finds."""
    localizer = Localizer(slam_map, INTRINSICS, LocalizationSettings(feature_count=500))
    found = [localizer.locate(frame).world_from_camera for frame, _ in frames]
    assert all(pose is not None for pose in found)
    return error_m(frames, [pose.translation for pose in found if pose is not None])


def test_mapping_finds_the_readout_time_and_keeps_to_the_truth(drawn: list[tuple[Frame, FloatArray]]) -> None:
    mapper, slam_map, running_m, final_m = mapped(drawn)
    assert mapper.builder.readout.seconds == pytest.approx(READOUT_S, abs=0.003)
    assert slam_map.readout_s[0] == mapper.builder.readout.seconds
    assert thaw(slam_map).readout.seconds == mapper.builder.readout.seconds
    # Without taking the readout out it is 0.05 m, without repeating adjustments while it is being found 0.03 m.
    assert max(running_m, final_m) < 0.012


def test_mapping_with_a_camera_that_takes_its_picture_at_once_finds_no_readout(
    drawn_at_once: list[tuple[Frame, FloatArray]],
) -> None:
    mapper, _, _, final_m = mapped(drawn_at_once)
    assert abs(mapper.builder.readout.seconds) < 0.002
    assert final_m < 0.006


def test_who_knows_the_readout_is_located_better(
    drawn: list[tuple[Frame, FloatArray]], drawn_at_once: list[tuple[Frame, FloatArray]]
) -> None:
    true_map = mapped(drawn_at_once)[1]
    knowing_m = located(drawn, replace(true_map, readout_s=np.array([READOUT_S])))
    unknowing_m = located(drawn, replace(true_map, readout_s=np.zeros(1)))
    assert knowing_m < 0.5 * unknowing_m


def test_a_map_that_does_not_say_its_readout_has_none_and_an_impossible_one_is_damaged(
    drawn_at_once: list[tuple[Frame, FloatArray]],
) -> None:
    arrays = mapped(drawn_at_once[:20])[1].to_arrays()
    assert SlamMap.from_arrays(arrays).readout_s[0] == arrays["readout_s"][0]
    assert SlamMap.from_arrays({k: a for k, a in arrays.items() if k != "readout_s"}).readout_s[0] == 0.0
    with pytest.raises(SiteError, match="reads a picture"):
        SlamMap.from_arrays({**arrays, "readout_s": np.array([1.0])})


@pytest.mark.parametrize(("step_m", "step_s"), [(0.1, 0.001), (0.28, 1 / 30), (3.0, 0.05)])
def test_a_pose_that_was_put_right_is_no_velocity(step_m: float, step_s: float) -> None:
    later = np.eye(4)
    later[0, 3] = step_m
    assert not velocity_between(np.eye(4), later, step_s).any()


def test_no_velocity_turns_a_picture_inside_out() -> None:
    """Whatever velocity is believed, nothing comes behind the camera or out of all bounds."""
    seen = np.array([[320.0, 10.0, 320.0 - 40.0 / 1.5], [100.0, 470.0, 100.0 - 40.0 / 0.5]])
    for velocity in ((0, 0, 100.0, 0, 0, 0), (0, 0, -100.0, 0, 0, 0), (0, 0, 40.0, 3.0, 0, 0)):
        uvr, depth = unroll(seen, np.array(velocity, dtype=np.float64), 0.03, 480, 500.0, 500.0, 320.0, 240.0, 40.0)
        assert np.isfinite(uvr).all()
        assert (depth > 0.2).all()
        assert (np.abs(uvr[:, :2]) < 2000.0).all()

"""The floor holds height and tilt where nothing else does, and says nothing where it is not flat, or another one."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from slam_blank_room import CAMERA, FLOOR, Plane, camera_at, corridor_planes, depth_of

from navcore.geometry import FloatArray
from navcore.slam.depth_localization import DepthAid
from navcore.slam.depth_model import DepthModel, depth_grid, depth_model
from navcore.slam.depth_tracking import DepthView
from navcore.slam.floor_anchor import FloorAnchor
from navcore.slam.keyframes import Features
from navcore.slam.lie import exp_so3, inverse_se3, log_so3
from navcore.slam.localizer_state import LocalizerState
from navcore.slam.mapper import Mapper
from navcore.slam.pose_uncertainty import drifted
from navcore.slam.slam_map import SlamMap
from navcore.slam.tracking import Track
from navcore.types import CameraIntrinsics, Frame

INTRINSICS = CameraIntrinsics(320, 240, CAMERA.fx_px, CAMERA.fy_px, CAMERA.cx_px, CAMERA.cy_px)
END = Plane((1.0, 0.0, 0.0), 4.0)
"""A wall across the corridor, towards which it was mapped."""
HEIGHT_M = 1.2
NOISE_PER_M = 0.002
PITCH_RAD = 0.4
RISE_M, RAMP_RAD = 0.1, 0.09
NOTHING = Features(
    np.zeros((0, 3)), np.zeros(0), np.zeros(0, np.int32), np.zeros(0), np.zeros((0, 32), np.uint8),
    np.zeros(2, np.int32), 1,
)  # fmt: skip
WIDE = np.diag([0.1**2] * 3 + [0.05**2] * 3)
"""A covariance of (position, rotation) with which little is a surprise."""


@dataclass
class Walked:
    """A pose carried back along the corridor: errors against the truth, frame by frame."""

    up_m: list[float]
    tilt_rad: list[float]
    sigma_m: list[FloatArray]
    """Standard deviations along the corridor, across it, and up."""


def looking(x_m: float, heading_rad: float, pitch_rad: float = PITCH_RAD, height_m: float = HEIGHT_M) -> FloatArray:
    """``camera_from_world`` (4, 4) of a camera in the corridor's middle that looks down by a pitch."""
    turn = np.eye(4)
    turn[:3, :3] = exp_so3(np.array([pitch_rad, 0.0, 0.0]))
    return np.ascontiguousarray(turn @ camera_at((x_m, 0.0, height_m), heading_rad))


def seen_from(pose: FloatArray, planes: list[Plane] | None = None, seed: int = 0) -> np.ndarray:
    return depth_of(planes or [*corridor_planes(), END], pose, NOISE_PER_M, np.random.default_rng(seed))


@pytest.fixture(scope="module")
def corridor() -> SlamMap:
    """A blank corridor, mapped by depth alone on the way to its end, level."""
    mapper = Mapper(INTRINSICS, CAMERA, 300)
    grey = np.full((CAMERA.height_px, CAMERA.width_px, 3), 128, np.uint8)
    poses = [looking(x_m, 0.0, 0.2) for x_m in np.linspace(-1.0, 2.0, 31)]
    for number, pose in enumerate(poses):
        assert mapper.add(Frame(0.1 * number, grey, seen_from(pose, seed=number)))
    return mapper.finish().transformed(inverse_se3(poses[0]))


def back(count: int) -> list[FloatArray]:
    """The way back: no key frame looks along it."""
    return [looking(x_m, np.pi) for x_m in np.linspace(3.2, 2.2, count)]


def track_at(stamp_s: float, pose: FloatArray) -> Track:
    return Track(stamp_s, NOTHING, pose, np.zeros(0, np.int32), np.zeros((6, 6)))


def walked_back(slam_map: SlamMap, has_floor: bool) -> Walked:
    """Follow the way back by odometry that errs by 2 mm upwards and 1 mrad of tilt in each frame."""
    aid, walked = DepthAid(slam_map), Walked([], [], [])
    truth = back(60)
    erring = np.eye(4)
    erring[:3, :3] = exp_so3(np.array([0.001, 0.0, 0.0]))
    erring[:3, 3] = (0.0, 0.002, 0.0)
    track, covariance = track_at(0.0, truth[0]), np.diag([1e-5] * 3 + [1e-6] * 3)
    for number in range(1, len(truth)):
        step = truth[number] @ inverse_se3(truth[number - 1])
        followed = track_at(0.1 * number, erring @ step @ track.camera_from_world)
        seen = DepthView(CAMERA, seen_from(truth[number], seed=number))
        state = LocalizerState(track, None, covariance, np.zeros((6, 6)), 0.0, 3, 1.0)
        placed = aid.place(seen, state, followed, followed, True) if has_floor else None
        covariance = drifted(covariance, track, followed) if placed is None else placed.covariance
        assert placed is None or not placed.is_sure
        track = followed if placed is None else placed.track
        off = inverse_se3(track.camera_from_world) @ truth[number]
        walked.up_m.append(abs(float(inverse_se3(track.camera_from_world)[2, 3]) - HEIGHT_M))
        walked.tilt_rad.append(float(np.linalg.norm(log_so3(np.ascontiguousarray(off[:3, :3]))[:2])))
        walked.sigma_m.append(np.sqrt(np.diag(covariance)[:3]))
    return walked


def test_between_blank_walls_the_floor_holds_height_and_tilt(corridor: SlamMap) -> None:
    held, drifting = walked_back(corridor, has_floor=True), walked_back(corridor, has_floor=False)
    assert drifting.up_m[-1] > 0.07
    assert drifting.tilt_rad[-1] > np.radians(3.0)
    assert max(held.up_m) < 0.02
    assert max(held.tilt_rad) < np.radians(0.7)
    along_m, across_m, up_m = held.sigma_m[-1]
    # What the floor does not hold goes on drifting, and the covariance says so.
    assert min(along_m, across_m) > 2.0 * up_m
    assert up_m < 0.02
    assert max(held.up_m) < 3.0 * up_m


def seen_and_guess(
    planes: list[Plane], pose: FloatArray, lifted_m: float, tilted_rad: float
) -> tuple[DepthModel, FloatArray]:
    """What is seen from a pose, and that pose (4, 4) lifted and tilted."""
    guess = inverse_se3(pose)
    guess[:3, :3] = exp_so3(np.array([0.0, tilted_rad, 0.0])) @ guess[:3, :3]
    guess[2, 3] += lifted_m
    return depth_model(seen_from(pose, planes), CAMERA), inverse_se3(guess)


def test_a_pose_that_is_too_high_and_tilted_is_put_right_and_stays_where_it_is(corridor: SlamMap) -> None:
    pose = looking(3.2, np.pi)
    seen, guess = seen_and_guess([*corridor_planes(), END], pose, 0.05, 0.03)
    said = FloorAnchor(corridor).factor(seen, guess, WIDE)
    assert said is not None
    there, truth, before = (inverse_se3(each) for each in (said.camera_from_world, pose, guess))
    assert abs(there[2, 3] - truth[2, 3]) < 0.012
    assert np.linalg.norm(log_so3(np.ascontiguousarray(there[:3, :3] @ truth[:3, :3].T))) < 0.008
    np.testing.assert_allclose(there[:2, 3], before[:2, 3], atol=1e-9)
    along, across, up = said.camera_from_world[:3, :3].T
    for twist in (np.append(along, np.zeros(3)), np.append(across, np.zeros(3)), np.append(np.zeros(3), up)):
        assert twist @ said.information @ twist < 1e-6
    assert np.linalg.matrix_rank(said.information, tol=1.0) == 3


def lifted(plane: Plane, by_m: float) -> Plane:
    return replace(plane, distance_m=plane.distance_m - by_m)


RAMP = Plane((float(np.sin(RAMP_RAD)), 0.0, float(-np.cos(RAMP_RAD))), float(2.4 * np.sin(RAMP_RAD)))
"""A floor that rises towards −x."""


def stepped(pose: FloatArray, from_x_m: float) -> np.ndarray:
    """Depth (h, w) of a corridor whose floor is RISE_M higher where x is less."""
    walls = [*corridor_planes()[1:], END]
    low, high = seen_from(pose, [FLOOR, *walls]), seen_from(pose, [lifted(FLOOR, RISE_M), *walls])
    v, u = np.mgrid[0 : CAMERA.height_px, 0 : CAMERA.width_px]
    rays = np.stack([(u - CAMERA.cx_px) / CAMERA.fx_px, (v - CAMERA.cy_px) / CAMERA.fy_px, np.ones(u.shape)], axis=2)
    x_m = inverse_se3(pose)[0, 3] + high * (rays @ pose[:3, 0])
    return np.where(x_m < from_x_m, high, low).astype(np.float32)


@pytest.mark.parametrize(
    "planes",
    [
        pytest.param([lifted(FLOOR, 0.15), *corridor_planes()[1:], END], id="somebody stands on a platform"),
        pytest.param([RAMP, *corridor_planes()[1:], END], id="a ramp begins before the feet"),
        pytest.param([*corridor_planes()[1:], END], id="no floor"),
    ],
)
def test_a_floor_that_is_not_where_the_map_has_it_says_nothing(corridor: SlamMap, planes: list[Plane]) -> None:
    seen, guess = seen_and_guess(planes, looking(3.2, np.pi), 0.0, 0.0)
    assert FloorAnchor(corridor).factor(seen, guess, WIDE) is None


def test_a_step_in_view_says_nothing(corridor: SlamMap) -> None:
    pose = looking(3.2, np.pi)
    level, step = depth_model(stepped(pose, -9.0), CAMERA), depth_model(stepped(pose, 2.0), CAMERA)
    assert FloorAnchor(corridor).factor(level, pose, WIDE) is not None
    assert FloorAnchor(corridor).factor(step, pose, WIDE) is None


def test_where_the_map_has_a_step_the_floor_is_not_asked(corridor: SlamMap) -> None:
    grids = np.stack([depth_grid(stepped(pose, 2.0), CAMERA) for pose in corridor.camera_from_world])
    pose = looking(3.2, np.pi)
    seen = depth_model(seen_from(pose), CAMERA)
    assert FloorAnchor(replace(corridor, keyframe_depth=grids)).factor(seen, pose, WIDE) is None


def test_a_surprising_floor_is_not_believed(corridor: SlamMap) -> None:
    """Where the pose is known well, ten centimetres are another floor."""
    seen, guess = seen_and_guess([*corridor_planes(), END], looking(3.2, np.pi), 0.1, 0.0)
    assert FloorAnchor(corridor).factor(seen, guess, WIDE) is not None
    assert FloorAnchor(corridor).factor(seen, guess, np.diag([0.01**2] * 3 + [0.01**2] * 3)) is None


def test_a_floor_that_nobody_has_seen_says_nothing(corridor: SlamMap) -> None:
    pose = looking(-4.0, np.pi)
    seen: DepthModel = depth_model(seen_from(pose), CAMERA)
    assert FloorAnchor(corridor).factor(seen, pose, WIDE) is None


def test_in_a_map_that_is_not_level_nothing_is_floor(corridor: SlamMap) -> None:
    turned = np.eye(4)
    turned[:3, :3] = exp_so3(np.array([np.pi / 2, 0.0, 0.0]))
    pose = looking(3.2, np.pi)
    seen = depth_model(seen_from(pose), CAMERA)
    assert FloorAnchor(corridor.transformed(turned)).factor(seen, pose @ inverse_se3(turned), WIDE) is None

"""What the depth image says of the way ahead: found where it stands, and nothing found on a bare floor."""

from __future__ import annotations

import math
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from closed_loop import ABSORBING, CAMERA, EYE_M, PITCH_RAD, box, depth_image, without_absorbed
from hypothesis import given, settings
from hypothesis import strategies as st

from navcore.angles import world_angle
from navcore.geometry import Transform, heading_of_camera, world_from_camera_at
from navcore.obstacle.levelling import Expected, level_by_floor, level_by_pose, refine_by_floor
from navcore.obstacle.memory import ObstacleMemory, remember, with_memory
from navcore.obstacle.scan import scan
from navcore.settings import ObstacleSettings, Settings
from navcore.types import BearingState, ObstacleScan, Pose2D

SETTINGS = ObstacleSettings()
ROOM = (box(-10, 9, 10, 9.2), box(-10, -9.2, 10, -9), box(9, -9, 9.2, 9))


def seen(*solids, seed: int | None = 0, roll_deg: float = 0.0, settings: ObstacleSettings = SETTINGS) -> ObstacleScan:
    camera = world_from_camera_at((0, 0, EYE_M), 0.0, PITCH_RAD, math.radians(roll_deg))
    rng = None if seed is None else np.random.default_rng(seed)
    return scan(depth_image((*ROOM, *solids), camera, rng), CAMERA, camera, settings)


def free_deg(found: ObstacleScan, required_m: float = 3.0) -> list[int]:
    return [round(math.degrees(each.angle)) for each in found.candidates if each.clearance_m >= required_m]


@pytest.mark.parametrize("roll_deg", [-4.0, 0.0, 4.0])
@pytest.mark.parametrize("seed", range(4))
def test_a_bare_floor_has_no_obstacle_and_no_drop(seed: int, roll_deg: float):
    found = seen(seed=seed, roll_deg=roll_deg)
    assert found.nearest_ahead_m is None
    assert set(found.state.tolist()) == {BearingState.FREE}
    assert {0, -24, 24} <= set(free_deg(found))


@pytest.mark.parametrize(
    ("solid", "distance_m"),
    [
        (box(3.0, -0.3, 3.4, 0.3, 1.0), 3.0),
        (box(2.5, -0.3, 2.9, 0.3, 0.25), 2.5),  # low
        (box(2.5, -0.3, 2.9, 0.3, 1.8, 1.4), 2.5),  # overhanging
        (box(1.0, -0.3, 1.4, 0.3, 2.0), 1.0),
        (box(2.0, -0.03, 2.06, 0.03, 2.0), 2.0),  # a post, 6 cm thick
    ],
)
def test_what_stands_or_hangs_in_the_way_is_found_at_its_distance(solid, distance_m: float):
    found = seen(solid)
    assert found.nearest_ahead_m == pytest.approx(distance_m, abs=0.12)
    assert 0 not in free_deg(found, distance_m + 0.3)


def test_what_a_person_passes_over_or_under_is_no_obstacle():
    assert seen(box(2.5, -0.5, 2.9, 0.5, 0.05)).nearest_ahead_m is None
    assert seen(box(2.5, -0.5, 2.9, 0.5, 2.6, 2.0)).nearest_ahead_m is None


@settings(max_examples=15, deadline=None)
@given(st.floats(1.2, 2.8), st.floats(-0.6, 0.6), st.floats(0.1, 0.4))
def test_a_walkable_corridor_really_is_free(x_m: float, y_m: float, half_m: float):
    """No candidate direction, walked as far as it is said to be free, touches the box with a person's width."""
    found = seen(box(x_m, y_m - half_m, x_m + 0.4, y_m + half_m, 1.2))
    assert found.candidates
    corners = [(x_m, y_m - half_m), (x_m, y_m + half_m)]
    for each in found.candidates:
        for cx, cy in corners:
            along = cx * math.cos(each.angle) + cy * math.sin(each.angle)
            aside = -cx * math.sin(each.angle) + cy * math.cos(each.angle)
            assert abs(aside) > SETTINGS.person_width_m / 2 - 0.08 or along > each.clearance_m - 0.15


def test_the_mirror_image_gives_the_mirror_image():
    left, right = seen(box(2.0, 0.1, 2.4, 0.7), seed=None), seen(box(2.0, -0.7, 2.4, -0.1), seed=None)
    assert free_deg(left, 2.5) == [-angle for angle in free_deg(right, 2.5)][::-1]


def test_missing_depth_is_unknown_never_free():
    camera = world_from_camera_at((0, 0, EYE_M), 0.0, PITCH_RAD)
    depth = depth_image(ROOM, camera)
    depth[:, 60:100] = np.nan
    found = scan(depth, CAMERA, camera, SETTINGS)
    unknown = np.degrees(found.bearing_rad[found.state == BearingState.UNKNOWN])
    assert unknown.min() < -5
    assert unknown.max() > 5
    assert np.isnan(found.nearest_m[found.state == BearingState.UNKNOWN]).all()
    assert not set(free_deg(found, 0.0)) & set(range(-6, 7))
    nothing = scan(np.full_like(depth, np.nan), CAMERA, camera, SETTINGS)
    assert nothing.candidates == ()
    assert nothing.valid_fraction == 0.0
    assert scan(np.full_like(depth, np.nan), CAMERA, None, SETTINGS).candidates == ()


@pytest.mark.parametrize("height_m", [0.15, 0.25, 0.5, 0.9, 1.5])
@pytest.mark.parametrize("distance_m", [2.0, 2.4, 2.8])
@pytest.mark.parametrize("seed", [None, 0])
def test_what_gives_no_depth_is_unknown_from_its_foot_on(height_m: float, distance_m: float, seed: int | None):
    """A black bag 30 cm wide: the camera shows a hole in the floor, and the floor again beyond it."""
    camera = world_from_camera_at((0, 0, EYE_M), 0.0, PITCH_RAD)
    bag = replace(box(distance_m, -0.15, distance_m + 0.3, 0.15, height_m), name=ABSORBING)
    rng = None if seed is None else np.random.default_rng(seed)
    depth = without_absorbed(depth_image((*ROOM, bag), camera, rng), (*ROOM, bag), camera)
    found = scan(depth, CAMERA, camera, SETTINGS)
    ahead = np.abs(found.bearing_rad) < math.atan(0.1 / distance_m)
    assert set(found.state[ahead].tolist()) == {BearingState.UNKNOWN}
    assert found.nearest_m[ahead] == pytest.approx(np.full(ahead.sum(), distance_m), abs=0.16)
    assert found.nearest_ahead_m == pytest.approx(distance_m, abs=0.16)
    assert not set(free_deg(found, distance_m + 0.3)) & set(range(-3, 4))
    beside = np.abs(found.bearing_rad) > math.atan(0.3 / distance_m)
    assert set(found.state[beside].tolist()) == {BearingState.FREE}


def test_a_hole_that_is_out_of_sight_is_remembered_until_the_floor_is_seen_there():
    """Two steps on it lies below the image: it is in the way all the same; taken away, it is not any more."""
    bag = replace(box(2.2, -0.15, 2.5, 0.15, 0.25), name=ABSORBING)
    memory, walked_m = ObstacleMemory(), 0.0
    for number in range(12):
        walked_m = 0.1 * number
        camera = world_from_camera_at((walked_m, 0, EYE_M), 0.0, PITCH_RAD)
        depth = without_absorbed(depth_image((*ROOM, bag), camera), (*ROOM, bag), camera)
        found = scan(depth, CAMERA, camera, SETTINGS)
        pose = Pose2D(walked_m, 0.0, world_angle(0.0))
        memory = remember(memory, found, pose, 0.1 * number)
    assert found.nearest_ahead_m is None, "this image does not show it"
    known = with_memory(found, memory, pose, SETTINGS)
    assert known.nearest_ahead_m == pytest.approx(2.2 - walked_m, abs=0.2)
    away = world_from_camera_at((0, 0, EYE_M), 0.0, PITCH_RAD)
    bare = scan(depth_image(ROOM, away), CAMERA, away, SETTINGS)
    back = Pose2D(0.0, 0.0, world_angle(0.0))
    assert with_memory(bare, remember(memory, bare, back, 2.0), back, SETTINGS).nearest_ahead_m is None


def test_readings_below_the_sensors_range_are_near_not_missing():
    camera = world_from_camera_at((0, 0, EYE_M), 0.0, PITCH_RAD)
    found = scan(np.full((120, 160), 0.2, np.float32), CAMERA, camera, SETTINGS)
    assert found.nearest_ahead_m is not None
    assert found.nearest_ahead_m < 0.4
    assert found.candidates == ()


@settings(max_examples=20, deadline=None)
@given(st.floats(0, 30), st.floats(-8, 8), st.floats(1.2, 1.9), st.integers(0, 100))
def test_the_floor_in_the_image_tells_which_way_is_up(pitch_deg: float, roll_deg: float, eye_m: float, seed: int):
    camera = world_from_camera_at((0, 0, eye_m), 0.0, math.radians(15 + pitch_deg), math.radians(roll_deg))
    depth = depth_image(ROOM, camera, np.random.default_rng(seed))
    found = level_by_floor(depth, CAMERA)
    assert found is not None
    truth = level_by_pose(camera)
    assert found.height_m == pytest.approx(truth.height_m, abs=0.03)
    assert math.degrees(math.acos(min(1.0, float(found.level_from_camera[2] @ truth.level_from_camera[2])))) < 0.8


@pytest.mark.parametrize("error_deg", [-2.5, -1.0, 1.0, 2.5])
def test_a_pitch_that_is_off_makes_no_obstacle_of_the_floor(error_deg: float):
    camera = world_from_camera_at((0, 0, EYE_M), 0.0, PITCH_RAD)
    believed = world_from_camera_at((0, 0, EYE_M + 0.04), 0.0, PITCH_RAD + math.radians(error_deg))
    depth = depth_image(ROOM, camera, np.random.default_rng(1))
    found = scan(depth, CAMERA, believed, SETTINGS)
    assert set(found.state.tolist()) == {BearingState.FREE}
    refined = refine_by_floor(level_by_pose(believed), depth, CAMERA)
    assert refined.height_m == pytest.approx(EYE_M, abs=0.02)


TOO_LOW = world_from_camera_at((0, 0, EYE_M - 0.2), 0.0, PITCH_RAD - math.radians(2.0))
"""Where a pose that is not sure has the camera."""


def test_a_pose_that_is_far_too_low_makes_no_drop_of_the_floor_and_hides_nothing_low():
    camera = world_from_camera_at((0, 0, EYE_M), 0.0, PITCH_RAD)
    bare = depth_image(ROOM, camera, np.random.default_rng(2))
    assert scan(bare, CAMERA, TOO_LOW, SETTINGS).nearest_ahead_m is not None, "by that pose alone it is one"
    found = scan(bare, CAMERA, TOO_LOW, SETTINGS, Expected(EYE_M))
    assert set(found.state.tolist()) == {BearingState.FREE}
    assert found.eye_m == pytest.approx(EYE_M, abs=0.02)
    low = depth_image((*ROOM, box(2.5, -0.3, 2.9, 0.3, 0.25)), camera, np.random.default_rng(2))
    found = scan(low, CAMERA, TOO_LOW, SETTINGS, Expected(EYE_M))
    assert found.nearest_ahead_m == pytest.approx(2.5, abs=0.12)
    assert BearingState.DROP not in found.state


SURE = world_from_camera_at((0, 0, EYE_M), 0.0, PITCH_RAD)


@pytest.mark.parametrize("stoops_m", [-0.03, 0.0, 0.05, 0.08])
@pytest.mark.parametrize("step_m", [0.14, 0.17, 0.2])
@pytest.mark.parametrize("believed", [SURE, TOO_LOW])
def test_the_floor_below_a_step_is_not_taken_for_the_walker_s(step_m: float, believed: Transform, stoops_m: float):
    """Only what lies beyond the edge is in view: by the pose, or by where the eye was a moment ago, it is a drop."""
    eye_m = EYE_M if believed is SURE else EYE_M - stoops_m
    beyond = depth_image(ROOM, world_from_camera_at((0, 0, eye_m + step_m), 0.0, PITCH_RAD), np.random.default_rng(3))
    found = scan(beyond, CAMERA, believed, SETTINGS, None if believed is SURE else Expected(EYE_M))
    # Who stoops comes nearer to the floor that is lower; 5 cm are allowed for the gait.
    assert not is_free_ahead(found)


def is_free_ahead(found: ObstacleScan) -> bool:
    return BearingState.FREE in found.state[np.abs(found.bearing_rad) < math.radians(10.0)]


@pytest.mark.parametrize("down_deg", [8.0, 10.0, 20.0, 30.0])
@pytest.mark.parametrize("believed", [SURE, TOO_LOW])
def test_what_slopes_down_steeply_is_not_taken_for_the_walker_s_floor(down_deg: float, believed: Transform):
    """A flight of stairs or a steep ramp that begins at the feet: as high below the eye there as the floor was."""
    sloping = world_from_camera_at((0, 0, EYE_M), 0.0, PITCH_RAD - math.radians(down_deg))
    depth = depth_image(ROOM, sloping, np.random.default_rng(4))
    assert not is_free_ahead(scan(depth, CAMERA, believed, SETTINGS, None if believed is SURE else Expected(EYE_M)))


def test_levels_are_rotations():
    camera = world_from_camera_at((1, 2, EYE_M), 2.0, PITCH_RAD, 0.1)
    for levelling in (level_by_pose(camera), level_by_floor(depth_image(ROOM, camera), CAMERA)):
        assert levelling is not None
        assert levelling.level_from_camera @ levelling.level_from_camera.T == pytest.approx(np.eye(3), abs=1e-9)
        assert np.linalg.det(levelling.level_from_camera) == pytest.approx(1.0)
        assert abs(levelling.level_from_camera[1, 2]) < 1e-9, "the optical axis has no sideways part"


@pytest.mark.real_data
def test_the_real_cabinet_is_found_and_its_bare_floor_is_free(fr3_cabinet: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.syspath_prepend(str(Path(__file__).resolve().parent.parent / "benchmarks"))
    sys.modules.pop("obstacle_cabinet", None)
    import obstacle_cabinet

    for by_pose in (True, False):
        figures = obstacle_cabinet.summary(obstacle_cabinet.judged(fr3_cabinet, by_pose))
        assert figures["frames_found"] == figures["frames_with_box"] > 50
        assert figures["bearing_recall"] > 0.97
        assert figures["bearing_precision"] > 0.97
        assert figures["distance_error_of_a_frame_m"]["median"] < 0.03
        assert figures["distance_error_of_a_bearing_m"]["p95"] < 0.1
        assert figures["bearing_error_of_an_edge_deg"]["median"] < 1.5
        assert figures["floor_bearings"] > 1000
        assert figures["false_floor_bearings"] == 0


# -------------------------------------------------------------------------------------------------------- memory
def remembered_after(solids_at, away_s: float) -> int:
    """Look ahead for a second (ten frames), turn away, and count what is still remembered then within 2 m ahead."""
    memory, now_s = ObstacleMemory(), 0.0
    for heading_deg, seconds in ((0.0, 1.0), (90.0, away_s)):
        for _ in range(round(10 * seconds)):
            camera = world_from_camera_at((0.0, 0.0, EYE_M), math.radians(heading_deg), PITCH_RAD)
            found = scan(depth_image(solids_at(now_s), camera), CAMERA, camera, Settings().obstacle)
            memory = remember(memory, found, Pose2D(0.0, 0.0, heading_of_camera(camera)), now_s)
            now_s += 0.1
    places = memory.places_m
    return int(np.count_nonzero((np.abs(places[:, 1]) < 0.6) & (places[:, 0] > 0.5) & (places[:, 0] < 2.0)))


def test_what_is_tall_and_stands_is_remembered_beside_the_walker_and_somebody_who_walks_by_is_not():
    cupboard = box(1.5, -0.3, 2.0, 0.3, 1.8)
    assert remembered_after(lambda now_s: (cupboard,), 60.0)
    passing = lambda now_s: (box(1.3, -1.0 + 1.2 * now_s, 1.6, -0.6 + 1.2 * now_s, 1.8),)  # noqa: E731
    assert remembered_after(passing, 0.5)
    assert not remembered_after(passing, 3.0)

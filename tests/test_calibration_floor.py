"""How the camera is held is found from the floor; what could be something else is refused with what to do."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from closed_loop import CAMERA, box, depth_image
from hypothesis import given, settings
from hypothesis import strategies as st

from navcore.calibrating.floor import MIN_FRAMES, calibrated_floor
from navcore.calibration import FloorCalibration, angle_between_rad, pitch_and_roll_rad
from navcore.errors import InputError
from navcore.geometry import Transform, world_from_camera_at
from navcore.obstacle.levelling import level_by_pose
from navcore.types import Frame

COLOUR = np.zeros((CAMERA.height_px, CAMERA.width_px, 3), np.uint8)
WALLS = (box(6.0, -4.0, 6.2, 4.0),)


def frames_from(
    poses: list[Transform], solids: tuple = WALLS, *, felt_off_rad: float | None = None, seed: int = 0
) -> list[Frame]:
    """Return noisy frames; with ``felt_off_rad`` an accelerometer, mounted so far off about the camera's x axis."""
    rng, frames = np.random.default_rng(seed), []
    for number, pose in enumerate(poses):
        gravity = None
        if felt_off_rad is not None:
            c, s = math.cos(felt_off_rad), math.sin(felt_off_rad)
            gravity = np.array([[1, 0, 0], [0, c, -s], [0, s, c]]) @ -pose.rotation[2]
        frames.append(Frame(0.1 * number, COLOUR, depth_image(solids, pose, rng), gravity=gravity))
    return frames


def standing(height_m: float, pitch_deg: float, roll_deg: float, count: int = MIN_FRAMES) -> list[Transform]:
    pose = world_from_camera_at((0.0, 0.0, height_m), 0.3, math.radians(pitch_deg), math.radians(roll_deg))
    return [pose] * count


@settings(deadline=None, max_examples=12)
@given(
    height_m=st.floats(1.0, 1.9), pitch_deg=st.floats(8.0, 35.0), roll_deg=st.floats(-12.0, 12.0),
    seed=st.integers(0, 99),
)  # fmt: skip
def test_pitch_roll_and_height_are_found_whatever_they_are(
    height_m: float, pitch_deg: float, roll_deg: float, seed: int
) -> None:
    found = calibrated_floor(frames_from(standing(height_m, pitch_deg, roll_deg), seed=seed), CAMERA, 7.0)
    assert found.height_m == pytest.approx(height_m, abs=0.02)
    assert math.degrees(found.pitch_rad) == pytest.approx(pitch_deg, abs=0.5)
    assert math.degrees(found.roll_rad) == pytest.approx(roll_deg, abs=0.7)
    assert found.made_s == 7.0
    assert 0.0 < found.pitch_sigma_rad < math.radians(0.5)


@settings(deadline=None)
@given(pitch_deg=st.floats(-40.0, 45.0), roll_deg=st.floats(-40.0, 40.0), heading_rad=st.floats(-3.0, 3.0))
def test_attitude_and_its_two_angles_say_the_same(pitch_deg: float, roll_deg: float, heading_rad: float) -> None:
    pitch_rad, roll_rad = math.radians(pitch_deg), math.radians(roll_deg)
    pose = world_from_camera_at((0.0, 0.0, 1.6), heading_rad, pitch_rad, roll_rad)
    assert pitch_and_roll_rad(level_by_pose(pose)) == pytest.approx((pitch_rad, roll_rad), abs=1e-9)
    floor = FloorCalibration(0.0, 1.6, 0.0, pitch_rad, 0.0, roll_rad, 0.0, 1)
    assert floor.up == pytest.approx(pose.rotation[2], abs=1e-9)


def test_a_nodding_head_makes_the_result_less_sure_not_wrong() -> None:
    still = calibrated_floor(frames_from(standing(1.6, 15.0, 0.0, 30)), CAMERA, 0.0)
    poses = [
        world_from_camera_at((0.0, 0.0, 1.6), 0.0, math.radians(15.0 + 1.5 * math.sin(0.9 * number)))
        for number in range(30)
    ]
    nodding = calibrated_floor(frames_from(poses), CAMERA, 0.0)
    assert math.degrees(nodding.pitch_rad) == pytest.approx(15.0, abs=0.8)
    assert nodding.pitch_sigma_rad > 3 * still.pitch_sigma_rad


def test_an_accelerometer_that_is_mounted_askew_is_measured_with_it() -> None:
    pose = standing(1.6, 15.0, 0.0, 15)
    found = calibrated_floor(frames_from(pose, felt_off_rad=math.radians(4.0)), CAMERA, 0.0)
    assert found.up_from_gravity_rad is not None
    assert math.degrees(math.hypot(*found.up_from_gravity_rad)) == pytest.approx(4.0, abs=0.3)
    # Whoever nods afterwards is levelled by it.
    nod = frames_from(standing(1.6, 27.0, 3.0, 1), felt_off_rad=math.radians(4.0))[0]
    up = found.up_by_gravity(nod.gravity)
    assert up is not None
    assert angle_between_rad(up, standing(1.6, 27.0, 3.0, 1)[0].rotation[2]) < math.radians(0.5)


TABLE = (*WALLS, box(0.3, -2.0, 3.0, 2.0, 0.75))


@pytest.mark.parametrize(
    ("frames", "sentence"),
    [
        (frames_from(standing(1.6, 15.0, 0.0, 3)), "Only 3 frames came"),
        ([], "Only 0 frames came"),
        (frames_from(standing(1.6, 15.0, 0.0), (box(0.9, -5.0, 1.1, 5.0),)), "not at a wall"),
        (frames_from(standing(1.6, 25.0, 0.0), TABLE), "table"),
        (frames_from(standing(0.6, 15.0, 0.0)), "0.60 m below the camera"),
        (frames_from(standing(1.6, 15.0, 0.0), felt_off_rad=math.radians(15.0)), "not level by the accelerometer"),
        (
            frames_from([standing(1.6, pitch_deg, 0.0)[0] for pitch_deg in np.linspace(8.0, 24.0, 20)]),
            "stand still",
        ),
        (
            [replace(each, depth_m=np.full_like(each.depth_m, np.nan)) for each in frames_from(standing(1.6, 15, 0))],
            "found in 0 of 10 frames",
        ),
    ],
    ids=["few", "none", "wall", "table", "low", "slope", "moving", "dark"],
)  # fmt: skip
def test_what_may_be_no_floor_is_refused_with_what_to_do(frames: list[Frame], sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        calibrated_floor(frames, CAMERA, 0.0)


def test_some_frames_without_a_floor_do_no_harm() -> None:
    good = frames_from(standing(1.6, 15.0, 0.0, 16))
    bad = frames_from(standing(1.6, 15.0, 0.0, 4), (box(0.9, -5.0, 1.1, 5.0),))
    found = calibrated_floor([*good[:8], *bad, *good[8:]], CAMERA, 0.0)
    assert found.frame_count == 16
    assert found.height_m == pytest.approx(1.6, abs=0.02)

"""The simulated fisheye camera shows the same building as the depth camera beside it, and the same every time."""

from __future__ import annotations

import math
from pathlib import Path

import cv2
import numpy as np
import pytest

from device_agent.cli import main
from device_agent.simulation.building import Building
from device_agent.simulation.fisheye_sensor import FisheyeModel, head_fisheye
from device_agent.simulation.renderer import Renderer
from device_agent.simulation.sensors import NO_COLOUR_NOISE, head_camera
from navcore.errors import InputError
from navcore.geometry import world_from_camera_at
from navcore.recording import open_recording
from navcore.slam.fisheye import project, unproject

CAMERA = head_camera(320, 240)
POSE = world_from_camera_at((13.0, 6.0, 1.6), math.pi, math.radians(15))


def test_both_cameras_show_the_same_points(office_renderer: Renderer) -> None:
    fisheye = head_fisheye()
    view = office_renderer.render(CAMERA, POSE)
    v, u = np.mgrid[0 : CAMERA.height_px, 0 : CAMERA.width_px]
    rays = np.stack([(u - CAMERA.cx_px) / CAMERA.fx_px, (v - CAMERA.cy_px) / CAMERA.fy_px, np.ones_like(u)], axis=2)
    in_fisheye = fisheye.fisheye_from_camera.apply((rays * view.depth_m[:, :, None]).reshape(-1, 3))
    pixel = np.rint(project(fisheye.intrinsics, in_fisheye)).astype(int)
    grey = FisheyeModel(fisheye, 0, NO_COLOUR_NOISE).capture(office_renderer, POSE, 0.0, 0).grey
    soft = cv2.GaussianBlur(cv2.cvtColor(view.colour_rgb, cv2.COLOR_RGB2GRAY), (7, 7), 1.5).ravel()
    here = grey[pixel[:, 1], pixel[:, 0]].astype(float)
    # The lens is darker off its axis, and sees a few points that the other camera does not.
    assert np.corrcoef(soft, here)[0, 1] > 0.9
    elsewhere = grey[pixel[:, 1], np.clip(pixel[:, 0] + 12, 0, 399)].astype(float)
    assert np.corrcoef(soft, elsewhere)[0, 1] < 0.8


def test_it_sees_far_to_the_sides_and_nothing_beyond_its_circle(office_renderer: Renderer) -> None:
    fisheye = head_fisheye()
    lens = fisheye.intrinsics
    grey = FisheyeModel(fisheye, 0, NO_COLOUR_NOISE).capture(office_renderer, POSE, 0.0, 0).grey
    assert grey[lens.height_px // 2, :5].min() > 10
    assert grey[:8, :8].max() == 0
    left, right = unproject(lens, np.array([[0.0, lens.cy_px], [lens.width_px - 1.0, lens.cy_px]]))
    assert math.degrees(math.acos(float(left @ right))) > 155


def test_the_same_seed_and_number_give_the_same_picture(office_renderer: Renderer) -> None:
    first, again, other = (
        FisheyeModel(head_fisheye(320, 240), seed).capture(office_renderer, POSE, 0.0, 5, yaw_rate_rad_s=0.8).grey
        for seed in (1, 1, 2)
    )
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)


def test_a_size_that_makes_no_picture_is_refused() -> None:
    with pytest.raises(InputError, match="8×8"):
        head_fisheye(8, 8)


def test_a_walk_can_be_recorded_with_it(office: Building, tmp_path: Path) -> None:
    for name, option in (("with", ["--fisheye"]), ("without", [])):
        assert main(["sim", "record", str(tmp_path / name), "--rate-hz", "2", "--max-length-m", "0.6", *option]) == 0
    both, plain = open_recording(tmp_path / "with"), open_recording(tmp_path / "without")
    assert plain.fisheye is None
    assert both.fisheye is not None
    frames = list(zip(both.frames(), plain.frames(), strict=True))
    assert len(frames) > 2
    for frame, alone in frames:
        assert frame.fisheye is not None
        assert frame.fisheye.stamp_s == frame.stamp_s
        assert np.array_equal(frame.colour_rgb, alone.colour_rgb)
        assert np.array_equal(frame.depth_m, alone.depth_m, equal_nan=True)

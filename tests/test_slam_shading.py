"""Shading fixes what surfaces leave open, or says nothing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from slam_blank_room import CAMERA
from slam_shaded_corridor import walk

from navcore.slam.depth_alignment import align_depth
from navcore.slam.depth_model import depth_model
from navcore.slam.pace import MAX_SPEED_M_S, Pace
from navcore.slam.shading_alignment import ShadedView, align_shading, grey_grid
from navcore.types import Frame

PLACES_M = (3.0, 4.1, 5.2)


def shaded(frame: Frame) -> ShadedView:
    return ShadedView.of(depth_model(frame.depth_m, CAMERA), grey_grid(frame.colour_rgb[..., 0].copy(), CAMERA))


def darkened(frame: Frame, gain: float) -> Frame:
    """The frame by a lens that is a third darker at its corners, and another exposure."""
    v, u = np.mgrid[0 : CAMERA.height_px, 0 : CAMERA.width_px]
    off2 = ((u - CAMERA.cx_px) / CAMERA.fx_px) ** 2 + ((v - CAMERA.cy_px) / CAMERA.fy_px) ** 2
    return replace(frame, colour_rgb=(frame.colour_rgb * (gain * (1.0 - 0.5 * off2))[..., None]).astype(np.uint8))


def pair(begin_m: float, *, lamps: bool) -> tuple[Frame, Frame, np.ndarray]:
    """Two frames 0.24 m apart, and the true pose of the second in the first (4, 4)."""
    walked = walk(begin_m, begin_m + 0.3, lamps=lamps, seed=1)
    (first, first_pose), (second, second_pose) = walked[0], walked[3]
    return first, second, second_pose @ np.linalg.inv(first_pose)


def along_error_m(first: Frame, second: Frame, truth: np.ndarray, off_m: float) -> float | None:
    """Error along the corridor after an alignment that was begun ``off_m`` away; None where nothing is said."""
    guess = truth.copy()
    guess[2, 3] += off_m
    one, other = shaded(first), shaded(second)
    surfaces = align_depth(one.model, other.model, guess)
    assert surfaces is not None
    assert len(surfaces.free_directions) == 1
    found = align_shading(one, other, surfaces.camera_from_reference, surfaces.free_directions)
    return None if found is None else float((found.camera_from_reference - truth)[2, 3])


@pytest.mark.parametrize("off_m", [-0.1, 0.0, 0.1])
@pytest.mark.parametrize("begin_m", PLACES_M)
def test_the_light_of_lamps_fixes_the_way_along_a_corridor(begin_m: float, off_m: float) -> None:
    error_m = along_error_m(*pair(begin_m, lamps=True), off_m)
    assert error_m is None or abs(error_m) < 0.06


def test_it_mostly_says_something() -> None:
    errors = [along_error_m(*pair(begin_m, lamps=True), 0.05) for begin_m in (2.6, *PLACES_M, 5.8)]
    assert sum(error is not None for error in errors) >= 3


@pytest.mark.parametrize("begin_m", PLACES_M)
def test_a_lens_that_is_darker_at_its_corners_does_not_say_that_nobody_moves(begin_m: float) -> None:
    first, second, truth = pair(begin_m, lamps=True)
    error_m = along_error_m(darkened(first, 0.9), darkened(second, 0.8), truth, 0.05)
    assert error_m is None or abs(error_m) < 0.1


@pytest.mark.parametrize("darkening", [False, True])
@pytest.mark.parametrize("begin_m", PLACES_M)
def test_even_light_says_nothing(begin_m: float, darkening: bool) -> None:
    first, second, truth = pair(begin_m, lamps=False)
    if darkening:
        first, second = darkened(first, 0.9), darkened(second, 0.9)
    assert along_error_m(first, second, truth, 0.05) is None


def test_pace_is_the_mean_velocity_and_never_faster_than_a_walker() -> None:
    pace = Pace()
    assert not pace.is_known
    assert not pace.velocity_m_s.any()
    for number in range(30):
        pose = np.eye(4)
        pose[0, 3] = -0.09 * number + (0.02 if number % 2 else -0.02)
        pace.note(0.1 * number, pose)
    assert pace.velocity_m_s[0] == pytest.approx(0.9, abs=0.06)
    carried = pace.carried_on(np.eye(4), 0.5, np.eye(3))
    assert carried[0, 3] == pytest.approx(-0.45, abs=0.03)
    far = np.eye(4)
    far[0, 3] = -50.0
    pace.note(3.0, far)
    assert np.linalg.norm(pace.velocity_m_s) <= MAX_SPEED_M_S + 1e-9
    pace.forget()
    assert not pace.is_known

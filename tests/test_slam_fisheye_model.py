"""The fisheye model agrees with OpenCV's, with finite differences, and with itself, also beside and behind the lens."""

from __future__ import annotations

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from navcore.errors import InputError
from navcore.slam.fisheye import project, projection_jacobian, unproject
from navcore.types import FisheyeIntrinsics

LENS = FisheyeIntrinsics(400, 380, 140.0, 138.0, 201.3, 188.2, 0.02, -0.011, 0.003, -0.0006, math.radians(100.0))


def points_within(angle_rad: float, count: int = 300, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    theta, phi = rng.uniform(0.0, angle_rad, count), rng.uniform(-math.pi, math.pi, count)
    rays = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=1)
    return rays * rng.uniform(0.2, 20.0, count)[:, None]


def test_agrees_with_opencv_in_front_of_the_lens() -> None:
    points = points_within(math.radians(85.0))
    matrix = np.array([[LENS.fx_px, 0.0, LENS.cx_px], [0.0, LENS.fy_px, LENS.cy_px], [0.0, 0.0, 1.0]])
    expected, _ = cv2.fisheye.projectPoints(
        points.reshape(-1, 1, 3), np.zeros(3), np.zeros(3), matrix, np.array(LENS.distortion)
    )
    np.testing.assert_allclose(project(LENS, points), expected[:, 0], atol=1e-8)


def test_rays_lead_back_to_their_points_even_behind_the_lens() -> None:
    points = points_within(LENS.max_angle_rad - 1e-6)
    assert np.any(points[:, 2] < 0)
    directions = points / np.linalg.norm(points, axis=1)[:, None]
    np.testing.assert_allclose(unproject(LENS, project(LENS, points)), directions, atol=1e-9)


def test_jacobian_agrees_with_finite_differences() -> None:
    points = np.concatenate([points_within(LENS.max_angle_rad - 0.01, 200), [[0.0, 0.0, 2.0], [1e-7, 0.0, 3.0]]])
    analytic = projection_jacobian(LENS, points)
    for axis in range(3):
        step = np.zeros(3)
        step[axis] = 1e-6
        numeric = (project(LENS, points + step) - project(LENS, points - step)) / 2e-6
        np.testing.assert_allclose(analytic[:, :, axis], numeric, rtol=1e-5, atol=1e-4)


def test_what_the_lens_does_not_show_has_no_pixel() -> None:
    behind = np.array([[0.0, 0.0, -1.0], [0.1, 0.0, -1.0], [0.0, 0.0, 0.0]])
    assert np.isnan(project(LENS, behind)).all()
    assert np.isnan(projection_jacobian(LENS, behind)).all()
    assert np.isnan(unproject(LENS, np.array([[-400.0, -400.0]]))).all()


@given(
    k=st.tuples(*(st.floats(-bound, bound) for bound in (0.05, 0.01, 0.002, 0.0003))),
    theta=st.floats(1e-4, 1.5),
    phi=st.floats(-3.1, 3.1),
)
def test_every_lens_that_is_accepted_can_be_inverted(
    k: tuple[float, float, float, float], theta: float, phi: float
) -> None:
    try:
        lens = replace(LENS, k1=k[0], k2=k[1], k3=k[2], k4=k[3], max_angle_rad=1.55)
    except InputError:
        return
    ray = np.array([[math.sin(theta) * math.cos(phi), math.sin(theta) * math.sin(phi), math.cos(theta)]])
    np.testing.assert_allclose(unproject(lens, project(lens, ray)), ray, atol=1e-7)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"fx_px": 0.0}, "fx"),
        ({"fy_px": 1e6}, "fy"),
        ({"cx_px": 400.0}, "optical axis"),
        ({"k1": math.nan}, "not finite"),
        ({"k1": -0.5}, "fold"),
        ({"max_angle_rad": 4.0}, "off its axis"),
        ({"width_px": 3}, "too small"),
    ],
)
def test_numbers_that_no_lens_has_are_refused(change: dict[str, float], message: str) -> None:
    with pytest.raises(InputError, match=message):
        replace(LENS, **change)

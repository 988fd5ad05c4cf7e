"""Laws of angles and rigid transforms."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from navcore.angles import in_world, relative_angle, relative_to, world_angle, wrap_rad
from navcore.geometry import (
    Transform,
    heading_of_camera,
    quat_xyzw_from_rotation,
    rotation_from_quat_xyzw,
    rotation_from_rotvec,
    world_from_camera_at,
)

angles = st.floats(-1e4, 1e4)
vectors = st.tuples(*[st.floats(-3, 3)] * 3).map(np.array)
transforms = st.builds(Transform.from_rotation_translation, vectors.map(rotation_from_rotvec), vectors)


@given(angles)
def test_wrapping_keeps_the_direction_and_its_range(angle: float) -> None:
    wrapped = wrap_rad(angle)
    assert -math.pi < wrapped <= math.pi
    assert math.cos(wrapped) == pytest.approx(math.cos(angle), abs=1e-9)
    assert math.sin(wrapped) == pytest.approx(math.sin(angle), abs=1e-9)
    assert 0 <= world_angle(angle) < math.tau


def test_wrapping_at_the_seam() -> None:
    assert wrap_rad(-math.pi) == math.pi
    assert wrap_rad(math.pi) == math.pi
    assert world_angle(-1e-20) == 0.0


@given(angles, angles, angles)
def test_relative_direction_does_not_change_when_the_world_turns(direction: float, heading: float, turn: float) -> None:
    plain = relative_to(world_angle(direction), world_angle(heading))
    turned = relative_to(world_angle(direction + turn), world_angle(heading + turn))
    assert math.cos(plain - turned) == pytest.approx(1.0, abs=1e-9)


@given(angles, angles)
def test_in_world_undoes_relative_to(direction: float, heading: float) -> None:
    back = in_world(relative_to(world_angle(direction), world_angle(heading)), world_angle(heading))
    assert math.cos(back - direction) == pytest.approx(1.0, abs=1e-9)


def test_350_degrees_against_10_is_20_to_the_right() -> None:
    assert relative_to(world_angle(math.radians(350)), world_angle(math.radians(10))) == pytest.approx(
        -math.radians(20)
    )
    assert relative_angle(3 * math.pi) == pytest.approx(math.pi)


@given(transforms, transforms, transforms)
def test_transforms_are_a_group(a: Transform, b: Transform, c: Transform) -> None:
    np.testing.assert_allclose(((a @ b) @ c).matrix, (a @ (b @ c)).matrix, atol=1e-9)
    np.testing.assert_allclose((a @ a.inverse()).matrix, np.eye(4), atol=1e-9)
    np.testing.assert_allclose(a.rotation @ a.rotation.T, np.eye(3), atol=1e-9)


@given(transforms, vectors)
def test_composition_applies_the_right_one_first(a: Transform, point: np.ndarray) -> None:
    b = world_from_camera_at((1.0, -2.0, 1.6), 0.7, 0.2)
    np.testing.assert_allclose((a @ b).apply(point), a.apply(b.apply(point)), atol=1e-9)


@given(transforms)
def test_quaternions_come_back_as_the_same_rotation(a: Transform) -> None:
    quat = quat_xyzw_from_rotation(a.rotation)
    assert quat[3] >= 0
    np.testing.assert_allclose(rotation_from_quat_xyzw(quat), a.rotation, atol=1e-9)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_quaternion_of_half_a_turn(axis: int) -> None:
    rotvec = np.zeros(3)
    rotvec[axis] = math.pi
    rotation = rotation_from_rotvec(rotvec)
    np.testing.assert_allclose(rotation_from_quat_xyzw(quat_xyzw_from_rotation(rotation)), rotation, atol=1e-9)


def test_no_rotation_from_an_empty_quaternion() -> None:
    with pytest.raises(ValueError, match="length zero"):
        rotation_from_quat_xyzw(np.zeros(4))
    with pytest.raises(ValueError, match="4×4"):
        Transform(np.eye(3))


@given(st.floats(0, 6.28), st.floats(-1.2, 1.2), st.floats(-0.5, 0.5))
def test_heading_is_the_optical_axis_on_the_floor(heading: float, pitch: float, roll: float) -> None:
    pose = world_from_camera_at((0, 0, 1.6), heading, pitch, roll)
    assert math.cos(heading_of_camera(pose) - heading) == pytest.approx(1.0, abs=1e-9)
    assert np.linalg.det(pose.rotation) == pytest.approx(1.0)


def test_camera_axes_in_the_world() -> None:
    """Looking along +x and 30° down: image-right is −y, and the optical axis falls."""
    pose = world_from_camera_at((0, 0, 1.6), 0.0, math.radians(30))
    np.testing.assert_allclose(pose.rotation @ [1, 0, 0], [0, -1, 0], atol=1e-12)
    np.testing.assert_allclose(pose.rotation @ [0, 0, 1], [math.cos(math.pi / 6), 0, -0.5], atol=1e-12)


@pytest.mark.parametrize("pitch", [math.pi / 2, -math.pi / 2])
def test_heading_of_a_camera_that_looks_straight_down_or_up(pitch: float) -> None:
    assert math.cos(heading_of_camera(world_from_camera_at((0, 0, 1.6), 1.0, pitch)) - 1.0) == pytest.approx(
        1.0, abs=1e-9
    )

"""The trajectory error does not depend on where the world's origin is, and measures what differs."""

import numpy as np
import pytest

from navcore.errors import InputError
from navcore.evaluation import absolute_trajectory_error, align_rigidly
from navcore.geometry import Transform, rotation_from_rotvec


def _walk() -> tuple[np.ndarray, np.ndarray]:
    stamps = np.linspace(0.0, 10.0, 101)
    return stamps, np.stack([np.cos(stamps), np.sin(1.3 * stamps), 0.1 * stamps], axis=1)


def test_a_moved_world_is_no_error() -> None:
    stamps, positions = _walk()
    other = Transform.from_rotation_translation(
        rotation_from_rotvec(np.array([0.3, -2.0, 0.5])), np.array([4.0, -3, 1])
    )
    error = absolute_trajectory_error(stamps, other.apply(positions), stamps, positions)
    assert error.rmse_m == pytest.approx(0.0, abs=1e-9)
    assert error.compared_count == 101
    np.testing.assert_allclose(
        align_rigidly(positions, other.apply(positions)).matrix, other.inverse().matrix, atol=1e-9
    )


def test_scale_is_an_error_and_a_mirror_is_too() -> None:
    stamps, positions = _walk()
    assert absolute_trajectory_error(stamps, 1.1 * positions, stamps, positions).rmse_m > 0.05
    assert absolute_trajectory_error(stamps, positions * [1, 1, -1], stamps, positions).rmse_m > 0.1


def test_what_lies_outside_the_truth_is_left_out() -> None:
    stamps, positions = _walk()
    error = absolute_trajectory_error(stamps, positions, stamps[20:80], positions[20:80])
    assert error.compared_count == 60
    with pytest.raises(InputError, match="Fewer than three"):
        absolute_trajectory_error(stamps + 100.0, positions, stamps, positions)

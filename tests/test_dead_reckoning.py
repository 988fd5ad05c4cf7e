"""A pose carried on between two frames: right for steady movement, and no guess where it would be one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from navcore.geometry import Transform, world_from_camera_at
from navcore.slam.dead_reckoning import MAX_STEP_S, carried_on
from navcore.slam.localizer import MAX_UNMATCHED_S
from navcore.types import Localization, LocalizationQuality

SURE = LocalizationQuality.LOCALIZED


def at(stamp_s: float, x_m: float = 0.0, heading_rad: float = 0.0, quality: LocalizationQuality = SURE) -> Localization:
    pose = world_from_camera_at((x_m, 0.5, 1.6), heading_rad, 0.2)
    return Localization(stamp_s, quality, pose, np.eye(6) * 1e-4, 200)


@settings(deadline=None)  # The first call loads kernels.
@given(st.floats(-1.5, 1.5), st.floats(-2.0, 2.0), st.floats(0.02, 0.14), st.floats(0.02, 0.3))
def test_steady_movement_is_carried_on_exactly(v_m_s: float, turn_rad_s: float, ahead_s: float, step_s: float) -> None:
    before = at(10.0)
    rate = step_s + ahead_s
    last = at(10.0 + step_s, 0.0, turn_rad_s * step_s)
    turned = carried_on(before, last, last.stamp_s + ahead_s)
    assert turned is not None
    expected = world_from_camera_at((0.0, 0.5, 1.6), turn_rad_s * rate, 0.2)
    assert turned.world_from_camera is not None
    np.testing.assert_allclose(turned.world_from_camera.matrix, expected.matrix, atol=1e-9)
    gone = carried_on(before, at(10.0 + step_s, v_m_s * step_s), 10.0 + rate)
    assert gone is not None
    assert gone.world_from_camera is not None
    np.testing.assert_allclose(gone.world_from_camera.translation, (v_m_s * rate, 0.5, 1.6), atol=1e-9)


def test_it_says_that_it_is_less_sure_and_has_seen_nothing() -> None:
    last = at(10.1, 0.08)
    short, long = (carried_on(at(10.0), last, 10.1 + ahead_s) for ahead_s in (0.03, 0.1))
    assert short is not None
    assert long is not None
    assert short.quality is SURE
    assert (short.stamp_s, short.inlier_count) == (10.1 + 0.03, 0)
    variances = [np.diag(each.covariance) for each in (last, short, long) if each.covariance is not None]
    assert np.all(np.diff(variances, axis=0) > 0)


@pytest.mark.parametrize(
    ("before", "last", "stamp_s"),
    [
        (at(10.0), at(10.1), 10.1),
        (at(10.0), at(10.1), 10.05),
        (at(10.0), at(10.1), 10.1 + MAX_UNMATCHED_S + 0.01),
        (at(10.0), at(10.0 + MAX_STEP_S + 0.01), 10.5),
        (at(10.1), at(10.1), 10.15),
        (at(10.0), at(10.1, 1.0), 10.15),
        (at(10.0), at(10.1, quality=LocalizationQuality.UNCERTAIN), 10.15),
        (at(10.0, quality=LocalizationQuality.UNCERTAIN), at(10.1), 10.15),
        (Localization(10.0, LocalizationQuality.LOST, None), at(10.1), 10.15),
        (at(10.0), replace(at(10.1), covariance=None), 10.15),
        (at(10.0), replace(at(10.1), world_from_camera=None), 10.15),
    ],
)
def test_where_it_would_be_a_guess_there_is_none(before: Localization, last: Localization, stamp_s: float) -> None:
    assert carried_on(before, last, stamp_s) is None


def test_the_poses_that_it_is_given_stay_as_they_are() -> None:
    before, last = at(10.0), at(10.1, 0.1)
    kept = Transform(np.array(last.world_from_camera.matrix)) if last.world_from_camera else None
    carried_on(before, last, 10.2)
    assert kept is not None
    assert last.world_from_camera is not None
    np.testing.assert_array_equal(last.world_from_camera.matrix, kept.matrix)

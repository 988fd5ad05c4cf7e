"""A pose carried on between two frames: right for steady movement, and no guess where it would be one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from navcore.geometry import Transform, world_from_camera_at
from navcore.slam.dead_reckoning import MAX_STEP_S, carried_on, reckoned
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


# ------------------------------------------------------------------------------------------- without an answer
HELD_S = 0.5


@settings(deadline=None)
@given(st.floats(0.0, 1.2), st.floats(-1.0, 1.0))
def test_the_longer_without_an_answer_the_less_is_known(v_m_s: float, turn_rad_s: float) -> None:
    found = (at(10.0), at(10.1, 0.1 * v_m_s, 0.1 * turn_rad_s))
    poses = [reckoned(found, 10.1 + 0.01 * number, HELD_S) for number in range(1, 70)]
    order = [SURE, LocalizationQuality.UNCERTAIN, LocalizationQuality.LOST]
    ranks = [order.index(pose.quality) for pose in poses]
    assert ranks == sorted(ranks)
    assert [ranks.count(rank) for rank in (0, 1)] == [pytest.approx(15, abs=1), pytest.approx(35, abs=1)]
    known = [pose for pose in poses if pose.covariance is not None]
    assert all(pose.inlier_count == 0 for pose in known)
    spreads = [float(np.trace(pose.covariance)) for pose in known if pose.covariance is not None]
    assert np.all(np.diff(spreads) > 0)
    places = [pose.world_from_camera.translation for pose in known if pose.world_from_camera is not None]
    assert len(places) == len(known)
    assert np.max(np.linalg.norm(np.diff(places, axis=0), axis=1), initial=0.0) <= 0.0101 * v_m_s + 1e-6
    lost = poses[-1]
    assert (lost.quality, lost.world_from_camera, lost.covariance) == (LocalizationQuality.LOST, None, None)


@pytest.mark.parametrize(
    ("found", "stamp_s"),
    [
        ((), 10.0),
        ((Localization(10.0, LocalizationQuality.LOST, None),), 10.1),
        ((at(10.0), Localization(10.1, LocalizationQuality.LOST, None)), 10.15),
        ((at(10.0), replace(at(10.1), covariance=None)), 10.15),
        ((at(10.0), at(10.1)), 10.05),
        ((at(10.0), at(10.1)), 10.1 + HELD_S + 0.01),
    ],
)
def test_without_a_pose_before_nothing_is_known(found: tuple[Localization, ...], stamp_s: float) -> None:
    reckoning = reckoned(found, stamp_s, HELD_S)
    assert (reckoning.quality, reckoning.stamp_s) == (LocalizationQuality.LOST, stamp_s)


def test_a_single_or_an_uncertain_pose_is_held_and_never_sure() -> None:
    for found in ((at(10.1),), (at(10.0), at(10.1, 0.08, quality=LocalizationQuality.UNCERTAIN))):
        held = reckoned(found, 10.15, HELD_S)
        assert held.quality is LocalizationQuality.UNCERTAIN
        assert held.world_from_camera is found[-1].world_from_camera

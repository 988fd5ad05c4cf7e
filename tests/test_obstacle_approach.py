"""What comes towards the walker is told from what stands, whoever moves; it only ever closes directions."""

from __future__ import annotations

import math

import numpy as np
import pytest
from closed_loop import CAMERA, EYE_M, PITCH_RAD, box, depth_image

from navcore.angles import world_angle
from navcore.geometry import world_from_camera_at
from navcore.obstacle.approach import RecentScans, anticipated, closing_speed_m_s, with_scan
from navcore.obstacle.scan import scan
from navcore.settings import ObstacleSettings
from navcore.types import Pose2D

SETTINGS = ObstacleSettings()
WALLS = (box(-2, 1.2, 12, 1.4), box(-2, -1.4, 12, -1.2), box(9, -1.2, 9.2, 1.2))
STEP_S = 0.1


def person(x_m: float, y_m: float):
    return box(x_m - 0.15, y_m - 0.25, x_m + 0.15, y_m + 0.25, 1.7)


def watched(
    moving_at, *, walker_m_s: float = 0.0, turn_deg_s: float = 0.0, frames: int = 12, standing=(), seed: int = 0,
    shaken_m: float = 0.02,
) -> RecentScans:  # fmt: skip
    """Scans of somebody who walks along +x among walls; ``moving_at(t)`` gives where another person is, or None."""
    rng, recent = np.random.default_rng(seed), ()
    for k in range(frames):
        now_s = k * STEP_S
        heading = math.radians(turn_deg_s * now_s)
        where = (walker_m_s * now_s, 0.0, EYE_M)
        place = moving_at(now_s)
        solids = (*WALLS, *standing, *(() if place is None else (person(*place),)))
        truth = world_from_camera_at(where, heading, PITCH_RAD)
        shaken = rng.normal(0.0, shaken_m, 2)
        believed = (where[0] + shaken[0], where[1] + shaken[1], EYE_M)
        seen = scan(
            depth_image(solids, truth, rng), CAMERA, world_from_camera_at(believed, heading, PITCH_RAD), SETTINGS
        )
        pose = Pose2D(believed[0], believed[1], world_angle(heading))
        recent = with_scan(recent, seen, pose, now_s)
    return recent


@pytest.mark.parametrize("walker_m_s", [0.0, 0.9])
@pytest.mark.parametrize("person_m_s", [0.6, 1.0, 1.5])
def test_somebody_who_comes_is_heard_of_with_their_own_speed(person_m_s: float, walker_m_s: float) -> None:
    recent = watched(lambda t: (5.0 - person_m_s * t, 0.0), walker_m_s=walker_m_s)
    speed = closing_speed_m_s(recent)
    ahead = np.abs(recent[-1].scan.bearing_rad) < math.radians(3.0)
    assert np.median(speed[ahead]) == pytest.approx(person_m_s, abs=0.2)
    assert not speed[np.abs(recent[-1].scan.bearing_rad) > math.radians(20.0)].any()


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("turn_deg_s", [0.0, 40.0, -40.0])
@pytest.mark.parametrize("walker_m_s", [0.0, 1.1])
def test_what_stands_does_not_come_however_the_walker_moves(walker_m_s: float, turn_deg_s: float, seed: int) -> None:
    standing = (person(4.0, 0.5), box(3, -1.2, 3.5, -0.8, 0.5))
    recent = watched(
        lambda _: None, walker_m_s=walker_m_s, turn_deg_s=turn_deg_s, standing=standing, seed=seed, frames=8
    )
    assert not closing_speed_m_s(recent).any()


@pytest.mark.parametrize("speed_m_s", [0.8, 1.2])
def test_somebody_who_goes_away_or_crosses_does_not_come(speed_m_s: float) -> None:
    away = closing_speed_m_s(watched(lambda t: (2.0 + speed_m_s * t, 0.0)))
    assert not away.any()
    crossing = closing_speed_m_s(watched(lambda t: (3.0, -0.9 + speed_m_s * t)))
    assert crossing.max(initial=0.0) < 0.4


@pytest.mark.parametrize("speed_m_s", [3.0, 4.0])
def test_a_runner_comes_as_fast_as_is_told_at_most(speed_m_s: float) -> None:
    recent = watched(lambda t: (7.4 - speed_m_s * t, 0.0))
    speed = closing_speed_m_s(recent)
    ahead = np.abs(recent[-1].scan.bearing_rad) < math.radians(3.0)
    assert np.median(speed[ahead]) == pytest.approx(2.5)


def test_what_comes_counts_as_being_where_it_will_be() -> None:
    recent = watched(lambda t: (4.6 - 1.0 * t, 0.0))
    now = recent[-1].scan
    later = anticipated(now, closing_speed_m_s(recent), SETTINGS)
    assert now.nearest_ahead_m is not None
    assert later.nearest_ahead_m == pytest.approx(now.nearest_ahead_m - SETTINGS.approach_horizon_s, abs=0.25)
    free = {round(each.angle, 3): each.clearance_m for each in now.candidates}
    assert all(each.clearance_m <= free[round(each.angle, 3)] + 1e-9 for each in later.candidates)
    assert later.nearest_m[np.isfinite(later.nearest_m)].min() >= 0.0


def test_a_scan_without_a_past_and_one_of_nothing_tell_nothing() -> None:
    recent = watched(lambda t: (4.0 - t, 0.0), frames=2)
    assert not closing_speed_m_s(recent).any()
    assert closing_speed_m_s(()).shape == (0,)
    assert anticipated(recent[-1].scan, closing_speed_m_s(recent), SETTINGS).candidates == recent[-1].scan.candidates


def test_only_the_last_moments_are_kept_and_a_clock_that_jumps_begins_anew() -> None:
    recent = watched(lambda _: None, frames=20)
    assert len(recent) <= 11
    back = with_scan(recent, recent[-1].scan, recent[-1].pose, 0.0)
    assert [each.stamp_s for each in back] == [0.0]

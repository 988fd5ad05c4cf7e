"""Doing less by plan: laws of the levels, over many walks of work times."""

from __future__ import annotations

import itertools

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from device_agent.load_plan import (
    CALM_COUNT,
    CALM_FRACTION,
    LATE_COUNT,
    LONGEST_CALM_COUNT,
    LoadLevel,
    LoadPlan,
    after_cycle,
)

BUDGET_S = 0.06
LEVELS = list(LoadLevel)


def after(plan: LoadPlan, work_s: float, count: int) -> LoadPlan:
    for _ in range(count):
        plan = after_cycle(plan, work_s, BUDGET_S)
    return plan


def test_nothing_is_left_out_by_a_device_that_is_in_time() -> None:
    assert after(LoadPlan(), BUDGET_S, 1000).level is LoadLevel.FULL


def test_a_pose_that_is_late_counts_as_a_late_cycle_and_never_as_a_calm_one() -> None:
    plan = LoadPlan()
    for _ in range(LATE_COUNT):
        plan = after_cycle(plan, 0.0, BUDGET_S, pose_late=True)
    assert plan.level is LoadLevel.FEWER_FEATURES
    calm = after(plan, 0.0, plan.calm_wanted_count - 1)
    assert after_cycle(calm, 0.0, BUDGET_S, pose_late=True).level is LoadLevel.FEWER_FEATURES
    assert after_cycle(calm, 0.0, BUDGET_S).level is LoadLevel.FULL


def test_a_single_late_cycle_now_and_then_changes_nothing() -> None:
    plan = LoadPlan()
    for _ in range(200):
        plan = after(after(plan, 10 * BUDGET_S, 1), 0.9 * BUDGET_S, 1)
    assert plan.level is LoadLevel.FULL


def test_late_cycles_lead_down_one_level_after_the_other_and_no_farther_than_the_last() -> None:
    plan, reached = LoadPlan(), []
    for _ in range(4 * LATE_COUNT):
        plan = after(plan, 1.01 * BUDGET_S, 1)
        reached.append(plan.level)
    assert reached[LATE_COUNT - 2 :: LATE_COUNT][:3] == LEVELS
    assert reached[-1] is LoadLevel.HALF_RATE


def test_calm_leads_back_and_not_quite_calm_does_not() -> None:
    low = after(LoadPlan(), 2 * BUDGET_S, 2 * LATE_COUNT)
    assert low.level is LoadLevel.HALF_RATE
    assert after(low, 1.01 * CALM_FRACTION * BUDGET_S, 5000).level is LoadLevel.HALF_RATE
    assert after(low, CALM_FRACTION * BUDGET_S, low.calm_wanted_count - 1).level is LoadLevel.HALF_RATE
    assert after(low, CALM_FRACTION * BUDGET_S, low.calm_wanted_count).level is LoadLevel.FEWER_FEATURES
    assert after(low, CALM_FRACTION * BUDGET_S, 2 * low.calm_wanted_count).level is LoadLevel.FULL


def test_a_device_that_is_late_whenever_it_does_more_tries_that_ever_more_rarely() -> None:
    plan, changes = LoadPlan(), []
    for number in range(30_000):
        work_s = 1.1 * BUDGET_S if plan.level is LoadLevel.FULL else 0.5 * BUDGET_S
        following = after_cycle(plan, work_s, BUDGET_S)
        if following.level is not plan.level:
            changes.append(number)
        plan = following
    assert len(changes) < 30
    tried = changes[1::2]
    assert tried[-1] - tried[-2] >= LONGEST_CALM_COUNT
    assert np.all(np.diff(tried, 2) >= 0)


def test_what_went_wrong_long_ago_is_forgotten() -> None:
    plan = after(after(LoadPlan(), 2 * BUDGET_S, LATE_COUNT), 0.0, 20_000)
    assert plan.level is LoadLevel.FULL
    assert plan.calm_wanted_count == CALM_COUNT


@given(st.lists(st.floats(0.0, 3.0), max_size=300))
def test_levels_change_one_by_one_and_never_at_once_back_and_forth(shares: list[float]) -> None:
    plan, changed = LoadPlan(), [-LATE_COUNT]
    for number, share in enumerate(shares):
        following = after_cycle(plan, share * BUDGET_S, BUDGET_S)
        step = LEVELS.index(following.level) - LEVELS.index(plan.level)
        assert abs(step) <= 1
        assert 0 <= following.late_count <= LATE_COUNT
        if step > 0:
            assert share > 1.0
        if step < 0:
            assert share <= CALM_FRACTION
            assert number - changed[-1] >= CALM_COUNT
        if step:
            changed.append(number)
        plan = following
    assert all(later - earlier >= LATE_COUNT for earlier, later in itertools.pairwise(changed))

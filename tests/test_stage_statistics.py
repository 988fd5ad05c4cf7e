"""How long the stages take: percentiles of the newest cycles, and what was late, in bounded memory."""

from __future__ import annotations

import numpy as np

from device_agent.stage_statistics import RECENT_COUNT, STAGES, StageStatistics, StageTimes, as_text
from navcore.settings import DeadlineSettings

DEADLINES = DeadlineSettings()


def times(localize_s: float) -> StageTimes:
    return StageTimes(0.01, localize_s, 0.002, 0.001, 0.003, 0.016 + localize_s)


def test_there_is_nothing_to_tell_before_the_first_cycle() -> None:
    assert StageStatistics().summaries() == ()


def test_percentiles_are_those_of_the_newest_the_longest_and_the_late_of_all() -> None:
    rng = np.random.default_rng(1)
    taken_s = [5.0, *rng.uniform(0.001, 2 * DEADLINES.localize_s, 3 * RECENT_COUNT + 17)]
    statistics = StageStatistics()
    for each in taken_s:
        statistics.note(times(float(each)), DEADLINES)
    by_stage = {each.stage: each for each in statistics.summaries()}
    assert tuple(by_stage) == STAGES
    localize, newest_ms = by_stage["localize"], 1000.0 * np.array(taken_s[-RECENT_COUNT:])
    assert localize.p50_ms == round(float(np.percentile(newest_ms, 50)), 2)
    assert localize.p99_ms == round(float(np.percentile(newest_ms, 99)), 2)
    assert localize.max_ms == 5000.0
    assert localize.missed_count == sum(each > DEADLINES.localize_s for each in taken_s)
    assert by_stage["cue"].missed_count == 0
    assert "localize" in as_text(statistics.summaries())
    assert f"({localize.missed_count} late)" in as_text(statistics.summaries())


def test_each_stage_has_a_deadline_among_the_settings() -> None:
    for stage in STAGES:
        late = StageTimes(*(10.0 if name == stage else 0.0 for name in STAGES))
        statistics = StageStatistics()
        statistics.note(late, DEADLINES)
        assert [each.stage for each in statistics.summaries() if each.missed_count] == [stage]

"""How long the stages take, and how often each is later than its deadline: bounded, whatever the length of the walk."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields

import numpy as np

from navcore.settings import DeadlineSettings
from navcore.wire import StageSummary

RECENT_COUNT = 512
"""Percentiles are those of so many cycles, the newest."""


@dataclass(frozen=True, slots=True)
class StageTimes:
    """What one cycle took, seconds; the names are those of the deadlines' settings."""

    capture_s: float
    """Age of the frame when the loop takes it: exposure, driver, and waiting for the loop."""
    localize_s: float
    guide_s: float
    """Planning, scan and guidance."""
    cue_s: float
    """Choosing the cues and handing them to the output."""
    hand_off_s: float
    """Handing over to watchdog, screen, link and recorder."""
    capture_to_cue_s: float


STAGES = tuple(each.name.removesuffix("_s") for each in fields(StageTimes))


class StageStatistics:
    """Collects the times of cycles. One thread notes; nothing grows."""

    def __init__(self) -> None:
        self._recent_ms = np.zeros((RECENT_COUNT, len(STAGES)))
        self._max_ms = np.zeros(len(STAGES))
        self._missed = np.zeros(len(STAGES), np.int64)
        self.cycle_count = 0
        """Cycles noted."""

    def note(self, times: StageTimes, deadlines: DeadlineSettings, *, pose_late: bool = False) -> None:
        """Take the times of a cycle; with ``pose_late`` localization took longer than it was waited for."""
        taken_s = np.array([getattr(times, f"{stage}_s") for stage in STAGES])
        self._recent_ms[self.cycle_count % RECENT_COUNT] = 1000.0 * taken_s
        self._max_ms = np.maximum(self._max_ms, 1000.0 * taken_s)
        missed = taken_s > [getattr(deadlines, f"{stage}_s") for stage in STAGES]
        missed[STAGES.index("localize")] |= pose_late
        self._missed += missed
        self.cycle_count += 1

    def summaries(self) -> tuple[StageSummary, ...]:
        """Return a summary of each stage; none before the first cycle."""
        if self.cycle_count == 0:
            return ()
        recent_ms = self._recent_ms[: self.cycle_count]
        p50_ms, p99_ms = np.percentile(recent_ms, (50.0, 99.0), axis=0)
        return tuple(
            StageSummary(stage, round(float(p50), 2), round(float(p99), 2), round(float(longest), 2), int(missed))
            for stage, p50, p99, longest, missed in zip(STAGES, p50_ms, p99_ms, self._max_ms, self._missed, strict=True)
        )


def as_text(summaries: Iterable[StageSummary]) -> str:
    """Return a line for the log: median/99th percentile/longest of each stage, milliseconds, and what was too late."""
    parts = [
        f"{each.stage} {each.p50_ms:.0f}/{each.p99_ms:.0f}/{each.max_ms:.0f}"
        + (f" ({each.missed_count} late)" if each.missed_count else "")
        for each in summaries
    ]
    return "ms p50/p99/max: " + ", ".join(parts)

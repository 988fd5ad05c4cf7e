"""Watches how long the loop's cycles take, tells of it, and plans what is left out where they take too long."""

from __future__ import annotations

import logging
import math

from device_agent.cycle import Cycle
from device_agent.load_plan import LoadLevel, LoadPlan, after_cycle
from device_agent.stage_statistics import StageStatistics, StageTimes, as_text
from navcore.settings import DeadlineSettings
from navcore.types import LocalizationQuality
from navcore.wire import StageSummary

LOG_EVERY_S = 60.0
_SUMMARY_EVERY_S = 1.0
_GUIDE = ("plan", "scan", "guide")
_log = logging.getLogger(__name__)


class LoopMonitor:
    """Fed by the loop's thread after each cycle."""

    def __init__(self, *, plans: bool) -> None:
        """``plans`` is False where time does not pass by this machine's speed: nothing is left out then."""
        self._plans = plans
        self._plan = LoadPlan()
        self._statistics = StageStatistics()
        self._logged_s = self._summed_s = -math.inf
        self._logged_missed_count = 0
        self.newest: StageTimes | None = None
        """What the newest cycle that was located took."""
        self.summaries: tuple[StageSummary, ...] = ()
        """What the stages took, renewed once a second."""

    @property
    def level(self) -> LoadLevel:
        """What the next cycle shall do."""
        return self._plan.level

    def note(self, cycle: Cycle, cued_s: float, hand_off_s: float, deadlines: DeadlineSettings) -> None:
        """Take a cycle whose cues were handed over at ``cued_s``, by the clock of its stamp.

        One without a frame, or without localization, says nothing of how long the others take.
        """
        located = cycle.localization
        if cycle.frame is None or located is None:
            return
        work_s = cycle.work_ms / 1000.0
        age_s = cued_s - cycle.stamp_s
        took_s = {stage: took_ms / 1000.0 for stage, took_ms in cycle.stage_ms.items()}
        times = StageTimes(
            max(0.0, age_s - work_s), took_s.get("localize", 0.0), sum(took_s.get(stage, 0.0) for stage in _GUIDE),
            took_s.get("cues", 0.0), hand_off_s, age_s,
        )  # fmt: skip
        self.newest = times
        self._statistics.note(times, deadlines, pose_late=cycle.pose_late)
        self._tell(cued_s)
        if not (self._plans and deadlines.do_less):
            self._plan = LoadPlan()
        elif cycle.pose_late or located.quality is not LocalizationQuality.LOST:
            # Looking for a lost place takes longer than following it, and the walker stands meanwhile.
            self._plan = after_cycle(self._plan, work_s, deadlines.work_s, pose_late=cycle.pose_late)

    def _tell(self, now_s: float) -> None:
        if now_s - self._summed_s >= _SUMMARY_EVERY_S:
            self._summed_s, self.summaries = now_s, self._statistics.summaries()
        if now_s - self._logged_s >= LOG_EVERY_S:
            first, self._logged_s = self._logged_s == -math.inf, now_s
            if not first:
                self._log_line()

    def _log_line(self) -> None:
        """Write how it went, as a warning where something was late since the last line."""
        missed_count = sum(each.missed_count for each in self.summaries)
        level = logging.WARNING if missed_count > self._logged_missed_count else logging.INFO
        self._logged_missed_count = missed_count
        count = self._statistics.cycle_count
        _log.log(level, "%d cycles, load level %s; %s", count, self.level.value, as_text(self.summaries))

"""Doing less by plan, instead of falling behind: how long the cycles take decides what is left out of the next ones.

Pure. Obstacles are looked for in every frame at every level: what is left out is part of localization alone. Levels are
taken one by one; what was left out is taken up again only after a long calm, and after a longer one where that has
failed before, so that the device does not swing to and fro.

============== ==============================================================
level          what is left out
============== ==============================================================
FULL           nothing
FEWER_FEATURES part of each picture's features, while the place is known
HALF_RATE      a frame after each pose as well: a sure pose is carried on from the two before
============== ==============================================================

Whatever is still too slow at the last level is counted, and is *Stop* when guidance grows stale (the watchdog).
"""

from __future__ import annotations

import enum
from dataclasses import dataclass, replace

LATE_COUNT = 5
"""So many late cycles, each timely one taken off again, lead to the next level."""
CALM_COUNT = 50
"""Calm cycles in a row that lead a level back, doubled with each step down."""
LONGEST_CALM_COUNT = 3200
"""At most so many, however often going back has failed; so many at the first level, and that is forgotten."""
CALM_FRACTION = 0.55
"""A cycle within this part of its budget is calm: at the level before, it would still have been in time."""
FEWER_FEATURES_FRACTION = 0.6
"""Share of the features that is used from FEWER_FEATURES on."""


class LoadLevel(enum.Enum):
    """How much of its work the loop does."""

    FULL = "full"
    FEWER_FEATURES = "fewer_features"
    HALF_RATE = "half_rate"

    @property
    def feature_fraction(self) -> float:
        """Share of the features that is used."""
        return 1.0 if self is LoadLevel.FULL else FEWER_FEATURES_FRACTION


_LEVELS = tuple(LoadLevel)


@dataclass(frozen=True, slots=True)
class LoadPlan:
    """What is remembered from cycle to cycle."""

    level: LoadLevel = LoadLevel.FULL
    late_count: int = 0
    """Late cycles, less the timely ones since."""
    calm_count: int = 0
    """Calm cycles in a row."""
    calm_wanted_count: int = CALM_COUNT
    """Calm cycles in a row that lead a level back."""


def after_cycle(plan: LoadPlan, work_s: float, budget_s: float, *, pose_late: bool = False) -> LoadPlan:
    """Return the plan after a cycle whose work, from the frame to its cue, took ``work_s`` of ``budget_s``.

    A cycle that went on without the pose of its frame is late, however soon its cue was there.
    """
    late = pose_late or work_s > budget_s
    late_count = plan.late_count + 1 if late else max(0, plan.late_count - 1)
    calm_count = plan.calm_count + 1 if not late and work_s <= CALM_FRACTION * budget_s else 0
    index = _LEVELS.index(plan.level)
    if late_count >= LATE_COUNT:
        if index + 1 == len(_LEVELS):
            return replace(plan, late_count=LATE_COUNT, calm_count=0)
        return LoadPlan(_LEVELS[index + 1], calm_wanted_count=min(2 * plan.calm_wanted_count, LONGEST_CALM_COUNT))
    if index > 0 and calm_count >= plan.calm_wanted_count:
        return LoadPlan(_LEVELS[index - 1], calm_wanted_count=plan.calm_wanted_count)
    if index == 0 and calm_count >= LONGEST_CALM_COUNT:
        return LoadPlan()
    return replace(plan, late_count=late_count, calm_count=calm_count)

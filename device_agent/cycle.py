"""The result of one cycle, and how it is told to the console."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from device_agent.motion import speed_m_s
from device_agent.state import DeviceState
from navcore.cues.table import Cue
from navcore.types import Frame, Guidance, Localization, ObstacleScan
from navcore.wire import StageSummary, WalkerState, WireCandidate

DEVICE_WORK = ("localize", "plan", "scan", "guide", "cues")
"""The stages that count as work of the device, from the depth frame to the cue."""


@dataclass(frozen=True, slots=True, eq=False)
class Cycle:
    """One run from the sensors to the cues."""

    stamp_s: float
    """Capture time of the frame, or the time at which it was given up."""
    guidance: Guidance
    frame: Frame | None = None
    localization: Localization | None = None
    scan: ObstacleScan | None = None
    cues: tuple[Cue, ...] = ()
    stage_ms: Mapping[str, float] = field(default_factory=dict)
    """Time that each stage took."""
    fault: str = ""
    """What was raised in the loop; empty while all is well."""
    pose_late: bool = False
    """The localizer, which knows the place, was not in time with the pose of this frame."""

    @property
    def work_ms(self) -> float:
        """Time of the device's own work, localize to cues."""
        return sum(self.stage_ms.get(stage, 0.0) for stage in DEVICE_WORK)


def walker_state(
    state: DeviceState,
    cycle: Cycle,
    last_cue: Cue | None,
    frame_rate_hz: float,
    stages: tuple[StageSummary, ...] = (),
) -> WalkerState:
    """Return the cycle as the console's message."""
    guidance, trace = cycle.guidance, cycle.guidance.trace
    located = cycle.localization
    goal = trace.sub_goal
    return WalkerState(
        stamp_s=cycle.stamp_s,
        quality=located.quality.value if located is not None else "lost",
        action=guidance.action.value,
        reason=guidance.reason.value,
        rule=(cycle.fault or trace.rule)[:500],
        pose=_pose(located),
        position_std_m=_position_std_m(located),
        inlier_count=located.inlier_count if located is not None else 0,
        direction_rad=_number(guidance.direction),
        expected_rad=_number(trace.expected),
        sub_goal=(float(goal.x_m), float(goal.y_m)) if goal is not None else None,
        sub_goal_case=goal.case.value if goal is not None else None,
        candidates=tuple(
            WireCandidate(float(each.angle), float(min(each.clearance_m, 1e3))) for each in trace.candidates
        ),
        deviation_m=_number(trace.deviation_m),
        remaining_m=_number(trace.remaining_m),
        nearest_ahead_m=_number(trace.nearest_ahead_m),
        sonar_state=trace.sonar_state.value,
        sonar_m=_number(trace.sonar_m),
        speed_m_s=_number(speed_m_s(state.trail)),
        last_cue=last_cue.text[:500] if last_cue is not None else "",
        last_cue_stamp_s=last_cue.stamp_s if last_cue is not None else None,
        cycle_ms=cycle.work_ms,
        frame_rate_hz=frame_rate_hz,
        mode=state.mode,
        destination_id=state.destination_id,
        load_level=state.load_level.value,
        stages=stages,
    )


def _pose(located: Localization | None) -> tuple[float, float, float, float] | None:
    if located is None or located.world_from_camera is None or located.pose is None:
        return None
    x_m, y_m, z_m = (float(value) for value in located.world_from_camera.translation)
    return x_m, y_m, z_m, float(located.pose.heading)


def _position_std_m(located: Localization | None) -> float | None:
    if located is None or located.covariance is None:
        return None
    return _number(math.sqrt(max(0.0, float(located.covariance[0, 0] + located.covariance[1, 1]))))


def _number(value: float | None) -> float | None:
    """Return a plain, finite number: the console takes no others."""
    return float(value) if value is not None and math.isfinite(value) else None

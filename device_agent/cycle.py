"""The result of one cycle, and how it is told to the console."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from device_agent.decision_view import decision_view, finite
from device_agent.motion import speed_m_s
from device_agent.ports import HostHealth
from device_agent.state import DeviceState
from navcore.cues.table import Cue
from navcore.modes import Mode
from navcore.types import Frame, Guidance, Localization, ObstacleScan
from navcore.wire import StageSummary, WalkerState
from navcore.wire_trace import WireCandidate

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
    health: HostHealth | None = None,
) -> WalkerState:
    """Return the cycle as the console's message."""
    guidance, trace = cycle.guidance, cycle.guidance.trace
    located = cycle.localization
    goal, among, health = trace.sub_goal, frozenset(trace.among), health or HostHealth()
    return WalkerState(
        stamp_s=cycle.stamp_s,
        quality=located.quality.value if located is not None else "lost",
        action=guidance.action.value,
        reason=guidance.reason.value,
        rule=(cycle.fault or trace.rule)[:500],
        pose=_pose(located),
        position_std_m=_position_std_m(located),
        inlier_count=located.inlier_count if located is not None else 0,
        direction_rad=finite(guidance.direction),
        expected_rad=finite(trace.expected),
        sub_goal=(float(goal.x_m), float(goal.y_m)) if goal is not None else None,
        sub_goal_case=goal.case.value if goal is not None else None,
        candidates=tuple(
            WireCandidate(float(each.angle), float(min(each.clearance_m, 1e3)), each.angle in among)
            for each in trace.candidates
        ),
        deviation_m=finite(trace.deviation_m),
        remaining_m=finite(trace.remaining_m),
        nearest_ahead_m=finite(trace.nearest_ahead_m),
        sonar_state=trace.sonar_state.value,
        sonar_m=finite(trace.sonar_m),
        speed_m_s=finite(speed_m_s(state.trail)),
        last_cue=last_cue.text[:500] if last_cue is not None else "",
        last_cue_stamp_s=last_cue.stamp_s if last_cue is not None else None,
        cycle_ms=cycle.work_ms,
        frame_rate_hz=frame_rate_hz,
        mode=state.mode,
        # In a fault, which hides the state beneath it, a destination says that somebody is being led.
        destination_id=None if state.beneath is Mode.ARRIVED else state.destination_id,
        destination_by=state.aim_by[:120],
        load_level=state.load_level.value,
        stages=stages,
        trace=decision_view(guidance, cycle.scan, state.settings),
        eye_m=None if cycle.scan is None else finite(cycle.scan.eye_m),
        tilt_rad=_tilt_rad(cycle),
        battery_percent=health.battery_percent,
        is_charging=health.is_charging,
        temperature_c=health.temperature_c,
    )


def _pose(located: Localization | None) -> tuple[float, float, float, float] | None:
    if located is None or located.world_from_camera is None or located.pose is None:
        return None
    x_m, y_m, z_m = (float(value) for value in located.world_from_camera.translation)
    pose = x_m, y_m, z_m, float(located.pose.heading)
    # The wire takes no other numbers, and the console would close the link on whoever sends them.
    return pose if all(map(math.isfinite, pose)) else None


def _position_std_m(located: Localization | None) -> float | None:
    if located is None or located.covariance is None:
        return None
    return finite(math.sqrt(max(0.0, float(located.covariance[0, 0] + located.covariance[1, 1]))))


def _tilt_rad(cycle: Cycle) -> float | None:
    """Return how far the picture's up is from up: gravity tells it of every camera, whatever it looks at."""
    if cycle.frame is not None and cycle.frame.gravity is not None:
        return finite(math.acos(min(1.0, max(-1.0, float(cycle.frame.gravity[1])))))
    return None if cycle.scan is None else finite(cycle.scan.tilt_rad)

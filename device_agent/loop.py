"""One cycle: capture → localize → plan → scan → guide → cue (the paper's Fig. 7, with its sensors and its voice)."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace

from device_agent.cycle import Cycle
from device_agent.motion import extended_trail
from device_agent.orders import mode_event
from device_agent.ports import Clock, DepthCamera, LocalizerPort, Sonar
from device_agent.state import DeviceState, Effect, Happened
from device_agent.voice import Voice
from device_agent.watchdog import is_fresh
from device_agent.way import plan_if_needed
from navcore.errors import SensorError
from navcore.follower.gate import current_reading, echo_distance_m
from navcore.guide import guide
from navcore.obstacle.approach import anticipated, closing_speed_m_s, with_scan
from navcore.obstacle.memory import remember, remember_heard, with_memory
from navcore.obstacle.scan import Scanner
from navcore.obstacle.scan import scan as scan_depth
from navcore.types import (
    Action,
    DecisionTrace,
    Frame,
    Guidance,
    Localization,
    LocalizationQuality,
    ObstacleScan,
    Reason,
    SonarReading,
)


@dataclass(frozen=True, slots=True, eq=False)
class Ports:
    """What a cycle reads from and speaks to."""

    clock: Clock
    camera: DepthCamera
    sonar: Sonar
    localizer: LocalizerPort
    voice: Voice
    stale_s: Callable[[], float]
    """When the watchdog last found guidance stale."""
    scan: Scanner = scan_depth
    """What reduces a depth image to bearings."""


@dataclass(slots=True)
class StageTimes:
    """Measures each stage, and remembers the one that was begun last."""

    stage_ms: dict[str, float] = field(default_factory=dict)
    current: str = ""

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Measure what is done inside."""
        self.current = name
        began = time.perf_counter()
        try:
            yield
        finally:
            self.stage_ms[name] = 1000.0 * (time.perf_counter() - began)


SETTLED_AFTER_S = 1.0
"""After a failure everything must have been fresh for so long before the walker moves again: no "stop, go, stop"."""
Outcome = tuple[DeviceState, Cycle, tuple[Effect, ...]]


def run_stages(state: DeviceState, ports: Ports) -> Outcome:
    """Run one cycle; return what to remember, what came out, and what else is to be done. Raises nothing."""
    times = StageTimes()
    frame: Frame | None = None
    try:
        with times.stage("capture"):
            frame = ports.camera.read()
        return _from_frame(state, ports, frame, times)
    except SensorError as error:
        why = str(error)
    except Exception as error:
        return _faulted(state, ports, frame, times, error)
    try:
        return _blind(state, ports, why, times)
    except Exception as error:
        return _faulted(state, ports, frame, times, error)


def _from_frame(state: DeviceState, ports: Ports, frame: Frame, times: StageTimes) -> Outcome:
    intrinsics, settings = ports.camera.intrinsics, state.settings
    effects: list[Effect] = []
    if state.blind:
        effects.append(Happened("sensor", "The camera delivers again."))
    with times.stage("localize"):
        located = ports.localizer.locate(frame)
        pose = located.pose
    state = replace(state, blind=False, trail=extended_trail(state.trail, frame.stamp_s, pose))
    with times.stage("plan"):
        # A way from a place that is not sure would begin anywhere.
        sure = located.quality is LocalizationQuality.LOCALIZED
        state, planned = plan_if_needed(state, pose if sure else None, frame.stamp_s)
    with times.stage("scan"):
        scan = ports.scan(frame.depth_m, intrinsics, located.world_from_camera, settings.obstacle)
        state, sonar, told = _sonar(state, ports, frame.stamp_s)
        effects += told
        state, scan = _with_what_was_seen(state, scan, sonar, located, frame.stamp_s)
    with times.stage("guide"):
        guidance = _decide(state, frame.stamp_s, located, scan, sonar)
        state, guidance = _fresh_or_stop(state, guidance, ports.clock.now_s(), ports.stale_s())
    with times.stage("cues"):
        cues = ports.voice.tell(state, guidance, ports.clock.now_s())
    state, arrived = _after(replace(state, guidance=guidance))
    cycle = Cycle(frame.stamp_s, guidance, frame, located, scan, cues, times.stage_ms)
    return state, cycle, (*effects, *planned, *arrived)


def _with_what_was_seen(
    state: DeviceState, scan: ObstacleScan, sonar: SonarReading | None, located: Localization, stamp_s: float
) -> tuple[DeviceState, ObstacleScan]:
    """Add to a scan what is out of the image now, and where that will be which comes towards the walker.

    Where the pose is lost nobody knows where that is. An uncertain one still tells how the walker has moved since.
    """
    pose, settings = located.pose, state.settings
    if pose is None or located.quality is LocalizationQuality.LOST:
        return replace(state, recent_scans=()), scan
    echo_m = echo_distance_m(current_reading(sonar, stamp_s, settings.gate))
    half_field_rad = math.radians(settings.gate.half_field_deg)
    obstacles = remember(state.obstacles, scan, pose, stamp_s)
    heard = remember_heard(state.heard, scan, echo_m, half_field_rad, pose, stamp_s)
    sure = located.quality is LocalizationQuality.LOCALIZED
    recent = with_scan(state.recent_scans, scan, pose, stamp_s) if sure else ()
    state = replace(state, obstacles=obstacles, heard=heard, recent_scans=recent)
    coming = anticipated(scan, closing_speed_m_s(recent), settings.obstacle)
    return state, with_memory(coming, obstacles.and_also(heard), pose, settings.obstacle)


def _sonar(
    state: DeviceState, ports: Ports, stamp_s: float
) -> tuple[DeviceState, SonarReading | None, tuple[Effect, ...]]:
    """Return the latest reading, with its age as it is now put before the frame's stamp, and what there is to tell.

    It is read after the frame has been worked on, so that it may be newer than the frame; only its age tells whether it
    can be believed. A rangefinder that fails is an absent one: guidance goes on with depth only, and says so.
    """
    try:
        reading = ports.sonar.read()
    except SensorError as error:
        told = () if state.deaf else (Happened("sensor", str(error)[:500]),)
        return replace(state, deaf=True), None, told
    told = (Happened("sensor", "The rangefinder delivers again."),) if state.deaf else ()
    age_s = ports.clock.now_s() - reading.stamp_s
    return replace(state, deaf=False), replace(reading, stamp_s=stamp_s - age_s), told


def _decide(
    state: DeviceState, stamp_s: float, located: Localization, scan: ObstacleScan, sonar: SonarReading | None
) -> Guidance:
    """Return what guidance says, as far as somebody is to be led."""
    route = state.route if state.leading else None
    guidance = guide(
        stamp_s, located, route, scan, sonar, state.guidance, state.settings,
        paused=state.mode == "paused", wanted=state.mode == "guiding", route_version=state.route_version,
    )  # fmt: skip
    if state.mode == "arrived" and guidance.reason is Reason.NO_ROUTE:
        return replace(guidance, reason=Reason.ARRIVED, trace=replace(guidance.trace, rule="arrived before"))
    return guidance


def _fresh_or_stop(
    state: DeviceState, guidance: Guidance, now_s: float, stale_s: float
) -> tuple[DeviceState, Guidance]:
    """Deciding may have taken so long that the decision is about a place where the walker no longer is.

    ``stale_s`` is when the watchdog last overruled the loop: perhaps a moment ago, within this very cycle.
    """
    if guidance.action is Action.STOP:
        return state, guidance
    age_s = now_s - guidance.stamp_s
    if not is_fresh(guidance.stamp_s, now_s, state.settings.watchdog.guidance_timeout_s):
        rule = f"The decision is {age_s:.2f} s old: too old to walk by."
        return replace(state, failed_s=now_s), _stopped(guidance, rule)
    fresh_for_s = now_s - max(state.failed_s, stale_s)
    if fresh_for_s < SETTLED_AFTER_S:
        return state, _stopped(guidance, f"Fresh for {fresh_for_s:.1f} s of {SETTLED_AFTER_S:g} s since the failure.")
    return state, guidance


def _stopped(guidance: Guidance, rule: str) -> Guidance:
    trace = replace(guidance.trace, rule=rule)
    return replace(guidance, action=Action.STOP, direction=None, reason=Reason.SENSOR_STALE, trace=trace)


def _after(state: DeviceState) -> tuple[DeviceState, tuple[Effect, ...]]:
    if state.mode != "guiding" or state.guidance is None or state.guidance.reason is not Reason.ARRIVED:
        return state, ()
    state = replace(state, mode="arrived", route=None, wanted_id=None, off_route_since_s=None)
    return state, (Happened("arrived", mode_event(state).text), mode_event(state))


def _blind(state: DeviceState, ports: Ports, why: str, times: StageTimes) -> Outcome:
    """The camera gave nothing: *Stop* and the reason; the next cycle asks it again."""
    now_s = ports.clock.now_s()
    guidance = _stop(state, now_s, Reason.SENSOR_STALE, why)
    cues = ports.voice.tell(state, guidance, now_s)
    effects = () if state.blind else (Happened("sensor", why[:500]),)
    state = replace(state, guidance=guidance, blind=True, failed_s=now_s, trail=())
    return state, Cycle(now_s, guidance, cues=cues, stage_ms=times.stage_ms), effects


def _faulted(state: DeviceState, ports: Ports, frame: Frame | None, times: StageTimes, error: Exception) -> Outcome:
    """Something was raised that nobody expected: guidance is *Stop*, and the watchdog says so."""
    now_s = ports.clock.now_s()
    fault = f"{times.current} failed: {type(error).__name__}: {error}"[:500]
    guidance = _stop(state, now_s, _FAULT_REASONS.get(times.current, Reason.SENSOR_STALE), fault)
    state = replace(state, guidance=guidance, failed_s=now_s, trail=())
    return state, Cycle(now_s, guidance, frame, stage_ms=times.stage_ms, fault=fault), ()


_FAULT_REASONS = {"localize": Reason.POSE_LOST, "scan": Reason.DEPTH_INVALID}


def _stop(state: DeviceState, now_s: float, reason: Reason, rule: str) -> Guidance:
    """Stop, but remember the place on the route, and what the rangefinder did: it has not failed with the rest."""
    before = state.guidance.trace if state.guidance is not None else DecisionTrace()
    trace = DecisionTrace(
        sub_goal=before.sub_goal, closest_index=before.closest_index, lost_index=before.lost_index,
        sonar_state=before.sonar_state, sure_count=before.sure_count, rule=rule,
    )  # fmt: skip
    return Guidance(now_s, Action.STOP, None, reason, trace, state.route_version)

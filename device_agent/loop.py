"""One cycle: capture → localize → plan → scan → guide → cue (the paper's Fig. 7, with its sensors and its voice)."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace

from device_agent.cycle import Cycle
from device_agent.load_plan import LoadLevel
from device_agent.locating import Locator, Request
from device_agent.motion import extended_trail
from device_agent.mounting import expected_of, look_at_floor, look_where_walked
from device_agent.ports import Clock, DepthCamera, Sonar
from device_agent.state import DeviceState, Effect, Happened, Notice, Step
from device_agent.states import StateEvent, may_be_told
from device_agent.transitions import happen, mode_event
from device_agent.voice import Voice
from device_agent.watchdog import is_fresh
from device_agent.way import plan_if_needed
from navcore.cues.table import CueKind
from navcore.cues.texts import TEXTS
from navcore.errors import SensorError
from navcore.follower.gate import current_reading, echo_distance_m
from navcore.geometry import Transform
from navcore.guide import guide
from navcore.modes import Mode
from navcore.obstacle.approach import anticipated, closing_speed_m_s, with_scan
from navcore.obstacle.memory import is_hidden_ahead, remember, remember_heard, with_memory
from navcore.obstacle.mounting import FloorFinder, find_floor
from navcore.obstacle.scan import Scanner
from navcore.obstacle.scan import scan as scan_depth
from navcore.slam.dead_reckoning import carried_on, reckoned
from navcore.slam.localizer import MAX_UNMATCHED_S
from navcore.types import (
    Action,
    DecisionTrace,
    Frame,
    Guidance,
    Localization,
    LocalizationQuality,
    ObstacleScan,
    Pose2D,
    Reason,
    Rule,
    SonarReading,
)


@dataclass(frozen=True, slots=True, eq=False)
class Ports:
    """What a cycle reads from and speaks to."""

    clock: Clock
    camera: DepthCamera
    sonar: Sonar
    locator: Locator
    voice: Voice
    stale_s: Callable[[], float]
    """When the watchdog last found guidance stale."""
    scan: Scanner = scan_depth
    """What reduces a depth image to bearings."""
    timer_s: Callable[[], float] = time.perf_counter
    """Measures the stages; nothing is decided by it within a cycle."""
    floor: FloorFinder = find_floor
    """What finds the floor in a depth image, to tell whether the camera has moved."""


@dataclass(slots=True)
class StageTimer:
    """Measures each stage, and remembers the one that was begun last."""

    timer_s: Callable[[], float]
    stage_ms: dict[str, float] = field(default_factory=dict)
    current: str = ""

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Measure what is done inside."""
        self.current = name
        began_s = self.timer_s()
        try:
            yield
        finally:
            self.stage_ms[name] = 1000.0 * (self.timer_s() - began_s)


SETTLED_AFTER_S = 1.0
"""After a failure everything must have been fresh for so long before the walker moves again: no "stop, go, stop"."""
Outcome = tuple[DeviceState, Cycle, tuple[Effect, ...]]


def run_stages(state: DeviceState, ports: Ports) -> Outcome:
    """Run one cycle; return what to remember, what came out, and what else is to be done. Raises nothing."""
    times = StageTimer(ports.timer_s)
    frame: Frame | None = None
    try:
        with times.stage("capture"):
            frame = ports.camera.read()
        if state.mode is Mode.OFF_DUTY:
            return _resting(state, ports, frame, times)
        if state.purpose is Mode.MAPPING:
            return _mapping(state, ports, frame, times)
        return _from_frame(state, ports, frame, times)
    except SensorError as error:
        why = str(error)
    except Exception as error:
        return _faulted(state, ports, frame, times, error)
    try:
        return _blind(state, ports, why, times)
    except Exception as error:
        return _faulted(state, ports, frame, times, error)


def _from_frame(state: DeviceState, ports: Ports, frame: Frame, times: StageTimer) -> Outcome:
    intrinsics, settings = ports.camera.intrinsics, state.settings
    effects: list[Effect] = []
    if state.blind:
        effects.append(Happened("sensor", "The camera delivers again."))
    with times.stage("localize"):
        state, place = _located(state, ports.locator, frame)
        located, pose = place.located, place.located.pose
        effects += _told_of_silence(state, located)
    sure = located.quality is LocalizationQuality.LOCALIZED
    state = replace(
        state, blind=False, trail=extended_trail(state.trail, frame.stamp_s, pose), located=located,
        sure=(frame.stamp_s, pose) if sure and pose is not None else state.sure,
    )  # fmt: skip
    with times.stage("plan"):
        # A way from a place that is not sure would begin anywhere.
        state, planned = plan_if_needed(state, pose if sure else None, frame.stamp_s)
    with times.stage("scan"):
        expected = expected_of(state, frame, located, has_pose=place.level is not None)
        scan = ports.scan(frame.depth_m, intrinsics, place.level, settings.obstacle, expected)
        if sure and math.isfinite(scan.eye_m):
            state = replace(state, eye=(frame.stamp_s, scan.eye_m))
        state, told = look_at_floor(state, ports.floor, intrinsics, frame, located)
        effects += told
        state, told = look_where_walked(state, located)
        effects += told
        state, sonar, told = _sonar(state, ports, frame.stamp_s)
        effects += told
        state, scan = _with_what_was_seen(state, scan, sonar, place, frame.stamp_s)
    with times.stage("guide"):
        decided = _decide(state, frame.stamp_s, located, scan, sonar)
        now_s, stale_s = ports.clock.now_s(), ports.stale_s()
        state, guidance = _fresh_or_stop(state, decided, now_s, stale_s)
        guidance = _as_mounted(state, guidance)
        fresh_for_s = 0.0 if state.mounting.moved else now_s - max(state.failed_s, stale_s)
        state, found = _found(state, decided, located, now_s, fresh_for_s)
        guidance = _as_allowed(state, guidance)
    with times.stage("cues"):
        cues = ports.voice.tell(state, guidance, ports.clock.now_s())
    state, arrived = _after(replace(state, guidance=guidance), now_s)
    cycle = Cycle(frame.stamp_s, guidance, frame, located, scan, cues, times.stage_ms, pose_late=place.is_late)
    return state, cycle, (*effects, *planned, *found, *arrived)


@dataclass(frozen=True, slots=True, eq=False)
class _Place:
    """Where a frame was taken."""

    located: Localization
    is_own: bool = True
    """The localizer has said so of this very frame; else it follows from the poses before."""
    is_late: bool = False
    """The localizer, which knows the place, was not in time."""

    @property
    def is_held(self) -> bool:
        """The pose stands still while nobody knows how the walker moves on."""
        return not self.is_own and self.located.quality is not LocalizationQuality.LOCALIZED

    @property
    def level(self) -> Transform | None:
        """The pose that tells which way is up; a head that nods has left one that is held: the floor must tell."""
        return None if self.is_held else self.located.world_from_camera


def _located(state: DeviceState, locator: Locator, frame: Frame) -> tuple[DeviceState, _Place]:
    """Return where the frame was taken: by itself, or by the poses before; one of them may have come only now."""
    request = _request(state, frame)
    answer = locator.locate(request)
    came = tuple(each for each in (answer.late, answer.own) if each is not None)
    state = replace(state, fixes=(*state.fixes, *came)[-2:])
    if answer.own is not None:
        return state, _Place(answer.own)
    left_out = request.feature_fraction is None or (answer.late is not None and request.rests)
    # Whoever looks for a lost place takes longer, and nobody walks meanwhile.
    is_late = not left_out and not _is_lost(state)
    located = reckoned(state.fixes, frame.stamp_s, state.settings.watchdog.guidance_timeout_s)
    return state, _Place(located, is_own=False, is_late=is_late)


def _request(state: DeviceState, frame: Frame) -> Request:
    """Return what is asked of the localizer; at half rate one frame is left out after each pose that it has found.

    So a sure pose is carried on, and never two in a row. Whoever has lost the place needs all that a picture shows to
    find it again.
    """
    is_lost, half = _is_lost(state), state.load_level is LoadLevel.HALF_RATE
    fraction: float | None = 1.0 if is_lost else state.load_level.feature_fraction
    if half and _was_found(state) and carried_on(state.fixes[0], state.fixes[1], frame.stamp_s) is not None:
        fraction = None
    return Request(frame, fraction, half and _may_rest(state, frame), state.settings.deadlines.pose_wait_s)


def _may_rest(state: DeviceState, frame: Frame) -> bool:
    """Whether a frame can be left out after a late pose, and the next one's pose still be carried on, late as well."""
    last = state.located
    return not _is_lost(state) and last is not None and 2.0 * (frame.stamp_s - last.stamp_s) <= MAX_UNMATCHED_S


def _was_found(state: DeviceState) -> bool:
    """Whether the localizer has found the last frame's pose, in time, and another one before."""
    last = state.located
    return last is not None and len(state.fixes) == 2 and last.stamp_s == state.fixes[-1].stamp_s


def _is_lost(state: DeviceState) -> bool:
    """Whether the localizer itself, as far as it has answered, does not know the place."""
    return not state.fixes or state.fixes[-1].quality is LocalizationQuality.LOST


def _told_of_silence(state: DeviceState, located: Localization) -> tuple[Effect, ...]:
    """Tell once that the localizer says nothing; ``state`` is that before the frame, but for the newest poses."""
    was_known = state.located is not None and state.located.quality is not LocalizationQuality.LOST
    if not was_known or located.quality is not LocalizationQuality.LOST or _is_lost(state):
        return ()
    silent_s = located.stamp_s - state.fixes[-1].stamp_s
    return (Happened("localization", f"Localization has not answered for {silent_s:.1f} s: the place is lost."),)


def _with_what_was_seen(
    state: DeviceState, scan: ObstacleScan, sonar: SonarReading | None, place: _Place, stamp_s: float
) -> tuple[DeviceState, ObstacleScan]:
    """Add to a scan what is out of the image now, and where that will be which comes towards the walker.

    Where the pose is lost nobody knows where that is. An uncertain one still tells how the walker has moved since, but
    not one that is only held: by it nothing is forgotten, and nothing put where it may not be.
    """
    located, pose, settings = place.located, place.located.pose, state.settings
    if pose is None or located.quality is LocalizationQuality.LOST:
        return replace(state, recent_scans=(), is_hidden_ahead=False), scan
    if place.is_held:
        # Who was coming a moment ago still is.
        closing_m_s = closing_speed_m_s(state.recent_scans)
        is_alike = len(closing_m_s) == len(scan.bearing_rad)
        coming = anticipated(scan, closing_m_s, settings.obstacle) if is_alike else scan
        return _closed_by_memory(state, coming, pose)
    echo_m = echo_distance_m(current_reading(sonar, stamp_s, settings.gate))
    half_field_rad = math.radians(settings.gate.half_field_deg)
    looks_rad = 0.0 if sonar is None else sonar.bearing_rad
    obstacles = remember(state.obstacles, scan, pose, stamp_s)
    heard = remember_heard(state.heard, scan, echo_m, half_field_rad, pose, stamp_s, looks_rad)
    sure = located.quality is LocalizationQuality.LOCALIZED
    recent = with_scan(state.recent_scans, scan, pose, stamp_s) if sure else ()
    state = replace(state, obstacles=obstacles, heard=heard, recent_scans=recent)
    coming = anticipated(scan, closing_speed_m_s(recent), settings.obstacle)
    return _closed_by_memory(state, coming, pose)


def _closed_by_memory(state: DeviceState, scan: ObstacleScan, pose: Pose2D) -> tuple[DeviceState, ObstacleScan]:
    settings = state.settings.obstacle
    state = replace(state, is_hidden_ahead=is_hidden_ahead(scan, state.obstacles, pose, settings))
    return state, with_memory(scan, state.obstacles.and_also(state.heard), pose, settings)


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
    alignment = state.calibration.sonar
    reading = reading if alignment is None else alignment.aligned(reading)
    return replace(state, deaf=False), replace(reading, stamp_s=stamp_s - age_s), told


def _decide(
    state: DeviceState, stamp_s: float, located: Localization, scan: ObstacleScan, sonar: SonarReading | None
) -> Guidance:
    """Return what guidance says, as far as somebody is to be led."""
    route = state.route if state.leading else None
    guidance = guide(
        stamp_s, located, route, scan, sonar, state.guidance, state.settings,
        paused=state.purpose is Mode.PAUSED, wanted=state.on_the_way, route_version=state.route_version,
    )  # fmt: skip
    if state.purpose is Mode.ARRIVED and guidance.reason is Reason.NO_ROUTE:
        trace = replace(guidance.trace, rule="arrived before", decided=Rule.ARRIVED_BEFORE)
        return replace(guidance, reason=Reason.ARRIVED, trace=trace)
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
        return replace(state, failed_s=now_s), _stopped(guidance, Rule.DECISION_OLD, rule)
    fresh_for_s = now_s - max(state.failed_s, stale_s)
    if fresh_for_s < SETTLED_AFTER_S:
        rule = f"Fresh for {fresh_for_s:.1f} s of {SETTLED_AFTER_S:g} s since the failure."
        return state, _stopped(guidance, Rule.SETTLING, rule)
    return state, guidance


def _as_mounted(state: DeviceState, guidance: Guidance) -> Guidance:
    """By a camera that is not where it was calibrated nobody is led."""
    if not state.mounting.moved:
        return guidance
    reason = Reason.LOOKS_AWAY if state.mounting.by_posture else Reason.CAMERA_MOVED
    return _stop_instead(guidance, reason, Rule.CAMERA_MOVED, f"The camera has moved: {state.mounting.why}.")


def _stopped(guidance: Guidance, decided: Rule, rule: str) -> Guidance:
    return _stop_instead(guidance, Reason.SENSOR_STALE, decided, rule)


def _stop_instead(guidance: Guidance, reason: Reason, decided: Rule, rule: str) -> Guidance:
    trace = replace(guidance.trace, rule=rule, decided=decided)
    return replace(guidance, action=Action.STOP, direction=None, reason=reason, trace=trace)


def _found(
    state: DeviceState, decided: Guidance, located: Localization, now_s: float, fresh_for_s: float
) -> tuple[DeviceState, tuple[Effect, ...]]:
    """Hand what this cycle has found to the state machine: whether all works, and whether the place is known."""
    state, effects = _health(state, now_s, fresh_for_s)
    if state.on_the_way:
        # Guidance carries an uncertain pose on for a while, and waits until a lost one is certain again.
        known = decided.reason is not Reason.POSE_LOST
    elif located.quality is LocalizationQuality.UNCERTAIN:
        return state, effects
    else:
        known = located.quality is LocalizationQuality.LOCALIZED
    state, also = happen(state, StateEvent.POSE_FOUND if known else StateEvent.POSE_LOST, now_s)
    return state, (*effects, *also)


def _health(state: DeviceState, now_s: float, fresh_for_s: float) -> Step:
    """Hand to the state machine whether all has worked for long enough."""
    works = fresh_for_s >= SETTLED_AFTER_S
    return happen(state, StateEvent.RECOVERED if works else StateEvent.FAILED, now_s)


def _as_allowed(state: DeviceState, guidance: Guidance) -> Guidance:
    """The state machine has the last word. Whatever it does not allow would be a fault of this program."""
    if may_be_told(state.mode, guidance.action):
        return guidance
    rule = f"{guidance.action.value} is not told in the state {state.mode.value}"
    return _stop_instead(guidance, Reason.OK, Rule.NOT_ALLOWED, rule)


def _after(state: DeviceState, now_s: float) -> tuple[DeviceState, tuple[Effect, ...]]:
    if not state.on_the_way or state.guidance is None or state.guidance.reason is not Reason.ARRIVED:
        return state, ()
    state, effects = happen(state, StateEvent.ARRIVED, now_s)
    is_sure = state.guidance is not None and state.guidance.trace.uncertain_since_s is None
    unsure = "" if is_sure else " The position is uncertain."
    return state, (Happened("arrived", mode_event(state).text + unsure), *effects)


def _resting(state: DeviceState, ports: Ports, frame: Frame, times: StageTimer) -> Outcome:
    """Off duty nobody is located, and no picture leaves the device; the camera is only kept awake."""
    guidance = _stop(state, frame.stamp_s, Reason.NO_ROUTE, Rule.OFF_DUTY, "off duty")
    cues = ports.voice.tell(state, guidance, ports.clock.now_s())
    state = replace(state, guidance=guidance, blind=False)
    return state, Cycle(frame.stamp_s, guidance, cues=cues, stage_ms=times.stage_ms), ()


def _mapping(state: DeviceState, ports: Ports, frame: Frame, times: StageTimer) -> Outcome:
    """Whoever records a map sees for themselves: nobody is located, and nothing but *Stop* can be told."""
    now_s = ports.clock.now_s()
    state, found = _health(state, now_s, now_s - max(state.failed_s, ports.stale_s()))
    guidance = _stop(state, frame.stamp_s, Reason.NO_ROUTE, Rule.MAPPING, "a map is being recorded")
    cues = ports.voice.tell(state, guidance, now_s)
    back = (Happened("sensor", "The camera delivers again."), _to_helper(state, "map_picture", CueKind.MAP_NEWS))
    effects = (*back, *found) if state.blind else found
    state = replace(state, guidance=guidance, blind=False)
    return state, Cycle(frame.stamp_s, guidance, frame, cues=cues, stage_ms=times.stage_ms), effects


def _to_helper(state: DeviceState, key: str, kind: CueKind) -> Notice:
    """Whoever records a map takes silence for *all is well*."""
    return Notice(TEXTS[state.settings.cues.language][key], kind=kind)


def _blind(state: DeviceState, ports: Ports, why: str, times: StageTimer) -> Outcome:
    """The camera gave nothing: *Stop* and the reason; the next cycle asks it again."""
    now_s = ports.clock.now_s()
    guidance = _stop(state, now_s, Reason.SENSOR_STALE, Rule.NO_FRAME, why)
    told: tuple[Effect, ...] = () if state.blind else (Happened("sensor", why[:500]),)
    if told and state.purpose is Mode.MAPPING:
        told = (*told, _to_helper(state, "map_no_picture", CueKind.MAP_ADVICE))
    state, effects = happen(state, StateEvent.FAILED, now_s)
    cues = ports.voice.tell(state, guidance, now_s)
    state = replace(state, guidance=guidance, blind=True, failed_s=now_s, trail=(), located=None, fixes=())
    return state, Cycle(now_s, guidance, cues=cues, stage_ms=times.stage_ms), (*told, *effects)


def _faulted(state: DeviceState, ports: Ports, frame: Frame | None, times: StageTimer, error: Exception) -> Outcome:
    """Something was raised that nobody expected: guidance is *Stop*, and the watchdog says so."""
    now_s = ports.clock.now_s()
    fault = f"{times.current} failed: {type(error).__name__}: {error}"[:500]
    reason = _FAULT_REASONS.get(times.current, Reason.SENSOR_STALE)
    guidance = _stop(state, now_s, reason, Rule.FAULT, fault)
    state, effects = happen(state, StateEvent.FAILED, now_s)
    state = replace(state, guidance=guidance, failed_s=now_s, trail=(), located=None, fixes=())
    return state, Cycle(now_s, guidance, frame, stage_ms=times.stage_ms, fault=fault), effects


_FAULT_REASONS = {"localize": Reason.POSE_LOST, "scan": Reason.DEPTH_INVALID}


def _stop(state: DeviceState, now_s: float, reason: Reason, decided: Rule, rule: str) -> Guidance:
    """Stop, but remember the place on the route, and what the rangefinder did: it has not failed with the rest."""
    before = state.guidance.trace if state.guidance is not None else DecisionTrace()
    trace = DecisionTrace(
        sub_goal=before.sub_goal, closest_index=before.closest_index, lost_index=before.lost_index,
        sonar_state=before.sonar_state, sure_count=before.sure_count, fastest_m_s=before.fastest_m_s,
        rejoined_from=before.rejoined_from, rule=rule, decided=decided,
    )  # fmt: skip
    return Guidance(now_s, Action.STOP, None, reason, trace, state.route_version)

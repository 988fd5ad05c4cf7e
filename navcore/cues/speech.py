"""From guidance to what is heard: instructions when they change, tones and ticks in between. Pure.

The walker acts on cues alone and stops by themselves after a second and a half of silence, so that while *walk* holds
something is heard at least every ``tick_interval_s``. A turn on the spot is said once; it is said again only when the
walker stands still in a wrong direction, or the direction to turn to has become another one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

from navcore.angles import wrap_rad
from navcore.cues import bus as cue_bus
from navcore.cues.bus import CueBus
from navcore.cues.synthesis import beep_cue, beep_interval_s, steer_cue, stop_cue, tick_cue
from navcore.cues.table import PRIORITY, Cue, CueKind, CuePriority
from navcore.cues.texts import TEXTS, Language, move_text, turn_text
from navcore.settings import CueSettings, Settings
from navcore.types import Action, Guidance, Reason, Route, RouteStop, SonarState

_STILL_RAD = math.radians(3.0)
_STILL_S = 0.8
"""A heading that has changed by less than this for so long is not turning any more."""
_NEW_TARGET_RAD = math.radians(25.0)
"""A direction to turn to that differs more than this from the one that was said is said anew."""
_SHORTEST_TURN_S = 1.5
"""Time that a walker needs at least to hear a turn and to begin it."""
_STANDING_HOLD_S = 0.5
"""Somebody who stands already hears a new reason only after it has held for so long."""
_STOP_REPEAT_FACTOR = 3.0
_ROUND_TO_DEG = 5.0
_SMALLEST_TURN_DEG = 10.0
"""Nobody can turn by less to order: turns without vision err by several degrees."""
_OFF_ROAD_REPEAT_S = 10.0
_UNCERTAIN_REPEAT_S = 20.0
_NOTICE_HOLD_S = 1.0
"""A sensor or a pose that fails for a moment only is not talked about; guidance heeds it at once."""
_STRAIGHT_HOLD_S = 1.0
"""There is time for an announcement when the walker has needed no steering for so long."""
_LOST_STATES = frozenset({SonarState.STALE, SonarState.ABSENT})


@dataclass(frozen=True, slots=True)
class CueMemory:
    """What has been said, as far as it matters for what to say next."""

    bus: CueBus = field(default_factory=CueBus)
    told_action: Action | None = None
    """The last instruction that was spoken."""
    told_reason: Reason | None = None
    told_s: float = -math.inf
    """When."""
    told_target_rad: float | None = None
    """World direction that the last turn was to lead to."""
    heading_rad: float | None = None
    """Heading since which the walker has stood still."""
    still_since_s: float = -math.inf
    changed_since_s: float | None = None
    """Since when guidance has been another than what was told, while the walker stands."""
    tone_s: float = -math.inf
    """When the last tick or steering tone was due."""
    tone_angle_deg: float = 0.0
    beep_s: float = -math.inf
    off_road_s: float = -math.inf
    sonar_lost: bool = False
    """What the walker was last told of the rangefinder."""
    sonar_changed_s: float | None = None
    """Since when it has been otherwise."""
    uncertain_s: float = -math.inf
    """When the walker was last told that the position is uncertain."""
    straight_since_s: float | None = None
    """Since when the walker has been walking straight on."""
    route_version: int | None = None
    reassured_m: float | None = None
    """Distance left when the walker last heard that all is well."""
    announced: frozenset[str] = frozenset()
    """PoIs of this route that have been announced."""


def cues_for(
    guidance: Guidance,
    memory: CueMemory,
    route: Route | None,
    settings: Settings,
    now_s: float,
) -> tuple[tuple[Cue, ...], CueMemory]:
    """Return the cues to begin now (at most one sentence or one tone), and what to remember.

    Args:
        guidance: what holds now.
        memory: what this function returned last; ``CueMemory()`` at the start.
        route: the present route, for announcements.
        settings: thresholds and language.
        now_s: the present time, on the scale of the stamps.
    """
    before = memory
    memory = _with_straight(_of_route(_with_heading(memory, guidance, now_s), guidance), guidance, settings, now_s)
    wanted: list[Cue] = []
    for stage in (_instruction, _heart_beat, _beep, _notices, _reassurance, _places_ahead):
        cues, memory = stage(guidance, memory, route, settings, now_s)
        wanted += cues
    played, heard = cue_bus.play(
        memory.bus, wanted, now_s, settings.cues.language, lambda cue: _still_holds(cue, guidance, settings)
    )
    if not any(cue.kind in (CueKind.WALK, CueKind.TICK, CueKind.STEER) for cue in played):
        # A tone that could not be heard, because somebody spoke, is due at once when they have finished.
        memory = replace(memory, tone_s=before.tone_s, tone_angle_deg=before.tone_angle_deg)
    return played, replace(memory, bus=heard)


def say(text: str, memory: CueMemory, settings: Settings, now_s: float) -> tuple[tuple[Cue, ...], CueMemory]:
    """Speak a sentence of a person at the console, or a notice of the device, as soon as nothing higher is heard."""
    played, bus = cue_bus.play(memory.bus, [message_cue(now_s, text)], now_s, settings.cues.language, lambda _: True)
    return played, replace(memory, bus=bus)


def repeat_last(memory: CueMemory, settings: Settings, now_s: float) -> tuple[tuple[Cue, ...], CueMemory]:
    """Say the last sentence again, where there is one."""
    last = memory.bus.repeatable
    if last is None:
        return (), memory
    again = replace(last, stamp_s=now_s, angle_deg=None, kind=CueKind.MESSAGE)
    played, bus = cue_bus.play(memory.bus, [again], now_s, settings.cues.language, lambda _: True)
    return played, replace(memory, bus=bus)


def message_cue(stamp_s: float, text: str) -> Cue:
    """Return a sentence as a cue."""
    return Cue(stamp_s, CueKind.MESSAGE, PRIORITY[CueKind.MESSAGE], text)


Stage = tuple[list[Cue], CueMemory]


# -------------------------------------------------------------------------------------------------- instructions
def _instruction(guidance: Guidance, memory: CueMemory, route: Route | None, settings: Settings, now_s: float) -> Stage:
    if guidance.action is Action.STOP:
        return _stop(guidance, memory, route, settings.cues, now_s)
    if guidance.action is Action.TURN:
        return _turn(guidance, memory, settings.cues, now_s)
    return _walk(guidance, memory, settings.cues, now_s)


def _stop(guidance: Guidance, memory: CueMemory, route: Route | None, settings: CueSettings, now_s: float) -> Stage:
    told = memory.told_action is Action.STOP and memory.told_reason is guidance.reason
    if told and (
        not _is_repeated(guidance.reason) or now_s - memory.told_s < _STOP_REPEAT_FACTOR * settings.turn_repeat_s
    ):
        return [], replace(memory, changed_since_s=None)
    if not told and memory.told_action is Action.STOP and guidance.reason is not Reason.ARRIVED:
        since_s = now_s if memory.changed_since_s is None else memory.changed_since_s
        if now_s - since_s < _STANDING_HOLD_S:
            return [], replace(memory, changed_since_s=since_s)
    if guidance.reason is Reason.ARRIVED:
        cue = Cue(now_s, CueKind.ARRIVED, PRIORITY[CueKind.ARRIVED], _arrived_text(route, settings.language))
    else:
        cue = stop_cue(now_s, guidance.reason, settings.language)
    return [cue], _told(memory, guidance, now_s)


def _turn(guidance: Guidance, memory: CueMemory, settings: CueSettings, now_s: float) -> Stage:
    if guidance.direction is None:
        return [], memory
    heading = guidance.trace.heading
    target = None if heading is None else heading + guidance.direction
    if memory.told_action is Action.TURN and not _turn_is_due(memory, target, settings, now_s):
        return [], memory
    angle_deg = math.copysign(max(_SMALLEST_TURN_DEG, abs(_rounded_deg(guidance.direction))), guidance.direction)
    cue = Cue(now_s, CueKind.TURN, PRIORITY[CueKind.TURN], turn_text(angle_deg, settings.language), angle_deg)
    return [cue], replace(_told(memory, guidance, now_s), told_target_rad=target, still_since_s=now_s)


def _turn_is_due(memory: CueMemory, target: float | None, settings: CueSettings, now_s: float) -> bool:
    """Whether a turn that was told is to be told again."""
    since_s = now_s - memory.told_s
    if since_s < _SHORTEST_TURN_S:
        return False
    is_new = (
        target is not None
        and memory.told_target_rad is not None
        and abs(wrap_rad(target - memory.told_target_rad)) > _NEW_TARGET_RAD
    )
    has_turned = memory.still_since_s > memory.told_s
    stands_still = now_s - memory.still_since_s >= _STILL_S
    # Where poses are so noisy that nobody seems ever to stand still, it is said again all the same.
    forgotten = since_s >= _STOP_REPEAT_FACTOR * settings.turn_repeat_s
    return is_new or forgotten or (stands_still and (has_turned or since_s >= settings.turn_repeat_s))


def _walk(guidance: Guidance, memory: CueMemory, settings: CueSettings, now_s: float) -> Stage:
    if guidance.direction is None or memory.told_action is Action.WALK:
        return [], memory
    angle_deg = math.degrees(guidance.direction)
    text = move_text(_rounded_deg(guidance.direction), settings.straight_within_deg, settings.language)
    cue = Cue(now_s, CueKind.WALK, PRIORITY[CueKind.WALK], text, round(angle_deg, 1))
    return [cue], replace(_told(memory, guidance, now_s), tone_s=now_s, tone_angle_deg=angle_deg)


# --------------------------------------------------------------------------------------------------------- tones
def _heart_beat(guidance: Guidance, memory: CueMemory, route: Route | None, settings: Settings, now_s: float) -> Stage:
    if guidance.action is not Action.WALK or guidance.direction is None:
        return [], memory
    angle_deg = math.degrees(guidance.direction)
    straight_deg = settings.cues.straight_within_deg
    steers, steered = abs(angle_deg) > straight_deg, abs(memory.tone_angle_deg) > straight_deg
    interval_s = settings.cues.steer_interval_s if steers else settings.cues.tick_interval_s
    if now_s - memory.tone_s < interval_s and not (steered and not steers):
        return [], memory
    cue = steer_cue(now_s, round(angle_deg, 1)) if steers else tick_cue(now_s)
    return [cue], replace(memory, tone_s=now_s, tone_angle_deg=angle_deg)


def _beep(guidance: Guidance, memory: CueMemory, route: Route | None, settings: Settings, now_s: float) -> Stage:
    near_m, range_m = guidance.trace.nearest_ahead_m, settings.cues.beep_range_m
    if guidance.action is not Action.WALK or near_m is None or near_m > range_m:
        return [], memory
    if now_s - memory.beep_s < beep_interval_s(near_m, range_m):
        return [], memory
    return [beep_cue(now_s, near_m, range_m)], replace(memory, beep_s=now_s)


# ------------------------------------------------------------------------------------------------- announcements
def _notices(guidance: Guidance, memory: CueMemory, route: Route | None, settings: Settings, now_s: float) -> Stage:
    """Each change that the walker should know of is said once; one at a time, and not over a message that waits."""
    if guidance.reason is Reason.NO_ROUTE:
        return [], memory
    texts = TEXTS[settings.cues.language]
    memory = _with_sonar(memory, guidance, now_s)
    if any(cue.priority is CuePriority.OFF_ROAD for cue in memory.bus.waiting):
        return [], memory
    if memory.sonar_changed_s is not None and now_s - memory.sonar_changed_s >= _NOTICE_HOLD_S:
        lost = not memory.sonar_lost
        told = replace(memory, sonar_lost=lost, sonar_changed_s=None)
        return [message_cue(now_s, texts["sonar_lost" if lost else "sonar_back"])], told
    since_s = guidance.trace.uncertain_since_s
    uncertain = guidance.action is not Action.STOP and since_s is not None and now_s - since_s >= _NOTICE_HOLD_S
    if uncertain and now_s - memory.uncertain_s > _UNCERTAIN_REPEAT_S:
        return [message_cue(now_s, texts["pose_uncertain"])], replace(memory, uncertain_s=now_s)
    if guidance.reason is Reason.OFF_ROAD and now_s - memory.off_road_s > _OFF_ROAD_REPEAT_S:
        return [message_cue(now_s, texts["off_road"])], replace(memory, off_road_s=now_s)
    return [], memory


def _with_sonar(memory: CueMemory, guidance: Guidance, now_s: float) -> CueMemory:
    if (guidance.trace.sonar_state in _LOST_STATES) == memory.sonar_lost:
        return replace(memory, sonar_changed_s=None)
    return replace(memory, sonar_changed_s=now_s) if memory.sonar_changed_s is None else memory


def _reassurance(guidance: Guidance, memory: CueMemory, route: Route | None, settings: Settings, now_s: float) -> Stage:
    left_m = guidance.trace.remaining_m
    if left_m is None or guidance.action is not Action.WALK:
        return [], memory
    if memory.reassured_m is None:
        return [], replace(memory, reassured_m=left_m)
    if memory.reassured_m - left_m < settings.cues.reassurance_m or not _has_time(memory, now_s):
        return [], memory
    text = TEXTS[settings.cues.language]["reassurance"].format(metres=round(left_m))
    cue = Cue(now_s, CueKind.REASSURANCE, PRIORITY[CueKind.REASSURANCE], text, distance_m=left_m)
    return [cue], replace(memory, reassured_m=left_m)


def _places_ahead(
    guidance: Guidance, memory: CueMemory, route: Route | None, settings: Settings, now_s: float
) -> Stage:
    left_m = guidance.trace.remaining_m
    if route is None or left_m is None or not _has_time(memory, now_s):
        return [], memory
    done_m = route.length_m - left_m
    for stop in route.stops:
        ahead_m = stop.distance_m - done_m
        if stop.is_silent or stop.poi_id in memory.announced or not 1.0 < ahead_m <= settings.cues.announce_m:
            continue
        text = TEXTS[settings.cues.language]["poi_ahead"].format(name=_spoken(stop), metres=round(ahead_m))
        cue = Cue(now_s, CueKind.POI_AHEAD, PRIORITY[CueKind.POI_AHEAD], text, distance_m=ahead_m)
        return [cue], replace(memory, announced=memory.announced | {stop.poi_id})
    return [], memory


# --------------------------------------------------------------------------------------------------------- parts
def _still_holds(cue: Cue, guidance: Guidance, settings: Settings) -> bool:
    """Whether a sentence that waited, or was cut off, is still true; an announcement gives way to steering for good."""
    holds_while = {CueKind.STOP: Action.STOP, CueKind.TURN: Action.TURN, CueKind.WALK: Action.WALK}
    if cue.kind in (CueKind.POI_AHEAD, CueKind.REASSURANCE):
        return _is_straight(guidance, settings)
    if cue.kind is CueKind.ARRIVED:
        return guidance.reason is Reason.ARRIVED
    return cue.kind not in holds_while or guidance.action is holds_while[cue.kind]


def _with_heading(memory: CueMemory, guidance: Guidance, now_s: float) -> CueMemory:
    heading = guidance.trace.heading
    if heading is None or (memory.heading_rad is not None and abs(wrap_rad(heading - memory.heading_rad)) < _STILL_RAD):
        return memory
    return replace(memory, heading_rad=float(heading), still_since_s=now_s)


def _with_straight(memory: CueMemory, guidance: Guidance, settings: Settings, now_s: float) -> CueMemory:
    if not _is_straight(guidance, settings):
        return replace(memory, straight_since_s=None)
    return replace(memory, straight_since_s=now_s) if memory.straight_since_s is None else memory


def _of_route(memory: CueMemory, guidance: Guidance) -> CueMemory:
    if memory.route_version == guidance.route_version:
        return memory
    return replace(memory, route_version=guidance.route_version, reassured_m=None, announced=frozenset())


def _told(memory: CueMemory, guidance: Guidance, now_s: float) -> CueMemory:
    return replace(
        memory, told_action=guidance.action, told_reason=guidance.reason, told_s=now_s, told_target_rad=None,
        changed_since_s=None,
    )  # fmt: skip


def _is_repeated(reason: Reason) -> bool:
    return reason not in (Reason.ARRIVED, Reason.NO_ROUTE, Reason.PAUSED)


def _is_straight(guidance: Guidance, settings: Settings) -> bool:
    """Whether the walker walks straight on."""
    if guidance.action is not Action.WALK or guidance.direction is None:
        return False
    return abs(math.degrees(guidance.direction)) <= settings.cues.straight_within_deg


def _has_time(memory: CueMemory, now_s: float) -> bool:
    """Whether the walker has been walking straight on for long enough to listen."""
    return memory.straight_since_s is not None and now_s - memory.straight_since_s >= _STRAIGHT_HOLD_S


def _rounded_deg(direction_rad: float) -> float:
    """Round to what can be spoken and turned to; never to nothing."""
    degrees = math.degrees(direction_rad)
    rounded = _ROUND_TO_DEG * round(degrees / _ROUND_TO_DEG)
    return math.copysign(_ROUND_TO_DEG, degrees) if rounded == 0.0 and abs(degrees) > 1.0 else rounded


def _spoken(stop: RouteStop) -> str:
    return stop.spoken_name or stop.name


def _arrived_text(route: Route | None, language: Language) -> str:
    name = _spoken(route.stops[-1]) if route is not None and route.stops else ""
    return TEXTS[language]["arrived"].format(name=name) if name else TEXTS[language]["arrived"].split(":")[0]

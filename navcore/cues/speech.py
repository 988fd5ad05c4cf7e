"""From guidance to what is heard: instructions when they change, tones and ticks in between. Pure.

The walker acts on cues alone and stops by themselves after a second and a half of silence, so that while *walk* holds
something is heard at least every ``tick_interval_s``. A turn on the spot is said once; it is said again only when the
walker stands still in a wrong direction, or the direction to turn to has become another one.
"""

from __future__ import annotations

import math
from dataclasses import replace

from navcore.angles import wrap_rad
from navcore.cues import bus as cue_bus
from navcore.cues.announcements import OF_THE_MAP, announcement, is_straight, spoken_name
from navcore.cues.bus import CueBus
from navcore.cues.directions import move_text, told_move_deg, told_turn_deg, turn_text
from navcore.cues.memory import CueMemory
from navcore.cues.synthesis import beep_cue, beep_interval_s, steer_cue, stop_cue, tick_cue
from navcore.cues.table import ANNOUNCEMENTS, OF_PRIVACY, PRIORITY, Cue, CueKind, CuePriority
from navcore.cues.texts import TEXTS, Language
from navcore.settings import CueSettings, Settings
from navcore.types import Action, Guidance, Reason, Route, SonarState

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
_AIM_DEG = 3.0
"""A tone is not heard from a more exact direction than this (J. Blauert, "Spatial Hearing")."""
_OFF_ROAD_REPEAT_S = 10.0
_UNCERTAIN_REPEAT_S = 20.0
_NOTICE_HOLD_S = 1.0
"""A sensor or a pose that fails for a moment only is not talked about; guidance heeds it at once."""
_LOST_STATES = frozenset({SonarState.STALE, SonarState.ABSENT})


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
    for stage in (_instruction, _heart_beat, _beep, _notices):
        cues, memory = stage(guidance, memory, route, settings, now_s)
        wanted += cues
    if all(cue.is_tone for cue in wanted):
        announced, memory = announcement(guidance, memory, route, settings, now_s)
        wanted += [announced] if announced is not None else []
    played, heard = cue_bus.play(
        memory.bus, wanted, now_s, settings.cues.language, lambda cue: _still_holds(cue, guidance, settings)
    )
    memory, heard = _cut_off(_with_tones(memory, before, played), before, played, heard, now_s)
    return played, replace(memory, bus=heard)


def say(
    text: str, memory: CueMemory, settings: Settings, now_s: float, kind: CueKind = CueKind.MESSAGE
) -> tuple[tuple[Cue, ...], CueMemory]:
    """Speak a sentence of a person at the console, or one of the device, as soon as nothing higher is heard."""
    cue = Cue(now_s, kind, PRIORITY[kind], text)
    played, bus = cue_bus.play(memory.bus, [cue], now_s, settings.cues.language, lambda _: True)
    memory, bus = _cut_off(memory, memory, played, bus, now_s)
    return played, replace(memory, bus=bus)


def sound(tone: Cue, memory: CueMemory, settings: Settings, now_s: float) -> tuple[tuple[Cue, ...], CueMemory]:
    """Play a tone that is none of guidance, where no words are heard just now; else nothing."""
    played, bus = cue_bus.play(memory.bus, [tone], now_s, settings.cues.language, lambda _: True)
    return played, replace(memory, bus=bus)


def repeat_last(
    guidance: Guidance, memory: CueMemory, settings: Settings, now_s: float, otherwise: str = ""
) -> tuple[tuple[Cue, ...], CueMemory]:
    """Say the last sentence again, where there is one that is still true; else say something else, if anything."""
    last = memory.bus.repeatable
    if last is None or not _still_holds(last, guidance, settings):
        return say(otherwise, memory, settings, now_s, CueKind.ANSWER) if otherwise else ((), memory)
    repeats = last.repeats or last.kind
    again = replace(last, stamp_s=now_s, angle_deg=None, kind=CueKind.MESSAGE, repeats=repeats)
    played, bus = cue_bus.play(memory.bus, [again], now_s, settings.cues.language, lambda _: True)
    memory, bus = _cut_off(memory, memory, played, bus, now_s)
    return played, replace(memory, bus=bus)


def forget(kinds: frozenset[CueKind], memory: CueMemory) -> CueMemory:
    """Return the memory without sentences of some kinds that wait, or could be said again: they are no longer true."""
    bus, last = memory.bus, memory.bus.repeatable
    waiting = tuple(cue for cue in bus.waiting if (cue.repeats or cue.kind) not in kinds)
    is_outdated = last is not None and (last.repeats or last.kind) in kinds
    return replace(memory, bus=replace(bus, waiting=waiting, repeatable=None if is_outdated else last))


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
        text = _arrived_text(route, guidance.trace.uncertain_since_s is None, settings.language)
        cue = Cue(now_s, CueKind.ARRIVED, PRIORITY[CueKind.ARRIVED], text)
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
    angle_deg = told_turn_deg(guidance.direction, settings.direction_style)
    text = turn_text(angle_deg, settings.direction_style, settings.language)
    cue = Cue(now_s, CueKind.TURN, PRIORITY[CueKind.TURN], text, angle_deg)
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
    # Nobody turns before they have heard by how much: standing still counts from then on.
    speaking = memory.bus.speaking
    heard_s = memory.bus.until_s if speaking is not None and speaking.kind is CueKind.TURN else memory.told_s
    has_turned = memory.still_since_s > memory.told_s
    stands_still = now_s - max(memory.still_since_s, heard_s) >= _STILL_S
    # Where poses are so noisy that nobody seems ever to stand still, it is said again all the same.
    forgotten = since_s >= _STOP_REPEAT_FACTOR * settings.turn_repeat_s
    return is_new or forgotten or (stands_still and (has_turned or since_s >= settings.turn_repeat_s))


def _walk(guidance: Guidance, memory: CueMemory, settings: CueSettings, now_s: float) -> Stage:
    if guidance.direction is None or memory.told_action is Action.WALK:
        return [], memory
    angle_deg = told_move_deg(guidance.direction, settings.straight_within_deg, settings.direction_style)
    text = move_text(angle_deg, settings.direction_style, settings.language)
    cue = Cue(now_s, CueKind.WALK, PRIORITY[CueKind.WALK], text, angle_deg)
    return [cue], _told(memory, guidance, now_s)


# --------------------------------------------------------------------------------------------------------- tones
def _heart_beat(guidance: Guidance, memory: CueMemory, route: Route | None, settings: Settings, now_s: float) -> Stage:
    if guidance.action is not Action.WALK or guidance.direction is None:
        return [], memory
    angle_deg = math.degrees(guidance.direction)
    straight_deg = settings.cues.straight_within_deg
    steers = abs(angle_deg) > (_AIM_DEG if memory.aims else straight_deg)
    steered = abs(memory.tone_angle_deg) > straight_deg
    interval_s = settings.cues.steer_interval_s if steers else settings.cues.tick_interval_s
    if now_s - memory.tone_s < interval_s and not (steered and not steers):
        return [], memory
    cue = steer_cue(now_s, round(angle_deg, 1)) if steers else tick_cue(now_s)
    return [cue], replace(memory, tone_s=now_s, tone_angle_deg=angle_deg, aims=False)


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


# --------------------------------------------------------------------------------------------------------- parts
def _still_holds(cue: Cue, guidance: Guidance, settings: Settings) -> bool:
    """Whether a sentence that waited, or was cut off, is still true; an announcement gives way to steering for good."""
    holds_while = {
        CueKind.STOP: Action.STOP, CueKind.TURN: Action.TURN, CueKind.WALK: Action.WALK,
        CueKind.HAZARD_AHEAD: Action.WALK, CueKind.CAUTION_SIDE: Action.WALK, CueKind.NARROW_PASSAGE: Action.WALK,
        CueKind.EXPLANATION: Action.STOP,
    }  # fmt: skip
    kind = cue.repeats or cue.kind
    if kind in ANNOUNCEMENTS and kind not in holds_while:
        return is_straight(guidance, settings)
    if kind is CueKind.ARRIVED:
        return guidance.reason is Reason.ARRIVED
    return kind not in holds_while or guidance.action is holds_while[kind]


def _with_tones(memory: CueMemory, before: CueMemory, played: tuple[Cue, ...]) -> CueMemory:
    """Remember tones only as far as they were heard: one that somebody spoke over is due when they have finished.

    Words say the direction of a movement roughly; the tone that follows them says the rest.
    """
    if not any(cue.kind is CueKind.OBSTACLE_BEEP for cue in played):
        memory = replace(memory, beep_s=before.beep_s)
    if any(cue.kind in (CueKind.TICK, CueKind.STEER) for cue in played):
        return memory
    told_deg = [cue.angle_deg for cue in played if cue.kind is CueKind.WALK and cue.angle_deg is not None]
    return replace(
        memory, tone_s=before.tone_s, tone_angle_deg=told_deg[0] if told_deg else before.tone_angle_deg,
        aims=before.aims or bool(told_deg),
    )  # fmt: skip


def _cut_off(
    memory: CueMemory, before: CueMemory, played: tuple[Cue, ...], heard: CueBus, now_s: float
) -> tuple[CueMemory, CueBus]:
    """Announcements and what concerns privacy do not wait, nor does an answer that was begun: one can ask anew.

    An announcement of what the map knows that other words have cut off is made anew, with a true distance.
    """
    cut = before.bus.speaking if before.bus.is_speaking(now_s) else None
    heard = replace(
        heard,
        waiting=tuple(
            cue
            for cue in heard.waiting
            if cue.kind not in ANNOUNCEMENTS | OF_PRIVACY and not (cue is cut and cue.kind is CueKind.ANSWER)
        ),
    )
    if cut is None or cut.kind not in OF_THE_MAP or before.announcing is None:
        return memory, heard
    if all(cue.is_tone for cue in played):
        return memory, heard
    return replace(memory, announced=memory.announced - {before.announcing}), heard


def _with_heading(memory: CueMemory, guidance: Guidance, now_s: float) -> CueMemory:
    heading = guidance.trace.heading
    if heading is None or (memory.heading_rad is not None and abs(wrap_rad(heading - memory.heading_rad)) < _STILL_RAD):
        return memory
    return replace(memory, heading_rad=float(heading), still_since_s=now_s)


def _with_straight(memory: CueMemory, guidance: Guidance, settings: Settings, now_s: float) -> CueMemory:
    if not is_straight(guidance, settings):
        return replace(memory, straight_since_s=None)
    return replace(memory, straight_since_s=now_s) if memory.straight_since_s is None else memory


def _of_route(memory: CueMemory, guidance: Guidance) -> CueMemory:
    if memory.route_version == guidance.route_version:
        return memory
    return replace(
        memory, route_version=guidance.route_version, reassured_m=None, announced=frozenset(), announcing=None,
        corner_m=-math.inf,
    )  # fmt: skip


def _told(memory: CueMemory, guidance: Guidance, now_s: float) -> CueMemory:
    return replace(
        memory, told_action=guidance.action, told_reason=guidance.reason, told_s=now_s, told_target_rad=None,
        changed_since_s=None, explained=memory.explained if guidance.action is Action.STOP else None,
    )  # fmt: skip


def _is_repeated(reason: Reason) -> bool:
    return reason not in (Reason.ARRIVED, Reason.NO_ROUTE, Reason.PAUSED)


def _arrived_text(route: Route | None, is_sure: bool, language: Language) -> str:
    name = spoken_name(route.stops[-1]) if route is not None and route.stops else ""
    key = f"arrived{'' if name else '_here'}{'' if is_sure else '_unsure'}"
    return TEXTS[language][key].format(name=name)

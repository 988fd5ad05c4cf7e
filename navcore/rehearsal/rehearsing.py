"""One route walked in free space by the ideal walker, led by the real planner, guidance and cues. Pure.

No sensor is rendered and no clock is read: the scan says that everything is free and known, the pose is the truth, and
time is counted. The same input gives the same list.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from navcore.cues.announcements import USUAL_SPEED_M_S
from navcore.cues.memory import AT_REST, CueMemory
from navcore.cues.speech import cues_for, say
from navcore.cues.table import PRIORITY, Cue, CueKind
from navcore.cues.texts import TEXTS, Language, speech_duration_s
from navcore.errors import InputError, PlanningError
from navcore.geometry import world_from_camera_at
from navcore.guide import guide
from navcore.obstacle.corridor import candidate_directions
from navcore.obstacle.polar_grid import BEARING_STEP_RAD, MAX_BEARING_RAD, MAX_RANGE_M
from navcore.planning.poi_graph import Poi, PoiGraph
from navcore.planning.way_finding import WayFinder
from navcore.rehearsal.ideal_walker import IdealWalker
from navcore.settings import ObstacleSettings, Settings
from navcore.types import (
    BearingState,
    Guidance,
    Localization,
    LocalizationQuality,
    ObstacleScan,
    Reason,
    Route,
    SonarReading,
    SonarState,
)

CYCLE_S = 0.1
"""Time from one decision to the next, as on the device's slowest target."""
_STEPS_A_CYCLE = 2
_EYE_M = 1.6
_SET_OUT_M = 1.0
"""The walker looks at first to where the way leads after so much of it."""
_SPARE_S, _SPARE_FACTOR = 120.0, 15.0
"""Whoever has not arrived after this, and so many times the walking time, does not arrive any more."""
_MAX_REFUSAL = 500
"""Longest refusal that the device speaks."""


@dataclass(frozen=True, slots=True)
class Utterance:
    """One thing that is heard: words where there is a text, a tone where there is a frequency."""

    stamp_s: float
    """Seconds since the walker chose the destination."""
    x_m: float
    y_m: float
    """Where the walker is when it begins."""
    along_m: float
    """Arc length along the route there."""
    kind: CueKind
    text: str = ""
    lasts_s: float = 0.0
    """About how long it is heard; the words' part is an estimate."""
    angle_deg: float | None = None
    """Direction that is told, relative to the heading, left positive."""
    frequency_hz: float | None = None
    """Pitch of its tone; None for pure speech."""
    duration_s: float = 0.0
    """Length of its tone."""
    pan: float = 0.0
    """Place of the tone between the ears: −1 left, +1 right."""
    poi_id: str | None = None
    """The place that it announces."""
    distance_m: float | None = None
    """How far ahead is what it announces."""
    edge_id: str | None = None
    """The edge on which the walker is."""

    @property
    def cue(self) -> Cue:
        """The cue that is played."""
        return Cue(
            self.stamp_s, self.kind, PRIORITY[self.kind], self.text, self.angle_deg, self.distance_m,
            self.frequency_hz, self.duration_s, pan=self.pan,
        )  # fmt: skip


@dataclass(frozen=True, slots=True)
class Rehearsal:
    """What somebody would hear on the way from one place to another."""

    start_poi_id: str
    destination_poi_id: str
    language: Language
    utterances: tuple[Utterance, ...]
    """In order of time."""
    total_s: float = 0.0
    """Until the walker has arrived."""
    length_m: float = 0.0
    """Length of the route."""
    edge_ids: tuple[str, ...] = ()
    """The edges that it runs along, in order."""
    arrived: bool = False
    refusal: str = ""
    """Why there is no way, as the device says it, or why the walker does not arrive; empty where they do."""


class CancelledError(InputError):
    """Whoever wanted the rehearsal wants it no more."""


def rehearse(
    graph: PoiGraph,
    start_poi_id: str,
    destination_poi_id: str,
    settings: Settings | None = None,
    language: Language | None = None,
    *,
    speed_m_s: float = USUAL_SPEED_M_S,
    longest_m: float = math.inf,
    finder: WayFinder | None = None,
    cancelled: Callable[[], bool] = lambda: False,
) -> Rehearsal:
    """Return what would be heard by somebody who stands at a PoI, facing their way, and chooses a destination.

    Args:
        graph: the PoI-graph.
        start_poi_id: where the walker stands.
        destination_poi_id: where they want to go.
        settings: all thresholds, the style of directions and the verbosity.
        language: that of the speech; the settings' where it is None.
        speed_m_s: how fast they walk.
        longest_m: a longer way is refused.
        finder: a way finder of this graph and these settings, where there is one already.
        cancelled: asked now and then whether to give up.

    Raises InputError where there is no such start, the way is too long or the speed is nobody's, CancelledError.
    """
    settings = settings or Settings()
    if language is not None:
        settings = settings.changed({"cues.language": language})
    start = graph.pois.get(start_poi_id)
    if start is None:
        raise InputError(f"There is no place {start_poi_id!r} in the PoI-graph: choose another start.")
    if not 0.2 <= speed_m_s <= 2.0:
        raise InputError(f"Nobody is led at {speed_m_s:g} m/s: give a walking speed from 0.2 to 2 m/s.")
    finder = finder or WayFinder(graph, settings.planning)
    try:
        route = finder.route_to(destination_poi_id, start.x_m, start.y_m)
    except PlanningError as error:
        return _refused(start, graph, destination_poi_id, settings, str(error)[:_MAX_REFUSAL])
    if route.length_m > longest_m:
        raise InputError(
            f"The way is {route.length_m:.0f} m long, more than {longest_m:g} m: rehearse it in parts, from place to"
            " place."
        )
    return _walked(start, graph, destination_poi_id, route, settings, speed_m_s, cancelled)


def free_scan(settings: ObstacleSettings) -> ObstacleScan:
    """Return a scan in which everything is free and known."""
    bearing_rad = np.arange(-MAX_BEARING_RAD, MAX_BEARING_RAD + BEARING_STEP_RAD / 2.0, BEARING_STEP_RAD)
    nearest_m = np.full(len(bearing_rad), np.inf)
    state = np.full(len(bearing_rad), BearingState.FREE, dtype=np.int8)
    candidates = candidate_directions(bearing_rad, nearest_m, state, settings, MAX_RANGE_M)
    return ObstacleScan(bearing_rad, nearest_m, state, candidates, valid_fraction=1.0)


@dataclass(frozen=True, slots=True)
class _Heard:
    """The cues of one moment, and what is remembered of all that has been said."""

    cues: tuple[Cue, ...]
    memory: CueMemory


def _set_out(destination_name: str, settings: Settings) -> _Heard:
    text = TEXTS[settings.cues.language]["destination"].format(name=destination_name)
    return _Heard(*say(text, AT_REST, settings, 0.0, CueKind.ANSWER))


def _refused(start: Poi, graph: PoiGraph, goal_id: str, settings: Settings, refusal: str) -> Rehearsal:
    """The device repeats what was chosen, and says why it does not lead there."""
    language = settings.cues.language
    first = _set_out(_name_of(graph, goal_id), settings)
    second = _Heard(*say(refusal, first.memory, settings, first.memory.bus.until_s))
    here = IdealWalker(start.x_m, start.y_m, 0.0, USUAL_SPEED_M_S, 0.0)
    said = tuple(_utterance(cue, here, None, None, language) for cue in first.cues)
    here = replace(here, time_s=first.memory.bus.until_s)
    said += tuple(_utterance(cue, here, None, None, language) for cue in second.cues)
    return Rehearsal(start.id, goal_id, language, said, second.memory.bus.until_s, refusal=refusal)


def _walked(
    start: Poi, graph: PoiGraph, goal_id: str, route: Route, settings: Settings, speed_m_s: float,
    cancelled: Callable[[], bool],
) -> Rehearsal:  # fmt: skip
    language, scan = settings.cues.language, free_scan(settings.obstacle)
    walker = IdealWalker(start.x_m, start.y_m, _first_heading_rad(route), speed_m_s, settings.follower.reaction_s)
    heard = _set_out(_name_of(graph, goal_id), settings)
    said = [_utterance(cue, walker, None, route, language) for cue in heard.cues]
    guidance: Guidance | None = None
    arrived = False
    for cycle in range(1, round((_SPARE_S + _SPARE_FACTOR * route.length_m / speed_m_s) / CYCLE_S)):
        now_s = cycle * CYCLE_S
        if cancelled():
            raise CancelledError("The rehearsal was given up.")
        walker = replace(walker, time_s=now_s)
        guidance = _decided(now_s, walker, route, scan, guidance, settings)
        heard = _Heard(*cues_for(guidance, heard.memory, route, settings, now_s))
        for cue in heard.cues:
            said.append(_utterance(cue, walker, _Said(guidance, heard.memory), route, language))
            walker = walker.hear(cue, language)
        arrived = any(cue.kind is CueKind.ARRIVED for cue in heard.cues)
        if arrived:
            break
        walker = walker.led(guidance.direction)
        for _ in range(_STEPS_A_CYCLE):
            walker = walker.after(CYCLE_S / _STEPS_A_CYCLE)
    total_s = heard.memory.bus.until_s if arrived else walker.time_s
    return Rehearsal(
        start.id, goal_id, language, tuple(said), total_s, route.length_m,
        tuple(piece.edge_id for piece in route.pieces), arrived, "" if arrived else _not_arrived(walker, guidance),
    )  # fmt: skip


def _decided(
    now_s: float, walker: IdealWalker, route: Route, scan: ObstacleScan, before: Guidance | None, settings: Settings
) -> Guidance:
    pose = world_from_camera_at((walker.x_m, walker.y_m, _EYE_M), walker.heading_rad, 0.0)
    located = Localization(now_s, LocalizationQuality.LOCALIZED, pose)
    sonar = SonarReading(now_s, SonarState.NO_ECHO)
    return guide(now_s, located, route, scan, sonar, before, settings)


@dataclass(frozen=True, slots=True)
class _Said:
    """What a cue comes from, and what is remembered after it."""

    guidance: Guidance
    memory: CueMemory


def _utterance(cue: Cue, walker: IdealWalker, said: _Said | None, route: Route | None, language: Language) -> Utterance:
    left_m = None if said is None else said.guidance.trace.remaining_m
    along_m = 0.0 if route is None or left_m is None else route.length_m - left_m
    piece = None if route is None else route.piece_at(along_m)
    return Utterance(
        walker.time_s, walker.x_m, walker.y_m, along_m, cue.kind, cue.text,
        cue.duration_s + speech_duration_s(cue.text, language), cue.angle_deg, cue.frequency_hz, cue.duration_s,
        cue.pan, _place_announced(cue, said, route), cue.distance_m, None if piece is None else piece.edge_id,
    )  # fmt: skip


def _place_announced(cue: Cue, said: _Said | None, route: Route | None) -> str | None:
    if route is None or said is None:
        return None
    if cue.kind is CueKind.ARRIVED:
        return route.stops[-1].poi_id
    return said.memory.announcing if cue.kind in (CueKind.POI_AHEAD, CueKind.HAZARD_AHEAD) else None


def _first_heading_rad(route: Route) -> float:
    index = min(int(np.searchsorted(route.arc_length_m, _SET_OUT_M)), len(route.points_m) - 1)
    x_m, y_m = route.points_m[index] - route.points_m[0]
    return math.atan2(y_m, x_m)


def _name_of(graph: PoiGraph, poi_id: str) -> str:
    poi = graph.pois.get(poi_id)
    return poi_id if poi is None else poi.spoken_name or poi.name


def _not_arrived(walker: IdealWalker, guidance: Guidance | None) -> str:
    left_m = None if guidance is None else guidance.trace.remaining_m
    reason = Reason.NO_ROUTE if guidance is None else guidance.reason
    left = "" if left_m is None else f", {left_m:.1f} m before the destination"
    return (
        f"Guidance does not lead there: after {walker.time_s:.0f} s the walker is at ({walker.x_m:.1f},"
        f" {walker.y_m:.1f}){left}. {reason.sentence} Look at the road there."
    )

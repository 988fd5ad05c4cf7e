"""What the walker is told of ahead, at the right distance for their speed, and while they have time to listen. Pure.

An announcement begins at its time or not at all: it never waits, for the distance in it would be wrong by then. What it
announces comes no earlier than the walker can have heard it out and reacted, and no later than they remember it:

==================  ================================================================================================
a place             ``announce_m`` at the usual speed, more for whoever walks faster, less for whoever walks slower,
                    from 2/3 to 3/2 of it; a sentence longer than that leaves time for begins earlier
a turn              so that the sentence is over ``turn_lead_s`` before the turn is due; not when it could not be over
stairs              as a place; but late rather than not at all, and whatever the verbosity
caution, narrow     when the walker has come onto the edge and walks, for only then are left and right those of the way;
                    it waits for other words while it can still begin early on the edge, and not longer; but late
                    rather than not at all, and whatever the verbosity
reassurance         as soon as there is time, after ``reassurance_m``
==================  ================================================================================================

A reassurance comes after the others: it does not cut them off, make a place be told later than ``announce_m`` less 1 m,
a turn too late to be told at all, or a caution wait. Nor does a caution where it can wait.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

from navcore.cues.bus import PAUSE_S
from navcore.cues.directions import told_turn_deg, turn_text
from navcore.cues.memory import CueMemory
from navcore.cues.table import PRIORITY, Cue, CueKind, is_said
from navcore.cues.texts import EXPLANATIONS, HAZARD_KINDS, TEXTS, distance_text, place_text, speech_duration_s
from navcore.settings import ObstacleSettings, Settings
from navcore.types import Action, Guidance, Reason, Route, RoutePiece, RouteStop

USUAL_SPEED_M_S = 0.85
"""The middle of what blind pedestrians walk: 0.6 to 1.1 m/s (D. Clark-Carter, A. Heyes, C. Howarth, "The efficiency and
walking speed of visually impaired people", Ergonomics 29, 1986)."""
LEAST_SHARE, MOST_SHARE = 2.0 / 3.0, 3.0 / 2.0
"""A place is announced at no less and no more than these parts of ``announce_m``, however slow or fast the walker."""
_WINDOW_M = 1.0
"""However long the sentence, there is a piece of the way this long on which it may begin."""
PLACE_TOLERANCE_M = 1.0
"""Wayfindr: a place is announced 6 ± 1 m ahead."""
NARROW_MARGIN_M = 0.2
"""People who walk by what they hear sway so far: a passage less than this wider than a person is narrow for them."""
OF_THE_MAP = frozenset({CueKind.POI_AHEAD, CueKind.HAZARD_AHEAD, CueKind.CAUTION_SIDE, CueKind.NARROW_PASSAGE})
"""What the map knows of the way, each thing said once; again where other words have cut it off."""
BEGINS_SHARE, BEGINS_M = 0.45, 5.0
"""What is to be known of an edge begins in this part of it, and on no more than so much of it, whatever else is due."""
_CYCLE_S = 0.1
"""So much later at most is decided again whether something may begin."""
_STRAIGHT_HOLD_S = 1.0
"""There is time for an announcement when the walker has needed no steering for so long."""
_SAME_CORNER_M = 1.0
_DEVIATION_M = 0.5
"""Nearer than this to the middle of the road, nobody wants to hear where it is."""
_DEVIATION_REPEAT_S = 10.0
_EXPLAIN_AFTER_S = 1.0
"""A stop that is over sooner needs no explanation."""

Announced = tuple[Cue | None, CueMemory]


def announcement(
    guidance: Guidance, memory: CueMemory, route: Route | None, settings: Settings, now_s: float
) -> Announced:
    """Return the most important announcement that may begin now, if any, and what to remember of it."""
    for kind, stage in _STAGES.items():
        if is_said(kind, settings.cues.verbosity) and _may_begin(kind, memory, now_s):
            cue, told = stage(guidance, memory, route, settings, now_s)
            if cue is not None:
                return cue, told
            memory = told
    return None, memory


def place_distances_m(speed_m_s: float, sentence_s: float, settings: Settings) -> tuple[float, float]:
    """Return how far before a place its announcement may begin: at the latest, and at the earliest.

    At the latest the walker still hears it out and has their reaction time before they come to the place.
    """
    latest_m = speed_m_s * (sentence_s + settings.follower.reaction_s)
    usual_m = settings.cues.announce_m
    share = min(max(speed_m_s / USUAL_SPEED_M_S, LEAST_SHARE), MOST_SHARE)
    return latest_m, max(usual_m * share, latest_m + _WINDOW_M)


def turn_distances_m(speed_m_s: float, sentence_s: float, turn_m: float, settings: Settings) -> tuple[float, float]:
    """Return how far before a corner its announcement may begin: at the latest, and at the earliest.

    ``turn_m`` before the corner the turn itself is told; by then the sentence is over.
    """
    latest_m = turn_m + speed_m_s * (sentence_s + PAUSE_S)
    return latest_m, latest_m + speed_m_s * settings.cues.turn_lead_s


def is_narrow(width_m: float | None, settings: ObstacleSettings) -> bool:
    """Return whether a passage is hardly wider than a person; one that nobody has measured is not said to be."""
    return width_m is not None and width_m < settings.person_width_m + NARROW_MARGIN_M


def is_straight(guidance: Guidance, settings: Settings) -> bool:
    """Return whether the walker walks straight on."""
    if guidance.action is not Action.WALK or guidance.direction is None:
        return False
    return abs(math.degrees(guidance.direction)) <= settings.cues.straight_within_deg


def spoken_name(stop: RouteStop) -> str:
    """Return what a place is called aloud."""
    return stop.spoken_name or stop.name


def _may_begin(kind: CueKind, memory: CueMemory, now_s: float) -> bool:
    """Announcements begin where nobody speaks, or something less important, and where nothing waits to be said."""
    bus = memory.bus
    speaking = bus.speaking if bus.is_speaking(now_s) else None
    return not bus.waiting and (speaking is None or speaking.priority < PRIORITY[kind])


# ------------------------------------------------------------------------------------------------------- places
def _hazard(guidance: Guidance, memory: CueMemory, route: Route | None, settings: Settings, now_s: float) -> Announced:
    if guidance.action is not Action.WALK:
        return None, memory
    return _place(CueKind.HAZARD_AHEAD, guidance, memory, route, settings, now_s)


def _poi(guidance: Guidance, memory: CueMemory, route: Route | None, settings: Settings, now_s: float) -> Announced:
    if not _has_time(memory, now_s):
        return None, memory
    return _place(CueKind.POI_AHEAD, guidance, memory, route, settings, now_s)


def _place(
    kind: CueKind, guidance: Guidance, memory: CueMemory, route: Route | None, settings: Settings, now_s: float
) -> Announced:
    is_hazard = kind is CueKind.HAZARD_AHEAD
    for place in _places_ahead(guidance, memory, route, settings):
        is_too_late = place.ahead_m < place.latest_m and not is_hazard
        if place.kind is not kind or place.ahead_m > place.earliest_m or is_too_late:
            continue
        cue = Cue(now_s, kind, PRIORITY[kind], place.text, distance_m=place.ahead_m)
        return cue, _announced(memory, place.poi_id)
    return None, memory


@dataclass(frozen=True, slots=True)
class _PlaceAhead:
    """A place on the way that has not been announced yet, and between which distances it may be."""

    kind: CueKind
    poi_id: str
    text: str
    ahead_m: float
    latest_m: float
    earliest_m: float


def _places_ahead(
    guidance: Guidance, memory: CueMemory, route: Route | None, settings: Settings
) -> Iterator[_PlaceAhead]:
    """Yield what is to be announced of the places on the way that lie ahead, the nearest first."""
    left_m, language = guidance.trace.remaining_m, settings.cues.language
    if route is None or left_m is None:
        return
    for stop in route.stops:
        ahead_m = stop.distance_m - (route.length_m - left_m)
        kind = CueKind.HAZARD_AHEAD if stop.kind in HAZARD_KINDS else CueKind.POI_AHEAD
        is_passed_over = stop.is_silent and kind is CueKind.POI_AHEAD
        if ahead_m <= 0.0 or stop.poi_id in memory.announced or is_passed_over:
            continue
        text = place_text(spoken_name(stop), stop.kind, ahead_m, language)
        sentence_s = speech_duration_s(text, language)
        latest_m, earliest_m = place_distances_m(guidance.trace.speed_m_s, sentence_s, settings)
        yield _PlaceAhead(kind, stop.poi_id, text, ahead_m, latest_m, earliest_m)


def _announced(memory: CueMemory, what: str) -> CueMemory:
    return replace(memory, announced=memory.announced | {what}, announcing=what)


# ----------------------------------------------------------------------------------------- what is beside the way
def _caution(guidance: Guidance, memory: CueMemory, route: Route | None, settings: Settings, now_s: float) -> Announced:
    piece = _piece_walked(guidance, route)
    if piece is None or piece.caution_side == "none":
        return None, memory
    return _of_the_edge(
        CueKind.CAUTION_SIDE, f"caution_{piece.caution_side}", piece, guidance, memory, route, settings, now_s
    )


def _narrow(guidance: Guidance, memory: CueMemory, route: Route | None, settings: Settings, now_s: float) -> Announced:
    piece = _piece_walked(guidance, route)
    if piece is None or not is_narrow(piece.width_m, settings.obstacle):
        return None, memory
    return _of_the_edge(CueKind.NARROW_PASSAGE, "narrow_passage", piece, guidance, memory, route, settings, now_s)


def _piece_walked(guidance: Guidance, route: Route | None) -> RoutePiece | None:
    """Return the piece of the route that the walker walks on; None while they stand or turn."""
    left_m = guidance.trace.remaining_m
    if route is None or left_m is None or guidance.action is not Action.WALK:
        return None
    return route.piece_at(route.length_m - left_m)


def _of_the_edge(
    kind: CueKind, key: str, piece: RoutePiece, guidance: Guidance, memory: CueMemory, route: Route | None,
    settings: Settings, now_s: float,
) -> Announced:  # fmt: skip
    """Say once what is to be known of an edge."""
    # No identifier of a PoI has a colon.
    what = f"{kind.value}:{piece.edge_id}"
    text = TEXTS[settings.cues.language][key]
    if what in memory.announced:
        return None, memory
    wait_s = _wait_s(text, guidance, memory, route, settings, now_s)
    if _makes_a_hazard_too_late(text, guidance, memory, route, settings):
        return None, memory
    if wait_s > 0.0 and _walked_m(guidance, route) + guidance.trace.speed_m_s * wait_s <= _latest_begin_m(piece):
        return None, memory
    return Cue(now_s, kind, PRIORITY[kind], text), _announced(memory, what)


def _makes_a_hazard_too_late(
    text: str, guidance: Guidance, memory: CueMemory, route: Route | None, settings: Settings
) -> bool:
    """Whether, with a sentence said first, stairs could not be heard of before the walker is there."""
    heard_m = guidance.trace.speed_m_s * _heard_s(text, settings)
    return any(
        place.kind is CueKind.HAZARD_AHEAD and place.ahead_m - heard_m < place.latest_m
        for place in _places_ahead(guidance, memory, route, settings)
    )


def _heard_s(text: str, settings: Settings) -> float:
    """Return how long it takes until something else can begin after a sentence."""
    return speech_duration_s(text, settings.cues.language) + PAUSE_S + _CYCLE_S


def _walked_m(guidance: Guidance, route: Route | None) -> float:
    left_m = guidance.trace.remaining_m
    return math.inf if route is None or left_m is None else route.length_m - left_m


def _latest_begin_m(piece: RoutePiece) -> float:
    """Return up to where on the route what is to be known of a piece waits for other words."""
    return piece.start_m + min(BEGINS_SHARE * (piece.end_m - piece.start_m), BEGINS_M)


def _wait_s(
    text: str, guidance: Guidance, memory: CueMemory, route: Route | None, settings: Settings, now_s: float
) -> float:
    """Return how long a sentence must wait to neither cut off another nor make the next place or turn be told too late.

    Zero where it may begin now.
    """
    wait_s = memory.bus.until_s - now_s if memory.bus.is_speaking(now_s) else 0.0
    speed_m_s, verbosity = guidance.trace.speed_m_s, settings.cues.verbosity
    heard_m = speed_m_s * _heard_s(text, settings)
    turn = _next_turn(guidance, memory, route, settings) if is_said(CueKind.TURN_AHEAD, verbosity) else None
    due: list[tuple[_PlaceAhead | _TurnAhead, float]] = [(turn, turn.latest_m)] if turn is not None else []
    due += [
        (place, place.earliest_m - PLACE_TOLERANCE_M)
        for place in _places_ahead(guidance, memory, route, settings)
        if is_said(place.kind, verbosity)
    ]
    for each, latest_m in due:
        # Where nobody moves, nothing comes nearer.
        if each.ahead_m - heard_m < latest_m <= each.ahead_m:
            begins_s = max(0.0, each.ahead_m - each.earliest_m) / speed_m_s
            wait_s = max(wait_s, begins_s + _heard_s(each.text, settings))
    return wait_s


# -------------------------------------------------------------------------------------------------------- turns
def _turn_ahead(
    guidance: Guidance, memory: CueMemory, route: Route | None, settings: Settings, now_s: float
) -> Announced:
    turn = _next_turn(guidance, memory, route, settings)
    if turn is None or not _has_time(memory, now_s) or not turn.latest_m <= turn.ahead_m <= turn.earliest_m:
        return None, memory
    cue = Cue(now_s, CueKind.TURN_AHEAD, PRIORITY[CueKind.TURN_AHEAD], turn.text, distance_m=turn.ahead_m)
    return cue, replace(memory, corner_m=turn.corner_m)


@dataclass(frozen=True, slots=True)
class _TurnAhead:
    """The next turn, where it has not been announced yet, and between which distances it may be."""

    text: str
    corner_m: float
    """Arc length of the corner."""
    ahead_m: float
    latest_m: float
    earliest_m: float


def _next_turn(guidance: Guidance, memory: CueMemory, route: Route | None, settings: Settings) -> _TurnAhead | None:
    corner = guidance.trace.corner
    if corner is None or route is None:
        return None
    corner_m = float(route.arc_length_m[min(corner.route_index, len(route.arc_length_m) - 1)])
    if abs(corner_m - memory.corner_m) < _SAME_CORNER_M:
        return None
    text = _turn_ahead_text(corner.distance_m, float(corner.bend), settings)
    sentence_s = speech_duration_s(text, settings.cues.language)
    latest_m, earliest_m = turn_distances_m(guidance.trace.speed_m_s, sentence_s, corner.turn_m, settings)
    return _TurnAhead(text, corner_m, corner.distance_m, latest_m, earliest_m)


def _turn_ahead_text(distance_m: float, bend_rad: float, settings: Settings) -> str:
    language, style = settings.cues.language, settings.cues.direction_style
    distance = distance_text(max(1.0, distance_m), language)
    if settings.cues.verbosity == "full":
        turn = turn_text(told_turn_deg(bend_rad, style), style, language)
        return TEXTS[language]["turn_ahead_exact"].format(distance=distance, turn=turn[0].lower() + turn[1:])
    return TEXTS[language][f"turn_ahead_{'left' if bend_rad > 0.0 else 'right'}"].format(distance=distance)


# --------------------------------------------------------------------------------------------------- reassurance
def _reassurance(
    guidance: Guidance, memory: CueMemory, route: Route | None, settings: Settings, now_s: float
) -> Announced:
    left_m = guidance.trace.remaining_m
    if left_m is None or guidance.action is not Action.WALK:
        return None, memory
    if memory.reassured_m is None:
        return None, replace(memory, reassured_m=left_m)
    if memory.reassured_m - left_m < settings.cues.reassurance_m or not _has_time(memory, now_s):
        return None, memory
    distance = distance_text(left_m, settings.cues.language)
    text = TEXTS[settings.cues.language]["reassurance"].format(distance=distance)
    is_near = _comes_onto_a_caution(text, guidance, route, settings)
    if is_near or _wait_s(text, guidance, memory, route, settings, now_s) > 0.0:
        return None, memory
    cue = Cue(now_s, CueKind.REASSURANCE, PRIORITY[CueKind.REASSURANCE], text, distance_m=left_m)
    return cue, replace(memory, reassured_m=left_m)


def _comes_onto_a_caution(text: str, guidance: Guidance, route: Route | None, settings: Settings) -> bool:
    """Whether, before a sentence were heard out, the walker came to where there is something to know of the edge.

    Beyond a turn that is told only after the turn.
    """
    walked_m, corner = _walked_m(guidance, route), guidance.trace.corner
    heard_m = guidance.trace.speed_m_s * _heard_s(text, settings)
    straight_m = heard_m if corner is None else min(heard_m, corner.distance_m - corner.turn_m)
    return route is not None and any(
        walked_m <= piece.start_m <= walked_m + straight_m
        and (piece.caution_side != "none" or is_narrow(piece.width_m, settings.obstacle))
        for piece in route.pieces
    )


def _deviation(
    guidance: Guidance, memory: CueMemory, route: Route | None, settings: Settings, now_s: float
) -> Announced:
    """Say where the road is to somebody who walks beside it; whoever is off it hears that from the notices."""
    trace = guidance.trace
    aside_m = trace.deviation_m
    if route is None or aside_m is None or aside_m < _DEVIATION_M or guidance.reason is not Reason.OK:
        return None, memory
    side = _road_side(guidance, route)
    if side is None or now_s - memory.deviation_s < _DEVIATION_REPEAT_S or not _has_time(memory, now_s):
        return None, memory
    distance = distance_text(aside_m, settings.cues.language, decimals=1)
    text = TEXTS[settings.cues.language][f"deviation_{side}"].format(distance=distance)
    cue = Cue(now_s, CueKind.DEVIATION, PRIORITY[CueKind.DEVIATION], text, distance_m=aside_m)
    return cue, replace(memory, deviation_s=now_s)


def _road_side(guidance: Guidance, route: Route) -> str | None:
    """Return on which side of the walker the closest point of the road lies; None where it is not beside them."""
    trace = guidance.trace
    if trace.position is None or trace.heading is None or trace.closest_index is None:
        return None
    x_m, y_m = route.points_m[min(trace.closest_index, len(route.points_m) - 1)] - trace.position
    c, s = math.cos(trace.heading), math.sin(trace.heading)
    ahead_m, left_m = c * x_m + s * y_m, c * y_m - s * x_m
    if abs(left_m) <= abs(ahead_m):
        return None
    return "left" if left_m > 0.0 else "right"


# ------------------------------------------------------------------------------------------------- explanations
def _explanation(
    guidance: Guidance, memory: CueMemory, route: Route | None, settings: Settings, now_s: float
) -> Announced:
    """Say why, once the stop itself has been told and has held for a moment."""
    reason = guidance.reason
    is_told = memory.told_action is Action.STOP and memory.told_reason is reason and math.isfinite(memory.told_s)
    if guidance.action is not Action.STOP or not is_told or memory.explained is reason:
        return None, memory
    if now_s - memory.told_s < _EXPLAIN_AFTER_S:
        return None, memory
    text = EXPLANATIONS[settings.cues.language][reason]
    return Cue(now_s, CueKind.EXPLANATION, PRIORITY[CueKind.EXPLANATION], text), replace(memory, explained=reason)


def _has_time(memory: CueMemory, now_s: float) -> bool:
    """Whether the walker has been walking straight on for long enough to listen."""
    return memory.straight_since_s is not None and now_s - memory.straight_since_s >= _STRAIGHT_HOLD_S


_STAGES = {
    CueKind.CAUTION_SIDE: _caution,
    CueKind.NARROW_PASSAGE: _narrow,
    CueKind.HAZARD_AHEAD: _hazard,
    CueKind.TURN_AHEAD: _turn_ahead,
    CueKind.POI_AHEAD: _poi,
    CueKind.REASSURANCE: _reassurance,
    CueKind.DEVIATION: _deviation,
    CueKind.EXPLANATION: _explanation,
}
"""In the order in which they are considered: of two that are due, the more urgent one begins."""

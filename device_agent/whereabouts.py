"""Where the walker is, in words: the answer to *where am I*, and what the device does. Pure.

It says no more than is known: of a lost position only where and when it was last sure, of an uncertain one that it is.
"""

from __future__ import annotations

import math

from device_agent.state import DeviceState
from navcore.cues.directions import place_direction_text
from navcore.cues.texts import TEXTS, Language, distance_text
from navcore.errors import PlanningError
from navcore.modes import Mode
from navcore.planning.poi_graph import Poi
from navcore.planning.way_finding import WayFinder
from navcore.types import Action, LocalizationQuality, Pose2D

HERE_M = 1.0
"""Whoever is nearer to a place than this is there."""
_REMEMBERED_S = 600.0
_STOPS_STANDING, _STOPS_WALKING = 2, 1
"""Next stops of the route that are named: whoever walks hears less, because tones are silent meanwhile."""


def mode_text(state: DeviceState) -> str:
    """Return what the device does, as the walker hears it."""
    texts = TEXTS[state.settings.cues.language]
    if state.mode is Mode.LOCALIZING and not state.has_map:
        return texts["mode_no_map"]
    return texts[f"mode_{state.mode.value}"].format(name=state.place_name(state.destination_id))


def whereabouts(state: DeviceState, now_s: float) -> str:
    """Return where the walker is: the nearest place on the road, the way that is left, and how sure this is."""
    language, located = state.settings.cues.language, state.located
    pose = located.pose if located is not None else None
    if located is None or pose is None or located.quality is LocalizationQuality.LOST:
        return _joined([mode_text(state), *_unknown(state, now_s)], language)
    parts = [] if located.quality is LocalizationQuality.LOCALIZED else [TEXTS[language]["pose_uncertain"]]
    if state.mode not in (Mode.READY, Mode.LOCALIZING, Mode.GUIDING):
        parts.append(mode_text(state))
    parts += [_nearest(state, pose), *_way(state)]
    # Whoever has arrived is at the place that is nearest.
    return _joined(list(dict.fromkeys(parts)), language)


def costs_m(state: DeviceState, pose: Pose2D) -> dict[str, float]:
    """Return what the way to each place costs, where one leads there; nothing for one who is away from the road."""
    try:
        return finder_of(state).costs_m(pose.x_m, pose.y_m, heading=pose.heading)
    except PlanningError:
        return {}


def finder_of(state: DeviceState) -> WayFinder:
    """Return the way finder of the state's graph: the one that it keeps, where it is still of this graph."""
    kept, settings = state.way_finder, state.settings.planning
    if kept is not None and kept.graph is state.graph and kept.settings == settings:
        return kept
    return WayFinder(state.graph, settings)


def name_of(poi: Poi) -> str:
    """Return what a place is called aloud."""
    return poi.spoken_name or poi.name


def _unknown(state: DeviceState, now_s: float) -> list[str]:
    texts, language = TEXTS[state.settings.cues.language], state.settings.cues.language
    if state.sure is None or now_s - state.sure[0] > _REMEMBERED_S:
        return [texts["where_unknown"]]
    since_s, pose = state.sure
    found = _nearest_place(state, pose)
    if found is None:
        return [texts["where_unknown"]]
    seconds = max(1, round(now_s - since_s))
    return [
        texts["where_last"].format(
            seconds=seconds, name=name_of(found[0]), distance=distance_text(max(1.0, found[1]), language)
        )
    ]


def _nearest(state: DeviceState, pose: Pose2D) -> str:
    cues = state.settings.cues
    texts, found = TEXTS[cues.language], _nearest_place(state, pose)
    if found is None:
        return texts["where_no_place"]
    poi, distance_m = found
    if distance_m < HERE_M:
        return texts["where_here"].format(name=name_of(poi))
    bearing = math.atan2(poi.y_m - pose.y_m, poi.x_m - pose.x_m) - pose.heading
    direction = place_direction_text(bearing, cues.direction_style, cues.language)
    distance = distance_text(distance_m, cues.language)
    return texts["where_near"].format(name=name_of(poi), distance=distance, direction=direction)


def _nearest_place(state: DeviceState, pose: Pose2D) -> tuple[Poi, float] | None:
    """Return the place that is nearest along the road, and how far it is as the crow flies.

    Behind a wall there may be a nearer one, to which nobody can go from here. Junctions without a spoken name have
    nothing that could be said.
    """
    along_m = costs_m(state, pose)
    named = [poi for poi in state.graph.pois.values() if poi.on_road and (poi.kind != "junction" or poi.spoken_name)]
    if not named:
        return None
    straight_m = {poi.id: math.hypot(poi.x_m - pose.x_m, poi.y_m - pose.y_m) for poi in named}
    reachable = [poi for poi in named if poi.id in along_m] or named
    nearest = min(reachable, key=lambda poi: (along_m.get(poi.id, straight_m[poi.id]), poi.id))
    return nearest, straight_m[nearest.id]


def _way(state: DeviceState) -> list[str]:
    """Return the way that is left and the next stops on it."""
    route, guidance, language = state.route, state.guidance, state.settings.cues.language
    if route is None or not route.stops or guidance is None or guidance.route_version != state.route_version:
        return []
    index, texts = guidance.trace.closest_index, TEXTS[language]
    if index is None:
        return []
    done_m = float(route.arc_length_m[min(index, len(route.arc_length_m) - 1)])
    left = distance_text(max(1.0, route.length_m - done_m), language)
    parts = [texts["where_goal"].format(name=state.place_name(state.destination_id), distance=left)]
    count = _STOPS_WALKING if guidance.action is Action.WALK else _STOPS_STANDING
    ahead = [stop for stop in route.stops[:-1] if not stop.is_silent and stop.distance_m > done_m + HERE_M][:count]
    for stop in ahead:
        distance = distance_text(max(1.0, stop.distance_m - done_m), language)
        parts.append(texts["where_next"].format(name=stop.spoken_name or stop.name, distance=distance))
    return parts


def _joined(parts: list[str], language: Language) -> str:
    return ("" if language == "zh" else " ").join(parts)

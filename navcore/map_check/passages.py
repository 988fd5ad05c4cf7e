"""Is there room for a person along the edges and at the places?"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from navcore.map_check.clearance import Bound, PathClearance
from navcore.map_check.evidence import MapEvidence, edge_name, middle_of
from navcore.map_check.finding import Finding, Severity
from navcore.planning.poi_graph import Edge

THROUGH_M = 0.15
"""What stands nearer than this to the path stands in it: nobody's middle comes so close to a wall."""
TRODDEN_M = 0.4
"""Where so much is known to be free, somebody has walked; what is left unknown is beside them."""
MIN_STRETCH_M = 0.2
"""Of a path along which the room beside it is not known, or is too narrow."""

Mask = NDArray[np.bool_]


def edges_through_obstacles(evidence: MapEvidence) -> Iterator[Finding]:
    """Find edges that run through something that stands in the cloud."""
    for edge, room in _measured(evidence):
        for middle, stretch in _stretches(room, _in_the_way(room)):
            what = f"runs through something that stands {room.arc_m[stretch].min():.1f} m along it"
            action = "Move the road round it; if it was somebody who walked by, let it be."
            yield _finding("edge_through_obstacle", "error", edge, evidence, room, middle, what, action)


def narrow_passages(evidence: MapEvidence) -> Iterator[Finding]:
    """Find passages narrower than a person: by the cloud, and by what somebody has measured and written down."""
    person_m = evidence.settings.obstacle.person_width_m
    action = "Lead the connection elsewhere, or close it: guidance would stop there."
    for edge in evidence.graph.edges.values():
        if edge.width_m is not None and edge.width_m < person_m:
            text = f"{edge_name(edge, evidence.graph)} is {edge.width_m:.2f} m wide, and a person needs {person_m:g} m."
            ends = tuple(key for key in (edge.a, edge.b) if key in evidence.graph.pois)
            yield Finding("narrow_passage", "error", text, action, *middle_of(edge, evidence.graph), ends, (edge.id,))
    for edge, room in _measured(evidence):
        walled = (room.left_bound == Bound.OBSTACLE) & (room.right_bound == Bound.OBSTACLE)
        narrow = walled & (room.width_m < person_m) & ~_in_the_way(room)
        for middle, stretch in _stretches(room, narrow, MIN_STRETCH_M):
            what = f"is {room.width_m[stretch].min():.2f} m wide at one place, and a person needs {person_m:g} m"
            yield _finding("narrow_passage", "error", edge, evidence, room, middle, what, action)


def unknown_passages(evidence: MapEvidence) -> Iterator[Finding]:
    """Find stretches of edges beside which too little floor has been seen to say that there is room."""
    for edge, room in _measured(evidence):
        ends_unknown = (room.left_bound == Bound.UNKNOWN) | (room.right_bound == Bound.UNKNOWN)
        narrow = ends_unknown & (room.width_m < evidence.settings.obstacle.person_width_m) & ~_in_the_way(room)
        for middle, stretch in _stretches(room, narrow, MIN_STRETCH_M):
            is_trodden = bool((room.width_m[stretch] >= TRODDEN_M).all())
            what = "leads where little floor has been seen" if is_trodden else "leads where no floor has been seen"
            action = "Record a walk there that shows the floor, or look for yourself."
            # Unknown is never clear: where nobody has walked either, a person must say that there is a floor.
            severity: Severity = "note" if is_trodden else "error"
            yield _finding("unknown_passage", severity, edge, evidence, room, middle, what, action)


def places_without_clearance(evidence: MapEvidence) -> Iterator[Finding]:
    """Find places where a person has no room to stand, and those of which nobody knows."""
    needed_m = evidence.settings.obstacle.person_width_m / 2
    for key, room in evidence.places.items():
        poi = evidence.graph.pois.get(key)
        if poi is None or not poi.on_road:
            continue
        if room.radius_m < needed_m:
            text = (
                f"{poi.name} is {room.radius_m:.2f} m from something that stands there; a person needs {needed_m:g} m."
            )
            yield Finding("no_clearance", "warning", text, "Move the place along the road.", poi.x_m, poi.y_m, (key,))
        elif not room.is_known:
            text = f"No floor has been seen at {poi.name}."
            action = "Record a walk there that shows the floor, or look for yourself."
            yield Finding("unknown_clearance", "warning", text, action, poi.x_m, poi.y_m, (key,))


def _measured(evidence: MapEvidence) -> Iterator[tuple[Edge, PathClearance]]:
    """Return the edges whose surroundings have been measured; nobody is led along a closed one."""
    for edge in evidence.graph.edges.values():
        room = evidence.paths.get(edge.id)
        if room is not None and len(room.arc_m) and not edge.closed:
            yield edge, room


def _in_the_way(room: PathClearance) -> Mask:
    left = (room.left_bound == Bound.OBSTACLE) & (room.left_m < THROUGH_M)
    right = (room.right_bound == Bound.OBSTACLE) & (room.right_m < THROUGH_M)
    return np.asarray(left | right)


def _stretches(room: PathClearance, holds: Mask, min_m: float = 0.0) -> Iterator[tuple[int, slice]]:
    """Return the middle (an index) and the extent of each stretch of a path for which something holds."""
    turns = np.flatnonzero(np.diff(np.concatenate([[False], holds, [False]]).astype(np.int8)))
    for begin, end in zip(turns[::2].tolist(), turns[1::2].tolist(), strict=True):
        if room.arc_m[end - 1] - room.arc_m[begin] >= min_m:
            yield (begin + end - 1) // 2, slice(begin, end)


def _finding(
    code: str,
    severity: Severity,
    edge: Edge,
    evidence: MapEvidence,
    room: PathClearance,
    middle: int,
    what: str,
    action: str,
) -> Finding:
    x_m, y_m = room.points_m[middle].tolist()
    ends = tuple(key for key in (edge.a, edge.b) if key in evidence.graph.pois)
    text = f"{edge_name(edge, evidence.graph)} {what}."
    return Finding(code, severity, text, action, x_m, y_m, ends, (edge.id,), evidence.road_ids_at(x_m, y_m))

"""A few steps back, to look from there at what lies at the walker's feet, where no image shows it. Pure.

A camera at eye height sees nothing low that is nearer than about 1.8 m. Who has come to a stand before something low
stands before what is remembered of it, however long they wait: it may have gone (somebody's foot), and whether there is
a way round it cannot be seen from there. Nobody is sent backwards, for there nothing looks: the walker is turned round,
led back along the road like anywhere else, by what the camera sees then, and turned back again.
"""

from __future__ import annotations

import math

import numpy as np

from device_agent.state import DeviceState
from navcore.cues.texts import HAZARD_KINDS
from navcore.planning.poi_graph import Edge
from navcore.planning.projection import arc_lengths_m, path_between
from navcore.planning.road_joining import evenly_spaced
from navcore.planning.way_finding import route_piece
from navcore.types import Pose2D, Reason, Route

BACK_M = 1.5
"""From here, what was at the feet is in the image again, and still remembered (:mod:`navcore.obstacle.memory`)."""
_ROUTE_M, _SHORTEST_M = 5.0, 2.7
"""The way back is longer than it is walked: who reacts slowly must not come to its end."""
_ELSEWHERE_M = 3.0
_BEFORE_HAZARD_M, _BEFORE_BLOCKAGE_M = 1.0, 0.7
"""So far before stairs, and before what blocks it, the way back ends."""


def helps(state: DeviceState, now_s: float) -> bool:
    """Whether the walker stands before something that is out of the image, and was not sent back from here before."""
    guidance, last = state.guidance, state.step_back
    if guidance is None or guidance.reason is Reason.OBSTACLE_SONAR or not state.is_hidden_ahead:
        return False
    position = guidance.trace.position
    if position is None:
        return False
    if last is None or now_s - last.since_s > state.settings.planning.blocked_memory_s:
        return True
    return math.dist(position, (last.x_m, last.y_m)) > _ELSEWHERE_M


def is_under_way(state: DeviceState) -> bool:
    """Whether the walker is being led back just now."""
    return state.step_back is not None and state.step_back.route_version == state.route_version


def is_far_enough(state: DeviceState, pose: Pose2D) -> bool:
    """Whether the walker, who is being led back, has come so far that it can be looked again."""
    last = state.step_back
    return last is not None and math.dist((pose.x_m, pose.y_m), (last.x_m, last.y_m)) >= BACK_M


def way_back(state: DeviceState) -> Route | None:
    """Return the way back along the road that was walked, or on which the way began; None where it is too short.

    It ends before edges that may not be walked that way, before what is known to block them, and before stairs.
    """
    here, route = state.place_ahead(0.0), state.route
    if here is None or route is None or state.guidance is None:
        return None
    done_m = float(route.arc_length_m[state.guidance.trace.closest_index or 0])
    walked = [piece for piece in route.pieces if piece.start_m <= done_m] or list(route.pieces[:1])
    spans: list[tuple[Edge, float, float]] = []
    from_m, left_m = here.arc_m, _ROUTE_M
    for piece in reversed(walked):
        edge = state.graph.edges.get(piece.edge_id)
        if edge is None or edge.one_way or edge.closed:
            break
        begins_m = 0.0 if piece.edge_start_m <= piece.edge_end_m else edge.length_m
        to_m, goes_on = _end_m(state, edge, from_m, begins_m, left_m)
        spans.append((edge, from_m, to_m))
        left_m -= abs(to_m - from_m)
        if not goes_on or piece is walked[0]:
            break
        from_m = walked[walked.index(piece) - 1].edge_end_m
    return _route(state, spans) if _ROUTE_M - left_m >= _SHORTEST_M else None


def _end_m(state: DeviceState, edge: Edge, from_m: float, begins_m: float, left_m: float) -> tuple[float, bool]:
    """Return how far (arc length) an edge is walked back, and whether the way back may go on behind its beginning."""
    towards = 1.0 if begins_m > from_m else -1.0
    most_m, goes_on = abs(begins_m - from_m), True
    poi = state.graph.pois.get(edge.a if begins_m == 0.0 else edge.b)
    if poi is not None and poi.kind in HAZARD_KINDS:
        most_m, goes_on = most_m - _BEFORE_HAZARD_M, False
    for blocked in state.blocked:
        away_m = towards * (blocked.place.arc_m - from_m)
        if blocked.place.edge_id == edge.id and away_m > 0.0 and away_m - _BEFORE_BLOCKAGE_M < most_m:
            most_m, goes_on = away_m - _BEFORE_BLOCKAGE_M, False
    if most_m > left_m:
        most_m, goes_on = left_m, False
    return from_m + towards * max(0.0, most_m), goes_on


def _route(state: DeviceState, spans: list[tuple[Edge, float, float]]) -> Route:
    parts = [path_between(np.asarray(edge.path_m, dtype=np.float64), from_m, to_m) for edge, from_m, to_m in spans]
    points = evenly_spaced(np.vstack(parts), state.settings.planning.route_spacing_m)
    arcs = arc_lengths_m(points)
    # Even spacing cuts corners, so that the route is a little shorter than its pieces.
    ends_m = np.cumsum([abs(to_m - from_m) for _, from_m, to_m in spans])
    ends = (ends_m * (float(arcs[-1]) / float(ends_m[-1]))).tolist()
    begins = [0.0, *ends[:-1]]
    pieces = tuple(
        route_piece(edge, begin_m, end_m, from_m, to_m)
        for (edge, from_m, to_m), begin_m, end_m in zip(spans, begins, ends, strict=True)
        if end_m > begin_m
    )
    return Route(points, arcs, pieces=pieces, leads_to_destination=False)

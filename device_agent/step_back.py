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
from navcore.planning.projection import arc_lengths_m, path_between
from navcore.planning.road_joining import evenly_spaced
from navcore.types import Pose2D, Route

BACK_M = 1.5
"""From here, what was at the feet is in the image again, and still remembered (:mod:`navcore.obstacle.memory`)."""
_ROUTE_M, _SHORTEST_M = 5.0, 2.4
"""The way back is longer than it is walked: who reacts slowly must not come to its end."""
_ELSEWHERE_M = 3.0


def helps(state: DeviceState, now_s: float) -> bool:
    """Whether the walker stands before something that is out of the image, and was not sent back from here before."""
    last, position = state.step_back, None if state.guidance is None else state.guidance.trace.position
    if not state.is_hidden_ahead or position is None:
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
    """Return the way back along the road; None where it is not known, too short, or one-way."""
    here = state.place_ahead(0.0)
    edge = None if here is None else state.graph.edges.get(here.edge_id)
    if here is None or edge is None or edge.one_way or state.route is None or state.guidance is None:
        return None
    index = state.guidance.trace.closest_index or 0
    behind = state.route.points_m[: index + 1][::-1]
    first = state.route.pieces[0]
    if first.edge_id == edge.id:
        # The way has begun on this edge: the road goes on behind its beginning.
        path_m = np.asarray(edge.path_m, dtype=np.float64)
        to_m = 0.0 if first.edge_start_m < first.edge_end_m else float(arc_lengths_m(path_m)[-1])
        behind = path_between(path_m, here.arc_m, to_m)
    points = evenly_spaced(behind, state.settings.planning.route_spacing_m) if len(behind) > 1 else behind
    arcs = arc_lengths_m(points)
    kept = arcs <= _ROUTE_M
    if float(arcs[kept][-1]) < _SHORTEST_M:
        return None
    return Route(points[kept], arcs[kept], leads_to_destination=False)

"""What is announced on every edge of a PoI-graph, for the checker: a few ways that lead over all of them.

An announcement depends on where the walker comes from: somebody who sets out 3 m before a place cannot be told of it
6 m ahead. So each edge is walked, in each direction in which it may be, by somebody who has come a good piece towards
it, where such a way is anybody's shortest. Pure.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from navcore.geometry import FloatArray
from navcore.map_check.evidence import Announced, RehearsedRoute
from navcore.planning.poi_graph import PoiGraph
from navcore.planning.shortest_path import Source, Ways
from navcore.planning.way_finding import WayFinder
from navcore.rehearsal.rehearsing import CancelledError, Rehearsal, rehearse
from navcore.settings import Settings

LONGEST_M = 3000.0
"""Longest way that is walked in all, by default: some ten seconds of one core."""
MAX_PLACES = 1000
"""Ways begin and end at so many places at most: what each way costs is known of all pairs of them (8 MB)."""
MAX_LEGS = 500
"""For so many legs at most a way is looked for: a few milliseconds each, a tenth of a second among many places."""
_LEAD_IN_M = 15.0
"""Whoever has come so far hears of an edge what somebody hears who is under way."""
_LEAD_OUT_M = 40.0
"""The way goes on so far where it can: the more edges share one piece that leads to them."""
_SAME_COST_M = 1e-6


@dataclass(frozen=True, slots=True)
class EveryLeg:
    """What is said on all ways, and where nobody knows what is."""

    routes: tuple[RehearsedRoute, ...]
    left_out: tuple[str, ...]
    """Edges that were not walked in each of their directions: no shortest way leads over them, or all ways together
    would have been too long."""
    refusals: tuple[str, ...]
    """Ways on which the walker did not arrive, and why."""


def all_routes_announced(
    graph: PoiGraph,
    settings: Settings | None = None,
    *,
    longest_m: float = LONGEST_M,
    max_places: int = MAX_PLACES,
    cancelled: Callable[[], bool] = lambda: False,
) -> EveryLeg:
    """Rehearse ways over every edge, in each direction in which it may be walked, up to a length of all together.

    Args:
        graph: the PoI-graph.
        settings: all thresholds.
        longest_m: length of all ways together; what is left then is named in the result.
        max_places: legs between the first so many places are walked; the others are named in the result.
        cancelled: asked now and then whether to give up.

    Raises CancelledError.
    """
    settings = settings or Settings()
    legs, network = _legs(graph), _Network.of(graph, max_places, cancelled)
    sought = [leg for leg in legs if leg.from_id in network.index_of and leg.to_id in network.index_of]
    finder, heard = WayFinder(graph, settings.planning), set[_Leg]()
    rehearsals: dict[_Ends, Rehearsal] = {}
    tried = 0
    for leg in sought:
        if leg in heard:
            continue
        if tried == MAX_LEGS:
            break
        _go_on(cancelled)
        tried += 1
        ends = network.ends_of_way_over(leg)
        if ends is None:
            continue
        if ends not in rehearsals:
            if ends.cost_m > longest_m:
                break
            rehearsals[ends] = rehearse(
                graph, ends.start_id, ends.goal_id, settings, finder=finder, cancelled=cancelled
            )
            longest_m -= rehearsals[ends].length_m
        heard |= _heard_well(graph, rehearsals[ends], leg)
    return EveryLeg(
        tuple(rehearsed_route(rehearsal, graph) for rehearsal in rehearsals.values()),
        tuple(dict.fromkeys(leg.edge_id for leg in legs if leg not in heard)),
        tuple(rehearsal.refusal for rehearsal in rehearsals.values() if rehearsal.refusal),
    )


def rehearsed_route(rehearsal: Rehearsal, graph: PoiGraph) -> RehearsedRoute:
    """Return a rehearsal as the checker looks at it: all that is said in words, and where.

    Whoever turns at a corner may be nearest to a point of the route that they have passed already.
    """
    goal = graph.pois[rehearsal.destination_poi_id]
    said = tuple(
        Announced(
            each.kind.value,
            each.poi_id or "",
            each.along_m,
            each.distance_m or 0.0,
            each.x_m,
            each.y_m,
            each.edge_id or "",
        )
        for each in rehearsal.utterances
        if each.text
    )
    return RehearsedRoute(
        rehearsal.start_poi_id,
        rehearsal.destination_poi_id,
        rehearsal.length_m,
        goal.x_m,
        goal.y_m,
        tuple(sorted(said, key=lambda each: each.at_m)),
        rehearsal.edge_ids if rehearsal.arrived else (),
    )


@dataclass(frozen=True, slots=True)
class _Leg:
    """An edge in a direction in which it may be walked."""

    edge_id: str
    from_id: str
    to_id: str


@dataclass(frozen=True, slots=True)
class _Ends:
    """Where a way begins and ends, and what it costs: never less than its length."""

    start_id: str
    goal_id: str
    cost_m: float


@dataclass(frozen=True, slots=True, eq=False)
class _Network:
    """What the way from each PoI to each costs (n, n), inf where none leads there; and which can be a goal (n,).

    Of the first PoIs only where there are many; the ways lead over all.
    """

    graph: PoiGraph
    poi_ids: tuple[str, ...]
    index_of: dict[str, int]
    costs_m: FloatArray
    is_goal: NDArray[np.bool_]

    @staticmethod
    def of(graph: PoiGraph, max_places: int, cancelled: Callable[[], bool]) -> _Network:
        ways = Ways.of(graph)
        poi_ids = ways.poi_ids[:max_places]
        index_of = {poi_id: row for row, poi_id in enumerate(poi_ids)}
        costs_m, usable = np.full((len(poi_ids), len(poi_ids)), math.inf), ways.usable()
        for row, poi_id in enumerate(poi_ids):
            _go_on(cancelled)
            found = ways.costs_m([Source(poi_id, 0.0)], usable)
            known = [goal_id for goal_id in found if goal_id in index_of]
            costs_m[row, [index_of[goal_id] for goal_id in known]] = [found[goal_id] for goal_id in known]
        is_goal = np.array([graph.pois[poi_id].on_road for poi_id in poi_ids], dtype=np.bool_)
        return _Network(graph, poi_ids, index_of, costs_m, is_goal)

    def ends_of_way_over(self, leg: _Leg) -> _Ends | None:
        """Return the ends of a shortest way over a leg; None where no shortest way leads over it.

        Of all these the one with the best piece before and behind the leg, and of equals the shortest.
        """
        edge = self.graph.edges[leg.edge_id]
        before_m, behind_m = self.costs_m[:, self.index_of[leg.from_id]], self.costs_m[self.index_of[leg.to_id]]
        over_m = before_m[:, None] + edge.length_m * edge.cost_multiplier + behind_m[None]
        leads = np.isfinite(over_m) & (over_m <= self.costs_m + _SAME_COST_M) & self.is_goal[None]
        if not bool(leads.any()):
            return None
        worth = np.minimum(before_m, _LEAD_IN_M)[:, None] + np.minimum(behind_m, _LEAD_OUT_M)[None]
        worth = np.where(leads, worth, -math.inf)
        cost_m = np.where(worth >= worth.max() - _SAME_COST_M, over_m, math.inf)
        start, goal = np.unravel_index(int(np.argmin(cost_m)), cost_m.shape)
        return _Ends(self.poi_ids[int(start)], self.poi_ids[int(goal)], float(cost_m[start, goal]))


def _go_on(cancelled: Callable[[], bool]) -> None:
    if cancelled():
        raise CancelledError("The rehearsals were given up.")


def _legs(graph: PoiGraph) -> tuple[_Leg, ...]:
    legs: list[_Leg] = []
    for edge in graph.edges.values():
        if edge.closed or edge.a not in graph.pois or edge.b not in graph.pois:
            continue
        legs.append(_Leg(edge.id, edge.a, edge.b))
        if not edge.one_way:
            legs.append(_Leg(edge.id, edge.b, edge.a))
    return tuple(legs)


def _heard_well(graph: PoiGraph, rehearsal: Rehearsal, wanted: _Leg) -> set[_Leg]:
    """Return the legs of a way that the walker had come a good piece towards, and the one that it was made for."""
    at_id, done_m, heard = rehearsal.start_poi_id, 0.0, set[_Leg]()
    for edge_id in rehearsal.edge_ids:
        edge = graph.edges[edge_id]
        leg = _Leg(edge_id, at_id, edge.b if at_id == edge.a else edge.a)
        if done_m >= _LEAD_IN_M or leg == wanted:
            heard.add(leg)
        at_id, done_m = leg.to_id, done_m + edge.length_m
    return heard

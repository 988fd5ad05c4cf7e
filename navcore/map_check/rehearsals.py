"""Is the walker told of places at the right distance, and never left long without a word?"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

from navcore.cues.announcements import is_narrow
from navcore.cues.table import CueKind
from navcore.map_check.evidence import MapEvidence, RehearsedRoute, edge_name, middle_of
from navcore.map_check.finding import Finding
from navcore.planning.poi_graph import Edge

TOLERANCE_M = 1.0
"""Places are announced 6 ± 1 m ahead (Wayfindr Open Standard). A reassurance too waits for the end of a turn."""
_PLACES = frozenset({CueKind.POI_AHEAD.value, CueKind.HAZARD_AHEAD.value})
_PRECISION_M = 1e-6


def announcements_out_of_place(evidence: MapEvidence) -> Iterator[Finding]:
    """Find announcements of places that come too early or too late, once for each place and side."""
    usual_m, pois = evidence.settings.cues.announce_m, evidence.graph.pois
    told: set[tuple[str, bool]] = set()
    for route in evidence.routes:
        for said in route.announced:
            off_m = said.distance_m - usual_m
            if said.kind not in _PLACES or abs(off_m) <= TOLERANCE_M + _PRECISION_M:
                continue
            if (said.poi_id, off_m > 0.0) in told:
                continue
            told.add((said.poi_id, off_m > 0.0))
            name = pois[said.poi_id].name if said.poi_id in pois else "A place"
            text = (
                f"{name} is announced {said.distance_m:.1f} m ahead on the way {_way(evidence, route)}, and not"
                f" {usual_m:g} ± {TOLERANCE_M:g} m."
            )
            action = "Shorten its spoken name, or see whether a turn or another place is too near before it."
            ids = (said.poi_id,) if said.poi_id in pois else ()
            yield Finding("announcement_distance", "warning", text, action, said.x_m, said.y_m, ids)


def cautions_not_said(evidence: MapEvidence) -> Iterator[Finding]:
    """Find edges on which a walker would not hear what is to be known of them, once for each edge."""
    found: set[tuple[str, CueKind]] = set()
    for route in evidence.routes:
        said = {(each.edge_id, each.kind) for each in route.announced}
        for edge in (evidence.graph.edges[key] for key in route.edge_ids if key in evidence.graph.edges):
            for kind in _to_be_said(edge, evidence):
                if (edge.id, kind.value) in said or (edge.id, kind) in found:
                    continue
                found.add((edge.id, kind))
                what = "its caution" if kind is CueKind.CAUTION_SIDE else "that it is narrow"
                text = (
                    f"{edge_name(edge, evidence.graph)} asks for care, and on the way {_way(evidence, route)} nobody"
                    f" hears {what}: there is no time to say it."
                )
                action = "Move the places there apart, or give the edge before it the same caution."
                ends = tuple(key for key in (edge.a, edge.b) if key in evidence.graph.pois)
                yield Finding(
                    "caution_not_said", "error", text, action, *middle_of(edge, evidence.graph), ends, (edge.id,)
                )


def _to_be_said(edge: Edge, evidence: MapEvidence) -> Iterator[CueKind]:
    if edge.caution_side != "none":
        yield CueKind.CAUTION_SIDE
    if is_narrow(edge.width_m, evidence.settings.obstacle):
        yield CueKind.NARROW_PASSAGE


def long_silences(evidence: MapEvidence) -> Iterator[Finding]:
    """Find stretches of rehearsed routes on which nothing is said for longer than between two reassurances."""
    limit_m = evidence.settings.cues.reassurance_m + TOLERANCE_M
    for route in evidence.routes:
        places = [(0.0, None), *((said.at_m, said) for said in route.announced), (route.length_m, None)]
        for (from_m, _), (to_m, said) in pairwise(places):
            if to_m - from_m <= limit_m + _PRECISION_M:
                continue
            x_m, y_m = (said.x_m, said.y_m) if said is not None else (route.end_x_m, route.end_y_m)
            text = f"Nothing is said for {to_m - from_m:.0f} m before here, on the way {_way(evidence, route)}."
            action = "Tag a place on that stretch, or lower the distance between reassurances (cues.reassurance_m)."
            yield Finding("long_silence", "warning", text, action, x_m, y_m, _ends(evidence, route))


def rehearsals_without_arrival(evidence: MapEvidence) -> Iterator[Finding]:
    """Find ways on which nobody would arrive though there is a way."""
    for refusal in evidence.refusals:
        action = "Rehearse that way on the page Rehearse, and see where it ends."
        yield Finding("rehearsal_failed", "error", refusal, action, 0.0, 0.0)


def not_rehearsed(evidence: MapEvidence) -> Iterator[Finding]:
    """Say how much of the graph no rehearsal has led over: it is not known to be fine."""
    edges = [evidence.graph.edges[key] for key in evidence.not_rehearsed if key in evidence.graph.edges]
    if not edges:
        return
    what = edge_name(edges[0], evidence.graph) + " was" if len(edges) == 1 else f"{len(edges)} connections were"
    text = f"{what} not rehearsed in each direction: what is said there has not been checked."
    action = f"Rehearse ways over {'it' if len(edges) == 1 else 'them'} on the page Rehearse, where it matters."
    x_m, y_m = middle_of(edges[0], evidence.graph)
    yield Finding("not_rehearsed", "note", text, action, x_m, y_m, edge_ids=tuple(edge.id for edge in edges))


def _ends(evidence: MapEvidence, route: RehearsedRoute) -> tuple[str, ...]:
    return tuple(key for key in (route.start_id, route.goal_id) if key in evidence.graph.pois)


def _way(evidence: MapEvidence, route: RehearsedRoute) -> str:
    pois = evidence.graph.pois
    start, goal = (pois[key].name if key in pois else key for key in (route.start_id, route.goal_id))
    return f"from {start} to {goal}"

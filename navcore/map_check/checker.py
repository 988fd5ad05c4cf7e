"""All checks, one after the other: what they find, the worst first.

The same evidence gives the same findings in the same order. Whatever the graph is like, no check raises.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

from navcore.map_check.edges import dangling_edges, edges_without_road, short_edges
from navcore.map_check.evidence import MapEvidence
from navcore.map_check.finding import Finding, Severity
from navcore.map_check.names import confusable_names, duplicate_names, unspeakable_names
from navcore.map_check.passages import (
    edges_through_obstacles,
    narrow_passages,
    places_without_clearance,
    unknown_passages,
)
from navcore.map_check.reachability import unreachable_places
from navcore.map_check.rehearsals import (
    announcements_out_of_place,
    cautions_not_said,
    long_silences,
    not_rehearsed,
    rehearsals_without_arrival,
)
from navcore.map_check.road_ends import nearly_joined_roads
from navcore.map_check.weak_localization import weak_localization

Check = Callable[[MapEvidence], Iterable[Finding]]

CHECKS: tuple[Check, ...] = (
    unreachable_places,
    dangling_edges,
    edges_without_road,
    short_edges,
    nearly_joined_roads,
    edges_through_obstacles,
    narrow_passages,
    unknown_passages,
    places_without_clearance,
    duplicate_names,
    confusable_names,
    unspeakable_names,
    weak_localization,
    announcements_out_of_place,
    cautions_not_said,
    long_silences,
    rehearsals_without_arrival,
    not_rehearsed,
)
_RANK: dict[Severity, int] = {"error": 0, "warning": 1, "note": 2}


def findings_of(evidence: MapEvidence) -> tuple[Finding, ...]:
    """Return everything that the checks find, by severity and then by place."""
    found = {finding for check in CHECKS for finding in check(evidence)}
    return tuple(sorted(found, key=_order))


def _order(finding: Finding) -> tuple[object, ...]:
    place = (finding.x_m, finding.y_m)
    about = (finding.poi_ids, finding.edge_ids, finding.road_ids)
    return (_RANK[finding.severity], *place, finding.code, finding.text, *about)

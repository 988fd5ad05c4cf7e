"""Do roads that nearly meet join?"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from navcore.map_check.evidence import MapEvidence
from navcore.map_check.finding import Finding

MAX_GAP_M = 2.0
"""A road that ends farther than this from another one ends there on purpose, more likely than not."""
MIN_DETOUR_M = 5.0
"""Whoever gets across the gap by so much more way along the road is not helped by closing it."""


def nearly_joined_roads(evidence: MapEvidence) -> Iterator[Finding]:
    """Find ends of the road that come near to another piece of road, without a way along the road between them."""
    network = evidence.network
    if network.is_empty:
        return
    tree = cKDTree(network.vertices_m)
    ends = np.flatnonzero(np.bincount(network.segments.ravel(), minlength=len(network.vertices_m)) == 1)
    for end in ends.tolist():
        place = network.vertices_m[end]
        near = np.array(sorted(tree.query_ball_point(place, MAX_GAP_M)))
        gaps_m = np.hypot(*(network.vertices_m[near] - place).T)
        ways_m = dijkstra(network.matrix, directed=False, indices=[end], limit=MAX_GAP_M + MIN_DETOUR_M)[0, near]
        apart = ways_m > gaps_m + MIN_DETOUR_M
        if not apart.any():
            continue
        across = int(near[apart][np.argmin(gaps_m[apart])])
        # Two ends that face each other are found twice, and are one finding.
        yield _finding(evidence, place.tolist(), network.vertices_m[across].tolist())


def _finding(evidence: MapEvidence, end_m: list[float], other_m: list[float]) -> Finding:
    gap_m = float(np.hypot(end_m[0] - other_m[0], end_m[1] - other_m[1]))
    x_m, y_m = (end_m[0] + other_m[0]) / 2, (end_m[1] + other_m[1]) / 2
    text = f"A road ends {gap_m:.1f} m before another one, and is not joined to it."
    roads = tuple(sorted({*evidence.road_ids_at(*end_m), *evidence.road_ids_at(*other_m)}))
    action = "Join them where people can walk across; let it be where a wall stands between them."
    return Finding("nearly_joined_roads", "warning", text, action, x_m, y_m, road_ids=roads)

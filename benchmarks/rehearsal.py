"""Time to rehearse ways, and to find out for the checker what is announced on all edges of a building.

    python -m benchmarks.rehearsal [--side 22] [--seed 0]

The building is the one of :mod:`benchmarks.way_finding`: side × side PoIs about 10 m apart. Prints, as JSON, times of
the thread's own CPU: for ways of 55 to 65 m median and worst, and for all legs (up to 3 km of ways) the whole and how
many edges were left out.
"""

from __future__ import annotations

import argparse
import json
import sys
import time

import numpy as np

from benchmarks.way_finding import large_graph
from navcore.errors import PlanningError
from navcore.planning.poi_graph import PoiGraph
from navcore.planning.way_finding import WayFinder
from navcore.rehearsal.every_leg import LONGEST_M, all_routes_announced
from navcore.rehearsal.rehearsing import rehearse

_WAYS_COUNT = 20


def measure(side: int, seed: int) -> dict[str, object]:
    """Return the figures."""
    rng = np.random.default_rng(seed)
    graph = large_graph(side, rng)
    finder = WayFinder(graph)
    ways = _ways(graph, finder, rng)
    # What is compiled at the first call is not measured.
    rehearse(graph, *ways[0], finder=finder)
    times_s = []
    for start_id, goal_id in ways:
        began_s = time.thread_time()
        done = rehearse(graph, start_id, goal_id, finder=finder)
        times_s.append(time.thread_time() - began_s)
        assert done.arrived, done.refusal
    began_s = time.thread_time()
    every = all_routes_announced(graph)
    return {
        "pois": len(graph.pois),
        "edges": len(graph.edges),
        "ways": len(ways),
        "way_median_s": round(float(np.median(times_s)), 3),
        "way_worst_s": round(max(times_s), 3),
        "all_legs_s": round(time.thread_time() - began_s, 1),
        "all_legs_at_most_m": LONGEST_M,
        "routes": len(every.routes),
        "announced": sum(len(route.announced) for route in every.routes),
        "edges_left_out": len(every.left_out),
        "not_arrived": len(every.refusals),
    }


def _ways(graph: PoiGraph, finder: WayFinder, rng: np.random.Generator) -> list[tuple[str, str]]:
    """Return ends of ways of about 60 m."""
    poi_ids, ways = tuple(graph.pois), []
    while len(ways) < _WAYS_COUNT:
        start_id, goal_id = (poi_ids[int(i)] for i in rng.integers(0, len(poi_ids), 2))
        start = graph.pois[start_id]
        try:
            route = finder.route_to(goal_id, start.x_m, start.y_m)
        except PlanningError:
            continue
        if 55.0 <= route.length_m <= 65.0:
            ways.append((start_id, goal_id))
    return ways


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--side", type=int, default=22)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    json.dump(measure(arguments.side, arguments.seed), sys.stdout, indent=1)
    sys.stdout.write("\n")


if __name__ == "__main__":
    main()

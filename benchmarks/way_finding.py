"""Time to plan a route in a large building: 10,000 PoIs on a road of 20,000 edges.

    python -m benchmarks.way_finding [--side 100] [--seed 0] [--json]

The building is a bent grid of corridors, some of them one-way, closed or dear. Prints, as JSON: the time to prepare the
graph (once for each version of it), and median, 95th percentile and worst time of planning between random places, in
the thread's own CPU time; beside it the same for the longest routes of all, from corner to corner.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time

import numpy as np

from navcore.errors import PlanningError
from navcore.planning.poi_graph import Edge, Poi, PoiGraph
from navcore.planning.road_joining import evenly_spaced
from navcore.planning.way_finding import WayFinder

_SPACING_M = 10.0


def large_graph(side: int, rng: np.random.Generator) -> PoiGraph:
    """Return a graph of side × side PoIs about 10 m apart, each joined with its neighbours."""
    places = {
        f"p{i}_{j}": (_SPACING_M * np.array([i, j]) + rng.uniform(-2.0, 2.0, 2))
        for i in range(side)
        for j in range(side)
    }
    pois = {key: Poi(key, key, "other", float(x), float(y)) for key, (x, y) in places.items()}
    pairs = [(f"p{i}_{j}", f"p{i + 1}_{j}") for i in range(side - 1) for j in range(side)]
    pairs += [(f"p{i}_{j}", f"p{i}_{j + 1}") for i in range(side) for j in range(side - 1)]
    edges = {f"e{number}": _edge(f"e{number}", a, b, places, rng) for number, (a, b) in enumerate(pairs)}
    return PoiGraph(1, pois, edges)


def _edge(edge_id: str, a: str, b: str, places: dict[str, np.ndarray], rng: np.random.Generator) -> Edge:
    bend = 0.5 * (places[a] + places[b]) + rng.uniform(-1.0, 1.0, 2)
    path = evenly_spaced(np.array([places[a], bend, places[b]]), 0.5)
    length_m = float(np.hypot(*np.diff(path, axis=0).T).sum())
    kind = rng.random()
    points = tuple((float(x), float(y)) for x, y in path)
    return Edge(
        edge_id, a, b, points, length_m, one_way=bool(kind < 0.03), closed=bool(kind > 0.97),
        cost_multiplier=2.0 if 0.5 < kind < 0.55 else 1.0,
    )  # fmt: skip


def measure(side: int, seed: int) -> dict[str, object]:
    """Return the figures."""
    rng = np.random.default_rng(seed)
    graph = large_graph(side, rng)
    began = time.thread_time()
    finder = WayFinder(graph)
    built_s = time.thread_time() - began
    reach_m = _SPACING_M * (side - 1)
    starts = rng.uniform(0.0, reach_m, (60, 2))
    goals = [f"p{i}_{j}" for i, j in rng.integers(0, side, (60, 2))]
    last = side - 1
    corners = [((0.0, 0.0), f"p{last}_{last}"), ((reach_m, 0.0), f"p0_{last}"), ((0.0, reach_m), f"p{last}_0")]
    # The first search compiles, or loads what was compiled.
    _planned(finder, starts[0], goals[0])
    random = [_planned(finder, start, goal) for start, goal in zip(starts, goals, strict=True)]
    far = [_planned(finder, start, goal) for start, goal in corners * 5]
    return {
        "pois": len(graph.pois), "edges": len(graph.edges), "prepare_s": round(built_s, 3),
        **_summary("random", random), **_summary("corner_to_corner", far),
    }  # fmt: skip


def _planned(finder: WayFinder, start: tuple[float, float] | np.ndarray, goal: str) -> tuple[float, float]:
    """Return the time in milliseconds, and the length of the route; NaN where there is none."""
    began = time.thread_time()
    try:
        length_m = finder.route_to(goal, float(start[0]), float(start[1])).length_m
    except PlanningError:
        length_m = math.nan
    return 1e3 * (time.thread_time() - began), length_m


def _summary(name: str, plans: list[tuple[float, float]]) -> dict[str, object]:
    times_ms, lengths_m = (np.array(column) for column in zip(*plans, strict=True))
    return {
        f"{name}_median_ms": round(float(np.median(times_ms)), 2),
        f"{name}_p95_ms": round(float(np.percentile(times_ms, 95)), 2),
        f"{name}_worst_ms": round(float(times_ms.max()), 2),
        f"{name}_longest_m": round(float(np.nanmax(lengths_m)), 1),
        f"{name}_without_a_way": int(np.isnan(lengths_m).sum()),
    }


def main() -> int:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--side", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", action="store_true", help="on one line")
    arguments = parser.parse_args()
    print(json.dumps(measure(max(3, arguments.side), arguments.seed), indent=None if arguments.json else 1))
    return 0


if __name__ == "__main__":
    sys.exit(main())

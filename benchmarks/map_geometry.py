"""Time and memory of the map's geometry: a cloud of five million points, 300 m of road, 500 PoIs and 800 edges.

    python -m benchmarks.map_geometry [--points 5000000] [--corridors 25] [--seed 0]

The building is corridors side by side, 12 m long and 2.4 m wide, whose floor, walls and ceiling are seen at random
places with 5 mm of noise; a road runs down each. Prints, as JSON, seconds of processor time (of the one core that it
uses): for what the scene shows (thinned, then cleaned of points by themselves), for what is measured once in the cloud
(in a process of its own), and for the clearance along the road, the floor plan and the checker, which come again with
every edit. ``longest_hold_s`` is how long, by the clock, nobody else could run while the scene's points were chosen:
Open3D holds Python's lock. Memory is the most that the process has held meanwhile, beyond the cloud.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import numpy as np

from benchmarks.way_finding import large_graph
from console.map_geometry.clearance import path_clearance, place_clearance
from console.map_geometry.cloud_cleaning import evenly_thinned, shown_points
from console.map_geometry.floor_plan import floor_plan
from console.map_geometry.occupancy import occupancy_of
from console.map_geometry.open3d_library import import_open3d
from console.map_geometry.plan_layout import PlanPlace
from console.map_geometry.wall_segments import wall_segments
from console.viewer.cloud import MAX_POINTS_COUNT
from device_agent.single_core import use_one_core
from navcore.geometry import FloatArray
from navcore.map_check.checker import findings_of
from navcore.map_check.evidence import MapEvidence, path_of
from navcore.planning.poi_graph import PoiGraph
from navcore.planning.road_network import RoadNetwork

LENGTH_M, WIDTH_M, HEIGHT_M = 12.0, 2.4, 2.6
_SIDE, _EDGES_COUNT = 22, 800
_MIB = 1 << 20
Result = TypeVar("Result")


def building(corridors: int, points_count: int, rng: np.random.Generator) -> tuple[np.ndarray, list[FloatArray]]:
    """Return a cloud (n, 3), float32, and the roads (k, 2) of corridors side by side."""
    at, up = rng.uniform(0.0, LENGTH_M, points_count), rng.uniform(0.0, HEIGHT_M, points_count)
    across = rng.uniform(-WIDTH_M / 2, WIDTH_M / 2, points_count)
    surface = rng.integers(0, 4, points_count)
    across = np.where(surface == 0, -WIDTH_M / 2, np.where(surface == 1, WIDTH_M / 2, across))
    up = np.where(surface == 2, 0.0, np.where(surface == 3, HEIGHT_M, up))
    number = rng.integers(0, corridors, points_count)
    points = np.column_stack([at, across + 3.0 * number, up]) + rng.normal(0.0, 0.005, (points_count, 3))
    xs = np.arange(0.0, LENGTH_M + 0.05, 0.1)
    roads = [np.column_stack([xs, np.full_like(xs, 3.0 * n)]) for n in range(corridors)]
    return points.astype(np.float32), roads


def timed(work: Callable[[], Result]) -> tuple[Result, float]:
    """Return what some work gives, and the seconds of processor time that it takes."""
    begin_s = time.process_time()
    result = work()
    return result, round(time.process_time() - begin_s, 3)


class Bystander:
    """A thread that only wants to run now and then; how long it was kept from it."""

    def __init__(self) -> None:
        self.longest_s = 0.0
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        last_s = time.perf_counter()
        while not self._over.wait(0.005):
            now_s = time.perf_counter()
            self.longest_s, last_s = max(self.longest_s, now_s - last_s), now_s

    def end(self) -> float:
        """Return how long nobody else could run, at the longest."""
        self._over.set()
        self._thread.join()
        return round(self.longest_s, 3)


def part_of(graph: PoiGraph, pois_count: int, edges_count: int) -> PoiGraph:
    """Return a graph of so many of another one's PoIs, and so many of the edges between them."""
    pois = dict(list(graph.pois.items())[:pois_count])
    edges = [edge for edge in graph.edges.values() if edge.a in pois and edge.b in pois][:edges_count]
    return PoiGraph(1, pois, {edge.id: edge for edge in edges})


class Memory:
    """The most memory that this process has held since then, beyond what it held then (Linux)."""

    def __init__(self) -> None:
        Path("/proc/self/clear_refs").write_text("5", encoding="ascii")
        self._before_mib = self._peak_mib()

    def most_mib(self) -> int:
        """Return it, MiB."""
        return round(self._peak_mib() - self._before_mib)

    @staticmethod
    def _peak_mib() -> float:
        status = Path("/proc/self/status").read_text(encoding="ascii")
        return int(status.split("VmHWM:")[1].split()[0]) / 1024


def main() -> int:
    """Run the benchmark; print its figures."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    parser.add_argument("--points", type=int, default=5_000_000)
    parser.add_argument("--corridors", type=int, default=25)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    use_one_core()
    _, import_s = timed(import_open3d)
    points, roads = building(arguments.corridors, arguments.points, np.random.default_rng(arguments.seed))
    bystander, memory = Bystander(), Memory()
    thinned, thin_s = timed(lambda: evenly_thinned(points, MAX_POINTS_COUNT))
    shown, shown_s = timed(lambda: shown_points(points, MAX_POINTS_COUNT))
    longest_hold_s, shown_mib = bystander.end(), memory.most_mib()
    memory = Memory()
    occupancy, occupancy_s = timed(lambda: occupancy_of(points, roads))
    walls, walls_s = timed(lambda: wall_segments(points))
    measured_mib = memory.most_mib()
    rooms, clearance_s = timed(lambda: [path_clearance(occupancy, road) for road in roads])
    places = [PlanPlace(f"Room {n}", float(road[60, 0]), float(road[60, 1])) for n, road in enumerate(roads)]
    plan, plan_s = timed(lambda: floor_plan(occupancy, walls, roads, places))

    graph = part_of(large_graph(_SIDE + 1, np.random.default_rng(arguments.seed)), 500, _EDGES_COUNT)
    network = RoadNetwork.from_roads([path_of(edge) for edge in graph.edges.values()])
    paths, paths_s = timed(lambda: {e.id: path_clearance(occupancy, path_of(e)) for e in graph.edges.values()})
    around = {poi.id: place_clearance(occupancy, poi.x_m, poi.y_m) for poi in graph.pois.values()}
    found, checker_s = timed(lambda: findings_of(MapEvidence(graph, network, paths, around)))
    json.dump(
        {
            "points": len(points), "open3d_import_s": import_s,
            "shown": {
                "thinned_points": len(thinned), "thin_s": thin_s, "points": len(shown), "thin_and_clean_s": shown_s,
                "longest_hold_s": longest_hold_s, "memory_mib": shown_mib,
            },
            "measured_once": {
                "occupancy_s": occupancy_s, "walls_s": walls_s, "walls": len(walls),
                "memory_mib": measured_mib, "cloud_mib": round(points.nbytes / _MIB),
            },
            "clearance": {
                "road_m": round(sum(float(room.arc_m[-1]) for room in rooms)), "s": clearance_s,
                "width_m": round(float(np.median(np.concatenate([room.width_m for room in rooms]))), 2),
            },
            "floor_plan": {"s": plan_s, "pixels": [plan.width_px, plan.height_px], "bytes": len(plan.png)},
            "checker": {
                "pois": len(graph.pois), "edges": len(graph.edges), "clearance_s": paths_s, "s": checker_s,
                "findings": len(found), "road_m": round(math.fsum(edge.length_m for edge in graph.edges.values())),
            },
        },
        sys.stdout, indent=1,
    )  # fmt: skip
    sys.stdout.write("\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())

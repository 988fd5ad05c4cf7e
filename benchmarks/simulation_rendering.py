"""How long the sighted person's walk is, and what a frame of it costs on one core.

Run ``python benchmarks/simulation_rendering.py`` (``--help`` lists the options). Times are this thread's CPU time, so
that other load does not matter.
"""

from __future__ import annotations

import argparse
import json
import statistics
import time

from device_agent.simulation.building import renderer_of
from device_agent.simulation.office_floor import office_floor
from device_agent.simulation.simulated_walk import simulated_walk
from device_agent.simulation.walk import head_trajectory, plan_walk


def main() -> None:
    """Render the beginning of the walk at both picture sizes and print the figures as JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=60, help="frames to render at each size (default: %(default)s)")
    parser.add_argument("--rate-hz", type=float, default=10.0, help="frame rate of the walk")
    arguments = parser.parse_args()
    building = office_floor()
    plan = plan_walk(building.road_waypoints, seed=0)
    count = len(head_trajectory(plan, arguments.rate_hz))
    begin_s = time.thread_time()
    renderer = renderer_of(building)
    figures: dict[str, float | int] = {
        "walk_m": round(plan.length_m, 1),
        "walk_s": round(plan.duration_s, 1),
        "frames": count,
        "painting_s": round(time.thread_time() - begin_s, 2),
    }
    for size_px in ((320, 240), (640, 480)):
        frames = simulated_walk(building, seed=0, rate_hz=arguments.rate_hz, size_px=size_px, renderer=renderer)
        next(frames)  # compiles on the very first run
        spent_ms = []
        for _ in range(max(1, arguments.frames)):
            begin_s = time.thread_time()
            next(frames)
            spent_ms.append(1e3 * (time.thread_time() - begin_s))
        size = f"{size_px[0]}x{size_px[1]}"
        figures[f"frame_median_ms_{size}"] = round(statistics.median(spent_ms), 2)
        figures[f"frame_p95_ms_{size}"] = round(sorted(spent_ms)[int(0.95 * len(spent_ms))], 2)
    print(json.dumps(figures, indent=1))


if __name__ == "__main__":
    main()

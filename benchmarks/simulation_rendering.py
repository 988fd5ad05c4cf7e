"""How long the sighted person's walk is, and what a frame of it costs on one core.

Run ``python benchmarks/simulation_rendering.py`` (``--help`` lists the options). Times are this thread's CPU time, so
that other load does not matter.
"""

from __future__ import annotations

import argparse
import itertools
import statistics
import time

from device_agent.simulation.building import renderer_of
from device_agent.simulation.office_floor import office_floor
from device_agent.simulation.walk import head_trajectory, plan_walk, recorded_walk


def main() -> None:
    """Render the beginning of the walk at both image sizes and print one line for each."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=60, help="frames to render at each size")
    parser.add_argument("--rate-hz", type=float, default=10.0, help="frame rate of the walk")
    arguments = parser.parse_args()
    building = office_floor()
    plan = plan_walk(building.road_waypoints, seed=0)
    count = len(head_trajectory(plan, arguments.rate_hz))
    print(f"walk: {plan.length_m:.0f} m, {plan.duration_s:.0f} s, {count} frames at {arguments.rate_hz:g} Hz")
    begin_s = time.thread_time()
    renderer = renderer_of(building)
    print(f"painting and lighting the building: {time.thread_time() - begin_s:.1f} s")
    for size_px in ((320, 240), (640, 480)):
        frames = recorded_walk(building, 0, arguments.rate_hz, size_px, renderer=renderer)
        next(frames)  # compiles on the very first run
        spent_ms = []
        for _ in itertools.repeat(None, arguments.frames):
            begin_s = time.thread_time()
            next(frames)
            spent_ms.append(1e3 * (time.thread_time() - begin_s))
        median_ms = statistics.median(spent_ms)
        slow_ms = sorted(spent_ms)[int(0.95 * len(spent_ms))]
        whole_s = median_ms * count / 1e3
        size = f"{size_px[0]}×{size_px[1]}"
        print(f"{size}: median {median_ms:.1f} ms, p95 {slow_ms:.1f} ms; the whole walk {whole_s:.0f} s")


if __name__ == "__main__":
    main()

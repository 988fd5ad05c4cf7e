"""A map walk through the simulated office floor: what is said, and what following it live costs.

``python -m benchmarks.map_walk [--length-m 60] [--speed 1]`` prints JSON. A careful walk should hear little; ``--speed
3`` shows every third frame, as if it were walked three times as fast. The work is done in line, one thread after the
other, so that what is measured is the work of each.
"""

from __future__ import annotations

import argparse
import json
import resource
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from device_agent.map_walk.map_walks import free_bytes_of
from device_agent.map_walk.recorder import WalkRecording
from device_agent.map_walk.walk_folder import new_walk
from device_agent.simulation.office_floor import office_floor
from device_agent.simulation.sensors import head_camera
from device_agent.simulation.simulated_walk import simulated_walk
from device_agent.single_core import use_one_core
from device_agent.state import MapWalkTold
from device_agent.warm_up import warm_up
from navcore.settings import Settings

RATE_HZ = 10.0


def main() -> None:
    """Walk, and print the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--length-m", type=float, default=60.0)
    parser.add_argument("--speed", type=int, default=1)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    use_one_core()
    warm_up()
    said: list[tuple[float, str]] = []
    took_ms: list[float] = []
    now_s = 0.0

    def told(what: MapWalkTold) -> None:
        said.append((round(now_s, 1), what.text("en")))

    before_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    with tempfile.TemporaryDirectory() as folder:
        walk = new_walk(Path(folder), "")
        recording = WalkRecording(walk, head_camera(320, 240), Settings(), told, beside=False, free_bytes=free_bytes_of)
        frames = simulated_walk(office_floor(), None, arguments.seed, rate_hz=RATE_HZ, max_length_m=arguments.length_m)
        for number, (frame, _) in enumerate(frames):
            if number % arguments.speed:
                continue
            now_s = number / arguments.speed / RATE_HZ
            began_s = time.perf_counter()
            recording.take(replace(frame, stamp_s=now_s))
            took_ms.append(1e3 * (time.perf_counter() - began_s))
        size_mb = sum(path.stat().st_size for path in walk.rglob("*")) / 2**20
        recording.finish()
    figures = {
        "frames": len(took_ms),
        "seconds": round(now_s, 1),
        "ms_median": round(float(np.median(took_ms)), 1),
        "ms_p95": round(float(np.percentile(took_ms, 95)), 1),
        "ms_max": round(max(took_ms), 1),
        "share_of_real_time": round(sum(took_ms) / (1e3 * max(now_s, 0.1)), 3),
        "memory_grown_mb": round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024 - before_mb),
        "disk_mb_per_minute": round(60.0 * size_mb / max(now_s, 0.1), 1),
        "said": said,
    }
    json.dump(figures, sys.stdout, indent=1)
    sys.stdout.write("\n")


if __name__ == "__main__":
    main()

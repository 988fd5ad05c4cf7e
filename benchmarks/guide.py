"""Time from a depth frame to the cues: scan, guide, cues, on one core.

    python benchmarks/guide.py RECORDING [--frames N] [--json]

RECORDING is in the TUM RGB-D layout with ``groundtruth.txt``; its poses stand in for localization, which has its own
benchmark. The route is the recorded way itself. Prints median and 95th percentile in milliseconds as JSON.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path

import numpy as np

from navcore.cues.memory import CueMemory
from navcore.cues.speech import cues_for
from navcore.errors import VbrError
from navcore.guide import guide
from navcore.obstacle.scan import scan
from navcore.planning.projection import arc_lengths_m
from navcore.planning.road_joining import evenly_spaced
from navcore.recording import open_recording, read_trajectory
from navcore.settings import Settings
from navcore.types import Guidance, Localization, LocalizationQuality, Route


def measure(folder: Path, count: int) -> dict[str, object]:
    """Return the figures over the first frames of a recording. Raises RecordingError."""
    recording, settings = open_recording(folder), Settings()
    stamps, poses = read_trajectory(folder / "groundtruth.txt")
    points = evenly_spaced(np.array([pose.translation[:2] for pose in poses]), settings.planning.route_spacing_m)
    route = Route(points, arc_lengths_m(points))
    previous: Guidance | None = None
    memory = CueMemory()
    times_ms: list[tuple[float, float, float]] = []
    for entry in recording.entries[: count + 1]:
        frame = recording.read(entry)
        pose = poses[int(np.argmin(np.abs(stamps - entry.stamp_s)))]
        located = Localization(entry.stamp_s, LocalizationQuality.LOCALIZED, pose)
        began = time.perf_counter()
        found = scan(frame.depth_m, recording.intrinsics, pose, settings.obstacle)
        scanned = time.perf_counter()
        previous = guide(entry.stamp_s, located, route, found, None, previous, settings)
        guided = time.perf_counter()
        _, memory = cues_for(previous, memory, route, settings, entry.stamp_s)
        ended = time.perf_counter()
        times_ms.append((1e3 * (scanned - began), 1e3 * (guided - scanned), 1e3 * (ended - guided)))
    # The first frame compiles, or loads what was compiled.
    table = np.array(times_ms[1:])
    figures: dict[str, object] = {
        "frames": len(table), "width_px": recording.intrinsics.width_px, "height_px": recording.intrinsics.height_px,
    }  # fmt: skip
    for name, column in (*zip(("scan", "guide", "cues"), table.T, strict=True), ("depth_to_cue", table.sum(axis=1))):
        figures[f"{name}_median_ms"] = round(float(np.median(column)), 3)
        figures[f"{name}_p95_ms"] = round(float(np.percentile(column, 95)), 3)
    return figures


def main() -> int:
    """Print the figures; 1 where the recording cannot be read."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recording", type=Path)
    parser.add_argument("--frames", type=int, default=300)
    parser.add_argument("--json", action="store_true", help="on one line")
    arguments = parser.parse_args()
    try:
        figures = measure(arguments.recording, max(1, arguments.frames))
    except VbrError as error:
        print(error, file=sys.stderr)
        return 1
    print(json.dumps(figures, indent=None if arguments.json else 1))
    return 0


if __name__ == "__main__":
    sys.exit(main())

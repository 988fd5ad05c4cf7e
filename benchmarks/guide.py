"""Time from a depth frame to the decision and its cues, on one core, and whether anything grows in ten minutes of it.

    python -m benchmarks.guide [RECORDING] [--frames N] [--minutes 10] [--json]

RECORDING is in the TUM RGB-D layout with ``groundtruth.txt``; without one, a walk through the simulated office floor is
rendered at 640×480. The poses stand in for localization, which has its own benchmark; the route is the recorded way
itself. Times are the thread's own CPU time, in milliseconds: levelling and scan, memory of obstacles, guidance, cues.

With ``--minutes`` the real loop (agent, planning, voice, watchdog) walks the frames again and again for so long by its
own clock, as fast as the machine can, and what the process and Python hold is compared after the first minute and at
the end; the exit status is 1 where that grew, or where a median is above 10 ms. Prints JSON.
"""

from __future__ import annotations

import argparse
import gc
import itertools
import json
import os
import resource
import sys
import time
import tracemalloc
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from device_agent.adapters.clocks import SteppedClock
from device_agent.adapters.fakes import FakeLocalizer, FakeSonar, NoUplink
from device_agent.agent import DeviceAgent, DeviceParts
from device_agent.simulation.office_floor import office_floor
from device_agent.simulation.sensors import head_camera
from device_agent.simulation.simulated_walk import simulated_walk
from device_agent.single_core import use_one_core
from device_agent.state import DeviceState
from navcore.cues.memory import CueMemory
from navcore.cues.speech import cues_for
from navcore.cues.table import Cue
from navcore.errors import VbrError
from navcore.geometry import Transform
from navcore.guide import guide
from navcore.obstacle.memory import ObstacleMemory, remember, with_memory
from navcore.obstacle.scan import scan
from navcore.planning.poi_graph import Edge, Poi, PoiGraph
from navcore.planning.projection import arc_lengths_m
from navcore.planning.road_joining import evenly_spaced
from navcore.recording import open_recording, read_trajectory
from navcore.settings import Settings
from navcore.types import (
    Action,
    CameraIntrinsics,
    DepthImage,
    Frame,
    Guidance,
    Localization,
    LocalizationQuality,
    Route,
)
from navcore.wire import SetDestination

STAGES = ("scan", "memory", "guide", "cues")
TARGET_MS = 10.0
RATE_HZ = 30.0
WARM_UP_S = 60.0
MOST_GROWTH = {"rss_mb": 8.0, "python_kb": 256.0, "objects": 2000.0}
"""What may be found at the end beyond what was there after the first minute: caches fill, the allocator keeps pages."""
_SIMULATED_M = 10.0


@dataclass(frozen=True)
class Walk:
    """Depth frames with their poses."""

    intrinsics: CameraIntrinsics
    stamps_s: list[float]
    depths_m: list[DepthImage]
    poses: list[Transform]

    def route(self) -> Route:
        """Return the way itself."""
        spacing_m = Settings().planning.route_spacing_m
        points = evenly_spaced(np.array([pose.translation[:2] for pose in self.poses]), spacing_m)
        return Route(points, arc_lengths_m(points))


def recorded(folder: Path, count: int) -> Walk:
    """Return the first frames of a recording. Raises RecordingError."""
    recording = open_recording(folder)
    stamps, poses = read_trajectory(folder / "groundtruth.txt")
    entries = recording.entries[:count]
    return Walk(
        recording.intrinsics, [entry.stamp_s for entry in entries],
        [recording.read(entry).depth_m for entry in entries],
        [poses[int(np.argmin(np.abs(stamps - entry.stamp_s)))] for entry in entries],
    )  # fmt: skip


def simulated(count: int) -> Walk:
    """Return a walk from the hall into the middle corridor, as the device's camera sees it."""
    way = ((15.0, 2.6), (15.0, 14.0))
    shots = simulated_walk(office_floor(), way, seed=1, size_px=(640, 480), max_length_m=_SIMULATED_M)
    taken = list(itertools.islice(((frame.stamp_s, frame.depth_m, pose) for frame, pose in shots), count))
    return Walk(head_camera(640, 480), *(list(column) for column in zip(*taken, strict=True)))


def measure(walk: Walk) -> dict[str, object]:
    """Return the times of each stage over all frames but the first, which compiles or loads what was compiled."""
    settings, route = Settings(), walk.route()
    previous: Guidance | None = None
    cue_memory, obstacles = CueMemory(), ObstacleMemory()
    times_s: list[list[float]] = []
    for stamp_s, depth_m, pose in zip(walk.stamps_s, walk.depths_m, walk.poses, strict=True):
        located = Localization(stamp_s, LocalizationQuality.LOCALIZED, pose)
        here = located.pose
        assert here is not None
        clock = [time.thread_time()]
        found = scan(depth_m, walk.intrinsics, pose, settings.obstacle)
        clock.append(time.thread_time())
        obstacles = remember(obstacles, found, here, stamp_s)
        found = with_memory(found, obstacles, here, settings.obstacle)
        clock.append(time.thread_time())
        previous = guide(stamp_s, located, route, found, None, previous, settings)
        clock.append(time.thread_time())
        _, cue_memory = cues_for(previous, cue_memory, route, settings, stamp_s)
        clock.append(time.thread_time())
        times_s.append(clock)
    table_ms = 1e3 * np.diff(np.array(times_s[1:]), axis=1)
    figures: dict[str, object] = {
        "frames": len(table_ms), "width_px": walk.intrinsics.width_px, "height_px": walk.intrinsics.height_px,
    }  # fmt: skip
    columns = (*zip(STAGES, table_ms.T, strict=True), ("depth_to_cue", table_ms.sum(axis=1)))
    for name, column in columns:
        for label, share in (("median", 50.0), ("p95", 95.0), ("p99", 99.0)):
            figures[f"{name}_{label}_ms"] = round(float(np.percentile(column, share)), 3)
    return figures


class _Replay:
    """A camera that shows the frames again and again, at a steady rate by the clock."""

    def __init__(self, walk: Walk, clock: SteppedClock) -> None:
        self.intrinsics = walk.intrinsics
        self._walk, self._clock = walk, clock
        self._colour = np.zeros((walk.intrinsics.height_px, walk.intrinsics.width_px, 3), np.uint8)
        self.number = -1

    @property
    def index(self) -> int:
        return self.number % len(self._walk.poses)

    def read(self) -> Frame:
        self.number += 1
        self._clock.sleep_until(self._clock.now_s() + 1.0 / RATE_HZ)
        return Frame(self._clock.now_s(), self._colour, self._walk.depths_m[self.index])

    def close(self) -> None:
        """Nothing is open."""


class _Silent:
    """An output that keeps nothing."""

    def play(self, cue: Cue) -> None:
        """Let it pass."""

    def close(self) -> None:
        """Nothing is open."""


def growth(walk: Walk, minutes: float) -> dict[str, object]:
    """Return what the process holds after the first minute, and what it has gained at the end. Simulated minutes."""
    clock = SteppedClock(1000.0)
    camera, sonar = _Replay(walk, clock), FakeSonar(clock)

    def locate(frame: Frame) -> Localization:
        pose = walk.poses[camera.index]
        return Localization(frame.stamp_s, LocalizationQuality.LOCALIZED, pose, np.eye(6) * 1e-4, 200)

    localizer = FakeLocalizer(locate)
    parts = DeviceParts(clock, camera, sonar, _Silent(), NoUplink(), lambda *_: localizer)
    agent = DeviceAgent(parts, DeviceState(Settings(), _graph(walk.route())), localizer)
    held = _Held.now()
    begin_s, warm, walking = clock.now_s(), False, 0
    tracemalloc.start()
    while clock.now_s() - begin_s < 60.0 * minutes:
        if camera.index == len(walk.poses) - 1 or camera.number < 0:
            agent.submit(SetDestination("end"))
        sonar.echo(None)
        walking += agent.run_cycle().guidance.action is Action.WALK
        agent.watchdog.check()
        if not warm and clock.now_s() - begin_s >= min(WARM_UP_S, 30.0 * minutes):
            held, warm = _Held.now(), True
    gained = _Held.now()
    tracemalloc.stop()
    return {
        "minutes": minutes, "cycles": camera.number + 1, "walks": camera.number // len(walk.poses) + 1,
        "walking_share": round(walking / (camera.number + 1), 3),
        "rss_mb": round(held.rss_mb, 1), "rss_mb_growth": round(gained.rss_mb - held.rss_mb, 2),
        "python_kb": round(held.python_kb, 1), "python_kb_growth": round(gained.python_kb - held.python_kb, 1),
        "objects": held.objects, "objects_growth": gained.objects - held.objects,
    }  # fmt: skip


@dataclass(frozen=True)
class _Held:
    """What a process holds."""

    rss_mb: float
    python_kb: float
    objects: int

    @staticmethod
    def now() -> _Held:
        gc.collect()
        pages = int(Path("/proc/self/statm").read_text().split()[1])
        traced = tracemalloc.get_traced_memory()[0] if tracemalloc.is_tracing() else 0
        return _Held(pages * os.sysconf("SC_PAGE_SIZE") / 1e6, traced / 1e3, len(gc.get_objects()))


def _graph(route: Route) -> PoiGraph:
    path = tuple((float(x), float(y)) for x, y in route.points_m)
    pois = {"begin": Poi("begin", "Begin", "hall", *path[0]), "end": Poi("end", "End", "room", *path[-1])}
    return PoiGraph(1, pois, {"road": Edge("road", "begin", "end", path, route.length_m)})


def too_much(figures: dict[str, object]) -> list[str]:
    """Return the figures that are beyond their limits."""
    limits = {f"{name}_growth": most for name, most in MOST_GROWTH.items()} | {"depth_to_cue_median_ms": TARGET_MS}
    return [name for name, most in limits.items() if name in figures and float(str(figures[name])) > most]


def main() -> int:
    """Print the figures; 1 where a figure is beyond its limit, or the recording cannot be read."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recording", type=Path, nargs="?")
    parser.add_argument("--frames", type=int, default=300)
    parser.add_argument("--minutes", type=float, default=0.0, help="of the clock of the loop; 0 measures no growth")
    parser.add_argument("--json", action="store_true", help="on one line")
    arguments = parser.parse_args()
    use_one_core()
    try:
        count = max(1, arguments.frames) + 1
        walk = simulated(count) if arguments.recording is None else recorded(arguments.recording, count)
    except VbrError as error:
        print(error, file=sys.stderr)
        return 1
    figures = measure(walk)
    if arguments.minutes > 0.0:
        figures |= growth(walk, arguments.minutes)
    figures["peak_mb"] = round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3, 1)
    figures["beyond_limits"] = too_much(figures)
    print(json.dumps(figures, indent=None if arguments.json else 1))
    return int(bool(figures["beyond_limits"]))


if __name__ == "__main__":
    sys.exit(main())

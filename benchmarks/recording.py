"""What recording costs: the loop's thread, the writer's thread, bytes, and memory.

    python -m benchmarks.recording [--frames N] [--size WxH] [--live-s S] [--cycles N]

Frames of a walk through the simulated office floor go through the real loop (agent, planning, voice); the true poses
stand in for localization. Each frame is given to three devices in turn, one that records nothing, one without and one
with pictures, so that whatever else the machine does falls on all of them. Times are the thread's own CPU time, in
milliseconds. ``live`` runs the writer's thread beside the loop, at 10 Hz in real time, and gives the wall time of a
cycle; ``growth`` records so many cycles with rotation, and compares what the process holds after a quarter and at the
end. Prints JSON.
"""

from __future__ import annotations

import argparse
import itertools
import json
import os
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from device_agent.adapters.clocks import SteppedClock, SystemClock
from device_agent.adapters.fakes import FakeCamera, FakeLocalizer, FakeOutput, FakeSonar, NoUplink
from device_agent.agent import DeviceAgent, DeviceParts
from device_agent.ports import Clock
from device_agent.recording.options import RecordingOptions
from device_agent.recording.recorder import WalkRecorder
from device_agent.recording.tap import Tap
from device_agent.recording.walk_files import parts_in
from device_agent.simulation.office_floor import office_floor
from device_agent.simulation.sensors import head_camera
from device_agent.simulation.simulated_walk import simulated_walk
from device_agent.simulation_options import picture_size
from device_agent.single_core import use_one_core
from device_agent.state import DeviceState
from navcore.geometry import Transform
from navcore.planning.poi_graph import Edge, Poi, PoiGraph
from navcore.recording import depth_from_units, units_from_depth
from navcore.settings import Settings
from navcore.types import CameraIntrinsics, Frame, Localization, LocalizationQuality
from navcore.wire import SetDestination

RATE_HZ = 10.0
_WARM_UP = 10


@dataclass(frozen=True, slots=True, eq=False)
class Walk:
    """Frames, and where they were taken."""

    camera: CameraIntrinsics
    seen: list[tuple[Frame, Transform]]
    graph: PoiGraph

    def in_millimetres(self) -> Walk:
        """Return the walk as a camera would have seen it that measures whole millimetres."""
        seen = [
            (replace(frame, depth_m=depth_from_units(units_from_depth(frame.depth_m, 1000.0), 1000.0)), pose)
            for frame, pose in self.seen
        ]
        return replace(self, seen=seen)


def simulated(size_px: tuple[int, int], count: int) -> Walk:
    """Render the beginning of a walk through the office floor."""
    walk = simulated_walk(office_floor(), seed=0, size_px=size_px, rate_hz=RATE_HZ)
    seen = list(itertools.islice(walk, count))
    (x0, y0), (x1, y1) = ((float(pose.translation[0]), float(pose.translation[1])) for _, pose in (seen[0], seen[-1]))
    line = ((x0, y0), (x1 + 20.0, y1))
    graph = PoiGraph(
        1,
        {"a": Poi("a", "Start", "other", *line[0]), "b": Poi("b", "End", "other", *line[1])},
        {"ab": Edge("ab", "a", "b", line, float(np.hypot(line[1][0] - x0, line[1][1] - y0)))},
    )
    return Walk(head_camera(*size_px), seen, graph)


class Device:
    """The agent on the frames of a walk, again and again."""

    def __init__(self, walk: Walk, tap: Tap, clock: Clock) -> None:
        self._clock, self._walk = clock, walk
        self._poses: dict[float, Transform] = {}
        self._sonar = FakeSonar(clock)
        camera = FakeCamera(walk.camera, clock, self._frames())
        parts = DeviceParts(
            clock, camera, self._sonar, FakeOutput(), NoUplink(), lambda *_: FakeLocalizer(self._locate), tap=tap
        )
        self.agent = DeviceAgent(parts, DeviceState(Settings(), walk.graph), FakeLocalizer(self._locate))
        self.agent.submit(SetDestination("b"))

    def cycle(self) -> float:
        """Run one; return its wall time without the wait for the frame, milliseconds."""
        self._sonar.echo(None)
        began_s = time.perf_counter()
        cycle = self.agent.run_cycle()
        return 1000.0 * (time.perf_counter() - began_s) - cycle.stage_ms["capture"]

    def _frames(self) -> Iterable[Frame]:
        stamp_s = self._clock.now_s()
        for frame, pose in itertools.cycle(self._walk.seen):
            stamp_s += 1.0 / RATE_HZ
            self._poses = {stamp_s: pose}
            yield replace(frame, stamp_s=stamp_s)

    def _locate(self, frame: Frame) -> Localization:
        pose = self._poses[frame.stamp_s]
        return Localization(frame.stamp_s, LocalizationQuality.LOCALIZED, pose, np.eye(6) * 1e-4, 200)


def in_turn(walk: Walk, folder: Path) -> dict[str, Any]:
    """Return the CPU time of a cycle with and without a recorder, that of its writing, and the bytes of a minute."""
    recorders = {
        name: WalkRecorder(RecordingOptions(folder / name, name == "pictures", reserve_bytes=0))
        for name in ("poses", "pictures")
    }
    devices = {name: Device(walk, recorders.get(name, Tap()), SteppedClock()) for name in ("nothing", *recorders)}
    loop_ms: dict[str, list[float]] = {name: [] for name in devices}
    write_ms: dict[str, list[float]] = {name: [] for name in recorders}
    names = list(devices)
    for number in range(len(walk.seen)):
        # Who comes first finds the caches cold.
        for name in names[number % len(names) :] + names[: number % len(names)]:
            device = devices[name]
            loop_ms[name].append(_cpu_ms(device.cycle))
            if name in recorders:
                write_ms[name].append(_cpu_ms(recorders[name].check))
    figures: dict[str, Any] = {"loop_nothing_ms": _middle(loop_ms["nothing"])}
    for name, recorder in recorders.items():
        recorder.close()
        size = sum(path.stat().st_size for path in parts_in(folder / name))
        more_ms = np.subtract(loop_ms[name], loop_ms["nothing"])
        figures[name] = {
            "loop_ms": _middle(loop_ms[name]),
            "loop_more_ms": _middle(more_ms),
            "write_ms": _middle(write_ms[name]),
            "megabytes_per_minute": round(size / len(walk.seen) * RATE_HZ * 60.0 / 1e6, 2),
        }
    return figures


def live(walk: Walk, folder: Path, seconds: float) -> dict[str, Any]:
    """Return the wall time of a cycle while a recorder's thread writes beside it, and what was dropped."""
    figures: dict[str, Any] = {}
    for name in ("nothing", "poses", "pictures"):
        recorder = WalkRecorder(RecordingOptions(folder / name, name == "pictures", reserve_bytes=0))
        device = Device(walk, Tap() if name == "nothing" else recorder, SystemClock())
        recorder.start()
        times_ms: list[float] = []
        until_s = time.monotonic() + seconds
        while time.monotonic() < until_s:
            times_ms.append(device.cycle())
        recorder.close()
        figures[name] = {
            "cycle_p50_ms": _middle(times_ms[_WARM_UP:]),
            "cycle_p99_ms": round(float(np.percentile(times_ms[_WARM_UP:], 99)), 3),
            "cycles": len(times_ms),
            "pictures_dropped": recorder.pictures_dropped,
        }
    return figures


def growth(walk: Walk, folder: Path, count: int) -> dict[str, Any]:
    """Return what the process holds after a quarter of the cycles, and at the end, while files rotate and go."""
    options = RecordingOptions(
        folder, pictures=True, max_part_bytes=16 << 20, max_total_bytes=64 << 20, reserve_bytes=0
    )  # fmt: skip
    recorder = WalkRecorder(options)
    device = Device(walk, recorder, SteppedClock())
    quarter_mb = 0.0
    for number in range(count):
        device.cycle()
        recorder.check()
        if number == count // 4:
            quarter_mb = _resident_mb()
    end_mb = _resident_mb()
    recorder.close()
    return {
        "cycles": count, "rss_after_a_quarter_mb": quarter_mb, "rss_at_the_end_mb": end_mb,
        "files_mb": round(sum(path.stat().st_size for path in parts_in(folder)) / 1e6, 1),
    }  # fmt: skip


def _cpu_ms(work: Callable[[], object]) -> float:
    began_s = time.thread_time()
    work()
    return 1000.0 * (time.thread_time() - began_s)


def _middle(values_ms: Sequence[float]) -> float:
    return round(float(np.median(values_ms[_WARM_UP:])), 3)


def _resident_mb() -> float:
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return round(pages * os.sysconf("SC_PAGE_SIZE") / 1e6, 1)


def main() -> int:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=60)
    parser.add_argument("--size", type=picture_size, default=(640, 480), metavar="WxH")
    parser.add_argument("--live-s", type=float, default=15.0)
    parser.add_argument("--cycles", type=int, default=1200)
    arguments = parser.parse_args()
    use_one_core()
    walk = simulated(arguments.size, arguments.frames)
    exact = walk.in_millimetres()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        figures = {
            "size_px": list(arguments.size),
            "depth_in_millimetres": in_turn(exact, folder / "mm"),
            "depth_in_metres": in_turn(walk, folder / "m"),
            "live": live(exact, folder / "live", arguments.live_s),
            "growth": growth(exact, folder / "growth", arguments.cycles),
        }
    json.dump(figures, sys.stdout, indent=1)
    sys.stdout.write("\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())

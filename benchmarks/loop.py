"""The whole device on one core: from a frame's capture to its cue, memory after an hour, and the time until *Ready*.

    python -m benchmarks.loop --cache FOLDER [--seconds 60] [--rate-hz 30] [--no-plan] [--in-line]
    python -m benchmarks.loop --cache FOLDER --target-quota [--seconds 60]
    python -m benchmarks.loop --cache FOLDER --compare 0.35 [--turns 3] [--seconds 30]
    python -m benchmarks.loop --cache FOLDER --minutes 60
    python -m benchmarks.loop --cache FOLDER --start
    python -m benchmarks.loop --cache FOLDER --accuracy

FOLDER keeps what is made the first time (some minutes, 6 GB): a walk of 150 m through the simulated office floor at
640×480, the site that is built of it (more than 300 key frames), and another walk of 18 m at 30 Hz in the building.

- The first command plays the second walk back and forth at the camera's rate, in real time, to the device: its reader's
  thread, the real localizer in the real map, obstacles, guidance, voice, watchdog, recorder (without pictures), event
  journal, and a link to a console that is not there. All of it runs on one core (``sched_setaffinity``). Frames lie
  unpacked on disk; copying them is paid on the same core. ``others_core_share`` is what other processes took of that
  core meanwhile: where that is more than a few hundredths, the times are not the device's own. ``late_share`` is the
  share of the cycles that went on without the pose of their frame, ``pose`` how far the *Localized* poses that guidance
  had are from the truth. ``--no-plan`` leaves nothing out, however slow it is; ``--in-line`` waits for
  each pose, as the device does in the simulated building.
- ``--target-quota`` emulates the target: the process gets a share of the core in the ratio of 1.44 GHz to this
  machine's clock (``--target-ghz`` for another one; ``--host-ghz`` where the kernel does not tell it; see
  benchmarks/cpu_quota.py).
- ``--compare`` emulates a clock of so many GHz with the load plan, without it, and without both it and the thread that
  localization has, in turn and anew each time, so that what else the machine does falls on all of them.
- ``--minutes`` plays the first walk at 10 Hz for so long by the device's clock, as fast as the machine can, with the
  recorder writing in between, and tells what the process holds.
- ``--start`` runs ``vbr device`` on the recording and takes the time from its start until it says *Ready*, with the
  kernels compiled (``make install`` does that) and, the last time, without.
- ``--accuracy`` plays both walks forwards at each level of the load plan, and compares the poses with the truth, those
  that were carried on at half rate apart. The first walk is the map's own, at 10 Hz.

Prints JSON. Times are real time, in milliseconds.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.cpu_quota import clock_ghz, limited, measured_fraction, others_fraction
from benchmarks.prepared_frames import PreparedCamera, PreparedFrames, prepared
from device_agent.adapters.clocks import SteppedClock, SystemClock
from device_agent.adapters.fakes import FakeSonar, NoUplink
from device_agent.adapters.newest_frame import NewestFrameCamera
from device_agent.adapters.outputs import TextOutput
from device_agent.agent import DeviceAgent, DeviceParts
from device_agent.cycle import Cycle
from device_agent.journal import EventJournal
from device_agent.link import ConsoleLink
from device_agent.link_settings import LinkSettings
from device_agent.load_plan import LoadLevel
from device_agent.localization import make_localizer
from device_agent.locating import Beside, InLine, Locator
from device_agent.orders import Lead
from device_agent.ports import Clock, DepthCamera, LocalizerPort, Uplink
from device_agent.recording.options import RecordingOptions
from device_agent.recording.recorder import WalkRecorder
from device_agent.simulation.walk_recording import record_walk
from device_agent.single_core import use_one_core
from device_agent.stage_statistics import StageTimes
from device_agent.state import DeviceState
from device_agent.warm_up import warm_up
from navcore.evaluation import align_rigidly
from navcore.geometry import Transform
from navcore.recording import open_recording, read_trajectory
from navcore.settings import LocalizationSettings, Settings
from navcore.site import load_site, save_site
from navcore.site_building import build_site
from navcore.slam.lie import log_so3
from navcore.types import Localization, LocalizationQuality

SIZE_PX = (640, 480)
TARGET_GHZ = 1.44
"""The clock of the glasses' processor."""
PLACES = ("bar", "wash-room")
"""Where the device leads, in turn."""
HOUR_RATE_HZ = 10.0
STARTS = 4
MOST_COMPARED = 600
"""Frames of a walk of which poses are compared with the truth."""
_NOBODY = "ws://127.0.0.1:9"
"""Nothing listens there."""
_SETTLING_S = 3.0
"""What happens in the first seconds is told apart: the place is looked for."""


# ------------------------------------------------------------------------------------------------------ preparing
def prepare(cache: Path) -> None:
    """Make what is missing in the cache."""
    cache.mkdir(parents=True, exist_ok=True)
    if not (cache / "walk").exists():
        record_walk(cache / "walk", 0, SIZE_PX, HOUR_RATE_HZ, min_length_m=150.0)
    if not (cache / "walk30").exists():
        record_walk(cache / "walk30", 1, SIZE_PX, 30.0, max_length_m=18.0)
    if not (cache / "site").exists():
        site, _ = build_site(open_recording(cache / "walk"), "Office", LocalizationSettings(), lambda *_: None)
        save_site(site, cache / "site")


# -------------------------------------------------------------------------------------------------------- devices
class Device:
    """The agent on prepared frames, always leading somewhere."""

    def __init__(
        self,
        cache: Path,
        folder: Path,
        camera: DepthCamera,
        clock: Clock,
        uplink: Uplink,
        *,
        plans: bool = False,
        locating: Callable[[LocalizerPort], Locator] = InLine,
        level: LoadLevel | None = None,
    ) -> None:
        """``level`` is that of every cycle, whatever the plan says."""
        self._site = load_site(cache / "site")
        settings = Settings()
        localizer = make_localizer(self._site, camera.intrinsics, settings)
        self.keyframes = len(self._site.map_arrays["camera_from_world"])
        self.recorder = _LevelledRecorder(RecordingOptions(folder / "records", reserve_bytes=0), level)
        self._sonar = FakeSonar(clock)
        output = TextOutput(Path(os.devnull).open("w"))  # noqa: SIM115 - as long as the process
        parts = DeviceParts(
            clock, camera, self._sonar, output, uplink, make_localizer, plans_load=plans, tap=self.recorder,
            locating=locating,
        )  # fmt: skip
        self.recorder.rehearsed(frame := camera.read())
        localizer.locate(frame)
        self.agent = DeviceAgent(parts, DeviceState(settings, self._site.poi_graph, self._site.site_id), localizer)
        self._led = 0

    def cycle(self) -> Cycle:
        """Run one; who has arrived is led to the other place."""
        if not self.agent.state.leading:
            self.agent.submit(Lead(PLACES[self._led % len(PLACES)]))
            self._led += 1
        self._sonar.echo(None)
        return self.agent.run_cycle()


class _LevelledRecorder(WalkRecorder):
    """A recorder that decides the level of the load plan, where that is wanted."""

    def __init__(self, options: RecordingOptions, level: LoadLevel | None) -> None:
        super().__init__(options)
        self._level = level

    def load_level(self, level: LoadLevel) -> LoadLevel:
        """Return the level that is wanted."""
        return super().load_level(self._level or level)


def walk(cache: Path, seconds: float, rate_hz: float, fraction: float, *, plans: bool, in_line: bool) -> dict[str, Any]:
    """Play the second walk in real time; return the figures."""
    frames = prepared(cache / "walk30", cache / "walk30.frames")
    clock = SystemClock()
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        journal = EventJournal(folder / "events.sqlite")
        stack.callback(journal.close)
        link = ConsoleLink(LinkSettings(_NOBODY, "token", folder / "staging"), journal, clock)
        stack.callback(link.stop)
        source = PreparedCamera(frames, clock, rate_hz)
        camera = NewestFrameCamera(source, clock, Settings().watchdog.camera_timeout_s)
        stack.callback(camera.close)
        how = stack.enter_context(limited(fraction))
        share = measured_fraction()
        device = Device(cache, folder, camera, clock, link, plans=plans, locating=InLine if in_line else Beside)
        stack.callback(device.recorder.close)
        device.recorder.start()
        link.start(device.agent)
        _, truth = read_trajectory(cache / "walk30" / "groundtruth.txt")
        figures = _walked(device, source, clock, seconds, truth)
    return {"limit": how, "core_share": round(share, 3), **figures}


def _walked(
    device: Device, source: PreparedCamera, clock: Clock, seconds: float, truth: Sequence[Transform]
) -> dict[str, Any]:
    agent = device.agent
    agent.watchdog.start()
    taken: list[StageTimes] = []
    levels: Counter[str] = Counter()
    qualities: Counter[str] = Counter()
    actions: Counter[str] = Counter()
    found: list[tuple[Localization, Transform]] = []
    late_count = 0
    begin_s = clock.now_s() + _SETTLING_S
    others = others_fraction(max(os.sched_getaffinity(0)))
    captured = 0
    while clock.now_s() < begin_s + seconds:
        cycle = device.cycle()
        if clock.now_s() < begin_s:
            captured = source.captured_count
            continue
        located = cycle.localization
        late_count += cycle.pose_late
        if located is not None and located.quality is LocalizationQuality.LOCALIZED:
            found.append((located, truth[source.index_at(cycle.stamp_s)]))
        if agent.monitor.newest is not None:
            taken.append(agent.monitor.newest)
        state = agent.state
        levels[state.load_level.value] += 1
        qualities[state.located.quality.value if state.located else "none"] += 1
        actions[state.guidance.action.value if state.guidance else "none"] += 1
    passed_s = clock.now_s() - begin_s
    agent.watchdog.stop()
    return {
        "keyframes": device.keyframes,
        "others_core_share": round(others(), 3),
        "camera_hz": round((source.captured_count - captured) / passed_s, 1),
        "frame_rate_hz": round(len(taken) / passed_s, 1),
        "late_share": round(late_count / max(1, len(taken)), 3),
        "pose": _apart(found, _building_from_map(found)) if found else None,
        **_percentiles(taken),
        "missed": {each.stage: each.missed_count for each in agent.monitor.summaries},
        "levels": dict(levels), "qualities": dict(qualities), "actions": dict(actions),
        "watchdog_stops": agent.watchdog.stop_count,
        **_memory(),
    }  # fmt: skip


def _percentiles(taken: list[StageTimes]) -> dict[str, Any]:
    by_stage = {name: 1000.0 * np.array([asdict(each)[name] for each in taken]) for name in asdict(taken[0])}
    return {
        f"{name.removesuffix('_s')}_ms": {
            "p50": round(float(np.percentile(values_ms, 50)), 1),
            "p99": round(float(np.percentile(values_ms, 99)), 1),
            "max": round(float(values_ms.max()), 1),
        }
        for name, values_ms in by_stage.items()
    }


def hour(cache: Path, minutes: float) -> dict[str, Any]:
    """Play the first walk for so long by the device's clock; return what the process holds."""
    frames: PreparedFrames = prepared(cache / "walk", cache / "walk.frames")
    clock = SteppedClock(1000.0)
    began_s, real_s = clock.now_s(), time.monotonic()
    held: dict[str, float] = {}
    with tempfile.TemporaryDirectory() as name:
        camera = PreparedCamera(frames, clock, HOUR_RATE_HZ)
        device = Device(cache, Path(name), camera, clock, NoUplink())
        qualities: Counter[str] = Counter()
        marks = [*(each for each in (1, 5, 15, 30, 45) if each < minutes), minutes]
        while marks:
            device.cycle()
            device.recorder.check()
            device.agent.watchdog.check()
            located = device.agent.state.located
            qualities[located.quality.value if located else "none"] += 1
            if clock.now_s() - began_s >= 60.0 * marks[0]:
                held[f"rss_after_{marks.pop(0):g}_min_mb"] = _resident_mb()
        device.recorder.close()
        camera.close()
    return {
        "keyframes": device.keyframes, "minutes": minutes, "cycles": sum(qualities.values()),
        "qualities": dict(qualities), **held, **_memory(), "took_s": round(time.monotonic() - real_s, 1),
    }  # fmt: skip


def accuracy(cache: Path) -> dict[str, Any]:
    """Return the errors of the poses at each level, of both walks."""
    return {
        f"{name} at {rate_hz:g} Hz": {level.value: _errors(cache, name, rate_hz, level) for level in LoadLevel}
        for name, rate_hz in (("walk30", 30.0), ("walk", HOUR_RATE_HZ))
    }


def _errors(cache: Path, name: str, rate_hz: float, level: LoadLevel) -> dict[str, Any]:
    frames = prepared(cache / name, cache / f"{name}.frames")
    _, truth = read_trajectory(cache / name / "groundtruth.txt")
    clock = SteppedClock(1000.0)
    found: list[tuple[Localization, Transform]] = []
    qualities: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as folder:
        camera = PreparedCamera(frames, clock, rate_hz)
        device = Device(cache, Path(folder), camera, clock, NoUplink(), level=level)
        while camera.captured_count < min(MOST_COMPARED, frames.count):
            device.cycle()
            device.recorder.check()
            located = device.agent.state.located
            assert located is not None, "a prepared camera does not fail"
            qualities[located.quality.value] += 1
            if located.quality is LocalizationQuality.LOCALIZED:
                found.append((located, truth[camera.captured_count - 1]))
        device.recorder.close()
        camera.close()
    building_from_map = _building_from_map(found)
    carried = [each for each in found if each[0].inlier_count == 0]
    figures: dict[str, Any] = {"qualities": dict(qualities)}
    for which, poses in (("located", [each for each in found if each[0].inlier_count > 0]), ("carried", carried)):
        if poses:
            figures[which] = _apart(poses, building_from_map)
    return figures


def _building_from_map(found: list[tuple[Localization, Transform]]) -> Transform:
    places = [pose.translation for located, _ in found if (pose := located.world_from_camera) is not None]
    return align_rigidly(np.array([true.translation for _, true in found]), np.array(places))


def _apart(found: list[tuple[Localization, Transform]], building_from_map: Transform) -> dict[str, float]:
    off_m, turned_deg = [], []
    for located, true in found:
        assert located.world_from_camera is not None
        off = true.inverse() @ building_from_map @ located.world_from_camera
        off_m.append(float(np.linalg.norm(off.translation)))
        turned_deg.append(float(np.degrees(np.linalg.norm(log_so3(np.array(off.rotation))))))
    return {
        "frames": len(found),
        "position_rmse_m": round(float(np.sqrt(np.mean(np.square(off_m)))), 4), "position_max_m": round(max(off_m), 3),
        "rotation_median_deg": round(float(np.median(turned_deg)), 2), "rotation_max_deg": round(max(turned_deg), 2),
    }  # fmt: skip


def start(cache: Path) -> dict[str, Any]:
    """Return the times from a process's start until it says *Ready*; the last one compiles all kernels first."""
    warm = [_until_ready(cache, dict(os.environ)) for _ in range(STARTS)]
    with tempfile.TemporaryDirectory() as empty:
        cold_s = _until_ready(cache, {**os.environ, "NUMBA_CACHE_DIR": empty})
    return {"ready_s": warm, "ready_without_compiled_kernels_s": cold_s}


def _until_ready(cache: Path, environment: dict[str, str]) -> float:
    with tempfile.TemporaryDirectory() as state:
        command = [
            sys.executable, "-m", "device_agent", "device", "--site", str(cache / "site"),
            "--recording", str(cache / "walk"), "--state", state,
        ]  # fmt: skip
        began_s = time.monotonic()
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment) as process:
            assert process.stdout is not None
            said = next((line for line in process.stdout if "Ready." in line), None)
            took_s = time.monotonic() - began_s
            process.terminate()
            if said is None:
                raise RuntimeError("vbr device has ended without saying Ready: run it by hand to see why.")
    return round(took_s, 2)


def _resident_mb() -> float:
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return round(pages * os.sysconf("SC_PAGE_SIZE") / 1e6, 1)


def _memory() -> dict[str, float]:
    peak_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return {"rss_mb": _resident_mb(), "rss_peak_mb": round(peak_kb * 1024 / 1e6, 1)}


def _measured(arguments: argparse.Namespace) -> dict[str, Any]:
    if arguments.accuracy:
        return accuracy(arguments.cache)
    if arguments.minutes is not None:
        return hour(arguments.cache, arguments.minutes)
    fraction = 1.0 if arguments.target_ghz is None else min(1.0, arguments.target_ghz / arguments.host_ghz)
    return walk(
        arguments.cache, arguments.seconds, arguments.rate_hz, fraction, plans=not arguments.no_plan,
        in_line=arguments.in_line,
    )  # fmt: skip


def compare(cache: Path, target_ghz: float, turns: int, arguments: argparse.Namespace) -> list[dict[str, Any]]:
    """Return the figures of each walk under the quota, each in a process of its own, in turn."""
    runs = []
    for turn in range(turns):
        for flags in ([], ["--no-plan"], ["--no-plan", "--in-line"]):
            command = [
                sys.executable, "-m", "benchmarks.loop", "--cache", str(cache), "--target-ghz", str(target_ghz),
                "--host-ghz", str(arguments.host_ghz), "--seconds", str(arguments.seconds),
                "--rate-hz", str(arguments.rate_hz), *flags,
            ]  # fmt: skip
            done = subprocess.run(command, stdout=subprocess.PIPE, check=True, text=True)
            runs.append({"turn": turn + 1, "flags": flags, **json.loads(done.stdout)})
    return runs


def main() -> int:
    """Run the benchmark; print its figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cache", type=Path, required=True, metavar="FOLDER")
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--rate-hz", type=float, default=30.0)
    parser.add_argument("--in-line", action="store_true")
    parser.add_argument("--target-ghz", type=float)
    parser.add_argument("--target-quota", dest="target_ghz", action="store_const", const=TARGET_GHZ)
    parser.add_argument("--compare", type=float, metavar="GHZ")
    parser.add_argument("--turns", type=int, default=3)
    parser.add_argument("--host-ghz", type=float, default=clock_ghz())
    parser.add_argument("--no-plan", action="store_true")
    parser.add_argument("--minutes", type=float)
    parser.add_argument("--start", action="store_true")
    parser.add_argument("--accuracy", action="store_true")
    arguments = parser.parse_args()
    if (arguments.target_ghz or arguments.compare) is not None and arguments.host_ghz is None:
        parser.error("the kernel does not tell this machine's clock: name it with --host-ghz")
    prepare(arguments.cache)
    figures: dict[str, Any] | list[dict[str, Any]]
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    if arguments.start:
        figures = start(arguments.cache)
    elif arguments.compare is not None:
        figures = compare(arguments.cache, arguments.compare, arguments.turns, arguments)
    else:
        use_one_core()
        warm_up()
        figures = _measured(arguments)
    json.dump(figures, sys.stdout, indent=1)
    sys.stdout.write("\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())

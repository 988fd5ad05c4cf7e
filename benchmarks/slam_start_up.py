"""How long a process takes from its start until it can locate the walker in a site, and how much memory it then holds.

    python -m benchmarks.slam_start_up SITE RECORDING

The kernels must have been compiled (``vbr warm-up``). Wall-clock seconds since the interpreter was started, and the
process's CPU seconds, which other load does not stretch.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from itertools import islice
from pathlib import Path
from typing import Any

from navcore.settings import LocalizationSettings

FOLLOWED_FRAMES = 50
"""After so many frames the memory is read."""


def start_up_figures(site: Path, recording: Path, settings: LocalizationSettings) -> dict[str, Any]:
    """Start a process that loads the site and locates frames of the recording; return what it measured."""
    started = subprocess.run(
        [sys.executable, "-m", "benchmarks.slam_start_up", str(site), str(recording), settings.model_dump_json()],
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    if started.returncode != 0:
        return {"outcome": started.stderr.strip().splitlines()[-1]}
    figures: dict[str, Any] = json.loads(started.stdout)
    return figures


def resident_mb() -> float:
    """Return the memory of this process that is in RAM now, MB."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


def _since_start_s() -> float:
    """Return how long ago this process was started."""
    ticks = int(Path("/proc/self/stat").read_text().rsplit(")", 1)[1].split()[19])
    return time.clock_gettime(time.CLOCK_BOOTTIME) - ticks / os.sysconf("SC_CLK_TCK")


class _Stages:
    """Wall-clock and CPU seconds of the stages of a start, one after the other."""

    def __init__(self) -> None:
        self.figures: dict[str, Any] = {}
        self._wall_s, self._cpu_s = 0.0, 0.0

    def end(self, name: str) -> None:
        wall_s, cpu_s = _since_start_s(), time.process_time()
        self.figures[f"{name}_s"] = round(wall_s - self._wall_s, 3)
        self.figures[f"{name}_cpu_s"] = round(cpu_s - self._cpu_s, 3)
        self._wall_s, self._cpu_s = wall_s, cpu_s


def _start(site_folder: Path, recording_folder: Path, settings: LocalizationSettings) -> dict[str, Any]:
    stages = _Stages()
    # What a start costs is what is imported here.
    from device_agent.single_core import use_one_core
    from navcore.recording import open_recording
    from navcore.site import load_site
    from navcore.slam.localizer import Localizer
    from navcore.slam.slam_map import SlamMap

    use_one_core()
    stages.end("imports")
    site = load_site(site_folder)
    localizer = Localizer(SlamMap.from_arrays(site.map_arrays), site.intrinsics, settings)
    stages.end("map_load")
    ready = {"ready_s": round(_since_start_s(), 3), "ready_cpu_s": round(time.process_time(), 3)}
    frames = open_recording(recording_folder).frames()
    localizer.locate(next(frames))
    stages.end("first_frame")
    for frame in islice(frames, FOLLOWED_FRAMES):
        localizer.locate(frame)
    size_mb = sum(array.nbytes for array in site.map_arrays.values()) / 1e6
    memory = {"memory_mb": round(resident_mb()), "map_mb": round(size_mb, 1)}
    return {**ready, **stages.figures, **memory, "keyframes": len(site.map_arrays["keyframe_stamp_s"])}


if __name__ == "__main__":
    _, _site, _recording, *_settings = sys.argv
    _chosen = LocalizationSettings.model_validate_json(_settings[0]) if _settings else LocalizationSettings()
    json.dump(_start(Path(_site), Path(_recording), _chosen), sys.stdout)

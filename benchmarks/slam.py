"""SLAM on a recording: time per frame, accuracy, cold relocalization, start-up and memory, as JSON.

    python -m benchmarks.slam RECORDING [--features 600] [--cold 200]

Times per frame (``mapping_ms_…``, ``localization_ms_…``) are the calling thread's own CPU time, so that other load does
not matter; what other threads of the process did meanwhile is ``…_other_threads_ms_mean``, per frame. ``cv2_orb_ms``
and ``localization_cv2_orb_ms`` are ``cv2.ORB_create(1000).detectAndCompute`` on the same frames in the same runs, the
median. Start-up is measured in a process of its own (:mod:`benchmarks.slam_start_up`). What could not be measured,
without ground truth or without a map, is null; then ``outcome`` says why.
"""

from __future__ import annotations

import argparse
import json
import resource
import sys
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from benchmarks.slam_start_up import resident_mb, start_up_figures
from device_agent.single_core import use_one_core
from navcore.errors import InputError, MappingError, VbrError
from navcore.evaluation import absolute_trajectory_error
from navcore.geometry import FloatArray
from navcore.recording import Recording, open_recording, read_trajectory
from navcore.settings import LocalizationSettings
from navcore.site import Site, save_site
from navcore.slam import warm_up
from navcore.slam.features import feature_count_for, grey_of
from navcore.slam.keyframes import SlamCamera
from navcore.slam.localizer import Localizer
from navcore.slam.map_build import BF_PX_M
from navcore.slam.mapper import Mapper
from navcore.slam.slam_map import SlamMap
from navcore.types import Frame, LocalizationQuality

WRONG_M = 0.5
"""A relocalization farther from the truth than this is wrong."""


def main() -> int:
    """Run the benchmark; print its figures."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    parser.add_argument("source", type=Path, metavar="RECORDING")
    parser.add_argument("--features", type=int, default=600, help="features at 320×240; 600 is 1000 at 640×480")
    parser.add_argument("--cold", type=int, default=200, help="frames for cold relocalization")
    arguments = parser.parse_args()
    use_one_core()
    warm_up()
    recording = open_recording(arguments.source)
    figures = measure(recording, LocalizationSettings(feature_count=arguments.features), arguments.cold)
    json.dump(figures, sys.stdout, indent=1)
    sys.stdout.write("\n")
    return 0


def measure(recording: Recording, settings: LocalizationSettings, cold_count: int) -> dict[str, Any]:
    """Return all figures of a recording; where no map comes of it, those of localization are null."""
    slam_map, figures = _mapping(recording, settings)
    figures |= _localization(recording, slam_map, settings)
    figures |= _cold_relocalization(recording, slam_map, settings, cold_count)
    figures |= _start_up(recording, slam_map, settings)
    figures["peak_memory_mb"] = round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)
    return figures


class _Clock:
    """CPU time of calls in this thread, and of the process's other threads since the clock was made."""

    def __init__(self) -> None:
        self.times_ms: list[float] = []
        self._others_s = time.process_time() - time.thread_time()

    def run(self, work: Callable[..., Any], *arguments: Any) -> Any:
        """Call and measure; return what the call returns."""
        started_s = time.thread_time()
        result = work(*arguments)
        self.times_ms.append(1e3 * (time.thread_time() - started_s))
        return result

    def figures(self, name: str) -> dict[str, float | None]:
        """Return median, mean and 95th percentile, and the mean of the other threads for each call."""
        others_ms = 1e3 * (time.process_time() - time.thread_time() - self._others_s)
        return _spread(name, self.times_ms) | {
            f"{name}_other_threads_ms_mean": round(others_ms / len(self.times_ms), 2) if self.times_ms else None
        }


class _OrbClock:
    """CPU time of OpenCV's ORB, frame by frame in turn with ours, so that a busy machine slows both alike."""

    def __init__(self) -> None:
        self._orb = cv2.ORB_create(1000)  # type: ignore[attr-defined]
        self._clock = _Clock()

    def run(self, frame: Frame) -> None:
        self._clock.run(self._orb.detectAndCompute, grey_of(frame.colour_rgb), None)

    @property
    def median_ms(self) -> float | None:
        times_ms = self._clock.times_ms
        return round(float(np.median(times_ms)), 2) if times_ms else None


def _spread(name: str, times_ms: list[float]) -> dict[str, float | None]:
    if not times_ms:
        return {f"{name}_ms_{kind}": None for kind in ("median", "mean", "p95")}
    return {
        f"{name}_ms_median": round(float(np.median(times_ms)), 2),
        f"{name}_ms_mean": round(float(np.mean(times_ms)), 2),
        f"{name}_ms_p95": round(float(np.percentile(times_ms, 95)), 2),
    }


def _ratio(part: float | None, whole: float | None) -> float | None:
    return round(part / whole, 2) if part and whole else None


def _mapping(recording: Recording, settings: LocalizationSettings) -> tuple[SlamMap | None, dict[str, Any]]:
    intrinsics = recording.intrinsics
    count = feature_count_for(intrinsics.width_px, intrinsics.height_px, settings.feature_count)
    # Local mapping works beside tracking, as it does on the device; its time counts as that of other threads.
    executor = ThreadPoolExecutor(1)
    mapper = Mapper(intrinsics, SlamCamera.of(intrinsics, BF_PX_M), count, executor=executor)
    clock, orb, running = _Clock(), _OrbClock(), []
    for frame in recording.frames():
        if clock.run(mapper.add, frame):
            running.append((frame.stamp_s, mapper.world_from_camera[:3, 3].copy()))
        orb.run(frame)
    mapper.settle()
    times = clock.figures("mapping")
    started_s = time.process_time()
    slam_map, outcome = _finished(mapper)
    executor.shutdown()
    final = [] if slam_map is None else _positions(slam_map)
    return slam_map, {
        "recording": recording.folder.name,
        "outcome": outcome,
        "frames": len(recording),
        "features": count,
        "keyframes": None if slam_map is None else slam_map.keyframe_count,
        "landmarks": None if slam_map is None else len(slam_map.positions),
        "loops_closed": mapper.loop_count,
        "mapping_tracked_share": round(len(running) / len(recording), 4),
        **times,
        "finish_s": round(time.process_time() - started_s, 2),
        "cv2_orb_ms": orb.median_ms,
        "mapping_median_over_cv2_orb": _ratio(times["mapping_ms_median"], orb.median_ms),
        "ate_while_running_m": _ate(recording, running),
        "ate_final_m": _ate(recording, final),
        "mapping_memory_mb": round(resident_mb()),
    }


def _finished(mapper: Mapper) -> tuple[SlamMap | None, str]:
    try:
        return mapper.finish(), "mapped"
    except MappingError as error:
        return None, str(error)


def _positions(slam_map: SlamMap) -> list[tuple[float, FloatArray]]:
    return list(zip(slam_map.trajectory_stamp_s.tolist(), slam_map.trajectory[:, :3, 3], strict=True))


def _localization(recording: Recording, slam_map: SlamMap | None, settings: LocalizationSettings) -> dict[str, Any]:
    clock, orb, found = _Clock(), _OrbClock(), []
    if slam_map is not None:
        localizer = Localizer(slam_map, recording.intrinsics, settings)
        for frame in recording.frames():
            found.append(clock.run(localizer.locate, frame))
            orb.run(frame)
    times = clock.figures("localization")
    poses = [(f.stamp_s, f.world_from_camera.translation) for f in found if f.world_from_camera is not None]
    localized = [f for f in found if f.quality is LocalizationQuality.LOCALIZED]
    return {
        "localization_tracked_share": round(len(poses) / len(found), 4) if found else None,
        "localization_localized_share": round(len(localized) / len(found), 4) if found else None,
        **times,
        "localization_cv2_orb_ms": orb.median_ms,
        "localization_median_over_cv2_orb": _ratio(times["localization_ms_median"], orb.median_ms),
        "ate_localization_m": _ate(recording, poses),
    }


def _cold_relocalization(
    recording: Recording, slam_map: SlamMap | None, settings: LocalizationSettings, count: int
) -> dict[str, Any]:
    """Locate shuffled frames, each without memory, and compare with where the mapping run had them."""
    if slam_map is None:
        return {"cold_tried": 0, "cold_found": None, "cold_wrong": None, "cold_unverified": None, **_spread("cold", [])}
    localizer = Localizer(slam_map, recording.intrinsics, settings)
    mapped = dict(_positions(slam_map))
    found = wrong = unverified = 0
    clock = _Clock()
    chosen = np.random.default_rng(0).permutation(len(recording))[:count]
    for index in chosen:
        frame = recording.read(recording.entries[int(index)])
        localizer.reset()
        located = clock.run(localizer.locate, frame)
        if located.world_from_camera is None:
            continue
        found += 1
        if frame.stamp_s in mapped:
            wrong += float(np.linalg.norm(located.world_from_camera.translation - mapped[frame.stamp_s])) > WRONG_M
        else:
            unverified += 1
    return {
        "cold_tried": len(chosen),
        "cold_found": found,
        "cold_wrong": int(wrong),
        "cold_unverified": unverified,
        **_spread("cold", clock.times_ms),
    }


def _start_up(recording: Recording, slam_map: SlamMap | None, settings: LocalizationSettings) -> dict[str, Any]:
    """Save the map as a site; a process of its own starts with it."""
    if slam_map is None:
        return {"start_up": None}
    with tempfile.TemporaryDirectory() as folder:
        nothing = np.zeros((0, 3))
        site = Site(
            "1", "Benchmark", recording.intrinsics, slam_map.to_arrays(), (), nothing.astype("f4"), nothing.astype("u1")
        )
        save_site(site, Path(folder) / "site")
        return {"start_up": start_up_figures(Path(folder) / "site", recording.folder, settings)}


def _ate(recording: Recording, poses: list[tuple[float, FloatArray]]) -> float | None:
    path = recording.folder / "groundtruth.txt"
    if not path.exists() or len(poses) < 3:
        return None
    stamps_s, true_poses = read_trajectory(path)
    try:
        error = absolute_trajectory_error(
            np.array([stamp for stamp, _ in poses]),
            np.array([position for _, position in poses]),
            stamps_s,
            np.array([pose.translation for pose in true_poses]),
        )
    except InputError:
        return None
    return round(error.rmse_m, 4)


if __name__ == "__main__":
    try:
        sys.exit(main())
    except VbrError as error:
        sys.exit(str(error))

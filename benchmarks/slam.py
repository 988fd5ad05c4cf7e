"""SLAM on a recording: time per frame, accuracy, cold relocalization, start-up and memory, as JSON.

    python -m benchmarks.slam RECORDING [--features 600] [--cold 200]

Times are the thread's own CPU time, so that other load does not matter. ``cv2_orb_ms`` is
``cv2.ORB_create(1000).detectAndCompute`` on the same frames in the same run.
"""

from __future__ import annotations

import argparse
import json
import resource
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from device_agent.single_core import use_one_core
from navcore.errors import InputError, VbrError
from navcore.evaluation import absolute_trajectory_error
from navcore.geometry import FloatArray
from navcore.recording import Recording, open_recording, read_trajectory
from navcore.settings import LocalizationSettings
from navcore.slam import warm_up
from navcore.slam.features import feature_count_for, grey_of
from navcore.slam.keyframes import SlamCamera
from navcore.slam.localizer import Localizer
from navcore.slam.map_build import BF_PX_M
from navcore.slam.mapper import Mapper
from navcore.slam.slam_map import SlamMap
from navcore.types import LocalizationQuality

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
    settings = LocalizationSettings(feature_count=arguments.features)
    slam_map, figures = _mapping(recording, settings)
    figures |= _localization(recording, slam_map, settings)
    figures |= _cold_relocalization(recording, slam_map, settings, arguments.cold)
    figures |= _start_up(recording, slam_map, settings)
    figures["peak_memory_mb"] = round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)
    json.dump(figures, sys.stdout, indent=1)
    sys.stdout.write("\n")
    return 0


def _cpu_ms(work: Callable[..., Any], *arguments: Any) -> tuple[float, Any]:
    started_s = time.thread_time()
    result = work(*arguments)
    return 1e3 * (time.thread_time() - started_s), result


def _spread(name: str, times_ms: list[float]) -> dict[str, float]:
    values = np.array(times_ms)
    return {
        f"{name}_ms_median": round(float(np.median(values)), 2),
        f"{name}_ms_mean": round(float(values.mean()), 2),
        f"{name}_ms_p95": round(float(np.percentile(values, 95)), 2),
    }


def _mapping(recording: Recording, settings: LocalizationSettings) -> tuple[SlamMap, dict[str, Any]]:
    intrinsics = recording.intrinsics
    count = feature_count_for(intrinsics.width_px, intrinsics.height_px, settings.feature_count)
    mapper = Mapper(intrinsics, SlamCamera.of(intrinsics, BF_PX_M), count)
    orb = cv2.ORB_create(1000)  # type: ignore[attr-defined]
    times_ms, orb_ms, running = [], [], []
    for frame in recording.frames():
        took_ms, tracked = _cpu_ms(mapper.add, frame)
        times_ms.append(took_ms)
        orb_ms.append(_cpu_ms(orb.detectAndCompute, grey_of(frame.colour_rgb), None)[0])
        if tracked:
            running.append((frame.stamp_s, mapper.world_from_camera[:3, 3].copy()))
    finish_ms, slam_map = _cpu_ms(mapper.finish)
    final = list(zip(slam_map.trajectory_stamp_s.tolist(), slam_map.trajectory[:, :3, 3], strict=True))
    return slam_map, {
        "recording": recording.folder.name,
        "frames": len(recording),
        "features": count,
        "keyframes": slam_map.keyframe_count,
        "landmarks": len(slam_map.positions),
        "mapping_tracked_share": round(len(running) / len(recording), 4),
        **_spread("mapping", times_ms),
        "finish_s": round(finish_ms / 1e3, 2),
        "cv2_orb_ms": round(float(np.median(orb_ms)), 2),
        "mapping_median_over_cv2_orb": round(float(np.median(times_ms) / np.median(orb_ms)), 2),
        "ate_while_running_m": _ate(recording, running),
        "ate_final_m": _ate(recording, final),
    }


def _localization(recording: Recording, slam_map: SlamMap, settings: LocalizationSettings) -> dict[str, Any]:
    localizer = Localizer(slam_map, recording.intrinsics, settings)
    times_ms, found = [], []
    for frame in recording.frames():
        took_ms, located = _cpu_ms(localizer.locate, frame)
        times_ms.append(took_ms)
        found.append(located)
    poses = [(f.stamp_s, f.world_from_camera.translation) for f in found if f.world_from_camera is not None]
    return {
        "localization_tracked_share": round(len(poses) / len(found), 4),
        "localization_localized_share": round(
            sum(f.quality is LocalizationQuality.LOCALIZED for f in found) / len(found), 4
        ),
        **_spread("localization", times_ms),
        "ate_localization_m": _ate(recording, poses),
    }


def _cold_relocalization(
    recording: Recording, slam_map: SlamMap, settings: LocalizationSettings, count: int
) -> dict[str, Any]:
    """Locate shuffled frames, each without memory, and compare with where the mapping run had them."""
    localizer = Localizer(slam_map, recording.intrinsics, settings)
    mapped = dict(zip(slam_map.trajectory_stamp_s.tolist(), slam_map.trajectory[:, :3, 3], strict=True))
    tried = found = wrong = 0
    times_ms = []
    for index in np.random.default_rng(0).permutation(len(recording))[:count]:
        frame = recording.read(recording.entries[int(index)])
        localizer.reset()
        took_ms, located = _cpu_ms(localizer.locate, frame)
        times_ms.append(took_ms)
        tried += 1
        if located.world_from_camera is not None and frame.stamp_s in mapped:
            found += 1
            wrong += float(np.linalg.norm(located.world_from_camera.translation - mapped[frame.stamp_s])) > WRONG_M
    return {"cold_tried": tried, "cold_found": found, "cold_wrong": int(wrong), **_spread("cold", times_ms)}


def _start_up(recording: Recording, slam_map: SlamMap, settings: LocalizationSettings) -> dict[str, Any]:
    arrays = slam_map.to_arrays()
    took_ms, _ = _cpu_ms(lambda: Localizer(SlamMap.from_arrays(arrays), recording.intrinsics, settings))
    return {"map_ready_s": round(took_ms / 1e3, 3), "map_mb": round(sum(a.nbytes for a in arrays.values()) / 1e6, 1)}


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

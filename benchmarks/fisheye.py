"""What the fisheye camera gains: the same walks located with and without it, as JSON.

    python -m benchmarks.fisheye [--seed 0] [--cold 40] [--max-s 40]

A wide hall, most of whose walls lie beyond the depth camera's reach, is mapped by one walk; another walk goes where the
first one did not. It is located three times over: as it is, with the depth camera's range cut to 2.5 m, and with the
front view covered for 3 s out of every 10. Shares count frames; errors are distances from the truth in metres, after
the map has been laid on its own walk's truth; times are the thread's own CPU time in milliseconds.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import takewhile
from typing import Any

import numpy as np

from device_agent.simulation.building import Building, renderer_of
from device_agent.simulation.fisheye_sensor import head_fisheye
from device_agent.simulation.renderer import Renderer
from device_agent.simulation.sensors import head_camera
from device_agent.simulation.simulated_walk import simulated_walk
from device_agent.simulation.wide_hall import ACROSS, wide_hall
from device_agent.single_core import use_one_core
from navcore.evaluation import align_rigidly
from navcore.geometry import Transform
from navcore.settings import LocalizationSettings
from navcore.slam import warm_up
from navcore.slam.features import feature_count_for
from navcore.slam.keyframes import SlamCamera
from navcore.slam.localizer import Localizer
from navcore.slam.map_build import BF_PX_M
from navcore.slam.mapper import Mapper
from navcore.slam.slam_map import SlamMap
from navcore.types import Frame, Localization, LocalizationQuality

SIZE_PX = (320, 240)
SHORT_RANGE_M = 2.5
COVERED_S, PERIOD_S = 3.0, 10.0
WRONG_M = 0.5
"""A pose farther from the truth than this is wrong."""
CHI2_95 = 5.991
"""95 % of the χ² distribution with two degrees of freedom: position on the floor."""
Spoil = Callable[[Frame], Frame]
Walked = list[tuple[Frame, Transform]]


def main() -> int:
    """Run the benchmark; print its figures."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    parser.add_argument("--seed", type=int, default=0, help="of pictures, walks and noise (default: %(default)s)")
    parser.add_argument("--cold", type=int, default=40, help="frames located without memory (default: %(default)s)")
    parser.add_argument("--max-s", type=float, default=60.0, help="end the second walk after this time")
    arguments = parser.parse_args()
    use_one_core()
    warm_up()
    hall = wide_hall(seed=arguments.seed)
    renderer = renderer_of(hall)
    slam_map, mapping = _mapped(hall, renderer, arguments.seed)
    walk = _walk(hall, renderer, arguments.seed + 1, arguments.max_s)
    figures: dict[str, Any] = {"mapping": mapping, "walk_frames": len(walk)}
    for name, spoil in (("as_it_is", _as_it_is), ("short_range", _short_range), ("covered", _covered)):
        figures[name] = {
            "fisheye" if use else "depth_only": _located(slam_map, walk, spoil, use, arguments.cold)
            for use in (False, True)
        }
    json.dump(figures, sys.stdout, indent=1)
    sys.stdout.write("\n")
    return 0


def _mapped(hall: Building, renderer: Renderer, seed: int) -> tuple[SlamMap, dict[str, Any]]:
    """Map the hall with the depth camera alone; return the map in the building's frame, and its figures."""
    camera = head_camera(*SIZE_PX)
    count = feature_count_for(*SIZE_PX, LocalizationSettings().feature_count)
    mapper = Mapper(camera, SlamCamera.of(camera, BF_PX_M), count)
    truth = {}
    for frame, world_from_camera in simulated_walk(hall, None, seed, size_px=SIZE_PX, renderer=renderer):
        mapper.add(frame)
        truth[frame.stamp_s] = world_from_camera.translation
    slam_map = mapper.finish()
    true_m = np.array([truth[stamp_s] for stamp_s in slam_map.trajectory_stamp_s.tolist()])
    made_m = slam_map.trajectory[:, :3, 3]
    on_truth = align_rigidly(true_m, made_m)
    error_m = np.linalg.norm(on_truth.apply(made_m) - true_m, axis=1)
    return slam_map.transformed(np.array(on_truth.matrix)), {
        "frames": len(truth),
        "tracked": len(made_m),
        "keyframes": slam_map.keyframe_count,
        "landmarks": len(slam_map.positions),
        "ate_m": round(float(np.sqrt(np.mean(error_m**2))), 4),
    }


def _walk(hall: Building, renderer: Renderer, seed: int, max_s: float) -> Walked:
    walked = simulated_walk(hall, ACROSS, seed, size_px=SIZE_PX, renderer=renderer, fisheye=head_fisheye())
    return list(takewhile(lambda taken: taken[0].stamp_s <= max_s, walked))


def _as_it_is(frame: Frame) -> Frame:
    return frame


def _short_range(frame: Frame) -> Frame:
    """Return the frame of a depth camera that sees no farther than 2.5 m."""
    return replace(frame, depth_m=np.where(frame.depth_m > SHORT_RANGE_M, np.nan, frame.depth_m).astype(np.float32))


def _covered(frame: Frame) -> Frame:
    """Return the frame as somebody who stands before the glasses leaves it: the front view shows nothing."""
    if frame.stamp_s % PERIOD_S < PERIOD_S - COVERED_S:
        return frame
    return replace(frame, colour_rgb=np.full_like(frame.colour_rgb, 70), depth_m=np.full_like(frame.depth_m, np.nan))


@dataclass(frozen=True, slots=True)
class _Judged:
    """One located frame against the truth."""

    quality: LocalizationQuality
    error_m: float
    chi2: float
    """Squared error on the floor over its covariance."""
    sigma_m: float
    took_ms: float


def _judge(found: Localization, truth: Transform, took_ms: float) -> _Judged:
    if found.world_from_camera is None or found.covariance is None:
        return _Judged(found.quality, math.nan, math.nan, math.nan, took_ms)
    off_m = found.world_from_camera.translation - truth.translation
    floor = found.covariance[:2, :2]
    chi2 = float(off_m[:2] @ np.linalg.solve(floor, off_m[:2]))
    sigma_m = float(np.sqrt(np.linalg.eigvalsh(floor)[-1]))
    return _Judged(found.quality, float(np.linalg.norm(off_m)), chi2, sigma_m, took_ms)


def _located(slam_map: SlamMap, walk: Walked, spoil: Spoil, use_fisheye: bool, cold: int) -> dict[str, Any]:
    """Locate the walk, then some of its frames without memory; return the figures of both."""
    localizer = Localizer(slam_map, head_camera(*SIZE_PX), LocalizationSettings(use_fisheye=use_fisheye))
    following = [_timed(localizer, spoil(frame), truth) for frame, truth in walk]
    alone = []
    for index in np.random.default_rng(0).permutation(len(walk))[:cold].tolist():
        localizer.reset()
        alone.append(_timed(localizer, spoil(walk[index][0]), walk[index][1]))
    return _figures(following) | {
        "cold_found_share": _share(not math.isnan(judged.error_m) for judged in alone),
        "cold_wrong": sum(judged.error_m > WRONG_M for judged in alone),
        "cold_ms_median": round(float(np.median([judged.took_ms for judged in alone])), 1),
    }


def _timed(localizer: Localizer, frame: Frame, truth: Transform) -> _Judged:
    started_s = time.thread_time()
    found = localizer.locate(frame)
    return _judge(found, truth, 1e3 * (time.thread_time() - started_s))


def _figures(judged: Sequence[_Judged]) -> dict[str, Any]:
    sure = [j for j in judged if j.quality is LocalizationQuality.LOCALIZED]
    times_ms = [j.took_ms for j in judged]
    return {
        "localized_share": _share(j.quality is LocalizationQuality.LOCALIZED for j in judged),
        "found_share": _share(j.quality is not LocalizationQuality.LOST for j in judged),
        "localized_rmse_m": _rounded(math.sqrt(np.mean([j.error_m**2 for j in sure]))) if sure else None,
        "localized_worst_m": _rounded(max(j.error_m for j in sure)) if sure else None,
        "localized_wrong": sum(j.error_m > WRONG_M for j in sure),
        "inside_95_share": _share(j.chi2 <= CHI2_95 for j in sure),
        "sigma_median_m": _rounded(float(np.median([j.sigma_m for j in sure]))) if sure else None,
        "ms_median": round(float(np.median(times_ms)), 1),
        "ms_mean": round(float(np.mean(times_ms)), 1),
    }


def _share(answers: Any) -> float | None:
    listed = list(answers)
    return round(sum(listed) / len(listed), 3) if listed else None


def _rounded(value: float) -> float:
    return round(float(value), 4)


if __name__ == "__main__":
    sys.exit(main())

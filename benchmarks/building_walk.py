"""A walk through a whole building with people in the way: the map's accuracy, its loops, doubled walls and ghosts.

    python -m benchmarks.building_walk [RECORDING] [--picture FILE.jpg] [--people 0.15] [--seed 0]

RECORDING is a simulated recording of the office floor (``vbr sim record --people 0.15 --min-length-m 150``); without
one it is made first, in a temporary folder. The map is built as ``vbr map build`` does, laid upon the truth by its
trajectory alone, and its cloud is compared with the true surfaces of the building. Prints one JSON object; the picture
shows the slice of the cloud between 0.3 and 1.8 m from above, the true walls as thin lines, and both roads.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.walk_geometry import loops_of
from benchmarks.walls_and_ghosts import CloudCheck, checked_cloud, drawn_cloud
from device_agent.simulation.building import Building
from device_agent.simulation.office_floor import office_floor
from device_agent.simulation.passers_by import SHOWN_SHARE
from device_agent.simulation.scenario import Scenario
from device_agent.simulation.walk_recording import PEOPLE_FILE, record_walk
from device_agent.single_core import use_one_core
from navcore.errors import VbrError
from navcore.evaluation import absolute_trajectory_error, align_rigidly
from navcore.geometry import FloatArray, Transform
from navcore.recording import Recording, open_recording, read_trajectory
from navcore.settings import LocalizationSettings
from navcore.slam import warm_up
from navcore.slam.map_build import MapBuild, build_map

MIN_LENGTH_M = 150.0
BAD_M = 0.08


def main() -> int:
    """Run the benchmark; print its figures."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    parser.add_argument("source", type=Path, nargs="?", metavar="RECORDING")
    parser.add_argument("--picture", type=Path, metavar="FILE", help="where to write the top view (JPEG or PNG)")
    parser.add_argument("--people", type=float, default=0.15, help="share of frames with people, where recorded here")
    parser.add_argument("--seed", type=int, default=0, help="of the walk, where recorded here")
    parser.add_argument("--features", type=int, default=LocalizationSettings().feature_count, help="at 320×240")
    arguments = parser.parse_args()
    use_one_core()
    warm_up()
    floor = office_floor()
    if arguments.source is not None:
        figures = _figures(arguments.source, floor, arguments.features, arguments.picture)
    else:
        with tempfile.TemporaryDirectory() as folder:
            source = Path(folder) / "building_walk"
            scenario = Scenario(people_share=arguments.people)
            record_walk(source, arguments.seed, building=floor, scenario=scenario, min_length_m=MIN_LENGTH_M)
            figures = _figures(source, floor, arguments.features, arguments.picture)
    json.dump(figures, sys.stdout, indent=1)
    sys.stdout.write("\n")
    return 0


def _figures(source: Path, floor: Building, features: int, picture: Path | None) -> dict[str, Any]:
    recording = open_recording(source)
    true_stamps_s, true_poses = read_trajectory(source / "groundtruth.txt")
    truth = np.array([pose.translation for pose in true_poses])
    started_s = time.thread_time()
    build = build_map(recording, features, lambda share, text: None)
    took_s = time.thread_time() - started_s
    building_from_map = _laid_upon_truth(build, true_stamps_s, truth)
    check = checked_cloud(floor, building_from_map.apply(build.cloud.points_m.astype(np.float64)), truth[:, :2])
    estimate = build.slam_map.trajectory[:, :3, 3]
    error = absolute_trajectory_error(build.slam_map.trajectory_stamp_s, estimate, true_stamps_s, truth)
    if picture is not None:
        drawn_cloud(
            floor, check, build.cloud.colours_rgb, truth[:, :2], building_from_map.apply(estimate)[:, :2], picture
        )
    loops = loops_of(truth[:, :2])
    return {
        "recording": source.name,
        "frames": len(recording),
        "length_m": round(float(np.hypot(*np.diff(truth[:, :2], axis=0).T).sum()), 1),
        "route_returns": loops.returns,
        "route_independent_loops": loops.independent,
        "loops_closed": build.level_map.loop_count,
        "people_frame_share": _people_share(recording),
        "tracked_share": round(build.tracked_share, 4),
        "keyframes": build.slam_map.keyframe_count,
        "ate_rmse_m": round(error.rmse_m, 4),
        "ate_max_m": round(error.max_m, 4),
        "worst_s": _worst_stamps_s(build, building_from_map, true_stamps_s, truth),
        **_cloud_figures(check),
        "map_build_cpu_s": round(took_s, 1),
        "map_build_ms_per_frame": round(1e3 * took_s / len(recording), 2),
    }


def _laid_upon_truth(build: MapBuild, true_stamps_s: FloatArray, truth_m: FloatArray) -> Transform:
    """Return ``building_from_map`` by the trajectory alone: the cloud has no say in where it lies."""
    stamps_s = build.slam_map.trajectory_stamp_s
    there = np.stack([np.interp(stamps_s, true_stamps_s, truth_m[:, axis]) for axis in range(3)], axis=1)
    return align_rigidly(there, build.slam_map.trajectory[:, :3, 3])


def _worst_stamps_s(
    build: MapBuild, building_from_map: Transform, true_stamps_s: FloatArray, truth_m: FloatArray
) -> list[list[float]]:
    """Return the stretches whose position is off by more than ``BAD_M``: from, to (stamps), and the largest error."""
    stamps_s = build.slam_map.trajectory_stamp_s
    there = np.stack([np.interp(stamps_s, true_stamps_s, truth_m[:, axis]) for axis in range(3)], axis=1)
    error = np.linalg.norm(building_from_map.apply(build.slam_map.trajectory[:, :3, 3]) - there, axis=1)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], (error > BAD_M).astype(np.int8), [0]])))
    return [
        [round(float(stamps_s[begin]), 1), round(float(stamps_s[end - 1]), 1), round(float(error[begin:end].max()), 3)]
        for begin, end in edges.reshape(-1, 2).tolist()
    ]


def _people_share(recording: Recording) -> float | None:
    """Return the share of frames that show people, as it was measured when they were drawn; None where nobody did."""
    path = recording.folder / PEOPLE_FILE
    if not path.exists():
        return None
    return round(float(np.mean(np.loadtxt(path, ndmin=2)[:, 1] >= SHOWN_SHARE)), 4)


def _cloud_figures(check: CloudCheck) -> dict[str, Any]:
    return {
        "cloud_points": len(check.is_slice),
        "wall_points": int(np.count_nonzero(check.is_wall)),
        "wall_median_error_m": round(check.wall_median_m, 4),
        "wall_share_within_5cm": round(check.wall_share_within(0.05), 4),
        "wall_share_5_to_30cm": round(1.0 - check.wall_share_within(0.05), 4),
        "wall_stretches": check.stretch_count,
        "wall_stretches_doubled": check.doubled_count,
        "ghost_points": int(np.count_nonzero(check.is_ghost)),
        "ghost_share_along_road": round(check.ghost_share, 5),
        "ghost_volume_l": round(check.ghost_volume_m3 * 1e3, 2),
        "ghost_clusters": [[round(float(value), 2) for value in row] for row in check.ghost_clusters],
    }


if __name__ == "__main__":
    try:
        sys.exit(main())
    except VbrError as error:
        sys.exit(f"building_walk: {error}")

"""``vbr map build``: from a recording to a site. ``vbr localize``: where a recording's camera was in a site."""

from __future__ import annotations

import argparse
import json
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from device_agent import map_exchange_commands, map_growth_commands
from device_agent.map_exchange_commands import refuse_unwritable
from navcore.errors import InputError

if TYPE_CHECKING:
    from navcore.geometry import FloatArray, Transform
    from navcore.recording import Recording
    from navcore.types import Localization

    StampedPoses = tuple[FloatArray, list[Transform]]

WARN_TRACKED_SHARE = 0.8
"""A map of which less was followed has gaps that people should know of."""


def add_commands(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add ``vbr map`` with its actions, and ``vbr localize``."""
    maps = subparsers.add_parser("map", help="make a map of a building")
    actions = maps.add_subparsers(metavar="ACTION", required=True)
    build = actions.add_parser("build", help="build a site from a recorded walk")
    build.add_argument("source", type=Path, metavar="SOURCE", help="recording (a folder in the TUM RGB-D layout)")
    build.add_argument("--site", type=Path, required=True, metavar="DIR", help="folder for the site")
    build.add_argument("--name", help="name of the site (default: that of the folder)")
    build.add_argument("--date", default="", help="when it was recorded, in whatever form")
    build.add_argument("--json", action="store_true", help="print the figures as JSON")
    build.add_argument(
        "--behind", action="store_true", help="give way to every other process, and print progress as lines of JSON"
    )
    _add_settings(build)
    build.set_defaults(run=_build)
    map_growth_commands.add_actions(actions)
    map_exchange_commands.add_actions(actions)
    localize = subparsers.add_parser("localize", help="find the camera of a recording in a site")
    localize.add_argument("source", type=Path, metavar="SOURCE", help="recording (a folder in the TUM RGB-D layout)")
    localize.add_argument("--site", type=Path, required=True, metavar="DIR", help="folder of the site")
    localize.add_argument("--trajectory", type=Path, metavar="OUT", help="write the poses here (TUM format)")
    localize.add_argument("--json", action="store_true", help="print the figures as JSON")
    _add_settings(localize)
    localize.set_defaults(run=_localize)


def _add_settings(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--set", action="append", default=[], metavar="NAME=VALUE", help="change a setting (see `vbr settings`)"
    )


# -------------------------------------------------------------------------------------------------- map build
def _build(arguments: argparse.Namespace) -> int:
    from device_agent.progress import end_with_reader, stage_bar, stage_lines
    from device_agent.single_core import give_way, use_one_core
    from navcore.recording import open_recording
    from navcore.settings import Settings, parse_assignment
    from navcore.site import prepare_site_folder, save_site
    from navcore.site_building import build_site, default_name

    use_one_core()
    if arguments.behind:
        give_way()
        end_with_reader()
    settings = Settings().changed(dict(parse_assignment(text) for text in arguments.set))
    recording = open_recording(arguments.source)
    true_trajectory = _true_trajectory(recording)
    prepare_site_folder(arguments.site)
    name = arguments.name or default_name(arguments.site)
    started_s = time.process_time()
    with ThreadPoolExecutor(1) as executor, (stage_lines if arguments.behind else stage_bar)() as progress:
        site, built = build_site(recording, name, settings.localization, progress, arguments.date, executor=executor)
    took_s = time.process_time() - started_s
    save_site(site, arguments.site)
    answer: dict[str, Any] = {**site.report, "ms_per_frame": round(1e3 * took_s / len(recording), 2)}
    truth = _trajectory_error(
        true_trajectory, list(zip(built.slam_map.trajectory_stamp_s, built.slam_map.trajectory, strict=True))
    )
    _print(arguments.json, answer | truth, _BUILD_WORDS)
    if built.tracked_share < WARN_TRACKED_SHARE:
        sys.stderr.write(
            f"vbr: Only {built.tracked_share:.0%} of the frames could be followed, so the map has gaps: record again,"
            " more slowly, and look at things with texture.\n"
        )
    if not arguments.json:
        sys.stdout.write(f"The site is in {arguments.site}. Next: vbr console --site {arguments.site}\n")
    return 0


# --------------------------------------------------------------------------------------------------- localize
def _localize(arguments: argparse.Namespace) -> int:
    from device_agent.progress import stage_bar
    from device_agent.single_core import use_one_core
    from navcore.recording import open_recording, write_trajectory
    from navcore.settings import Settings, parse_assignment
    from navcore.site import load_site
    from navcore.slam.localizer import Localizer
    from navcore.slam.slam_map import SlamMap

    use_one_core()
    settings = Settings().changed(dict(parse_assignment(text) for text in arguments.set))
    recording = open_recording(arguments.source)
    true_trajectory = _true_trajectory(recording)
    if arguments.trajectory is not None:
        refuse_unwritable(arguments.trajectory)
    site = load_site(arguments.site)
    slam_map = SlamMap.from_arrays(site.map_arrays)
    localizer = Localizer(slam_map, recording.intrinsics, settings.localization)
    located: list[Localization] = []
    took_s: list[float] = []
    with stage_bar() as progress:
        for number, frame in enumerate(recording.frames()):
            started_s = time.thread_time()
            located.append(localizer.locate(frame))
            took_s.append(time.thread_time() - started_s)
            progress((number + 1) / len(recording), "Localizing")
    poses = [(found.stamp_s, found.world_from_camera) for found in located if found.world_from_camera is not None]
    if arguments.trajectory is not None:
        write_trajectory(arguments.trajectory, poses, "map from camera")
    matrices = [(stamp_s, pose.matrix) for stamp_s, pose in poses]
    answer = _localization_figures(located, took_s) | _trajectory_error(true_trajectory, matrices)
    _print(arguments.json, answer, _FOUND_WORDS)
    return 0


def _localization_figures(located: list[Localization], took_s: list[float]) -> dict[str, Any]:
    import numpy as np

    from navcore.types import LocalizationQuality

    shares = {
        f"{quality.value}_share": round(sum(found.quality is quality for found in located) / len(located), 4)
        for quality in LocalizationQuality
    }
    ms = 1e3 * np.array(took_s)
    return {
        "frames": len(located),
        "tracked_share": round(1.0 - shares["lost_share"], 4),
        **shares,
        "ms_per_frame_median": round(float(np.median(ms)), 2),
        "ms_per_frame_mean": round(float(np.mean(ms)), 2),
        "ms_per_frame_p95": round(float(np.percentile(ms, 95)), 2),
    }


def _true_trajectory(recording: Recording) -> StampedPoses | None:
    from navcore.recording import read_trajectory

    path = recording.folder / "groundtruth.txt"
    return read_trajectory(path) if path.exists() else None


def _trajectory_error(truth: StampedPoses | None, poses: list[tuple[float, Any]]) -> dict[str, Any]:
    import numpy as np

    from navcore.evaluation import absolute_trajectory_error

    if truth is None:
        return {}
    true_stamps_s, true_poses = truth
    try:
        error = absolute_trajectory_error(
            np.array([stamp_s for stamp_s, _ in poses]),
            np.array([matrix[:3, 3] for _, matrix in poses]).reshape(-1, 3),
            true_stamps_s,
            _positions(true_poses),
        )
    except InputError:
        # A truth that does not fit says nothing about what was found; the answer says that there is no figure.
        return {"ate_rmse_m": None}
    return {f"ate_{name}": round(value, 5) for name, value in asdict(error).items()}


def _positions(poses: list[Transform]) -> Any:
    import numpy as np

    return np.array([pose.translation for pose in poses]).reshape(-1, 3)


# ---------------------------------------------------------------------------------------------------- answers
_BUILD_WORDS = {
    "frames": "frames",
    "tracked_share": "share of them tracked",
    "keyframes": "key frames",
    "landmarks": "landmarks",
    "loops_closed": "loops closed",
    "road_m": "road, m",
    "cloud_points": "points of the cloud",
    "leveling": "levelling",
    "places": "places with names",
    "places_lost": "places that were marked where the way was not known",
    "weak_m": "of the walk not seen well, m",
    "ms_per_frame": "computing time per frame, ms",
    "ate_rmse_m": "error against the ground truth (ATE RMSE), m",
    "ate_max_m": "largest error, m",
}
_FOUND_WORDS = {
    "frames": "frames",
    "tracked_share": "share of them tracked",
    "localized_share": "share localized",
    "uncertain_share": "share uncertain",
    "lost_share": "share lost",
    "ms_per_frame_median": "computing time per frame, median, ms",
    "ms_per_frame_p95": "computing time per frame, 95th percentile, ms",
    "ate_rmse_m": "error against the ground truth (ATE RMSE), m",
    "ate_max_m": "largest error, m",
}


def _print(as_json: bool, answer: dict[str, Any], words: dict[str, str]) -> None:
    if as_json:
        json.dump(answer, sys.stdout, indent=1)
        sys.stdout.write("\n")
        return
    for name, text in words.items():
        if answer.get(name, "") != "":
            sys.stdout.write(f"{text + ':':<50} {answer[name]}\n")

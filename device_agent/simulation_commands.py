"""``vbr sim record``: the simulated sighted person's walk, as a recording from which a map can be built."""

from __future__ import annotations

import argparse
import math
from pathlib import Path

from device_agent.simulation_options import add_simulation_options, positive_number
from navcore.errors import InputError


def add_commands(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add ``vbr sim``."""
    simulation = subparsers.add_parser("sim", help="work with the simulated building")
    actions = simulation.add_subparsers(metavar="ACTION", required=True)
    record = actions.add_parser("record", help="record the simulated sighted person's walk")
    record.add_argument("folder", type=Path, metavar="FOLDER", help="new folder for the recording")
    add_simulation_options(record, seed=0)
    record.add_argument(
        "--max-length-m", type=positive_number, default=math.inf, help="end the walk after this distance"
    )
    record.add_argument("--fisheye", action="store_true", help="record a fisheye camera on the glasses as well")
    record.set_defaults(run=_record)


def _record(arguments: argparse.Namespace) -> int:
    from device_agent.progress import progress_bar
    from device_agent.simulation.fisheye_sensor import head_fisheye
    from device_agent.simulation.walk import record_walk

    folder: Path = arguments.folder
    if folder.exists() and any(folder.iterdir()):
        raise InputError(f"{folder} is not empty: name a new folder for the recording.")
    fisheye = head_fisheye() if arguments.fisheye else None
    with progress_bar("Walking through the simulated building") as report:
        count = record_walk(
            folder, arguments.seed, arguments.size, arguments.rate_hz, report, arguments.max_length_m, fisheye=fisheye
        )  # fmt: skip
    print(f"{count} frames in {folder}. Next: vbr map build {folder} --site SITE")  # noqa: T201 - the command's answer
    return 0

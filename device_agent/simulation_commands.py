"""``vbr sim record``: the simulated sighted person's walk, as a recording from which a map can be built."""

from __future__ import annotations

import argparse
import math
from pathlib import Path

from device_agent.scenario_options import add_scenario_options, scenario_from
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
        "--floor", default="office", metavar="NAME", help="office (default), wide-hall or blank-corridor"
    )
    record.add_argument(
        "--max-length-m", type=positive_number, default=math.inf, help="end the walk after this distance"
    )
    record.add_argument(
        "--min-length-m", type=positive_number, default=0.0, help="walk on round the building up to this distance"
    )
    add_scenario_options(record)
    record.add_argument("--fisheye", action="store_true", help="record a fisheye camera on the glasses as well")
    record.set_defaults(run=_record)


def _record(arguments: argparse.Namespace) -> int:
    from device_agent.progress import progress_bar
    from device_agent.simulation.fisheye_sensor import head_fisheye
    from device_agent.simulation.floors import floor_named
    from device_agent.simulation.walk_recording import record_walk

    folder: Path = arguments.folder
    if folder.exists() and any(folder.iterdir()):
        raise InputError(f"{folder} is not empty: name a new folder for the recording.")
    fisheye = head_fisheye() if arguments.fisheye else None
    scenario, floor = scenario_from(arguments), floor_named(arguments.floor)
    with progress_bar("Walking through the simulated building") as report:
        record = record_walk(
            folder,
            arguments.seed,
            arguments.size,
            arguments.rate_hz,
            report,
            arguments.max_length_m,
            floor,
            fisheye=fisheye,
            scenario=scenario,
            min_length_m=arguments.min_length_m,
        )
    seen = f", people in {100 * record.people_frame_share:.1f} % of them" if scenario.people_share > 0.0 else ""
    print(  # noqa: T201 - the command's answer
        f"{record.frame_count} frames on {record.length_m:.0f} m in {folder}{seen}."
        f" Next: vbr map build {folder} --site SITE"
    )
    return 0

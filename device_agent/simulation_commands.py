"""``vbr sim record``: the simulated sighted person's walk, as a recording from which a map can be built."""

from __future__ import annotations

import argparse
import re
from pathlib import Path

from navcore.errors import InputError


def add_commands(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add ``vbr sim``."""
    simulation = subparsers.add_parser("sim", help="work with the simulated building")
    actions = simulation.add_subparsers(metavar="ACTION", required=True)
    record = actions.add_parser("record", help="record the simulated sighted person's walk")
    record.add_argument("folder", type=Path, metavar="FOLDER", help="new folder for the recording")
    record.add_argument("--seed", type=int, default=0, help="of noise and gait (default: %(default)s)")
    record.add_argument("--size", type=picture_size, default=(320, 240), metavar="WxH", help="320x240 or 640x480")
    record.add_argument("--rate-hz", type=float, default=10.0, help="frames per second (default: %(default)g)")
    record.add_argument("--max-length-m", type=float, default=float("inf"), help="end the walk after this distance")
    record.set_defaults(run=_record)


def picture_size(text: str) -> tuple[int, int]:
    """Read ``320x240``. Raises argparse.ArgumentTypeError."""
    match = re.fullmatch(r"(\d{2,4})[x×](\d{2,4})", text)
    if match is None:
        raise argparse.ArgumentTypeError(f"{text!r} is no picture size: write 320x240 or 640x480")
    return int(match[1]), int(match[2])


def _record(arguments: argparse.Namespace) -> int:
    from device_agent.progress import progress_bar
    from device_agent.simulation.walk import record_walk

    folder: Path = arguments.folder
    if folder.exists() and any(folder.iterdir()):
        raise InputError(f"{folder} is not empty: name a new folder for the recording.")
    with progress_bar("Walking through the simulated building") as report:
        count = record_walk(
            folder, arguments.seed, arguments.size, arguments.rate_hz, report, arguments.max_length_m
        )  # fmt: skip
    print(f"{count} frames in {folder}. Next: vbr map build {folder} --site SITE")  # noqa: T201 - the command's answer
    return 0

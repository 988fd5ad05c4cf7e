"""The options that make a simulated walk hard, checked before anything is begun."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from device_agent.simulation_options import number

if TYPE_CHECKING:
    from device_agent.simulation.scenario import Scenario


def add_scenario_options(parser: argparse._ActionsContainer) -> None:
    """Add ``--people``, ``--changed-furniture``, ``--dark``, ``--cover`` and ``--kidnapped``."""
    parser.add_argument(
        "--people", type=share, default=0.0, metavar="SHARE", help="share of frames that show walking people, as 0.15"
    )
    parser.add_argument(
        "--changed-furniture",
        type=share,
        default=0.0,
        metavar="SHARE",
        help="share of the furniture that has been moved, taken away or replaced",
    )
    parser.add_argument(
        "--dark", type=number_pair, metavar="FROM:TO", help="lights off from and to these metres of the walk, as 20:35"
    )
    parser.add_argument(
        "--cover", type=number_pair, metavar="AT:FOR", help="cover the camera at this second for so many, as 10:3"
    )
    parser.add_argument(
        "--kidnapped", action="store_true", help="begin elsewhere on the floor, beside the road, facing anywhere"
    )


def scenario_from(arguments: argparse.Namespace) -> Scenario:
    """Return the scenario that was asked for. Raises InputError for one that makes no sense."""
    from device_agent.simulation.scenario import Scenario

    return Scenario(
        arguments.people, arguments.changed_furniture, arguments.dark, arguments.cover, arguments.kidnapped
    )  # fmt: skip


def share(text: str) -> float:
    """Read a share. Raises argparse.ArgumentTypeError."""
    value = number(text)
    if not 0.0 <= value <= 1.0:
        raise argparse.ArgumentTypeError(f"{text!r} is no share: give a number from 0 to 1")
    return value


def number_pair(text: str) -> tuple[float, float]:
    """Read ``20:35``. Raises argparse.ArgumentTypeError."""
    parts = text.split(":")
    if len(parts) != 2:
        raise argparse.ArgumentTypeError(f"{text!r} is no pair of numbers: write it as 20:35")
    return number(parts[0]), number(parts[1])

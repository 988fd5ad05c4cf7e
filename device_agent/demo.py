"""``vbr demo``: the whole product in a simulated building, from one command.

The first start records the simulated sighted person's walk and builds the map from it; both are kept. Then the console
and the device run as two processes that share nothing but the link, and the keys of the terminal are the walker's
buttons; with ``--no-console`` the device runs alone. Or, with ``--headless``, the walker walks without a browser, in
lock step with the simulation, and the figures are printed.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from device_agent.recording.options import add_recording_options, recording_flags, recording_options
from device_agent.scenario_options import add_scenario_options, scenario_from
from device_agent.simulation_options import add_simulation_options, positive_number

EXIT_NOT_ARRIVED = 1


def add_commands(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add ``vbr demo``."""
    parser = subparsers.add_parser("demo", help="simulated building, device and console in one")
    parser.add_argument(
        "--data",
        type=Path,
        default=Path(".vbr/demo"),
        metavar="DIR",
        help="where the map is kept (default: %(default)s)",
    )
    parser.add_argument("--fresh", action="store_true", help="record and map the building again")
    add_simulation_options(parser, seed=1)
    parser.add_argument("--from", dest="start", default="Hall", metavar="PLACE", help="where the walker stands")
    parser.add_argument("--port", type=int, default=8765, help="of the console; 0 takes any free one")
    parser.add_argument("--no-console", action="store_true", help="the device alone, with the keyboard for buttons")
    add_recording_options(parser.add_argument_group("recording"))
    headless = parser.add_argument_group("without a browser")
    headless.add_argument("--headless", action="store_true", help="walk without a browser, and print the figures")
    headless.add_argument("--to", default="Wash room", metavar="PLACE", help="destination (default: %(default)s)")
    headless.add_argument("--json", action="store_true", help="print the figures as JSON")
    headless.add_argument("--set", action="append", default=[], metavar="NAME=VALUE", help="change a setting")
    headless.add_argument(
        "--max-s", type=positive_number, default=300.0, help="give up after this time of the simulation"
    )
    headless.add_argument("--wav", type=Path, metavar="FILE", help="write what the walker hears as a stereo WAV file")
    headless.add_argument(
        "--overlay", type=Path, metavar="DIR", help="write what both eyes see on the glasses as PNG pictures"
    )
    add_scenario_options(headless)
    parser.set_defaults(run=_run)


def _run(arguments: argparse.Namespace) -> int:
    from device_agent.demo_site import prepare_demo_site
    from device_agent.simulation.office_floor import office_floor
    from navcore.settings import Settings, parse_assignment

    # Before the first start's minutes of mapping.
    if not arguments.headless and not arguments.no_console and arguments.record is None:
        # Nobody's walk is anybody's secret in a simulation, and the console has something to show.
        arguments.record, arguments.share_walks = arguments.data / "walks", True
    record = recording_options(arguments)
    office_floor().place(arguments.start)
    scenario_from(arguments)
    Settings().changed(dict(parse_assignment(text) for text in arguments.set))
    site = prepare_demo_site(arguments.data, arguments.size, arguments.rate_hz, fresh=arguments.fresh)
    if arguments.headless:
        return _walk(arguments, site)
    from device_agent.demo_processes import run_device_alone, run_live_demo

    simulation = [
        "--simulated", "--seed", str(arguments.seed), "--start", arguments.start,
        "--size", f"{arguments.size[0]}x{arguments.size[1]}", "--rate-hz", f"{arguments.rate_hz:g}",
        *recording_flags(record),
    ]  # fmt: skip
    if arguments.no_console:
        return run_device_alone(arguments.data, site, simulation)
    return run_live_demo(arguments.data, site, arguments.port, simulation)


def _walk(arguments: argparse.Namespace, site: Path) -> int:
    from device_agent.demo_walk import walk_figures

    figures = walk_figures(arguments, site)
    if arguments.json:
        sys.stdout.write(json.dumps(figures) + "\n")
    else:
        for name, value in figures.items():
            sys.stdout.write(f"{name:>24}  {value}\n")
    return 0 if figures["arrived"] and not figures["contacts"] else EXIT_NOT_ARRIVED

"""``vbr doctor``: look at every part of the device, and say what to do."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from device_agent.device_command import (
    add_device_options,
    checked_console_url,
    device_options,
    read_ca_file,
    read_token,
)

if TYPE_CHECKING:
    from device_agent.doctor.checks import Patient
    from device_agent.doctor.findings import Checked


def add_commands(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add ``vbr doctor``."""
    parser = subparsers.add_parser(
        "doctor",
        help="look at every part of the device, and say what to do",
        description="Look at sensors, calibration, map, disk, clock, sound, console and machine. Name the hardware"
        " as for `vbr device`, and stop that first: a camera serves one program at a time. Exit code 1: one failed.",
    )
    parser.add_argument("--site", type=Path, metavar="DIR", help="the map to walk in")
    add_device_options(parser)
    parser.add_argument("--json", action="store_true", help="print the findings as JSON")
    parser.add_argument("--markdown", action="store_true", help="print the page of the docs instead")
    parser.set_defaults(run=_run, to=None, without_map=False)


def _run(arguments: argparse.Namespace) -> int:
    from device_agent.doctor.checks import checks_of
    from device_agent.doctor.findings import exit_code, made

    checks = checks_of(_patient(arguments))
    if arguments.markdown:
        from device_agent.doctor.page import doctor_markdown

        sys.stdout.write(doctor_markdown(checks))
        return 0
    checked = []
    for each in made(checks):
        checked.append(each)
        if not arguments.json:
            sys.stdout.write(_lines(each))
            sys.stdout.flush()
    if arguments.json:
        json.dump([_entry(each) for each in checked], sys.stdout, indent=1, ensure_ascii=False)
        sys.stdout.write("\n")
    return exit_code(checked)


def _patient(arguments: argparse.Namespace) -> Patient:
    from device_agent.doctor.checks import Link, Patient

    url, token_file, ca_file = arguments.console, arguments.token_file, arguments.ca_file
    # What is wrong with the console's address or token is a finding, and stops no other check.
    arguments.console = arguments.ca_file = None
    options = device_options(arguments)
    link = Link(
        lambda: None if url is None else checked_console_url(url),
        lambda: read_token(token_file),
        lambda: read_ca_file(ca_file),
    )
    has_camera = arguments.simulated or arguments.recording is not None or arguments.camera is not None
    return Patient(options, arguments.site, has_camera, link)


def _lines(checked: Checked) -> str:
    finding = checked.finding
    what_to_do = f"{'':<22}→ {finding.advice}\n" if finding.advice else ""
    return f"{finding.status.value:<8} {checked.name:<12} {finding.found}\n{what_to_do}"


def _entry(checked: Checked) -> dict[str, object]:
    finding = checked.finding
    return {
        "check": checked.name,
        "status": finding.status.value,
        "found": finding.found,
        "advice": finding.advice,
        "took_s": round(checked.took_s, 3),
    }

"""``vbr logs``: what the device has logged, for people."""

from __future__ import annotations

import argparse
import sys
from collections import deque
from collections.abc import Iterator
from pathlib import Path

from device_agent.state_folder import add_state_options, state_folder_of
from navcore.errors import InputError


def add_commands(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add ``vbr logs``."""
    parser = subparsers.add_parser("logs", help="show what the device has logged")
    add_state_options(parser)
    parser.add_argument("--lines", type=int, default=100, metavar="N", help="the last N lines (default: %(default)s)")
    parser.add_argument("--json", action="store_true", help="the lines as they are: JSON, for other programs")
    parser.set_defaults(run=_show)


def _show(arguments: argparse.Namespace) -> int:
    from device_agent.logs import FILE_NAME, RotatedLines, readable_line

    if arguments.lines < 1:
        raise InputError(f"{arguments.lines} lines cannot be shown: give a number greater than 0.")
    paths = RotatedLines(state_folder_of(arguments) / "logs" / FILE_NAME).paths()
    if not paths:
        raise InputError(
            f"There is no log in {state_folder_of(arguments) / 'logs'}: run `vbr device`, or name --state."
        )
    for line in deque(_lines(paths), maxlen=arguments.lines):
        sys.stdout.write((line if arguments.json else readable_line(line)) + "\n")
    return 0


def _lines(paths: list[Path]) -> Iterator[str]:
    for path in paths:
        try:
            with path.open(encoding="utf-8", errors="backslashreplace") as file:
                yield from (line.rstrip("\n") for line in file)
        except FileNotFoundError:
            # It was rotated away meanwhile.
            continue
        except OSError as error:
            raise InputError(f"{path} cannot be read ({error.strerror}): log in as the device's user.") from error

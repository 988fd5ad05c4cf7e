"""Eight hours of walking and monitoring, as fast as the machine allows: does anything grow, does anything get slower?

    python -m benchmarks.long_run [--hours 8] [--only device console viewer] [--size 160x120] [--rate-hz 10] [--seed 0]
        [--longest-min MINUTES]

Two cores cannot do all of it at once in good time, so it is in three parts, each for all the hours:

- ``device``: the real agent in lock step, its clock as fast as the machine can: obstacles, guidance, planning, voice,
  watchdog, recorder whose files turn over and go, journal, log, espeak. Frames of a rendered walk (``--size``, at
  ``--rate-hz``) come again and again; true poses stand in for localization, of which ``loop --minutes`` tells. Its link
  dials a real console in real time: every event and every recorded walk goes there, and of the states the newest, at 20
  a second of *real* time.
- ``console``: ``vbr console`` is sent every message of the hours at the rates of the table (20 states a second, depth
  images, an event every two seconds), in bursts of half a minute over links of their own, as fast as it takes them.
  Pages Console, Overview and Alerts stay open. Every ten minutes somebody edits, takes back or publishes, speaks,
  changes settings, keeps an incident, and new pages and windows come and go; once an hour the device falls silent while
  it leads somebody, until there is an alert, and what is too old is deleted.
- ``viewer``: the scene looks at model and hub 20 times for each second of the hours, each time at a new state, with a
  window that stays. At last it tells how long a newcomer would wait after days, had the live scene been shared.

Everything is read each ten simulated minutes. Prints Markdown: the medians of the first hour after the warm-up hour and
of the last one, their ratio, and the slope after the warm-up (Theil–Sen, with 95 %). Times are those of a machine that
other work may share: look at the ratios. A part that takes longer than ``--longest-min`` of real time ends there, and
tells how far it came.
"""

from __future__ import annotations

import argparse
import math
import multiprocessing
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

from benchmarks import long_run_console
from benchmarks.growth import table
from benchmarks.long_run_console import Plan, Readings

PARTS = ("device", "console", "viewer")


def main() -> None:
    """Run it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--hours", type=float, default=8.0, help="simulated")
    parser.add_argument("--only", nargs="+", choices=PARTS, default=list(PARTS))
    parser.add_argument("--size", default="160x120", help="of the device's pictures")
    parser.add_argument("--rate-hz", type=float, default=10.0, help="of the device's camera")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--longest-min", type=float, default=math.inf, help="real minutes of each part")
    arguments = parser.parse_args()
    for name in arguments.only:
        with tempfile.TemporaryDirectory() as folder:
            began_s = time.monotonic()
            print(f"== {name}, {arguments.hours:g} simulated hours", flush=True)
            (hours, readings), more = _measured(name, arguments, Path(folder))
            print("\n".join(["", *table(hours, readings), "", *more]))
            print(f"{name}: {hours[-1]:.1f} simulated hours took {time.monotonic() - began_s:.0f} s", flush=True)


def _measured(name: str, arguments: argparse.Namespace, folder: Path) -> tuple[Readings, list[str]]:
    plan = Plan(arguments.hours, time.monotonic() + 60.0 * arguments.longest_min)
    if name == "device":
        how = arguments.size, arguments.rate_hz, arguments.seed
        return long_run_console.device(plan, *how, folder), []
    if name == "viewer":
        return long_run_console.viewer(plan, folder)
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as devices:
        return long_run_console.console(plan, folder, devices)


if __name__ == "__main__":
    main()

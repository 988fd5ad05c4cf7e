"""``vbr settings``, ``vbr cues``, ``vbr link``, ``vbr states`` and ``vbr warm-up``."""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import asdict


def add_commands(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add ``vbr settings``, ``vbr cues``, ``vbr link``, ``vbr states`` and ``vbr warm-up``."""
    settings = subparsers.add_parser("settings", help="list every setting: value, unit, range, meaning, source")
    settings.add_argument("--json", action="store_true", help="as JSON")
    settings.add_argument("--markdown", action="store_true", help="as the page of the docs")
    settings.set_defaults(run=_list_settings)
    cues = subparsers.add_parser("cues", help="list everything that the walker can hear and see")
    cues.add_argument("--markdown", action="store_true", help="as the page of the docs")
    cues.set_defaults(run=_list_cues)
    link = subparsers.add_parser("link", help="list every message between device and console, and how it is sent")
    link.add_argument("--markdown", action="store_true", help="as the page of the docs")
    link.set_defaults(run=_list_messages)
    states = subparsers.add_parser("states", help="list the states of the device, and what the buttons mean in each")
    states.add_argument("--markdown", action="store_true", help="as the page of the docs")
    states.set_defaults(run=_list_states)
    warm = subparsers.add_parser("warm-up", help="compile everything now, so that nobody waits for it while walking")
    warm.set_defaults(run=_warm_up)


def _list_settings(arguments: argparse.Namespace) -> int:
    from navcore.settings import setting_specs

    if arguments.markdown:
        from navcore.settings_page import settings_markdown

        sys.stdout.write(settings_markdown())
    elif arguments.json:
        json.dump([{"key": spec.key, **asdict(spec)} for spec in setting_specs()], sys.stdout, indent=1)
        sys.stdout.write("\n")
    else:
        _print_table()
    return 0


def _list_cues(arguments: argparse.Namespace) -> int:
    if arguments.markdown:
        from navcore.cues.page import cues_markdown

        sys.stdout.write(cues_markdown())
    else:
        _print_cues()
    return 0


def _print_cues() -> None:
    from rich.console import Console
    from rich.table import Table

    from navcore.cues.table import CUE_TABLE

    table = Table("cue", "priority", "from", "what it means", "sound", "on the overlay", title="highest priority first")
    for kind, entry in sorted(CUE_TABLE.items(), key=lambda item: -item[1].priority):
        priority = entry.priority.name.lower().replace("_", " ")
        table.add_row(kind.value, priority, entry.verbosity, entry.meaning, entry.sound, entry.picture)
    Console(width=None if sys.stdout.isatty() else 160).print(table)


def _list_messages(arguments: argparse.Namespace) -> int:
    if arguments.markdown:
        from navcore.wire_page import link_markdown

        sys.stdout.write(link_markdown())
    else:
        _print_messages()
    return 0


def _print_messages() -> None:
    from rich.console import Console
    from rich.table import Table

    from navcore.wire import MESSAGES

    table = Table("message", "goes", "sent", "priority", "on a slow link", "at most", "says")
    for row in MESSAGES.values():
        rate = f", ≤ {row.rate_hz:g} Hz" if row.rate_hz is not None else ""
        table.add_row(
            row.name, row.direction.value, row.when + rate, str(row.priority), row.delivery.name.lower(),
            f"{row.max_bytes >> 10} KiB", row.meaning,
        )  # fmt: skip
    Console(width=None if sys.stdout.isatty() else 160).print(table)


def _list_states(arguments: argparse.Namespace) -> int:
    if arguments.markdown:
        from device_agent.states_page import states_markdown

        sys.stdout.write(states_markdown())
    else:
        _print_states()
    return 0


def _print_states() -> None:
    from rich.console import Console
    from rich.table import Table

    from device_agent.states import STATES
    from navcore.modes import Mode

    table = Table("state", "at the console", "what it means", "may be told", "what leads out of it")
    for mode in Mode:
        told = ", ".join(sorted(action.value for action in STATES[mode].allows))
        out = [f"{event.value} → {answer.to.value}" for event, answer in STATES[mode].answers.items() if answer.to]
        table.add_row(mode.value, mode.label, mode.sentence, told, "; ".join(out))
    Console(width=None if sys.stdout.isatty() else 160).print(table)


def _print_table() -> None:
    from rich.console import Console
    from rich.table import Table

    from navcore.settings import setting_specs

    table = Table("setting", "default", "range", "source", "meaning", title="--set NAME=VALUE changes one")
    group = ""
    for spec in setting_specs():
        if spec.group != group:
            group = spec.group
            table.add_section()
        default = f"{spec.default} {spec.unit}".strip()
        allowed = ", ".join(spec.choices) or (
            f"{spec.low:g} – {spec.high:g}" if spec.low is not None else "true, false"
        )
        mark = " [red]safety[/red]" if spec.safety else ""
        table.add_row(spec.key + mark, default, allowed, spec.source, spec.meaning)
    # Piped into a file or a pager, nothing is cut off.
    Console(width=None if sys.stdout.isatty() else 160).print(table)


def _warm_up(arguments: argparse.Namespace) -> int:
    from device_agent.progress import progress_bar
    from device_agent.warm_up import warm_up_side_by_side

    with progress_bar("Compiling") as report:
        warm_up_side_by_side(report)
    return 0

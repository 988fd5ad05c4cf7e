"""``vbr rehearse``: what somebody would hear on the way from one place of a site to another, without walking."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from navcore.errors import PlanningError

if TYPE_CHECKING:
    from navcore.rehearsal.rehearsing import Rehearsal
    from navcore.settings import Settings


def add_commands(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add ``vbr rehearse``."""
    parser = subparsers.add_parser(
        "rehearse", help="list what would be heard on a way, where and when, without walking"
    )
    parser.add_argument("--site", type=Path, required=True, metavar="DIR", help="folder of the site")
    parser.add_argument("--from", dest="start", required=True, metavar="PLACE", help="where the walker stands")
    parser.add_argument("--to", required=True, metavar="PLACE", help="where they want to go")
    parser.add_argument("--language", choices=("en", "zh"), help="language of the speech (default: the settings')")
    parser.add_argument("--json", action="store_true", help="print all of it, tones included, as JSON")
    parser.add_argument("--wav", type=Path, metavar="FILE", help="write the sound of the whole way")
    parser.add_argument(
        "--set", action="append", default=[], metavar="NAME=VALUE", help="change a setting (see `vbr settings`)"
    )
    parser.set_defaults(run=_rehearse)


def _rehearse(arguments: argparse.Namespace) -> None:
    from device_agent.places import find_place
    from navcore.rehearsal.rehearsing import rehearse
    from navcore.settings import Settings, parse_assignment
    from navcore.site import load_poi_graph, map_checksum

    settings = Settings().changed(dict(parse_assignment(text) for text in arguments.set))
    if arguments.language is not None:
        settings = settings.changed({"cues.language": arguments.language})
    # A folder that is no site is refused; one without a PoI-graph has no places.
    map_checksum(arguments.site)
    graph = load_poi_graph(arguments.site)
    start, goal = find_place(graph, arguments.start), find_place(graph, arguments.to)
    rehearsal = rehearse(graph, start.id, goal.id, settings)
    if arguments.wav is not None:
        _write_sound(rehearsal, arguments.wav, settings)
    if arguments.json:
        sys.stdout.write(_json_text(rehearsal))
    else:
        _print_list(rehearsal)
    if rehearsal.refusal:
        raise PlanningError(rehearsal.refusal, "apart", name=goal.name)


def _write_sound(rehearsal: Rehearsal, path: Path, settings: Settings) -> None:
    from device_agent.adapters.wav_file import WavFileOutput
    from navcore.espeak import Speech

    output = WavFileOutput(path, Speech(settings.cues.language), begin_s=0.0)
    try:
        for utterance in rehearsal.utterances:
            output.play(utterance.cue)
    finally:
        output.close()


def _json_text(rehearsal: Rehearsal) -> str:
    import msgspec

    values: dict[str, Any] = msgspec.to_builtins(rehearsal)
    return json.dumps(values, ensure_ascii=False, indent=1) + "\n"


def _print_list(rehearsal: Rehearsal) -> None:
    from rich.console import Console
    from rich.table import Table

    table = Table("s", "m", "x, y", "edge", "cue", "what is heard")
    for each in rehearsal.utterances:
        if each.text:
            table.add_row(
                f"{each.stamp_s:.1f}", f"{each.along_m:.1f}", f"{each.x_m:.1f}, {each.y_m:.1f}", each.edge_id or "",
                each.kind.value, each.text,
            )  # fmt: skip
    console = Console(width=None if sys.stdout.isatty() else 160)
    console.print(table)
    if rehearsal.arrived:
        tones = sum(not each.text for each in rehearsal.utterances)
        console.print(
            f"{rehearsal.length_m:.1f} m in {rehearsal.total_s:.0f} s; {tones} tones besides.", highlight=False
        )

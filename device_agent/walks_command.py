"""``vbr walks``: what was recorded of walks, and whether the loop still decides as it did then."""

from __future__ import annotations

import argparse
import json
import shlex
import sys
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from navcore.errors import InputError

if TYPE_CHECKING:
    from device_agent.recording.reading import RecordedPart
    from device_agent.recording.replay import MakeLocalizer, ReplayedCycle

EXIT_DIFFERENT = 1
_SHOWN_DIFFERENCES, _SHOWN_VALUES = 10, 3


def add_commands(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add ``vbr walks``."""
    walks = subparsers.add_parser("walks", help="recorded walks: list, show, replay, repair")
    actions = walks.add_subparsers(metavar="ACTION", required=True)
    listing = actions.add_parser("list", help="list the recorded walks in a folder")
    listing.add_argument("folder", type=Path, metavar="DIR", help="folder of the recordings")
    listing.add_argument("--json", action="store_true", help="print them as JSON")
    listing.set_defaults(run=_list)
    show = actions.add_parser("show", help="what happened: how long, what was decided, what was heard")
    show.add_argument("file", type=Path, metavar="FILE", help="a file of a walk")
    show.add_argument("--json", action="store_true", help="print it as JSON")
    show.set_defaults(run=_show)
    again = actions.add_parser(
        "replay",
        help="let the loop run again on what it read, and compare",
        description="Let the loop run again on what it read, and compare all guidance and all cues with those of then,"
        " bit for bit. Poses and scans come from the recording; with --site they are computed from its pictures.",
    )
    again.add_argument("files", type=Path, nargs="+", metavar="FILE", help="files of one walk, in order")
    again.add_argument("--site", type=Path, metavar="DIR", help="the map of then: go through the pictures as well")
    again.add_argument("--set", action="append", default=[], metavar="NAME=VALUE", help="under another setting")
    again.add_argument("--cues", type=Path, metavar="FILE", help="write what is said now as JSON lines")
    again.add_argument(
        "--decisions", type=Path, metavar="FILE", help="write each cycle's decision, then and now, as JSON lines"
    )
    again.add_argument("--last", type=_seconds, metavar="SECONDS", help="replay no more than the end of the walk")
    again.add_argument(
        "--behind", action="store_true", help="give way to every other process, and print progress as lines of JSON"
    )
    again.add_argument("--json", action="store_true", help="print the figures as JSON")
    again.set_defaults(run=_replay)
    repair = actions.add_parser("repair", help="write what is whole of a damaged file to a new one, with its index")
    repair.add_argument("file", type=Path, metavar="FILE", help="a file that a crash or a bad disk has damaged")
    repair.add_argument("target", type=Path, metavar="OUT", help="the new file")
    repair.set_defaults(run=_repair)
    send = actions.add_parser(
        "send",
        help="send a recorded walk, or the recording of a map walk, to the console's machine",
        description="Send a recorded walk (FILE.mcap), or the recording of a map walk (a folder), to the console's"
        " machine. What was broken off goes on where it was.",
    )
    send.add_argument("file", type=Path, metavar="FILE", help="a file of a walk, or a recording's folder")
    send.add_argument("--console", required=True, metavar="URL", help="ws://127.0.0.1:PORT or wss://HOST:PORT")
    send.add_argument("--token-file", type=Path, required=True, metavar="FILE", help="holds the console's token")
    send.add_argument("--ca-file", type=Path, metavar="FILE", help="certificate of a console that has its own")
    send.set_defaults(run=_send)


def _list(arguments: argparse.Namespace) -> int:
    from device_agent.recording.walk_files import parts_in

    rows = [_row(path) for path in parts_in(arguments.folder)]
    if arguments.json:
        json.dump(rows, sys.stdout, indent=1)
        sys.stdout.write("\n")
        return 0
    if not rows:
        sys.stdout.write(_nothing_in(arguments.folder))
        return 0
    from rich.console import Console
    from rich.table import Table

    table = Table("file", "MB", "seconds", "pictures", "state")
    for row in rows:
        seconds = "" if row["seconds"] is None else f"{row['seconds']:.0f}"
        table.add_row(row["file"], f"{row['bytes'] / 1e6:.1f}", seconds, row["pictures"], row["state"])
    Console(width=None if sys.stdout.isatty() else 160).print(table)
    return 0


def _nothing_in(folder: Path) -> str:
    """Say that there is nothing to be listed, and what may have been meant."""
    others = sorted(path.name for path in folder.glob("*.mcap"))
    if others:
        return (
            f"{folder} holds no file that is named as walks are (DATE-DEVICE-PART.mcap), but {', '.join(others[:5])}:"
            f" look at it with `vbr walks show {shlex.quote(str(folder / others[0]))}`.\n"
        )
    return (
        f"{folder} holds no recorded walks: name the folder that was given to --record, or record one with"
        f" `vbr demo --record {shlex.quote(str(folder))}`.\n"
    )


def _row(path: Path) -> dict[str, Any]:
    """Return what a list says of a file, without reading all of it."""
    from device_agent.recording.reading import RecordedPart

    row: dict[str, Any] = {
        "file": path.name, "bytes": path.stat().st_size, "seconds": None, "pictures": "", "state": "whole"
    }  # fmt: skip
    try:
        part = RecordedPart(path)
    except InputError as error:
        return {**row, "state": str(error)}
    row["pictures"] = part.description.get("pictures", "")
    row["seconds"] = part.length_s()
    if row["seconds"] is None:
        row["state"] = "not completed: read up to its end, or repair it"
    return row


def _show(arguments: argparse.Namespace) -> int:
    from device_agent.recording.reading import RecordedPart

    part = RecordedPart(arguments.file)
    shown = _summary(part)
    if arguments.json:
        json.dump(shown, sys.stdout, indent=1, ensure_ascii=False)
        sys.stdout.write("\n")
        return 0
    sys.stdout.write("\n".join(_readable(shown)) + "\n")
    return 0


def _readable(shown: dict[str, Any]) -> list[str]:
    """Return a summary in lines for people."""
    pictures = f"{shown['frames_with_pictures']} frames with pictures" if shown["pictures"] == "yes" else "no pictures"
    lines = [
        f"Walk {shown['walk_id']}, file {shown['part']} of it, recorded by version {shown['software_version']}",
        f"  length     {shown['seconds']:.1f} s, {shown['cycles']} cycles, {pictures}",
        f"  map        {shown['site_id'] or 'none'}" + (f" ({shown['map_checksum'][:12]})" if shown["site_id"] else ""),
        f"  decisions  {_shares(shown['actions'], shown['cycles'])}",
        f"  reasons    {_shares(shown['reasons'], shown['cycles'])}",
        f"  file       {'damaged: ' + shown['damage'] if shown['damage'] else 'whole'}",
        "  heard, by the device's clock:" if shown["heard"] else "  Nothing was said.",
    ]
    return [*lines, *(f"  {stamp_s:10.2f} s  “{text}”" for stamp_s, text in shown["heard"])]


def _shares(counts: dict[str, int], total: int) -> str:
    """Return how often each was, the most frequent first: ``walk 64% (52), stop 26% (21)``."""
    ordered = sorted(counts.items(), key=lambda item: -item[1])
    return ", ".join(f"{name.replace('_', ' ')} {count / total:.0%} ({count})" for name, count in ordered) or "none"


def _summary(part: RecordedPart) -> dict[str, Any]:
    actions: Counter[str] = Counter()
    reasons: Counter[str] = Counter()
    stamps: list[float] = []
    heard: list[tuple[float, str]] = []
    pictures = 0
    for recorded in part.cycles():
        guidance = recorded.notes.guidance
        stamps.append(guidance.stamp_s)
        actions[guidance.action.value] += 1
        reasons[guidance.reason.value] += 1
        pictures += recorded.notes.pictures
        heard += [(cue.stamp_s, cue.text) for cue in recorded.notes.cues if cue.text]
    return {
        **part.description,
        "cycles": len(stamps),
        "seconds": round(stamps[-1] - stamps[0], 3) if stamps else 0.0,
        "frames_with_pictures": pictures,
        "actions": dict(actions),
        "reasons": dict(reasons),
        "damage": part.damage,
        "heard": heard,
    }


def _replay(arguments: argparse.Namespace) -> int:
    from device_agent.recording.reading import RecordedPart
    from device_agent.recording.replay import replay
    from device_agent.single_core import give_way, use_one_core
    from navcore.settings import parse_assignment

    changes = dict(parse_assignment(text) for text in arguments.set)
    if arguments.behind:
        give_way()
    use_one_core()
    parts = [RecordedPart(path) for path in arguments.files]
    _refuse_twice(parts)
    make_localizer = None if arguments.site is None else _localizers(arguments.site, parts)
    if arguments.last is not None:
        if make_localizer is not None:
            raise InputError("What the localizer remembered is in no file: leave --last out, or --site.")
        parts = _last_parts(parts, arguments.last)
    cycles: Iterable[ReplayedCycle] = replay(parts, make_localizer, changes)
    if arguments.last is not None:
        cycles = _from_then_on(cycles, parts, arguments.last)
    if arguments.behind:
        cycles = _with_progress(cycles, sum(part.length_s() or 0.0 for part in parts))
    with _decisions_file(arguments.decisions) as note:
        count, different, cues = _compared(cycles, note)
    damages = {str(part.path): part.damage for part in parts if part.damage}
    if arguments.cues is not None:
        _write_cues(arguments.cues, cues)
    if arguments.json:
        figures = {
            "cycles": count, "different": len(different), "first": different[:_SHOWN_DIFFERENCES], "damages": damages
        }  # fmt: skip
        sys.stdout.write(json.dumps(figures, ensure_ascii=False) + "\n")
    else:
        _print_comparison(count, different, damages)
    return EXIT_DIFFERENT if different else 0


def _refuse_twice(parts: list[RecordedPart]) -> None:
    named: dict[tuple[str, int], Path] = {}
    for part in parts:
        key = (part.opening.walk_id, part.opening.part)
        if key in named:
            raise InputError(
                f"{part.path} is the same part of the same walk as {named[key]}: name each file of a walk once."
            )
        named[key] = part.path


def _last_parts(parts: list[RecordedPart], last_s: float) -> list[RecordedPart]:
    """Return the files in which the last seconds of a walk are: a replay may begin with any of them."""
    from itertools import accumulate

    covered_s = list(accumulate(part.length_s() or 0.0 for part in reversed(parts)))
    count = next((index + 1 for index, length_s in enumerate(covered_s) if length_s >= last_s), len(parts))
    return parts[-count:]


def _from_then_on(cycles: Iterable[ReplayedCycle], parts: list[RecordedPart], last_s: float) -> Iterator[ReplayedCycle]:
    """Pass over what came before the last seconds, though it is replayed: guidance goes on from it."""
    skipped_s, first_s = sum(part.length_s() or 0.0 for part in parts) - last_s, None
    for cycle in cycles:
        stamp_s = cycle.notes.guidance.stamp_s
        first_s = stamp_s if first_s is None else first_s
        if stamp_s - first_s >= skipped_s:
            yield cycle


def _with_progress(cycles: Iterable[ReplayedCycle], length_s: float) -> Iterator[ReplayedCycle]:
    """Print each percent of the walk's time that has been replayed, as a line of JSON."""
    first_s, told = None, -1
    for cycle in cycles:
        stamp_s = cycle.notes.guidance.stamp_s
        first_s = stamp_s if first_s is None else first_s
        percent = int(100 * (stamp_s - first_s) / length_s) if length_s > 0 else 0
        if percent > told:
            told = percent
            sys.stdout.write(json.dumps({"percent": min(100, percent)}) + "\n")
            sys.stdout.flush()
        yield cycle


@contextmanager
def _decisions_file(path: Path | None) -> Iterator[Callable[[ReplayedCycle], None]]:
    """Open what each cycle's decision is written to; nothing is written where no file is named."""
    from device_agent.recording.replay import decision_line

    if path is None:
        yield lambda cycle: None
        return
    try:
        with path.open("w", encoding="utf-8") as out:
            yield lambda cycle: print(json.dumps(decision_line(cycle), ensure_ascii=False), file=out)
    except OSError as error:
        raise InputError(f"{path} cannot be written ({error.strerror}): name another file with --decisions.") from error


def _seconds(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not 0.0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"{text!r} is no number of seconds: give one above 0")
    return value


def _compared(
    cycles: Iterable[ReplayedCycle], note: Callable[[ReplayedCycle], None]
) -> tuple[int, list[dict[str, Any]], list[dict[str, Any]]]:
    """Return how many cycles there were, those that differ, and all that is said now; ``note`` is given each."""
    from device_agent.recording.replay import cue_line, difference

    count, different, cues = 0, [], []
    for cycle in cycles:
        count += 1
        note(cycle)
        cues += [cue_line(cue) for cue in cycle.cues]
        if cycle.differs_in:
            different.append(difference(cycle))
    return count, different, cues


def _print_comparison(count: int, different: list[dict[str, Any]], damages: dict[str, str]) -> None:
    lines = [f"{count} cycles replayed, {len(different)} of them differ."]
    for each in different[:_SHOWN_DIFFERENCES]:
        lines += _difference_lines(each)
    if len(different) > _SHOWN_DIFFERENCES:
        lines.append(f"  and {len(different) - _SHOWN_DIFFERENCES} more")
    lines += [f"{path} was read up to where it is damaged: {damage}." for path, damage in damages.items()]
    sys.stdout.write("\n".join(lines) + "\n")


def _difference_lines(each: dict[str, Any]) -> list[str]:
    """Return a difference in lines; where both come to the same words, the values that differ stand below."""
    then, now = each["then"], each["now"]
    head = f"  {each['stamp_s']:.2f} s, in {', '.join(each['in'])}:"
    if then != now:
        return [f"{head} {then} → {now}"]
    values = list(each["values"].items())
    lines = [f"    {name}: {old} → {new}" for name, (old, new) in values[:_SHOWN_VALUES]]
    if len(values) > _SHOWN_VALUES:
        lines.append(f"    and {len(values) - _SHOWN_VALUES} values more (--json has them)")
    how = "by other values" if values else "which came to the same guidance"
    return [f"{head} the same, {then}, {how}", *lines]


def _write_cues(path: Path, cues: list[dict[str, Any]]) -> None:
    try:
        path.write_text("".join(json.dumps(cue, ensure_ascii=False) + "\n" for cue in cues), encoding="utf-8")
    except OSError as error:
        raise InputError(f"{path} cannot be written ({error.strerror}): name another file with --cues.") from error


def _localizers(folder: Path, parts: list[RecordedPart]) -> MakeLocalizer:
    """Return what localizes in the map of then. Raises InputError where it is another map."""
    from device_agent.localization import make_localizer
    from navcore.site import load_site, map_checksum

    site, checksum = load_site(folder), map_checksum(folder)
    for part in parts:
        then = part.opening.state.map_checksum
        if then and then != checksum:
            raise InputError(f"{part.path} was recorded in another map than {folder}: name the map of then.")
    return lambda intrinsics, settings: make_localizer(site, intrinsics, settings)


def _repair(arguments: argparse.Namespace) -> int:
    from device_agent.recording.reading import RecordedPart

    part = RecordedPart(arguments.file)
    try:
        part.repair(arguments.target)
    except FileExistsError as error:
        raise InputError(f"{arguments.target} is there already: name a new file.") from error
    except OSError as error:
        raise InputError(f"{arguments.target} cannot be written ({error.strerror}): name another file.") from error
    found = f"It is damaged ({part.damage})" if part.damage else "It was whole"
    print(f"{found}; what is whole is in {arguments.target}.")  # noqa: T201 - the command's answer
    return 0


def _send(arguments: argparse.Namespace) -> int:
    import asyncio

    from device_agent.device_command import checked_console_url, read_ca_file, read_token
    from device_agent.map_download import MapSource
    from device_agent.map_walk.walk_folder import STATE_FILE
    from device_agent.progress import progress_bar
    from device_agent.recording_upload import send_recording
    from navcore.recording_archive import RecordingArchive
    from navcore.recording_upload import RecordingOffer

    console = MapSource(
        checked_console_url(arguments.console), read_token(arguments.token_file), read_ca_file(arguments.ca_file)
    )
    source: Path = arguments.file
    archive = RecordingArchive(source, {STATE_FILE})
    kind: Literal["recording", "walk"] = "recording" if source.is_dir() else "walk"
    offer = RecordingOffer(kind, source.resolve().stem[:120], archive.size_bytes, archive.sha256())

    async def at_once() -> None:
        """Nothing here is more urgent."""

    with progress_bar("Sending") as progress:
        asyncio.run(send_recording(archive, offer, console, at_once, progress))
    print(f"{source} is on the console's machine, as {offer.name}.")  # noqa: T201 - the command's answer
    return 0

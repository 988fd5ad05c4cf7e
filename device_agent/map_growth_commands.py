"""``vbr map extend``, ``sessions`` and ``remove-session``: the recordings that a site is made of."""

from __future__ import annotations

import argparse
import json
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from navcore.site_growth import Growth

WORDS = {
    "session": "session",
    "frames": "frames",
    "tracked_share": "share of them tracked",
    "matches": "views recognised in the site's map",
    "known_moved_m": "largest correction of the map that was there, m",
    "session_road_m": "road of this session, m",
    "places_added": "places added",
    "places_lost": "places that were marked where the way was not known",
    "points_read": "points read",
}
SITE_WORDS = {
    "sessions": "sessions of the site",
    "keyframes": "key frames",
    "landmarks": "landmarks",
    "road_m": "road, m",
    "road_parts": "parts of road that do not join each other",
    "cloud_points": "points of the cloud",
}


def add_actions(actions: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the actions to ``vbr map``."""
    extend = actions.add_parser(
        "extend",
        help="join another recorded walk to a site",
        description="Join another recorded walk to a site. It must pass through a place that the site's map shows;"
        " places keep where they are. Publish in the console first: what is only a draft there is not carried over.",
    )
    extend.add_argument("site", type=Path, metavar="SITE", help="folder of the site")
    extend.add_argument("source", type=Path, metavar="RECORDING", help="recording that passes through a mapped place")
    add_session_options(extend)
    extend.add_argument("--set", action="append", default=[], metavar="NAME=VALUE", help="change a setting")
    extend.set_defaults(run=_extend)
    sessions = actions.add_parser("sessions", help="list the recordings that a site is made of")
    sessions.add_argument("site", type=Path, metavar="SITE", help="folder of the site")
    sessions.add_argument("--json", action="store_true", help="print them as JSON")
    sessions.set_defaults(run=_sessions)
    remove = actions.add_parser(
        "remove-session",
        help="take a recording out of a site",
        description="Take a recording, or what was imported, out of a site. Places to which no road leads any more stay"
        " as free-standing ones. Publish in the console first: what is only a draft there is not carried over.",
    )
    remove.add_argument("site", type=Path, metavar="SITE", help="folder of the site")
    remove.add_argument("session", metavar="ID", help="its id, as `vbr map sessions` lists it")
    remove.add_argument("--json", action="store_true", help="print the figures as JSON")
    remove.set_defaults(run=_remove)
    restore = actions.add_parser(
        "restore",
        help="put the device's map from before the last change back",
        description="Put the map that ran on this device before the present one back in use, and keep the present one"
        " in its place. Stop `vbr device` first.",
    )
    restore.add_argument("site", type=Path, metavar="SITE", help="the device's copy of the site's folder")
    restore.set_defaults(run=_restore)


def _restore(arguments: argparse.Namespace) -> int:
    from device_agent.device_store import restore_previous
    from navcore.errors import InputError

    try:
        restore_previous(arguments.site)
    except OSError as error:
        raise InputError(f"{arguments.site} cannot be restored ({error.strerror}): free the disk.") from error
    sys.stdout.write(f"{arguments.site} is the map from before; running this again changes them back.\n")
    return 0


def add_session_options(parser: argparse.ArgumentParser) -> None:
    """Add what is said of a new session."""
    parser.add_argument("--name", help="name of the session (default: that of what it is made of)")
    parser.add_argument("--date", default="", help="when it was recorded, in whatever form")
    parser.add_argument("--json", action="store_true", help="print the figures as JSON")


def _extend(arguments: argparse.Namespace) -> int:
    from device_agent.progress import stage_bar
    from device_agent.single_core import use_one_core
    from navcore.recording import open_recording
    from navcore.settings import Settings, parse_assignment
    from navcore.site import load_site, prepare_site_folder
    from navcore.site_building import default_name
    from navcore.site_growth import extend_site, recording_session

    use_one_core()
    settings = Settings().changed(dict(parse_assignment(text) for text in arguments.set))
    site = load_site(arguments.site)
    recording = open_recording(arguments.source)
    session = recording_session(recording, arguments.name or default_name(arguments.source), arguments.date)
    prepare_site_folder(arguments.site)
    with ThreadPoolExecutor(1) as executor, stage_bar() as progress:
        growth = extend_site(site, recording, session, settings.localization, progress, executor=executor)
    return keep(growth, arguments)


def _sessions(arguments: argparse.Namespace) -> int:
    from navcore.site import load_site

    site = load_site(arguments.site)
    rows: list[dict[str, Any]] = []
    for number, session in enumerate(site.sessions):
        camera = session.camera
        rows.append(
            {
                "id": session.id,
                "kind": session.kind,
                "name": session.name,
                "date": session.date,
                "frames": session.frame_count,
                "camera": f"{camera.width_px}x{camera.height_px}" if camera else "",
                "roads": sum(of == number for of in site.road_sessions),
            }
        )
    if arguments.json:
        json.dump(rows, sys.stdout, indent=1)
        sys.stdout.write("\n")
        return 0
    for row in rows:
        kind = "imported" if row["kind"] == "import" else f"{row['frames']} frames, {row['camera'] or 'unknown camera'}"
        sys.stdout.write(f"{row['id']:<10} {row['name']:<30} {row['date']:<12} {kind}\n")
    return 0


def _remove(arguments: argparse.Namespace) -> int:
    from device_agent.single_core import use_one_core
    from navcore.site import load_site
    from navcore.site_growth import remove_session

    use_one_core()
    return keep(remove_session(load_site(arguments.site), arguments.session), arguments)


def keep(growth: Growth, arguments: argparse.Namespace) -> int:
    """Write a changed site, and say what has changed."""
    from navcore.site import save_site

    save_site(growth.site, arguments.site)
    places = ", ".join(growth.off_road)
    lost = {"places_off_road": list(growth.off_road), "edges_lost": growth.lost_edges}
    if arguments.json:
        report = {name: growth.site.report[name] for name in SITE_WORDS if name in growth.site.report}
        json.dump(
            growth.figures | {f"site_{name}": value for name, value in report.items()} | lost, sys.stdout, indent=1
        )
        sys.stdout.write("\n")
        return 0
    for words, values in ((WORDS, growth.figures), (SITE_WORDS, growth.site.report)):
        for name, text in words.items():
            if values.get(name, "") != "":
                sys.stdout.write(f"{text + ':':<50} {values[name]}\n")
    if growth.off_road or growth.lost_edges:
        sys.stderr.write(
            f"vbr: No road leads any more to {places or 'some places'} ({growth.lost_edges} edges are gone): look at"
            " the PoI-graph in the console.\n"
        )
    sys.stdout.write(
        f"The site in {arguments.site} is changed, with the PoI-graph as last published. A running console shows it"
        " when it is started again.\n"
    )
    return 0

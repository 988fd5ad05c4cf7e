"""``vbr map export`` and ``import``: trajectories, clouds and roads, for and from other programs."""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from device_agent.map_growth_commands import add_session_options, keep
from navcore.errors import InputError

if TYPE_CHECKING:
    from navcore.site import Site
    from navcore.site_growth import Growth


def add_actions(actions: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the actions to ``vbr map``."""
    export = actions.add_parser("export", help="write a site's trajectory, cloud or road for other programs")
    export.add_argument("site", type=Path, metavar="SITE", help="folder of the site")
    export.add_argument("--trajectory", type=Path, metavar="OUT.txt", help="the recording camera's poses (TUM format)")
    export.add_argument("--session", metavar="ID", help="whose trajectory (default: that of the only recording)")
    export.add_argument("--cloud", type=Path, metavar="OUT.ply|OUT.pcd", help="the coloured cloud")
    export.add_argument("--road", type=Path, metavar="OUT.csv", help="the virtual blind road: road, x_m, y_m, z_m")
    export.set_defaults(run=_export)
    bring = actions.add_parser("import", help="bring a cloud, or a trajectory as a road, into a site")
    bring.add_argument("site", type=Path, metavar="SITE", help="folder of the site")
    what = bring.add_mutually_exclusive_group(required=True)
    what.add_argument("--cloud", type=Path, metavar="FILE", help="coloured cloud (.ply, .pcd) in the site's frame, m")
    what.add_argument("--trajectory", type=Path, metavar="FILE", help="poses (TUM format) in the site's frame: a road")
    bring.add_argument(
        "--replace", action="store_true", help="show the imported cloud instead of the one that is there"
    )
    add_session_options(bring)
    bring.set_defaults(run=_import)


# ------------------------------------------------------------------------------------------------------- export
def _export(arguments: argparse.Namespace) -> int:
    from navcore.cloud_files import refuse_unknown_form, write_cloud
    from navcore.site import load_site

    wanted = [path for path in (arguments.trajectory, arguments.cloud, arguments.road) if path is not None]
    if not wanted:
        raise InputError("Nothing to export: name a file with --trajectory, --cloud or --road.")
    for path in wanted:
        refuse_unwritable(path)
    if arguments.cloud is not None:
        refuse_unknown_form(arguments.cloud)
    site = load_site(arguments.site)
    if arguments.trajectory is not None:
        _write_trajectory(site, arguments.session, arguments.trajectory)
    if arguments.cloud is not None:
        write_cloud(arguments.cloud, site.cloud_points_m, site.cloud_colours_rgb)
    if arguments.road is not None:
        _write_road(site, arguments.road)
    sys.stdout.write("".join(f"{path}\n" for path in wanted))
    return 0


def refuse_unwritable(path: Path) -> None:
    """Raise InputError where a file cannot be written."""
    if path.is_dir() or not os.access(path if path.exists() else path.parent, os.W_OK):
        raise InputError(f"{path} cannot be written: name a file in a folder that is there.")


def _write_trajectory(site: Site, session_id: str | None, path: Path) -> None:
    from navcore.geometry import Transform
    from navcore.recording import write_trajectory
    from navcore.site_growth import session_number, slam_map_of

    recorded = [session.id for session in site.sessions if session.kind == "recording"]
    if session_id is None and len(recorded) > 1:
        raise InputError(
            f"The site has {len(recorded)} recordings, whose times are not comparable: name one with --session"
            f" ({', '.join(recorded)})."
        )
    number = session_number(site, session_id or recorded[0])
    slam_map = slam_map_of(site)
    own = slam_map.trajectory_session == number
    poses = [
        (float(stamp_s), Transform(pose))
        for stamp_s, pose in zip(slam_map.trajectory_stamp_s[own], slam_map.trajectory[own], strict=True)
    ]
    write_trajectory(path, poses, f"site {site.site_id}, session {site.sessions[number].id}: level map from camera")


def _write_road(site: Site, path: Path) -> None:
    with path.open("w", encoding="utf-8", newline="\n") as out:
        out.write("road,x_m,y_m,z_m\n")
        for number, road in enumerate(site.roads_m):
            out.writelines(f"{number},{x:.4f},{y:.4f},{z:.4f}\n" for x, y, z in road.tolist())


# ------------------------------------------------------------------------------------------------------- import
def _import(arguments: argparse.Namespace) -> int:
    from navcore.site import load_site, prepare_site_folder

    source: Path = arguments.cloud or arguments.trajectory
    if arguments.replace and arguments.cloud is None:
        raise InputError("Only a cloud can take the place of what is there: leave --replace out, or name a --cloud.")
    site = load_site(arguments.site)
    prepare_site_folder(arguments.site)
    name = arguments.name or source.name
    grown = _with_cloud if arguments.cloud is not None else _with_road
    return keep(grown(site, source, name, arguments), arguments)


def _with_cloud(site: Site, source: Path, name: str, arguments: argparse.Namespace) -> Growth:
    from navcore.cloud_files import read_cloud
    from navcore.site_import import import_session, with_imported_cloud

    cloud = read_cloud(source)
    session = import_session(source.read_bytes(), name, arguments.date)
    return with_imported_cloud(site, session, cloud.points_m, cloud.colours_rgb, replaces=arguments.replace)


def _with_road(site: Site, source: Path, name: str, arguments: argparse.Namespace) -> Growth:
    import numpy as np

    from navcore.recording import read_trajectory
    from navcore.site_import import import_session, with_imported_road
    from navcore.slam.road import build_roads

    stamps_s, poses = read_trajectory(source)
    places = np.array([pose.translation for pose in poses]).reshape(-1, 3)
    session = import_session(source.read_bytes(), name, arguments.date)
    return with_imported_road(site, session, build_roads(stamps_s, places))

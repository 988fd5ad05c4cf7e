"""``vbr map export`` and ``import``: sites, graphs, trajectories, clouds and roads, for and from other programs."""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

from device_agent.map_growth_commands import add_session_options, keep
from navcore.errors import InputError

if TYPE_CHECKING:
    from navcore.planning.poi_graph import PoiGraph
    from navcore.site import Site
    from navcore.site_growth import Growth


def add_actions(actions: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the actions to ``vbr map``."""
    export = actions.add_parser("export", help="write a site as one file, or its parts for other programs")
    export.add_argument("site", type=Path, metavar="SITE", help="folder of the site")
    export.add_argument("--trajectory", type=Path, metavar="OUT.txt", help="the recording camera's poses (TUM format)")
    export.add_argument("--session", metavar="ID", help="whose trajectory (default: that of the only recording)")
    export.add_argument("--cloud", type=Path, metavar="OUT.ply|OUT.pcd", help="the coloured cloud")
    export.add_argument(
        "--road", type=Path, metavar="OUT.csv|OUT.tum", help="the virtual blind road: road, x_m, y_m, z_m; or poses"
    )
    export.add_argument("--graph", type=Path, metavar="OUT.geojson|OUT.graphml", help="the published PoI-graph")
    export.add_argument("--archive", type=Path, metavar="OUT.zip", help="the whole site as one file")
    export.set_defaults(run=_export)
    bring = actions.add_parser("import", help="make a site of an archive; bring a cloud, a road or a graph into one")
    bring.add_argument("site", type=Path, metavar="SITE", help="folder of the site")
    what = bring.add_mutually_exclusive_group(required=True)
    what.add_argument("--cloud", type=Path, metavar="FILE", help="coloured cloud (.ply, .pcd) in the site's frame, m")
    what.add_argument("--trajectory", type=Path, metavar="FILE", help="poses (TUM format) in the site's frame: a road")
    what.add_argument("--graph", type=Path, metavar="FILE", help="PoI-graph (GeoJSON, GraphML), published as it is")
    what.add_argument("--archive", type=Path, metavar="FILE", help="a whole site, as one file; SITE is made")
    bring.add_argument(
        "--replace",
        action="store_true",
        help="show the imported cloud instead of the one that is there; put an archive in the place of the site",
    )
    bring.add_argument(
        "--confirmed",
        action="store_true",
        help="publish a graph although the checks find errors in it: you have looked",
    )
    add_session_options(bring)
    bring.set_defaults(run=_import)


# ------------------------------------------------------------------------------------------------------- export
def _export(arguments: argparse.Namespace) -> int:
    from navcore.cloud_files import refuse_unknown_form, write_cloud
    from navcore.site import load_site

    named = (arguments.trajectory, arguments.cloud, arguments.road, arguments.graph, arguments.archive)
    wanted: list[Path] = [path for path in named if path is not None]
    if not wanted:
        raise InputError("Nothing to export: name a file with --archive, --graph, --trajectory, --cloud or --road.")
    for path in wanted:
        refuse_unwritable(path)
    if arguments.cloud is not None:
        refuse_unknown_form(arguments.cloud)
    if arguments.graph is not None:
        _graph_form(arguments.graph)
    site = load_site(arguments.site)
    if arguments.trajectory is not None:
        _write_trajectory(site, arguments.session, arguments.trajectory)
    if arguments.cloud is not None:
        write_cloud(arguments.cloud, site.cloud_points_m, site.cloud_colours_rgb)
    if arguments.road is not None:
        _write_road(site, arguments.road)
    if arguments.graph is not None:
        _write_graph(site, arguments.graph)
    if arguments.archive is not None:
        _write_archive(arguments.site, arguments.archive)
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
    from navcore.recording import write_trajectory
    from navcore.road_trajectory import COMMENT, road_poses

    if path.suffix.lower() in (".tum", ".txt"):
        write_trajectory(path, road_poses([road.points_m for road in _with_roads(site).roads.values()]), COMMENT)
        return
    with path.open("w", encoding="utf-8", newline="\n") as out:
        out.write("road,x_m,y_m,z_m\n")
        for number, road in enumerate(site.roads_m):
            out.writelines(f"{number},{x:.4f},{y:.4f},{z:.4f}\n" for x, y, z in road.tolist())


def _with_roads(site: Site) -> PoiGraph:
    """Return the site's graph with its roads; those that nobody has edited are stored with the map alone."""
    from navcore.planning.road_edits import recorded_roads

    graph = site.poi_graph
    return graph if graph.roads else msgspec.structs.replace(graph, roads=recorded_roads(site.roads_m))


def _graph_form(path: Path) -> str:
    from navcore.graph_import import GRAPH_FORMS

    form = path.suffix.lower().removeprefix(".")
    if form not in GRAPH_FORMS:
        endings = " or ".join(f".{known}" for known in GRAPH_FORMS)
        raise InputError(f"{path} is no kind of graph file that is known here: give a name that ends in {endings}.")
    return form


def _write_graph(site: Site, path: Path) -> None:
    from navcore.graph_import import GRAPH_FORMS

    path.write_bytes(GRAPH_FORMS[_graph_form(path)](_with_roads(site), site.site_id, site.name))


def _write_archive(folder: Path, path: Path) -> None:
    from navcore.site_archive import write_site_archive

    # Beside its place first: what is there stays where this cannot be finished.
    fresh = path.with_name(f".{path.name}.new")
    try:
        with fresh.open("wb") as out:
            write_site_archive(folder, out)
        os.replace(fresh, path)
    except OSError as error:
        raise InputError(f"{path} cannot be written ({error.strerror}): free the disk, or name another.") from error
    finally:
        fresh.unlink(missing_ok=True)


# ------------------------------------------------------------------------------------------------------- import
def _import(arguments: argparse.Namespace) -> int:
    if arguments.replace and arguments.cloud is None and arguments.archive is None:
        raise InputError(
            "Only a cloud or a whole site can take the place of what is there: leave --replace out, or name a --cloud"
            " or an --archive."
        )
    if arguments.confirmed and arguments.graph is None:
        raise InputError("Only a graph is checked before it is published: leave --confirmed out, or name a --graph.")
    if arguments.archive is not None:
        return _import_archive(arguments)
    if arguments.graph is not None:
        return _import_graph(arguments)
    return _import_session(arguments)


def _import_archive(arguments: argparse.Namespace) -> int:
    from navcore.site_archive import unpack_site_archive

    manifest = unpack_site_archive(arguments.archive, arguments.site, replace=arguments.replace)
    sys.stdout.write(
        f"{arguments.site} is {manifest.name}, with version {manifest.graph_version} of its PoI-graph. Open it with"
        f" `vbr console --site {arguments.site}`.\n"
    )
    return 0


def _import_graph(arguments: argparse.Namespace) -> int:
    from navcore.graph_import import MAX_GRAPH_FILE_BYTES, imported
    from navcore.planning.road_edits import recorded_roads
    from navcore.site import load_site, save_poi_graph

    site = load_site(arguments.site)
    resolved = arguments.site.resolve()
    if resolved.with_name(f"{resolved.name}.console").exists():
        raise InputError(
            "A console keeps the PoI-graph of this site, and would put its own back: import the graph in the console."
        )
    try:
        with arguments.graph.open("rb") as file:
            found = imported(file.read(MAX_GRAPH_FILE_BYTES + 1), _with_roads(site))
        if not arguments.confirmed:
            _refuse_errors(found.graph)
        unedited = found.graph.roads == recorded_roads(site.roads_m)
        graph = msgspec.structs.replace(found.graph, roads={}) if unedited else found.graph
        save_poi_graph(graph, arguments.site)
    except OSError as error:
        raise InputError(f"{arguments.graph} cannot be imported ({error.strerror}): see to the file.") from error
    for sentence in (*found.notes, *(f"Not used: {each}" for each in found.unused)):
        sys.stderr.write(f"vbr: {sentence}\n")
    sys.stdout.write(
        f"{arguments.site} has version {graph.version} of its PoI-graph: {len(graph.pois)} places,"
        f" {len(graph.edges)} connections. Whether there is room along them only the console's check knows.\n"
    )
    return 0


def _refuse_errors(graph: PoiGraph) -> None:
    """Raise InputError where the checks that need no cloud find errors: devices take what is published."""
    from navcore.map_check.checker import findings_of
    from navcore.map_check.evidence import MapEvidence
    from navcore.planning.road_edits import network_of

    found = findings_of(MapEvidence(graph, network_of(graph.roads)))
    errors = [finding for finding in found if finding.severity == "error"]
    if errors:
        listed = "".join(f"\n  {error.text} {error.action}" for error in errors)
        raise InputError(
            f"The graph is not published, for it has errors ({len(errors)}): mend them, or give --confirmed where you"
            f" know that it is safe.{listed}"
        )


def _import_session(arguments: argparse.Namespace) -> int:
    from navcore.site import load_site, prepare_site_folder

    source: Path = arguments.cloud or arguments.trajectory
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

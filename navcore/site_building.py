"""From a recording to a site: the map, the road, the cloud, and a first PoI-graph of the places that were named."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from concurrent.futures import Executor
from pathlib import Path
from typing import Any

import numpy as np

from navcore.live_recording import COVERAGE_FILE
from navcore.planning.poi_graph import PoiGraph
from navcore.planning.road_network import RoadNetwork
from navcore.recording import Mark, Recording, read_marks
from navcore.settings import LocalizationSettings
from navcore.site import Site
from navcore.site_growth import recording_session
from navcore.slam.map_build import MapBuild, Progress, build_map
from navcore.tagging import graph_from_marks, lost_marks
from navcore.weak_stretches import Trouble, read_coverage, weak_stretches


def build_site(
    recording: Recording,
    name: str,
    settings: LocalizationSettings,
    progress: Progress,
    date: str = "",
    *,
    executor: Executor | None = None,
) -> tuple[Site, MapBuild]:
    """Build the site of a recording, and return it with what it was made from.

    ``date`` says when the recording was made, in whatever form. ``executor`` runs local mapping beside tracking. Raises
    RecordingError for damaged input and MappingError where no map can be made.
    """
    marks = read_marks(recording.folder / "marks.txt")
    session = recording_session(recording, default_name(recording.folder), date)
    troubles = read_coverage(recording.folder / COVERAGE_FILE)
    built = build_map(recording, settings.feature_count, progress, executor=executor)
    graph, lost = _named_places(marks, built)
    site = Site(
        site_id=_site_id(built),
        name=name,
        intrinsics=recording.intrinsics,
        map_arrays=built.slam_map.to_arrays(),
        roads_m=built.roads_m,
        cloud_points_m=built.cloud.points_m,
        cloud_colours_rgb=built.cloud.colours_rgb,
        poi_graph=graph,
        report=figures(built) | _walk_figures(graph, lost, troubles, built),
        sessions=(session,),
        cloud_weights=built.cloud.weights,
        cloud_view_counts=built.cloud.view_counts,
        cloud_sessions=built.cloud.sessions,
    )
    return site, built


def _named_places(marks: Sequence[Mark], built: MapBuild) -> tuple[PoiGraph, tuple[str, ...]]:
    """Return the places that were named, and the names of those that nobody knows where to put."""
    if not marks:
        return PoiGraph(), ()
    if not built.roads_m:
        return PoiGraph(), tuple(mark.name for mark in marks)
    slam_map = built.slam_map
    walked = slam_map.trajectory_stamp_s, slam_map.trajectory[:, :3, 3]
    network = RoadNetwork.from_roads(built.roads_m)
    return graph_from_marks(marks, *walked, network), lost_marks(marks, *walked, network)


def figures(built: MapBuild) -> dict[str, float | int | str]:
    """Return what a person wants to know about a map; the same map gives the same figures."""
    return {
        "frames": built.level_map.frame_count,
        "tracked_share": round(built.tracked_share, 4),
        "keyframes": built.slam_map.keyframe_count,
        "landmarks": len(built.slam_map.positions),
        "loops_closed": built.level_map.loop_count,
        "road_m": round(built.road_length_m, 2),
        "cloud_points": len(built.cloud),
        "leveling": built.level_map.leveling.note,
    }


def _walk_figures(graph: PoiGraph, lost: Sequence[str], troubles: Sequence[Trouble], built: MapBuild) -> dict[str, Any]:
    """Return what else a person wants to know: how many places have names, and where the walk was not seen well."""
    slam_map = built.slam_map
    stretches = weak_stretches(troubles, slam_map.trajectory_stamp_s, slam_map.trajectory[:, :3, 3])
    return {
        "places": sum(poi.kind != "junction" for poi in graph.pois.values()),
        "places_lost": ", ".join(lost),
        "weak_m": round(sum(stretch.length_m for stretch in stretches), 1),
        "weak_stretches": [
            {
                "from_m": round(stretch.from_m, 1),
                "length_m": round(stretch.length_m, 1),
                "x_m": round(stretch.x_m, 2),
                "y_m": round(stretch.y_m, 2),
                "kinds": list(stretch.kinds),
            }
            for stretch in stretches
        ],
    }


def _site_id(built: MapBuild) -> str:
    content = np.ascontiguousarray(built.slam_map.positions).tobytes()
    return "site-" + hashlib.sha256(content).hexdigest()[:12]


def default_name(folder: Path) -> str:
    """Return the name of a site that nobody named: its folder's."""
    return folder.resolve().name or "Site"

"""A site that grows: another recording joined to it, or one taken out of it.

Places stay: the map's frame does not jump, PoIs move with what they stand beside and are put back on the road, and
what the caregiver has set stays set. Each function gives a new site and changes nothing.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from typing import Any

import msgspec
import numpy as np

from navcore.errors import InputError, MappingError
from navcore.geometry import FloatArray
from navcore.planning.poi_graph import Poi, PoiGraph
from navcore.planning.road_change import Carried, carried_over
from navcore.planning.road_edits import drawn_lines_m, roads_with_drawn
from navcore.planning.road_network import RoadNetwork
from navcore.recording import Mark, Recording, read_marks
from navcore.settings import LocalizationSettings
from navcore.site import Site
from navcore.site_sessions import MAX_SESSIONS, Session
from navcore.slam.cloud_joining import cloud_without_session
from navcore.slam.deformation import Deformation
from navcore.slam.dense_cloud import CEILING_M, DenseCloud
from navcore.slam.map_build import MapExtension, Progress, extend_map, length_of_roads_m, roads_of
from navcore.slam.session_removal import renumbered, separated_by_removal, without_key_frames
from navcore.slam.slam_map import SlamMap
from navcore.tagging import lost_marks, places_to_add

_STANDING_M = 1.0
"""Height at which a place moves with the key frames around it."""


@dataclass(frozen=True, slots=True, eq=False)
class Growth:
    """A site after a change, and what the change did."""

    site: Site
    figures: dict[str, float | int | str]
    """For people to read."""
    off_road: tuple[str, ...] = ()
    """Names of places to which no road leads any more."""
    lost_edges: int = 0
    """Edges along which no road leads any more."""


def recording_session(recording: Recording, name: str, date: str) -> Session:
    """Return the session of a recording; its id is made from the camera, the times and three of the pictures.

    Raises RecordingError where a picture cannot be read.
    """
    entries = recording.entries
    digest = hashlib.sha256(repr((recording.intrinsics, recording.depth_factor)).encode())
    digest.update(np.array([entry.stamp_s for entry in entries]).tobytes())
    for entry in (entries[0], entries[len(entries) // 2], entries[-1]):
        digest.update(recording.read(entry).colour_rgb.tobytes())
    return Session(digest.hexdigest()[:8], name, date, "recording", len(recording), recording.intrinsics)


def slam_map_of(site: Site) -> SlamMap:
    """Return the site's map. Raises SiteError where it is damaged."""
    return SlamMap.from_arrays(site.map_arrays)


def cloud_of(site: Site) -> DenseCloud:
    """Return the site's cloud."""
    points = site.cloud_points_m
    return DenseCloud(
        points, site.cloud_colours_rgb, points[:, 2] > CEILING_M, site.cloud_weights, site.cloud_view_counts,
        site.cloud_sessions,
    )  # fmt: skip


# ------------------------------------------------------------------------------------------------------ extending
def extend_site(
    site: Site,
    recording: Recording,
    session: Session,
    settings: LocalizationSettings,
    progress: Progress,
    *,
    executor: Executor | None = None,
) -> Growth:
    """Join a recording of an overlapping part of the building, or of the same part at another time, to a site.

    ``executor`` runs local mapping beside tracking, which changes the time it takes and nothing else. Raises InputError
    where it is part of the site already, RecordingError for damaged input, and MappingError, saying what to do, where
    it cannot be mapped or does not overlap.
    """
    refuse_known(site, session)
    number = len(site.sessions)
    marks = read_marks(recording.folder / "marks.txt")
    known = slam_map_of(site)
    extension = extend_map(
        known, cloud_of(site), recording, number, settings.feature_count, progress, executor=executor
    )
    slam_map = extension.joined.slam_map
    roads, road_sessions = _roads_after(site, slam_map, extension.joined.known, number)
    carried, lost = _graph_after(site, extension, marks, roads)
    grown = replace(
        with_cloud(site, extension.cloud),
        map_arrays=slam_map.to_arrays(),
        roads_m=roads,
        road_sessions=road_sessions,
        sessions=(*site.sessions, session),
        poi_graph=carried.graph,
    )
    new_road_m = length_of_roads_m([road for road, of in zip(roads, road_sessions, strict=True) if of == number])
    figures = {
        "session": session.id,
        "frames": len(recording),
        "tracked_share": round(extension.level_map.tracked_count / len(recording), 4),
        "matches": extension.joined.matches,
        "known_moved_m": round(extension.joined.known.largest_step_m, 4),
        "session_road_m": round(new_road_m, 2),
        "places_added": len(carried.graph.pois) - len(site.poi_graph.pois),
        "places_lost": ", ".join(lost),
    }
    return growth_of(grown, slam_map, figures, carried, extension)


def refuse_known(site: Site, session: Session) -> None:
    """Raise InputError or MappingError where a site cannot take a session in."""
    for there in site.sessions:
        if there.id == session.id:
            raise InputError(
                f"This is already part of the site, as session {there.id} ({there.name}): name another one, or remove"
                " that session first."
            )
    if len(site.sessions) >= MAX_SESSIONS:
        raise MappingError(f"The site has {MAX_SESSIONS} sessions, as many as it can have: remove one first.")


def _roads_after(
    site: Site, slam_map: SlamMap, known: Deformation, number: int
) -> tuple[tuple[FloatArray, ...], tuple[int, ...]]:
    """Return all roads, and the session of each: walked ones made again from the trajectory, others moved along."""
    roads: list[FloatArray] = []
    numbers: list[int] = []
    for session in range(number + 1):
        if session == number or site.sessions[session].kind == "recording":
            found: Sequence[FloatArray] = roads_of(slam_map, session)
        else:
            found = [_moved_road(known, road) for road, of in _numbered_roads(site) if of == session]
        roads += found
        numbers += [session] * len(found)
    return tuple(roads), tuple(numbers)


def _numbered_roads(site: Site) -> list[tuple[FloatArray, int]]:
    return list(zip(site.roads_m, site.road_sessions, strict=True))


def _moved_road(known: Deformation, road: FloatArray) -> FloatArray:
    moved = _moved_places(known, road[:, :2])
    return np.column_stack([moved, np.zeros(len(moved))])


def _moved_places(known: Deformation, places_m: FloatArray) -> FloatArray:
    """Return where places (n, 2) lie now."""
    standing = np.column_stack([places_m, np.full(len(places_m), _STANDING_M)])
    return known.moved(standing)[:, :2]


def _graph_after(
    site: Site, extension: MapExtension, marks: Sequence[Mark], roads: tuple[FloatArray, ...]
) -> tuple[Carried, tuple[str, ...]]:
    """Return the graph with the new places, and the names of those that nobody knows where to put."""
    joined = extension.joined
    graph = site.poi_graph
    drawn = drawn_lines_m(graph)
    drawn_now = [_moved_places(joined.known, line) for line in drawn]
    before, network = _network(site.roads_m, drawn), _network(roads, drawn_now)
    graph = msgspec.structs.replace(graph, roads=roads_with_drawn(roads, drawn_now))
    places = np.array([(poi.x_m, poi.y_m) for poi in graph.pois.values()]).reshape(-1, 2)
    moved = dict(zip(graph.pois, map(_pair, _moved_places(joined.known, places)), strict=True))
    slam_map = joined.slam_map
    own = slam_map.trajectory_session == len(site.sessions)
    walked = slam_map.trajectory_stamp_s[own], slam_map.trajectory[own, :3, 3]
    added = places_to_add(_placed(graph, moved), marks, *walked, before, network)
    return carried_over(graph, added, moved, before, network), lost_marks(marks, *walked, network)


def _pair(place: FloatArray) -> tuple[float, float]:
    return float(place[0]), float(place[1])


def _placed(graph: PoiGraph, places_m: dict[str, tuple[float, float]]) -> PoiGraph:
    pois = {key: _at(poi, places_m[key]) for key, poi in graph.pois.items()}
    return PoiGraph(graph.version, pois, graph.edges, graph.roads)


def _network(roads_m: Sequence[FloatArray], drawn_m: Sequence[FloatArray]) -> RoadNetwork:
    return RoadNetwork.from_roads(roads_m, drawn_m=drawn_m)


# ------------------------------------------------------------------------------------------------------- removing
def remove_session(site: Site, session_id: str) -> Growth:
    """Take a session out of a site: key frames, landmarks that it alone saw, roads, and points of the cloud.

    Raises InputError where there is no such session, or it is the last recording, and MappingError where what remains
    would fall apart.
    """
    number = session_number(site, session_id)
    slam_map = slam_map_of(site)
    session = site.sessions[number]
    if session.kind == "recording":
        _refuse_gap(site, slam_map, number)
        slam_map = without_key_frames(slam_map, number)
    slam_map = renumbered(slam_map, number)
    kept = [(road, of - (of > number)) for road, of in _numbered_roads(site) if of != number]
    roads = tuple(road for road, _ in kept)
    drawn = drawn_lines_m(site.poi_graph)
    graph = msgspec.structs.replace(site.poi_graph, roads=roads_with_drawn(roads, drawn))
    before, network = _network(site.roads_m, drawn), _network(roads, drawn)
    carried = carried_over(graph, {}, {}, before, network)
    left = replace(
        with_cloud(site, cloud_without_session(cloud_of(site), number)),
        map_arrays=slam_map.to_arrays(),
        roads_m=roads,
        road_sessions=tuple(of for _, of in kept),
        sessions=(*site.sessions[:number], *site.sessions[number + 1 :]),
        poi_graph=carried.graph,
    )
    return growth_of(left, slam_map, {"session": session.id}, carried)


def session_number(site: Site, session_id: str) -> int:
    """Return the number of a session. Raises InputError where there is none of this id."""
    for number, session in enumerate(site.sessions):
        if session.id == session_id:
            return number
    raise InputError(f"The site has no session {session_id!r}: `vbr map sessions` lists those that it has.")


def _refuse_gap(site: Site, slam_map: SlamMap, number: int) -> None:
    if sum(session.kind == "recording" for session in site.sessions) < 2:
        raise InputError("This is the site's only recording: build the site anew from another one instead.")
    if lonely := separated_by_removal(slam_map, number):
        names = ", ".join(f"{site.sessions[n].id} ({site.sessions[n].name})" for n in lonely)
        raise MappingError(
            f"Without this session nothing would join {names} with the rest: remove that first, or add a recording"
            " that walks from one to the other."
        )


# -------------------------------------------------------------------------------------------------------- parts
def _at(poi: Poi, place_m: tuple[float, float]) -> Poi:
    return msgspec.structs.replace(poi, x_m=place_m[0], y_m=place_m[1])


def with_cloud(site: Site, cloud: DenseCloud) -> Site:
    """Return the site with another cloud."""
    return replace(
        site,
        cloud_points_m=cloud.points_m,
        cloud_colours_rgb=cloud.colours_rgb,
        cloud_weights=cloud.weights,
        cloud_view_counts=cloud.view_counts,
        cloud_sessions=cloud.sessions,
    )


def growth_of(
    site: Site,
    slam_map: SlamMap,
    figures: dict[str, Any],
    carried: Carried,
    extension: MapExtension | None = None,
) -> Growth:
    """Return the site with its report brought up to date."""
    report = dict(site.report)
    frames = sum(session.frame_count for session in site.sessions)
    whole: dict[str, float | int | str] = {
        "frames": frames,
        "tracked_share": round(len(slam_map.trajectory_stamp_s) / frames, 4) if frames else 1.0,
        "keyframes": slam_map.keyframe_count,
        "landmarks": len(slam_map.positions),
        "road_m": round(length_of_roads_m(site.roads_m), 2),
        "cloud_points": len(site.cloud_points_m),
        "sessions": len(site.sessions),
    }
    if extension is not None:
        whole["loops_closed"] = int(report.get("loops_closed", 0)) + extension.level_map.loop_count
    whole["road_parts"] = RoadNetwork.from_roads(site.roads_m).component_count()
    names = tuple(site.poi_graph.pois[key].name for key in carried.off_road)
    return Growth(replace(site, report=report | whole), figures, names, len(carried.lost_edges))

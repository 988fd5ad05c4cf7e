"""What other programs made, brought into a site: a cloud to show, a trajectory that becomes a road.

Each import is a session of its own, so that it can be taken out again. It must be in the site's frame (metres, floor at
z = 0), as what `vbr map export` writes is. It adds nothing to localize by: that takes a recording.
"""

from __future__ import annotations

import hashlib
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from navcore.errors import InputError
from navcore.geometry import FloatArray
from navcore.planning.road_change import Carried, carried_over
from navcore.planning.road_network import RoadNetwork
from navcore.site import Site
from navcore.site_growth import Growth, cloud_of, growth_of, refuse_known, slam_map_of, with_cloud
from navcore.site_sessions import Session
from navcore.slam.cloud_joining import joined_clouds
from navcore.slam.dense_cloud import CEILING_M, VOXEL_M, DenseCloud
from navcore.slam.map_build import length_of_roads_m
from navcore.tagging import places_to_add

IMPORTED_WEIGHT = 4.0
"""An imported point counts like one measured from half a metre away: it is meant to be shown."""


def with_imported_cloud(
    site: Site, session: Session, points_m: NDArray[np.float32], colours_rgb: NDArray[np.uint8], *, replaces: bool
) -> Growth:
    """Add a cloud (n, 3) with colours (n, 3), in the site's frame, as a session of its own.

    With ``replaces`` it takes the place of the one that is shown: where a point was before, the sessions that saw it
    stay with it.
    """
    refuse_known(site, session)
    bit = np.uint64(1) << np.uint64(len(site.sessions))
    count = len(points_m)
    cloud = DenseCloud(
        points_m,
        colours_rgb,
        points_m[:, 2] > CEILING_M,
        np.full(count, IMPORTED_WEIGHT, np.float32),
        np.ones(count, np.uint16),
        np.full(count, bit, np.uint64),
    )
    known = cloud_of(site)
    shown = _with_origins(cloud, known, bit) if replaces else joined_clouds([known, cloud])
    grown = replace(with_cloud(site, shown), sessions=(*site.sessions, session))
    return growth_of(
        grown, slam_map_of(site), {"session": session.id, "points_read": count}, Carried(site.poi_graph, (), ())
    )


def _with_origins(cloud: DenseCloud, known: DenseCloud, bit: np.uint64) -> DenseCloud:
    """Return the cloud, each point with what is known of the point that was in its place."""
    if not len(known):
        return cloud
    distance_m, nearest = cKDTree(known.points_m).query(cloud.points_m)
    there = distance_m < VOXEL_M
    return replace(
        cloud,
        weights=np.where(there, known.weights[nearest], cloud.weights).astype(np.float32),
        view_counts=np.where(there, known.view_counts[nearest], cloud.view_counts).astype(np.uint16),
        sessions=np.where(there, known.sessions[nearest], bit).astype(np.uint64),
    )


def with_imported_road(site: Site, session: Session, roads_m: tuple[FloatArray, ...]) -> Growth:
    """Add roads (n, 3), in the site's frame, as a session of their own. Raises InputError where there are none."""
    refuse_known(site, session)
    if not roads_m:
        raise InputError("The trajectory leads nowhere: import one that is longer than half a metre.")
    number = len(site.sessions)
    roads = (*site.roads_m, *roads_m)
    before, network = RoadNetwork.from_roads(site.roads_m), RoadNetwork.from_roads(roads)
    nothing = np.zeros(0), np.zeros((0, 3))
    added = places_to_add(site.poi_graph, (), *nothing, before, network)
    carried = carried_over(site.poi_graph, added, {}, before, network)
    grown = replace(
        site,
        roads_m=roads,
        road_sessions=(*site.road_sessions, *([number] * len(roads_m))),
        sessions=(*site.sessions, session),
        poi_graph=carried.graph,
    )
    figures = {"session": session.id, "session_road_m": round(length_of_roads_m(roads_m), 2)}
    return growth_of(grown, slam_map_of(site), figures, carried)


def import_session(content: bytes, name: str, date: str) -> Session:
    """Return the session of something that was brought from elsewhere, by its contents."""
    return Session(hashlib.sha256(content).hexdigest()[:8], name, date, "import")

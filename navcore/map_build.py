"""From a recording to a site: visual SLAM, levelling, the virtual blind road, the cloud, and a first PoI-graph.

A composition of the stages; the same recording gives the same site, byte for byte.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator

import numpy as np

from navcore.errors import PlanningError
from navcore.geometry import FloatArray
from navcore.planning.poi_graph import PoiGraph
from navcore.planning.road_network import RoadNetwork
from navcore.recording import Mark, Recording, read_marks
from navcore.settings import LocalizationSettings
from navcore.site import Site
from navcore.slam.dense_cloud import DenseCloud, VoxelFusion
from navcore.slam.features import feature_count_for
from navcore.slam.keyframes import SlamCamera
from navcore.slam.leveling import Leveling, level
from navcore.slam.mapper import Mapper
from navcore.slam.road import arc_length, build_roads
from navcore.slam.slam_map import SlamMap
from navcore.tagging import graph_from_marks
from navcore.types import Frame

Progress = Callable[[str, int, int], None]
"""Called with what is being done, how much of it is done, and how much there is."""

DEPTH_BASELINE_PX_M = 40.0
"""Focal length times the virtual baseline of the depth camera (ORB-SLAM2's setting for these cameras)."""
_LEVELLING_VIEWS = 100
_TRACKING, _CLOSING, _CLOUD = "Tracking and mapping", "Closing loops", "Fusing the cloud"


def build_site(
    recording: Recording,
    site_id: str,
    name: str,
    settings: LocalizationSettings,
    progress: Progress = lambda what, done, total: None,
    frames: Iterable[Frame] | None = None,
) -> Site:
    """Build the site of a recording.

    ``frames`` are the recording's frames in order, for a caller that reads them as they are written; by default they
    are read from its folder. Raises RecordingError for a damaged recording, MappingError where it cannot be mapped.
    """
    intrinsics = recording.intrinsics
    count = feature_count_for(intrinsics.width_px, intrinsics.height_px, settings.feature_count)
    mapper = Mapper(intrinsics, SlamCamera.of(intrinsics, DEPTH_BASELINE_PX_M), count)
    tracked = 0
    for done, frame in enumerate(recording.frames() if frames is None else frames, 1):
        tracked += mapper.add(frame)
        progress(_TRACKING, done, len(recording))
    progress(_CLOSING, 0, 1)
    slam_map = mapper.finish()
    progress(_CLOSING, 1, 1)
    levelling = _levelled(recording, slam_map)
    slam_map = slam_map.transformed(levelling.level_from_map.matrix)
    cloud = _cloud(recording, slam_map, progress)
    positions_m = slam_map.trajectory[:, :3, 3]
    roads = build_roads(slam_map.trajectory_stamp_s, positions_m)
    return Site(
        site_id=site_id,
        name=name,
        intrinsics=intrinsics,
        map_arrays=slam_map.to_arrays(),
        roads_m=roads,
        cloud_points_m=cloud.points_m,
        cloud_colours_rgb=cloud.colours_rgb,
        poi_graph=_first_graph(
            read_marks(recording.folder / "marks.txt"), slam_map.trajectory_stamp_s, positions_m, roads
        ),
        report={
            "frames": len(recording),
            "tracked_frames": tracked,
            "keyframes": slam_map.keyframe_count,
            "landmarks": len(slam_map.positions),
            "loops_closed": len(slam_map.loop_edges),
            "road_length_m": round(sum(float(arc_length(road)[-1]) for road in roads), 2),
            "cloud_points": len(cloud),
            "levelling": levelling.note,
        },
    )


def _keyframe_views(recording: Recording, slam_map: SlamMap, step: int = 1) -> Iterator[tuple[Frame, FloatArray]]:
    """Yield the frames that became key frames, with their ``world_from_camera`` (4, 4)."""
    entries = {entry.stamp_s: entry for entry in recording.entries}
    for index in range(0, slam_map.keyframe_count, step):
        entry = entries[float(slam_map.keyframe_stamp_s[index])]
        yield recording.read(entry), np.linalg.inv(slam_map.camera_from_world[index])


def _levelled(recording: Recording, slam_map: SlamMap) -> Leveling:
    camera = recording.intrinsics
    step = max(slam_map.keyframe_count // _LEVELLING_VIEWS, 1)
    views = ((frame.depth_m, pose) for frame, pose in _keyframe_views(recording, slam_map, step))
    return level(views, camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px)


def _cloud(recording: Recording, slam_map: SlamMap, progress: Progress) -> DenseCloud:
    fusion = VoxelFusion(recording.intrinsics)
    for done, (frame, world_from_camera) in enumerate(_keyframe_views(recording, slam_map), 1):
        fusion.add(frame.colour_rgb, frame.depth_m, world_from_camera)
        progress(_CLOUD, done, slam_map.keyframe_count)
    return fusion.cloud()


def _first_graph(
    marks: tuple[Mark, ...], stamps_s: FloatArray, positions_m: FloatArray, roads: tuple[FloatArray, ...]
) -> PoiGraph:
    if not marks or not roads:
        return PoiGraph()
    try:
        return graph_from_marks(marks, stamps_s, positions_m, RoadNetwork.from_roads(roads))
    except PlanningError:
        # A road that is no network yet can still be tagged by hand.
        return PoiGraph()

"""A site whose form is real, and whose map is too small to be found in; and a walk of which another one is built."""

from __future__ import annotations

import functools
import tempfile
from pathlib import Path

import numpy as np

from device_agent.simulation.sensors import head_camera
from navcore.live_recording import LiveRecording
from navcore.planning.poi_graph import Edge, Poi, PoiGraph
from navcore.recording_archive import RecordingArchive
from navcore.site import Site
from navcore.types import CameraIntrinsics, Frame

MAP_WALK_NAME = "painted-wall"
_FRAMES_COUNT = 12
_STEP_PX = 8
_WALL_M = 2.0


def small_site() -> Site:
    """Return a site of a few points, two places and a road."""
    rng = np.random.default_rng(3)
    road = np.stack([np.linspace(0.0, 6.0, 61), np.zeros(61), np.full(61, 1.6)], axis=1)
    graph = PoiGraph(
        version=1,
        pois={"a": Poi("a", "Hall", "hall", 0.0, 0.0), "b": Poi("b", "Bar", "bar", 6.0, 0.0)},
        edges={"a-b": Edge("a-b", "a", "b", ((0.0, 0.0), (6.0, 0.0)), 6.0)},
    )
    return Site(
        site_id="small", name="Small site", intrinsics=CameraIntrinsics(320, 240, 230.0, 230.0, 160.0, 120.0),
        map_arrays={
            "keyframe_poses": np.tile(np.eye(4), (2, 1, 1)), "descriptors": rng.integers(0, 256, (5, 32), np.uint8)
        },
        roads_m=(road,), cloud_points_m=rng.normal(size=(50, 3)).astype(np.float32),
        cloud_colours_rgb=rng.integers(0, 256, (50, 3)).astype(np.uint8), poi_graph=graph, report={"keyframes": 2},
    )  # fmt: skip


@functools.cache
def small_map_walk() -> bytes:
    """Return a map walk as it is sent: a step along a painted wall, of which a map is built in two seconds."""
    camera = head_camera()
    wall = np.random.default_rng(1).integers(0, 256, (60, 120, 3)).astype(np.uint8).repeat(6, 0).repeat(6, 1)
    depth_m = np.full((camera.height_px, camera.width_px), _WALL_M, np.float32)
    with tempfile.TemporaryDirectory() as folder:
        recording = LiveRecording(Path(folder) / "walk", camera)
        for number in range(_FRAMES_COUNT):
            left_px = number * _STEP_PX
            seen = wall[: camera.height_px, left_px : left_px + camera.width_px]
            recording.add(Frame(number / 10.0, np.ascontiguousarray(seen), depth_m))
        recording.close()
        archive = RecordingArchive(Path(folder) / "walk")
        return archive.read(0, archive.size_bytes)

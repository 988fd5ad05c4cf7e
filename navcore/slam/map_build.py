"""From a recording to everything that a site holds of it: map, road and cloud, in the level frame."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from navcore.errors import MappingError
from navcore.geometry import FloatArray
from navcore.recording import RecordedFrame, Recording
from navcore.slam.dense_cloud import DenseCloud, VoxelFusion
from navcore.slam.features import feature_count_for
from navcore.slam.keyframes import SlamCamera
from navcore.slam.leveling import Leveling, level
from navcore.slam.mapper import Mapper
from navcore.slam.road import build_roads
from navcore.slam.slam_map import SlamMap
from navcore.types import Frame

Progress = Callable[[float, str], None]
"""Called with the share that is done (0–1) and what is being done."""

BF_PX_M = 100.0
"""Focal length times virtual baseline. A depth z counts as measured to z²/100 m at the finest pyramid level, several
times less well than a structured-light sensor does on a wall: at edges it errs by far more than its noise."""
MIN_FRAMES = 10
"""A shorter recording makes no map."""
LEVELLING_VIEWS = 100
"""Key frames from which up, floor and walls are read, at most."""
CLOUD_VIEWS = 400
"""Key frames that are fused into the cloud, at most."""
_TRACKING_SHARE, _FINISHED_SHARE, _LEVELLED_SHARE = 0.82, 0.92, 0.94


@dataclass(frozen=True, slots=True, eq=False)
class MapBuild:
    """What was made of a recording."""

    slam_map: SlamMap
    """In the level frame: floor at z = 0, z up."""
    roads_m: tuple[FloatArray, ...]
    """The virtual blind road: polylines (n, 3)."""
    cloud: DenseCloud
    leveling: Leveling
    frame_count: int
    tracked_count: int
    loop_count: int
    """Loops that were closed."""

    @property
    def tracked_share(self) -> float:
        """Share of the frames that were followed, 0–1."""
        return self.tracked_count / self.frame_count

    @property
    def road_length_m(self) -> float:
        """Length of all roads."""
        return float(sum(np.linalg.norm(np.diff(road[:, :2], axis=0), axis=1).sum() for road in self.roads_m))


def build_map(recording: Recording, reference_feature_count: int, progress: Progress) -> MapBuild:
    """Build the map of a recording. The same recording gives the same map.

    ``reference_feature_count`` is the number of features at 320×240. Raises RecordingError for damaged images and
    MappingError where the camera could not be followed, with advice.
    """
    if len(recording) < MIN_FRAMES:
        raise MappingError(
            f"{recording.folder} has only {len(recording)} frames: record a walk of at least a few seconds."
        )
    intrinsics = recording.intrinsics
    count = feature_count_for(intrinsics.width_px, intrinsics.height_px, reference_feature_count)
    mapper = Mapper(intrinsics, SlamCamera.of(intrinsics, BF_PX_M), count)
    for number, frame in enumerate(recording.frames()):
        mapper.add(frame)
        text = f"Mapping: {mapper.keyframe_count} key frames, {mapper.landmark_count} landmarks"
        progress(_TRACKING_SHARE * (number + 1) / len(recording), text)
    progress(_TRACKING_SHARE, "Closing loops and adjusting the whole map")
    slam_map = mapper.finish()
    progress(_FINISHED_SHARE, "Finding the floor")
    views = _Views(recording, slam_map)
    leveling = level(
        ((frame.depth_m, pose) for frame, pose in views.some(LEVELLING_VIEWS)),
        intrinsics.fx_px,
        intrinsics.fy_px,
        intrinsics.cx_px,
        intrinsics.cy_px,
    )
    slam_map = slam_map.transformed(leveling.level_from_map.matrix)
    cloud = _cloud(recording, slam_map, progress)
    roads = build_roads(slam_map.trajectory_stamp_s, slam_map.trajectory[:, :3, 3])
    return MapBuild(
        slam_map,
        roads,
        cloud,
        leveling,
        len(recording),
        len(slam_map.trajectory_stamp_s),
        mapper.loop_count,
    )


def _cloud(recording: Recording, slam_map: SlamMap, progress: Progress) -> DenseCloud:
    fusion = VoxelFusion(recording.intrinsics)
    views = _Views(recording, slam_map)
    total = min(CLOUD_VIEWS, slam_map.keyframe_count)
    for number, (frame, level_from_camera) in enumerate(views.some(CLOUD_VIEWS)):
        fusion.add(frame.colour_rgb, frame.depth_m, level_from_camera)
        progress(_LEVELLED_SHARE + (1 - _LEVELLED_SHARE) * (number + 1) / total, "Fusing the coloured cloud")
    return fusion.cloud()


class _Views:
    """The images of key frames, read again from the recording."""

    def __init__(self, recording: Recording, slam_map: SlamMap) -> None:
        self._recording = recording
        self._slam_map = slam_map
        self._entries: dict[float, RecordedFrame] = {entry.stamp_s: entry for entry in recording.entries}

    def some(self, count: int) -> Iterator[tuple[Frame, FloatArray]]:
        """Yield up to ``count`` key frames, evenly chosen, with their world_from_camera (4, 4)."""
        total = self._slam_map.keyframe_count
        for k in np.unique(np.linspace(0, total - 1, min(count, total)).round().astype(int)).tolist():
            frame = self._recording.read(self._entries[float(self._slam_map.keyframe_stamp_s[k])])
            yield frame, np.linalg.inv(self._slam_map.camera_from_world[k])

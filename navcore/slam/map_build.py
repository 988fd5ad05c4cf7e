"""From a recording to everything that a site holds of it: map, road and cloud, in the level frame.

A site grows by further recordings: each is mapped by itself and joined to what is there (:func:`extend_map`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace

import numpy as np

from navcore.errors import MappingError
from navcore.geometry import FloatArray
from navcore.recording import RecordedFrame, Recording
from navcore.slam.cloud_joining import joined_clouds
from navcore.slam.dense_cloud import DenseCloud, VoxelFusion
from navcore.slam.features import feature_count_for
from navcore.slam.joining import Joined, join
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
class LevelMap:
    """The map of one recording, by itself."""

    slam_map: SlamMap
    """In the level frame: floor at z = 0, z up."""
    leveling: Leveling
    frame_count: int
    loop_count: int
    """Loops that were closed."""

    @property
    def tracked_count(self) -> int:
        """Frames that were followed."""
        return len(self.slam_map.trajectory_stamp_s)


@dataclass(frozen=True, slots=True, eq=False)
class MapBuild:
    """What was made of a recording."""

    level_map: LevelMap
    roads_m: tuple[FloatArray, ...]
    """The virtual blind road: polylines (n, 3)."""
    cloud: DenseCloud

    @property
    def slam_map(self) -> SlamMap:
        """In the level frame: floor at z = 0, z up."""
        return self.level_map.slam_map

    @property
    def tracked_share(self) -> float:
        """Share of the frames that were followed, 0–1."""
        return self.level_map.tracked_count / self.level_map.frame_count

    @property
    def road_length_m(self) -> float:
        """Length of all roads."""
        return length_of_roads_m(self.roads_m)


@dataclass(frozen=True, slots=True, eq=False)
class MapExtension:
    """What became of a map with another recording."""

    joined: Joined
    level_map: LevelMap
    """The new recording's map, by itself."""
    cloud: DenseCloud
    """Of all recordings."""


def length_of_roads_m(roads_m: Sequence[FloatArray]) -> float:
    """Return the length of all roads (n, 3) together, passes of the same corridor each counted."""
    return float(sum(np.linalg.norm(np.diff(road[:, :2], axis=0), axis=1).sum() for road in roads_m))


def build_map(
    recording: Recording, reference_feature_count: int, progress: Progress, *, executor: Executor | None = None
) -> MapBuild:
    """Build the map of a recording. The same recording gives the same map.

    ``reference_feature_count`` is the number of features at 320×240. ``executor`` runs local mapping beside tracking,
    which changes the time it takes and nothing else. Raises RecordingError for damaged images and
    MappingError where the camera could not be followed, with advice.
    """
    level_map = build_level_map(recording, reference_feature_count, progress, executor=executor)
    cloud = _fused(recording, level_map.slam_map, 0, progress).cloud()
    return MapBuild(level_map, roads_of(level_map.slam_map, 0), cloud)


def extend_map(
    known: SlamMap,
    known_cloud: DenseCloud,
    recording: Recording,
    session: int,
    reference_feature_count: int,
    progress: Progress,
    *,
    executor: Executor | None = None,
) -> MapExtension:
    """Build the map of another recording and join it to a known one, as its recording number ``session``.

    Raises RecordingError for damaged images, and MappingError where the camera could not be followed or the two maps
    cannot be laid upon each other, with advice.
    """
    level_map = build_level_map(recording, reference_feature_count, progress, executor=executor)
    progress(_LEVELLED_SHARE, "Finding where the recording lies in the map")
    joined = join(known, level_map.slam_map, session)
    fusion = _fused(recording, joined.slam_map, session, progress)
    return MapExtension(joined, level_map, _with_moved(known_cloud, joined, fusion))


def _with_moved(known_cloud: DenseCloud, joined: Joined, fusion: VoxelFusion) -> DenseCloud:
    """Return the known cloud, moved along with its map, and the new one; what the new views look through is gone."""
    moved = replace(
        known_cloud, points_m=joined.known.moved(known_cloud.points_m.astype(np.float64)).astype(np.float32)
    )
    gone = fusion.looks_through(moved.points_m.astype(np.float64), moved.view_counts.astype(np.float64))
    return joined_clouds([moved.chosen(~gone), fusion.cloud()])


def roads_of(slam_map: SlamMap, session: int) -> tuple[FloatArray, ...]:
    """Return the roads (n, 3) that were walked in one recording of a level map."""
    walked = slam_map.trajectory_session == session
    return build_roads(slam_map.trajectory_stamp_s[walked], slam_map.trajectory[walked, :3, 3])


def build_level_map(
    recording: Recording, reference_feature_count: int, progress: Progress, *, executor: Executor | None = None
) -> LevelMap:
    """Build the map of a recording by itself, and level it. Raises RecordingError and MappingError."""
    if len(recording) < MIN_FRAMES:
        raise MappingError(
            f"{recording.folder} has only {len(recording)} frames: record a walk of at least a few seconds."
        )
    intrinsics = recording.intrinsics
    count = feature_count_for(intrinsics.width_px, intrinsics.height_px, reference_feature_count)
    mapper = Mapper(intrinsics, SlamCamera.of(intrinsics, BF_PX_M), count, executor=executor)
    for number, frame in enumerate(recording.frames()):
        mapper.add(frame)
        text = f"Mapping: {mapper.keyframe_count} key frames, {mapper.landmark_count} landmarks"
        progress(_TRACKING_SHARE * (number + 1) / len(recording), text)
    progress(_TRACKING_SHARE, "Closing loops and adjusting the whole map")
    slam_map = mapper.finish()
    progress(_FINISHED_SHARE, "Finding the floor")
    views = _Views(recording, slam_map, 0)
    leveling = level(
        ((frame.depth_m, pose) for frame, pose in views.some(LEVELLING_VIEWS)),
        intrinsics.fx_px,
        intrinsics.fy_px,
        intrinsics.cx_px,
        intrinsics.cy_px,
    )
    return LevelMap(slam_map.transformed(leveling.level_from_map.matrix), leveling, len(recording), mapper.loop_count)


def _fused(recording: Recording, slam_map: SlamMap, session: int, progress: Progress) -> VoxelFusion:
    fusion = VoxelFusion(recording.intrinsics, session=session)
    views = _Views(recording, slam_map, session)
    total = min(CLOUD_VIEWS, len(views))
    for number, (frame, level_from_camera) in enumerate(views.some(CLOUD_VIEWS)):
        fusion.add(frame.colour_rgb, frame.depth_m, level_from_camera)
        progress(_LEVELLED_SHARE + (1 - _LEVELLED_SHARE) * (number + 1) / total, "Fusing the coloured cloud")
    return fusion


class _Views:
    """The images of a recording's key frames, read again from it."""

    def __init__(self, recording: Recording, slam_map: SlamMap, session: int) -> None:
        self._recording = recording
        self._slam_map = slam_map
        self._keyframes = np.flatnonzero(slam_map.keyframe_session == session)
        self._entries: dict[float, RecordedFrame] = {entry.stamp_s: entry for entry in recording.entries}

    def __len__(self) -> int:
        return len(self._keyframes)

    def some(self, count: int) -> Iterator[tuple[Frame, FloatArray]]:
        """Yield up to ``count`` key frames, evenly chosen, with their world_from_camera (4, 4)."""
        total = len(self)
        places = np.unique(np.linspace(0, total - 1, min(count, total)).round().astype(int))
        for k in self._keyframes[places].tolist():
            frame = self._recording.read(self._entries[float(self._slam_map.keyframe_stamp_s[k])])
            yield frame, np.linalg.inv(self._slam_map.camera_from_world[k])

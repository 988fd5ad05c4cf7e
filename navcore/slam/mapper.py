"""Building the map, one frame after the other.

:class:`Mapper` takes frames and closes the map with ``finish``; the same recording gives the same map, also where local
mapping runs beside tracking (see :mod:`navcore.slam.local_mapping`). What a frame leaves is its pose relative to a key
frame, so that the whole trajectory follows when key frames are moved by loop closing and adjustment.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace

import numpy as np

from navcore.errors import MappingError
from navcore.frame_check import check_frame, with_known_depth
from navcore.geometry import FloatArray
from navcore.slam import anchoring, mapping
from navcore.slam.blind_steps import BlindSteps
from navcore.slam.depth_mapping import KEYFRAME_OVERLAP, MAX_BLIND_S, MIN_TRACKED, DepthCarrier
from navcore.slam.depth_tracking import Carried, DepthView
from navcore.slam.features import FeatureExtractor, grey_of
from navcore.slam.freezing import freeze
from navcore.slam.keyframes import NO_LANDMARK, Features, IntArray, SlamCamera
from navcore.slam.lie import inverse_se3
from navcore.slam.local_mapping import LocalMapping
from navcore.slam.loop_closing import DRIFT_OF_A_WALK, DriftGate, LoopCloser
from navcore.slam.map import MapBuilder
from navcore.slam.map_evidence import evidence_for
from navcore.slam.pace import Pace
from navcore.slam.pose_factor import PoseFactor
from navcore.slam.pose_uncertainty import is_reachable, is_walkable
from navcore.slam.relocalization import relocalize
from navcore.slam.rolling_shutter import KEPT_SHARE, MIN_READOUT_S, sorted_anew, unrolled
from navcore.slam.self_similarity import is_firm, is_sparse, undisputed
from navcore.slam.slam_map import SlamMap
from navcore.slam.tracking import (
    FrameMatch,
    Track,
    extend_by_map,
    local_keyframes,
    local_landmarks,
    match_last_frame,
    moved,
    predict_pose,
    seen_again,
    track_last_frame,
    velocity_of,
)
from navcore.types import CameraIntrinsics, Frame

MIN_START_POINTS = 100
"""Features with depth that the first frame needs."""
MIN_TRACKED_FRAMES = 5
"""A map needs so many tracked frames."""
CLOSE_DEPTH_M = 3.5
"""Nearer points fix the translation well: a key frame is due when many of them are not in the map."""
KEYFRAME_RATIO = 0.75
"""A key frame is due when fewer landmarks are tracked than this share of the most since the last one."""
MAX_KEYFRAME_INTERVAL_S = 3.0
"""A key frame is due after this time, where the camera moved."""
MAX_HELD_FRAMES = 3000
"""Frames of a continued recording that wait, at most, until its place in the map is found; older ones are dropped."""


@dataclass(frozen=True, slots=True, eq=False)
class FramePose:
    """Where a frame was: relative to a key frame, or nowhere (``reference`` −1)."""

    stamp_s: float
    reference: int
    camera_from_reference: FloatArray


@dataclass(frozen=True, slots=True)
class Followed:
    """How well the last frame was followed."""

    tracked: bool
    landmark_count: int
    """Landmarks that agree with its pose."""
    is_fixed: bool
    """Something seen fixes the pose in every direction."""


class Mapper:
    """Builds a map from frames in the order of their stamps.

    ``executor`` runs local mapping beside tracking, in line where None; ``max_drift`` bounds what a loop may correct.
    Between two frames the map may be at work: read counts and poses here, and ``builder`` after :meth:`settle`.
    """

    def __init__(
        self,
        intrinsics: CameraIntrinsics,
        camera: SlamCamera,
        feature_count: int,
        *,
        executor: Executor | None = None,
        max_drift: DriftGate = DRIFT_OF_A_WALK,
    ) -> None:
        self._begin(MapBuilder(camera, feature_count), intrinsics, camera, feature_count, executor, max_drift)

    def _begin(
        self,
        builder: MapBuilder,
        intrinsics: CameraIntrinsics,
        camera: SlamCamera,
        feature_count: int,
        executor: Executor | None,
        max_drift: DriftGate,
    ) -> None:
        self.intrinsics = intrinsics
        self.builder = builder
        self.frame_poses: list[FramePose] = []
        self.dropped_count = 0
        """Frames that were given up because the recording's place in the map was not found in time."""
        self._earlier_count = 0
        self._held: list[tuple[float, Features, DepthView]] = []
        self._cold: Track | None = None
        self._extractor = FeatureExtractor(intrinsics, camera, feature_count)
        self._closer = LoopCloser(self.builder, max_drift=max_drift)
        self._local = LocalMapping(self.builder, self._closer, executor)
        self._depth = DepthCarrier(self.builder)
        self._pace = Pace()
        self._is_fixed = True
        self._blind = BlindSteps()
        self._carried: Carried | None = None
        self._last_stamp_s: float | None = None
        self._last: Track | None = None
        self._before_last: Track | None = None
        self._velocity = np.zeros(6)
        self._reference = -1
        self._most_tracked = 0
        self._last_keyframe_s = 0.0
        self._counts = (0, 0, 0)

    @classmethod
    def continuing(
        cls,
        builder: MapBuilder,
        intrinsics: CameraIntrinsics,
        camera: SlamCamera,
        feature_count: int,
        *,
        earlier: Sequence[FramePose] = (),
        executor: Executor | None = None,
        max_drift: DriftGate = DRIFT_OF_A_WALK,
    ) -> Mapper:
        """Return a mapper that adds another recording to a map.

        Frames wait (``held_count``) until two of them were located independently in the map; those before are then
        followed backwards from there. ``earlier`` frames of the map move along with their key frames and come back in
        the trajectory. Raises MappingError where the map was made with another camera or holds no key frame.
        """
        if builder.camera != camera:
            raise MappingError(
                "The map was recorded with another camera: continue it with the camera it was made with."
            )
        if not builder.keyframe_alive.any():
            raise MappingError("The map holds no key frame: build it anew from its recording.")
        mapper = cls.__new__(cls)
        mapper._begin(builder, intrinsics, camera, feature_count, executor, max_drift)
        mapper._count()
        mapper.frame_poses += earlier
        mapper._earlier_count = len(earlier)
        return mapper

    @property
    def is_anchored(self) -> bool:
        """Whether the place of this recording in the map is known; for a new map, whether it has begun."""
        return self._reference >= 0

    @property
    def held_count(self) -> int:
        """Frames that wait for the place of this recording in the map."""
        return len(self._held)

    @property
    def world_from_camera(self) -> FloatArray:
        """(4, 4): where the last tracked frame is, as far as is known now. Raises MappingError before the first."""
        if self._last is None:
            raise MappingError("No frame has been followed yet: give frames with texture and depth.")
        return inverse_se3(self._last.camera_from_world)

    @property
    def followed(self) -> Followed:
        """How well the last frame was followed."""
        tracked = bool(self.frame_poses) and self.frame_poses[-1].reference >= 0
        count = self._last.inlier_count if tracked and self._last is not None else 0
        return Followed(tracked, count, tracked and self._is_fixed)

    @property
    def keyframe_count(self) -> int:
        """Key frames that live, as of the last settled one."""
        return self._counts[0]

    @property
    def landmark_count(self) -> int:
        """Landmarks that live, as of the last settled key frame."""
        return self._counts[1]

    @property
    def loop_count(self) -> int:
        """Loops that were closed, as of the last settled key frame."""
        return self._counts[2]

    def add(self, frame: Frame) -> bool:
        """Track a frame, and extend the map where it is due. Return whether the frame was tracked.

        Raises SensorError, with what to do, for a frame without a finite stamp, not later than the one before, or of
        another size than the camera's; the map stays as it was. Depth that is no finite distance above zero is unknown.
        """
        check_frame(frame, self.intrinsics, self._last_stamp_s)
        frame, self._last_stamp_s = with_known_depth(frame), frame.stamp_s
        image = grey_of(frame.colour_rgb)
        features = self._extractor.extract_grey(image, frame.depth_m)
        self.settle()
        features = self._unrolled_as_expected(features)
        depth = DepthView(self.builder.camera, frame.depth_m, image=image)
        if not self.builder.keyframes:
            return self._start(frame.stamp_s, features, depth)
        if self._reference < 0:
            return self._anchor(frame.stamp_s, features, depth)
        return self._follow(frame.stamp_s, features, depth)

    def _follow(self, stamp_s: float, features: Features, depth: DepthView) -> bool:
        track = self._track(stamp_s, features, depth)
        if track is None or not self._is_fixed:
            track = self._found_again(stamp_s, features, depth, track)
        if track is None:
            self._before_last = None
            self.frame_poses.append(FramePose(stamp_s, -1, np.eye(4)))
            return False
        track = self._unrolled_as_found(track)
        self._note_blind(track)
        if self._is_keyframe_due(track):
            self._insert_keyframe(track, depth)
            camera_from_reference = np.eye(4)
        else:
            camera_from_reference = track.camera_from_world @ inverse_se3(self.builder.pose_of(self._reference))
        self.frame_poses.append(FramePose(stamp_s, self._reference, camera_from_reference))
        self._before_last, self._last = (self._last if self._was_tracked() else None), track
        return True

    def _note_blind(self, track: Track) -> None:
        """Remember along what nothing seen has led to a frame."""
        assert self._last is not None
        is_open = self._carried is not None and not self._is_fixed
        free = self._carried.alignment.free_directions if self._carried is not None and is_open else np.zeros((0, 6))
        self._blind.note(track.camera_from_world, track.stamp_s - self._last.stamp_s, free)

    def _unrolled_as_expected(self, features: Features) -> Features:
        """Return features unrolled as if the camera kept its velocity, sorted by where they are then."""
        camera = self.builder.camera
        velocity = np.zeros(6) if self._last is None else velocity_of(self._last, self._before_last)
        return sorted_anew(unrolled(features, velocity, self.builder.readout.seconds, camera), camera)[0]

    def _unrolled_as_found(self, track: Track) -> Track:
        """Return a track unrolled with the velocity that its pose tells, and its pose refined once more.

        Where surfaces have part in the pose, it stays as it is: landmarks alone would lead it astray.
        """
        last, camera = self._last, self.builder.camera
        if last is None:
            return track
        self._velocity = velocity_of(track, last)
        self._tell_first(last.stamp_s)
        readout_s = self.builder.readout.seconds
        features = unrolled(track.features, self._velocity, readout_s, camera)
        if self._carried is not None or is_sparse(track) or abs(readout_s) < MIN_READOUT_S:
            return replace(track, features=features)
        again = seen_again(self.builder, track, features)
        return again if again.inlier_count >= KEPT_SHARE * track.inlier_count else track

    def _tell_first(self, stamp_s: float) -> None:
        """Tell a key frame that nothing led to how fast the camera was: what led from it to the next frame says it."""
        newest = self.builder.keyframes[-1]
        if newest.velocity is None and newest.stamp_s == stamp_s:
            self.builder.unroll(newest.index, self._velocity)

    def settle(self) -> None:
        """Wait for local mapping; afterwards ``builder`` is at rest until the next frame."""
        settled = self._local.settle()
        if settled is None:
            return
        before, self._last = self._last, self._track_of(settled.keyframe)
        if before is not None and self._before_last is not None:
            # The map has moved the camera, not its velocity.
            step = inverse_se3(before.camera_from_world) @ self._last.camera_from_world
            self._before_last = moved(self._before_last, self._before_last.camera_from_world @ step)
        if settled.has_closed_loop:
            # The map has moved under the camera; its velocity is to be learned anew.
            self._before_last = None
            self._pace.forget()
        self._count()

    def _count(self) -> None:
        builder = self.builder
        alive = int(np.count_nonzero(builder.keyframe_alive)), int(np.count_nonzero(builder.landmark_alive))
        self._counts = (*alive, len(self._closer.closures))

    def _was_tracked(self) -> bool:
        return len(self.frame_poses) >= 2 and self.frame_poses[-2].reference >= 0

    # ------------------------------------------------------------------------------------------- continuing
    def _anchor(self, stamp_s: float, features: Features, depth: DepthView) -> bool:
        """Look for a frame in the map that is continued; once two agree, follow the recording from there both ways."""
        candidates = self._closer.alike(features.descriptors, anchoring.CANDIDATES)
        found = anchoring.locate_cold(self.builder, stamp_s, features, candidates)
        confirmed = found is not None and self._cold is not None and anchoring.agree(self.builder, self._cold, found)
        self._cold = found
        if found is None or not confirmed:
            self._held.append((stamp_s, features, depth.reduced()))
            if len(self._held) > MAX_HELD_FRAMES:
                self._held.pop(0)
                self.dropped_count += 1
            return False
        self._insert_keyframe(found, depth)
        self._last = found
        self.settle()
        anchor = self._reference
        self.frame_poses.append(FramePose(stamp_s, anchor, np.eye(4)))
        self._follow_backwards()
        self._reference, self._last_keyframe_s, self._most_tracked = anchor, stamp_s, 0
        self._before_last, self._last = None, self._track_of(anchor)
        return True

    def _follow_backwards(self) -> None:
        held, self._held, self._cold = self._held, [], None
        for stamp_s, features, depth in reversed(held):
            self._follow(stamp_s, features, depth)
            self.settle()

    # --------------------------------------------------------------------------------------------- tracking
    def _start(self, stamp_s: float, features: Features, depth: DepthView) -> bool:
        near = np.nan_to_num(features.depth_m, nan=np.inf) < mapping.MAX_LANDMARK_DEPTH_M
        if np.count_nonzero(near) < MIN_START_POINTS and not depth.is_structured:
            self.frame_poses.append(FramePose(stamp_s, -1, np.eye(4)))
            return False
        index = self.builder.add_keyframe(stamp_s, features, np.eye(4), np.full(len(features), -1, np.int32))
        mapping.add_landmarks_from_depth(self.builder, index)
        self._depth.keep(index, depth)
        self._reference, self._last_keyframe_s = index, stamp_s
        self._last = self._track_of(index)
        self.frame_poses.append(FramePose(stamp_s, index, np.eye(4)))
        self._count()
        return True

    def _track_of(self, keyframe: int) -> Track:
        held = self.builder.keyframes[keyframe]
        return Track(
            held.stamp_s,
            held.features,
            self.builder.camera_from_world[keyframe].copy(),
            self.builder.landmark_of[keyframe, : len(held.features)].copy(),
            np.zeros((6, 6)),
        )

    def _track(self, stamp_s: float, features: Features, depth: DepthView) -> Track | None:
        assert self._last is not None
        guess = self._predicted(stamp_s)
        found = track_last_frame(self.builder, self._last, features, stamp_s, guess)
        if found is not None and not is_walkable(self._last, found.track):
            found = None
        self._carried = None if found is not None else self._carry(stamp_s, depth, guess)
        if found is None and (self._carried is None or not self._carried.is_complete):
            found = self._relocalized(stamp_s, features, depth)
            if found is not None:
                self._carried = None
            elif self._carried is None:
                return None
        return self._track_by_map(stamp_s, features, depth, found)

    def _predicted(self, stamp_s: float) -> FloatArray:
        """Return where the motion model has a frame: steps that were not fixed by anything seen are not repeated."""
        assert self._last is not None
        guess = predict_pose(self._last, self._before_last, stamp_s)
        if self._is_fixed:
            return guess
        return self._pace.carried_on(self._last.camera_from_world, stamp_s - self._last.stamp_s, guess[:3, :3])

    def _found_again(
        self, stamp_s: float, features: Features, depth: DepthView, carried_on: Track | None
    ) -> Track | None:
        """Look around the latest key frames for a frame that was not followed, or only ``carried_on``."""
        found = self._relocalized(stamp_s, features, depth)
        if found is None:
            return carried_on
        before = self._carried, self._reference
        self._carried = None
        track = self._track_by_map(stamp_s, features, depth, found)
        if track is not None and self._is_fixed:
            return track
        self._carried, self._reference = before
        self._is_fixed = False
        return carried_on

    def _relocalized(self, stamp_s: float, features: Features, depth: DepthView) -> FrameMatch | None:
        found = relocalize(self.builder, features, stamp_s, self._recent_keyframes(), MIN_TRACKED)
        return found if found is not None and self._is_believable(stamp_s, found, depth) else None

    def _is_believable(self, stamp_s: float, found: FrameMatch, depth: DepthView) -> bool:
        """Tell whether a place that was found again is this one: it can be reached, and after a while it must convince.

        Bare corridors look alike from lamp to lamp, and one's mouth like another's.
        """
        assert self._last is not None
        if not is_reachable(self._last, found.track):
            return False
        if abs(stamp_s - self._last.stamp_s) <= MAX_BLIND_S or depth.depth_m is None:
            return True
        around = local_landmarks(self.builder, local_keyframes(self.builder, found.track.landmarks))
        return evidence_for(self.builder, found.track, around, depth.depth_m).is_convincing

    def _track_by_map(
        self, stamp_s: float, features: Features, depth: DepthView, found: FrameMatch | None
    ) -> Track | None:
        """Look for the map's landmarks around a pose found by matches, by depth, or by both."""
        near = self._unmatched(stamp_s, features) if found is None else found.track
        found, expected = self._extended(near)
        if self._carried is None and is_sparse(found.track):
            self._carried = self._carried_beside(stamp_s, depth, near, found.track)
            if self._carried is not None:
                found, expected = self._extended(near)
        carried = self._carried
        is_fixed = carried is not None and carried.is_complete
        if carried is None:
            is_fixed = found.landmark_count >= MIN_TRACKED and is_firm(found.track.information)
        elif not carried.is_complete:
            distinct = self._distinct(near, found, carried)
            is_fixed = distinct is not None
            found = distinct or FrameMatch(self._unmatched(stamp_s, features), 0, 0)
        self.builder.visible[expected] += 1
        self.builder.found[found.track.landmarks] += 1
        is_seen = found.landmark_count >= MIN_TRACKED
        self._is_fixed = is_fixed
        if is_fixed:
            self._pace.note(stamp_s, found.track.camera_from_world)
        if not self._depth.note(stamp_s, is_fixed) or not (is_seen or carried is not None):
            return None
        if is_seen:
            seeing, _ = self.builder.keyframes_seeing(found.track.landmarks)
            self._reference = int(seeing[0])
        elif carried is not None:
            self._reference = carried.reference
        return found.track

    def _carried_beside(self, stamp_s: float, depth: DepthView, near: Track, track: Track) -> Carried | None:
        """Ask depth near where landmarks have placed a frame; along what it leaves open, the motion model goes on."""
        assert self._last is not None
        is_guide = is_firm(track.information) and is_walkable(self._last, track)
        carried = self._carry(stamp_s, depth, (track if is_guide else near).camera_from_world)
        if carried is not None and carried.is_complete:
            return carried
        since_s = stamp_s - self._last.stamp_s
        turned = near.camera_from_world if carried is None else carried.factor.camera_from_world
        at_pace = self._pace.carried_on(self._last.camera_from_world, since_s, turned[:3, :3])
        return self._carry(stamp_s, depth, at_pace) or carried

    def _distinct(self, near: Track, found: FrameMatch, carried: Carried) -> FrameMatch | None:
        """Return the match, with the map or else with the last frame, that fixes what surfaces leave open."""
        assert self._last is not None
        last = self._last

        def by_map(start: FloatArray, factor: PoseFactor) -> FrameMatch | None:
            nothing = np.full(len(near.features), NO_LANDMARK, np.int32)
            at = replace(near, camera_from_world=start, landmark_of=nothing, carried_points=None)
            return self._extended(at, factor)[0]

        def by_last(start: FloatArray, factor: PoseFactor) -> FrameMatch | None:
            return match_last_frame(self.builder, last, near.features, near.stamp_s, start, factor)

        if undisputed(found, carried, by_map):
            return found
        again = by_last(near.camera_from_world, carried.factor)
        return again if again is not None and undisputed(again, carried, by_last) else None

    def _extended(self, near: Track, factor: PoseFactor | None = None) -> tuple[FrameMatch, IntArray]:
        """Look for the local map's landmarks near where a frame is, weighing in what depth says where it was asked."""
        assert self._last is not None
        keyframes = local_keyframes(self.builder, near.landmarks if near.inlier_count >= 10 else self._last.landmarks)
        if self._carried is not None:
            keyframes = np.union1d(keyframes, [self._carried.reference, self._reference]).astype(np.int32)
            factor = factor or self._carried.factor
        return extend_by_map(self.builder, near, local_landmarks(self.builder, keyframes), factor=factor)

    def _carry(self, stamp_s: float, depth: DepthView, guess: FloatArray) -> Carried | None:
        assert self._last is not None
        was_lost = not self.frame_poses or self.frame_poses[-1].reference < 0
        return self._depth.carry(depth, guess, stamp_s - self._last.stamp_s, was_lost, self._reference)

    def _unmatched(self, stamp_s: float, features: Features) -> Track:
        """Return the frame where depth has placed it, without landmarks yet."""
        assert self._carried is not None
        factor = self._carried.factor
        nothing = np.full(len(features), NO_LANDMARK, np.int32)
        return Track(stamp_s, features, factor.camera_from_world, nothing, factor.information)

    def _recent_keyframes(self) -> IntArray:
        return np.flatnonzero(self.builder.keyframe_alive)[::-1][:20].astype(np.int32)

    # -------------------------------------------------------------------------------------------- key frames
    def _is_keyframe_due(self, track: Track) -> bool:
        late = abs(track.stamp_s - self._last_keyframe_s) > MAX_KEYFRAME_INTERVAL_S
        count = track.inlier_count
        if self._carried is not None and count < MIN_TRACKED:
            return late or self._carried.alignment.overlap < KEYFRAME_OVERLAP
        self._most_tracked = max(self._most_tracked, count)
        close = np.nan_to_num(track.features.depth_m, nan=np.inf) < CLOSE_DEPTH_M
        tracked_close = int(np.count_nonzero(close & (track.landmark_of >= 0)))
        new_close = int(np.count_nonzero(close & (track.landmark_of < 0)))
        needs_close = tracked_close < 100 and new_close > 70
        return late or needs_close or count < KEYFRAME_RATIO * self._most_tracked

    def _insert_keyframe(self, track: Track, depth: DepthView) -> None:
        index = self.builder.add_keyframe(track.stamp_s, track.features, track.camera_from_world, track.landmark_of)
        self._depth.keep(index, depth)
        drift = self._blind.taken(track.camera_from_world)
        if drift.any():
            self.builder.drifts[index] = drift
        if track.inlier_count < MIN_TRACKED or (
            self._carried is not None and self._carried.is_complete and is_sparse(track)
        ):
            self.builder.depth_carried.add(index)
        if self._velocity.any():
            self.builder.unroll(index, self._velocity)
        self._reference, self._last_keyframe_s, self._most_tracked = index, track.stamp_s, 0
        self._local.begin(index)

    # ---------------------------------------------------------------------------------------------- result
    def finish(self) -> SlamMap:
        """Close the loops that are still open, adjust the whole map, and return it. Raises MappingError."""
        self.settle()
        if not self.is_anchored and self._held:
            raise MappingError(
                "No frame of the recording was recognised in the map: begin it, or let it pass, where the map has been."
            )
        own = self.frame_poses[self._earlier_count :]
        tracked = sum(pose.reference >= 0 for pose in own)
        if tracked < MIN_TRACKED_FRAMES:
            raise MappingError(
                f"Only {tracked} of {len(own)} frames could be followed, too few for a map: record again, slowly,"
                " in good light, 0.5 to 4 m from things with texture."
            )
        self._closer.finish()
        self._count()
        return freeze(self.builder, self._closer.places, self.trajectory())

    def trajectory(self) -> list[tuple[float, FloatArray]]:
        """Return stamp and world_from_camera (4, 4) of every tracked frame, in the order of the stamps.

        Those of earlier recordings, given to :meth:`continuing`, come first.
        """
        self.settle()
        own = sorted(self.frame_poses[self._earlier_count :], key=lambda pose: pose.stamp_s)
        return [
            (p.stamp_s, inverse_se3(p.camera_from_reference @ self.builder.pose_of(p.reference)))
            for p in [*self.frame_poses[: self._earlier_count], *own]
            if p.reference >= 0
        ]

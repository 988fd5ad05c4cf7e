"""Localization only: where the walker is in a map that stays as it is.

The last frame and the map's key frames are matched (paper IV-A). Where the map shows nothing, the last frame alone
carries the pose on (visual odometry), and its covariance grows; where the map matches again, the drift is gone. After a
loss, and at the start, place recognition finds the pose again. Every pose says how far it can be trusted: a pose is
called Localized only when map, motion and depth image agree.

States, from frame to frame:

- *Lost* (no state): every frame searches the whole map. A place that convinces, without a rival, makes it Uncertain.
- *Uncertain, unconfirmed*: found, and to be confirmed by ``CONFIRMATIONS`` convincing frames in a row that show many
  landmarks; its covariance allows for a mistaken place. A match that moves the pose farther than its uncertainty
  begins this anew.
- *Localized*: confirmed, matched with the map within ``MAX_UNMATCHED_S``, and sure enough.
- *Uncertain, carried*: surfaces or odometry carry the pose on, the covariance grows, and the whole map is searched
  every ``SEARCH_INTERVAL_S``. The next convincing match makes it Localized again; a map that contradicts takes the
  confirmation away; ``MAX_ODOMETRY_S`` without the map, or a frame that nothing can follow, makes it Lost.

Where no frame came at all, nobody knows how the walker went: after ``MAX_UNSEEN_S`` the pose must be confirmed anew,
and after ``MAX_GAP_S``, or where time went backwards, the next frame is searched for as at the start.

The same frames in the same order give the same poses.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from navcore.frame_check import check_frame, with_known_depth
from navcore.geometry import FloatArray, Transform
from navcore.settings import LocalizationSettings
from navcore.slam.depth_localization import DepthAid, is_elsewhere
from navcore.slam.depth_tracking import DepthView
from navcore.slam.features import FeatureExtractor, feature_count_for, grey_of
from navcore.slam.fisheye_localization import FisheyeAid
from navcore.slam.keyframes import NO_LANDMARK, Features, IntArray, SlamCamera
from navcore.slam.lie import inverse_se3
from navcore.slam.localizer_state import LocalizerState, MapMatch, RememberedCovisibility
from navcore.slam.map_evidence import evidence_for
from navcore.slam.pace import Pace
from navcore.slam.pose import position_sigma_m
from navcore.slam.pose_factor import PoseFactor, intersected
from navcore.slam.pose_uncertainty import (
    centre_of,
    covariance_of,
    drifted,
    is_walkable,
    map_covariance,
    map_factor,
    misfit,
    odometry_factor,
    walked_unseen,
    weighed_by_misfit,
    with_ambiguity,
)
from navcore.slam.relocalization import is_same_place, proposals
from navcore.slam.rolling_shutter import KEPT_SHARE, MIN_READOUT_S, sorted_anew, unrolled
from navcore.slam.self_similarity import is_firm, undisputed
from navcore.slam.slam_map import SlamMap
from navcore.slam.tracking import (
    FrameMatch,
    Track,
    extend_by_map,
    local_keyframes,
    local_landmarks,
    predict_pose,
    seen_again,
    steadied,
    track_last_frame,
    velocity_of,
)
from navcore.types import CameraIntrinsics, Frame, Localization, LocalizationQuality

RELOCALIZATION_CANDIDATES = 10
"""Key frames that look alike, which are tried."""
RELOCALIZATION_INLIERS = 40
"""Landmarks that are no edges that must agree when there was no guess: along bare corridors edges agree anywhere."""
RIVAL_SHARE = 0.6
"""Where another place convinces too, with more than this share of the best one's landmarks, neither is believed."""
STEADY_COUNT = 80
"""Fewer landmarks than this fix a pose badly: what odometry follows is used as well."""
STEADIED_SHARE = 0.7
"""Share of these landmarks that must go on agreeing with the pose then."""
MAX_ODOMETRY_S = 10.0
"""After so long without the map, a pose from odometry alone is given up."""
MAX_UNSEEN_S = 1.0
"""After so long without any frame, what was known of the pose is confirmed anew, and of the velocity forgotten."""
MAX_GAP_S = 2.0
"""After so long without any frame the walker may be at another place that looks alike: all of the map is searched."""
MAX_UNMATCHED_S = 0.15
"""After so long without the map, a pose is only Uncertain."""
SEARCH_INTERVAL_S = 0.5
"""While odometry carries the pose, the whole map is searched this often."""
GUESS_RADIUS_FACTOR = 3.0
"""Search radius around landmarks where only the motion model says where the camera is, times the usual one."""
JUMP_M = 0.3
"""A match with the map that moves the pose by more than this, and more than its uncertainty, must be confirmed."""
NEAR_M = 4.0
"""Key frames within this distance of the pose are searched where the last frame shows no landmark."""
TURN_LEVER_M = 2.0
"""When the nearest key frame is looked for, one that looks to the side counts as so much farther away."""
OPEN_SIGMA_M = 0.3
"""A match that leaves the position open by more than this in some direction does not count as one."""
LEAST_FEATURES = 300
"""Fewer features than this of a picture are not looked for, however slow the device (or all, where all are fewer)."""
MISFIT_MEMORY = 0.8
"""Weight of earlier frames in the running mean of the variance factor."""


class Localizer:
    """Locates frames in a map. Frames come in order of their stamps, and may be dropped; ``reset`` forgets them."""

    def __init__(self, slam_map: SlamMap, intrinsics: CameraIntrinsics, settings: LocalizationSettings) -> None:
        self._settings = settings
        self._intrinsics = intrinsics
        camera = SlamCamera.of(intrinsics, slam_map.camera.bf_px_m)
        self._map = replace(slam_map, camera=camera)
        # Another camera reads its pictures otherwise.
        self._readout_s = float(slam_map.readout_s[0]) if camera == slam_map.camera else 0.0
        self._feature_count = feature_count_for(intrinsics.width_px, intrinsics.height_px, settings.feature_count)
        self._extractor = FeatureExtractor(intrinsics, camera, self._feature_count)
        poses = slam_map.camera_from_world
        self._centres = -np.einsum("kji,kj->ki", poses[:, :3, :3], poses[:, :3, 3])
        self._covisibility = RememberedCovisibility(self._map)
        self._state: LocalizerState | None = None
        self._seen = DepthView(camera)
        self._pace = Pace()
        self._depth = DepthAid(slam_map)
        self._aid = FisheyeAid(self._map, settings.feature_count) if settings.use_fisheye else None

    @property
    def state(self) -> LocalizerState | None:
        """What is remembered; None when lost."""
        return self._state

    def reset(self) -> None:
        """Forget where the camera was."""
        self._state = None
        self._pace.forget()

    def use_features(self, fraction: float) -> None:
        """Look for this share (0, 1] of the features from the next frame on; what is remembered stays."""
        count = max(LEAST_FEATURES, round(fraction * self._feature_count))
        if count != self._extractor.count:
            self._extractor.look_for(min(count, self._feature_count))

    def locate(self, frame: Frame) -> Localization:
        """Return the pose of a frame, its covariance and its quality.

        Raises SensorError, with what to do, for a frame without a finite stamp, or of another size than the camera's;
        what is remembered stays. Depth that is no finite distance above zero is unknown.
        """
        check_frame(frame, self._intrinsics)
        frame = with_known_depth(frame)
        self._bridge_gap(frame.stamp_s)
        image = grey_of(frame.colour_rgb)
        features = self._unrolled_as_expected(self._extractor.extract_grey(image, frame.depth_m))
        self._seen = DepthView(self._map.camera, frame.depth_m, image=image)
        if self._aid is not None:
            known = self._state
            self._aid.look(frame, *((None, None) if known is None else (known.last, known.before_last)))
        state = self._follow(self._state, frame, features) if self._state is not None else None
        self._state = state or self._find(frame, features)
        self._keep_pace(frame.stamp_s)
        return _as_localization(self._state, frame.stamp_s, self._quality(self._state, frame.stamp_s))

    def _bridge_gap(self, stamp_s: float) -> None:
        """Doubt what is remembered, or forget it, where no frame came for a while."""
        if self._state is None:
            return
        gap_s = stamp_s - self._state.last.stamp_s
        if not 0.0 < gap_s <= MAX_GAP_S:
            self.reset()
        elif gap_s > MAX_UNSEEN_S:
            covariance = walked_unseen(self._state.covariance, gap_s)
            self._state = replace(self._state, before_last=None, covariance=covariance, confirmations=0)
            self._pace.forget()

    # ------------------------------------------------------------------------------------------- rolling shutter
    def _unrolled_as_expected(self, features: Features) -> Features:
        """Return features as a camera that reads all rows at once would see them, if it kept its velocity."""
        if self._state is None or abs(self._readout_s) < MIN_READOUT_S:
            return features
        velocity = velocity_of(self._state.last, self._state.before_last)
        return sorted_anew(unrolled(features, velocity, self._readout_s, self._map.camera), self._map.camera)[0]

    def _unrolled_as_found(self, state: LocalizerState, match: MapMatch) -> MapMatch:
        """Return a match of the front view unrolled with the velocity that its pose tells, its pose refined by it.

        Where other evidence has part in the pose, it stays as it is.
        """
        track = match.track
        if abs(self._readout_s) < MIN_READOUT_S or match.fisheye is not None or track.inlier_count < STEADY_COUNT:
            return match
        velocity = velocity_of(track, state.last)
        features = unrolled(track.features, velocity, self._readout_s, self._map.camera)
        again = seen_again(self._map, track, features)
        # Where the step is a pose put right rather than a movement, fewer landmarks agree.
        return replace(match, track=again) if again.inlier_count >= KEPT_SHARE * track.inlier_count else match

    # ------------------------------------------------------------------------------------------- following
    def _follow(self, state: LocalizerState, frame: Frame, features: Features) -> LocalizerState | None:
        guess = predict_pose(state.last, state.before_last, frame.stamp_s)
        if state.matched_s != state.last.stamp_s:
            guess = self._at_pace(state, frame.stamp_s, guess)
        moved = track_last_frame(self._map, state.last, features, frame.stamp_s, guess)
        if moved is not None and not is_walkable(state.last, moved.track):
            moved = None
        if moved is not None:
            moved = replace(moved, track=weighed_by_misfit(self._map.camera, moved.track))
        unseen = np.full(len(features), NO_LANDMARK, np.int32)
        predicted = Track(frame.stamp_s, features, guess, unseen, np.zeros((6, 6)))
        # Somebody who walks along can lead odometry astray; the map, looked for where the camera should be, cannot.
        doubtful: MapMatch | None = None
        followed = None if moved is None else moved.track
        for track, radius_factor in ((followed, 1.0), (predicted, GUESS_RADIUS_FACTOR)):
            if track is None:
                continue
            matched = self._match_map(state, track, frame, radius_factor)
            if matched is not None and not self._is_undisputed(matched, frame.stamp_s - state.last.stamp_s):
                continue
            if matched is not None and matched.is_convincing:
                return self._with_map(state, track, self._unrolled_as_found(state, matched), frame)
            if matched is not None and track is followed and matched.is_plausible_after(track):
                return self._half_matched(state, track, matched, frame)
            doubtful = doubtful or matched
        found = self._find(frame, features) if self._is_due_for_search(state, frame) else None
        return found or self._carried_on(state, moved, doubtful, predicted, frame)

    def _at_pace(self, state: LocalizerState, stamp_s: float, guess: FloatArray) -> FloatArray:
        """Return a guess (4, 4) with the position to which the walker's pace leads."""
        return self._pace.carried_on(state.last.camera_from_world, stamp_s - state.last.stamp_s, guess[:3, :3])

    def _keep_pace(self, stamp_s: float) -> None:
        """Remember the walker's pace by frames that the map has matched, as long as they are of one piece."""
        state = self._state
        if state is None or (state.matched_s == stamp_s and state.confirmations == 1):
            self._pace.forget()
        if state is not None and state.matched_s == stamp_s:
            self._pace.note(stamp_s, state.last.camera_from_world)

    def _carried_on(
        self,
        state: LocalizerState,
        moved: FrameMatch | None,
        doubtful: MapMatch | None,
        predicted: Track,
        frame: Frame,
    ) -> LocalizerState | None:
        """Go on without a convincing match: by surfaces and odometry, else where the map seemed to match.

        None when lost.
        """
        if frame.stamp_s - state.matched_s <= MAX_ODOMETRY_S:
            followed = None if moved is None else moved.track
            at_pace = self._at_pace(state, frame.stamp_s, predicted.camera_from_world)
            predicted = replace(predicted, camera_from_world=at_pace)
            placed = self._depth.place(self._seen, state, followed, predicted, self._pace.is_known)
            if placed is not None:
                return replace(
                    state,
                    last=placed.track,
                    before_last=state.last,
                    covariance=placed.covariance,
                    shared_covariance=placed.shared_covariance,
                    matched_s=frame.stamp_s if placed.is_sure else state.matched_s,
                    confirmations=state.confirmations if placed.is_sure or doubtful is None else 0,
                )
        track = moved.track if moved is not None else doubtful.track if doubtful is not None else None
        if track is None or frame.stamp_s - state.matched_s > MAX_ODOMETRY_S:
            return None
        confirmations = 0 if doubtful is not None else state.confirmations
        covariance = drifted(state.covariance, state.last, track)
        return replace(state, last=track, before_last=state.last, covariance=covariance, confirmations=confirmations)

    def _match_map(
        self, state: LocalizerState, track: Track, frame: Frame, least_radius_factor: float
    ) -> MapMatch | None:
        seed = track.landmarks if track.inlier_count >= 10 else state.last.landmarks
        if len(seed) >= 10:
            keyframes = local_keyframes(self._covisibility, seed)
        else:
            keyframes = self._near_keyframes(track.camera_from_world)
        candidates = local_landmarks(self._map, keyframes)
        if len(candidates) == 0 and (self._aid is None or not self._aid.has_picture):
            return None
        sigma_m = float(np.sqrt(np.trace(state.covariance[:3, :3])))
        radius_factor = float(np.clip(sigma_m / 0.05, least_radius_factor, 4.0))
        found, expected = extend_by_map(self._map, track, candidates, radius_factor)
        if radius_factor > 1.5 and found.landmark_count >= 10:
            found, expected = extend_by_map(self._map, found.track, candidates)
        alone = MapMatch(found.track, evidence_for(self._map, found.track, expected, frame.depth_m))
        if self._aid is not None and self._aid.has_picture and not (alone.is_ample and alone.is_convincing):
            known = self._known_of(state, track) if found.landmark_count < STEADY_COUNT else None
            both = self._with_fisheye(self._aid, found.track, candidates, frame, radius_factor, known)
            if both is not None:
                return both
        if found.landmark_count < self._settings.min_inliers_count:
            return None
        if found.landmark_count < STEADY_COUNT:
            return replace(alone, track=self._steadied(state, found.track, track))
        return alone

    def _is_undisputed(self, matched: MapMatch, step_s: float) -> bool:
        """Tell whether a match fixes all of the pose: what surfaces leave open, few landmarks may leave open, too."""
        track = matched.track
        if not matched.is_sparse:
            return True
        carried = self._depth.carried(self._seen, track.camera_from_world, step_s)
        if carried is None:
            return position_sigma_m(track.information) < OPEN_SIGMA_M
        if carried.is_complete:
            return not is_elsewhere(carried, track.camera_from_world)
        seeds = local_keyframes(self._covisibility, track.landmarks)
        candidates = local_landmarks(self._map, seeds)
        nothing = np.full(len(track.features), NO_LANDMARK, np.int32)

        def by_map(start: FloatArray, factor: PoseFactor) -> FrameMatch:
            at = replace(track, camera_from_world=start, landmark_of=nothing, carried_points=None)
            return extend_by_map(self._map, at, candidates, factor=factor)[0]

        found, _ = extend_by_map(self._map, track, candidates)
        return is_firm(found.track.information) and undisputed(found, carried, by_map)

    def _steadied(self, state: LocalizerState, matched: Track, followed: Track) -> Track:
        """Return a frame matched with few landmarks, its pose weighed against what odometry says.

        A sliver of the map at the image's edge fixes a pose badly. Where the two contradict each other, the map counts.
        """
        known = self._known_of(state, followed)
        if known is None:
            return matched
        both = steadied(self._map, matched, known)
        return both if both.inlier_count >= STEADIED_SHARE * matched.inlier_count else matched

    def _known_of(self, state: LocalizerState, followed: Track) -> PoseFactor | None:
        """Return what odometry says of a frame's pose; None where it did not follow."""
        if followed.carried_points is None:
            return None
        return odometry_factor(state.covariance - state.shared_covariance, state.last, followed)

    def _with_fisheye(
        self,
        aid: FisheyeAid,
        track: Track,
        candidates: IntArray,
        frame: Frame,
        radius_factor: float,
        known: PoseFactor | None = None,
    ) -> MapMatch | None:
        """Return the match near a pose on which both pictures agree; None where the fisheye's shows too little.

        ``known`` is what is known of the pose besides.
        """
        match = aid.join(track, radius_factor, known)
        if match is None:
            return None
        # Around the better pose the front view shows more.
        front, expected = extend_by_map(self._map, match.track, candidates)
        match = aid.join(front.track, 1.0, known) or match
        return MapMatch(match.track, evidence_for(self._map, match.track, expected, frame.depth_m), match)

    def _near_keyframes(self, camera_from_world: FloatArray) -> IntArray:
        centre = -camera_from_world[:3, :3].T @ camera_from_world[:3, 3]
        distance = np.linalg.norm(self._centres - centre, axis=1)
        alike = self._map.camera_from_world[:, 2, :3] @ camera_from_world[2, :3] > 0.5
        near = np.flatnonzero(alike & (distance < NEAR_M))
        return near[np.argsort(distance[near], kind="stable")][:30].astype(np.int32)

    def _nearest_keyframe(self, track: Track) -> int:
        """Return the key frame that saw things from about the same place, in about the same direction."""
        distance = np.linalg.norm(self._centres - centre_of(track), axis=1)
        along = self._map.camera_from_world[:, 2, :3] @ track.camera_from_world[2, :3]
        return int(np.argmin(distance + TURN_LEVER_M * (1.0 - along)))

    def _with_map(self, state: LocalizerState, moved: Track, matched: MapMatch, frame: Frame) -> LocalizerState:
        shift_m = float(np.linalg.norm(centre_of(matched.track) - centre_of(moved)))
        drift_m = 3.0 * float(np.sqrt(np.trace(drifted(state.covariance, state.last, moved)[:3, :3])))
        if shift_m > max(JUMP_M, drift_m):
            return self._matched(state, matched, frame, 1)
        # Bare corridors look alike: few landmarks do not tell that the place is the right one, however often.
        confirms = not state.is_confirmed and not matched.is_sparse
        return self._matched(state, matched, frame, state.confirmations + int(confirms))

    def _matched(
        self, state: LocalizerState | None, matched: MapMatch, frame: Frame, confirmations: int
    ) -> LocalizerState:
        track, last = matched.track, None if state is None else state.last
        factor = self._misfit_after(state, track)
        covariance, shared = map_covariance(track, self._covariance_around(track), factor)
        return LocalizerState(track, last, covariance, shared, frame.stamp_s, confirmations, factor)

    def _half_matched(self, state: LocalizerState, followed: Track, matched: MapMatch, frame: Frame) -> LocalizerState:
        """Return the state after a match that only odometry makes plausible.

        Both follow the same features, and may err alike. It keeps what is known of the place, but makes neither a
        doubtful pose a sure one, nor a drifted one as good as a match that convinces.
        """
        factor = self._misfit_after(state, matched.track)
        _, shared = map_covariance(matched.track, self._covariance_around(matched.track), factor)
        known = odometry_factor(state.covariance - state.shared_covariance, state.last, followed)
        both = intersected(known, map_factor(matched.track, factor))
        track = replace(matched.track, camera_from_world=both.camera_from_world)
        return replace(
            state,
            last=track,
            before_last=state.last,
            covariance=shared + covariance_of(both),
            shared_covariance=shared,
            matched_s=frame.stamp_s,
            misfit=factor,
        )

    def _misfit_after(self, state: LocalizerState | None, track: Track) -> float:
        factor = misfit(self._map, track)
        return factor if state is None else MISFIT_MEMORY * state.misfit + (1.0 - MISFIT_MEMORY) * factor

    def _covariance_around(self, track: Track) -> FloatArray:
        return np.asarray(self._map.keyframe_covariance[self._nearest_keyframe(track)])

    # --------------------------------------------------------------------------------------------- finding
    def _is_due_for_search(self, state: LocalizerState, frame: Frame) -> bool:
        """Return whether to search the whole map: at once when the map is missed, then every half second."""
        missed_s = frame.stamp_s - state.matched_s
        before_s = state.last.stamp_s - state.matched_s
        return int(missed_s / SEARCH_INTERVAL_S) != int(before_s / SEARCH_INTERVAL_S) or before_s <= 0.0

    def _find(self, frame: Frame, features: Features) -> LocalizerState | None:
        """Search the whole map; None where no place convinces, or more than one does."""
        if len(features) < RELOCALIZATION_INLIERS:
            return self._find_by_fisheye(frame, features)
        alike, _ = self._map.places.query(features.descriptors, RELOCALIZATION_CANDIDATES)
        best: MapMatch | None = None
        rival = 0
        for found in proposals(self._map, features, frame.stamp_s, alike.tolist(), RELOCALIZATION_INLIERS):
            around = local_landmarks(self._map, local_keyframes(self._covisibility, found.track.landmarks))
            match = MapMatch(found.track, evidence_for(self._map, found.track, around, frame.depth_m))
            if not match.is_convincing:
                continue
            if best is not None and is_same_place(best.track, match.track):
                best = max(best, match, key=lambda m: m.evidence.found)
            elif best is None or match.evidence.found > best.evidence.found:
                rival, best = 0 if best is None else best.evidence.found, match
            else:
                rival = max(rival, match.evidence.found)
        if best is None:
            return self._find_by_fisheye(frame, features)
        if best.track.distinct_count < RELOCALIZATION_INLIERS:
            return None
        if rival > RIVAL_SHARE * best.evidence.found or not self._is_undisputed(best, 0.0):
            return None
        return self._matched(None, best, frame, 1)

    def _find_by_fisheye(self, frame: Frame, features: Features) -> LocalizerState | None:
        """Search the whole map for what the fisheye picture shows, and weigh what the front view shows there."""
        found = self._aid.find(features, frame.stamp_s) if self._aid is not None else None
        if self._aid is None or found is None:
            return None
        around = local_landmarks(self._map, self._near_keyframes(found.track.camera_from_world))
        match = self._with_fisheye(self._aid, found.track, around, frame, 1.0)
        if match is None or not match.is_convincing or match.found_count < RELOCALIZATION_INLIERS:
            return None
        if not self._is_undisputed(match, 0.0):
            return None
        return self._matched(None, match, frame, 1)

    # --------------------------------------------------------------------------------------------- quality
    def _quality(self, state: LocalizerState | None, stamp_s: float) -> LocalizationQuality:
        if state is None:
            return LocalizationQuality.LOST
        sigma_m = float(np.sqrt(np.linalg.eigvalsh(state.covariance[:3, :3])[-1]))
        without_map_s = stamp_s - state.matched_s
        if not state.is_confirmed or sigma_m > self._settings.uncertain_position_m or without_map_s > MAX_UNMATCHED_S:
            return LocalizationQuality.UNCERTAIN
        return LocalizationQuality.LOCALIZED


def _as_localization(state: LocalizerState | None, stamp_s: float, quality: LocalizationQuality) -> Localization:
    if state is None:
        return Localization(stamp_s, quality, None)
    world_from_camera = Transform(inverse_se3(state.last.camera_from_world))
    covariance = state.covariance if state.is_confirmed else with_ambiguity(state.covariance)
    return Localization(stamp_s, quality, world_from_camera, covariance, state.last.inlier_count)

"""Where the camera is, from one frame to the next: motion model, last frame, local map.

The same functions follow the camera while the map grows (``mapper``) and in the frozen map (``localizer``); both kinds
of map are seen through :class:`MapView`. A :class:`Track` is what remains of a frame that was found.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from navcore.compiled import kernel
from navcore.geometry import FloatArray
from navcore.slam import pose
from navcore.slam.keyframes import (
    LEVEL_COUNT,
    NO_LANDMARK,
    SCALE_FACTOR,
    ByteArray,
    Features,
    IntArray,
    SlamCamera,
)
from navcore.slam.lie import exp_se3, log_se3
from navcore.slam.matching import DISTANCE_LOOSE, RATIO_LOCAL, match_all, match_projected, project_landmarks
from navcore.slam.pose_factor import PoseFactor
from navcore.slam.pose_kernels import has_slid
from navcore.slam.rolling_shutter import velocity_between

BoolArray = NDArray[np.bool_]

SCALES: FloatArray = np.power(SCALE_FACTOR, np.arange(LEVEL_COUNT, dtype=np.float64))
LAST_FRAME_RADIUS_PX = 15.0
"""Search radius around a point of the last frame, at pyramid level 0, in an image 640 pixels wide."""
LOCAL_RADIUS_PX = 3.0
"""Times 2.5 or 4 (seen head-on or not): search radius around a landmark of the local map, at pyramid level 0."""
WIDENINGS = (1.0, 2.5)
"""Times that radius: what is tried, one after the other."""
FAR_WIDENINGS = (2.5, 1.0)
"""The same around a pose that descriptors gave, from coarse to fine."""
MIN_FAR_MATCHES = 8
"""Matches by descriptor alone that must agree on one motion."""
MIN_FRAME_MATCHES = 20
"""Fewer matches than this with the last frame mean that it was not followed."""
MIN_AGREEING_SHARE = 0.5
"""Share of them that must agree on one motion. In the light 80 % and more do; in the dark noise matches noise, and what
a minority agrees on is farther from the truth than the motion model is."""
MIN_SETTLED = 30
"""So many settled landmarks decide the pose alone."""
AGREEING_CHI2 = 16.0
"""A point farther than this from where the settled ones put it moves, or is wrong: two bounds of an inlier, since the
pose that the few give is not exact."""
LOCAL_KEYFRAMES = 60
"""Key frames whose landmarks make the local map, at most."""
NEIGHBOURS = 10
"""Covisible key frames that each of them brings along."""


class Covisibility(Protocol):
    """Which key frames see the same landmarks."""

    def keyframes_seeing(self, landmarks: IntArray) -> tuple[IntArray, IntArray]:
        """Return the key frames that see any of the landmarks, best first, and how many each sees."""
        ...

    def covisible(self, index: int, min_shared: int) -> tuple[IntArray, IntArray]:
        """Return the key frames that share landmarks with one, best first, and how many."""
        ...


class MapView(Covisibility, Protocol):
    """What tracking reads of a map, growing or frozen; see :class:`navcore.slam.map.MapBuilder` for the arrays."""

    @property
    def camera(self) -> SlamCamera: ...
    @property
    def positions(self) -> FloatArray: ...
    @property
    def normals(self) -> FloatArray: ...
    @property
    def reach(self) -> FloatArray: ...
    @property
    def descriptors(self) -> ByteArray: ...
    @property
    def landmark_of(self) -> IntArray: ...
    @property
    def landmark_alive(self) -> BoolArray: ...
    @property
    def landmark_settled(self) -> BoolArray: ...


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """A frame whose pose was found."""

    stamp_s: float
    features: Features
    camera_from_world: FloatArray
    """(4, 4)."""
    landmark_of: IntArray
    """(n,): the landmark that each feature shows, or NO_LANDMARK."""
    information: FloatArray
    """(6, 6): of the pose, as :func:`navcore.slam.pose.refine_pose` gives it."""
    carried_points: FloatArray | None = None
    """(n, 3): world points of features that were followed from earlier frames, NaN elsewhere; they keep odometry from
    drifting with every frame."""

    @property
    def landmarks(self) -> IntArray:
        """The landmarks that are seen, in the order of the features."""
        return self.landmark_of[self.landmark_of >= 0]

    @property
    def inlier_count(self) -> int:
        """How many landmarks agree with the pose."""
        return int(np.count_nonzero(self.landmark_of >= 0))

    @property
    def distinct_count(self) -> int:
        """How many of these are no edges."""
        return self.features.count_distinct(np.flatnonzero(self.landmark_of >= 0).astype(np.int32))


def predict_pose(last: Track, before_last: Track | None, stamp_s: float) -> FloatArray:
    """Return camera_from_world (4, 4) at a time, for a camera that keeps its velocity, also over dropped frames.

    Time may run backwards, but must not turn round on the way.
    """
    if before_last is None or last.stamp_s == before_last.stamp_s:
        return last.camera_from_world
    ratio = (stamp_s - last.stamp_s) / (last.stamp_s - before_last.stamp_s)
    if ratio <= 0.0:
        return last.camera_from_world
    step = last.camera_from_world @ np.linalg.inv(before_last.camera_from_world)
    if 0.7 < ratio < 1.4:
        return np.asarray(step @ last.camera_from_world)
    return np.asarray(fraction_of_step(step, min(ratio, 3.0)) @ last.camera_from_world)


def velocity_of(track: Track, before: Track | None) -> FloatArray:
    """Return the twist per second (6,) that led to a frame from the one before; zero where it is not known."""
    if before is None:
        return np.zeros(6)
    return velocity_between(before.camera_from_world, track.camera_from_world, track.stamp_s - before.stamp_s)


def fraction_of_step(step: FloatArray, ratio: float) -> FloatArray:
    """Return the motion (4, 4) over ``ratio`` times the time that ``step`` took, at constant velocity."""
    motion: FloatArray = exp_se3(ratio * log_se3(np.ascontiguousarray(step)))
    return motion


def points_of(track: Track, view: MapView) -> FloatArray:
    """Return world points (n, 3) of a frame's features: the landmark's, else from depth, else NaN."""
    world_from_camera = np.linalg.inv(track.camera_from_world)
    points: FloatArray = track.features.points_in_camera(view.camera) @ world_from_camera[:3, :3].T
    points += world_from_camera[:3, 3]
    if track.carried_points is not None:
        carried = np.isfinite(track.carried_points[:, 2])
        points[carried] = track.carried_points[carried]
    seen = track.landmark_of >= 0
    points[seen] = view.positions[track.landmark_of[seen]]
    return points


def project_points(camera_from_world: FloatArray, points: FloatArray, camera: SlamCamera) -> FloatArray:
    """Return u, v, u_r (n, 3) of world points (n, 3); NaN where behind the camera or outside the image."""
    in_camera = points @ camera_from_world[:3, :3].T + camera_from_world[:3, 3]
    with np.errstate(divide="ignore", invalid="ignore"):
        z = np.where(in_camera[:, 2] > 0.05, in_camera[:, 2], np.nan)
        u = camera.fx_px * in_camera[:, 0] / z + camera.cx_px
        v = camera.fy_px * in_camera[:, 1] / z + camera.cy_px
        outside = (u < 0) | (u >= camera.width_px) | (v < 0) | (v >= camera.height_px)
        uvr = np.stack([u, v, u - camera.bf_px_m / z], axis=1)
    uvr[outside] = np.nan
    return uvr


@dataclass(frozen=True, slots=True, eq=False)
class FrameMatch:
    """A pose found from the last frame, and the points that support it."""

    track: Track
    matched_count: int
    """Points of the last frame that agree, landmarks or not."""
    landmark_count: int
    """Landmarks among them."""

    @property
    def distinct_count(self) -> int:
        """Points among them that are no edges."""
        carried = self.track.carried_points
        seen = self.track.landmark_of >= 0 if carried is None else np.isfinite(carried[:, 2])
        return self.track.features.count_distinct(np.flatnonzero(seen).astype(np.int32))


def refined(
    stamp_s: float,
    features: Features,
    guess: FloatArray,
    feature_index: IntArray,
    points: FloatArray,
    landmarks: IntArray,
    camera: SlamCamera,
    factor: PoseFactor | None = None,
    settled: BoolArray | None = None,
) -> FrameMatch:
    """Refine a pose from matched features (m,) with world points (m, 3); ``landmarks`` (m,) may hold NO_LANDMARK.

    ``factor`` is what is known of the pose besides. Where enough points are ``settled`` (m,), they alone decide where
    the camera is, and of the others those help that agree: a key frame makes landmarks on a passer-by as well, and they
    are near, many, and of one mind.
    """
    if settled is not None and not settled.all() and np.count_nonzero(settled) >= MIN_SETTLED:
        guess = _refined_pose(guess, features, feature_index[settled], points[settled], camera, factor)
        helping = settled | agrees(guess, points, features, feature_index, camera)
        feature_index, points, landmarks = feature_index[helping], points[helping], landmarks[helping]
    camera_from_world, inlier, information = pose.refine_pose(
        guess,
        points,
        features.uvr_px[feature_index],
        features.inv_sigma2[feature_index],
        camera.fx_px,
        camera.fy_px,
        camera.cx_px,
        camera.cy_px,
        camera.bf_px_m,
        factor,
        features.slides_at(feature_index),
    )
    same = inlier & ~_has_slid(camera_from_world, points, features, feature_index, camera)
    landmark_of = np.full(len(features), NO_LANDMARK, np.int32)
    landmark_of[feature_index[same]] = landmarks[same]
    carried = np.full((len(features), 3), np.nan)
    carried[feature_index[same]] = points[same]
    track = Track(stamp_s, features, camera_from_world, landmark_of, information, carried)
    return FrameMatch(track, int(np.count_nonzero(inlier)), track.inlier_count)


def _refined_pose(
    guess: FloatArray,
    features: Features,
    feature_index: IntArray,
    points: FloatArray,
    camera: SlamCamera,
    factor: PoseFactor | None,
) -> FloatArray:
    found, _, _ = pose.refine_pose(
        guess,
        points,
        features.uvr_px[feature_index],
        features.inv_sigma2[feature_index],
        camera.fx_px,
        camera.fy_px,
        camera.cx_px,
        camera.cy_px,
        camera.bf_px_m,
        factor,
        features.slides_at(feature_index),
    )
    return found


def _has_slid(
    camera_from_world: FloatArray, points: FloatArray, features: Features, feature_index: IntArray, camera: SlamCamera
) -> BoolArray:
    """Return which features (m,) lie on an edge, but elsewhere on it than their points (m, 3) are seen.

    They help to find the pose, and are not the same points.
    """
    slides = features.slides_at(feature_index)
    if slides is None:
        return np.zeros(len(feature_index), np.bool_)
    return has_slid(
        camera_from_world,
        np.ascontiguousarray(points),
        features.uvr_px[feature_index],
        slides,
        features.inv_sigma2[feature_index],
        (camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px, camera.bf_px_m),
    )


def agrees(
    camera_from_world: FloatArray,
    points: FloatArray,
    features: Features,
    feature_index: IntArray,
    camera: SlamCamera,
) -> BoolArray:
    """Return whether each point (m, 3) is seen near where a pose (4, 4) puts it, also in depth."""
    expected = project_points(camera_from_world, points, camera)
    error = (features.uvr_px[feature_index] - expected) ** 2
    chi2 = (error[:, 0] + error[:, 1] + np.nan_to_num(error[:, 2])) * features.inv_sigma2[feature_index]
    return np.asarray(chi2 < AGREEING_CHI2)


def track_last_frame(
    view: MapView, last: Track, features: Features, stamp_s: float, guess: FloatArray
) -> FrameMatch | None:
    """Find the pose from the points of the last frame, near where the motion model puts them; None where too few match.

    The window is widened once; where that fails too, all descriptors are compared and the motion is found by RANSAC.
    """
    points = points_of(last, view)
    usable = np.isfinite(points[:, 2]) & ((last.landmark_of < 0) | view.landmark_alive[last.landmark_of])
    for widening in WIDENINGS:
        match = _match_around(view, last, features, guess, points, usable, widening)
        found = _from_matches(view, last, features, stamp_s, guess, match, points)
        if found is not None:
            return found
    return _track_by_descriptors(view, last, features, stamp_s, points, usable)


def match_last_frame(
    view: MapView, last: Track, features: Features, stamp_s: float, guess: FloatArray, factor: PoseFactor
) -> FrameMatch | None:
    """Find the pose from the points of the last frame near a guess (4, 4), weighing in what is known besides.

    None where too few match.
    """
    points = points_of(last, view)
    usable = np.isfinite(points[:, 2]) & ((last.landmark_of < 0) | view.landmark_alive[last.landmark_of])
    match = _match_around(view, last, features, guess, points, usable, 1.0)
    from_last = np.flatnonzero(match >= 0)
    if len(from_last) < MIN_FRAME_MATCHES:
        return None
    landmarks = last.landmark_of[from_last]
    return refined(stamp_s, features, guess, match[from_last], points[from_last], landmarks, view.camera, factor)


def _match_around(
    view: MapView,
    last: Track,
    features: Features,
    guess: FloatArray,
    points: FloatArray,
    usable: BoolArray,
    widening: float,
) -> IntArray:
    """Return the feature that shows each point of the last frame (n,), looked for near where a guess puts it."""
    uvr = project_points(guess, points, view.camera)
    visible = usable & np.isfinite(uvr[:, 0])
    scale_px = LAST_FRAME_RADIUS_PX * view.camera.width_px / 640
    radius = np.where(visible, widening * scale_px * SCALES[last.features.octave], 0.0)
    return match_projected(
        features,
        uvr[:, :2],
        np.full(len(uvr), np.nan),
        radius,
        last.features.octave - 1,
        last.features.octave + 1,
        last.features.descriptors,
        np.zeros(len(features), np.bool_),
        DISTANCE_LOOSE,
        0.9,
        last.features.angle_rad,
    )


def _from_matches(
    view: MapView,
    last: Track,
    features: Features,
    stamp_s: float,
    guess: FloatArray,
    match: IntArray,
    points: FloatArray,
) -> FrameMatch | None:
    from_last = np.flatnonzero(match >= 0)
    if len(from_last) < MIN_FRAME_MATCHES:
        return None
    # What the map knows stands still; what it does not know may be somebody walking along.
    known = from_last[last.landmark_of[from_last] >= 0]
    for chosen in (known, from_last):
        if len(chosen) < MIN_FRAME_MATCHES:
            continue
        landmarks = last.landmark_of[chosen]
        settled = (landmarks >= 0) & view.landmark_settled[landmarks]
        found = refined(
            stamp_s, features, guess, match[chosen], points[chosen], landmarks, view.camera, settled=settled
        )
        if found.matched_count >= max(MIN_FRAME_MATCHES // 2, MIN_AGREEING_SHARE * len(chosen)):
            return found
    return None


def _track_by_descriptors(
    view: MapView, last: Track, features: Features, stamp_s: float, points: FloatArray, usable: BoolArray
) -> FrameMatch | None:
    """Find the pose without a guess: by looks and depth first, then by what is found again around that."""
    match = match_all(
        last.features.descriptors, features.descriptors, 64, 0.85, last.features.angle_rad, features.angle_rad
    )
    match[~usable] = -1
    from_last = np.flatnonzero(match >= 0)
    guess = _guess_from_matches(view, features, match[from_last], points[from_last])
    if guess is None:
        return None
    found = None
    for widening in FAR_WIDENINGS:
        rematch = _match_around(view, last, features, guess, points, usable, widening)
        found = _from_matches(view, last, features, stamp_s, guess, rematch, points)
        if found is None:
            return None
        guess = found.track.camera_from_world
    return found


def _guess_from_matches(
    view: MapView, features: Features, feature_index: IntArray, points: FloatArray
) -> FloatArray | None:
    """Return camera_from_world by matched features (m,) and world points (m, 3): rigid where both have a depth."""
    measured = np.isfinite(features.depth_m[feature_index])
    in_camera = features.points_in_camera(view.camera)[feature_index[measured]]
    # Depth gets worse with the square of the distance; a few pixels' worth of it must be allowed.
    tolerance_m = 0.03 + 0.012 * in_camera[:, 2] ** 2
    aligned = pose.align_ransac(in_camera, points[measured], tolerance_m, min_inliers=MIN_FAR_MATCHES)
    if aligned is not None:
        return aligned[0]
    camera = view.camera
    solved = pose.pnp_ransac(
        points,
        features.uv_px[feature_index],
        camera.fx_px,
        camera.fy_px,
        camera.cx_px,
        camera.cy_px,
        min_inliers=MIN_FAR_MATCHES,
    )
    return None if solved is None else solved[0]


# ------------------------------------------------------------------------------------------------- local map
def local_keyframes(view: Covisibility, landmarks: IntArray) -> IntArray:
    """Return the key frames that see the landmarks, best first, with covisible neighbours of the best."""
    seeing, _ = view.keyframes_seeing(landmarks)
    chosen = seeing[:LOCAL_KEYFRAMES].tolist()
    held = set(chosen)
    for index in chosen[:5]:
        if len(chosen) >= LOCAL_KEYFRAMES:
            break
        neighbours, _ = view.covisible(index, 1)
        fresh = [int(k) for k in neighbours[:NEIGHBOURS] if int(k) not in held]
        chosen += fresh
        held.update(fresh)
    return np.array(chosen[:LOCAL_KEYFRAMES], dtype=np.int32)


def local_landmarks(view: MapView, keyframes: IntArray) -> IntArray:
    """Return the living landmarks that the key frames see, ascending."""
    return _union(view.landmark_of, keyframes, view.landmark_alive)


def extend_by_map(
    view: MapView,
    track: Track,
    candidates: IntArray,
    radius_factor: float = 1.0,
    factor: PoseFactor | None = None,
) -> tuple[FrameMatch, IntArray]:
    """Look for further landmarks of the map in a frame whose pose is nearly known, and refine the pose with all.

    ``factor`` is what is known of the pose besides. Return the new state and the candidates (k,) that should have been
    seen.
    """
    held = np.zeros(len(view.positions), np.bool_)
    held[track.landmarks] = True
    wanted = candidates[~held[candidates]]
    uvr, _, octave, cosine = project_landmarks(
        track.camera_from_world, view.positions[wanted], view.normals[wanted], view.reach[wanted], view.camera
    )
    visible = octave >= 0
    wanted, uvr, octave, cosine = wanted[visible], uvr[visible], octave[visible], cosine[visible]
    radius = radius_factor * LOCAL_RADIUS_PX * np.where(cosine > 0.998, 2.5, 4.0) * SCALES[octave]
    match = match_projected(
        track.features,
        uvr[:, :2],
        uvr[:, 2],
        radius,
        octave - 1,
        octave + 1,
        view.descriptors[wanted],
        track.landmark_of >= 0,
        DISTANCE_LOOSE,
        RATIO_LOCAL,
    )
    landmark_of = track.landmark_of.copy()
    matched = match >= 0
    landmark_of[match[matched]] = wanted[matched]
    feature_index = np.flatnonzero(landmark_of >= 0).astype(np.int32)
    landmarks = landmark_of[feature_index]
    found = refined(
        track.stamp_s,
        track.features,
        track.camera_from_world,
        feature_index,
        view.positions[landmarks],
        landmarks,
        view.camera,
        factor,
        view.landmark_settled[landmarks],
    )
    return found, np.concatenate([wanted, track.landmarks])


def seen_again(view: MapView, track: Track, features: Features) -> Track:
    """Return a track whose features have moved a little, its pose refined on the landmarks that it showed."""
    shown = np.flatnonzero(track.landmark_of >= 0).astype(np.int32)
    if len(shown) < MIN_FRAME_MATCHES:
        return replace(track, features=features)
    landmarks = track.landmark_of[shown]
    return refined(
        track.stamp_s,
        features,
        track.camera_from_world,
        shown,
        view.positions[landmarks],
        landmarks,
        view.camera,
        settled=view.landmark_settled[landmarks],
    ).track


def steadied(view: MapView, matched: Track, known: PoseFactor) -> Track:
    """Return a frame matched with few landmarks, its pose refined together with what is known of it from elsewhere.

    The information stays that of the landmarks alone: what is known already comes from the same landmarks, frames ago.
    """
    seen = np.flatnonzero(matched.landmark_of >= 0).astype(np.int32)
    features, camera = matched.features, view.camera
    camera_from_world, inlier, _ = pose.refine_pose(
        matched.camera_from_world,
        view.positions[matched.landmark_of[seen]],
        features.uvr_px[seen],
        features.inv_sigma2[seen],
        camera.fx_px,
        camera.fy_px,
        camera.cx_px,
        camera.cy_px,
        camera.bf_px_m,
        known,
        features.slides_at(seen),
    )
    landmark_of = np.full(len(features), NO_LANDMARK, np.int32)
    landmark_of[seen[inlier]] = matched.landmark_of[seen[inlier]]
    return replace(matched, camera_from_world=camera_from_world, landmark_of=landmark_of)


def moved(track: Track, camera_from_world: FloatArray) -> Track:
    """Return the track with another pose, after the map under it was adjusted."""
    return replace(track, camera_from_world=camera_from_world)


# --------------------------------------------------------------------------------------------------- kernels
@kernel
def _union(landmark_of: IntArray, keyframes: IntArray, alive: BoolArray) -> IntArray:
    chosen = np.zeros(len(alive), np.bool_)
    for k in keyframes:
        for f in range(landmark_of.shape[1]):
            landmark = landmark_of[k, f]
            if landmark >= 0 and alive[landmark]:
                chosen[landmark] = True
    return np.flatnonzero(chosen).astype(np.int32)

"""Two maps of overlapping parts of a building become one.

The new recording was mapped by itself, so it may begin anywhere. It is laid on the known map where both show the same
(:mod:`navcore.slam.overlap`), the drift is spread over both (essential graph), landmarks that are one become one all
along the overlap, and everything is adjusted together (as ORB-SLAM3's Atlas merges maps: Campos et al. 2021, section
VI). The known map's frame stays: its key frames, on the whole, lie where they lay.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from navcore.errors import MappingError
from navcore.geometry import FloatArray
from navcore.slam import loop_correction, mapping
from navcore.slam.covisibility import spanning_parents
from navcore.slam.deformation import Deformation, frame_kept
from navcore.slam.freezing import freeze
from navcore.slam.keyframes import IntArray
from navcore.slam.loop_verification import VerifiedLoop
from navcore.slam.map import MapBuilder
from navcore.slam.nearest import nearest_index
from navcore.slam.overlap import camera_centres, find_overlap
from navcore.slam.place_recognition import PlaceIndex, Vocabulary
from navcore.slam.rolling_shutter import ReadoutTime
from navcore.slam.slam_map import SlamMap
from navcore.slam.thawing import graft, thaw
from navcore.slam.tracking import local_landmarks

MAX_SCALE = 1.25
"""Focal lengths of two cameras may differ by this factor: beyond, their features are not of the same size."""
LOOP_SPACING_M = 1.0
"""Of the matches, one for each so many metres of the walk becomes an edge of the pose graph."""
NEAR_M = 2.0
"""Key frames of both maps that stand nearer than this …"""
NEAR_COSINE = float(np.cos(np.radians(40.0)))
"""… and look the same way should show the same landmarks."""
NEIGHBOURS = 6
"""Such key frames whose landmarks are looked for in one."""
WELD_RADII_PX = (8.0, 4.0)
"""Search radii of the two rounds of fusion, at pyramid level 0, in an image 640 pixels wide."""
CLOSE_M = 1.5
"""Key frames nearer than this that look the same way must share landmarks: …"""
MIN_SHARED = 20
"""… so many, …"""
MIN_SHARED_SHARE = 0.3
"""… in this share of them, or the maps do not lie on each other as was thought."""


@dataclass(frozen=True, slots=True, eq=False)
class Joined:
    """One map of two."""

    slam_map: SlamMap
    """In the known map's frame; the new map's key frames follow the known one's."""
    known: Deformation
    """How the known map's key frames moved."""
    new: Deformation
    """How the new map's key frames came from their own frame into this one."""
    matches: int
    """Key frames of the new map that were recognised in the known one and agree."""


def join(known: SlamMap, new: SlamMap, session: int, seed: int = 0) -> Joined:
    """Join a level map of another recording to a known one; the same maps and seed give the same bytes.

    The new map's recording gets the number ``session``, which must be higher than the known one's.

    Raises MappingError, with what to do, where they do not overlap, overlap too little to be sure, or were recorded
    with cameras that are too different.
    """
    _refuse_foreign_camera(known, new)
    new = replace(
        new,
        keyframe_session=np.full_like(new.keyframe_session, session),
        trajectory_session=np.full_like(new.trajectory_session, session),
    )
    builder, known_index, new_index = _side_by_side(known, new, np.eye(4))
    overlap = find_overlap(builder, known_index, new_index, known.places, seed)
    builder, known_index, new_index = _side_by_side(known, new, overlap.known_from_new)
    loop_correction.correct(builder, _thinned(builder, list(overlap.loops)))
    mapping.adjust_all(builder, 8)
    for radius_px in WELD_RADII_PX:
        _weld(builder, known_index, new_index, radius_px * builder.camera.width_px / 640)
        mapping.adjust_all(builder, 12)
    _refuse_contradiction(builder, known_index, new_index)
    return _as_one_map(builder, known, new, len(overlap.loops), seed)


def _refuse_foreign_camera(known: SlamMap, new: SlamMap) -> None:
    for first, second in ((known.camera.fx_px, new.camera.fx_px), (known.camera.fy_px, new.camera.fy_px)):
        if not 1.0 / MAX_SCALE <= first / second <= MAX_SCALE:
            raise MappingError(
                f"The site was recorded with a focal length of {first:.0f} px and this recording with {second:.0f} px:"
                " record at the same picture size, with the same kind of camera."
            )


def _side_by_side(known: SlamMap, new: SlamMap, known_from_new: FloatArray) -> tuple[MapBuilder, IntArray, IntArray]:
    """Return a builder that holds both maps, and the key frames (a,) and (b,) of each."""
    builder = thaw(known, int(np.diff(new.feature_start).max()))
    if builder.readout.seconds == 0.0 and known.camera == new.camera:
        # The map that was there is older than what is known of its camera.
        builder.readout = ReadoutTime(float(new.readout_s[0]))
    new_index = graft(builder, new, known_from_new)
    return builder, np.arange(known.keyframe_count, dtype=np.int32), new_index


def _thinned(builder: MapBuilder, loops: list[VerifiedLoop]) -> list[VerifiedLoop]:
    """Return the matches that are some way apart: neighbours say the same."""
    centres = camera_centres(builder.camera_from_world)
    chosen = [loops[0]]
    for loop in loops[1:]:
        if np.linalg.norm(centres[loop.keyframe] - centres[chosen[-1].keyframe]) >= LOOP_SPACING_M:
            chosen.append(loop)
    return chosen


# ----------------------------------------------------------------------------------------------------- welding
def _weld(builder: MapBuilder, known: IntArray, new: IntArray, radius_px: float) -> None:
    """Fuse what both maps show, wherever key frames of both stand near each other and look the same way."""
    for side, other in ((new, known), (known, new)):
        for keyframe in side.tolist():
            near = _near(builder, keyframe, other, NEAR_M)[:NEIGHBOURS]
            if len(near):
                mapping.project_and_fuse(builder, keyframe, local_landmarks(builder, near), radius_px)
    builder.refresh_landmarks(np.flatnonzero(builder.landmark_alive).astype(np.int32))


def _near(builder: MapBuilder, keyframe: int, others: IntArray, reach_m: float) -> IntArray:
    """Return those of the others that stand near a key frame and look the same way, nearest first."""
    poses = builder.camera_from_world
    distance_m = np.linalg.norm(camera_centres(poses[others]) - camera_centres(poses[keyframe][None]), axis=1)
    alike = poses[others, 2, :3] @ poses[keyframe, 2, :3] > NEAR_COSINE
    near = np.flatnonzero(alike & (distance_m < reach_m))
    return np.asarray(others[near[np.argsort(distance_m[near], kind="stable")]])


def _refuse_contradiction(builder: MapBuilder, known: IntArray, new: IntArray) -> None:
    """A wrong join shows: where the maps lie upon each other, most key frames find nothing of the other map."""
    expected, met = 0, 0
    for keyframe in new.tolist():
        near = _near(builder, keyframe, known, CLOSE_M)
        if len(near):
            row = builder.landmark_of[keyframe]
            shared = np.isin(row[row >= 0], local_landmarks(builder, near))
            expected += 1
            met += int(np.count_nonzero(shared) >= MIN_SHARED)
    if met < MIN_SHARED_SHARE * expected:
        raise MappingError(
            f"This recording was recognised in the site's map, but then only {met} of {expected} views agree with what"
            " the map shows there: record again, more slowly, looking the way that part was recorded."
        )


# ------------------------------------------------------------------------------------------------------ result
def _as_one_map(builder: MapBuilder, known: SlamMap, new: SlamMap, matches: int, seed: int) -> Joined:
    count = known.keyframe_count
    moved = Deformation(known.camera_from_world, builder.camera_from_world[:count].copy())
    keep_frame = frame_kept(moved)
    poses = builder.camera_from_world.copy()
    stamps = np.concatenate([known.trajectory_stamp_s, new.trajectory_stamp_s])
    trajectory = np.concatenate([carried_trajectory(known, poses[:count]), carried_trajectory(new, poses[count:])])
    sessions = np.concatenate([known.trajectory_session, new.trajectory_session])
    frozen = freeze(builder, trained_places(builder, seed), list(zip(stamps, trajectory, strict=True)), sessions)
    slam_map = replace(frozen, parent=spanning_parents(frozen)).transformed(keep_frame)
    after = slam_map.camera_from_world
    return Joined(
        slam_map,
        Deformation(known.camera_from_world, after[:count]),
        Deformation(new.camera_from_world, after[count:]),
        matches,
    )


def carried_trajectory(slam_map: SlamMap, camera_from_world: FloatArray) -> FloatArray:
    """Return the trajectory (T, 4, 4) of a map whose key frames now have other poses (K, 4, 4).

    Each frame goes with the key frame of its recording that is nearest in time.
    """
    nearest = np.zeros(len(slam_map.trajectory), np.int64)
    for session in np.unique(slam_map.keyframe_session).tolist():
        keyframes = np.flatnonzero(slam_map.keyframe_session == session)
        frames = np.flatnonzero(slam_map.trajectory_session == session)
        if len(keyframes) and len(frames):
            in_time = nearest_index(slam_map.keyframe_stamp_s[keyframes], slam_map.trajectory_stamp_s[frames])
            nearest[frames] = keyframes[in_time]
    step = np.linalg.inv(camera_from_world) @ slam_map.camera_from_world
    return np.asarray(step[nearest] @ slam_map.trajectory)


def trained_places(builder: MapBuilder, seed: int) -> PlaceIndex:
    """Return an index with a vocabulary trained on all living key frames; :func:`freeze` fills it."""
    alive = np.flatnonzero(builder.keyframe_alive).tolist()
    descriptors = np.concatenate([builder.keyframes[k].features.descriptors for k in alive])
    return PlaceIndex(Vocabulary.train(descriptors, seed))

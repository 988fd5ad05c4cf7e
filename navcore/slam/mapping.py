"""Local mapping: what happens to the map when a key frame joins it.

New landmarks from depth (and by triangulation where there is none), fusion with what the neighbours already hold, local
bundle adjustment, and culling of landmarks that are rarely found again and of key frames that show nothing new
(Mur-Artal et al. 2015, section VI; Mur-Artal and Tardós 2017, section III).
"""

from __future__ import annotations

import numpy as np

from navcore.geometry import FloatArray
from navcore.slam.bundle_adjustment import BundleResult, bundle_adjust
from navcore.slam.keyframes import Features, IntArray
from navcore.slam.map import BoolArray, MapBuilder, Observations
from navcore.slam.matching import DISTANCE_STRICT, match_projected, project_landmarks
from navcore.slam.readout_estimation import parameter_step
from navcore.slam.rolling_shutter import unrolled
from navcore.slam.tracking import SCALES

MAX_LANDMARK_DEPTH_M = 6.0
"""Depth beyond which a sensor's noise makes no useful landmark."""
LOCAL_ADJUSTMENT_KEYFRAMES = 30
"""Key frames that local bundle adjustment moves, at most."""
READOUT_ROUNDS = 3
"""Times that a local bundle adjustment is done, at most, while the readout time is being found."""
READOUT_SETTLED_S = 5e-4
"""A change of the readout time below this moves features by less than they are uncertain."""
FIXED_KEYFRAMES = 100
"""Key frames that hold them in place, at most."""
FINAL_DEPTH_FACTOR = 4.0
"""Times the virtual baseline, in the last adjustment: at 100 px·m, a depth z then counts as measured to z²/400 m."""
FUSION_NEIGHBOURS = 10
"""Covisible key frames with which landmarks are fused."""
FUSION_RADIUS_PX = 3.0
"""Search radius at pyramid level 0 when fusing."""
REDUNDANT_SHARE = 0.9
"""A key frame is redundant when this share of its landmarks is seen by three others at the same or a finer scale."""
MIN_FOUND_RATIO = 0.25
"""A young landmark found in a smaller share of the frames that should show it is culled."""
YOUNG_KEYFRAMES = 3
"""For so many key frames a landmark counts as young."""


def add_landmarks_from_depth(builder: MapBuilder, keyframe: int) -> int:
    """Make landmarks of the key frame's features that have a depth and show none yet; return how many."""
    features = builder.keyframes[keyframe].features
    free = builder.landmark_of[keyframe, : len(features)] < 0
    near = np.nan_to_num(features.depth_m, nan=np.inf) <= MAX_LANDMARK_DEPTH_M
    chosen = np.flatnonzero(free & near).astype(np.int32)
    world_from_camera = np.linalg.inv(builder.camera_from_world[keyframe])
    points = features.points_in_camera(builder.camera)[chosen]
    builder.add_landmarks(keyframe, chosen, points @ world_from_camera[:3, :3].T + world_from_camera[:3, 3])
    return len(chosen)


def cull_young_landmarks(builder: MapBuilder, keyframe: int) -> None:
    """Cull landmarks that are seldom found again, or seen by fewer than three key frames when they stop being young."""
    age = keyframe - builder.first_keyframe
    young = builder.landmark_alive & (age >= 1) & (age <= YOUNG_KEYFRAMES)
    seldom = young & (builder.found < MIN_FOUND_RATIO * builder.visible)
    lonely = young & (age >= YOUNG_KEYFRAMES - 1) & (builder.observation_counts() < 2)
    gone = np.flatnonzero(seldom | lonely).astype(np.int32)
    if len(gone):
        builder.remove_landmarks(gone)


def fuse_with_neighbours(builder: MapBuilder, keyframe: int) -> None:
    """Join the key frame's landmarks with the neighbours': each is looked for in the other's features."""
    neighbours, _ = builder.covisible(keyframe, 15)
    neighbours = neighbours[:FUSION_NEIGHBOURS]
    if len(neighbours) == 0:
        return
    own = _landmarks_of(builder, keyframe)
    for neighbour in neighbours.tolist():
        project_and_fuse(builder, neighbour, own)
    theirs = [_landmarks_of(builder, neighbour) for neighbour in neighbours.tolist()]
    project_and_fuse(builder, keyframe, np.unique(np.concatenate(theirs)))
    builder.refresh_landmarks(_landmarks_of(builder, keyframe))


def _landmarks_of(builder: MapBuilder, keyframe: int) -> IntArray:
    row = builder.landmark_of[keyframe]
    return np.unique(row[row >= 0])


def project_and_fuse(
    builder: MapBuilder, keyframe: int, landmarks: IntArray, radius_px: float = FUSION_RADIUS_PX
) -> int:
    """Look for landmarks in a key frame that does not see them; connect them, or fuse them with what is there.

    Of two landmarks at one feature the one seen by more key frames survives. Return how many were connected or fused.
    """
    landmarks = landmarks[builder.landmark_alive[landmarks]]
    features = builder.keyframes[keyframe].features
    row = builder.landmark_of[keyframe, : len(features)]
    landmarks = landmarks[~np.isin(landmarks, row[row >= 0])]
    if len(landmarks) == 0:
        return 0
    uvr, _, octave, _ = project_landmarks(
        builder.camera_from_world[keyframe],
        builder.positions[landmarks],
        builder.normals[landmarks],
        builder.reach[landmarks],
        builder.camera,
    )
    visible = octave >= 0
    landmarks, uvr, octave = landmarks[visible], uvr[visible], octave[visible]
    match = match_projected(
        features,
        uvr[:, :2],
        uvr[:, 2],
        radius_px * SCALES[octave],
        octave - 1,
        octave + 1,
        builder.descriptors[landmarks],
        np.zeros(len(features), np.bool_),
        DISTANCE_STRICT,
    )
    matched = match >= 0
    landmarks, match, uvr = landmarks[matched], match[matched], uvr[matched]
    agrees = _agrees(features, match, uvr)
    landmarks, match = landmarks[agrees], match[agrees]
    there = row[match].copy()
    builder.connect(keyframe, match[there < 0], landmarks[there < 0])
    old, new = landmarks[there >= 0], there[there >= 0]
    counts = builder.observation_counts()
    swap = counts[old] > counts[new]
    builder.fuse_landmarks(np.where(swap, new, old), np.where(swap, old, new))
    return len(landmarks)


def _agrees(features: Features, match: IntArray, uvr: FloatArray) -> BoolArray:
    """Return whether each projection lies within the 95 % bound of its feature, χ² of two or three coordinates."""
    error = (features.uvr_px[match] - uvr) ** 2
    depthless = np.isnan(error[:, 2])
    chi2 = (error[:, :2].sum(axis=1) + np.nan_to_num(error[:, 2])) * features.inv_sigma2[match]
    agrees: BoolArray = chi2 < np.where(depthless, 5.99, 7.81)
    return agrees


# -------------------------------------------------------------------------------------------------- adjustment
def adjust_locally(builder: MapBuilder, keyframe: int, iterations: int = 10) -> None:
    """Bundle-adjust the key frame, its covisible ones and all that they see; others that see it hold it in place.

    While it says that the readout takes otherwise than was thought, the features move, and it is done again.
    """
    neighbours, _ = builder.covisible(keyframe, 15)
    moving = np.concatenate([[keyframe], neighbours[: LOCAL_ADJUSTMENT_KEYFRAMES - 1]]).astype(np.int32)
    for _ in range(READOUT_ROUNDS):
        before_s = builder.readout.seconds
        adjust(builder, moving, iterations)
        if abs(builder.readout.seconds - before_s) < READOUT_SETTLED_S:
            break


def adjust_all(builder: MapBuilder, iterations: int = 10) -> None:
    """Bundle-adjust the whole map; the first living key frame stays where it is."""
    adjust(builder, np.flatnonzero(builder.keyframe_alive).astype(np.int32), iterations)


def settle_all(builder: MapBuilder, iterations: int = 15) -> None:
    """Bundle-adjust the whole map a last time, depth weighing what the sensor deserves; no observation is dropped.

    While the map grows, depth must not outweigh the image: it errs at edges and lags in fast turns. In a map that fits
    together its noise is what remains, and averages out.
    """
    moving = np.flatnonzero(builder.keyframe_alive).astype(np.int32)
    adjust(builder, moving, iterations, depth_factor=FINAL_DEPTH_FACTOR, drops=False)


def adjust(
    builder: MapBuilder, moving: IntArray, iterations: int, *, depth_factor: float = 1.0, drops: bool = True
) -> None:
    """Bundle-adjust key frames and the landmarks they see.

    ``depth_factor`` multiplies the baseline that depth is weighed with; where ``drops``, observations that disagree are
    dropped.
    """
    rows = builder.landmark_of[moving]
    landmarks = np.unique(rows[rows >= 0])
    if len(landmarks) == 0:
        return
    seeing, _ = builder.keyframes_seeing(landmarks)
    holding = seeing[~np.isin(seeing, moving)][:FIXED_KEYFRAMES]
    keyframes = np.sort(np.concatenate([moving, holding])).astype(np.int32)
    chosen = np.zeros(builder.landmark_count, np.bool_)
    chosen[landmarks] = True
    seen = builder.observations(keyframes, chosen)
    # What depth has placed, a handful of landmarks must not move.
    fixed = np.isin(keyframes, holding) | np.isin(keyframes, list(builder.depth_carried))
    if not fixed.any():
        fixed[0] = True
    camera = builder.camera
    uvr_px = seen.uvr_px.copy()
    uvr_px[:, 2] = uvr_px[:, 0] - depth_factor * (uvr_px[:, 0] - uvr_px[:, 2])
    keyframe_index = np.searchsorted(keyframes, seen.keyframe).astype(np.int32)
    landmark_index = np.searchsorted(landmarks, seen.landmark).astype(np.int32)
    result = bundle_adjust(
        camera.fx_px,
        camera.fy_px,
        camera.cx_px,
        camera.cy_px,
        camera.bf_px_m * depth_factor,
        builder.camera_from_world[keyframes],
        fixed,
        builder.positions[landmarks],
        keyframe_index,
        landmark_index,
        uvr_px,
        seen.inv_sigma2,
        iterations,
    )
    builder.camera_from_world[keyframes] = result.poses
    builder.positions[landmarks] = result.points
    _refine_readout(builder, seen, result, fixed, keyframe_index, landmark_index, uvr_px, depth_factor)
    if drops:
        _drop(builder, seen, ~result.inlier, landmarks)
    builder.refresh_landmarks(landmarks)


def _refine_readout(
    builder: MapBuilder, seen: Observations, result: BundleResult, fixed: BoolArray, keyframe_index: IntArray,
    landmark_index: IntArray, uvr_px: FloatArray, depth_factor: float,
) -> None:  # fmt: skip
    """Take in what an adjustment says of the readout time."""
    camera = builder.camera
    per_s = _per_second_of_readout(builder, seen)
    per_s[:, 2] = per_s[:, 0] - depth_factor * (per_s[:, 0] - per_s[:, 2])
    pinhole = np.array([camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px, camera.bf_px_m * depth_factor])
    step = parameter_step(
        pinhole,
        result.poses,
        fixed,
        result.points,
        keyframe_index,
        landmark_index,
        uvr_px,
        per_s,
        seen.inv_sigma2,
        result.inlier,
    )
    builder.refine_readout(*step)


def _per_second_of_readout(builder: MapBuilder, seen: Observations) -> FloatArray:
    """Return how observations (m, 3) change with the readout time, px/s; zero where the velocity is not known."""
    per_s = np.zeros((len(seen.keyframe), 3))
    for keyframe in np.unique(seen.keyframe).tolist():
        held = builder.keyframes[keyframe]
        if held.velocity is None:
            continue
        own = np.flatnonzero(seen.keyframe == keyframe)
        longer, shorter = (
            unrolled(held.features, held.velocity, builder.readout.seconds + half, builder.camera).uvr_px
            for half in (0.5e-3, -0.5e-3)
        )
        per_s[own] = 1e3 * (longer - shorter)[seen.feature[own]]
    return per_s


def _drop(builder: MapBuilder, seen: Observations, wrong: BoolArray, landmarks: IntArray) -> None:
    builder.disconnect(seen.keyframe[wrong], seen.feature[wrong])
    unseen = landmarks[builder.observation_counts()[landmarks] == 0]
    if len(unseen):
        builder.remove_landmarks(unseen)


# ----------------------------------------------------------------------------------------------------- culling
def cull_redundant_keyframes(builder: MapBuilder, keyframe: int) -> int:
    """Cull neighbours of a key frame whose landmarks others show as well; return how many.

    What is known of no landmark stays: the place that depth gave a key frame, and how far it may have drifted.
    """
    neighbours, _ = builder.covisible(keyframe, 15)
    culled = 0
    protected = {
        0,
        keyframe,
        *builder.depth_carried,
        *builder.drifts,
        *(k for i, j, _ in builder.loop_edges for k in (i, j)),
    }
    for neighbour in neighbours.tolist():
        if neighbour in protected:
            continue
        seen, redundant = builder.redundancy(neighbour, 3)
        if seen and redundant > REDUNDANT_SHARE * seen:
            builder.remove_keyframe(neighbour)
            culled += 1
    return culled

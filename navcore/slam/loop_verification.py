"""Is this key frame really where that one was? Geometry decides, and everything that speaks against it counts.

A false loop ruins the whole map, a missed one only leaves some drift: so a loop must be supported by many landmarks
that agree on one rigid motion, found again by projection, and must not be contradicted by depth (a camera cannot see
through what the map says is there) nor by more drift than a walk of that length can have.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from navcore.compiled import kernel
from navcore.geometry import FloatArray
from navcore.slam.keyframes import Features, IntArray
from navcore.slam.map import MapBuilder
from navcore.slam.matching import DISTANCE_LOOSE, match_all, match_projected, project_landmarks
from navcore.slam.pose import align_ransac, refine_pose
from navcore.slam.tracking import SCALES, local_landmarks

MIN_ALIKE = 15
"""Descriptors that must match."""
MIN_RIGID = 12
"""Of them, those that must agree on one rigid motion."""
MIN_GUIDED = 35
"""Landmarks that must be found by projection around that motion."""
MIN_FOUND_SHARE = 0.12
"""Of the landmarks that should be visible, the share that must be found."""
MAX_CONTRADICTED_SHARE = 0.25
"""Of the landmarks at whose place depth was measured, the share that may be seen through."""
MIN_SPREAD_PX = 0.08
"""The supporting features' standard deviation in the image, as a share of its width, must reach this both ways."""
DESCRIPTOR_DISTANCE = 64
DESCRIPTOR_RATIO = 0.85
NEIGHBOURHOOD = 10
"""Covisible key frames whose landmarks are looked for together with the candidate's."""
GUIDED_RADIUS_PX = 10.0
"""Search radius of the first guided round at pyramid level 0, in an image 320 pixels wide."""


@dataclass(frozen=True, slots=True, eq=False)
class VerifiedLoop:
    """A key frame seen again from the landmarks of another time."""

    keyframe: int
    candidate: int
    camera_from_world: FloatArray
    """(4, 4): where the key frame must be, by the candidate's landmarks."""
    feature: IntArray
    """(m,): features of the key frame that show …"""
    landmark: IntArray
    """(m,): … these landmarks of the candidate's neighbourhood."""


def verify(builder: MapBuilder, keyframe: int, candidate: int, seed: int = 0) -> VerifiedLoop | None:
    """Return the loop between two key frames, or None where geometry does not support it."""
    held = builder.keyframes[keyframe]
    guess = _rigid_guess(builder, held.features, candidate, seed)
    if guess is None:
        return None
    neighbours, _ = builder.covisible(candidate, 10)
    around = np.concatenate([[candidate], neighbours[:NEIGHBOURHOOD]]).astype(np.int32)
    landmarks = local_landmarks(builder, around)
    scale = builder.camera.width_px / 320
    pose, feature, landmark = guess, np.zeros(0, np.int32), np.zeros(0, np.int32)
    for radius_px in (GUIDED_RADIUS_PX, 0.5 * GUIDED_RADIUS_PX):
        pose, feature, landmark, expected = _guided(builder, held.features, pose, landmarks, radius_px * scale)
        if len(feature) < MIN_GUIDED:
            return None
    if len(feature) < MIN_FOUND_SHARE * expected or not is_spread(builder, held.features, feature):
        return None
    if contradicted_share(builder, held.features, pose, landmarks) > MAX_CONTRADICTED_SHARE:
        return None
    return VerifiedLoop(keyframe, candidate, pose, feature, landmark)


def _rigid_guess(builder: MapBuilder, features: Features, candidate: int, seed: int) -> FloatArray | None:
    """Align the features' measured points with the candidate's landmarks of the same look (Horn within RANSAC)."""
    landmarks = local_landmarks(builder, np.array([candidate], dtype=np.int32))
    measured = np.flatnonzero(np.isfinite(features.depth_m)).astype(np.int32)
    if min(len(landmarks), len(measured)) < MIN_ALIKE:
        return None
    match = match_all(
        builder.descriptors[landmarks], features.descriptors[measured], DESCRIPTOR_DISTANCE, DESCRIPTOR_RATIO
    )
    matched = np.flatnonzero(match >= 0)
    if len(matched) < MIN_ALIKE:
        return None
    seen = measured[match[matched]]
    in_camera = features.points_in_camera(builder.camera)[seen]
    in_world = builder.positions[landmarks[matched]]
    # Depth gets worse with the square of the distance; a few pixels' worth of it must be allowed.
    tolerance_m = 0.05 + 0.012 * in_camera[:, 2] ** 2
    aligned = align_ransac(in_camera, in_world, tolerance_m, seed, min_inliers=MIN_RIGID)
    return None if aligned is None else aligned[0]


def _guided(
    builder: MapBuilder, features: Features, pose: FloatArray, landmarks: IntArray, radius_px: float
) -> tuple[FloatArray, IntArray, IntArray, int]:
    """Look for landmarks by projection and refine: pose, features and landmarks that agree, how many were expected."""
    camera = builder.camera
    uvr, _, octave, _ = project_landmarks(
        pose, builder.positions[landmarks], builder.normals[landmarks], builder.reach[landmarks], camera
    )
    visible = octave >= 0
    wanted, uvr, octave = landmarks[visible], uvr[visible], octave[visible]
    match = match_projected(
        features,
        uvr[:, :2],
        uvr[:, 2],
        radius_px * SCALES[octave],
        octave - 1,
        octave + 1,
        builder.descriptors[wanted],
        np.zeros(len(features), np.bool_),
        DISTANCE_LOOSE,
        0.9,
    )
    found = match >= 0
    feature, landmark = match[found], wanted[found]
    pose, inlier, _ = refine_pose(
        pose,
        builder.positions[landmark],
        features.uvr_px[feature],
        features.inv_sigma2[feature],
        camera.fx_px,
        camera.fy_px,
        camera.cx_px,
        camera.cy_px,
        camera.bf_px_m,
    )
    return pose, feature[inlier], landmark[inlier], len(wanted)


def is_spread(builder: MapBuilder, features: Features, feature: IntArray | NDArray[np.intp]) -> bool:
    """Return whether the supporting features cover the image: one poster or door plate is not a place."""
    spread = np.std(features.uv_px[feature], axis=0)
    return bool(np.all(spread >= MIN_SPREAD_PX * builder.camera.width_px))


def contradicted_share(builder: MapBuilder, features: Features, pose: FloatArray, landmarks: IntArray) -> float:
    """Return the share of landmarks that the camera would have to look through, of those near a measured depth.

    A landmark that lies behind what was measured is hidden, and says nothing.
    """
    uvr, _, octave, _ = project_landmarks(
        pose, builder.positions[landmarks], builder.normals[landmarks], builder.reach[landmarks], builder.camera
    )
    visible = octave >= 0
    depth_m = builder.camera.bf_px_m / (uvr[visible, 0] - uvr[visible, 2])
    measured = np.isfinite(features.depth_m)
    agree, through = _compare_depth(
        np.ascontiguousarray(uvr[visible, :2]),
        depth_m,
        np.ascontiguousarray(features.uvr_px[measured, :2]),
        features.depth_m[measured],
        8.0 * builder.camera.width_px / 320,
    )
    return through / max(agree + through, 1)


@kernel
def _compare_depth(
    uv: FloatArray, depth: FloatArray, measured_uv: FloatArray, measured_depth: FloatArray, radius: float
) -> tuple[int, int]:
    """Count the points that the nearest measured depth confirms, and those that it looks through."""
    agree, through = 0, 0
    for i in range(len(uv)):
        best, nearest = radius * radius, -1
        for m in range(len(measured_uv)):
            d = (uv[i, 0] - measured_uv[m, 0]) ** 2 + (uv[i, 1] - measured_uv[m, 1]) ** 2
            if d < best:
                best, nearest = d, m
        if nearest < 0:
            continue
        difference = measured_depth[nearest] - depth[i]
        tolerance = 0.15 + 0.06 * depth[i]
        if abs(difference) <= tolerance:
            agree += 1
        elif difference > 2.0 * tolerance:
            through += 1
    return agree, through


def warm_up() -> None:
    """Compile this module's kernels."""
    _compare_depth(np.zeros((1, 2)), np.ones(1), np.zeros((1, 2)), np.ones(1), 8.0)

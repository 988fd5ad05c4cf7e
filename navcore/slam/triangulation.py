"""Landmarks where there is no depth: far walls, glossy and dark things, found by the parallax between key frames.

Features of a new key frame that show no landmark and have no usable depth are matched with such features of earlier key
frames that saw the same things from elsewhere: along the epipolar line, by descriptor. What both rays agree on becomes
a landmark (Mur-Artal et al. 2015, section VI-C). In wide rooms, most of the walls come into the map only like this.
"""

from __future__ import annotations

import math

import numpy as np

from navcore.compiled import kernel
from navcore.geometry import FloatArray
from navcore.slam.descriptors import WordArray, as_words, bit_distance
from navcore.slam.keyframes import INV_SIGMA2, IntArray
from navcore.slam.map import MapBuilder
from navcore.slam.pose_kernels import CHI2_MONO

MIN_BASELINE_M = 0.4
"""Key frames nearer to each other than this show no parallax of what is far away."""
MAX_BASELINE_M = 3.0
"""Key frames farther apart than this show other things, or the same too differently."""
MIN_AXIS_COSINE = 0.8
"""Key frames whose optical axes differ by more than 37° have little in common."""
PARTNERS = 3
"""Earlier key frames with which a new one is compared, at most: the nearest, the farthest, and between them."""
MIN_PARALLAX_COSINE = math.cos(math.radians(1.2))
"""Rays that are more parallel than this meet nowhere in particular."""
MAX_DISTANCE = 50
"""Bits that the two descriptors may differ by."""
MAX_RATIO = 0.8
"""Best distance over second best along the epipolar line, at most."""
MAX_TURN_RAD = math.radians(30.0)
"""The orientations of the two features may differ by this."""
EPIPOLAR_CHI2 = 3.84
"""95 % of the χ² distribution with one degree of freedom: distance from the epipolar line."""


def add_landmarks_without_depth(builder: MapBuilder, keyframe: int, max_depth_m: float) -> int:
    """Make landmarks of the key frame's features that have no depth up to ``max_depth_m``; return how many."""
    added = 0
    for partner in _partners(builder, keyframe).tolist():
        own, theirs = _free(builder, keyframe, max_depth_m), _free(builder, partner, max_depth_m)
        if len(own) == 0 or len(theirs) == 0:
            continue
        match, points = _triangulated(builder, keyframe, own, partner, theirs)
        found = np.flatnonzero(match >= 0)
        if len(found) == 0:
            continue
        new = builder.add_landmarks(keyframe, own[found], points[found])
        builder.connect(partner, theirs[match[found]], new)
        added += len(found)
    return added


def _partners(builder: MapBuilder, keyframe: int) -> IntArray:
    """Return earlier key frames that look the same way from elsewhere, among those that share landmarks."""
    others, _ = builder.covisible(keyframe, 10)
    poses = builder.camera_from_world
    centres = -np.einsum("kji,kj->ki", poses[others][:, :3, :3], poses[others][:, :3, 3])
    pose = poses[keyframe]
    baseline_m = np.linalg.norm(centres + pose[:3, :3].T @ pose[:3, 3], axis=1)
    cosine = poses[others][:, 2, :3] @ pose[2, :3]
    fit = (baseline_m >= MIN_BASELINE_M) & (baseline_m <= MAX_BASELINE_M) & (cosine >= MIN_AXIS_COSINE)
    chosen: IntArray = others[fit][np.argsort(baseline_m[fit], kind="stable")].astype(np.int32)
    if len(chosen) <= PARTNERS:
        return chosen
    spread = np.linspace(0, len(chosen) - 1, PARTNERS).round().astype(np.int64)
    return np.asarray(chosen[spread], dtype=np.int32)


def _free(builder: MapBuilder, keyframe: int, max_depth_m: float) -> IntArray:
    """Return the features that show no landmark and have no usable depth."""
    features = builder.keyframes[keyframe].features
    is_far = ~(features.depth_m <= max_depth_m)
    return np.flatnonzero(is_far & (builder.landmark_of[keyframe, : len(features)] < 0)).astype(np.int32)


def _triangulated(
    builder: MapBuilder, keyframe: int, own: IntArray, partner: int, theirs: IntArray
) -> tuple[IntArray, FloatArray]:
    """Return for each of the key frame's features (n,) the partner's (of ``theirs``, or −1), and the points (n, 3)."""
    a, b = builder.keyframes[keyframe].features, builder.keyframes[partner].features
    camera = builder.camera
    return triangulate(
        np.ascontiguousarray(builder.camera_from_world[keyframe]),
        np.ascontiguousarray(builder.camera_from_world[partner]),
        np.ascontiguousarray(a.uvr_px[own]),
        np.ascontiguousarray(b.uvr_px[theirs]),
        as_words(a.descriptors[own]),
        as_words(b.descriptors[theirs]),
        a.octave[own],
        b.octave[theirs],
        a.angle_rad[own],
        b.angle_rad[theirs],
        INV_SIGMA2,
        (camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px),
    )


def warm_up() -> None:
    """Compile this module's kernels."""
    uvr, words = np.array([[10.0, 10.0, np.nan]]), np.zeros((1, 4), np.uint64)
    octave, angle = np.zeros(1, np.int32), np.zeros(1)
    pose_b = np.eye(4)
    pose_b[0, 3] = -1.0
    triangulate(
        np.eye(4), pose_b, uvr, uvr, words, words, octave, octave, angle, angle, INV_SIGMA2, (100.0, 100.0, 50.0, 50.0)
    )


# --------------------------------------------------------------------------------------------------- kernels
@kernel
def triangulate(
    pose_a: FloatArray,
    pose_b: FloatArray,
    uvr_a: FloatArray,
    uvr_b: FloatArray,
    words_a: WordArray,
    words_b: WordArray,
    octave_a: IntArray,
    octave_b: IntArray,
    angle_a: FloatArray,
    angle_b: FloatArray,
    inv_sigma2: FloatArray,
    camera: tuple[float, float, float, float],
) -> tuple[IntArray, FloatArray]:
    """Match features of two key frames along epipolar lines; return the match of each of a (n,), and the points (n, 3).

    ``pose_a`` and ``pose_b`` (4, 4) are camera_from_world; ``camera`` is fx, fy, cx, cy.
    """
    count = len(uvr_a)
    match = np.full(count, -1, np.int32)
    points = np.full((count, 3), np.nan)
    owner = np.full(len(uvr_b), -1, np.int32)
    distance_of = np.full(count, 1 << 20, np.int32)
    rotation, shift = _b_from_a(pose_a, pose_b)
    in_a = np.empty(3)
    line = np.empty(3)
    for i in range(count):
        ray_x, ray_y = (uvr_a[i, 0] - camera[2]) / camera[0], (uvr_a[i, 1] - camera[3]) / camera[1]
        _epipolar_line(rotation, shift, ray_x, ray_y, camera, line)
        best_feature, best, second = _best_along(
            line, words_a[i], octave_a[i], angle_a[i], uvr_b, words_b, octave_b, angle_b, inv_sigma2
        )
        if best > MAX_DISTANCE or best > MAX_RATIO * second:
            continue
        sigma_a, sigma_b = inv_sigma2[octave_a[i]], inv_sigma2[octave_b[best_feature]]
        if not _meet(rotation, shift, uvr_a[i], uvr_b[best_feature], camera, sigma_a, sigma_b, in_a):
            continue
        rival = owner[best_feature]
        if rival >= 0:
            if distance_of[rival] <= best:
                continue
            match[rival] = -1
        owner[best_feature] = i
        match[i] = best_feature
        distance_of[i] = best
        for r in range(3):
            points[i, r] = 0.0
            for c in range(3):
                points[i, r] += pose_a[c, r] * (in_a[c] - pose_a[c, 3])
    return match, points


@kernel
def _best_along(
    line: FloatArray,
    words: WordArray,
    octave: int,
    angle: float,
    uvr: FloatArray,
    words_b: WordArray,
    octave_b: IntArray,
    angle_b: FloatArray,
    inv_sigma2: FloatArray,
) -> tuple[int, int, int]:
    """Return the feature of b on a line that looks most alike (−1: none), its distance, and the second best's."""
    best, second, best_feature = 1 << 20, 1 << 20, -1
    for k in range(len(uvr)):
        if abs(octave - octave_b[k]) > 2:
            continue
        away = line[0] * uvr[k, 0] + line[1] * uvr[k, 1] + line[2]
        if away * away * inv_sigma2[octave_b[k]] > EPIPOLAR_CHI2:
            continue
        turn = angle_b[k] - angle
        turn -= 2.0 * np.pi * np.floor(turn / (2.0 * np.pi) + 0.5)
        if abs(turn) > MAX_TURN_RAD:
            continue
        d = bit_distance(words, words_b[k])
        if d < best:
            second, best, best_feature = best, d, k
        elif d < second:
            second = d
    return best_feature, best, second


@kernel
def _b_from_a(pose_a: FloatArray, pose_b: FloatArray) -> tuple[FloatArray, FloatArray]:
    rotation = np.zeros((3, 3))
    shift = np.empty(3)
    for r in range(3):
        for c in range(3):
            for k in range(3):
                rotation[r, c] += pose_b[r, k] * pose_a[c, k]
        shift[r] = pose_b[r, 3]
        for c in range(3):
            shift[r] -= rotation[r, c] * pose_a[c, 3]
    return rotation, shift


@kernel
def _epipolar_line(
    rotation: FloatArray,
    shift: FloatArray,
    ray_x: float,
    ray_y: float,
    camera: tuple[float, float, float, float],
    line: FloatArray,
) -> None:
    """Fill ``line`` (3,) with a, b, c of the line a u + b v + c = 0 in b, normalized, on which a ray of a is seen."""
    turned = np.empty(3)
    for r in range(3):
        turned[r] = rotation[r, 0] * ray_x + rotation[r, 1] * ray_y + rotation[r, 2]
    n0 = shift[1] * turned[2] - shift[2] * turned[1]
    n1 = shift[2] * turned[0] - shift[0] * turned[2]
    n2 = shift[0] * turned[1] - shift[1] * turned[0]
    a, b = n0 / camera[0], n1 / camera[1]
    length = max(math.sqrt(a * a + b * b), 1e-12)
    line[0] = a / length
    line[1] = b / length
    line[2] = (n2 - a * camera[2] - b * camera[3]) / length


@kernel
def _meet(
    rotation: FloatArray,
    shift: FloatArray,
    seen_a: FloatArray,
    seen_b: FloatArray,
    camera: tuple[float, float, float, float],
    weight_a: float,
    weight_b: float,
    point: FloatArray,
) -> bool:
    """Fill ``point`` (3,), in a's frame, with where two rays come nearest; False where they do not fix it."""
    ax, ay = (seen_a[0] - camera[2]) / camera[0], (seen_a[1] - camera[3]) / camera[1]
    bx, by = (seen_b[0] - camera[2]) / camera[0], (seen_b[1] - camera[3]) / camera[1]
    # b's ray and its origin, in a's frame.
    ray = np.empty(3)
    origin = np.empty(3)
    for c in range(3):
        ray[c] = rotation[0, c] * bx + rotation[1, c] * by + rotation[2, c]
        origin[c] = -(rotation[0, c] * shift[0] + rotation[1, c] * shift[1] + rotation[2, c] * shift[2])
    aa, bb = ax * ax + ay * ay + 1.0, ray[0] * ray[0] + ray[1] * ray[1] + ray[2] * ray[2]
    ab = ax * ray[0] + ay * ray[1] + ray[2]
    if ab / math.sqrt(aa * bb) > MIN_PARALLAX_COSINE:
        return False
    ao, bo = ax * origin[0] + ay * origin[1] + origin[2], ray[0] * origin[0] + ray[1] * origin[1] + ray[2] * origin[2]
    determinant = aa * bb - ab * ab
    along_a, along_b = (bb * ao - ab * bo) / determinant, (ab * ao - aa * bo) / determinant
    point[0] = 0.5 * (along_a * ax + origin[0] + along_b * ray[0])
    point[1] = 0.5 * (along_a * ay + origin[1] + along_b * ray[1])
    point[2] = 0.5 * (along_a + origin[2] + along_b * ray[2])
    return (
        along_a > 0.0
        and along_b > 0.0
        and _agrees(point[0], point[1], point[2], seen_a, camera, weight_a)
        and _agrees(
            rotation[0, 0] * point[0] + rotation[0, 1] * point[1] + rotation[0, 2] * point[2] + shift[0],
            rotation[1, 0] * point[0] + rotation[1, 1] * point[1] + rotation[1, 2] * point[2] + shift[1],
            rotation[2, 0] * point[0] + rotation[2, 1] * point[1] + rotation[2, 2] * point[2] + shift[2],
            seen_b,
            camera,
            weight_b,
        )
    )


@kernel
def _agrees(
    x: float, y: float, z: float, seen: FloatArray, camera: tuple[float, float, float, float], weight: float
) -> bool:
    if z < 0.1:
        return False
    u = camera[0] * x / z + camera[2] - seen[0]
    v = camera[1] * y / z + camera[3] - seen[1]
    return bool((u * u + v * v) * weight <= CHI2_MONO)

"""Which feature shows which landmark: guided searches in windows, and brute force where there is no guide.

Descriptors are compared by Hamming distance over four 64-bit words. Thresholds of distance and ratio are those of
ORB-SLAM (Mur-Artal et al. 2015).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from navcore.compiled import kernel
from navcore.geometry import FloatArray
from navcore.slam.descriptors import WordArray, as_words, bit_distance
from navcore.slam.features import GRID_PX
from navcore.slam.keyframes import LEVEL_COUNT, SCALE_FACTOR, ByteArray, Features, IntArray, SlamCamera

BoolArray = NDArray[np.bool_]

DISTANCE_STRICT = 50
"""Bits (of 256) that two descriptors of one point may differ by, where nothing else supports the match."""
DISTANCE_LOOSE = 100
"""The same, where a projection supports it."""
RATIO_LOCAL = 0.8
"""Best distance over second best, at most, among features of the same level in a window."""
ROTATION_BINS = 30
"""Bins of the histogram of orientation changes; matches outside its three fullest bins are dropped."""
MIN_VIEW_COSINE = 0.5
"""A landmark seen from more than 60° off its mean direction is not looked for."""


def match_projected(
    features: Features,
    uv_px: FloatArray,
    u_right_px: FloatArray,
    radius_px: FloatArray,
    low_octave: IntArray,
    high_octave: IntArray,
    descriptors: ByteArray,
    taken: BoolArray,
    max_distance: int = DISTANCE_LOOSE,
    ratio: float = 1.0,
    angles_rad: FloatArray | None = None,
) -> IntArray:
    """Return for each of n projected points the feature that shows it (n,), or −1.

    Points lie at ``uv_px`` (n, 2) with virtual right coordinate ``u_right_px`` (n,) and are looked for within
    ``radius_px`` (n,) (a radius ≤ 0 skips the point) at the levels ``low_octave`` to ``high_octave``. ``taken`` (m,)
    marks features that are not to be used. Each feature goes to the point whose descriptor is nearest. With
    ``angles_rad`` (n,), matches whose orientation changes otherwise than most are dropped.
    """
    match, _ = _match_projected(
        features.uvr_px,
        features.octave,
        as_words(features.descriptors),
        features.cell_start,
        features.cell_columns,
        np.ascontiguousarray(uv_px, dtype=np.float64),
        np.ascontiguousarray(u_right_px, dtype=np.float64),
        np.ascontiguousarray(radius_px, dtype=np.float64),
        np.ascontiguousarray(low_octave, dtype=np.int32),
        np.ascontiguousarray(high_octave, dtype=np.int32),
        as_words(descriptors),
        taken,
        max_distance,
        ratio,
    )
    if angles_rad is not None:
        keep_common_turn(match, np.ascontiguousarray(angles_rad, dtype=np.float64), features.angle_rad)
    return match


def match_all(
    descriptors_a: ByteArray,
    descriptors_b: ByteArray,
    max_distance: int = DISTANCE_STRICT,
    ratio: float = 0.75,
    angles_a_rad: FloatArray | None = None,
    angles_b_rad: FloatArray | None = None,
) -> IntArray:
    """Return for each descriptor of a (n, 32) its match among b (m, 32), or −1: best, clearly, and mutually."""
    match = _match_all(as_words(descriptors_a), as_words(descriptors_b), max_distance, ratio)
    if angles_a_rad is not None and angles_b_rad is not None:
        keep_common_turn(
            match,
            np.ascontiguousarray(angles_a_rad, dtype=np.float64),
            np.ascontiguousarray(angles_b_rad, dtype=np.float64),
        )
    return match


def project_landmarks(
    camera_from_world: FloatArray,
    positions: FloatArray,
    normals: FloatArray,
    reach: FloatArray,
    camera: SlamCamera,
) -> tuple[FloatArray, FloatArray, IntArray, FloatArray]:
    """Return u, v, u_r (n, 3), distance (n,), expected octave (n,; −1 where not visible) and view cosine (n,).

    A landmark (position (n, 3), mean viewing direction (n, 3), ``reach`` (n,)) is visible where it lies in front of the
    camera, inside the image, at a distance at which the pyramid can show it, and is seen from near its mean direction.
    """
    return _project_landmarks(
        np.ascontiguousarray(camera_from_world),
        np.ascontiguousarray(positions),
        np.ascontiguousarray(normals),
        np.ascontiguousarray(reach),
        camera.fx_px,
        camera.fy_px,
        camera.cx_px,
        camera.cy_px,
        camera.bf_px_m,
        float(camera.width_px),
        float(camera.height_px),
    )


# --------------------------------------------------------------------------------------------------- kernels
@kernel
def _best_two_in_window(
    feature_uvr: FloatArray,
    feature_octave: IntArray,
    feature_words: WordArray,
    cell_start: IntArray,
    columns: int,
    u: float,
    v: float,
    u_right: float,
    radius: float,
    low_octave: int,
    high_octave: int,
    words: WordArray,
    taken: BoolArray,
) -> tuple[int, int, int, int, int]:
    """Return the best feature (−1: none), its distance and octave, and distance and octave of the second best."""
    rows = (len(cell_start) - 1) // columns
    column0 = max(int((u - radius) // GRID_PX), 0)
    column1 = min(int((u + radius) // GRID_PX), columns - 1)
    row0 = max(int((v - radius) // GRID_PX), 0)
    row1 = min(int((v + radius) // GRID_PX), rows - 1)
    best, second = 1 << 20, 1 << 20
    best_feature, best_octave, second_octave = -1, -1, -1
    if column1 < column0:
        row1 = row0 - 1
    for row in range(row0, row1 + 1):
        # The cells of one row lie one after the other, and so do their features.
        for f in range(cell_start[row * columns + column0], cell_start[row * columns + column1 + 1]):
            octave = int(feature_octave[f])
            if taken[f] or octave < low_octave or octave > high_octave:
                continue
            if abs(feature_uvr[f, 0] - u) > radius or abs(feature_uvr[f, 1] - v) > radius:
                continue
            # NaN compares false: without depth on either side there is nothing to contradict.
            if abs(feature_uvr[f, 2] - u_right) > 2.0 * radius:
                continue
            d = bit_distance(words, feature_words[f])
            if d < best:
                second, second_octave = best, best_octave
                best, best_feature, best_octave = d, f, octave
            elif d < second:
                second, second_octave = d, octave
    return best_feature, best, best_octave, second, second_octave


@kernel
def _match_projected(
    feature_uvr: FloatArray,
    feature_octave: IntArray,
    feature_words: WordArray,
    cell_start: IntArray,
    columns: int,
    uv: FloatArray,
    u_right: FloatArray,
    radius: FloatArray,
    low_octave: IntArray,
    high_octave: IntArray,
    words: WordArray,
    taken: BoolArray,
    max_distance: int,
    ratio: float,
) -> tuple[IntArray, IntArray]:
    count = len(uv)
    match = np.full(count, -1, np.int32)
    distance_of = np.full(count, 1 << 20, np.int32)
    owner = np.full(len(feature_uvr), -1, np.int32)
    for i in range(count):
        if radius[i] <= 0.0:
            continue
        feature, best, best_octave, second, second_octave = _best_two_in_window(
            feature_uvr,
            feature_octave,
            feature_words,
            cell_start,
            columns,
            uv[i, 0],
            uv[i, 1],
            u_right[i],
            radius[i],
            int(low_octave[i]),
            int(high_octave[i]),
            words[i],
            taken,
        )
        if best > max_distance or (best_octave == second_octave and best > ratio * second):
            continue
        rival = owner[feature]
        if rival >= 0:
            if distance_of[rival] <= best:
                continue
            match[rival] = -1
        owner[feature] = i
        match[i] = feature
        distance_of[i] = best
    return match, distance_of


@kernel
def keep_common_turn(match: IntArray, angles_from: FloatArray, angles_to: FloatArray) -> None:
    """Drop (set to −1) matches (n,) whose turn lies outside the three fullest bins of the histogram of turns."""
    histogram = np.zeros(ROTATION_BINS, np.int64)
    bins = np.empty(len(match), np.int64)
    for i in range(len(match)):
        if match[i] >= 0:
            turn = (angles_to[match[i]] - angles_from[i]) / (2.0 * np.pi)
            turn -= np.floor(turn)
            bins[i] = int(turn * ROTATION_BINS + 0.5) % ROTATION_BINS
            histogram[bins[i]] += 1
    kept = np.zeros(ROTATION_BINS, np.bool_)
    fullest = histogram.max()
    for rank in range(3):
        best = -1
        for b in range(ROTATION_BINS):
            if not kept[b] and (best < 0 or histogram[b] > histogram[best]):
                best = b
        if rank > 0 and 10 * histogram[best] < fullest:
            break
        kept[best] = True
    for i in range(len(match)):
        if match[i] >= 0 and not kept[bins[i]]:
            match[i] = -1


@kernel
def _match_all(words_a: WordArray, words_b: WordArray, max_distance: int, ratio: float) -> IntArray:
    match = np.full(len(words_a), -1, np.int32)
    best_of_b = np.full(len(words_b), 1 << 20, np.int32)
    owner = np.full(len(words_b), -1, np.int32)
    for i in range(len(words_a)):
        best, second, best_feature = 1 << 20, 1 << 20, -1
        for j in range(len(words_b)):
            d = bit_distance(words_a[i], words_b[j])
            if d < best_of_b[j]:
                best_of_b[j] = d
                owner[j] = i
            if d < best:
                second, best, best_feature = best, d, j
            elif d < second:
                second = d
        if best <= max_distance and best < ratio * second:
            match[i] = best_feature
    for i in range(len(words_a)):
        if match[i] >= 0 and owner[match[i]] != i:
            match[i] = -1
    return match


@kernel
def _project_landmarks(
    camera_from_world: FloatArray,
    positions: FloatArray,
    normals: FloatArray,
    reach: FloatArray,
    fx: float,
    fy: float,
    cx: float,
    cy: float,
    bf: float,
    width: float,
    height: float,
) -> tuple[FloatArray, FloatArray, IntArray, FloatArray]:
    count = len(positions)
    uvr = np.full((count, 3), np.nan)
    distance = np.zeros(count)
    octave = np.full(count, -1, np.int32)
    cosine = np.zeros(count)
    rotation = camera_from_world[:3, :3]
    centre = np.zeros(3)
    for r in range(3):
        for c in range(3):
            centre[r] -= rotation[c, r] * camera_from_world[c, 3]
    log_scale = np.log(SCALE_FACTOR)
    for i in range(count):
        x, y, z = positions[i, 0], positions[i, 1], positions[i, 2]
        depth = rotation[2, 0] * x + rotation[2, 1] * y + rotation[2, 2] * z + camera_from_world[2, 3]
        if depth < 0.05:
            continue
        u = fx * (rotation[0, 0] * x + rotation[0, 1] * y + rotation[0, 2] * z + camera_from_world[0, 3]) / depth + cx
        v = fy * (rotation[1, 0] * x + rotation[1, 1] * y + rotation[1, 2] * z + camera_from_world[1, 3]) / depth + cy
        if u < 0.0 or u >= width or v < 0.0 or v >= height:
            continue
        dx, dy, dz = x - centre[0], y - centre[1], z - centre[2]
        range_m = np.sqrt(dx * dx + dy * dy + dz * dz)
        level = np.log(reach[i] * fx / range_m) / log_scale
        if level < -1.5 or level > LEVEL_COUNT + 0.5:
            continue
        view = (dx * normals[i, 0] + dy * normals[i, 1] + dz * normals[i, 2]) / range_m
        if view < MIN_VIEW_COSINE:
            continue
        uvr[i, 0] = u
        uvr[i, 1] = v
        uvr[i, 2] = u - bf / depth
        distance[i] = range_m
        cosine[i] = view
        octave[i] = min(max(int(np.floor(level + 0.5)), 0), LEVEL_COUNT - 1)
    return uvr, distance, octave, cosine

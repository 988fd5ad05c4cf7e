"""A finished map becomes a growing one again, so that another recording can be added to it."""

from __future__ import annotations

import numpy as np

from navcore.geometry import FloatArray
from navcore.slam.depth_mapping import MIN_TRACKED
from navcore.slam.depth_model import grid_shape
from navcore.slam.features import GRID_PX, sort_into_cells
from navcore.slam.keyframes import NO_LANDMARK, Features, IntArray, SlamCamera
from navcore.slam.map import MapBuilder
from navcore.slam.rolling_shutter import ReadoutTime
from navcore.slam.slam_map import SlamMap


def thaw(slam_map: SlamMap, features_per_frame: int = 0) -> MapBuilder:
    """Return a builder that holds a finished map, key frames and landmarks under the same numbers.

    Key frames may have up to ``features_per_frame`` features, and as many as those of the map have. What was only
    needed while the map was young (how often a landmark was found) is not stored, and begins anew; the builder is ready
    for key frames of the next session. A closed loop's measurement is what the map says now.
    """
    most = int(np.diff(slam_map.feature_start).max())
    builder = MapBuilder(slam_map.camera, max(features_per_frame, most))
    builder.readout = ReadoutTime(float(slam_map.readout_s[0]))
    graft(builder, slam_map, np.eye(4))
    builder.session = int(slam_map.keyframe_session[-1]) + 1
    return builder


def graft(builder: MapBuilder, slam_map: SlamMap, world_from_map: FloatArray) -> IntArray:
    """Add a finished map to a builder, moved by ``world_from_map`` (4, 4); return its key frames' new numbers (K,).

    Nothing joins it with what the builder held before.
    """
    moved = slam_map.transformed(world_from_map)
    landmarks = builder.adopt_landmarks(moved.positions, moved.normals, moved.reach, moved.descriptors)
    first = int(landmarks[0]) if len(landmarks) else 0
    added = []
    for k in range(moved.keyframe_count):
        features, landmark = _features_of(moved, k, builder.camera)
        builder.session = int(moved.keyframe_session[k])
        shown = np.where(landmark >= 0, landmark + first, NO_LANDMARK).astype(np.int32)
        added.append(
            builder.add_keyframe(float(moved.keyframe_stamp_s[k]), features, moved.camera_from_world[k], shown)
        )
        _keep_depth(builder, added[-1], moved, k)
        if moved.keyframe_drift[k].any():
            builder.drifts[added[-1]] = moved.keyframe_drift[k]
    index = np.array(added, dtype=np.int32)
    builder.parent[index] = np.where(moved.parent >= 0, index[moved.parent], NO_LANDMARK)
    poses = builder.camera_from_world
    for i, j in index[moved.loop_edges].tolist():
        builder.loop_edges.append((i, j, poses[i] @ np.linalg.inv(poses[j])))
    return index


def _keep_depth(builder: MapBuilder, index: int, slam_map: SlamMap, keyframe: int) -> None:
    """Let a key frame keep its depth and grey, if the builder's camera can use it, and the place that depth gave it."""
    grid = slam_map.keyframe_depth[keyframe]
    if slam_map.camera == builder.camera and grid.shape == grid_shape(builder.camera) and grid.any():
        builder.depth_grids[index] = grid
        if slam_map.keyframe_grey[keyframe].any():
            builder.grey_grids[index] = slam_map.keyframe_grey[keyframe]
    if np.count_nonzero(builder.landmark_of[index] >= 0) < MIN_TRACKED:
        builder.depth_carried.add(index)


def _features_of(slam_map: SlamMap, keyframe: int, camera: SlamCamera) -> tuple[Features, IntArray]:
    """Return the features of a key frame as another ideal pinhole would have them, and what they show (n,)."""
    held = slice(int(slam_map.feature_start[keyframe]), int(slam_map.feature_start[keyframe + 1]))
    own = slam_map.camera
    stored = slam_map.feature_uvr_px[held].astype(np.float64)
    depth = own.bf_px_m / (stored[:, 0] - stored[:, 2])
    uvr = np.empty_like(stored)
    uvr[:, 0] = (stored[:, 0] - own.cx_px) * (camera.fx_px / own.fx_px) + camera.cx_px
    uvr[:, 1] = (stored[:, 1] - own.cy_px) * (camera.fy_px / own.fy_px) + camera.cy_px
    uvr[:, 2] = uvr[:, 0] - camera.bf_px_m / depth
    columns, rows = -(-camera.width_px // GRID_PX), -(-camera.height_px // GRID_PX)
    order, cell_start = sort_into_cells(uvr, columns, rows)
    features = Features(
        np.ascontiguousarray(uvr[order]),
        np.ascontiguousarray(depth[order]),
        slam_map.feature_octave[held].astype(np.int32)[order],
        slam_map.feature_angle_rad[held].astype(np.float64)[order],
        np.ascontiguousarray(slam_map.feature_descriptor[held][order]),
        cell_start,
        columns,
    )
    return features, np.ascontiguousarray(slam_map.feature_landmark[held][order])

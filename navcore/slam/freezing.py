"""A growing map becomes a finished one: only what lives is kept, and it is told how far it can be wrong."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from navcore.geometry import FloatArray
from navcore.slam.depth_model import grid_shape
from navcore.slam.keyframes import NO_LANDMARK, Features, IntArray
from navcore.slam.map import MapBuilder
from navcore.slam.map_uncertainty import with_covariances
from navcore.slam.place_recognition import PlaceIndex
from navcore.slam.rolling_shutter import sorted_anew
from navcore.slam.slam_map import Int64Array, SlamMap, assembled


def freeze(
    builder: MapBuilder,
    places: PlaceIndex,
    trajectory: Sequence[tuple[float, FloatArray]],
    trajectory_session: IntArray | None = None,
) -> SlamMap:
    """Return the finished map of a builder, with the place index over it and the trajectory of the recordings.

    ``places`` gives the vocabulary; ``trajectory`` holds stamps and world_from_camera (4, 4), of the builder's present
    session unless ``trajectory_session`` (T,) says otherwise.
    """
    given = np.full(len(trajectory), builder.session) if trajectory_session is None else trajectory_session
    sessions = given.astype(np.int32)
    alive = np.flatnonzero(builder.keyframe_alive)
    counts = builder.observation_counts()
    living = np.flatnonzero(builder.landmark_alive & (counts > 0))
    new_landmark = np.full(builder.landmark_count + 1, NO_LANDMARK, np.int32)
    new_landmark[living] = np.arange(len(living), dtype=np.int32)
    new_keyframe = np.full(len(builder.keyframes) + 1, -1, np.int32)
    new_keyframe[alive] = np.arange(len(alive), dtype=np.int32)
    features, orders = zip(*(_in_cells(builder, k) for k in alive.tolist()), strict=True)
    lengths = [len(f) for f in features]
    arrays: dict[str, NDArray[Any]] = {
        "readout_s": np.array([builder.readout.seconds]),
        "keyframe_stamp_s": np.array([builder.keyframes[k].stamp_s for k in alive.tolist()]),
        "keyframe_session": np.array([builder.keyframes[k].session for k in alive.tolist()], np.int32),
        "keyframe_depth": _grids(builder, alive, builder.depth_grids, np.uint16),
        "keyframe_grey": _grids(builder, alive, builder.grey_grids, np.uint8),
        "camera_from_world": builder.camera_from_world[alive],
        "keyframe_covariance": np.zeros((len(alive), 6, 6)),
        "keyframe_drift": np.array([builder.drifts.get(k, np.zeros((6, 6))) for k in alive.tolist()]),
        "parent": new_keyframe[builder.parent[alive]],
        "loop_edges": _renumbered([(i, j) for i, j, _ in builder.loop_edges], new_keyframe),
        "feature_start": np.concatenate([[0], np.cumsum(lengths)]).astype(np.int64),
        "feature_uvr_px": np.concatenate([f.uvr_px for f in features]).astype(np.float32),
        "feature_octave": np.concatenate([f.octave for f in features]).astype(np.uint8),
        "feature_angle_rad": np.concatenate([f.angle_rad for f in features]).astype(np.float32),
        "feature_descriptor": np.concatenate([f.descriptors for f in features]),
        "feature_landmark": new_landmark[
            np.concatenate([builder.landmark_of[k][order] for k, order in zip(alive.tolist(), orders, strict=True)])
        ],
        "positions": builder.positions[living],
        "normals": builder.normals[living],
        "reach": builder.reach[living],
        "descriptors": builder.descriptors[living],
        "trajectory_stamp_s": np.array([stamp for stamp, _ in trajectory], dtype=np.float64),
        "trajectory_session": sessions,
        "trajectory": np.array([pose for _, pose in trajectory], dtype=np.float64).reshape(-1, 4, 4),
    }
    index = PlaceIndex(places.vocabulary)
    for k, feature in zip(alive.tolist(), features, strict=True):
        index.add(int(new_keyframe[k]), feature.descriptors)
    return with_covariances(assembled(builder.camera, index, arrays), np.concatenate([f.is_edge for f in features]))


def _in_cells(builder: MapBuilder, keyframe: int) -> tuple[Features, NDArray[np.int64]]:
    """Return a key frame's features as they are stored, by cells, and their order (n,): the readout has moved them."""
    features = builder.keyframes[keyframe].features
    stored = features.uvr_px.astype(np.float32).astype(np.float64)
    return sorted_anew(replace(features, uvr_px=stored), builder.camera)


def _grids(
    builder: MapBuilder, alive: Int64Array, held: Mapping[int, NDArray[Any]], kind: type[np.integer[Any]]
) -> NDArray[Any]:
    """Return the grids (K, rows, columns) of the living key frames, zero where one has none."""
    grids = np.zeros((len(alive), *grid_shape(builder.camera)), kind)
    for place, keyframe in enumerate(alive.tolist()):
        if keyframe in held:
            grids[place] = held[keyframe]
    return grids


def _renumbered(edges: list[tuple[int, int]], new_keyframe: IntArray) -> IntArray:
    kept = [(new_keyframe[i], new_keyframe[j]) for i, j in edges if new_keyframe[i] >= 0 and new_keyframe[j] >= 0]
    return np.array(kept, dtype=np.int32).reshape(-1, 2)

"""Closing a loop in the map: the drift is spread over all key frames, and landmarks that are one become one.

The pose graph runs over the essential graph (Mur-Artal et al. 2015, section VII): the spanning tree, strong
covisibility, and every loop closed so far. Landmarks follow a key frame that sees them.
"""

from __future__ import annotations

import numpy as np

from navcore.compiled import kernel
from navcore.geometry import FloatArray
from navcore.slam import pose_graph
from navcore.slam.keyframes import NO_LANDMARK, IntArray
from navcore.slam.loop_verification import VerifiedLoop
from navcore.slam.map import MapBuilder
from navcore.slam.mapping import project_and_fuse
from navcore.slam.tracking import local_landmarks

STRONG_COVISIBILITY = 60
"""Shared landmarks that make two key frames neighbours in the essential graph."""
LOOP_WEIGHT = 10.0
"""Weight of a loop's edge; that of any other edge is 1."""
FUSION_KEYFRAMES = 8
"""Key frames on either side of a loop among which landmarks are fused."""
FUSION_RADIUS_PX = 6.0
"""Search radius when they are, at pyramid level 0."""


def correct(builder: MapBuilder, loops: list[VerifiedLoop]) -> None:
    """Close verified loops in the map: pose graph, landmarks moved along, landmarks of both sides fused."""
    edges = essential_edges(builder)
    for loop in loops:
        candidate_pose = builder.camera_from_world[loop.candidate]
        relative = loop.camera_from_world @ np.linalg.inv(candidate_pose)
        builder.loop_edges.append((loop.keyframe, loop.candidate, relative))
    _optimize_essential_graph(builder, edges)
    for loop in loops:
        _connect(builder, loop)
        _fuse_sides(builder, loop)
    builder.version += 1


def essential_edges(builder: MapBuilder) -> tuple[IntArray, IntArray, FloatArray]:
    """Return i, j (E,) and i_from_j (E, 4, 4), as the poses are now: spanning tree and strong covisibility."""
    alive = np.flatnonzero(builder.keyframe_alive)
    shared = _shared_counts(builder.landmark_of, builder.landmark_count)
    shared[~builder.keyframe_alive] = 0
    shared[:, ~builder.keyframe_alive] = 0
    pairs = {(int(i), int(j)) for i, j in np.argwhere(np.tril(shared, -1) >= STRONG_COVISIBILITY)}
    for keyframe in alive.tolist():
        parent = int(builder.parent[keyframe])
        if parent >= 0:
            pairs.add((max(keyframe, parent), min(keyframe, parent)))
    # Neighbours in time hold together even where they share little; two recordings are no neighbours in time.
    session = np.array([builder.keyframes[k].session for k in alive.tolist()])
    together = np.flatnonzero(session[1:] == session[:-1])
    pairs.update(zip(alive[together + 1].tolist(), alive[together].tolist(), strict=True))
    ordered = np.array(sorted(pairs), dtype=np.int32).reshape(-1, 2)
    poses = builder.camera_from_world
    relative = poses[ordered[:, 0]] @ np.linalg.inv(poses[ordered[:, 1]])
    return ordered[:, 0], ordered[:, 1], relative


def _optimize_essential_graph(builder: MapBuilder, edges: tuple[IntArray, IntArray, FloatArray]) -> None:
    alive = np.flatnonzero(builder.keyframe_alive).astype(np.int32)
    position = np.full(len(builder.keyframes), -1, np.int32)
    position[alive] = np.arange(len(alive))
    closed = [(i, j, relative) for i, j, relative in builder.loop_edges if position[i] >= 0 and position[j] >= 0]
    i = np.concatenate([edges[0], [edge[0] for edge in closed]]).astype(np.int32)
    j = np.concatenate([edges[1], [edge[1] for edge in closed]]).astype(np.int32)
    relative = np.concatenate([edges[2], np.array([edge[2] for edge in closed]).reshape(-1, 4, 4)])
    weights = np.concatenate([np.ones(len(edges[0])), np.full(len(closed), LOOP_WEIGHT)])
    fixed = np.zeros(len(alive), np.bool_)
    fixed[0] = True
    old = builder.camera_from_world[alive].copy()
    new = pose_graph.optimize(old, position[i], position[j], relative, weights, fixed)
    _move_landmarks(builder, alive, old, new)
    builder.camera_from_world[alive] = new


def _move_landmarks(builder: MapBuilder, alive: IntArray, old: FloatArray, new: FloatArray) -> None:
    """Move each landmark with the first living key frame that sees it."""
    reference = _first_observer(builder.landmark_of, builder.landmark_count)
    seen = np.flatnonzero(reference >= 0)
    position = np.searchsorted(alive, reference[seen])
    correction = np.linalg.inv(new) @ old
    of_each = correction[position]
    builder.positions[seen] = np.einsum("nij,nj->ni", of_each[:, :3, :3], builder.positions[seen]) + of_each[:, :3, 3]
    builder.normals[seen] = np.einsum("nij,nj->ni", of_each[:, :3, :3], builder.normals[seen])


def _connect(builder: MapBuilder, loop: VerifiedLoop) -> None:
    """Let the key frame see the candidate's landmarks; where it held its own, the two become one."""
    row = builder.landmark_of[loop.keyframe]
    living = builder.landmark_alive[loop.landmark]
    feature, landmark = loop.feature[living], loop.landmark[living]
    fresh = ~np.isin(landmark, row[row >= 0])
    feature, landmark = feature[fresh], landmark[fresh]
    there = row[feature]
    taken = there != NO_LANDMARK
    builder.connect(loop.keyframe, feature[~taken], landmark[~taken])
    builder.fuse_landmarks(there[taken], landmark[taken])


def _fuse_sides(builder: MapBuilder, loop: VerifiedLoop) -> None:
    """Fuse landmarks between the neighbourhoods of the loop's two ends."""
    this_side = _with_neighbours(builder, loop.keyframe)
    that_side = _with_neighbours(builder, loop.candidate)
    this_side, that_side = this_side[~np.isin(this_side, that_side)], that_side[~np.isin(that_side, this_side)]
    radius_px = FUSION_RADIUS_PX * builder.camera.width_px / 640
    for side, other in ((this_side, that_side), (that_side, this_side)):
        for keyframe in side.tolist():
            project_and_fuse(builder, keyframe, local_landmarks(builder, other), radius_px)
    builder.refresh_landmarks(local_landmarks(builder, np.concatenate([this_side, that_side]).astype(np.int32)))


def _with_neighbours(builder: MapBuilder, keyframe: int) -> IntArray:
    neighbours, _ = builder.covisible(keyframe, 15)
    return np.concatenate([[keyframe], neighbours[:FUSION_KEYFRAMES]]).astype(np.int32)


# --------------------------------------------------------------------------------------------------- kernels
@kernel
def _first_observer(landmark_of: IntArray, landmark_count: int) -> IntArray:
    first = np.full(landmark_count, -1, np.int32)
    for k in range(landmark_of.shape[0]):
        for f in range(landmark_of.shape[1]):
            landmark = landmark_of[k, f]
            if landmark >= 0 and first[landmark] < 0:
                first[landmark] = k
    return first


@kernel
def _shared_counts(landmark_of: IntArray, landmark_count: int) -> IntArray:
    """Return how many landmarks each pair of key frames (K, K) shares."""
    keyframes, features = landmark_of.shape
    counts = np.zeros(landmark_count + 1, np.int64)
    for k in range(keyframes):
        for f in range(features):
            if landmark_of[k, f] >= 0:
                counts[landmark_of[k, f] + 1] += 1
    start = np.cumsum(counts)
    filled = start[:-1].copy()
    observer = np.empty(start[-1], np.int32)
    for k in range(keyframes):
        for f in range(features):
            landmark = landmark_of[k, f]
            if landmark >= 0:
                observer[filled[landmark]] = k
                filled[landmark] += 1
    shared = np.zeros((keyframes, keyframes), np.int32)
    for landmark in range(landmark_count):
        for a in range(start[landmark], start[landmark + 1]):
            for b in range(start[landmark], a):
                shared[observer[a], observer[b]] += 1
                shared[observer[b], observer[a]] += 1
    return shared


def warm_up() -> None:
    """Compile this module's kernels."""
    landmark_of = np.zeros((2, 4), np.int32)
    _shared_counts(landmark_of, 1)
    _first_observer(landmark_of, 1)

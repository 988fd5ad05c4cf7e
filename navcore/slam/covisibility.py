"""Which key frames hold a map together: by the landmarks they share, and by having been taken one after the other."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order, connected_components, minimum_spanning_tree

from navcore.slam.keyframes import IntArray
from navcore.slam.slam_map import SlamMap

MIN_SHARED = 15
"""Landmarks that two recordings must share to count as one map."""
_NEXT_IN_TIME = 0.5
"""Key frames that follow each other hold together like half a shared landmark: where nothing else holds them."""


def spanning_parents(slam_map: SlamMap) -> IntArray:
    """Return each key frame's parent (K,) in the tree that shares most landmarks; −1 at its root, the first one.

    What nothing joins has a root of its own.
    """
    count = slam_map.keyframe_count
    rows, columns, shared = _shared_pairs(slam_map)
    follows = np.flatnonzero(slam_map.keyframe_session[1:] == slam_map.keyframe_session[:-1])
    rows = np.concatenate([rows, follows])
    columns = np.concatenate([columns, follows + 1])
    # A tree of least weight takes what shares most.
    weight = 1.0 / np.concatenate([shared + _NEXT_IN_TIME, np.full(len(follows), _NEXT_IN_TIME)])
    order = np.lexsort((weight, columns, rows))
    first = np.ones(len(order), np.bool_)
    first[1:] = (np.diff(rows[order]) != 0) | (np.diff(columns[order]) != 0)
    kept = order[first]
    graph = coo_array((weight[kept], (rows[kept], columns[kept])), shape=(count, count)).tocsr()
    tree = minimum_spanning_tree(graph)
    parent = np.full(count, -1, np.int32)
    seen = np.zeros(count, np.bool_)
    for root in range(count):
        if not seen[root]:
            reached, predecessor = breadth_first_order(tree, root, directed=False)
            seen[reached] = True
            parent[reached[1:]] = predecessor[reached[1:]]
    return parent


def session_groups(slam_map: SlamMap) -> dict[int, int]:
    """Return for each recording of the map the number of the group that it hangs together with."""
    sessions, session = np.unique(slam_map.keyframe_session, return_inverse=True)
    rows, columns, shared = _shared_pairs(slam_map)
    between = np.zeros((len(sessions), len(sessions)), np.int64)
    np.add.at(between, (session[rows], session[columns]), shared)
    edges = session[slam_map.loop_edges]
    np.add.at(between, (edges[:, 0], edges[:, 1]), MIN_SHARED)
    _, group = connected_components(coo_array(between + between.T >= MIN_SHARED), directed=False)
    return dict(zip(sessions.tolist(), group.tolist(), strict=True))


def _shared_pairs(slam_map: SlamMap) -> tuple[IntArray, IntArray, IntArray]:
    """Return the pairs of key frames i < j that share landmarks, and how many."""
    rows: list[IntArray] = []
    columns: list[IntArray] = []
    shared: list[IntArray] = []
    for k in range(slam_map.keyframe_count):
        others, of_each = slam_map.covisible(k, 1)
        later = others > k
        rows.append(np.full(int(np.count_nonzero(later)), k, np.int32))
        columns.append(others[later])
        shared.append(of_each[later])
    return np.concatenate(rows), np.concatenate(columns), np.concatenate(shared)

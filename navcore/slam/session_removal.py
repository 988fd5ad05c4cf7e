"""Taking a recording out of a map: its key frames, and the landmarks that it alone has seen."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from navcore.slam.covisibility import session_groups, spanning_parents
from navcore.slam.freezing import freeze
from navcore.slam.joining import trained_places
from navcore.slam.slam_map import SlamMap
from navcore.slam.thawing import thaw


def separated_by_removal(slam_map: SlamMap, session: int) -> tuple[int, ...]:
    """Return the recordings that would no longer hang together with the first that stays, without a recording.

    Recordings keep their numbers here.
    """
    rest = without_key_frames(slam_map, session)
    groups = session_groups(rest)
    first = groups[min(groups)]
    return tuple(number for number, group in groups.items() if group != first)


def without_key_frames(slam_map: SlamMap, session: int, seed: int = 0) -> SlamMap:
    """Return the map without the key frames and the trajectory of a recording; the others keep their numbers."""
    builder = thaw(slam_map)
    gone = np.flatnonzero(slam_map.keyframe_session == session)
    for keyframe in gone.tolist():
        features = np.flatnonzero(builder.landmark_of[keyframe] >= 0).astype(np.int32)
        builder.disconnect(np.full(len(features), keyframe, np.int32), features)
    builder.keyframe_alive[gone] = False
    builder.refresh_landmarks(np.flatnonzero(builder.observation_counts() > 0).astype(np.int32))
    kept = np.flatnonzero(slam_map.trajectory_session != session)
    trajectory = [(float(slam_map.trajectory_stamp_s[i]), slam_map.trajectory[i]) for i in kept.tolist()]
    frozen = freeze(builder, trained_places(builder, seed), trajectory, slam_map.trajectory_session[kept])
    return replace(frozen, parent=spanning_parents(frozen))


def renumbered(slam_map: SlamMap, gone: int) -> SlamMap:
    """Return the map with the sessions above one that is gone moved up by one."""
    of_keyframe, of_frame = slam_map.keyframe_session, slam_map.trajectory_session
    return replace(
        slam_map,
        keyframe_session=(of_keyframe - (of_keyframe > gone)).astype(np.int32),
        trajectory_session=(of_frame - (of_frame > gone)).astype(np.int32),
    )

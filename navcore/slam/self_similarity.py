"""Whether landmarks fix what surfaces leave open, or look the same from beside.

Along a bare corridor everything that is seen may repeat itself: landmarks then agree on a pose, and agree as well on
another one a step further. So a pose is looked for from beside, along each direction that the surfaces leave open;
where about as many landmarks agree on another place, none of the two is believed.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from navcore.geometry import FloatArray
from navcore.slam.depth_alignment import SCALE, moved_by
from navcore.slam.depth_mapping import SPARSE_LANDMARKS
from navcore.slam.depth_tracking import Carried
from navcore.slam.pose import position_sigma_m
from navcore.slam.pose_factor import PoseFactor, factor_error
from navcore.slam.tracking import FrameMatch, Track

FIRM_SIGMA_M = 0.05
"""A position is fixed where its standard deviation is less than this in every direction, motion model aside."""
BESIDE_SIGMA_M = 0.02
"""The same where surfaces leave a direction open: the directions of edges are not exact, and many of them together seem
to tell that nobody moves."""
BESIDE_M = 0.2
"""From so far beside, on both sides, a pose is looked for."""
SAME_M = 0.1
"""Poses nearer to each other than this, along what is open, are the same."""
RIVAL_SHARE = 0.8
"""With this share of the matches, of all and of those that are no edges, another place is as good."""

Search = Callable[[FloatArray, PoseFactor], FrameMatch | None]
"""Finds a pose near a first guess (4, 4), weighing in what is known of it besides."""


def is_firm(information: FloatArray) -> bool:
    """Tell whether an information (6, 6) fixes the position in every direction."""
    return position_sigma_m(information) < FIRM_SIGMA_M


def is_sparse(track: Track) -> bool:
    """Tell whether few points that are no edges place a frame, or leave a direction open."""
    seen = track.landmark_of >= 0
    if track.carried_points is not None:
        seen = seen | np.isfinite(track.carried_points[:, 2])
    places = np.flatnonzero(seen).astype(np.int32)
    return track.features.count_distinct(places) < SPARSE_LANDMARKS or not is_firm(track.information)


def undisputed(found: FrameMatch, carried: Carried, search: Search) -> bool:
    """Tell whether a match fixes what surfaces leave open, and has no rival beside it."""
    track = found.track
    if position_sigma_m(track.information - carried.motion_information) > BESIDE_SIGMA_M:
        return False
    said = PoseFactor(carried.factor.camera_from_world, carried.alignment.information)
    free = carried.alignment.free_directions
    for direction in free:
        for side in (-BESIDE_M, BESIDE_M):
            other = search(moved_by(track.camera_from_world, side * direction), said)
            if other is not None and _is_rival(other, found, free):
                return False
    return True


def _is_rival(other: FrameMatch, found: FrameMatch, free: FloatArray) -> bool:
    shift = factor_error(other.track.camera_from_world, found.track.camera_from_world) / SCALE
    if float(np.abs(free @ shift).max()) <= SAME_M:
        return False
    return other.matched_count >= RIVAL_SHARE * found.matched_count and other.distinct_count >= (
        RIVAL_SHARE * found.distinct_count
    )

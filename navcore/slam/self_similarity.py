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
BESIDE_M = 0.2
"""From so far beside, on both sides, a pose is looked for."""
LED_BACK_M = 0.05
"""It is the same pose when it ends so near."""
RIVAL_SHARE = 0.6
"""With this share of the matches, of all and of those that are no edges, another place is as good."""

Search = Callable[[FloatArray, PoseFactor], FrameMatch | None]
"""Finds a pose near a first guess (4, 4), weighing in what is known of it besides."""


def is_firm(information: FloatArray) -> bool:
    """Tell whether an information (6, 6) fixes the position in every direction."""
    return position_sigma_m(information) < FIRM_SIGMA_M


def is_sparse(track: Track) -> bool:
    """Tell whether few landmarks that are no edges place a frame, or leave a direction open."""
    seen = np.flatnonzero(track.landmark_of >= 0).astype(np.int32)
    return track.features.count_distinct(seen) < SPARSE_LANDMARKS or not is_firm(track.information)


def leads_back(found: FrameMatch, carried: Carried, search: Search) -> bool:
    """Tell whether a match fixes what surfaces leave open, and is found again from beside."""
    track = found.track
    if not is_firm(track.information - carried.motion_information):
        return False
    said = PoseFactor(carried.factor.camera_from_world, carried.alignment.information)
    for direction in carried.alignment.free_directions:
        for side in (-BESIDE_M, BESIDE_M):
            again = search(moved_by(track.camera_from_world, side * direction), said)
            if again is None:
                continue
            shift = factor_error(again.track.camera_from_world, track.camera_from_world) / SCALE
            if abs(float(shift @ direction)) > LED_BACK_M and _is_rival(again, found):
                return False
    return True


def _is_rival(other: FrameMatch, found: FrameMatch) -> bool:
    return other.matched_count >= RIVAL_SHARE * found.matched_count and other.distinct_count >= (
        RIVAL_SHARE * found.distinct_count
    )

"""Finding where a new recording begins in a map that exists, before it may add to that map.

A wrong beginning would ruin the map, so one frame is not believed: two, located independently of one another, must
agree with the motion that was followed between them.
"""

from __future__ import annotations

from navcore.slam.keyframes import Features, IntArray
from navcore.slam.loop_closing import AGREEMENT_M, AGREEMENT_RAD, difference
from navcore.slam.loop_verification import MAX_CONTRADICTED_SHARE, contradicted_share, is_spread
from navcore.slam.map import MapBuilder
from navcore.slam.relocalization import relocalize
from navcore.slam.tracking import Track, local_keyframes, local_landmarks, track_last_frame

MIN_ANCHOR_LANDMARKS = 40
"""Landmarks that must agree on the place of a frame."""
CANDIDATES = 8
"""Key frames of similar look that are tried."""


def locate_cold(builder: MapBuilder, stamp_s: float, features: Features, candidates: IntArray) -> Track | None:
    """Return where a frame is by the key frames ``candidates`` (k,), where landmarks, spread and depth support it."""
    found = relocalize(builder, features, stamp_s, candidates.tolist(), MIN_ANCHOR_LANDMARKS)
    if found is None or not is_spread(builder, features, (found.track.landmark_of >= 0).nonzero()[0]):
        return None
    around = local_landmarks(builder, local_keyframes(builder, found.track.landmarks))
    contradicted = contradicted_share(builder, features, found.track.camera_from_world, around)
    return found.track if contradicted <= MAX_CONTRADICTED_SHARE else None


def agree(builder: MapBuilder, first: Track, second: Track) -> bool:
    """Return whether two frames, located independently, stand to one another as the motion between them was."""
    followed = track_last_frame(builder, first, second.features, second.stamp_s, first.camera_from_world)
    if followed is None:
        return False
    shift_m, turn_rad = difference(followed.track.camera_from_world, second.camera_from_world)
    return shift_m <= AGREEMENT_M and turn_rad <= AGREEMENT_RAD

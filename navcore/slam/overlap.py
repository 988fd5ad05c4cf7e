"""Where two maps overlap: places that both show, and the one motion that lays them upon each other.

Two corridors can look alike, so a match of two images says little. Each match must be supported by geometry, lay the
level maps level upon each other, and be confirmed by others along the walk; and no second way of laying them upon each
other may be supported nearly as well.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from navcore.errors import MappingError
from navcore.geometry import FloatArray
from navcore.slam.keyframes import IntArray
from navcore.slam.loop_closing import difference
from navcore.slam.loop_verification import VerifiedLoop, verify
from navcore.slam.map import MapBuilder
from navcore.slam.place_recognition import PlaceIndex

CANDIDATES = 4
"""Key frames of the known map that look most like a new one, which are tried."""
MIN_APART = 3
"""Candidates nearer to one another than so many key frames would say the same."""
MIN_AGREEING = 3
"""Key frames that must say the same of how the maps lie."""
MIN_BASE_M = 0.3
"""They must have been taken from places at least so far apart: what is seen from one spot is one observation."""
RIVAL_SHARE = 0.5
"""Another way of laying the maps upon each other with this share of the support makes the answer doubtful."""
AGREEMENT_M = 0.15
AGREEMENT_RAD = 0.06
"""Two matches say the same when each predicts the other up to this, …"""
DRIFT_M_PER_M = 0.03
DRIFT_RAD_PER_M = 0.01
"""… and up to the drift of the walk between them."""
MAX_TILT_RAD = 0.2
"""Both maps are level: a match that tilts one against the other by more is none, …"""
MAX_HEIGHT_M = 0.6
"""… nor is one that lifts the camera by more."""

BoolArray = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class Overlap:
    """How a new map lies on the known one."""

    known_from_new: FloatArray
    """(4, 4)."""
    loops: tuple[VerifiedLoop, ...]
    """Matches that agree, in the order of the new key frames; landmarks and candidates are of the known map."""


def find_overlap(builder: MapBuilder, known: IntArray, new: IntArray, places: PlaceIndex, seed: int = 0) -> Overlap:
    """Find how the new key frames (b,) lie on the known ones (a,), which ``places`` names as the builder does.

    Both are in the builder, level, the new ones in a frame of their own, in the order of their walk. Raises
    MappingError, with what to do, where too little speaks for any answer or two answers are possible.
    """
    dead = np.setdiff1d(np.arange(len(builder.keyframes), dtype=np.int32), known)
    found: list[VerifiedLoop] = []
    for keyframe in new.tolist():
        candidates, _ = places.query(builder.keyframes[keyframe].features.descriptors, 4 * CANDIDATES, dead)
        loops = [verify(builder, keyframe, k, seed) for k in _spread(candidates.tolist())]
        # A place that looks like two others supports either: which one, the others decide.
        found += [loop for loop in loops if loop is not None and _is_level(builder, loop)]
    if not found:
        raise MappingError(
            "Nothing of this recording was recognised in the site's map: record again so that the walk begins at, or"
            " passes through, a place that the map shows, looking the way it was recorded."
        )
    return _most_supported(builder, found, new)


def _spread(candidates: list[int]) -> list[int]:
    chosen: list[int] = []
    for candidate in candidates:
        if all(abs(candidate - other) >= MIN_APART for other in chosen):
            chosen.append(candidate)
    return chosen[:CANDIDATES]


def known_from_new(builder: MapBuilder, loop: VerifiedLoop) -> FloatArray:
    """Return (4, 4) how one match lays the new map on the known one."""
    return np.asarray(np.linalg.inv(loop.camera_from_world) @ builder.camera_from_world[loop.keyframe])


def _is_level(builder: MapBuilder, loop: VerifiedLoop) -> bool:
    moved = known_from_new(builder, loop)
    now = np.linalg.inv(loop.camera_from_world)
    before = np.linalg.inv(builder.camera_from_world[loop.keyframe])
    tilt_rad = float(np.arccos(np.clip(moved[2, 2], -1.0, 1.0)))
    return tilt_rad <= MAX_TILT_RAD and abs(float(now[2, 3] - before[2, 3])) <= MAX_HEIGHT_M


def _most_supported(builder: MapBuilder, found: list[VerifiedLoop], new: IntArray) -> Overlap:
    agrees = _agreement(builder, found, new)
    keyframe = np.array([loop.keyframe for loop in found])
    support = np.array([len(np.unique(keyframe[row])) for row in agrees])
    strength = np.array([len(loop.feature) for loop in found])
    best = int(np.lexsort((-strength, -support))[0])
    chosen = agrees[best]
    if support[best] < MIN_AGREEING or _base_m(builder, keyframe[chosen]) < MIN_BASE_M:
        raise MappingError(
            "Too little of this recording was recognised in the site's map to be sure of where it lies: record again,"
            " walking at least a few metres through places that the map shows, looking the way they were recorded."
        )
    # A key frame may match twice along a corridor; what agrees with any of the chosen is no rival.
    rivals = np.where(agrees[chosen].any(axis=0), 0, support)
    if rivals.max(initial=0) > RIVAL_SHARE * support[best]:
        raise MappingError(
            "This recording fits the site's map in two places that look alike: record again, walking on to a place"
            " that looks like no other."
        )
    loops = _one_for_each([found[i] for i in np.flatnonzero(chosen).tolist()])
    return Overlap(known_from_new(builder, found[best]), tuple(loops))


def _agreement(builder: MapBuilder, found: list[VerifiedLoop], new: IntArray) -> BoolArray:
    """Return which matches predict which others (m, m), as far as the walk between them allows."""
    walked = dict(zip(new.tolist(), _walked_m(builder, new).tolist(), strict=True))
    poses = [builder.camera_from_world[loop.keyframe] for loop in found]
    agrees = np.eye(len(found), dtype=np.bool_)
    for i, first in enumerate(found):
        new_from_known = np.linalg.inv(poses[i]) @ first.camera_from_world
        for j in range(i):
            apart_m = abs(walked[first.keyframe] - walked[found[j].keyframe])
            shift_m, turn_rad = difference(found[j].camera_from_world, poses[j] @ new_from_known)
            agrees[i, j] = agrees[j, i] = (
                shift_m <= AGREEMENT_M + DRIFT_M_PER_M * apart_m
                and turn_rad <= AGREEMENT_RAD + DRIFT_RAD_PER_M * apart_m
            )
    return agrees


def camera_centres(camera_from_world: FloatArray) -> FloatArray:
    """Return where cameras (k, 4, 4) stand (k, 3)."""
    return np.asarray(-np.einsum("kji,kj->ki", camera_from_world[:, :3, :3], camera_from_world[:, :3, 3]))


def _walked_m(builder: MapBuilder, new: IntArray) -> FloatArray:
    steps = np.linalg.norm(np.diff(camera_centres(builder.camera_from_world[new]), axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])


def _base_m(builder: MapBuilder, keyframes: NDArray[np.int64]) -> float:
    centres = camera_centres(builder.camera_from_world[keyframes])
    return float(np.linalg.norm(centres.max(axis=0) - centres.min(axis=0)))


def _one_for_each(loops: list[VerifiedLoop]) -> list[VerifiedLoop]:
    """Keep for each key frame the match that most landmarks support."""
    best: dict[int, VerifiedLoop] = {}
    for loop in loops:
        if loop.keyframe not in best or len(loop.feature) > len(best[loop.keyframe].feature):
            best[loop.keyframe] = loop
    return [best[keyframe] for keyframe in sorted(best)]

"""Loop closing: noticing that a place is seen again, and taking the drift out of the map (ORB-SLAM2, section III-D).

Candidates come from place recognition and from the map itself (key frames that should see the same, were it not for
drift). They are verified by geometry, must fit the drift that a walk of that length can have, and are believed only
when two key frames in a row say the same; then the loop is closed and the whole map adjusted.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from navcore.geometry import FloatArray
from navcore.slam import loop_correction, mapping
from navcore.slam.keyframes import ByteArray, IntArray
from navcore.slam.loop_verification import VerifiedLoop, verify
from navcore.slam.map import MapBuilder
from navcore.slam.place_recognition import PlaceIndex, Vocabulary

FIRST_TRAINING = 6
"""Key frames at which the vocabulary is trained for the first time; again whenever there are four times as many."""
MIN_AGE = 5
"""Key frames that must lie between the two ends of a loop."""
COVISIBLE = 15
"""Shared landmarks that make two key frames neighbours: between them nothing needs to be closed."""
ALIKE_CANDIDATES = 3
NEAR_CANDIDATES = 2
MIN_RELATIVE_SCORE = 0.3
"""A candidate must look this much alike, compared with the key frame's own neighbours."""
AGREEMENT_M = 0.12
"""Two detections in a row say the same when they agree on the key frame's place up to this, and on its …"""
AGREEMENT_RAD = 0.05
"""… orientation up to this."""
MEMORY = 4
"""Detections are compared with those of so many key frames before."""
SMALL_CORRECTION_M = 0.02
"""A loop that moves its key frame by less needs no adjustment of the whole map at once."""


@dataclass(frozen=True, slots=True)
class DriftGate:
    """How far a map may be wrong: a loop that would correct more is not believed."""

    shift_m: float = 0.4
    """Drift that is allowed in any case, …"""
    shift_m_per_m: float = 0.05
    """… and per metre walked between the two ends of the loop."""
    turn_rad: float = 0.12
    turn_rad_per_m: float = 0.02

    def admits(self, shift_m: float, turn_rad: float, walked_m: float) -> bool:
        """Return whether a correction is no larger than the drift of a walk of this length."""
        return (
            shift_m <= self.shift_m + self.shift_m_per_m * walked_m
            and turn_rad <= self.turn_rad + self.turn_rad_per_m * walked_m
        )


DRIFT_OF_A_WALK = DriftGate()


@dataclass(frozen=True, slots=True)
class LoopClosure:
    """A loop that was closed."""

    keyframe: int
    candidate: int
    correction_m: float
    """By how much the key frame moved."""
    supporting_landmarks: int


class LoopCloser:
    """Looks for loops each time a key frame is added. The same map and seed give the same loops.

    ``max_drift`` bounds what a loop may correct; joining recordings, whose places are not known well, can widen it.
    """

    def __init__(self, builder: MapBuilder, seed: int = 0, max_drift: DriftGate = DRIFT_OF_A_WALK) -> None:
        self.closures: list[LoopClosure] = []
        self._builder = builder
        self._seed = seed
        self._max_drift = max_drift
        self._index: PlaceIndex | None = None
        self._next_training = FIRST_TRAINING
        self._recent: list[VerifiedLoop] = []
        self._refused: dict[tuple[int, int], int] = {}
        """Pairs that geometry did not support, and the version of the map then."""

    @property
    def places(self) -> PlaceIndex:
        """The place index over the living key frames, on a vocabulary trained on all of them."""
        return self._trained()

    def alike(self, descriptors: ByteArray, count: int) -> IntArray:
        """Return up to ``count`` living key frames that look most like an image with the descriptors (n, 32)."""
        if self._index is None:
            if not len(self._builder.keyframes):
                return np.zeros(0, np.int32)
            self._index = self._trained()
            self._next_training = max(self._next_training, 4 * len(self._builder.keyframes))
        dead = np.flatnonzero(~self._builder.keyframe_alive).astype(np.int32)
        return self._index.query(descriptors, count, dead)[0]

    def add(self, keyframe: int) -> LoopClosure | None:
        """Take a new key frame in; close a loop where it completes one.

        After a closure the whole map has moved and ``builder.version`` is higher.
        """
        self._take_in(keyframe)
        detected = self._detect(keyframe)
        if detected is None:
            return None
        partner = self._confirming(detected)
        self._recent = [*self._recent, detected][-MEMORY:]
        return None if partner is None else self._close([partner, detected])

    def finish(self, iterations: int = 15) -> list[LoopClosure]:
        """Look for loops from every key frame once more, and adjust the whole map; return what was closed now."""
        before = len(self.closures)
        self._index = self._trained()
        self._recent = []
        for keyframe in np.flatnonzero(self._builder.keyframe_alive).tolist():
            if not self._builder.keyframe_alive[keyframe]:
                continue
            self._recent = [loop for loop in self._recent if keyframe - loop.keyframe <= 2 * MEMORY]
            detected = self._detect(keyframe)
            if detected is None:
                continue
            partner = self._confirming(detected)
            self._recent.append(detected)
            if partner is not None:
                self._close([partner, detected])
        if len(self._builder.keyframes) > 1:
            mapping.adjust_all(self._builder, iterations)
            mapping.settle_all(self._builder, iterations)
        return self.closures[before:]

    # ------------------------------------------------------------------------------------------- candidates
    def _take_in(self, keyframe: int) -> None:
        if len(self._builder.keyframes) >= self._next_training:
            self._index = self._trained()
            self._next_training *= 4
        elif self._index is not None:
            self._index.add(keyframe, self._builder.keyframes[keyframe].features.descriptors)

    def _trained(self) -> PlaceIndex:
        alive = np.flatnonzero(self._builder.keyframe_alive).tolist()
        per_keyframe = [self._builder.keyframes[k].features.descriptors for k in alive]
        index = PlaceIndex(Vocabulary.train(np.concatenate(per_keyframe), self._seed))
        for keyframe, descriptors in zip(alive, per_keyframe, strict=True):
            index.add(keyframe, descriptors)
        return index

    def candidates(self, keyframe: int) -> list[int]:
        """Return older key frames that may show the same place without sharing landmarks, the likeliest first."""
        if self._index is None:
            return []
        neighbours, _ = self._builder.covisible(keyframe, COVISIBLE)
        dead = np.flatnonzero(~self._builder.keyframe_alive)
        recent = np.arange(max(0, keyframe - MIN_AGE + 1), len(self._builder.keyframes))
        excluded = np.unique(np.concatenate([neighbours, dead, recent])).astype(np.int32)
        alike = self._alike(keyframe, neighbours, excluded)
        return alike + [k for k in self._near(keyframe, excluded) if k not in alike]

    def _alike(self, keyframe: int, neighbours: IntArray, excluded: IntArray) -> list[int]:
        assert self._index is not None
        scores = self._index.scores(self._builder.keyframes[keyframe].features.descriptors)
        ids = self._index.ids
        of_neighbours = scores[np.isin(ids, neighbours)]
        least = MIN_RELATIVE_SCORE * float(np.max(of_neighbours)) if len(of_neighbours) else 0.0
        open_to_all = ~np.isin(ids, excluded) & (scores > least)
        chosen: list[int] = []
        for position in np.argsort(-scores, kind="stable").tolist():
            # Candidates next to one another would say the same.
            if open_to_all[position] and all(abs(int(ids[position]) - k) > 2 for k in chosen):
                chosen.append(int(ids[position]))
            if len(chosen) == ALIKE_CANDIDATES:
                break
        return chosen

    def _near(self, keyframe: int, excluded: IntArray) -> list[int]:
        """Return key frames that by the map stand near and look the same way."""
        poses = self._builder.camera_from_world
        open_to_all = np.ones(len(poses), np.bool_)
        open_to_all[excluded] = False
        centres = -np.einsum("kji,kj->ki", poses[:, :3, :3], poses[:, :3, 3])
        distance = np.linalg.norm(centres - centres[keyframe], axis=1)
        cosine = poses[:, 2, :3] @ poses[keyframe, 2, :3]
        open_to_all &= (cosine > np.cos(np.radians(30))) & (distance < 1.5)
        near = np.flatnonzero(open_to_all)
        return [int(k) for k in near[np.argsort(distance[near], kind="stable")][:NEAR_CANDIDATES]]

    # -------------------------------------------------------------------------------------------- detection
    def _detect(self, keyframe: int) -> VerifiedLoop | None:
        best: VerifiedLoop | None = None
        for candidate in self.candidates(keyframe):
            if self._refused.get((keyframe, candidate)) == self._builder.version:
                continue
            loop = verify(self._builder, keyframe, candidate, self._seed)
            if loop is None or not self._is_plausible_drift(loop):
                self._refused[keyframe, candidate] = self._builder.version
                continue
            if best is None or len(loop.feature) > len(best.feature):
                best = loop
        return best

    def _is_plausible_drift(self, loop: VerifiedLoop) -> bool:
        walked_m = self._walked(loop.candidate, loop.keyframe)
        shift_m, turn_rad = difference(loop.camera_from_world, self._builder.camera_from_world[loop.keyframe])
        return self._max_drift.admits(shift_m, turn_rad, walked_m)

    def _walked(self, first: int, last: int) -> float:
        alive = np.flatnonzero(self._builder.keyframe_alive)
        between = self._builder.camera_from_world[alive[(alive >= first) & (alive <= last)]]
        centres = -np.einsum("kji,kj->ki", between[:, :3, :3], between[:, :3, 3])
        return float(np.sum(np.linalg.norm(np.diff(centres, axis=0), axis=1)))

    def _confirming(self, detected: VerifiedLoop) -> VerifiedLoop | None:
        """Return an earlier detection that says the same of where this key frame is."""
        for earlier in reversed(self._recent):
            if earlier.keyframe == detected.keyframe or not self._builder.keyframe_alive[earlier.keyframe]:
                continue
            poses = self._builder.camera_from_world
            step = poses[detected.keyframe] @ np.linalg.inv(poses[earlier.keyframe])
            shift_m, turn_rad = difference(detected.camera_from_world, step @ earlier.camera_from_world)
            if shift_m <= AGREEMENT_M and turn_rad <= AGREEMENT_RAD:
                return earlier
        return None

    # ---------------------------------------------------------------------------------------------- closing
    def _close(self, loops: list[VerifiedLoop]) -> LoopClosure:
        builder, last = self._builder, loops[-1]
        before = builder.camera_from_world[last.keyframe].copy()
        loop_correction.correct(builder, loops)
        moved_m, _ = difference(before, builder.camera_from_world[last.keyframe])
        # Where little has moved, what is already adjusted stays adjusted well enough until the end of the walk.
        if moved_m > SMALL_CORRECTION_M:
            mapping.adjust_all(builder, 8)
        moved_m, _ = difference(before, builder.camera_from_world[last.keyframe])
        closure = LoopClosure(last.keyframe, last.candidate, moved_m, len(last.feature))
        self.closures.append(closure)
        self._recent = []
        return closure


def difference(camera_from_world_a: FloatArray, camera_from_world_b: FloatArray) -> tuple[float, float]:
    """Return how far two cameras stand apart, in metres, and are turned against one another, in radians."""
    centre_a = -camera_from_world_a[:3, :3].T @ camera_from_world_a[:3, 3]
    centre_b = -camera_from_world_b[:3, :3].T @ camera_from_world_b[:3, 3]
    cosine = 0.5 * (np.trace(camera_from_world_a[:3, :3] @ camera_from_world_b[:3, :3].T) - 1.0)
    return float(np.linalg.norm(centre_a - centre_b)), float(np.arccos(np.clip(cosine, -1.0, 1.0)))

"""What the localizer remembers from frame to frame, and what it weighs in each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from navcore.geometry import FloatArray
from navcore.slam.depth_mapping import SPARSE_LANDMARKS
from navcore.slam.fisheye_tracking import FisheyeMatch
from navcore.slam.keyframes import IntArray
from navcore.slam.map_evidence import MapEvidence
from navcore.slam.pose_uncertainty import centre_of
from navcore.slam.self_similarity import is_firm, is_sparse
from navcore.slam.slam_map import SlamMap
from navcore.slam.tracking import Track

CONFIRMATIONS = 3
"""Frames in a row that must match the map after a relocalization before the pose is called Localized."""
AMPLE_COUNT = 150
"""With so many landmarks in the front view the fisheye picture is not looked at: it would add little, for its price."""
CONTINUITY_M = 0.08
"""Map and odometry say the same when their positions differ by less than this."""


@dataclass(frozen=True, slots=True, eq=False)
class LocalizerState:
    """What is remembered from frame to frame."""

    last: Track
    before_last: Track | None
    covariance: FloatArray
    """(6, 6): of (camera position, rotation) in the world, if the place is the right one."""
    shared_covariance: FloatArray
    """(6, 6): the part of it that all landmarks around share, the map's own error."""
    matched_s: float
    """When the map last matched."""
    confirmations: int
    """Frames in a row that have matched the map since the pose was found without a guess."""
    misfit: float
    """Running mean of the variance factor; see :func:`navcore.slam.pose_uncertainty.misfit`."""

    @property
    def is_confirmed(self) -> bool:
        """Whether enough frames said the same since the place was found."""
        return self.confirmations >= CONFIRMATIONS


@dataclass(frozen=True, slots=True, eq=False)
class MapMatch:
    """A pose at which landmarks of the map were found, and what speaks for it."""

    track: Track
    evidence: MapEvidence
    fisheye: FisheyeMatch | None = None
    """What the fisheye picture shows there, if that is evidence; the track is then the pose of both cameras."""

    @property
    def is_convincing(self) -> bool:
        """Whether the front view shows it by itself, or the fisheye picture does and depth does not contradict."""
        return self.evidence.is_convincing or (self.fisheye is not None and not self.evidence.is_contradicted)

    @property
    def is_ample(self) -> bool:
        """Whether the front view shows so much that the fisheye picture would add nothing."""
        return self.track.inlier_count >= AMPLE_COUNT

    @property
    def is_sparse(self) -> bool:
        """Whether few landmarks place the frame, in the front view and in the fisheye picture too."""
        is_wide = self.fisheye is not None and self.fisheye.found_count >= SPARSE_LANDMARKS
        return is_sparse(self.track) and not (is_wide and is_firm(self.track.information))

    @property
    def found_count(self) -> int:
        """Landmarks of the map that agree, in both pictures."""
        return self.track.inlier_count + (0 if self.fisheye is None else self.fisheye.found_count)

    def is_plausible_after(self, followed: Track) -> bool:
        """Whether odometry led to the same place, and nothing speaks against it."""
        shift_m = float(np.linalg.norm(centre_of(self.track) - centre_of(followed)))
        return self.evidence.is_plausible and shift_m < CONTINUITY_M


class RememberedCovisibility:
    """The frozen map's covisibility: neighbours are looked up once per key frame."""

    def __init__(self, slam_map: SlamMap) -> None:
        self._map = slam_map
        self._neighbours: dict[tuple[int, int], tuple[IntArray, IntArray]] = {}

    def keyframes_seeing(self, landmarks: IntArray) -> tuple[IntArray, IntArray]:
        """See :meth:`SlamMap.keyframes_seeing`."""
        return self._map.keyframes_seeing(landmarks)

    def covisible(self, index: int, min_shared: int) -> tuple[IntArray, IntArray]:
        """See :meth:`SlamMap.covisible`."""
        known = self._neighbours.get((index, min_shared))
        if known is None:
            known = self._neighbours[index, min_shared] = self._map.covisible(index, min_shared)
        return known

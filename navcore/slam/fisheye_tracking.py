"""Finding the map's landmarks in the fisheye picture, and the pose that both cameras agree on.

The map holds what the depth camera saw while it was made. The fisheye camera sees the same landmarks longer, and from
the side: while the walker turns, while people fill the front view, where everything ahead is too far for depth.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from navcore.geometry import FloatArray
from navcore.slam.fisheye_pose import FisheyeObservations, refine_with_fisheye
from navcore.slam.fisheye_view import FisheyeFeatures, FisheyeView
from navcore.slam.keyframes import INV_SIGMA2, NO_LANDMARK, IntArray
from navcore.slam.matching import DISTANCE_LOOSE, RATIO_LOCAL, match_projected
from navcore.slam.pose_factor import PoseFactor
from navcore.slam.tracking import LOCAL_RADIUS_PX, SCALES, MapView, Track, local_landmarks

NEAR_M = 5.0
"""Landmarks of key frames within this distance are looked for, whichever way those looked."""
NEAR_KEYFRAMES = 60
"""Of so many key frames at most, the nearest."""
MIN_FOUND = 25
"""Fewer landmarks that agree are no evidence."""
MIN_AGREEING_SHARE = 0.3
"""Share of the matches that must agree on the pose: at the true one 0.3–0.75 do, at a wrong one a tenth, at most 0.17,
and in between on the way from one to the other."""
SURE_AGREEING_SHARE = 0.4
"""The same, where nothing else speaks for the pose."""
MIN_EXPECTED_SHARE = 0.05
"""Share of the landmarks in view, hidden or not, that must be found: at the true pose a tenth to a fifth is, elsewhere
0.02."""
FURTHER_PASSES = 2
"""Where the matches do not agree well, the pose may be on its way: so many more searches around it."""


@dataclass(frozen=True, slots=True, eq=False)
class FisheyeMatch:
    """A pose on which the depth camera's landmarks and the fisheye camera's agree."""

    track: Track
    """The depth camera's frame at that pose; its information is that of both cameras."""
    landmarks: IntArray
    """(m,): landmarks seen in the fisheye picture that agree."""
    matched_count: int
    """Landmarks that were matched there, agreeing or not."""
    expected_count: int
    """Landmarks that should have been in view there, hidden or not."""

    @property
    def found_count(self) -> int:
        """How many landmarks the fisheye picture shows where they should be."""
        return len(self.landmarks)

    @property
    def agreeing_share(self) -> float:
        """Share of the matches that agree on the pose, 0–1."""
        return self.found_count / self.matched_count if self.matched_count else 0.0

    @property
    def is_evidence(self) -> bool:
        """Whether they are many, and agree with each other: matches by chance do not."""
        enough = self.found_count >= max(MIN_FOUND, MIN_EXPECTED_SHARE * self.expected_count)
        return enough and self.agreeing_share >= MIN_AGREEING_SHARE

    @property
    def is_sure(self) -> bool:
        """Whether they say enough where nothing else speaks for the pose."""
        return self.is_evidence and self.agreeing_share >= SURE_AGREEING_SHARE


def near_keyframes(centres: FloatArray, centre: FloatArray) -> IntArray:
    """Return the key frames (centres (K, 3)) near a place (3,), nearest first."""
    distance = np.linalg.norm(centres - centre, axis=1)
    near = np.flatnonzero(distance < NEAR_M)
    return near[np.argsort(distance[near], kind="stable")][:NEAR_KEYFRAMES].astype(np.int32)


def observe(
    view: MapView,
    fisheye: FisheyeView,
    seen: FisheyeFeatures,
    camera_from_world: FloatArray,
    candidates: IntArray,
    radius_factor: float = 1.0,
) -> tuple[IntArray, IntArray, int]:
    """Look for landmarks (k,) where a pose puts them; return landmarks and features (m,) and how many were in view."""
    uv, octave, cosine = fisheye.project_landmarks(
        seen.fisheye_from_camera @ camera_from_world,
        view.positions[candidates],
        view.normals[candidates],
        view.reach[candidates],
    )
    visible = octave >= 0
    wanted, uv, octave, cosine = candidates[visible], uv[visible], octave[visible], cosine[visible]
    match = match_projected(
        seen.features,
        uv,
        np.full(len(uv), np.nan),
        radius_factor * LOCAL_RADIUS_PX * np.where(cosine > 0.998, 2.5, 4.0) * SCALES[octave],
        octave - 1,
        octave + 1,
        view.descriptors[wanted],
        seen.unusable,
        DISTANCE_LOOSE,
        RATIO_LOCAL,
    )
    found = match >= 0
    return wanted[found], match[found], len(wanted)


def observations(
    view: MapView, fisheye: FisheyeView, seen: FisheyeFeatures, landmarks: IntArray, features: IntArray
) -> FisheyeObservations:
    """Return landmarks (m,) seen at features (m,) as the pose's refinement takes them."""
    return FisheyeObservations(
        view.positions[landmarks],
        seen.lens_px[features],
        INV_SIGMA2[seen.features.octave[features]],
        fisheye.numbers,
        seen.fisheye_from_camera,
    )


def joined(
    view: MapView,
    fisheye: FisheyeView,
    seen: FisheyeFeatures,
    track: Track,
    candidates: IntArray,
    radius_factor: float,
    known: PoseFactor | None = None,
) -> FisheyeMatch:
    """Refine a frame's pose with landmarks of the map in the fisheye picture, of which ``candidates`` (k,) may be seen.

    A wide search is followed by a narrow one around the better pose. ``known`` is what is known of the pose besides.
    """
    wide, narrow = (radius_factor, 1.0) if radius_factor > 1.5 else (0.0, radius_factor)
    match = FisheyeMatch(track, np.zeros(0, np.int32), 0, 0)
    for factor in (wide, narrow):
        if factor > 0.0:
            match = _refined(view, fisheye, seen, match.track, candidates, factor, known)
    for _ in range(FURTHER_PASSES):
        if match.found_count < MIN_FOUND // 2 or match.is_sure:
            break
        further = _refined(view, fisheye, seen, match.track, candidates, narrow, known)
        if further.found_count <= match.found_count:
            break
        match = further
    return match


def _refined(
    view: MapView,
    fisheye: FisheyeView,
    seen: FisheyeFeatures,
    track: Track,
    candidates: IntArray,
    radius_factor: float,
    known: PoseFactor | None,
) -> FisheyeMatch:
    landmarks, features, expected = observe(view, fisheye, seen, track.camera_from_world, candidates, radius_factor)
    own = np.flatnonzero(track.landmark_of >= 0)
    held = track.landmark_of[own]
    pose = refine_with_fisheye(
        track.camera_from_world,
        view.positions[held],
        track.features.uvr_px[own],
        track.features.inv_sigma2[own],
        view.camera,
        observations(view, fisheye, seen, landmarks, features),
        known,
        track.features.slides_at(own.astype(np.int32)),
    )
    landmark_of = np.full(len(track.landmark_of), NO_LANDMARK, np.int32)
    landmark_of[own[pose.inlier]] = held[pose.inlier]
    better = replace(
        track, camera_from_world=pose.camera_from_world, landmark_of=landmark_of, information=pose.information
    )
    return FisheyeMatch(better, landmarks[pose.fisheye_inlier], len(landmarks), expected)


def candidates_near(view: MapView, centres: FloatArray, camera_from_world: FloatArray) -> IntArray:
    """Return the landmarks (k,) that key frames near a pose see."""
    centre = -camera_from_world[:3, :3].T @ camera_from_world[:3, 3]
    return local_landmarks(view, near_keyframes(centres, centre))

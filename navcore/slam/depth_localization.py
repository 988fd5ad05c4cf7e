"""Localization by depth where the map shows no landmarks: a frame's surfaces against those that key frames saw.

Between blank walls the pose goes on by odometry or, where nothing can be followed either, by the motion model. Surfaces
of the map take away its drift along the directions that they fix. What they leave open goes on drifting, and the
covariance shows it: a long ellipse along the corridor. Such a pose counts as seen on the map only when nothing is open.
Where no key frame's surfaces are those in view, or some of them are elsewhere now, the floor is left
(:mod:`navcore.slam.floor_anchor`): odometry drifts along it, and not out of it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from navcore.geometry import FloatArray
from navcore.slam.depth_model import DepthModel, model_of_grid
from navcore.slam.depth_tracking import (
    MOTION_SIGMA_M_S,
    MOTION_SIGMA_RAD_S,
    BoolArray,
    Carried,
    DepthView,
    carry,
    nearest_view,
)
from navcore.slam.floor_anchor import FloorAnchor
from navcore.slam.lie import inverse_se3
from navcore.slam.localizer_state import LocalizerState
from navcore.slam.pose_factor import PoseFactor, factor_error, fused
from navcore.slam.pose_uncertainty import covariance_of, drifted
from navcore.slam.self_similarity import is_sparse
from navcore.slam.slam_map import SlamMap
from navcore.slam.tracking import Track

SURE_OVERLAP = 0.4
"""Share of a key frame's surfaces that must be seen again for the map to count as seen."""
SURE_CONTRADICTED = 0.12
"""Share of what both views see that may disagree then."""
DISAGREEING_M = 0.15
"""Landmarks are not believed where surfaces see the camera farther away than this."""
MAX_SURPRISE = 25.0
"""Squared Mahalanobis distance between what was expected and what the surfaces say, beyond which they are not
believed: 99.9 % of the χ² distribution with six degrees of freedom is 22.5."""
SURFACE_SIGMA_M = 0.013
SURFACE_SIGMA_RAD = 0.004
"""Standard deviation, per axis, of what map and sensor err alike."""
_SURFACE_COVARIANCE = np.diag([SURFACE_SIGMA_M**2] * 3 + [SURFACE_SIGMA_RAD**2] * 3)
LOST_SIGMA_M = 1.0
"""Where the motion model alone fills a direction, the pose is given up beyond this standard deviation."""
UNKNOWN_PACE_M_S = 1.0
"""Standard deviation of a velocity of which nothing is known."""
KEPT_POINTS_M = 0.02
"""Points that odometry follows are placed anew when the surfaces move the camera by more than this."""


@dataclass(frozen=True, slots=True, eq=False)
class DepthPlace:
    """A frame's pose with what surfaces say of it."""

    track: Track
    covariance: FloatArray
    """(6, 6): of (position, rotation) in the world."""
    shared_covariance: FloatArray
    """(6, 6): the part of it that the map errs here, and the sensor alike."""
    is_sure: bool
    """Whether surfaces of the map fix all of it, and convince."""


class DepthAid:
    """Weighs in the surfaces of a map's key frames."""

    def __init__(self, slam_map: SlamMap) -> None:
        self._map = slam_map
        self._usable: BoolArray = np.asarray(slam_map.keyframe_depth.any(axis=(1, 2)))
        self._model: tuple[int, DepthModel] | None = None
        self._floor = FloorAnchor(slam_map)
        self._has_grey: BoolArray = np.asarray(slam_map.keyframe_grey.any(axis=(1, 2)))

    def place(
        self, seen: DepthView, state: LocalizerState, followed: Track | None, predicted: Track, is_pace_known: bool
    ) -> DepthPlace | None:
        """Return the pose of a frame that landmarks do not tell, or None where surfaces tell nothing either.

        ``state`` is that after the frame before; ``followed`` is where odometry has this one, ``predicted`` where the
        motion model has it, which knows the walker's pace or not.
        """
        near, found = self._found_near(seen, state.last, followed, predicted)
        on_odometry = None if followed is None else _prior(state, followed, None)
        if found is None:
            return self._on_floor(seen, state, followed, on_odometry)
        unguided_m_s = MOTION_SIGMA_M_S if is_pace_known else UNKNOWN_PACE_M_S
        prior = on_odometry if near is followed else _prior(state, near, unguided_m_s)
        said = found.alignment.factor(self._map.camera_from_world[found.reference])
        if prior is None or _surprise(prior, said) > MAX_SURPRISE:
            return self._on_floor(seen, state, followed, on_odometry)
        both = fused(prior, said)
        relative = covariance_of(both)
        if found.alignment.contradicted > SURE_CONTRADICTED:
            # Surfaces of which some are elsewhere now may belong to a person, or to furniture that was moved.
            relative = covariance_of(self._on_its_floor(seen, prior) or prior)
        if near is not followed and float(np.linalg.eigvalsh(relative[:3, :3])[-1]) > LOST_SIGMA_M**2:
            return None
        # Surfaces tell the pose relative to a key frame, and where that is the map knows only so well.
        shared = self._map.keyframe_covariance[found.reference] + _SURFACE_COVARIANCE
        return DepthPlace(_moved(near, both), relative + shared, shared, _is_sure(found))

    def _found_near(
        self, seen: DepthView, before: Track, followed: Track | None, predicted: Track
    ) -> tuple[Track, Carried | None]:
        """Return where a frame is looked for, by odometry or by the motion model, and what surfaces say there."""
        near = predicted if followed is None else followed
        step_s = near.stamp_s - before.stamp_s
        found = self.carried(seen, near.camera_from_world, step_s)
        if near is predicted or found is None or found.is_complete or not is_sparse(near):
            return near, found
        # Between blank walls what odometry follows are edges, which say nothing of the way along them.
        return predicted, self.carried(seen, predicted.camera_from_world, step_s)

    def _on_floor(
        self, seen: DepthView, state: LocalizerState, followed: Track | None, prior: PoseFactor | None
    ) -> DepthPlace | None:
        """Return where odometry has a frame, as high and as tilted as the floor says; None without either."""
        held = None if prior is None else self._on_its_floor(seen, prior)
        if followed is None or held is None:
            return None
        shared = state.shared_covariance
        return DepthPlace(_with_its_points(followed, held), covariance_of(held) + shared, shared, is_sure=False)

    def _on_its_floor(self, seen: DepthView, prior: PoseFactor) -> PoseFactor | None:
        """Return what is known of a pose together with what the floor says of it; None where that says nothing."""
        floor = self._floor.factor(seen.model, prior.camera_from_world, covariance_of(prior))
        return None if floor is None else fused(prior, floor)

    def carried(self, seen: DepthView, guess: FloatArray, step_s: float) -> Carried | None:
        """Return what the surfaces of the nearest key frame say of a frame near a first guess (4, 4)."""
        reference = nearest_view(self._map.camera_from_world, self._usable, guess)
        if reference < 0:
            return None
        if self._model is None or self._model[0] != reference:
            self._model = reference, model_of_grid(self._map.keyframe_depth[reference], self._map.camera)
        grey = self._map.keyframe_grey[reference] if self._has_grey[reference] else None
        return carry(reference, self._model[1], self._map.camera_from_world[reference], seen, guess, step_s, grey)


def is_elsewhere(found: Carried, camera_from_world: FloatArray) -> bool:
    """Tell whether surfaces put a frame far from a pose (4, 4)."""
    shift = factor_error(found.factor.camera_from_world, camera_from_world)[:3]
    return float(np.linalg.norm(shift)) >= DISAGREEING_M


def _is_sure(found: Carried) -> bool:
    alignment = found.alignment
    is_seen = alignment.overlap >= SURE_OVERLAP and alignment.contradicted <= SURE_CONTRADICTED
    return found.is_complete and is_seen


def _prior(state: LocalizerState, near: Track, unguided_m_s: float | None) -> PoseFactor:
    """Return what is known of a frame's pose relative to the map from the frame before, by odometry; or by the motion
    model, whose velocity has this standard deviation."""
    expected = drifted(state.covariance - state.shared_covariance, state.last, near)
    if unguided_m_s is not None:
        expected = _unguided(expected, near.stamp_s - state.last.stamp_s, unguided_m_s)
    return PoseFactor(near.camera_from_world, _information(expected, near.camera_from_world))


def _unguided(covariance: FloatArray, step_s: float, sigma_m_s: float) -> FloatArray:
    """Return the covariance (6, 6) when only the motion model leads on: a wrong velocity stays wrong, so that the
    standard deviation, not the variance, grows with time."""
    grown = covariance.copy()
    for part, sigma in ((slice(0, 3), sigma_m_s * abs(step_s)), (slice(3, 6), MOTION_SIGMA_RAD_S * abs(step_s))):
        values, vectors = np.linalg.eigh(covariance[part, part])
        root = np.sqrt(np.maximum(values, 0.0))
        grown[part, part] += (vectors * (2.0 * sigma * root + sigma**2)) @ vectors.T
    return grown


def _information(covariance: FloatArray, camera_from_world: FloatArray) -> FloatArray:
    """Return the information (6, 6) of a twist in the camera's frame; see ``covariance_in_world`` for the way back."""
    world_from_twist = np.zeros((6, 6))
    world_from_twist[:3, :3] = world_from_twist[3:, 3:] = -camera_from_world[:3, :3].T
    return np.asarray(world_from_twist.T @ np.linalg.inv(covariance) @ world_from_twist)


def _surprise(prior: PoseFactor, said: PoseFactor) -> float:
    """Return the squared Mahalanobis distance between two poses, along the directions of which both know something."""
    error = factor_error(said.camera_from_world, prior.camera_from_world)
    values, vectors = np.linalg.eigh(said.information)
    known = values > 1e-6 * max(float(values[-1]), 1e-12)
    basis = vectors[:, known]
    spread = basis.T @ np.linalg.inv(prior.information) @ basis + np.diag(1.0 / values[known])
    along = basis.T @ error
    return float(along @ np.linalg.solve(spread, along))


def _moved(track: Track, known: PoseFactor) -> Track:
    shift_m = float(np.linalg.norm(factor_error(known.camera_from_world, track.camera_from_world)[:3]))
    kept = track.carried_points if shift_m <= KEPT_POINTS_M else None
    return replace(track, camera_from_world=known.camera_from_world, information=known.information, carried_points=kept)


def _with_its_points(track: Track, known: PoseFactor) -> Track:
    """Return a frame at a better pose; the points that it carries move with it, so that odometry does not lead back."""
    points = track.carried_points
    if points is not None:
        step = inverse_se3(known.camera_from_world) @ track.camera_from_world
        points = points @ step[:3, :3].T + step[:3, 3]
    return replace(
        track, camera_from_world=known.camera_from_world, information=known.information, carried_points=points
    )

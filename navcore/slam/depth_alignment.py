"""Where a depth image was taken, by the surfaces it shares with another: point-to-plane, projectively associated.

Where walls are blank, no features carry the pose, but the surfaces do: a floor gives height, roll and pitch, a wall the
distance and the angle to it. What no surface fixes (along the walls of an even corridor) is recognised, keeps its first
guess, and has no information: nothing is invented (Zhang, Kaess and Singh 2016 call this solution remapping).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from navcore.geometry import FloatArray
from navcore.slam.depth_kernels import accumulate
from navcore.slam.depth_model import DepthModel, depth_model
from navcore.slam.keyframes import SlamCamera
from navcore.slam.lie import update_pose
from navcore.slam.pose_factor import PoseFactor, factor_error

GATES_M = (0.3, 0.15, 0.08, 0.08, 0.06, 0.06, 0.06, 0.06)
"""Distance up to which points count as the same surface at 0 m, by iteration; 10 % more for each metre of depth."""
COARSE_ITERATIONS = 2
"""The first iterations look at every second cell of every second row."""
LEVER_M = 2.0
"""A rotation counts as much as a translation of this times the angle when directions are compared."""
MIN_SENSITIVITY = 0.001
"""Mean squared change of the distances per metre moved, below which surfaces say nothing of a direction."""
DOUBTFUL_SENSITIVITY = 0.06
"""Below this, the information could come from the noise of the normals: χ² beside the pose decides."""
PROBE_M = 0.04
"""How far beside the pose it is looked at."""
MIN_CURVATURE_SHARE = 0.4
"""Share of the promised rise of χ² that must be seen there."""
RETURN_SENSITIVITY = 0.02
"""Below this, the alignment must also come back when it is begun beside the pose."""
RETURN_FROM_M = 0.12
"""How far beside."""
RETURNED_M = 0.03
"""It has come back when it ends so near to the pose; a fixed direction ends within a millimetre, an open one stays away
by a decimetre or slides on."""
CORRELATED_CELLS = 60.0
"""Errors of neighbouring cells are alike (smoothing, calibration, objects): so many count as one."""
MIN_MATCHED = 150
"""Cells that must match."""
_STEP_DONE = 2e-5


@dataclass(frozen=True, slots=True, eq=False)
class DepthAlignment:
    """How one view lies to another, and how surely."""

    camera_from_reference: FloatArray
    """(4, 4)."""
    information: FloatArray
    """(6, 6): inverse covariance of a left-multiplied twist (translation, rotation) in the camera's frame; zero along
    directions that the surfaces do not fix."""
    free_directions: FloatArray
    """(k, 6): unit twists, rotations times LEVER_M, that the surfaces do not fix."""
    rms_m: float
    """Root mean square of the distances between the surfaces."""
    overlap: float
    """Share of the reference's cells that match, 0–1."""
    contradicted: float
    """Share of the cells, among those seen in both views, that do not match, 0–1."""

    @property
    def is_complete(self) -> bool:
        """Whether the surfaces fix all six directions."""
        return len(self.free_directions) == 0

    def factor(self, reference_from_world: FloatArray) -> PoseFactor:
        """Return what this says of the camera's pose, given that of the reference (4, 4)."""
        return PoseFactor(self.camera_from_reference @ reference_from_world, self.information)


@dataclass(frozen=True, slots=True, eq=False)
class _Equations:
    """Normal equations at one pose, in twists whose rotations are scaled by LEVER_M."""

    h: FloatArray
    g: FloatArray
    cost: float
    chi2: float
    squares: float
    matched: int
    contradicted: int
    known: int


SCALE: FloatArray = np.array([1.0, 1.0, 1.0, 1.0 / LEVER_M, 1.0 / LEVER_M, 1.0 / LEVER_M])
SCALE.setflags(write=False)
"""Twists of directions, whose rotations are times LEVER_M, to twists in radians."""


def align_depth(reference: DepthModel, seen: DepthModel, camera_from_reference: FloatArray) -> DepthAlignment | None:
    """Align what a camera sees with a reference view, from a first guess (4, 4) that is right to about 0.2 m and 6°.

    Returns None where too little of the two views matches.
    """
    guess = np.array(camera_from_reference, dtype=np.float64, order="C")
    free = np.zeros((0, 6))
    for _ in range(3):
        aligned = _descend(reference, seen, guess, free)
        if aligned is None:
            return None
        pose, equations = aligned
        information, now_free = _trusted(reference, seen, pose, equations)
        if len(now_free) <= len(free):
            break
        # Steps along what is not fixed are noise: once more from the guess, without them.
        free = now_free
    return DepthAlignment(
        pose,
        information,
        now_free,
        float(np.sqrt(equations.squares / equations.matched)),
        equations.matched / equations.known,
        equations.contradicted / (equations.matched + equations.contradicted),
    )


def _equations(reference: DepthModel, seen: DepthModel, pose: FloatArray, gate_m: float, stride: int) -> _Equations:
    h, g = np.empty((6, 6)), np.empty(6)
    cost, chi2, squares, matched, contradicted, known = accumulate(
        reference.surface, seen.surface, pose, *seen.pinhole, gate_m, stride, h, g
    )
    return _Equations(h * np.outer(SCALE, SCALE), g * SCALE, cost, chi2, squares, matched, contradicted, known)


def _descend(
    reference: DepthModel, seen: DepthModel, guess: FloatArray, free: FloatArray
) -> tuple[FloatArray, _Equations] | None:
    """Gauss–Newton from the guess, without steps along the ``free`` directions (k, 6)."""
    pose = guess
    held = np.eye(6) - free.T @ free
    for iteration, gate_m in enumerate(GATES_M):
        stride = 2 if iteration < COARSE_ITERATIONS else 1
        equations = _equations(reference, seen, pose, gate_m, stride)
        if equations.matched * stride * stride < MIN_MATCHED:
            return None
        step = _step(equations, held)
        pose = moved_by(pose, step)
        if iteration > COARSE_ITERATIONS and float(np.abs(step).max()) < _STEP_DONE:
            break
    equations = _equations(reference, seen, pose, GATES_M[-1], 1)
    return (pose, equations) if equations.matched >= MIN_MATCHED else None


def _step(equations: _Equations, held: FloatArray) -> FloatArray:
    damped = held @ equations.h @ held
    damped += 1e-4 * np.trace(damped) / 6.0 * np.eye(6)
    return np.asarray(-held @ np.linalg.solve(damped, held @ equations.g))


def moved_by(pose: FloatArray, step: FloatArray) -> FloatArray:
    """Return a pose (4, 4) after a step (6,) along directions whose rotations are times LEVER_M."""
    out = np.empty((4, 4))
    update_pose(pose, step * SCALE, out)
    return out


def _trusted(
    reference: DepthModel, seen: DepthModel, pose: FloatArray, equations: _Equations
) -> tuple[FloatArray, FloatArray]:
    """Return the information (6, 6) that can be believed, and the directions (k, 6) of which there is none."""
    values, vectors = np.linalg.eigh(equations.h)
    weight = float(np.trace(equations.h[:3, :3]))
    believed = np.zeros(6)
    for k in range(6):
        sensitivity = values[k] / weight
        if sensitivity < MIN_SENSITIVITY:
            continue
        share = 1.0
        if sensitivity < DOUBTFUL_SENSITIVITY:
            share = _curvature_share(reference, seen, pose, equations, vectors[:, k], values[k])
        if share <= MIN_CURVATURE_SHARE:
            continue
        if sensitivity >= RETURN_SENSITIVITY or _returns(reference, seen, pose, vectors[:, k]):
            believed[k] = values[k] * min(share, 1.0)
    # Where surfaces disagree by more than the sensor's noise, something else is wrong, and it counts for less.
    excess = max(1.0, equations.cost / equations.matched)
    scaled = (vectors * believed) @ vectors.T / (CORRELATED_CELLS * excess)
    return scaled / np.outer(SCALE, SCALE), vectors[:, believed == 0.0].T.copy()


def _curvature_share(
    reference: DepthModel,
    seen: DepthModel,
    pose: FloatArray,
    equations: _Equations,
    direction: FloatArray,
    value: float,
) -> float:
    """Return the rise of χ² on both sides of a pose as a share of what ``value`` promises, points matched anew.

    Noisy normals promise that moving along a blank wall matters; the wall is found to be the same all along.
    """
    rise = 0.0
    for side in (-PROBE_M, PROBE_M):
        beside = _equations(reference, seen, moved_by(pose, side * direction), GATES_M[-1], 1)
        if beside.matched < MIN_MATCHED:
            return 0.0
        rise += beside.chi2 / beside.matched - equations.chi2 / equations.matched
    return float(rise * equations.matched / (2.0 * value * PROBE_M**2))


def _returns(reference: DepthModel, seen: DepthModel, pose: FloatArray, direction: FloatArray) -> bool:
    """Tell whether the alignment comes back to a pose when it is begun on either side of it along a direction."""
    for side in (-RETURN_FROM_M, RETURN_FROM_M):
        again = _descend(reference, seen, moved_by(pose, side * direction), np.zeros((0, 6)))
        if again is None:
            return False
        away = factor_error(again[0], pose) / SCALE
        if abs(float(away @ direction)) > RETURNED_M:
            return False
    return True


def warm_up() -> None:
    """Compile this module's kernels."""
    model = depth_model(np.full((240, 320), 2.0, np.float32), SlamCamera(320, 240, 230.0, 230.0, 160.0, 120.0, 100.0))
    align_depth(model, model, np.eye(4))

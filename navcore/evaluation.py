"""How far a trajectory is from the truth: the absolute trajectory error after rigid alignment (Sturm et al. 2012)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from navcore.errors import InputError
from navcore.geometry import FloatArray, Transform

MAX_TRUTH_GAP_S = 1.0
"""Between two true poses farther apart than this nothing is interpolated."""


@dataclass(frozen=True, slots=True)
class TrajectoryError:
    """Distances between estimated and true positions, after the rigid alignment that makes their squares least."""

    rmse_m: float
    median_m: float
    max_m: float
    compared_count: int
    """Poses that were compared."""


def align_rigidly(points_a: FloatArray, points_b: FloatArray) -> Transform:
    """Return ``a_from_b``, which takes points b (n, 3) nearest to points a (n, 3) by least squares (Horn)."""
    centre_a, centre_b = points_a.mean(axis=0), points_b.mean(axis=0)
    u, _, vt = np.linalg.svd((points_a - centre_a).T @ (points_b - centre_b))
    rotation = u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt)) or 1.0]) @ vt
    return Transform.from_rotation_translation(rotation, centre_a - rotation @ centre_b)


def absolute_trajectory_error(
    stamps_s: FloatArray, positions_m: FloatArray, true_stamps_s: FloatArray, true_positions_m: FloatArray
) -> TrajectoryError:
    """Compare positions (n, 3) at stamps (n,) with the truth (m, 3) at (m,), interpolated. Both ascend.

    Raises InputError where fewer than three poses lie within the time of the truth.
    """
    after = np.clip(np.searchsorted(true_stamps_s, stamps_s), 1, max(1, len(true_stamps_s) - 1))
    if len(true_stamps_s) < 2:
        raise InputError("The ground truth has fewer than two poses: give one that covers the recording.")
    inside = (stamps_s >= true_stamps_s[0]) & (stamps_s <= true_stamps_s[-1])
    inside &= true_stamps_s[after] - true_stamps_s[after - 1] <= MAX_TRUTH_GAP_S
    if np.count_nonzero(inside) < 3:
        raise InputError(
            "Fewer than three poses lie within the time of the ground truth: use the truth of this recording."
        )
    truth = np.stack(
        [np.interp(stamps_s[inside], true_stamps_s, true_positions_m[:, axis]) for axis in range(3)], axis=1
    )
    estimate = positions_m[inside]
    error = np.linalg.norm(align_rigidly(truth, estimate).apply(estimate) - truth, axis=1)
    return TrajectoryError(float(np.sqrt(np.mean(error**2))), float(np.median(error)), float(error.max()), len(error))

"""What surfaces leave open, by their shading: how far along a blank wall, by the light that falls on it.

A painted wall has no corner, but lamps, doors and windows make it brighter here and darker there. Between two views
whose surfaces are aligned, the grey of the same places is compared, in small cells (dense alignment: Kerl, Sturm and
Cremers 2013), and steps are taken only along what the surfaces leave open. What a camera adds of its own (exposure, a
lens that is darker at its corners) is estimated along with it, so that it says nothing of motion. Cells with an edge
are left out. An answer is believed where it is found again from beside it on both sides; elsewhere nothing is said.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from navcore.geometry import FloatArray
from navcore.slam.depth_alignment import SCALE, moved_by
from navcore.slam.depth_model import DepthModel, cell_of, depth_model
from navcore.slam.keyframes import ByteArray, SlamCamera
from navcore.slam.pose_factor import factor_error
from navcore.slam.shading_kernels import NUISANCES, MaskArray, accumulate_shading, calm_cells

ITERATIONS = 12
MIN_CELLS = 300
"""Cells that must be compared."""
MAX_RMS_LEVELS = 2.0
"""Root mean square of the differences in grey beyond which the two views do not show the same light."""
CORRELATED_CELLS = 60.0
"""Differences of neighbouring cells are alike: so many count as one."""
LEAST_VARIANCE = 0.25
"""Variance of a cell's grey, squared levels, at least."""
MAX_SIGMA_M = 0.04
"""A direction whose standard deviation is larger stays open."""
RETURN_FROM_M = 0.15
"""From so far beside, on both sides, the alignment must come back."""
RETURNED_M = 0.03
"""It has come back when it ends so near."""
MAX_SHIFT_M = 0.3
"""A step from the first guess that is longer is not believed."""
_STEP_DONE = 1e-4


@dataclass(frozen=True, slots=True, eq=False)
class ShadedView:
    """The surfaces that one view saw, with their grey."""

    model: DepthModel
    grey: ByteArray
    """(rows, columns): mean grey of each cell."""
    calm: MaskArray
    """(rows, columns): cells without an edge."""

    @staticmethod
    def of(model: DepthModel, grey: ByteArray) -> ShadedView:
        """Return the view of a depth model and its grey grid (rows, columns)."""
        return ShadedView(model, grey, calm_cells(grey))


@dataclass(frozen=True, slots=True, eq=False)
class ShadingAlignment:
    """What shading says of directions that surfaces leave open."""

    camera_from_reference: FloatArray
    """(4, 4)."""
    information: FloatArray
    """(6, 6): inverse covariance of a left-multiplied twist in the camera's frame, along the open directions only."""
    free_directions: FloatArray
    """(k, 6): unit twists, rotations times LEVER_M, that shading leaves open as well."""


def grey_grid(grey: ByteArray, camera: SlamCamera) -> ByteArray:
    """Return the mean grey (rows, columns) of the cells of a grey image (h, w); see ``depth_model.grid_shape``."""
    cell_px = cell_of(camera)
    rows, columns = grey.shape[0] // cell_px, grey.shape[1] // cell_px
    whole = np.ascontiguousarray(grey[: rows * cell_px, : columns * cell_px])
    return np.asarray(cv2.resize(whole, (columns, rows), interpolation=cv2.INTER_AREA), dtype=np.uint8)


def align_shading(
    reference: ShadedView, seen: ShadedView, camera_from_reference: FloatArray, free_directions: FloatArray
) -> ShadingAlignment | None:
    """Align two views along directions (k, 6) that their surfaces leave open, from a pose (4, 4) that these have given.

    Returns None where shading says nothing that can be believed.
    """
    found = _descend(reference, seen, camera_from_reference, free_directions)
    if found is None:
        return None
    pose, covariance = found
    shift = factor_error(pose, np.ascontiguousarray(camera_from_reference)) / SCALE
    if float(np.linalg.norm(free_directions @ shift)) > MAX_SHIFT_M:
        return None
    variances, axes = np.linalg.eigh(covariance)
    fixed = variances < MAX_SIGMA_M**2
    # In twists of the camera: what is fixed, and what stays open.
    known, still_free = axes[:, fixed].T @ free_directions, axes[:, ~fixed].T @ free_directions
    if len(known) == 0 or not _returns(reference, seen, pose, free_directions, known):
        return None
    if len(still_free):
        again = _descend(reference, seen, camera_from_reference, known)
        if again is None:
            return None
        pose = again[0]
    information = known.T @ np.diag(1.0 / variances[fixed]) @ known
    return ShadingAlignment(pose, information / np.outer(SCALE, SCALE), still_free)


def _descend(
    reference: ShadedView, seen: ShadedView, start: FloatArray, free: FloatArray
) -> tuple[FloatArray, FloatArray] | None:
    """Gauss–Newton along ``free`` (k, 6); return the pose (4, 4) and the covariance (k, k) along these directions."""
    pose = np.array(start, dtype=np.float64, order="C")
    count_free = len(free)
    size = count_free + NUISANCES
    nuisances = np.zeros(NUISANCES)
    nuisances[0] = 1.0
    motions = np.ascontiguousarray(free * SCALE)
    h, g = np.empty((size, size)), np.empty(size)
    for _ in range(ITERATIONS):
        squares, count = accumulate_shading(
            reference.model.surface,
            reference.grey,
            reference.calm,
            seen.model.surface,
            seen.grey,
            seen.calm,
            pose,
            seen.model.pinhole,
            motions,
            nuisances,
            h,
            g,
        )
        if count < MIN_CELLS:
            return None
        scale = np.sqrt(np.maximum(np.diag(h), 1e-9))
        inverse = np.linalg.pinv(h / np.outer(scale, scale), rcond=1e-6) / np.outer(scale, scale)
        step = -inverse @ g
        nuisances += step[count_free:]
        longest = float(np.abs(step[:count_free]).max())
        along = step[:count_free] * min(1.0, 0.15 / max(longest, 1e-9))
        pose = moved_by(pose, along @ free)
        if longest < _STEP_DONE:
            break
    variance = squares / count
    if variance > MAX_RMS_LEVELS**2:
        return None
    covariance = inverse[:count_free, :count_free] * max(variance, LEAST_VARIANCE) * CORRELATED_CELLS
    # Where there is no gradient at all, the pseudo-inverse says nothing instead of "unknown".
    covariance[np.diag(h)[:count_free] < 1e-6, :] = 0.0
    flat = np.diag(h)[:count_free] < 1e-6
    covariance[flat, flat] = 1e6
    return pose, covariance


def _returns(reference: ShadedView, seen: ShadedView, pose: FloatArray, free: FloatArray, known: FloatArray) -> bool:
    """Tell whether the alignment comes back to a pose from either side of it along each known direction (k, 6)."""
    for direction in known:
        for side in (-RETURN_FROM_M, RETURN_FROM_M):
            again = _descend(reference, seen, moved_by(pose, side * direction), free)
            if again is None:
                return False
            away = factor_error(again[0], pose) / SCALE
            if float(np.abs(known @ away).max()) > RETURNED_M:
                return False
    return True


def warm_up() -> None:
    """Compile this module's kernels."""
    camera = SlamCamera(320, 240, 230.0, 230.0, 160.0, 120.0, 100.0)
    model = depth_model(np.full((240, 320), 2.0, np.float32), camera)
    view = ShadedView.of(model, np.full(model.grid.shape, 128, np.uint8))
    align_shading(view, view, np.eye(4), np.eye(6)[:1])

"""Following the camera by depth where landmarks are few: a reference view's surfaces say where the next frame is.

What surfaces leave open (along an even corridor, in front of one wall) is filled by the motion model, with a variance
that says so.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from navcore.geometry import FloatArray
from navcore.slam.depth_alignment import LEVER_M, DepthAlignment, align_depth
from navcore.slam.depth_kernels import GridArray
from navcore.slam.depth_model import DepthModel, depth_grid, model_of_grid
from navcore.slam.keyframes import ByteArray, SlamCamera
from navcore.slam.lie import inverse_se3, log_so3
from navcore.slam.pose_factor import PoseFactor
from navcore.slam.shading_alignment import ShadedView, align_shading, grey_grid
from navcore.types import DepthImage

MIN_OVERLAP = 0.25
"""Share of the reference's surfaces that must be seen again."""
MAX_CONTRADICTED = 0.25
"""Share of what both views see that may disagree."""
MAX_FREE = 3
"""Directions that may stay open: a single wall leaves three."""
MIN_KNOWN_SHARE = 0.15
"""Share of the image that must show surfaces."""
MOTION_SIGMA_M_S = 0.4
MOTION_SIGMA_RAD_S = 0.5
"""By how much a walker's velocity differs from that of the moment before, standard deviation."""
NEAR_M = 1.5
"""Key frames within this distance can serve as a reference."""
NEAR_RAD = 0.6
"""They must look the same way to within this angle."""
ANGLE_LEVER_M = 1.5
"""A radian counts as much as this distance when the nearest key frame is looked for."""

BoolArray = NDArray[np.bool_]


class DepthView:
    """The depth of one frame; its grid and surfaces are worked out when they are asked for, once."""

    def __init__(
        self,
        camera: SlamCamera,
        depth_m: DepthImage | None = None,
        grid: GridArray | None = None,
        image: ByteArray | None = None,
        grey: ByteArray | None = None,
    ) -> None:
        self._camera = camera
        self.depth_m = depth_m
        """(h, w), metres; None where only the grid is kept."""
        self._given = grid
        self._image = image
        self._given_grey = grey

    @cached_property
    def grid(self) -> GridArray:
        """(rows, columns): see :class:`navcore.slam.depth_model.DepthModel`."""
        if self.depth_m is None:
            return np.zeros((1, 1), np.uint16) if self._given is None else self._given
        return depth_grid(self.depth_m, self._camera)

    @cached_property
    def model(self) -> DepthModel:
        """The surfaces."""
        return model_of_grid(self.grid, self._camera)

    def reduced(self) -> DepthView:
        """Return the same without the image, to be kept."""
        return DepthView(self._camera, grid=self.grid, grey=self.grey)

    @cached_property
    def grey(self) -> ByteArray | None:
        """(rows, columns): mean grey of the grid's cells, None where no picture belongs to the depth."""
        return self._given_grey if self._image is None else grey_grid(self._image, self._camera)

    @cached_property
    def shaded(self) -> ShadedView | None:
        """The surfaces with their grey."""
        return None if self.grey is None or self.grey.shape != self.grid.shape else ShadedView.of(self.model, self.grey)

    @property
    def is_structured(self) -> bool:
        """Whether surfaces alone fix the camera: seen from the same place, no direction is open."""
        if self.model.known_share < MIN_KNOWN_SHARE:
            return False
        aligned = align_depth(self.model, self.model, np.eye(4))
        return aligned is not None and aligned.is_complete


@dataclass(frozen=True, slots=True, eq=False)
class Carried:
    """What depth says of a frame's pose."""

    factor: PoseFactor
    """The pose, and its information: of the surfaces, and of the motion model where these leave a direction open."""
    alignment: DepthAlignment
    reference: int
    """Key frame whose surfaces were used."""

    @property
    def is_complete(self) -> bool:
        """Whether no direction rests on the motion model."""
        return self.alignment.is_complete

    @property
    def motion_information(self) -> FloatArray:
        """(6, 6): the part of the information that only the motion model gives."""
        return self.factor.information - self.alignment.information


def carry(
    reference: int,
    reference_model: DepthModel,
    reference_from_world: FloatArray,
    seen: DepthView,
    guess: FloatArray,
    step_s: float,
    reference_grey: ByteArray | None = None,
) -> Carried | None:
    """Find a frame's pose by a reference view, from a first guess (4, 4) that the motion model made over ``step_s``.

    Returns None where the surfaces do not convince.
    """
    if seen.model.known_share < MIN_KNOWN_SHARE:
        return None
    aligned = align_depth(reference_model, seen.model, guess @ inverse_se3(reference_from_world))
    if aligned is None or aligned.overlap < MIN_OVERLAP or aligned.contradicted > MAX_CONTRADICTED:
        return None
    if len(aligned.free_directions) > MAX_FREE:
        return None
    if reference_grey is not None and seen.shaded is not None and not aligned.is_complete:
        aligned = _shaded(aligned, ShadedView.of(reference_model, reference_grey), seen.shaded)
    information = aligned.information + motion_information(aligned.free_directions, step_s)
    return Carried(PoseFactor(aligned.camera_from_reference @ reference_from_world, information), aligned, reference)


def _shaded(aligned: DepthAlignment, reference: ShadedView, seen: ShadedView) -> DepthAlignment:
    """Return an alignment with what shading says of the directions that it leaves open."""
    found = align_shading(reference, seen, aligned.camera_from_reference, aligned.free_directions)
    if found is None:
        return aligned
    return replace(
        aligned,
        camera_from_reference=found.camera_from_reference,
        information=aligned.information + found.information,
        free_directions=found.free_directions,
    )


def motion_information(free_directions: FloatArray, step_s: float) -> FloatArray:
    """Return what the motion model knows, after ``step_s``, of directions (k, 6) that nothing else fixes, as (6, 6)."""
    step_s = max(abs(step_s), 0.01)
    lever = np.array([1.0, 1.0, 1.0, LEVER_M, LEVER_M, LEVER_M])
    sigma = step_s * np.array([MOTION_SIGMA_M_S] * 3 + [MOTION_SIGMA_RAD_S] * 3) * lever
    along = free_directions @ np.diag(sigma**-2.0) @ free_directions.T
    return np.asarray(free_directions.T @ along @ free_directions) * np.outer(lever, lever)


def motion_covariance(free_directions: FloatArray) -> FloatArray:
    """Return the covariance (6, 6) of a twist after one second in which only the motion model told of directions
    (k, 6); zero across them."""
    lever = np.array([1.0, 1.0, 1.0, LEVER_M, LEVER_M, LEVER_M])
    sigma = np.array([MOTION_SIGMA_M_S] * 3 + [MOTION_SIGMA_RAD_S] * 3) * lever
    along = np.linalg.inv(free_directions @ np.diag(sigma**-2.0) @ free_directions.T)
    twists = free_directions / lever
    return np.asarray(twists.T @ along @ twists)


def nearest_view(camera_from_world: FloatArray, usable: BoolArray, guess: FloatArray) -> int:
    """Return the key frame, of poses (K, 4, 4) and those ``usable`` (K,), that looks where ``guess`` does, or −1."""
    centres = -np.einsum("kji,kj->ki", camera_from_world[:, :3, :3], camera_from_world[:, :3, 3])
    distance = np.linalg.norm(centres + guess[:3, :3].T @ guess[:3, 3], axis=1)
    cosine = np.einsum("kij,ij->k", camera_from_world[:, :3, :3], guess[:3, :3])
    angle = np.arccos(np.clip(0.5 * (cosine - 1.0), -1.0, 1.0))
    away = np.where(usable & (distance < NEAR_M) & (angle < NEAR_RAD), distance + ANGLE_LEVER_M * angle, np.inf)
    best = int(np.argmin(away)) if len(away) else -1
    return best if best >= 0 and np.isfinite(away[best]) else -1


def turned_rad(a_from_world: FloatArray, b_from_world: FloatArray) -> float:
    """Return the angle between two poses (4, 4)."""
    step = np.ascontiguousarray(a_from_world[:3, :3] @ b_from_world[:3, :3].T)
    return float(np.linalg.norm(log_so3(step)))

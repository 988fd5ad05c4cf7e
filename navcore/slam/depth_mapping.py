"""The depth side of mapping: key frames keep small depth grids, by which frames with few landmarks are placed."""

from __future__ import annotations

import numpy as np

from navcore.geometry import FloatArray
from navcore.slam.depth_model import DepthModel, grid_shape, model_of_grid
from navcore.slam.depth_tracking import Carried, DepthView, carry, nearest_view
from navcore.slam.map import MapBuilder

MIN_TRACKED = 25
"""Landmarks that must agree for a frame to count as tracked by them."""
SPARSE_LANDMARKS = 80
"""Fewer landmarks than this, and depth is asked as well."""
KEYFRAME_OVERLAP = 0.6
"""A key frame is due when less than this share of the reference's surfaces is seen again, where depth carries."""
MAX_BLIND_S = 2.0
"""For so long the motion model may fill directions that neither landmarks nor surfaces fix."""
FOUND_AGAIN_S = 0.5
"""For so long after a loss surfaces alone can find the camera again: corridors look alike every few metres."""
FOUND_AGAIN_OVERLAP = 0.5
"""After a loss, this share of the last reference's surfaces must be seen again."""


class DepthCarrier:
    """Places frames by the surfaces of key frames."""

    def __init__(self, builder: MapBuilder) -> None:
        self._builder = builder
        self._shape = grid_shape(builder.camera)
        self._model: tuple[int, DepthModel] | None = None
        self._sure_s = 0.0

    def keep(self, keyframe: int, depth: DepthView) -> None:
        """Let a key frame keep its depth grid."""
        if depth.grid.shape == self._shape:
            self._builder.depth_grids[keyframe] = depth.grid
            if depth.grey is not None:
                self._builder.grey_grids[keyframe] = depth.grey

    def carry(self, depth: DepthView, guess: FloatArray, step_s: float, was_lost: bool, last: int) -> Carried | None:
        """Place a frame near a first guess (4, 4), ``step_s`` after the last one; None where depth does not tell.

        The nearest key frame is asked, then that of the frame before, ``last``: where the map is bent, the nearest may
        be one from before the bend.
        """
        nearest = self._reference_for(guess)
        found = self._carry_by(nearest, depth, guess, step_s, was_lost)
        if found is None and last != nearest and last in self._builder.depth_grids:
            found = self._carry_by(last, depth, guess, step_s, was_lost)
        return found

    def _carry_by(
        self, reference: int, depth: DepthView, guess: FloatArray, step_s: float, was_lost: bool
    ) -> Carried | None:
        if reference < 0 or depth.grid.shape != self._shape:
            return None
        grey = self._builder.grey_grids.get(reference)
        found = carry(
            reference, self._model_of(reference), self._builder.pose_of(reference), depth, guess, step_s, grey
        )
        if found is None or not was_lost:
            return found
        if abs(step_s) > FOUND_AGAIN_S:
            return None
        is_sure = found.is_complete and found.alignment.overlap >= FOUND_AGAIN_OVERLAP
        return found if is_sure else None

    def note(self, stamp_s: float, is_fixed: bool) -> bool:
        """Remember whether a frame's pose was fixed by something seen; return whether it may be kept."""
        if is_fixed:
            self._sure_s = stamp_s
        return abs(stamp_s - self._sure_s) <= MAX_BLIND_S

    def _reference_for(self, guess: FloatArray) -> int:
        usable = np.zeros(len(self._builder.keyframes), np.bool_)
        usable[list(self._builder.depth_grids)] = True
        return nearest_view(self._builder.camera_from_world, usable & self._builder.keyframe_alive, guess)

    def _model_of(self, keyframe: int) -> DepthModel:
        if self._model is None or self._model[0] != keyframe:
            self._model = keyframe, model_of_grid(self._builder.depth_grids[keyframe], self._builder.camera)
        return self._model[1]

"""How much room there is beside a path and around a place, as somebody has measured it in the map's cloud."""

from __future__ import annotations

import enum
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from navcore.geometry import FloatArray


class Bound(enum.IntEnum):
    """What ends the free space."""

    OPEN = 0
    """Nothing: it is free as far as was looked."""
    OBSTACLE = 1
    """Something stands or hangs there."""
    UNKNOWN = 2
    """No floor has been seen there: it may be free, an obstacle, or a drop. Unknown is never free."""


@dataclass(frozen=True, slots=True, eq=False)
class PathClearance:
    """The room to the left and right of a path, at points of it."""

    points_m: FloatArray
    """(n, 2)."""
    arc_m: FloatArray
    """(n,): way from the path's first point, ascending."""
    left_m: FloatArray
    """(n,): known to be free, from the path to its left."""
    right_m: FloatArray
    """(n,)."""
    left_bound: NDArray[np.int8]
    """(n,): what ends it (:class:`Bound`)."""
    right_bound: NDArray[np.int8]
    """(n,)."""

    @property
    def width_m(self) -> FloatArray:
        """(n,): the free width that is known."""
        return self.left_m + self.right_m


@dataclass(frozen=True, slots=True)
class PlaceClearance:
    """The room around a place."""

    radius_m: float
    """To the nearest thing that stands or hangs there; inf where there is none."""
    is_known: bool
    """Whether floor has been seen there."""

"""What the depth camera sees on each bearing, as points on the floor in the walker's frame. Pure.

What is unknown is drawn too, near the walker and grey: a gap would look like a way that is free.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from console.viewer.appearance import Rgb
from navcore.geometry import FloatArray
from navcore.types import BearingState

UNKNOWN_AT_M = 0.8
_Z_M = 0.12
COLOURS: dict[BearingState, Rgb] = {
    BearingState.OBSTACLE: (213, 94, 0),
    BearingState.DROP: (204, 60, 160),
    BearingState.HEARD: (230, 159, 0),
    BearingState.UNKNOWN: (125, 130, 138),
}
REMEMBERED: Rgb = (150, 110, 80)


class Scan(Protocol):
    """A scan as the device tells it: evenly spaced bearings from right to left, and what is remembered beside them."""

    @property
    def first_rad(self) -> float:
        """The rightmost bearing."""
        ...

    @property
    def step_rad(self) -> float:
        """Between two bearings."""
        ...

    @property
    def states(self) -> Sequence[int]:
        """A BearingState for each bearing."""
        ...

    @property
    def nearest_cm(self) -> Sequence[int]:
        """Distance to what is nearest."""
        ...

    @property
    def unseen(self) -> Sequence[tuple[int, int]]:
        """Bearing (degrees) and distance (cm) of what is remembered, and not in the image."""
        ...


def scan_points(scan: Scan) -> tuple[FloatArray, NDArray[np.uint8]]:
    """Return points (n, 3) and their colours (n, 3); none where every bearing is known to be free."""
    found: list[tuple[float, float, Rgb]] = []
    for number, (state, nearest_cm) in enumerate(zip(scan.states, scan.nearest_cm, strict=False)):
        colour = COLOURS.get(BearingState(state))
        if colour is not None:
            distance_m = UNKNOWN_AT_M if state == BearingState.UNKNOWN else nearest_cm / 100
            found.append((scan.first_rad + number * scan.step_rad, distance_m, colour))
    found += [(math.radians(bearing_deg), nearest_cm / 100, REMEMBERED) for bearing_deg, nearest_cm in scan.unseen]
    points = [(distance_m * math.cos(angle), distance_m * math.sin(angle), _Z_M) for angle, distance_m, _ in found]
    colours = [colour for _, _, colour in found]
    return np.array(points, dtype=np.float64).reshape(-1, 3), np.array(colours, dtype=np.uint8).reshape(-1, 3)

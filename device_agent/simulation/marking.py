"""The sighted person names each place while standing at it, as one does when recording a road."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from device_agent.simulation.building import Building
from navcore.geometry import Transform
from navcore.recording import Mark

MAX_DISTANCE_M = 0.5
"""Farther than this from a place the person does not name it."""


def spoken_marks(building: Building, stamped_poses: Sequence[tuple[float, Transform]]) -> list[Mark]:
    """Return a mark for each place of the building, at the moment when the walk is nearest to it, in order of time."""
    stamps_s = np.array([stamp for stamp, _ in stamped_poses])
    positions_m = np.array([pose.translation[:2] for _, pose in stamped_poses])
    marks: list[Mark] = []
    for place in building.places.values():
        distances_m = np.hypot(*(positions_m - (place.x_m, place.y_m)).T)
        nearest = int(np.argmin(distances_m))
        if distances_m[nearest] <= MAX_DISTANCE_M:
            marks.append(Mark(float(stamps_s[nearest]), place.kind, place.name))
    return sorted(marks, key=lambda mark: mark.stamp_s)

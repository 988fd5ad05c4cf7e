"""What can make a walk hard: people, changed furniture, darkness, a covered camera, a start that nobody recorded."""

from __future__ import annotations

import math
from dataclasses import dataclass

from navcore.errors import InputError


@dataclass(frozen=True, slots=True)
class Scenario:
    """What differs from the ordinary walk; everything can be combined. Raises InputError for what cannot be."""

    people_share: float = 0.0
    """Share of the frames that show walking people, about."""
    changed_furniture_share: float = 0.0
    """Share of the movable furniture that is not where it was: moved, or gone; some is new."""
    dark_m: tuple[float, float] | None = None
    """From where to where along the walk the lights are off, metres."""
    covered_s: tuple[float, float] | None = None
    """When, and for how long, something covers the camera: seconds from the start, seconds."""
    kidnapped: bool = False
    """The walk begins somewhere else on the floor, beside the road, facing anywhere."""

    def __post_init__(self) -> None:
        for share, what in ((self.people_share, "people"), (self.changed_furniture_share, "changed furniture")):
            if not 0.0 <= share <= 1.0:
                raise InputError(f"A share of {share:g} for {what} makes no sense: choose one from 0 to 1.")
        if self.dark_m is not None and not 0.0 <= self.dark_m[0] < self.dark_m[1] < math.inf:
            raise InputError(
                f"No stretch is dark from {self.dark_m[0]:g} to {self.dark_m[1]:g} m: begin before its end."
            )
        if self.covered_s is not None and not (self.covered_s[0] >= 0.0 and 0.0 < self.covered_s[1] < math.inf):
            raise InputError("A camera is covered from a moment of the walk on, for more than 0 s: choose such times.")


ORDINARY = Scenario()
"""The walk as it is recorded for a map."""

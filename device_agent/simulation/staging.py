"""Things and people that do their part when the walker comes: a door that closes, a chair that is pulled out.

Unlike a :class:`building.Mover`, which goes its way by the clock, an actor waits for its cue, so that a scene is the
same for a slow walker and for a fast one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from device_agent.simulation.building import pose_in_stride
from device_agent.simulation.people import STRIDE_M, Clothes, walking_figure
from device_agent.simulation.renderer import Placement
from device_agent.simulation.shapes import Piece


@dataclass(frozen=True, slots=True)
class Mark:
    """Where an actor is, so long after its cue; in between it moves evenly. Seconds, metres, degrees."""

    after_s: float
    x_m: float
    y_m: float
    yaw_deg: float = 0.0


@dataclass(slots=True, eq=False)
class Actor:
    """Something that stands at its first mark until the walker has come near, then goes from mark to mark."""

    poses: tuple[Piece, ...]
    marks: tuple[Mark, ...]
    """In order of time; the first one is for 0 s."""
    cue_m: tuple[float, float, float] | None = None
    """Place (x, y) and radius, metres: it begins once the walker is inside; None begins with the walk."""
    stride_m: float = STRIDE_M
    begun_s: float | None = None
    """When it began; an actor plays once, and is made anew for the next walk."""

    def watch(self, now_s: float, x_m: float, y_m: float) -> None:
        """Look at where the walker is, and begin where that is the cue."""
        if self.begun_s is not None:
            return
        if self.cue_m is None or math.hypot(x_m - self.cue_m[0], y_m - self.cue_m[1]) <= self.cue_m[2]:
            self.begun_s = now_s

    def placement_at(self, time_s: float) -> Placement:
        """Return where it is at a time of the simulation."""
        since_s = 0.0 if self.begun_s is None else max(0.0, time_s - self.begun_s)
        stamps, x_m, y_m, yaw_deg = (
            np.array([getattr(mark, name) for mark in self.marks]) for name in ("after_s", "x_m", "y_m", "yaw_deg")
        )
        here = [float(np.interp(since_s, stamps, column)) for column in (x_m, y_m, yaw_deg)]
        travelled_m = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(x_m), np.diff(y_m)))])
        gone_m = float(np.interp(since_s, stamps, travelled_m))
        number = pose_in_stride(gone_m, self.stride_m, len(self.poses))
        return Placement(here[0], here[1], math.radians(here[2]), number)


@dataclass(slots=True, eq=False)
class Oncomer:
    """Somebody who comes towards the walker, stops before them, and after a while steps aside and walks on."""

    poses: tuple[Piece, ...]
    x_m: float
    y_m: float
    yaw_rad: float
    """Where they walk to."""
    aside_m: float
    """So far to their left they step; negative is to the right."""
    speed_m_s: float = 0.9
    waits_s: float = 3.0
    stands_before_m: float = 1.1
    waited_s: float = 0.0
    aside_now_m: float = 0.0
    walked_m: float = 0.0
    seen_s: float | None = None

    def watch(self, now_s: float, x_m: float, y_m: float) -> None:
        """Look at where the walker is, and make the steps since the last look."""
        passed_s = 0.0 if self.seen_s is None else now_s - self.seen_s
        self.seen_s = now_s
        here = self.placement_at(now_s)
        c, s = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        ahead_m = c * (x_m - here.x_m) + s * (y_m - here.y_m)
        beside_m = abs(c * (y_m - here.y_m) - s * (x_m - here.x_m))
        if not (0.0 < ahead_m < self.stands_before_m and beside_m < _ROOM_BESIDE_M):
            self.walked_m += self.speed_m_s * passed_s
        elif self.waited_s < self.waits_s:
            self.waited_s += passed_s
        else:
            step_m = _SIDE_STEP_M_S * passed_s
            self.aside_now_m += max(-step_m, min(step_m, self.aside_m - self.aside_now_m))

    def placement_at(self, time_s: float) -> Placement:
        """Return where they are since the last look."""
        c, s = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        x_m = self.x_m + self.walked_m * c - self.aside_now_m * s
        y_m = self.y_m + self.walked_m * s + self.aside_now_m * c
        return Placement(x_m, y_m, self.yaw_rad, pose_in_stride(self.walked_m, STRIDE_M, len(self.poses)))


_SIDE_STEP_M_S = 0.5
_ROOM_BESIDE_M = 0.7


def oncomer(x_m: float, y_m: float, yaw_deg: float, aside_m: float, speed_m_s: float = 0.9) -> Oncomer:
    """Return somebody who comes towards the walker from a place."""
    return Oncomer(walking_figure(Clothes("#3c6e4a")), x_m, y_m, math.radians(yaw_deg), aside_m, speed_m_s)


def thing(piece: Piece, *marks: Mark, cue_m: tuple[float, float, float] | None = None) -> Actor:
    """Return a thing that somebody moves: a door, a chair."""
    return Actor((piece,), marks, cue_m)


def person(
    path_m: tuple[tuple[float, float], ...],
    speed_m_s: float = 0.9,
    cue_m: tuple[float, float, float] | None = None,
    after_s: float = 0.0,
    colour: str = "#b03a48",
) -> Actor:
    """Return somebody who stands at the first corner of a path and walks along it, so long after their cue."""
    corners = np.asarray(path_m, np.float64)
    steps = np.diff(corners, axis=0)
    yaws_deg = np.degrees(np.arctan2(steps[:, 1], steps[:, 0])).tolist()
    marks = [Mark(0.0, *path_m[0], yaws_deg[0])]
    for (x_m, y_m), step, yaw_deg in zip(path_m[1:], steps, yaws_deg, strict=True):
        began = marks[-1].after_s if len(marks) > 1 else after_s
        # They turn before they go on, in no time.
        marks.append(Mark(began + 1e-3, marks[-1].x_m, marks[-1].y_m, yaw_deg))
        marks.append(Mark(began + 1e-3 + float(np.hypot(*step)) / speed_m_s, x_m, y_m, yaw_deg))
    return Actor(walking_figure(Clothes(colour)), tuple(marks), cue_m)

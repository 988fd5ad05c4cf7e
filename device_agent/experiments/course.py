"""What is in the way in Experiment 2: standing, low, overhanging, of glass, a drop, and people, on each of the paths.

Where things are is fixed for each path, as it was for the paper's people; when the people come depends on the seed.
Beside what stands there is room for a person; people who walk give way (:mod:`device_agent.simulation.courtesy`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from device_agent.simulation import furniture
from device_agent.simulation.building import Building, Mover
from device_agent.simulation.obstacles import carton, hanging_box, low_box, walking_person
from device_agent.simulation.openings import with_hole
from device_agent.simulation.shapes import GLASS, Piece, box

_LATEST_S = 20.0
_PAUSE_S = 8.0
"""People who have walked their way stand for a while before they come back: nobody paces before somebody's feet."""


@dataclass(frozen=True, slots=True)
class Course:
    """Things on one path."""

    pieces: tuple[Piece, ...] = ()
    people: tuple[Mover, ...] = ()
    hole_m: tuple[float, float, float, float] | None = None
    """A hatch left open: x0, y0, x1, y1."""


def glass_screen(x_m: float, y_m: float, yaw_deg: float = 0.0, width_m: float = 0.9) -> Piece:
    """A pane that stands in the way: depth camera and eye look through it, the ultrasonic rangefinder does not."""
    return box((width_m, 0.02, 2.0), GLASS, name="glass screen").moved(x_m, y_m, yaw_deg)


COURSES = {
    "A→B": Course(
        (carton(12.2, 5.75, 20.0), hanging_box(9.4, 6.5)),
        (walking_person(((6.15, 8.3), (7.85, 8.3)), 0.8, pause_s=_PAUSE_S),),
    ),
    "D→C": Course(
        (low_box(21.0, 14.35), glass_screen(22.55, 11.9), furniture.chair().moved(24.9, 10.75, 30.0)),
        (walking_person(((23.75, 8.0), (23.75, 13.2)), 0.9, colour="#3c6e4a", pause_s=_PAUSE_S),),
    ),
    "E→B": Course(
        (low_box(7.35, 11.6, 15.0), carton(6.7, 13.6, 10.0)),
        (walking_person(((8.2, 14.75), (12.8, 14.75)), 1.0, colour="#4a4f8a", pause_s=_PAUSE_S),),
        (9.0, 12.95, 9.7, 13.65),
    ),
}


def with_course(building: Building, path: str) -> Building:
    """Return the building with what is in the way on a path; the people still all begin at once."""
    course = COURSES[path]
    changed = building.with_pieces(*course.pieces)
    if course.hole_m is not None:
        changed = with_hole(changed, course.hole_m)
    return replace(changed, movers=(*building.movers, *course.people))


def with_people_starting(building: Building, seed: int) -> Building:
    """Let the people begin at times drawn from the seed; what is drawn of the building stays the same."""
    rng = np.random.default_rng([seed, 41])
    movers = tuple(
        replace(mover, start_s=float(rng.uniform(0.0, _LATEST_S))) if isinstance(mover, Mover) else mover
        for mover in building.movers
    )
    return replace(building, movers=movers)

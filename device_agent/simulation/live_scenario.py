"""A scenario for the live simulation, where nobody knows beforehand which way the walker will take.

People stroll along the ways, to and fro; the dark stretch is one of the recorded walk; time counts from the start.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace

import numpy as np

from device_agent.simulation.building import Building, Mover, Start, push_from_solids, touchable
from device_agent.simulation.conditions import EASY, Conditions, conditions_of
from device_agent.simulation.people import STRIDE_M, WARDROBE, walking_figure
from device_agent.simulation.refurnishing import refurnished
from device_agent.simulation.routes import kidnapped_route
from device_agent.simulation.scenario import ORDINARY, Scenario
from device_agent.simulation.walk import plan_walk
from navcore.geometry import FloatArray

PEOPLE_PER_SHARE = 20.0
"""In a building with 80 m of ways, so many people are seen about all the time."""
_STROLL_LEGS = (2, 5)
_BESIDE_M = 0.6
_CLEAR_M = 0.27
_ATTEMPTS = 200


@dataclass(frozen=True, slots=True, eq=False)
class LiveStage:
    """A building under a scenario, for :class:`world.SimulatedWorld`."""

    building: Building
    start: Start
    conditions: Conditions = EASY


def live_stage(building: Building, start: Start, scenario: Scenario = ORDINARY, seed: int = 0) -> LiveStage:
    """Return what the walker will meet. The same seed gives the same. Raises InputError where nothing is free."""
    if scenario == ORDINARY:
        return LiveStage(building, start)
    if scenario.changed_furniture_share > 0.0:
        building = refurnished(building, scenario.changed_furniture_share, seed)
    if scenario.kidnapped:
        route, heading_rad = kidnapped_route(building, building.road_waypoints, seed)
        start = Start(*route[0], heading_rad)
    if scenario.people_share > 0.0:
        people = strollers(building, math.ceil(PEOPLE_PER_SHARE * scenario.people_share), seed)
        building = replace(building, movers=(*building.movers, *people))
    walked = plan_walk(building.road_waypoints, seed).position_m
    return LiveStage(building, start, conditions_of(scenario, walked))


def strollers(building: Building, count: int, seed: int) -> tuple[Mover, ...]:
    """Return people who walk to and fro beside the road, at most so many; they do not step aside."""
    rng = np.random.default_rng([seed, 23])
    solids = touchable(building.solids)
    found: list[Mover] = []
    for _ in range(_ATTEMPTS):
        if len(found) >= count:
            break
        path = _beside(_part_of_road(building, rng), float(rng.choice([-1.0, 1.0])) * _BESIDE_M)
        spots = np.concatenate([np.linspace(a, b, 20) for a, b in itertools.pairwise(path)])
        if all(push_from_solids(solids, float(x), float(y))[0] > _CLEAR_M for x, y in spots):
            figure = walking_figure(WARDROBE[len(found) % len(WARDROBE)])
            corners = tuple((float(x), float(y)) for x, y in path)
            found.append(Mover(figure, corners, float(rng.uniform(0.7, 1.2)), stride_m=STRIDE_M))
    return tuple(found)


def _part_of_road(building: Building, rng: np.random.Generator) -> FloatArray:
    """Return some corners (n, 2) of the road, in order, up to where it comes straight back."""
    corners = np.asarray(building.road_waypoints, np.float64)
    first = int(rng.integers(len(corners) - 1))
    part = corners[first : first + int(rng.integers(*_STROLL_LEGS, endpoint=True))]
    for k in range(2, len(part)):
        into, out = part[k - 1] - part[k - 2], part[k] - part[k - 1]
        if into @ out < -0.5 * math.hypot(*into) * math.hypot(*out):
            return part[:k]
    return part if len(part) > 1 else corners[first : first + 2]


def _beside(corners_m: FloatArray, side_m: float) -> FloatArray:
    """Return a polyline (n, 2) beside another; positive is to the left."""
    steps = np.diff(corners_m, axis=0)
    normals = np.stack([-steps[:, 1], steps[:, 0]], axis=1) / np.hypot(*steps.T)[:, None]
    before, after = np.concatenate([normals[:1], normals]), np.concatenate([normals, normals[-1:]])
    # At a corner both sides' lines meet.
    shift = (before + after) / (1.0 + (before * after).sum(axis=1))[:, None]
    beside: FloatArray = corners_m + side_m * shift
    return beside

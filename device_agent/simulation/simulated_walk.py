"""A walk through a building with the camera, frame by frame, under a scenario: for maps, and for walks in them.

    for frame, world_from_camera in simulated_walk(office_floor(), seed=3, scenario=Scenario(kidnapped=True)):
        ...

The same arguments give the same bytes.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from device_agent.simulation.building import Building, renderer_of
from device_agent.simulation.conditions import Conditions, captured, conditions_of, covered_fisheye
from device_agent.simulation.fisheye_sensor import FisheyeModel
from device_agent.simulation.passers_by import WalkerTrack, passers_by
from device_agent.simulation.refurnishing import refurnished
from device_agent.simulation.renderer import Renderer
from device_agent.simulation.routes import Waypoints, kidnapped_route
from device_agent.simulation.scenario import ORDINARY, Scenario
from device_agent.simulation.sensors import CameraModel, head_camera
from device_agent.simulation.walk import CAREFUL_WALK, STEP_S, WalkPlan, head_trajectory, plan_walk
from navcore.errors import InputError
from navcore.geometry import FloatArray, Transform
from navcore.types import FisheyeCamera, Frame


@dataclass(frozen=True, slots=True, eq=False)
class Shot:
    """A frame with what only the simulation knows of it."""

    frame: Frame
    world_from_camera: Transform
    people_share: float
    """Share of the picture that shows people, 0–1; before anything covers the camera."""


@dataclass(frozen=True, slots=True, eq=False)
class StagedWalk:
    """A walk that has been prepared: the building as it is then, and what happens on the way."""

    building: Building
    stamp_s: FloatArray
    """Of the frames (n,)."""
    position_m: FloatArray
    """Of the body at each frame (n, 2)."""
    heads: tuple[Transform, ...]
    """``world_from_camera`` of each frame."""
    yaw_rate_rad_s: FloatArray
    conditions: Conditions

    def __len__(self) -> int:
        return len(self.stamp_s)

    @property
    def length_m(self) -> float:
        """Length of the walk."""
        return float(np.hypot(*np.diff(self.position_m, axis=0).T).sum())


def staged_walk(
    building: Building,
    waypoints_m: Waypoints | None = None,
    seed: int = 0,
    scenario: Scenario = ORDINARY,
    *,
    rate_hz: float = 10.0,
    max_length_m: float = math.inf,
) -> StagedWalk:
    """Prepare a walk along way points (the building's recorded walk where None) under a scenario.

    Raises InputError where the scenario cannot be arranged in the building.
    """
    if scenario.changed_furniture_share > 0.0:
        building = refurnished(building, scenario.changed_furniture_share, seed)
    route = building.road_waypoints if waypoints_m is None else waypoints_m
    heading_rad: float | None = None
    if scenario.kidnapped:
        route, heading_rad = kidnapped_route(building, route, seed)
    plan = plan_walk(route, seed, CAREFUL_WALK, heading_rad)
    track, yaw_rate_rad_s = _track(plan, rate_hz, max_length_m)
    if scenario.people_share > 0.0:
        people = passers_by(building, track, scenario.people_share, seed)
        building = replace(building, movers=(*building.movers, *people))
    return StagedWalk(
        building, track.stamp_s, track.position_m, track.heads, yaw_rate_rad_s, conditions_of(scenario, plan.position_m)
    )


def _track(plan: WalkPlan, rate_hz: float, max_length_m: float) -> tuple[WalkerTrack, FloatArray]:
    """Return the walk at the frames up to a length, and the head's yaw rate (n,) at each."""
    travelled = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(plan.position_m, axis=0).T))])
    yaw_rates_rad_s = np.gradient(plan.heading_rad, STEP_S)
    poses = head_trajectory(plan, rate_hz)
    samples = np.array([min(len(travelled) - 1, round(stamp_s / STEP_S)) for stamp_s, _ in poses])
    samples = samples[travelled[samples] <= max_length_m]
    poses = poses[: len(samples)]
    stamps = np.array([stamp_s for stamp_s, _ in poses])
    track = WalkerTrack(stamps, plan.position_m[samples], tuple(pose for _, pose in poses))
    return track, yaw_rates_rad_s[samples]


def shots(
    staged: StagedWalk,
    seed: int,
    size_px: tuple[int, int] = (320, 240),
    renderer: Renderer | None = None,
    fisheye: FisheyeCamera | None = None,
) -> Iterator[Shot]:
    """Take the frames of a prepared walk.

    ``renderer`` is one of the same building; its movers do not matter. ``fisheye`` is a second camera on the glasses.
    Raises InputError for a fisheye camera in the dark, which is not simulated.
    """
    if fisheye is not None and staged.conditions.darkness is not None:
        raise InputError("The fisheye camera is not simulated in the dark: leave one of them out.")
    building = staged.building
    drawing = renderer_of(building) if renderer is None else renderer.with_movers(building.mover_surfaces)
    model = CameraModel(head_camera(*size_px), seed)
    second = None if fisheye is None else FisheyeModel(fisheye, seed)
    for number, (stamp_s, pose) in enumerate(zip(staged.stamp_s.tolist(), staged.heads, strict=True)):
        placements, yaw_rate_rad_s = building.placements_at(stamp_s), float(staged.yaw_rate_rad_s[number])
        view = drawing.render(model.camera, pose, placements)
        frame = captured(model, view, pose, stamp_s, number, yaw_rate_rad_s, stamp_s, staged.conditions)
        if second is not None:
            picture = second.capture(drawing, pose, stamp_s, number, placements, yaw_rate_rad_s)
            frame = replace(frame, fisheye=covered_fisheye(picture) if staged.conditions.covers(stamp_s) else picture)
        yield Shot(frame, pose, view.moving_share)


def simulated_walk(
    building: Building,
    waypoints_m: Waypoints | None = None,
    seed: int = 0,
    scenario: Scenario = ORDINARY,
    *,
    rate_hz: float = 10.0,
    size_px: tuple[int, int] = (320, 240),
    max_length_m: float = math.inf,
    renderer: Renderer | None = None,
    fisheye: FisheyeCamera | None = None,
) -> Iterator[tuple[Frame, Transform]]:
    """Walk along way points (the recorded walk's where None) and yield each frame with the true ``world_from_camera``.

    ``max_length_m`` ends the walk early. ``renderer`` is one of the same building, for building one takes seconds; it
    is not used where the scenario changes the furniture.
    """
    staged = staged_walk(building, waypoints_m, seed, scenario, rate_hz=rate_hz, max_length_m=max_length_m)
    usable = None if scenario.changed_furniture_share > 0.0 else renderer
    for shot in shots(staged, seed, size_px, usable, fisheye):
        yield shot.frame, shot.world_from_camera

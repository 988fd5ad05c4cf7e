"""A small closed loop: boxes on a floor, seen by ray casting, walked by the walker model, led by the real guidance.

Depth is computed ray by ray against the boxes and the floor; the walker hears cues and nothing else.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from device_agent.simulation.building import Solid, touchable
from device_agent.simulation.walker import WalkerBody, WalkerParameters, hear, step
from navcore.compiled import kernel
from navcore.cues.memory import CueMemory
from navcore.cues.speech import cues_for
from navcore.cues.table import Cue
from navcore.geometry import world_from_camera_at
from navcore.guide import guide
from navcore.obstacle.scan import scan
from navcore.planning.projection import arc_lengths_m
from navcore.planning.road_joining import evenly_spaced
from navcore.settings import Settings
from navcore.types import (
    Action,
    CameraIntrinsics,
    Guidance,
    Localization,
    LocalizationQuality,
    Reason,
    Route,
    RouteStop,
    SonarReading,
    SonarState,
)

EYE_M, PITCH_RAD = 1.6, math.radians(15.0)
CAMERA = CameraIntrinsics(160, 120, 116.4, 116.4, 79.5, 59.5)
_FRAME_S, _STEP_S, _LATENCY_S = 0.1, 0.02, 0.04
NOTHING = touchable(())


def box(x0: float, y0: float, x1: float, y1: float, high_m: float = 2.5, low_m: float = 0.0) -> Solid:
    """Return a box between two corners on the floor."""
    return Solid(
        name="box",
        x_m=(x0 + x1) / 2, y_m=(y0 + y1) / 2, half_x_m=(x1 - x0) / 2, half_y_m=(y1 - y0) / 2, yaw_rad=0.0,
        low_m=low_m, high_m=high_m,
    )  # fmt: skip


def route_along(*corners_m: tuple[float, float], name: str = "Room") -> Route:
    """Return a route through corners, 0.1 m between its points."""
    points = evenly_spaced(np.array(corners_m, dtype=np.float64), 0.1)
    arcs = arc_lengths_m(points)
    return Route(points, arcs, (RouteStop("goal", name, float(arcs[-1])),))


@kernel
def _cast(low: np.ndarray, high: np.ndarray, origin: np.ndarray, rays: np.ndarray, nearest: np.ndarray) -> None:
    for i in range(rays.shape[0]):
        nearest[i] = -origin[2] / rays[i, 2] if rays[i, 2] < 0.0 else np.inf
        for k in range(low.shape[0]):
            enter, leave = -np.inf, np.inf
            for axis in range(3):
                ray = rays[i, axis] if rays[i, axis] != 0.0 else 1e-12
                first, second = (low[k, axis] - origin[axis]) / ray, (high[k, axis] - origin[axis]) / ray
                enter, leave = max(enter, min(first, second)), min(leave, max(first, second))
            if leave >= enter and leave > 0.0:
                nearest[i] = min(nearest[i], max(enter, 1e-3))


def cast(solids: tuple[Solid, ...], origin: np.ndarray, rays: np.ndarray) -> np.ndarray:
    """Return for each ray (n, 3) the multiple of it at which it meets the floor or a box, else inf."""
    table = np.array([(s.x_m, s.y_m, s.half_x_m, s.half_y_m, s.low_m, s.high_m) for s in solids]).reshape(-1, 6)
    low = np.column_stack([table[:, :2] - table[:, 2:4], table[:, 4]])
    high = np.column_stack([table[:, :2] + table[:, 2:4], table[:, 5]])
    nearest = np.empty(len(rays))
    _cast(low, high, np.array(origin, dtype=np.float64), np.ascontiguousarray(rays), nearest)
    return nearest


def depth_image(solids: tuple[Solid, ...], world_from_camera, rng: np.random.Generator | None = None) -> np.ndarray:
    """Return the depth image (h, w) with the noise of a structured-light sensor; NaN beyond its range."""
    rows, cols = np.mgrid[0 : CAMERA.height_px, 0 : CAMERA.width_px]
    rays = np.stack(
        [(cols - CAMERA.cx_px) / CAMERA.fx_px, (rows - CAMERA.cy_px) / CAMERA.fy_px, np.ones(rows.shape)], axis=-1
    ).reshape(-1, 3)
    depth = cast(solids, world_from_camera.translation, rays @ world_from_camera.rotation.T)
    if rng is not None:
        depth = depth + rng.standard_normal(depth.shape) * 0.0017 * np.minimum(depth, 10.0) ** 2
        depth[rng.random(depth.shape) < 0.01] = np.nan
    depth[(depth < 0.3) | (depth > 8.0)] = np.nan
    return depth.reshape(rows.shape).astype(np.float32)


def sonar_reading(solids: tuple[Solid, ...], body: WalkerBody, stamp_s: float) -> SonarReading:
    """Return the nearest echo within ±7.5°, level; everything reflects."""
    angles = body.heading_rad + np.radians(np.linspace(-7.5, 7.5, 7))
    rays = np.stack([np.cos(angles), np.sin(angles), np.zeros(7)], axis=1)
    nearest = float(cast(solids, np.array([body.x_m, body.y_m, 1.0]), rays).min())
    if nearest > 4.25:
        return SonarReading(stamp_s, SonarState.NO_ECHO)
    return SonarReading(stamp_s, SonarState.OK, nearest)


@dataclass(slots=True)
class Walk:
    """What happened."""

    arrived: bool = False
    contacts: int = 0
    seconds: float = 0.0
    trail: list[tuple[float, float]] = field(default_factory=list)
    guidance: list[Guidance] = field(default_factory=list)
    cues: list[Cue] = field(default_factory=list)

    def deviations_m(self, route: Route) -> np.ndarray:
        """Distance of each place of the trail from the route."""
        offsets = np.array(self.trail)[:, None, :] - route.points_m[None]
        return np.hypot(offsets[..., 0], offsets[..., 1]).min(axis=1)


def walk(
    solids: tuple[Solid, ...],
    route: Route,
    start: tuple[float, float, float],
    *,
    seed: int = 0,
    walker: WalkerParameters | None = None,
    settings: Settings | None = None,
    limit_s: float = 90.0,
    planned: Callable[[Localization, Guidance | None], tuple[Route, int]] | None = None,
) -> Walk:
    """Lead a walker from a place (x, y, heading in degrees) along a route until they arrive or the time is over.

    ``planned`` is asked for the route and its version before each frame, where they may change.
    """
    rng = np.random.default_rng(seed)
    walker = walker or WalkerParameters(veer_bias_deg_per_m=float(rng.normal(0, 0.5)))
    settings = settings or Settings()
    body = WalkerBody(0.0, start[0], start[1], math.radians(start[2]))
    touch, result = touchable(solids), Walk()
    guidance: Guidance | None = None
    memory, pending, version = CueMemory(), [], 1
    while body.time_s < limit_s:
        now_s = body.time_s
        phase = math.tau * 1.8 * now_s
        bob = 0.02 * math.sin(phase) if body.speed_mps > 0.2 else 0.0
        pitch = PITCH_RAD + math.radians(1.0) * math.sin(phase) * (body.speed_mps > 0.2)
        camera = world_from_camera_at((body.x_m, body.y_m, EYE_M + bob), body.heading_rad, pitch)
        noise = rng.standard_normal(4) * (0.03, 0.03, 0.01, math.radians(0.7))
        believed = world_from_camera_at(
            (body.x_m + noise[0], body.y_m + noise[1], EYE_M + bob + noise[2]), body.heading_rad + noise[3], pitch
        )
        seen = scan(depth_image(solids, camera, rng), CAMERA, believed, settings.obstacle)
        located = Localization(now_s, LocalizationQuality.LOCALIZED, believed)
        if planned is not None:
            route, version = planned(located, guidance)
        guidance = guide(
            now_s, located, route, seen, sonar_reading(solids, body, now_s), guidance, settings, route_version=version
        )
        cues, memory = cues_for(guidance, memory, route, settings, now_s)
        pending += [(now_s + _LATENCY_S, cue) for cue in cues]
        result.guidance.append(guidance)
        result.cues += cues
        result.trail.append((body.x_m, body.y_m))
        for _ in range(round(_FRAME_S / _STEP_S)):
            for _, cue in [entry for entry in pending if entry[0] <= body.time_s]:
                body = hear(body, cue, walker, rng)
            pending = [entry for entry in pending if entry[0] > body.time_s]
            body = step(body, walker, touch, NOTHING, _STEP_S, rng)
        if guidance.reason is Reason.ARRIVED and guidance.action is Action.STOP and body.speed_mps == 0.0:
            result.arrived = True
            break
    result.contacts, result.seconds = body.contacts, body.time_s
    return result

"""A small closed loop: boxes on a floor, seen by ray casting, walked by the walker model, led by the real guidance.

Depth is computed ray by ray against the boxes and the floor; the walker hears cues and nothing else.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from device_agent.simulation.building import Building, Moving, Solid, Start, touchable
from device_agent.simulation.walker import WalkerBody, WalkerParameters, hear, step
from device_agent.simulation.world import SimulatedWorld
from navcore.compiled import kernel
from navcore.cues.memory import CueMemory
from navcore.cues.speech import cues_for
from navcore.cues.table import Cue
from navcore.follower.gate import echo_distance_m
from navcore.geometry import Transform, rotation_about_z, world_from_camera_at
from navcore.guide import guide
from navcore.obstacle.memory import ObstacleMemory, remember, remember_heard, with_memory
from navcore.obstacle.scan import scan
from navcore.planning.projection import arc_lengths_m
from navcore.planning.road_joining import evenly_spaced
from navcore.settings import Settings
from navcore.types import (
    Action,
    CameraIntrinsics,
    Frame,
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
_ROWS, _COLS = np.mgrid[0 : CAMERA.height_px, 0 : CAMERA.width_px]
_RAYS = np.stack(
    [(_COLS - CAMERA.cx_px) / CAMERA.fx_px, (_ROWS - CAMERA.cy_px) / CAMERA.fy_px, np.ones(_ROWS.shape)], axis=-1
).reshape(-1, 3)


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
def _cast(boxes: np.ndarray, origin: np.ndarray, rays: np.ndarray, nearest: np.ndarray) -> None:
    """``boxes`` (k, 8): middle, half lengths, cosine and sine of the yaw, lower and upper end."""
    for i in range(rays.shape[0]):
        nearest[i] = -origin[2] / rays[i, 2] if rays[i, 2] < 0.0 else np.inf
    for k in range(boxes.shape[0]):
        c, s = boxes[k, 4], boxes[k, 5]
        off_x, off_y = origin[0] - boxes[k, 0], origin[1] - boxes[k, 1]
        start_x, start_y = c * off_x + s * off_y, c * off_y - s * off_x
        for i in range(rays.shape[0]):
            along_x, along_y = c * rays[i, 0] + s * rays[i, 1], c * rays[i, 1] - s * rays[i, 0]
            enter, leave = -np.inf, np.inf
            for axis in range(3):
                if axis == 0:
                    ray, low, high = along_x, -boxes[k, 2] - start_x, boxes[k, 2] - start_x
                elif axis == 1:
                    ray, low, high = along_y, -boxes[k, 3] - start_y, boxes[k, 3] - start_y
                else:
                    ray, low, high = rays[i, 2], boxes[k, 6] - origin[2], boxes[k, 7] - origin[2]
                ray = ray if ray != 0.0 else 1e-12
                enter, leave = max(enter, min(low / ray, high / ray)), min(leave, max(low / ray, high / ray))
            if leave >= enter and leave > 0.0:
                nearest[i] = min(nearest[i], max(enter, 1e-3))


def cast(solids: tuple[Solid, ...], origin: np.ndarray, rays: np.ndarray) -> np.ndarray:
    """Return for each ray (n, 3) the multiple of it at which it meets the floor or a box, else inf."""
    table = np.array(
        [
            (s.x_m, s.y_m, s.half_x_m, s.half_y_m, math.cos(s.yaw_rad), math.sin(s.yaw_rad), s.low_m, s.high_m)
            for s in solids
        ]
    ).reshape(-1, 8)
    nearest = np.empty(len(rays))
    _cast(table, np.array(origin, dtype=np.float64), np.ascontiguousarray(rays), nearest)
    return nearest


def depth_image(solids: tuple[Solid, ...], world_from_camera, rng: np.random.Generator | None = None) -> np.ndarray:
    """Return the depth image (h, w) with the noise of a structured-light sensor; NaN beyond its range."""
    depth = cast(solids, world_from_camera.translation, _RAYS @ world_from_camera.rotation.T)
    if rng is not None:
        depth = depth + rng.standard_normal(depth.shape) * 0.0017 * np.minimum(depth, 10.0) ** 2
        depth[rng.random(depth.shape) < 0.01] = np.nan
    depth[(depth < 0.3) | (depth > 8.0)] = np.nan
    return depth.reshape(CAMERA.height_px, CAMERA.width_px).astype(np.float32)


def without_absorbed(depth: np.ndarray, solids: tuple[Solid, ...], world_from_camera) -> np.ndarray:
    """Return a depth image of solids with NaN where what is seen is one that absorbs."""
    reflecting = tuple(solid for solid in solids if solid.name != ABSORBING)
    if len(reflecting) == len(solids):
        return depth
    rays = _RAYS @ world_from_camera.rotation.T
    hidden = cast(solids, world_from_camera.translation, rays) < cast(reflecting, world_from_camera.translation, rays)
    depth[hidden.reshape(depth.shape)] = np.nan
    return depth


def with_pits(depth: np.ndarray, solids: tuple[Solid, ...], world_from_camera) -> np.ndarray:
    """Return a depth image that shows, in place of the floor where pits are, their bottom."""
    rays = _RAYS @ world_from_camera.rotation.T
    x_m, y_m, eye_m = world_from_camera.translation
    floor = np.where(rays[:, 2] < 0.0, -eye_m / np.minimum(rays[:, 2], -1e-9), np.inf).reshape(depth.shape)
    shows_floor = np.abs(depth / floor - 1.0) < 0.03
    for pit in (solid for solid in solids if solid.name == PIT):
        inside = np.abs(x_m + floor * rays[:, 0].reshape(depth.shape) - pit.x_m) < pit.half_x_m
        inside &= np.abs(y_m + floor * rays[:, 1].reshape(depth.shape) - pit.y_m) < pit.half_y_m
        depth = np.where(inside & shows_floor, depth * (eye_m + _PIT_M) / eye_m, depth)
    return depth.astype(np.float32)


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
    obstacles, heard = ObstacleMemory(), ObstacleMemory()
    while body.time_s < limit_s:
        now_s = body.time_s
        phase = math.tau * 1.8 * now_s
        bob = 0.02 * math.sin(phase) if body.speed_mps > 0.2 else 0.0
        pitch = PITCH_RAD + math.radians(1.0) * math.sin(phase) * (body.speed_mps > 0.2)
        camera = world_from_camera_at((body.x_m, body.y_m, EYE_M + bob), body.heading_rad, pitch)
        noise = rng.standard_normal(4) * (0.01, 0.01, 0.01, math.radians(0.4))
        believed = world_from_camera_at(
            (body.x_m + noise[0], body.y_m + noise[1], EYE_M + bob + noise[2]), body.heading_rad + noise[3], pitch
        )
        seen = scan(depth_image(solids, camera, rng), CAMERA, believed, settings.obstacle)
        located = Localization(now_s, LocalizationQuality.LOCALIZED, believed)
        sonar, pose = sonar_reading(solids, body, now_s), located.pose
        assert pose is not None
        obstacles = remember(obstacles, seen, pose, now_s)
        half_field_rad = math.radians(settings.gate.half_field_deg)
        heard = remember_heard(heard, seen, echo_distance_m(sonar), half_field_rad, pose, now_s)
        seen = with_memory(seen, obstacles.and_also(heard), pose, settings.obstacle)
        if planned is not None:
            route, version = planned(located, guidance)
        guidance = guide(now_s, located, route, seen, sonar, guidance, settings, route_version=version)
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


# ---------------------------------------------------------------------------------------------- the device in a loop
GLASS, ABSORBING, PIT = "glass", "absorbing", "pit"
"""Names of solids through which the depth camera looks, from which nothing comes back to it, and that are holes in the
floor: nobody hears them, and whoever steps on them touches them."""
_PIT_M = 0.8
"""Solids of this name are looked through, and heard."""
_BLACK = np.zeros((CAMERA.height_px, CAMERA.width_px, 3), np.uint8)


class BoxWorld(SimulatedWorld):
    """The simulated world with boxes in place of pictures: for the real device with all but its SLAM."""

    def __init__(
        self, solids: Sequence[Solid], movers: Sequence[Moving], walker: WalkerParameters, start: Start, seed: int
    ) -> None:
        building = Building("boxes", {}, (), tuple(solids), (), (), ((start.x_m, start.y_m),), tuple(movers))
        super().__init__(building, walker, start, seed, size_px=(CAMERA.width_px, CAMERA.height_px), renderer=object())
        self._noise = np.random.default_rng([seed, 3])

    def _around(self) -> tuple[Solid, ...]:
        return (*self.building.solids, *self.building.moving_solids(self._placements(self.now_s())))

    def capture(self) -> Frame:
        """Return what the depth camera sees now: it looks through glass, and nothing comes back from what absorbs."""
        head, seen = self._head(), tuple(solid for solid in self._around() if solid.name not in (GLASS, PIT))
        depth = with_pits(depth_image(seen, head, self._noise), self._around(), head)
        return Frame(self.now_s(), _BLACK, without_absorbed(depth, seen, head))

    def ping(self) -> SonarReading:
        """Return the nearest echo now; everything reflects."""
        heard = tuple(solid for solid in self._around() if solid.name != PIT)
        return sonar_reading(heard, self.truth(), self.now_s())


class NoisyTruth:
    """A localizer that knows the truth up to some centimetres, and for a while, where that is wanted, nothing."""

    def __init__(self, world: SimulatedWorld, seed: int) -> None:
        self._world, self._rng = world, np.random.default_rng([seed, 4])
        self.lost_s: tuple[float, float] | None = None
        """From when to when it is lost."""

    def locate(self, frame: Frame) -> Localization:
        """Return the pose."""
        if self.lost_s is not None and self.lost_s[0] <= frame.stamp_s < self.lost_s[1]:
            return Localization(frame.stamp_s, LocalizationQuality.LOST, None)
        head = self._world.true_head()
        noise = self._rng.standard_normal(4) * (0.03, 0.03, 0.01, math.radians(0.7))
        rotation = rotation_about_z(float(noise[3])) @ head.rotation
        believed = Transform.from_rotation_translation(rotation, head.translation + noise[:3])
        return Localization(frame.stamp_s, LocalizationQuality.LOCALIZED, believed, np.eye(6) * 1e-3, 200)

    def use_features(self, fraction: float) -> None:
        """The truth has no features."""

    def apply(self, settings: Settings) -> None:
        """There is nothing to set."""

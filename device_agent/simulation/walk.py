"""The sighted person's walk, from which the map and the virtual blind road are made.

They walk along the corridors at an easy pace, round corners in small arcs, and turn on the spot, slowly, where a room
or a corridor ends.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from device_agent.simulation.building import checked_seed
from device_agent.simulation.gait import USUAL_GAIT, USUAL_MOUNT, Gait, HeadMount, advance_phase, head_pose
from navcore.angles import wrap_rad
from navcore.errors import InputError
from navcore.geometry import FloatArray, Transform

_STEP_M = 0.01
STEP_S = 0.01


@dataclass(frozen=True, slots=True)
class WalkStyle:
    """How the sighted person walks while recording."""

    speed_mps: float = 0.9
    """Below the comfortable 1.2–1.4 m/s (R. Bohannon, Age and Ageing 26, 1997): they record with care."""
    acceleration_mps2: float = 0.6
    corner_radius_m: float = 0.6
    turn_rate_rad_s: float = math.radians(44.0)
    """Limit on the spot and round corners, so that pictures are sharp and overlap."""
    turn_acceleration_rad_s2: float = 1.5
    wander_m: float = 0.03
    """Nobody walks a straight line: standard deviation to the side."""
    stand_s: float = 1.0
    """Standing still at the beginning and at the end."""


CAREFUL_WALK = WalkStyle()


@dataclass(frozen=True, slots=True, eq=False)
class WalkPlan:
    """A walk as dense samples, ``STEP_S`` apart: stamps (n,), positions (n, 2), headings (n,) and speeds (n,).

    Headings have no jumps.
    """

    stamp_s: FloatArray
    position_m: FloatArray
    heading_rad: FloatArray
    speed_mps: FloatArray

    @property
    def length_m(self) -> float:
        """Length of the whole walk."""
        return float(np.hypot(*np.diff(self.position_m, axis=0).T).sum())

    @property
    def duration_s(self) -> float:
        """Time that it takes."""
        return float(self.stamp_s[-1])


def plan_walk(
    waypoints_m: tuple[tuple[float, float], ...],
    seed: int,
    style: WalkStyle = CAREFUL_WALK,
    start_heading_rad: float | None = None,
) -> WalkPlan:
    """Plan the walk through way points; it ends facing as it set off.

    Before it sets off, the person stands facing ``start_heading_rad``; without one, the way they will go. Raises
    InputError for fewer than two way points.
    """
    if len(waypoints_m) < 2:
        raise InputError("A walk needs at least two way points: name where it leads.")
    rng = np.random.default_rng([checked_seed(seed), 4])
    legs = [_walk_leg(np.asarray(leg, np.float64), rng, style) for leg in _legs(waypoints_m)]
    first_heading = legs[0][0, 2]
    facing = np.array([*legs[0][0, :2], first_heading if start_heading_rad is None else start_heading_rad])
    pieces = [_standing(facing, style.stand_s)]
    if start_heading_rad is not None:
        pieces.append(_turning(facing, wrap_rad(float(first_heading - start_heading_rad)), style))
    for leg, following in zip(legs, [*legs[1:], None], strict=True):
        pieces.append(leg)
        end_heading = first_heading if following is None else following[0, 2]
        turn_rad = wrap_rad(float(end_heading - leg[-1, 2]))
        if abs(turn_rad) > 3.0 and rng.random() < 0.5:
            turn_rad -= math.copysign(math.tau, turn_rad)
        pieces.append(_turning(leg[-1, :3], turn_rad, style))
    pieces.append(_standing(pieces[-1][-1, :3], style.stand_s))
    samples = np.concatenate(pieces)
    stamps: FloatArray = STEP_S * np.arange(len(samples), dtype=np.float64)
    return WalkPlan(stamps, samples[:, :2], np.unwrap(samples[:, 2]), samples[:, 3])


def _legs(waypoints_m: tuple[tuple[float, float], ...]) -> list[list[tuple[float, float]]]:
    """Cut the walk where it comes straight back."""
    legs = [[waypoints_m[0], waypoints_m[1]]]
    for point in waypoints_m[2:]:
        (ax, ay), (bx, by) = legs[-1][-2:]
        turn = wrap_rad(math.atan2(point[1] - by, point[0] - bx) - math.atan2(by - ay, bx - ax))
        if abs(turn) > math.radians(150):
            legs.append([(bx, by)])
        legs[-1].append(point)
    return legs


def _walk_leg(corners_m: FloatArray, rng: np.random.Generator, style: WalkStyle) -> FloatArray:
    """Return samples (n, 4) of x, y, heading, speed along one leg, from standing to standing."""
    points = _rounded(corners_m, style.corner_radius_m)
    arc = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    grid = np.arange(0.0, arc[-1], _STEP_M)
    path = np.stack([np.interp(grid, arc, points[:, k]) for k in range(2)], axis=1)
    tangent = np.gradient(path, axis=0)
    normal = np.stack([-tangent[:, 1], tangent[:, 0]], axis=1) / np.hypot(*tangent.T)[:, None]
    path = path + _wander(grid, rng, style)[:, None] * normal
    tangent = np.gradient(path, axis=0)
    heading = ndimage.gaussian_filter1d(np.unwrap(np.arctan2(tangent[:, 1], tangent[:, 0])), 8.0, mode="nearest")
    bend_rad_m = ndimage.maximum_filter1d(np.abs(np.gradient(heading)) / _STEP_M, 9)
    limit = np.minimum(style.speed_mps, style.turn_rate_rad_s / np.maximum(bend_rad_m, 1e-3))
    speed = _reachable_speed(limit, style.acceleration_mps2)
    time = np.concatenate([[0.0], np.cumsum(_STEP_M / np.maximum(0.5 * (speed[1:] + speed[:-1]), 0.02))])
    stamps = np.arange(0.0, time[-1], STEP_S)
    columns = (path[:, 0], path[:, 1], heading, speed)
    return np.stack([np.interp(stamps, time, column) for column in columns], axis=1)


def _rounded(corners_m: FloatArray, radius_m: float) -> FloatArray:
    """Return points (n, 2) of a polyline with its corners replaced by arcs."""
    points: list[FloatArray] = [corners_m[0]]
    for before, corner, after in zip(corners_m, corners_m[1:], corners_m[2:], strict=False):
        into, out = corner - before, after - corner
        into, out = into / np.linalg.norm(into), out / np.linalg.norm(out)
        turn = wrap_rad(math.atan2(out[1], out[0]) - math.atan2(into[1], into[0]))
        if abs(turn) < 1e-6:
            continue
        reach = radius_m * math.tan(abs(turn) / 2)
        centre = corner - reach * into + radius_m * math.copysign(1.0, turn) * np.array([-into[1], into[0]])
        start = corner - reach * into - centre
        for share in np.linspace(0.0, 1.0, 100):
            c, s = math.cos(share * turn), math.sin(share * turn)
            points.append(centre + np.array([c * start[0] - s * start[1], s * start[0] + c * start[1]]))
    points.append(corners_m[-1])
    return np.array(points)


def _wander(grid_m: FloatArray, rng: np.random.Generator, style: WalkStyle) -> FloatArray:
    """Return a smooth random offset (n,), zero at both ends."""
    knots = np.arange(0.0, grid_m[-1] + 2.0, 1.5)
    values = rng.normal(0.0, style.wander_m, len(knots))
    share = np.interp(grid_m, knots, np.arange(len(knots)))
    lower = np.minimum(share.astype(int), len(knots) - 2)
    blend = 0.5 - 0.5 * np.cos(np.pi * (share - lower))
    taper = np.clip(np.minimum(grid_m, grid_m[-1] - grid_m), 0.0, 1.0)
    return np.asarray(((1 - blend) * values[lower] + blend * values[lower + 1]) * taper)


def _reachable_speed(limit_mps: FloatArray, acceleration_mps2: float) -> FloatArray:
    """Lower a speed limit (n,), ``_STEP_M`` apart, to what can be reached from and to standing."""
    speed = limit_mps.copy()
    speed[0] = speed[-1] = 0.0
    gain = 2 * acceleration_mps2 * _STEP_M
    for k in range(1, len(speed)):
        speed[k] = min(speed[k], math.sqrt(speed[k - 1] ** 2 + gain))
    for k in range(len(speed) - 2, -1, -1):
        speed[k] = min(speed[k], math.sqrt(speed[k + 1] ** 2 + gain))
    return speed


def _turning(state: FloatArray, turn_rad: float, style: WalkStyle) -> FloatArray:
    """Return samples (n, 4) of a turn on the spot, faster in the middle."""
    rate, gain = style.turn_rate_rad_s, style.turn_acceleration_rad_s2
    size = abs(turn_rad)
    ramp_s = min(rate / gain, math.sqrt(size / gain)) if size > 0 else 0.0
    peak = gain * ramp_s
    flat_s = max(0.0, (size - peak * ramp_s) / rate) if size > 0 else 0.0
    stamps = np.arange(0.0, 2 * ramp_s + flat_s + STEP_S, STEP_S)
    rates = np.clip(np.minimum(stamps, 2 * ramp_s + flat_s - stamps) * gain, 0.0, peak)
    share = np.concatenate([[0.0], np.cumsum(0.5 * (rates[1:] + rates[:-1]))])
    share = share / share[-1] if share[-1] > 0 else share
    samples = np.zeros((len(stamps), 4))
    samples[:, :2] = state[:2]
    samples[:, 2] = state[2] + turn_rad * share
    return samples


def _standing(state: FloatArray, duration_s: float) -> FloatArray:
    samples = np.zeros((max(1, round(duration_s / STEP_S)), 4))
    samples[:, :3] = state
    return samples


def head_trajectory(
    plan: WalkPlan, rate_hz: float, gait: Gait = USUAL_GAIT, mount: HeadMount = USUAL_MOUNT
) -> list[tuple[float, Transform]]:
    """Return the stamps of the captures at a frame rate, and ``world_from_camera`` at each."""
    if not 0.5 <= rate_hz <= 1.0 / STEP_S:
        raise InputError(f"A camera cannot run at {rate_hz:g} Hz here: choose 0.5 to {1 / STEP_S:g} Hz.")
    phases = np.zeros(len(plan.stamp_s))
    for k in range(1, len(phases)):
        phases[k] = advance_phase(phases[k - 1], float(plan.speed_mps[k]), STEP_S, gait)
    poses = []
    for number in range(int(plan.duration_s * rate_hz) + 1):
        k = min(len(phases) - 1, round(number / rate_hz / STEP_S))
        x_m, y_m = plan.position_m[k]
        heading, speed = float(plan.heading_rad[k]), float(plan.speed_mps[k])
        pose = head_pose(float(x_m), float(y_m), heading, float(plan.stamp_s[k]), float(phases[k]), speed, gait, mount)
        poses.append((float(plan.stamp_s[k]), pose))
    return poses

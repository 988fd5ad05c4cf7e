"""The ultrasonic rangefinder: the nearest echo within its cone.

Range 0.03–4.25 m and a field of 15° are the paper's (III, IV-C). That smooth surfaces met at a grazing angle send the
sound away, so that they are not heard, is J. Leonard and H. Durrant-Whyte, "Directed Sonar Sensing for Mobile Robot
Navigation" (1992); in a building's walls it happens already at smaller angles than the 60° taken here.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from device_agent.simulation.renderer import Placement
from device_agent.simulation.scene import RayScene, rays_from, surface_arrays
from device_agent.simulation.shading import F32
from device_agent.simulation.shapes import Surface
from navcore.geometry import FloatArray, Transform, rotation_about_z
from navcore.types import SonarReading, SonarState


@dataclass(frozen=True, slots=True)
class SonarNoise:
    """Parameters of the rangefinder."""

    cone_deg: float = 15.0
    """Full angle of the cone (paper, Eq. 5: ±7.5°)."""
    min_m: float = 0.03
    max_m: float = 4.25
    sigma_m: float = 0.01
    """Usual ranging modules resolve 1 cm."""
    grazing_deg: float = 60.0
    """Surfaces met at a larger angle from their normal reflect the sound away."""
    dropout: float = 0.01
    """Share of readings without an echo though there was one."""
    ray_count: int = 40


USUAL_SONAR_NOISE = SonarNoise()


class SonarModel:
    """Measures in one building; glass reflects sound. The same seed and number give the same reading."""

    def __init__(
        self,
        surfaces: Sequence[Surface],
        movers: Sequence[Sequence[Sequence[Surface]]] = (),
        seed: int = 0,
        noise: SonarNoise = USUAL_SONAR_NOISE,
    ) -> None:
        self._noise = noise
        self._seed = seed
        self._walls = _Reflectors(surfaces)
        # The legs are seldom in the cone: one pose does for all.
        self._movers = tuple(_Reflectors(poses[0]) for poses in movers)
        self._cone = _cone_directions(noise)

    def measure(
        self, stamp_s: float, world_from_sonar: Transform, number: int, placements: Sequence[Placement | None] = ()
    ) -> SonarReading:
        """Return one reading. The sonar looks along the z axis of its frame, as a camera does."""
        rng = np.random.default_rng([self._seed, 5, number])
        nearest = self._first_echo(world_from_sonar, placements)
        error_m, luck = self._noise.sigma_m * float(rng.standard_normal()), float(rng.random())
        distance_m = max(self._noise.min_m, nearest + error_m)
        if not distance_m <= self._noise.max_m or luck < self._noise.dropout:
            return SonarReading(stamp_s, SonarState.NO_ECHO)
        return SonarReading(stamp_s, SonarState.OK, distance_m)

    def _first_echo(self, world_from_sonar: Transform, placements: Sequence[Placement | None]) -> float:
        origin = world_from_sonar.translation
        directions = self._cone @ world_from_sonar.rotation.T
        grazing_cosine = math.cos(math.radians(self._noise.grazing_deg))
        nearest = self._walls.first_echo(origin, directions, grazing_cosine)
        for mover, placement in zip(self._movers, placements, strict=True):
            if placement is None:
                continue
            turn = rotation_about_z(placement.yaw_rad)
            own_origin = (origin - np.array([placement.x_m, placement.y_m, 0.0])) @ turn
            nearest = min(nearest, mover.first_echo(own_origin, directions @ turn, grazing_cosine))
        return nearest


class _Reflectors:
    """Surfaces that reflect sound."""

    def __init__(self, surfaces: Sequence[Surface]) -> None:
        self._scene = RayScene(surfaces)
        self._normals: F32 = surface_arrays(surfaces).normal if surfaces else np.zeros((0, 3), np.float32)

    def first_echo(self, origin: FloatArray, directions: FloatArray, grazing_cosine: float) -> float:
        """Return the distance of the nearest reflection among unit directions (n, 3); inf where there is none."""
        distance, surface = self._scene.cast(rays_from(np.broadcast_to(origin, directions.shape), directions))
        hit = np.flatnonzero(surface >= 0)
        facing = np.abs(np.einsum("nc,nc->n", directions[hit], self._normals[surface[hit]]))
        heard = hit[facing >= grazing_cosine]
        return float(distance[heard].min()) if len(heard) else math.inf


def _cone_directions(noise: SonarNoise) -> FloatArray:
    """Return unit vectors (n, 3) spread evenly over the cone about +z (a sunflower's pattern)."""
    k = np.arange(noise.ray_count)
    tilt = math.radians(noise.cone_deg / 2) * np.sqrt((k + 0.5) / noise.ray_count)
    around = k * math.pi * (3 - math.sqrt(5))
    return np.stack([np.sin(tilt) * np.cos(around), np.sin(tilt) * np.sin(around), np.cos(tilt)], axis=1)

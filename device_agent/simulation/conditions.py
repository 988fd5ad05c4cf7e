"""Hard conditions for the camera: lights switched off along a stretch, and something that covers the lens.

In the dark the camera exposes longer and amplifies (automatic exposure), so that the picture is dim, smeared by
motion, and noisy: noise of read-out grows with the amplification, that of light with its square root, relative to the
signal (EMVA standard 1288). The depth camera brings its own light and is not affected.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from device_agent.simulation.renderer import View
from device_agent.simulation.scenario import Scenario
from device_agent.simulation.sensors import CameraModel, ColourNoise
from device_agent.simulation.shading import F32, U8
from device_agent.simulation.textures import Material
from navcore.compiled import kernel
from navcore.geometry import FloatArray, Transform
from navcore.types import CameraIntrinsics, FisheyeImage, Frame

DARK_LEVEL = 0.006
"""Light that remains where the lamps are off: about 2 lx of 350 lx, from emergency signs and far windows."""
DARK_REACH_M = 2.2
"""Within this distance of the dark stretch it is as dark as it gets."""
TWILIGHT_M = 2.0
"""Over this distance from there on it becomes bright."""
LONGEST_EXPOSURE = 4.0
"""So many times longer than usual: 32 ms, a frame of a camera at 30 Hz."""
MAX_GAIN = 8.0
EXPOSED_MEAN = 90.0
"""Mean grey level that the automatic exposure aims at in the dark."""
_STEP_M = 0.4
_LIT = int(Material.LIT)
_LAMP_HEIGHT_M = 2.6


@dataclass(frozen=True, slots=True, eq=False)
class Darkness:
    """The lamps along a path are off."""

    path_m: FloatArray
    """Spots (n, 2) along it, at most half a metre apart."""
    level: float = DARK_LEVEL

    def illumination(self, view: View, camera: CameraIntrinsics, world_from_camera: Transform) -> F32 | None:
        """Return how much of the usual light (h, w), 0–1, falls on what the picture shows; None where all is usual."""
        light = np.empty(view.depth_m.shape, np.float32)
        _illuminate(
            view.depth_m,
            view.material,
            np.ascontiguousarray(world_from_camera.rotation),
            np.ascontiguousarray(world_from_camera.translation),
            np.array([camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px]),
            np.ascontiguousarray(self.path_m, np.float64),
            self.level,
            light,
        )
        return light if float(light.min()) < 1.0 else None


@dataclass(frozen=True, slots=True, eq=False)
class Conditions:
    """What hampers the camera during a walk."""

    darkness: Darkness | None = None
    covered_s: tuple[tuple[float, float], ...] = ()
    """From when to when the lens is covered."""

    def covers(self, time_s: float) -> bool:
        """Tell whether the lens is covered then."""
        return any(begin_s <= time_s < end_s for begin_s, end_s in self.covered_s)


EASY = Conditions()


def dark_along(position_m: FloatArray, begin_m: float, end_m: float, level: float = DARK_LEVEL) -> Darkness:
    """Return the darkness along a walk (n, 2), from one distance to another."""
    arc = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(position_m, axis=0).T))])
    spots = np.arange(begin_m, min(end_m, float(arc[-1])) + _STEP_M, _STEP_M)
    return Darkness(np.stack([np.interp(spots, arc, position_m[:, k]) for k in range(2)], axis=1), level)


def conditions_of(scenario: Scenario, position_m: FloatArray) -> Conditions:
    """Return what hampers the camera on a walk along positions (n, 2)."""
    dark = None if scenario.dark_m is None else dark_along(position_m, *scenario.dark_m)
    covered = () if scenario.covered_s is None else ((scenario.covered_s[0], sum(scenario.covered_s)),)
    return Conditions(dark, covered)


def captured(
    model: CameraModel,
    view: View,
    world_from_camera: Transform,
    stamp_s: float,
    number: int,
    yaw_rate_rad_s: float,
    time_s: float,
    conditions: Conditions,
) -> Frame:
    """Return the frame that the camera gives under these conditions; ``time_s`` counts from the walk's start."""
    if conditions.covers(time_s):
        return _covered_frame(model.camera, stamp_s, number)
    darkness = conditions.darkness
    light = None if darkness is None else darkness.illumination(view, model.camera, world_from_camera)
    if light is None:
        return model.capture(view, stamp_s, number, yaw_rate_rad_s)
    dim, noise = exposed_in_the_dark(view, light, model.colour_noise)
    return model.capture(dim, stamp_s, number, yaw_rate_rad_s, noise)


def exposed_in_the_dark(view: View, light: F32, noise: ColourNoise) -> tuple[View, ColourNoise]:
    """Return the view with the light that it gets, as the automatic exposure shows it, and the noise that it has."""
    raw = view.colour_rgb * light[:, :, None]
    brighten = float(np.clip(EXPOSED_MEAN / max(float(raw.mean()), 1e-3), 1.0, LONGEST_EXPOSURE * MAX_GAIN))
    longer = min(brighten, LONGEST_EXPOSURE)
    gain = brighten / longer
    colour = np.clip(raw * brighten + 0.5, 0.0, 255.0).astype(np.uint8)
    spoiled = replace(
        noise,
        read_sigma=noise.read_sigma * gain,
        shot_sigma=noise.shot_sigma * gain**0.5,
        exposure_s=noise.exposure_s * longer,
    )
    return replace(view, colour_rgb=colour), spoiled


def _covered_frame(camera: CameraIntrinsics, stamp_s: float, number: int) -> Frame:
    """A hand on the lens: hardly any light comes through the skin, and no depth."""
    rng = np.random.default_rng([number, 17])
    shape = (camera.height_px, camera.width_px)
    glow = cv2.resize(rng.uniform(0.0, 14.0, (3, 4)), shape[::-1], interpolation=cv2.INTER_CUBIC)
    skin = np.asarray(glow)[:, :, None] * np.array([1.0, 0.45, 0.35])
    colour = np.clip(skin + rng.normal(0.0, 4.0, (*shape, 3)), 0.0, 255.0).astype(np.uint8)
    return Frame(stamp_s, colour, np.full(shape, np.nan, np.float32))


def covered_fisheye(picture: FisheyeImage) -> FisheyeImage:
    """Return a fisheye picture with a hand on the lens: black."""
    return replace(picture, grey=np.zeros_like(picture.grey))


@kernel
def _illuminate(
    depth: F32,
    material: U8,
    rotation: FloatArray,
    origin: FloatArray,
    camera: FloatArray,
    path: FloatArray,
    level: float,
    out: F32,
) -> None:
    """Fill ``out`` (h, w) with the share of light by each hit point's distance on the floor plan from the path."""
    for v in range(depth.shape[0]):
        for u in range(depth.shape[1]):
            z = float(depth[v, u])
            if not z < 1e6:
                out[v, u] = 1.0
                continue
            x, y = (u - camera[2]) / camera[0] * z, (v - camera[3]) / camera[1] * z
            px = rotation[0, 0] * x + rotation[0, 1] * y + rotation[0, 2] * z + origin[0]
            py = rotation[1, 0] * x + rotation[1, 1] * y + rotation[1, 2] * z + origin[1]
            pz = rotation[2, 0] * x + rotation[2, 1] * y + rotation[2, 2] * z + origin[2]
            nearest = 1e9
            for k in range(len(path)):
                dx, dy = px - path[k, 0], py - path[k, 1]
                nearest = min(nearest, dx * dx + dy * dy)
            share = min(1.0, max(0.0, (np.sqrt(nearest) - DARK_REACH_M) / TWILIGHT_M))
            share = share * share * (3.0 - 2.0 * share)
            # Windows, screens and exit signs shine on; lamps do not.
            if material[v, u] == _LIT and pz < _LAMP_HEIGHT_M:
                share = 1.0
            out[v, u] = level + (1.0 - level) * share

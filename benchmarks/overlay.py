"""Time to draw the see-through overlay for both eyes, and an example of what they see.

    python -m benchmarks.overlay [--count N] [--picture FILE]

A walker in the simulated building comes to a corner. Prints the milliseconds of the thread's own time for a pair of
pictures, 640 × 360 each, as JSON. ``--picture`` writes what the left and the right eye see: the light of the overlay
added to that of the world.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from device_agent.simulation.office_floor import office_floor
from device_agent.simulation.renderer import Renderer
from device_agent.single_core import use_one_core
from navcore.cues.overlay import ImageRgba, render_overlay
from navcore.cues.overlay_display import DisplayGeometry, Eye, Head
from navcore.geometry import Transform, world_from_camera_at
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
    ObstacleScan,
    Route,
    SonarReading,
    SonarState,
)

EYE_M, PITCH_RAD = 1.6, math.radians(15.0)
DEPTH_CAMERA = CameraIntrinsics(320, 240, 232.8, 232.8, 159.5, 119.5)
HALLWAY = ((15.0, 14.0), (7.0, 14.0), (7.0, 10.0), (4.3, 10.0))
STANDS = (11.6, 13.75, math.radians(172.0))
_SEEN_THROUGH = 0.7
"""Share of the world's light that the glasses let through."""


def scene(renderer: Renderer) -> tuple[Guidance, ObstacleScan, Transform]:
    """Return what guidance says a few metres before the corner, what the depth camera sees, and the pose."""
    settings = Settings()
    pose = world_from_camera_at((STANDS[0], STANDS[1], EYE_M), STANDS[2], PITCH_RAD)
    depth_m = renderer.render(DEPTH_CAMERA, pose).depth_m.copy()
    depth_m[(depth_m < 0.3) | (depth_m > 8.0)] = np.nan
    seen = scan(depth_m, DEPTH_CAMERA, pose, settings.obstacle)
    points = evenly_spaced(np.array(HALLWAY), settings.planning.route_spacing_m)
    located = Localization(0.0, LocalizationQuality.LOCALIZED, pose)
    sonar = SonarReading(0.0, SonarState.NO_ECHO)
    guidance = guide(0.0, located, Route(points, arc_lengths_m(points)), seen, sonar, None, settings)
    return guidance, seen, pose


def measured_ms(guidance: Guidance, seen: ObstacleScan, pose: Transform, count: int) -> dict[str, float]:
    """Return median and 95th percentile of a pair of pictures: of *walk*, which has most to draw, and of *stop*."""
    figures: dict[str, float] = {}
    stop = replace(guidance, action=Action.STOP, direction=None)
    for name, each in (("walk", guidance), ("stop", stop)):
        times_ms = []
        for _ in range(count):
            began = time.thread_time()
            render_overlay(each, seen, Head.at(pose, EYE_M), 0.0, Settings(), DisplayGeometry())
            times_ms.append(1000.0 * (time.thread_time() - began))
        figures |= {
            f"{name}_median_ms": float(np.median(times_ms)),
            f"{name}_p95_ms": float(np.percentile(times_ms, 95)),
        }
    return {name: round(value, 2) for name, value in figures.items()}


def both_eyes(renderer: Renderer, guidance: Guidance, seen: ObstacleScan, pose: Transform) -> ImageRgba:
    """Return what the left eye sees, and right of it what the right eye sees, RGB."""
    display = DisplayGeometry()
    overlay = render_overlay(guidance, seen, Head.at(pose, EYE_M), 0.0, Settings(), display)
    views = []
    for eye, light in ((Eye.LEFT, overlay.left_rgba), (Eye.RIGHT, overlay.right_rgba)):
        half_m = eye.value * display.pupil_distance_m / 2.0
        shift_px = display.focal_px * half_m / display.image_distance_m
        camera = CameraIntrinsics(
            display.width_px, display.height_px, display.focal_px, display.focal_px,
            (display.width_px - 1) / 2.0 + shift_px, (display.height_px - 1) / 2.0,
        )  # fmt: skip
        at_m = pose.translation + half_m * pose.rotation[:, 0]
        world = _linear(renderer.render(camera, Transform.from_rotation_translation(pose.rotation, at_m)).colour_rgb)
        added = np.clip(_SEEN_THROUGH * world + _linear(light[..., :3]), 0.0, 1.0)
        views.append(np.round(255.0 * added ** (1.0 / 2.2)).astype(np.uint8))
    return np.hstack([views[0], np.zeros((display.height_px, 8, 3), np.uint8), views[1]])


def _linear(rgb: np.ndarray) -> np.ndarray:
    linear: np.ndarray = (rgb / 255.0) ** 2.2
    return linear


def main() -> int:
    """Run."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=300)
    parser.add_argument("--picture", type=Path, metavar="FILE")
    arguments = parser.parse_args()
    use_one_core()
    building = office_floor()
    renderer = Renderer(building.surfaces, building.lamps_m, building.seed)
    guidance, seen, pose = scene(renderer)
    if arguments.picture is not None:
        picture = cv2.cvtColor(both_eyes(renderer, guidance, seen, pose), cv2.COLOR_RGB2BGR)
        cv2.imwrite(str(arguments.picture), picture, (cv2.IMWRITE_JPEG_QUALITY, 88))
    json.dump(measured_ms(guidance, seen, pose, arguments.count), sys.stdout)
    sys.stdout.write("\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())

"""A rehearsal: the whole of SLAM on a picture that slides by, so that everything is compiled before anybody walks."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from itertools import islice

import cv2
import numpy as np

from navcore.geometry import FloatArray, Transform
from navcore.settings import LocalizationSettings
from navcore.slam import depth_alignment, fisheye, fisheye_pose, lie, shading_alignment, triangulation
from navcore.slam.features import feature_count_for
from navcore.slam.keyframes import SlamCamera
from navcore.slam.localizer import Localizer
from navcore.slam.mapper import Mapper
from navcore.types import CameraIntrinsics, FisheyeCamera, FisheyeImage, FisheyeIntrinsics, Frame

REHEARSAL_CAMERA = CameraIntrinsics(320, 240, 232.0, 232.0, 159.5, 119.5)
REHEARSAL_LENS = FisheyeIntrinsics(320, 240, 120.0, 120.0, 159.5, 119.5, 0.0, 0.0, 0.0, 0.0, math.radians(85.0))
WALL_M = 2.0
"""Distance of the wall that slides by."""


def sliding_frames(count: int, step_px: int = 8, seed: int = 0) -> Iterator[tuple[Frame, Transform]]:
    """Yield frames of a camera that moves along a painted wall, and where it truly is (world_from_camera)."""
    rng = np.random.default_rng(seed)
    camera = REHEARSAL_CAMERA
    width_px = camera.width_px + step_px * count
    coarse = rng.integers(0, 256, (camera.height_px // 6 + 1, width_px // 6 + 1, 3)).astype(np.uint8)
    wall = cv2.resize(coarse, (width_px, camera.height_px), interpolation=cv2.INTER_NEAREST)
    wall = cv2.GaussianBlur(wall, (3, 3), 0.8)
    depth_m = np.full((camera.height_px, camera.width_px), WALL_M, np.float32)
    for number in range(count):
        left = number * step_px
        view = np.ascontiguousarray(wall[:, left : left + camera.width_px], dtype=np.uint8)
        place = np.array([left * WALL_M / camera.fx_px, 0.0, 0.0])
        yield Frame(0.1 * number, view, depth_m), Transform.from_rotation_translation(np.eye(3), place)


def rehearse(count: int) -> tuple[Mapper, Localizer, FloatArray]:
    """Map ``count`` frames of the wall; return mapper, localizer in the map, and true positions (count, 3)."""
    settings = LocalizationSettings()
    camera = REHEARSAL_CAMERA
    feature_count = feature_count_for(camera.width_px, camera.height_px, settings.feature_count)
    mapper = Mapper(camera, SlamCamera.of(camera, 100.0), feature_count)
    truth = []
    for frame, world_from_camera in sliding_frames(count):
        mapper.add(frame)
        truth.append(world_from_camera.translation)
    return mapper, Localizer(mapper.finish(), camera, settings), np.array(truth)


def warm_up() -> None:
    """Compile every kernel of mapping and localization."""
    depth_alignment.warm_up()
    shading_alignment.warm_up()
    lie.warm_up()
    fisheye.warm_up()
    fisheye_pose.warm_up()
    triangulation.warm_up()
    count = 30
    _, localizer, _ = rehearse(count)
    # The wall's picture depends on its length, so that a walk along less of it would be one along another wall.
    for frame, _ in islice(sliding_frames(count), 6, 10):
        localizer.locate(frame)
    # What looks like nothing in the map is searched for everywhere, in the fisheye picture too.
    camera = FisheyeCamera(REHEARSAL_LENS, Transform.identity())
    for frame, _ in [*islice(sliding_frames(count), 10, 11), *sliding_frames(2, seed=1)]:
        grey = cv2.cvtColor(frame.colour_rgb, cv2.COLOR_RGB2GRAY).astype(np.uint8, copy=False)
        hidden = np.zeros_like(frame.colour_rgb)
        localizer.locate(replace(frame, colour_rgb=hidden, fisheye=FisheyeImage(frame.stamp_s, grey, camera)))

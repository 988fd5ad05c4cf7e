"""The sensors' errors have the sizes and the causes that their sources name."""

from __future__ import annotations

import math

import numpy as np
import pytest

from device_agent.simulation.renderer import Renderer, View
from device_agent.simulation.sensors import NO_COLOUR_NOISE, NO_DEPTH_NOISE, CameraModel, head_camera
from device_agent.simulation.shapes import GLASS, Surface, box, upright_quad
from device_agent.simulation.sonar import SonarModel, SonarNoise
from device_agent.simulation.textures import Material
from navcore.errors import InputError
from navcore.geometry import world_from_camera_at
from navcore.types import SonarState

CAMERA = head_camera(320, 240)
QUIET = SonarNoise(sigma_m=0.0, dropout=0.0)


def wall_view(depth_m: float, *, material: Material = Material.MATT, cosine: float = 1.0) -> View:
    shape = (CAMERA.height_px, CAMERA.width_px)
    return View(
        np.full((*shape, 3), 128, np.uint8),
        np.full(shape, depth_m, np.float32),
        np.full(shape, cosine, np.float32),
        np.full(shape, material, np.uint8),
    )


def wall_at(x_m: float, texture: str = "paint/#e0e0e0") -> Surface:
    return upright_quad((x_m, 3.0), (x_m, -3.0), 0.0, 2.7, texture)


def test_depth_noise_grows_with_the_square_of_the_distance() -> None:
    model = CameraModel(CAMERA, seed=4)
    sigma = {z: float(np.nanstd(model.capture(wall_view(z), 0.0, 0).depth_m - z)) for z in (1.0, 2.0, 4.0)}
    for z, value in sigma.items():
        assert 0.0010 * z * z < value < 0.0026 * z * z
    assert 3.0 < sigma[4.0] / sigma[2.0] < 5.0


def test_depth_ends_at_the_range_and_near_things_never_look_far() -> None:
    model = CameraModel(CAMERA, seed=4)
    assert np.isnan(model.capture(wall_view(8.5), 0.0, 0).depth_m).all()
    near = model.capture(wall_view(0.2), 0.0, 0).depth_m
    assert 0.2 < np.isnan(near).mean() < 0.9
    assert np.nanmax(near) < 0.5


@pytest.mark.parametrize(
    ("view", "least", "most"),
    [
        (wall_view(2.0), 0.0, 0.02),
        (wall_view(2.0, cosine=0.05), 0.5, 0.95),
        (wall_view(2.0, material=Material.SHINY), 0.3, 0.6),
        (wall_view(2.0, material=Material.LIT), 0.35, 0.65),
    ],
)
def test_depth_is_missing_where_the_camera_has_trouble(view: View, least: float, most: float) -> None:
    missing = np.mean([np.isnan(CameraModel(CAMERA, seed=s).capture(view, 0.0, 0).depth_m).mean() for s in range(4)])
    assert least <= missing <= most


def test_the_second_imager_casts_a_shadow_left_of_near_things() -> None:
    view = wall_view(4.0)
    view.depth_m[80:160, 150:200] = 1.0
    depth = CameraModel(CAMERA, seed=1).capture(view, 0.0, 0).depth_m
    shadow_px = 0.05 * CAMERA.fx_px * (1 / 1.0 - 1 / 4.0)
    left = np.isnan(depth[90:150, 150 - int(shadow_px) + 1 : 149]).mean()
    right = np.isnan(depth[90:150, 204:212]).mean()
    assert left > 0.95
    assert right < 0.1


def test_a_camera_without_noise_gives_the_truth() -> None:
    view = wall_view(3.0)
    frame = CameraModel(CAMERA, 0, NO_DEPTH_NOISE, NO_COLOUR_NOISE).capture(view, 1.5, 0)
    assert frame.stamp_s == 1.5
    assert np.allclose(frame.depth_m, 3.0, atol=1e-4)
    assert np.array_equal(frame.colour_rgb, view.colour_rgb)


def test_frames_repeat_for_a_seed_and_a_number() -> None:
    view = wall_view(3.0)
    frames = [CameraModel(CAMERA, seed).capture(view, 0.0, n) for seed, n in ((1, 5), (1, 5), (1, 6), (2, 5))]
    assert np.array_equal(frames[0].depth_m, frames[1].depth_m, equal_nan=True)
    assert np.array_equal(frames[0].colour_rgb, frames[1].colour_rgb)
    for other in frames[2:]:
        assert not np.array_equal(frames[0].colour_rgb, other.colour_rgb)


def test_a_turning_head_smears_upright_edges() -> None:
    view = wall_view(3.0)
    view.colour_rgb[:, :160] = 20
    model = CameraModel(CAMERA, 0, NO_DEPTH_NOISE, NO_COLOUR_NOISE.__class__(0.0, 0.0, 0.0, 0.0, 0.01))
    still, turning = (model.capture(view, 0.0, 0, rate).colour_rgb[120, :, 0].astype(int) for rate in (0.0, 3.0))
    assert np.abs(np.diff(turning)).max() < np.abs(np.diff(still)).max() / 2


@pytest.mark.parametrize("size", [(4, 4), (320, 2)])
def test_an_impossible_camera_is_refused(size: tuple[int, int]) -> None:
    with pytest.raises(InputError, match="640×480"):
        head_camera(*size)


def test_sonar_hears_walls_and_glass_alike() -> None:
    pose = world_from_camera_at((0.0, 0.0, 1.4), 0.0)
    for surfaces in ((wall_at(2.0),), (wall_at(2.0, GLASS), wall_at(4.0))):
        reading = SonarModel(surfaces, noise=QUIET).measure(0.5, pose, 0)
        assert (reading.stamp_s, reading.state) == (0.5, SonarState.OK)
        assert reading.distance_m == pytest.approx(2.0, abs=0.01)


def test_sonar_gives_the_nearest_thing_within_its_cone() -> None:
    pose = world_from_camera_at((0.0, 0.0, 1.4), 0.0)
    post = box((0.1, 0.1, 2.5), "paint/#808080").surfaces
    for bearing_deg, expected in ((0.0, 1.45), (6.0, 1.45), (12.0, 3.0)):
        x, y = 1.5 * math.cos(math.radians(bearing_deg)), 1.5 * math.sin(math.radians(bearing_deg))
        moved = tuple(surface.moved(x, y, 0.0, math.radians(bearing_deg)) for surface in post)
        reading = SonarModel((wall_at(3.0), *moved), noise=QUIET).measure(0.0, pose, 0)
        assert reading.distance_m == pytest.approx(expected, abs=0.03)


def test_sonar_hears_nothing_beyond_its_range_or_off_grazing_walls() -> None:
    level = world_from_camera_at((0.0, 0.0, 1.4), 0.0)
    along = world_from_camera_at((1.0, 0.0, 1.4), math.pi / 2 + math.radians(10))
    long_wall = upright_quad((2.0, 9.0), (2.0, -9.0), 0.0, 2.7, "paint/#e0e0e0")
    assert SonarModel((wall_at(4.4),), noise=QUIET).measure(0.0, level, 0).state is SonarState.NO_ECHO
    assert SonarModel((long_wall,), noise=QUIET).measure(0.0, along, 0).state is SonarState.NO_ECHO


def test_sonar_noise_is_a_centimetre_with_some_drop_outs() -> None:
    model = SonarModel((wall_at(2.0),), seed=3)
    pose = world_from_camera_at((0.0, 0.0, 1.4), 0.0)
    readings = [model.measure(0.0, pose, number) for number in range(800)]
    heard = [r.distance_m for r in readings if r.distance_m is not None]
    assert 0 < len(readings) - len(heard) < 30
    assert np.std(heard) == pytest.approx(0.01, rel=0.2)
    assert readings[7] == model.measure(0.0, pose, 7)


def test_a_renderer_without_anything_sees_nothing() -> None:
    view = Renderer((wall_at(2.0),)).render(CAMERA, world_from_camera_at((0.0, 0.0, 1.4), math.pi))
    assert np.isinf(view.depth_m).all()
    assert np.isnan(CameraModel(CAMERA, 0).capture(view, 0.0, 0).depth_m).all()

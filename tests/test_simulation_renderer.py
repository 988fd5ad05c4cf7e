"""What the renderer draws agrees with geometry, is rich in corners, and is the same every time."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest

from device_agent.simulation.building import Building
from device_agent.simulation.gait import head_pose
from device_agent.simulation.people import walking_figure
from device_agent.simulation.renderer import Placement, Renderer
from device_agent.simulation.sensors import CameraModel, head_camera
from device_agent.simulation.shapes import GLASS, floor_quad, upright_quad
from device_agent.simulation.textures import build_atlas, texture_key
from device_agent.simulation.walk import head_trajectory, plan_walk
from navcore.errors import InputError
from navcore.geometry import Transform, world_from_camera_at

CAMERA = head_camera(320, 240)


def points_of(depth_m: np.ndarray, world_from_camera: Transform) -> np.ndarray:
    v, u = np.mgrid[0 : CAMERA.height_px, 0 : CAMERA.width_px]
    rays = np.stack([(u - CAMERA.cx_px) / CAMERA.fx_px, (v - CAMERA.cy_px) / CAMERA.fy_px, np.ones_like(u)], axis=2)
    return world_from_camera.apply(rays * depth_m[:, :, None])


def test_depth_is_along_the_optical_axis(office: Building, office_renderer: Renderer) -> None:
    pose = world_from_camera_at((13.0, 6.0, 1.6), math.pi, math.radians(15))
    points = points_of(office_renderer.render(CAMERA, pose).depth_m, pose)
    bottom = points[-1, CAMERA.width_px // 2]
    assert bottom[2] == pytest.approx(0.0, abs=1e-3)
    assert points[:, :, 2].min() > -1e-3
    assert points[:, :, 2].max() < 2.7 + 1e-3
    # The wall at the corridor's end, whose face is at x = 5.8 + 0.06.
    end = points[int(CAMERA.cy_px - CAMERA.fy_px * math.tan(math.radians(14))), CAMERA.width_px // 2 - 12]
    assert end[0] == pytest.approx(5.86, abs=0.03)


def test_two_views_agree_about_the_same_points(office_renderer: Renderer) -> None:
    first = world_from_camera_at((13.0, 6.0, 1.6), math.pi, math.radians(15))
    second = world_from_camera_at((12.6, 6.2, 1.58), math.pi - 0.1, math.radians(13))
    a, b = office_renderer.render(CAMERA, first), office_renderer.render(CAMERA, second)
    in_second = second.inverse().apply(points_of(a.depth_m, first))
    u = np.rint(CAMERA.fx_px * in_second[..., 0] / in_second[..., 2] + CAMERA.cx_px).astype(int)
    v = np.rint(CAMERA.fy_px * in_second[..., 1] / in_second[..., 2] + CAMERA.cy_px).astype(int)
    inside = (in_second[..., 2] > 0) & (u >= 0) & (u < CAMERA.width_px) & (v >= 0) & (v < CAMERA.height_px)
    assert inside.mean() > 0.5
    expected, found = in_second[..., 2][inside], b.depth_m[v[inside], u[inside]]
    assert np.mean(np.abs(found - expected) < 0.03 * expected + 0.02) > 0.93
    grey_a = cv2.GaussianBlur(a.colour_rgb, (5, 5), 1.2)[inside].astype(float)
    grey_b = cv2.GaussianBlur(b.colour_rgb, (5, 5), 1.2)[v[inside], u[inside]].astype(float)
    assert np.median(np.abs(grey_a - grey_b)) < 8.0


def test_most_views_of_the_walk_are_rich_in_corners(office: Building, office_renderer: Renderer) -> None:
    poses = head_trajectory(plan_walk(office.road_waypoints, seed=0), rate_hz=0.5)[::3]
    model, detector = CameraModel(CAMERA, seed=0), cv2.FastFeatureDetector_create(12)
    counts, spreads = [], []
    for number, (stamp_s, pose) in enumerate(poses):
        frame = model.capture(office_renderer.render(CAMERA, pose), stamp_s, number)
        corners = detector.detect(cv2.cvtColor(frame.colour_rgb, cv2.COLOR_RGB2GRAY))
        counts.append(len(corners))
        spreads.append(len({(int(c.pt[0] // 40), int(c.pt[1] // 40)) for c in corners}))
    assert np.mean(np.array(counts) >= 400) > 0.85
    assert np.median(spreads) >= 30


def test_the_same_seed_gives_the_same_bytes(office: Building, office_renderer: Renderer) -> None:
    pose = world_from_camera_at((7.0, 12.0, 1.6), 1.4, math.radians(15))
    first, again = office_renderer.render(CAMERA, pose), office_renderer.render(CAMERA, pose)
    assert np.array_equal(first.colour_rgb, again.colour_rgb)
    assert np.array_equal(first.depth_m, again.depth_m)
    posters = [surface for surface in office.surfaces if surface.texture.startswith("poster/w")]
    assert np.array_equal(build_atlas(posters, 0).texels, build_atlas(posters, 0).texels)
    assert not np.array_equal(build_atlas(posters, 0).texels, build_atlas(posters, 1).texels)


def test_a_moving_person_hides_what_is_behind(office: Building) -> None:
    surfaces = (
        floor_quad(-5, -5, 5, 5, 0.0, "carpet/#606060"),
        upright_quad((4, 3), (4, -3), 0.0, 2.7, "brick/#a05040"),
    )
    renderer = Renderer(surfaces, movers=[[pose.surfaces for pose in walking_figure(poses=1)]])
    pose = world_from_camera_at((-2.0, 0.0, 1.6), 0.0, math.radians(10))
    middle = (CAMERA.height_px // 2, CAMERA.width_px // 2)
    here, away = (renderer.render(CAMERA, pose, [Placement(x, y, 0.3)]) for x, y in ((1.0, 0.0), (1.0, 30.0)))
    assert here.depth_m[middle] == pytest.approx(3.0, abs=0.35)
    assert away.depth_m[middle] > 5.0
    changed = np.any(here.colour_rgb != away.colour_rgb, axis=2)
    assert np.array_equal(here.depth_m[~changed], away.depth_m[~changed])
    assert 0.01 < changed.mean() < 0.4


def test_glass_is_not_seen() -> None:
    wall = upright_quad((4, 3), (4, -3), 0.0, 2.7, "paint/#e0e0e0")
    pane = upright_quad((2, 3), (2, -3), 0.0, 2.7, GLASS)
    pose = world_from_camera_at((0.0, 0.0, 1.4), 0.0)
    depth = Renderer((wall, pane)).render(CAMERA, pose).depth_m
    assert depth[CAMERA.height_px // 2, CAMERA.width_px // 2] == pytest.approx(4.0, abs=1e-3)


def test_far_pictures_do_not_flicker() -> None:
    """Mip levels: a fine pattern far away becomes its mean colour, not noise."""
    wall = upright_quad((30, 10), (30, -10), 0.0, 10.0, "terrazzo/#b0b0b0")
    near = upright_quad((3, 10), (3, -10), 0.0, 10.0, "terrazzo/#b0b0b0")
    pose = head_pose(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    spread = [float(Renderer((s,)).render(CAMERA, pose).colour_rgb[90:130, 130:190].std()) for s in (wall, near)]
    assert spread[0] < 0.5 * spread[1]


def test_an_unknown_texture_is_named() -> None:
    with pytest.raises(InputError, match="moss"):
        Renderer((floor_quad(0, 0, 1, 1, 0.0, "moss/#ffffff"),))


def test_a_walking_figure_keeps_its_limbs_and_moves_its_legs() -> None:
    poses = walking_figure()
    feet = []
    for pose in poses:
        corners = np.array([surface.corners for surface in pose.surfaces]).reshape(-1, 3)
        assert corners[:, 2].min() == pytest.approx(0.0, abs=1e-9)
        assert 1.6 < corners[:, 2].max() < 1.85
        feet.append(corners[corners[:, 2] < 0.15][:, 0].max())
    assert max(feet) - min(feet) > 0.15
    # Each limb is the same plank at every moment: its textures are painted once.
    assert len({tuple(sorted(texture_key(s) for s in pose.surfaces)) for pose in poses}) == 1


def test_the_view_tells_where_moving_things_are() -> None:
    wall = upright_quad((4.0, 4.0), (4.0, -4.0), 0.0, 2.7, "paint/#ffffff")
    renderer = Renderer((wall,), movers=[[pose.surfaces for pose in walking_figure()]])
    pose = world_from_camera_at((0.0, 0.0, 1.4), 0.0)
    empty = renderer.render(CAMERA, pose, [None])
    there = renderer.render(CAMERA, pose, [Placement(2.0, 0.0, 0.3, 5)])
    assert empty.is_moving is None
    assert there.is_moving is not None
    assert 0.03 < there.moving_share < 0.3
    assert np.array_equal(there.is_moving, there.depth_m != empty.depth_m)
    strode = renderer.render(CAMERA, pose, [Placement(2.0, 0.0, 0.3, 1)])
    assert not np.array_equal(strode.is_moving, there.is_moving)


def test_a_renderer_with_other_movers_draws_the_same_building() -> None:
    wall = upright_quad((3.0, 2.0), (3.0, -2.0), 0.0, 2.7, "brick/#a8573f")
    renderer = Renderer((wall,))
    peopled = renderer.with_movers([[pose.surfaces for pose in walking_figure()]])
    pose = world_from_camera_at((0.0, 0.0, 1.4), 0.0)
    assert np.array_equal(renderer.render(CAMERA, pose).colour_rgb, peopled.render(CAMERA, pose, [None]).colour_rgb)

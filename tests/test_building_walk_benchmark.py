"""The yardstick of the building walk: it finds doubled walls and ghosts that are there, and none that are not."""

from __future__ import annotations

import itertools
from pathlib import Path

import cv2
import numpy as np
import pytest

from benchmarks.walk_geometry import loops_of
from benchmarks.walls_and_ghosts import CloudCheck, checked_cloud, drawn_cloud
from device_agent.simulation.building import Building
from device_agent.simulation.shapes import GLASS
from navcore.geometry import FloatArray


@pytest.fixture(scope="module")
def true_cloud(office: Building) -> FloatArray:
    """Points (n, 3) all over the building's surfaces, with a depth camera's noise."""
    rng = np.random.default_rng(1)
    points = []
    for surface in office.surfaces:
        if surface.texture != GLASS:
            a, b, _, d = (np.array(corner) for corner in surface.corners)
            count = max(1, int(np.linalg.norm(np.cross(b - a, d - a)) * 120))
            share = rng.random((count, 2))
            points.append(a + share[:, :1] * (b - a) + share[:, 1:] * (d - a))
    cloud: FloatArray = np.concatenate(points)
    cloud = cloud[(cloud[:, 2] > 0.2) & (cloud[:, 2] < 1.9)]
    return cloud + rng.normal(0.0, 0.012, cloud.shape)


@pytest.fixture(scope="module")
def road(office: Building) -> FloatArray:
    corners = np.asarray(office.road_waypoints)
    return np.concatenate([np.linspace(a, b, 20) for a, b in itertools.pairwise(corners)])


@pytest.fixture(scope="module")
def sound(office: Building, true_cloud: FloatArray, road: FloatArray) -> CloudCheck:
    return checked_cloud(office, true_cloud, road)


def test_a_true_cloud_has_neither_doubled_walls_nor_ghosts(sound: CloudCheck) -> None:
    assert sound.stretch_count > 200
    assert sound.doubled_count <= 0.02 * sound.stretch_count
    assert sound.wall_share_within(0.05) > 0.97
    assert sound.ghost_share < 0.001
    assert len(sound.ghost_clusters) == 0


def test_a_wall_that_is_there_twice_is_found(
    office: Building, true_cloud: FloatArray, road: FloatArray, sound: CloudCheck
) -> None:
    # The north corridor's south side again, 15 cm before the wall, over 5 m.
    near = (np.abs(true_cloud[:, 1] - 12.86) < 0.04) & (true_cloud[:, 0] > 8.5) & (true_cloud[:, 0] < 13.5)
    again = true_cloud[near] + (0.0, 0.15, 0.0)
    check = checked_cloud(office, np.concatenate([true_cloud, again]), road)
    assert 7 <= check.doubled_count - sound.doubled_count <= 12
    assert check.wall_share_within(0.05) < sound.wall_share_within(0.05)


def test_somebody_who_remains_in_the_cloud_is_found(office: Building, true_cloud: FloatArray, road: FloatArray) -> None:
    angle, height = np.random.default_rng(2).uniform((0.0, 0.0), (2 * np.pi, 1.75), (600, 2)).T
    body = np.stack([15.0 + 0.2 * np.cos(angle), 6.0 + 0.2 * np.sin(angle), height], axis=1)
    check = checked_cloud(office, np.concatenate([true_cloud, body]), road)
    assert check.ghost_clusters[0] == pytest.approx([15.0, 6.0, 600 * 1.5 / 1.75], rel=0.1)
    assert check.ghost_volume_m3 > 0.02


def test_the_picture_shows_walls_and_roads(
    office: Building, true_cloud: FloatArray, road: FloatArray, sound: CloudCheck, tmp_path: Path
) -> None:
    path = tmp_path / "walk.png"
    colours = np.full((len(true_cloud), 3), 60, np.uint8)
    drawn_cloud(office, sound, colours, road, road + 0.3, path)
    image = cv2.imread(str(path))
    assert (image < 250).any(axis=2).mean() > 0.05
    for bgr in ((160, 215, 150), (220, 70, 25)):
        assert (np.abs(image.astype(int) - bgr).max(axis=2) < 25).sum() > 100
    assert ((image[:, :, 2] > 150) & (image[:, :, :2].max(axis=2) < 140)).sum() > 1000


def test_going_to_and_fro_makes_no_loop() -> None:
    there = np.stack([np.linspace(0.0, 30.0, 100), np.zeros(100)], axis=1)
    assert loops_of(np.concatenate([there, there[::-1]])).independent == 0


def test_walking_round_a_block_makes_a_loop() -> None:
    corners = np.array([(0.0, 0.0), (12.0, 0.0), (12.0, 8.0), (0.0, 8.0), (0.0, 0.0)])
    block = np.concatenate([np.linspace(a, b, 40) for a, b in itertools.pairwise(corners)])
    loops = loops_of(block)
    assert (loops.independent, loops.returns) == (1, 1)


def test_the_recorded_walk_makes_at_least_two_loops(office: Building) -> None:
    loops = loops_of(np.asarray(office.road_waypoints))
    assert loops.independent >= 2
    assert loops.returns >= 2

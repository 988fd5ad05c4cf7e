"""Depth carries the pose where surfaces fix it, and says where they do not."""

from __future__ import annotations

import numpy as np
import pytest
from slam_blank_room import CAMERA, Plane, camera_at, corridor_planes, depth_of, room_planes

from navcore.slam import lie
from navcore.slam.depth_alignment import LEVER_M, DepthAlignment, align_depth
from navcore.slam.depth_model import depth_model, grid_shape, model_of_grid, points_and_normals
from navcore.slam.depth_tracking import DepthView, carry, motion_information, nearest_view

LEVER = np.array([1.0, 1.0, 1.0, LEVER_M, LEVER_M, LEVER_M])
HERE = (0.0, 0.0, 1.0)
CORNER_RAD = 0.7
WALL = [Plane((1.0, 0.0, 0.0), 2.0)]


def aligned(
    planes: list[Plane],
    step: np.ndarray,
    noise: float = 0.002,
    guess_off: np.ndarray | None = None,
    seed: int = 0,
    heading_rad: float = 0.1,
) -> tuple[DepthAlignment, np.ndarray]:
    """Align two noisy views that differ by a twist; return the result and the true pose of the second in the first."""
    rng = np.random.default_rng(seed)
    first = camera_at(HERE, heading_rad)
    second = lie.exp_se3(step) @ first
    models = [depth_model(depth_of(planes, pose, noise, rng), CAMERA) for pose in (first, second)]
    truth = second @ np.linalg.inv(first)
    guess = truth if guess_off is None else lie.exp_se3(guess_off) @ truth
    found = align_depth(models[0], models[1], guess)
    assert found is not None
    return found, truth


def away(found: np.ndarray, truth: np.ndarray) -> np.ndarray:
    return lie.log_se3(np.ascontiguousarray(found @ np.linalg.inv(truth)))


def test_points_lie_on_the_surface_and_normals_are_its_normals() -> None:
    pose = camera_at(HERE, CORNER_RAD)
    model = depth_model(depth_of(room_planes(), pose, 0.0, np.random.default_rng(0)), CAMERA)
    points, normals = points_and_normals(model)
    assert model.known_share > 0.7
    in_world = (points - pose[:3, 3]) @ pose[:3, :3]
    normals_in_world = normals @ pose[:3, :3]
    planes = np.array([[*plane.normal, plane.distance_m] for plane in room_planes()])
    off = np.abs(in_world @ planes[:, :3].T - planes[:, 3])
    nearest = np.argmin(off, axis=1)
    assert np.percentile(off.min(axis=1), 90) < 0.002
    cosine = np.abs(np.einsum("ij,ij->i", normals_in_world, planes[nearest, :3]))
    assert np.percentile(cosine, 10) > 0.999
    assert np.all(np.einsum("ij,ij->i", points, normals) < 0)


def test_a_stored_grid_gives_the_same_surfaces_again() -> None:
    rng = np.random.default_rng(0)
    model = depth_model(depth_of(room_planes(), camera_at(HERE, CORNER_RAD), 0.002, rng), CAMERA)
    assert model.grid.shape == grid_shape(CAMERA)
    assert np.array_equal(model_of_grid(model.grid.copy(), CAMERA).surface, model.surface)


def test_what_the_sensor_did_not_measure_is_unknown() -> None:
    depth_m = depth_of(WALL, camera_at(HERE, 0.0), 0.0, np.random.default_rng(0))
    depth_m[:, :160] = np.nan
    depth_m[:, 160:] = np.where(np.arange(160) % 80 < 40, 2.0, 3.0)
    model = depth_model(depth_m, CAMERA)
    assert not model.surface[:, :40].any()
    assert 0.2 < model.known_share < 0.5


@pytest.mark.parametrize("seed", range(4))
def test_a_room_fixes_all_directions(seed: int) -> None:
    rng = np.random.default_rng(seed)
    step = np.r_[rng.uniform(-0.15, 0.15, 3), rng.uniform(-0.08, 0.08, 3)]
    off = np.r_[rng.uniform(-0.06, 0.06, 3), rng.uniform(-0.04, 0.04, 3)]
    found, truth = aligned(room_planes(), step, guess_off=off, seed=seed, heading_rad=CORNER_RAD)
    assert found.is_complete
    error = away(found.camera_from_reference, truth)
    assert np.linalg.norm(error[:3]) < 0.006
    assert np.linalg.norm(error[3:]) < 0.004
    assert found.contradicted < 0.1
    assert found.overlap > 0.5


def test_error_is_within_what_the_information_says() -> None:
    chi2 = []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        found, truth = aligned(
            room_planes(), np.r_[rng.uniform(-0.1, 0.1, 3), np.zeros(3)], 0.003, seed=seed, heading_rad=CORNER_RAD
        )
        error = away(found.camera_from_reference, truth)
        chi2.append(error @ found.information @ error)
    # 95 % of the χ² distribution with six degrees of freedom; a real sensor errs by more than this one's noise.
    assert np.max(chi2) < 12.6


def test_one_wall_leaves_three_directions_open() -> None:
    off = np.array([0.05, -0.04, 0.03, 0.01, 0.0, 0.0])
    found, truth = aligned(WALL, np.zeros(6), guess_off=off)
    assert len(found.free_directions) == 3
    # The wall's normal, in the camera: along it nothing is open; along the wall everything is.
    normal = camera_at(HERE, 0.1)[:3, :3] @ np.array([1.0, 0.0, 0.0])
    towards = np.r_[normal, np.zeros(3)]
    assert np.linalg.norm(found.free_directions @ towards) < 0.2
    assert towards @ found.information @ towards > 1e3
    for side in np.linalg.svd(normal[None])[2][1:]:
        along = np.r_[side, np.zeros(3)]
        assert np.linalg.norm(found.free_directions @ along) > 0.95
        assert along @ found.information @ along < 1.0
    assert abs(away(found.camera_from_reference, truth)[:3] @ normal) < 0.01


def test_an_even_corridor_leaves_only_its_length_open() -> None:
    ahead = np.array([0.0, 0.0, 0.06, 0.0, 0.0, 0.0])
    found, truth = aligned(corridor_planes(), np.array([0.0, 0.0, -0.1, 0.0, 0.0, 0.0]), guess_off=ahead)
    assert len(found.free_directions) == 1
    along = camera_at(HERE, 0.1)[:3, :3] @ np.array([1.0, 0.0, 0.0])
    assert abs(found.free_directions[0, :3] @ along) > 0.95
    error = away(found.camera_from_reference, truth)
    assert abs(error[:3] @ along - ahead[:3] @ along) < 0.01
    assert np.linalg.norm(error[:3] - (error[:3] @ along) * along) < 0.01
    assert np.linalg.norm(error[3:]) < 0.005


@pytest.mark.parametrize("noise", [0.0005, 0.002, 0.005])
def test_noise_of_a_wall_is_no_information(noise: float) -> None:
    for seed in range(3):
        found, _ = aligned(WALL, np.zeros(6), noise, seed=seed)
        eigenvalues = np.linalg.eigvalsh(found.information / np.outer(LEVER, LEVER))
        assert np.count_nonzero(eigenvalues < 1.0) == 3


def test_what_a_corridor_leaves_open_is_filled_by_motion_with_a_variance_that_says_so() -> None:
    rng = np.random.default_rng(1)
    first = camera_at(HERE, 0.0)
    second = camera_at((0.1, 0.0, 1.0), 0.0)
    views = [DepthView(CAMERA, depth_of(corridor_planes(), pose, 0.002, rng)) for pose in (first, second)]
    short = carry(0, views[0].model, first, views[1], second, 0.033)
    long = carry(0, views[0].model, first, views[1], second, 0.5)
    assert short is not None
    assert long is not None
    along = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
    sigma = [1.0 / np.sqrt(along @ found.factor.information @ along) for found in (short, long)]
    assert 0.005 < sigma[0] < 0.05
    assert 0.1 < sigma[1] < 0.5
    assert np.all(np.linalg.eigvalsh(long.factor.information) > 0)


def test_motion_knows_only_the_open_directions() -> None:
    free = np.zeros((1, 6))
    free[0, 2] = 1.0
    information = motion_information(free, 0.1)
    assert information[2, 2] > 0
    information[2, 2] = 0.0
    assert not information.any()


def test_another_place_is_not_taken_for_this_one() -> None:
    rng = np.random.default_rng(2)
    here, there = camera_at(HERE, CORNER_RAD), camera_at((-0.6, 0.4, 1.2), 2.4)
    views = [DepthView(CAMERA, depth_of(room_planes(), pose, 0.002, rng)) for pose in (here, there)]
    assert carry(0, views[0].model, here, views[1], here, 0.033) is None


def test_a_room_is_structured_and_a_wall_is_not() -> None:
    rng = np.random.default_rng(3)
    pose = camera_at(HERE, CORNER_RAD)
    assert DepthView(CAMERA, depth_of(room_planes(), pose, 0.002, rng)).is_structured
    assert not DepthView(CAMERA, depth_of(WALL, camera_at(HERE, 0.1), 0.002, rng)).is_structured
    assert not DepthView(CAMERA, np.full((240, 320), np.nan, np.float32)).is_structured


def test_nearest_view_looks_the_same_way() -> None:
    poses = np.stack(
        [camera_at((0.1, 0.0, 1.5), 2.0), camera_at((0.4, 0.0, 1.5), 0.1), camera_at((5.0, 0.0, 1.5), 0.0)]
    )
    here = camera_at(HERE, 0.0)
    assert nearest_view(poses, np.ones(3, np.bool_), here) == 1
    assert nearest_view(poses, np.array([True, False, True]), here) == -1
    assert nearest_view(np.zeros((0, 4, 4)), np.zeros(0, np.bool_), here) == -1

"""What lies on a straight edge is told from corners, and says nothing of the way along the edge."""

from __future__ import annotations

import numpy as np
import pytest

from navcore.slam import pose
from navcore.slam.apertures import edge_directions, slides_of
from navcore.slam.descriptors import box_sums

SIZE_PX = 80
MIDDLE = np.array([[40, 40, 0]], np.int32)
CAMERA = (230.0, 230.0, 159.5, 119.5, 100.0)


def direction_at_middle(image: np.ndarray) -> np.ndarray:
    """The direction (2,) of the edge in the middle of an image with the noise of a camera, 0 where there is none."""
    noisy = np.clip(image + np.random.default_rng(0).normal(0.0, 2.0, image.shape), 0, 255).astype(np.uint8)
    sums = np.zeros(noisy.shape, np.uint16)
    box_sums(noisy, sums)
    return edge_directions(sums, MIDDLE)[0]


@pytest.mark.parametrize("angle_rad", np.linspace(0.0, np.pi, 12, endpoint=False))
@pytest.mark.parametrize("width_px", [4.0, 200.0])
def test_the_stairs_of_a_slanted_edge_slide_along_it(angle_rad: float, width_px: float) -> None:
    y, x = np.mgrid[0:SIZE_PX, 0:SIZE_PX]
    across = -np.sin(angle_rad) * (x - 40.3) + np.cos(angle_rad) * (y - 40.3)
    found = direction_at_middle(np.where((across > 0) & (across < width_px), 50.0, 190.0))
    along = np.array([np.cos(angle_rad), np.sin(angle_rad)])
    assert abs(found @ along) > np.cos(0.05)


def test_a_corner_does_not_slide() -> None:
    y, x = np.mgrid[0:SIZE_PX, 0:SIZE_PX]
    assert not direction_at_middle(np.where((x > 40) & (y > 40), 50.0, 190.0)).any()
    assert not direction_at_middle(np.where(((x > 40) & (y > 40)) | (y > 44), 50.0, 190.0)).any()


def test_the_depth_along_an_edge_slides_with_it() -> None:
    depth_m = np.tile(np.linspace(1.0, 3.0, SIZE_PX, dtype=np.float32), (SIZE_PX, 1))
    raw_px = np.array([[40.0, 40.0], [40.0, 40.0], [20.0, 20.0]])
    directions = np.array([[1.0, 0.0], [0.0, 1.0], [0.0, 0.0]])
    slides = slides_of(directions, raw_px, np.full(3, 5.0), depth_m, 100.0)
    slope = (100.0 / depth_m[40, 45] - 100.0 / depth_m[40, 35]) / 10.0
    assert slides[0, 2] / slides[0, 0] == pytest.approx(1.0 - slope, abs=1e-4)
    assert slides[1] == pytest.approx([0.0, 1.0, 0.0], abs=1e-6)
    assert not slides[2].any()


def edges_of_a_corridor() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points on four edges along z, where they are seen, and how they can slide."""
    z = np.linspace(1.5, 5.0, 20)
    corners = [(-1.0, 1.2), (1.0, 1.2), (-1.0, -1.0), (1.0, -1.0)]
    points = np.concatenate([np.column_stack([np.full_like(z, x), np.full_like(z, y), z]) for x, y in corners])

    def seen(p: np.ndarray) -> np.ndarray:
        u = 230.0 * p[:, 0] / p[:, 2] + 159.5
        return np.column_stack([u, 230.0 * p[:, 1] / p[:, 2] + 119.5, u - 100.0 / p[:, 2]])

    ahead = np.array([0.0, 0.0, 0.01])
    slides = seen(points + ahead) - seen(points - ahead)
    return points, seen(points), slides / np.linalg.norm(slides, axis=1)[:, None]


def test_edges_along_a_corridor_leave_its_length_open_and_fix_the_rest() -> None:
    points, uvr, slides = edges_of_a_corridor()
    guess = np.eye(4)
    guess[:3, 3] = 0.02, -0.03, 0.1
    found, inlier, information = pose.refine_pose(guess, points, uvr, np.ones(len(points)), *CAMERA, slides=slides)
    assert inlier.all()
    assert found[:2, 3] == pytest.approx([0.0, 0.0], abs=1e-3)
    assert found[2, 3] == pytest.approx(0.1, abs=1e-2)
    assert pose.position_sigma_m(information) > 1.0
    assert np.sqrt(1.0 / information[0, 0]) < 0.02
    _, _, believed = pose.refine_pose(guess, points, uvr, np.ones(len(points)), *CAMERA)
    assert pose.position_sigma_m(believed) < 0.02

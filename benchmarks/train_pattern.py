"""Choose the descriptor's 256 comparisons, and print the table that ``navcore/slam/pattern.py`` holds.

    python -m benchmarks.train_pattern [--seed 0] [--images 150]

The pictures are drawn, not taken: leaves that fall over each other, with sizes as in nature ("dead leaves", Lee et al.
2001), lettering and grain, so that no recording has a part in it. Each picture is seen a second time, turned, scaled,
tilted, blurred, dimmed and with new noise, so that it is known which corners are one point. Of candidate comparisons
those are taken, one after the other, that set the distances of descriptors of one point farthest apart from those of
different points, in units of their spread: a comparison is worth taking where it differs between points (variance
near 0.5), stays between views, and says what those already taken do not (low correlation: Rublee et al. 2011 ask for
the first and the last).
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator

import cv2
import numpy as np
from numpy.typing import NDArray

from navcore.geometry import FloatArray
from navcore.slam.corners import BORDER_PX, find_corners
from navcore.slam.descriptors import TURN_COUNT, box_sums, disc_weights, orientation
from navcore.slam.keyframes import ByteArray, IntArray

WIDTH_PX, HEIGHT_PX = 400, 300
CORNERS = 150
"""Corners of one picture."""
SAME_PX = 1.5
"""Corners of two views are one point when they are nearer than this."""
CANDIDATES = 6000
MAX_RADIUS_PX = 13.0
"""Farther from the corner no pixel is compared: turned, its 5×5 pixels must lie in the image."""
MIN_APART_PX = 3.0
COMPARISONS = 256


# ------------------------------------------------------------------------------------------------- pictures
def leaves(rng: np.random.Generator) -> ByteArray:
    """Return a picture (h, w) of shapes that hide each other, the large ones many times rarer than the small."""
    picture = np.full((HEIGHT_PX, WIDTH_PX), int(rng.integers(40, 216)), np.uint8)
    for _ in range(900):
        size = float(np.clip(3.0 * rng.random() ** -0.6, 3, 120))
        centre = rng.uniform((0, 0), (WIDTH_PX, HEIGHT_PX))
        tone = int(np.clip(rng.normal(128, 55), 0, 255))
        _draw_shape(picture, rng, centre, size, tone)
    grain = cv2.resize(rng.normal(0, 9, (HEIGHT_PX // 3, WIDTH_PX // 3)), (WIDTH_PX, HEIGHT_PX))
    grey = cv2.GaussianBlur(picture.astype(np.float64) + grain, (0, 0), 0.7)
    return np.clip(grey, 0, 255).astype(np.uint8)


def _draw_shape(picture: ByteArray, rng: np.random.Generator, centre: FloatArray, size: float, tone: int) -> None:
    kind = rng.integers(0, 4)
    x, y = int(centre[0]), int(centre[1])
    if kind == 0:
        cv2.circle(picture, (x, y), int(size), tone, -1, cv2.LINE_AA)
    elif kind == 1:
        word = "".join(rng.choice(list("ABEHKMNRSTXZaegkrs2345678"), 4))
        cv2.putText(picture, word, (x, y), int(rng.integers(0, 4)), size / 25, tone, 1 + int(size / 15), cv2.LINE_AA)
    else:
        corners = 4 if kind == 2 else int(rng.integers(3, 7))
        angles = np.sort(rng.uniform(0, 2 * np.pi, corners))
        outline = centre + size * rng.uniform(0.5, 1.3, (corners, 1)) * np.stack([np.cos(angles), np.sin(angles)], 1)
        cv2.fillPoly(picture, [outline.astype(np.int32)], tone, cv2.LINE_AA)


def second_view(picture: ByteArray, rng: np.random.Generator) -> tuple[ByteArray, FloatArray]:
    """Return the picture seen from elsewhere (h, w), and the homography (3, 3) that leads there."""
    angle, scale = rng.normal(0, 0.35), np.exp(rng.normal(0, 0.12))
    middle = np.array([[1, 0, -WIDTH_PX / 2], [0, 1, -HEIGHT_PX / 2], [0, 0, 1]])
    c, s = scale * np.cos(angle), scale * np.sin(angle)
    tilt = np.array([[1, rng.normal(0, 0.06), 0], [0, 1 + rng.normal(0, 0.06), 0], [*rng.normal(0, 3e-4, 2), 1]])
    homography = np.linalg.inv(middle) @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ tilt @ middle
    view = cv2.warpPerspective(picture, homography, (WIDTH_PX, HEIGHT_PX), borderMode=cv2.BORDER_REFLECT_101)
    grey = cv2.GaussianBlur(view.astype(np.float64), (0, 0), rng.uniform(0.3, 1.3))
    return _noisy(rng.uniform(0.75, 1.2) * grey + rng.normal(0, 8), rng), homography


def _noisy(grey: FloatArray, rng: np.random.Generator) -> ByteArray:
    return np.clip(grey + rng.normal(0, 3.0, grey.shape), 0, 255).astype(np.uint8)


# --------------------------------------------------------------------------------------------------- patches
def patch_points() -> IntArray:
    """Return the pixels (m, 2) of the patch, from the corner."""
    reach = np.arange(-int(MAX_RADIUS_PX), int(MAX_RADIUS_PX) + 1)
    x, y = np.meshgrid(reach, reach)
    inside = np.hypot(x, y) <= MAX_RADIUS_PX
    return np.stack([x[inside], y[inside]], axis=1).astype(np.int32)


def patches(image: ByteArray, corners: IntArray) -> IntArray:
    """Return the smoothed pixels (n, m) of the turned patches of corners (n, ≥2)."""
    sums = np.zeros(image.shape, np.uint16)
    box_sums(image, sums)
    disc = disc_weights()
    angles = np.array([orientation(image, int(x), int(y), *disc) for x, y in corners[:, :2]])
    turns = np.floor(angles * TURN_COUNT / (2 * np.pi) + 0.5) * (2 * np.pi / TURN_COUNT)
    c, s = np.cos(turns)[:, None], np.sin(turns)[:, None]
    points = patch_points()
    x = np.round(c * points[:, 0] - s * points[:, 1]).astype(np.int64) + corners[:, :1]
    y = np.round(s * points[:, 0] + c * points[:, 1]).astype(np.int64) + corners[:, 1:2]
    return sums[y, x].astype(np.int32)


def pairs_of_patches(seed: int, images: int) -> tuple[IntArray, IntArray]:
    """Return patches (n, m) of points, and of the same points in other views."""
    rng = np.random.default_rng(seed)
    first, second = zip(*_matched(rng, images), strict=True)
    return np.concatenate(first), np.concatenate(second)


def _matched(rng: np.random.Generator, images: int) -> Iterator[tuple[IntArray, IntArray]]:
    for _ in range(images):
        drawn = leaves(rng)
        one, (other, homography) = _noisy(drawn.astype(np.float64), rng), second_view(drawn, rng)
        a, b = (find_corners(image, np.zeros_like(image), 20, 7, CORNERS) for image in (one, other))
        there = cv2.perspectiveTransform(a[:, None, :2].astype(np.float64), homography)[:, 0]
        distance = np.linalg.norm(there[:, None] - b[None, :, :2], axis=2)
        nearest = distance.argmin(axis=1)
        same = distance[np.arange(len(a)), nearest] < SAME_PX
        assert (a[:, :2] >= BORDER_PX).all()
        yield patches(one, a[same]), patches(other, b[nearest[same]])


# ------------------------------------------------------------------------------------------------- selection
def candidates(seed: int) -> IntArray:
    """Return pairs (CANDIDATES, 2) of patch pixels, by their number in :func:`patch_points`."""
    rng = np.random.default_rng(seed)
    points = patch_points()
    pairs = np.unique(np.sort(rng.integers(0, len(points), (3 * CANDIDATES, 2)), axis=1), axis=0)
    apart = np.linalg.norm(points[pairs[:, 0]] - points[pairs[:, 1]], axis=1)
    return np.asarray(rng.permutation(pairs[apart >= MIN_APART_PX])[:CANDIDATES], dtype=np.int32)


def select(same: NDArray[np.float32], different: NDArray[np.float32]) -> list[int]:
    """Return the comparisons taken, of columns that say for each pair of points whether the comparison differs.

    Greedy: each time the one with which the two distributions of distances lie farthest apart, (μ_d − μ_s)² / (σ_d² +
    σ_s²). A sum's variance with one more term needs only that term's covariance with the sum.
    """
    means = [part.mean(axis=0) for part in (same, different)]
    centred = [part - mean for part, mean in zip((same, different), means, strict=True)]
    variances = [(part**2).mean(axis=0) for part in centred]
    sums = [np.zeros(len(part), np.float32) for part in centred]
    gap, spread = 0.0, 0.0
    taken: list[int] = []
    while len(taken) < COMPARISONS:
        added = sum(
            variance + 2.0 * (part.T @ total) / len(part)
            for part, variance, total in zip(centred, variances, sums, strict=True)
        )
        apart = (gap + means[1] - means[0]) ** 2 / (spread + added)
        apart[taken] = -np.inf
        best = int(np.argmax(apart))
        taken.append(best)
        gap += float(means[1][best] - means[0][best])
        spread += float(np.asarray(added)[best])
        sums = [total + part[:, best] for total, part in zip(sums, centred, strict=True)]
    return taken


def train(seed: int, images: int) -> IntArray:
    """Return the comparisons (256, 4) as x, y, x, y."""
    first, second = pairs_of_patches(seed, images)
    chosen = candidates(seed)
    bits, again = (values[:, chosen[:, 0]] < values[:, chosen[:, 1]] for values in (first, second))
    stranger = np.roll(again, len(again) // 2 + 1, axis=0)
    taken = select((bits != again).astype(np.float32), (bits != stranger).astype(np.float32))
    return patch_points()[chosen[taken]].reshape(-1, 4)


def main() -> None:
    """Train and print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--images", type=int, default=150)
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    for row in train(arguments.seed, arguments.images).reshape(-1, 32):
        print(" ".join(str(value) for value in row))


if __name__ == "__main__":
    main()

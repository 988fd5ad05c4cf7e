"""Painters of materials: paint, brick, wood, carpet, tiles, leaves. Each is a function of a seeded generator.

A painter takes ``(rng, width_px, height_px, label)`` and returns an image (h, w, 3), uint8, red first. The label is
the part of a texture's name after the slash; most painters read a colour (``#rrggbb``) from it.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

Rng = np.random.Generator
Image = NDArray[np.uint8]
Field = NDArray[np.float32]
Colour = tuple[float, float, float]


def colour_of(label: str) -> Colour:
    """Return red, green, blue (0–255) of the ``#rrggbb`` that a label begins with; light grey where it has none."""
    if not label.startswith("#"):
        return (200.0, 200.0, 200.0)
    return (float(int(label[1:3], 16)), float(int(label[3:5], 16)), float(int(label[5:7], 16)))


def finished(image: NDArray[np.floating]) -> Image:
    """Round and clip to uint8."""
    clipped: Image = np.clip(np.rint(image), 0, 255).astype(np.uint8)
    return clipped


def cloud(rng: Rng, width_px: int, height_px: int, cell_px: float, octaves: int = 1) -> Field:
    """Return smooth noise (h, w), about −1 to 1, with spots ``cell_px`` wide; finer octaves have half the strength."""
    total = np.zeros((height_px, width_px), np.float32)
    strength, cell = 1.0, cell_px
    for _ in range(octaves):
        shape = (max(2, round(height_px / cell) + 1), max(2, round(width_px / cell) + 1))
        grid = rng.uniform(-1.0, 1.0, shape).astype(np.float32)
        total += strength * cv2.resize(grid, (width_px, height_px), interpolation=cv2.INTER_CUBIC)
        strength, cell = strength / 2, max(1.0, cell / 2)
    return total


def speckle(rng: Rng, width_px: int, height_px: int) -> Field:
    """Return white noise (h, w), standard normal."""
    return rng.standard_normal((height_px, width_px), dtype=np.float32)


def tinted(colour: Colour, shade: Field) -> NDArray[np.float32]:
    """Return an image (h, w, 3) of one colour, brightened or darkened by ``shade`` (h, w), in grey levels."""
    image: NDArray[np.float32] = np.asarray(colour, np.float32)[None, None, :] + shade[:, :, None]
    return image


def paint(rng: Rng, width_px: int, height_px: int, label: str) -> Image:
    """Painted plaster: nearly plain. It repeats without a seam."""
    fine = ndimage.gaussian_filter(speckle(rng, width_px, height_px), 1.2, mode="wrap")
    coarse = ndimage.gaussian_filter(speckle(rng, width_px, height_px), 12.0, mode="wrap")
    return finished(tinted(colour_of(label), 3.5 * fine / fine.std() * 0.6 + 2.0 * coarse / coarse.std()))


def fabric(rng: Rng, width_px: int, height_px: int, label: str) -> Image:
    """Woven cloth: threads, with flecks."""
    threads = speckle(rng, width_px, 1) * 5 + speckle(rng, 1, height_px) * 5
    flecks = np.where(rng.random((height_px, width_px)) > 0.985, 28, 0).astype(np.float32)
    return finished(tinted(colour_of(label), threads + speckle(rng, width_px, height_px) * 7 + flecks))


def metal(rng: Rng, width_px: int, height_px: int, label: str) -> Image:
    """Brushed metal."""
    lines = cv2.GaussianBlur(speckle(rng, width_px, height_px), (0, 0), sigmaX=9, sigmaY=0.5) * 16
    return finished(tinted(colour_of(label), lines + 8 * cloud(rng, width_px, height_px, height_px / 2)))


def plain(rng: Rng, width_px: int, height_px: int, label: str) -> Image:
    """One colour, hardly varied."""
    return finished(tinted(colour_of(label), 1.5 * cloud(rng, width_px, height_px, 16)))


def wood(rng: Rng, width_px: int, height_px: int, label: str) -> Image:
    """Boards along the width with grain, knots and gaps."""
    board_px = max(12, height_px // max(1, round(height_px / 48)))
    image = np.empty((height_px, width_px, 3), np.float32)
    for top in range(0, height_px, board_px):
        rows = min(board_px, height_px - top)
        grain = cv2.resize(speckle(rng, max(2, width_px // 24), rows), (width_px, rows), interpolation=cv2.INTER_CUBIC)
        wave = cloud(rng, width_px, rows, 40) * 10
        board = tinted(colour_of(label), grain * 7 + wave + float(rng.normal(0, 13)))
        joint = int(rng.integers(width_px))
        board[:, joint : joint + 2] -= 45
        board[:1] -= 35
        image[top : top + rows] = board
    for _ in range(max(1, width_px * height_px // 9_000)):
        centre = (int(rng.integers(width_px)), int(rng.integers(height_px)))
        knot = (np.asarray(colour_of(label)) * 0.55).tolist()
        cv2.ellipse(image, centre, (int(rng.integers(2, 7)), int(rng.integers(1, 4))), 0, 0, 360, knot, -1, cv2.LINE_AA)
    return finished(image)


def veneer(rng: Rng, width_px: int, height_px: int, label: str) -> Image:
    """Fine upright wood grain without boards: furniture and door leaves."""
    grain = cv2.resize(
        speckle(rng, width_px, max(2, height_px // 30)), (width_px, height_px), interpolation=cv2.INTER_CUBIC
    )
    return finished(tinted(colour_of(label), grain * 6 + 6 * cloud(rng, width_px, height_px, 30)))


def brick(rng: Rng, width_px: int, height_px: int, label: str) -> Image:
    """Bricks of 21 × 6.5 cm in running bond (at 150 px a metre), each with its own tone."""
    brick_w, brick_h = 33, 11
    image = tinted((188.0, 182.0, 172.0), speckle(rng, width_px, height_px) * 6)
    for row, top in enumerate(range(0, height_px, brick_h)):
        for left in range(-(row % 2) * brick_w // 2, width_px, brick_w):
            tone = np.asarray(colour_of(label)) + rng.normal(0, 16) + rng.normal(0, 5, 3)
            cv2.rectangle(image, (left + 1, top + 1), (left + brick_w - 2, top + brick_h - 2), tone.tolist(), -1)
    return finished(
        image + (speckle(rng, width_px, height_px) * 8 + cloud(rng, width_px, height_px, 90) * 8)[:, :, None]
    )


def carpet(rng: Rng, width_px: int, height_px: int, label: str) -> Image:
    """Carpet tiles of 50 cm (at 125 px a metre): speckle at several scales, tiles of other tones, never repeating."""
    base = np.asarray(colour_of(label))
    shade = (
        speckle(rng, width_px, height_px) * 11
        + cloud(rng, width_px, height_px, 9) * 18
        + cloud(rng, width_px, height_px, 60) * 9
    )
    image = tinted(colour_of(label), shade.astype(np.float32))
    tile_px = 63
    for top in range(0, height_px, tile_px):
        for left in range(0, width_px, tile_px):
            piece = image[top : top + tile_px, left : left + tile_px]
            piece += rng.normal(0, 9)
            if rng.random() < 0.13:
                piece += (np.roll(base, 1) - base) * 0.55
            piece[:1] -= 12
            piece[:, :1] -= 12
    _scatter(rng, image, width_px * height_px // 650, (1, 3))
    _scatter(rng, image, width_px * height_px // 900, (3, 6))
    return finished(image)


def terrazzo(rng: Rng, width_px: int, height_px: int, label: str) -> Image:
    """Polished floor with stone chips of many sizes and colours, in slabs of 1.2 m (at 125 px a metre)."""
    image = tinted(colour_of(label), 5 * cloud(rng, width_px, height_px, 40) + 3 * speckle(rng, width_px, height_px))
    _scatter(rng, image, width_px * height_px // 110, (1, 3))
    _scatter(rng, image, width_px * height_px // 700, (3, 7))
    image[::150] -= 40
    image[:, ::150] -= 40
    return finished(image)


def tiles(rng: Rng, width_px: int, height_px: int, label: str) -> Image:
    """Ceramic tiles of 15 cm (at 125 px a metre), glazed unevenly, some of them coloured."""
    base = np.asarray(colour_of(label))
    accents = [base * 0.72, np.array([72.0, 132.0, 150.0]), np.array([226.0, 226.0, 214.0])]
    image = np.full((height_px, width_px, 3), 128.0, np.float32)
    step = 19
    for top in range(0, height_px, step):
        for left in range(0, width_px, step):
            tone = base if rng.random() < 0.72 else accents[int(rng.integers(3))]
            image[top + 1 : top + step, left + 1 : left + step] = tone + rng.normal(0, 6)
    return finished(
        image + (3 * speckle(rng, width_px, height_px) + 6 * cloud(rng, width_px, height_px, 25))[:, :, None]
    )


def wallpaper(rng: Rng, width_px: int, height_px: int, label: str) -> Image:
    """Wallpaper of overlapping leaves and dots, each drawn once."""
    image = tinted(colour_of(label), 3 * speckle(rng, width_px, height_px))
    base = np.asarray(colour_of(label))
    for _ in range(width_px * height_px // 550):
        centre = (int(rng.integers(width_px)), int(rng.integers(height_px)))
        tone = (base * rng.uniform(0.55, 1.1) + rng.normal(0, 10, 3)).tolist()
        axes = (int(rng.integers(5, 16)), int(rng.integers(2, 5)))
        cv2.ellipse(image, centre, axes, float(rng.uniform(0, 180)), 0, 360, tone, -1, cv2.LINE_AA)
    return finished(image)


def cloth(rng: Rng, width_px: int, height_px: int, label: str) -> Image:
    """Clothes: checks of random widths, with prints here and there."""
    image = tinted(colour_of(label), 5 * speckle(rng, width_px, height_px))
    for axis, length in ((0, height_px), (1, width_px)):
        edges = np.cumsum(rng.integers(5, 22, 2 + length // 5))
        tones = rng.uniform(-38.0, 38.0, len(edges) + 1).astype(np.float32)
        band = tones[np.searchsorted(edges, np.arange(length), side="right")]
        image += band[:, None, None] if axis == 0 else band[None, :, None]
    for _ in range(1 + width_px * height_px // 900):
        centre = (int(rng.integers(width_px)), int(rng.integers(height_px)))
        tone = rng.uniform(20.0, 240.0, 3).tolist()
        cv2.ellipse(image, centre, (int(rng.integers(3, 8)), 3), float(rng.uniform(0, 180)), 0, 360, tone, -1)
    return finished(image)


def concrete(rng: Rng, width_px: int, height_px: int, label: str) -> Image:
    """Fair-faced concrete: stains, pores, tie holes, joints between the panels."""
    shade = 14 * cloud(rng, width_px, height_px, 110, 4) + 4 * speckle(rng, width_px, height_px)
    image = tinted(colour_of(label), shade)
    for _ in range(width_px * height_px // 1300):
        centre = (int(rng.integers(width_px)), int(rng.integers(height_px)))
        cv2.circle(image, centre, int(rng.integers(1, 3)), (70.0, 70.0, 70.0), -1, cv2.LINE_AA)
    for left in range(0, width_px, 120):
        image[:, left : left + 2] -= 40
        for top in range(30, height_px, 90):
            cv2.circle(image, (left + 20, top), 3, (60.0, 60.0, 62.0), -1, cv2.LINE_AA)
    return finished(image)


def ceiling(rng: Rng, width_px: int, height_px: int, label: str) -> Image:
    """Acoustic ceiling tiles of 60 cm (at 60 px a metre) with pores. It repeats without a seam."""
    image = tinted(colour_of(label), 2 * speckle(rng, width_px, height_px))
    pores = rng.random((height_px, width_px)) > 0.94
    image[pores] -= 38
    image[::36] -= 55
    image[:, ::36] -= 55
    return finished(image)


def leaf(rng: Rng, width_px: int, height_px: int, label: str) -> Image:
    """A green leaf with veins."""
    image = tinted(colour_of(label), 10 * cloud(rng, width_px, height_px, 10))
    vein = (np.asarray(colour_of(label)) * 1.35).clip(0, 255).tolist()
    middle = height_px // 2
    cv2.line(image, (0, middle), (width_px, middle), vein, 1, cv2.LINE_AA)
    for left in range(4, width_px, 8):
        cv2.line(image, (left, middle), (left + 6, 0), vein, 1, cv2.LINE_AA)
        cv2.line(image, (left, middle), (left + 6, height_px), vein, 1, cv2.LINE_AA)
    return finished(image)


def lamp(rng: Rng, width_px: int, height_px: int, label: str) -> Image:
    """A bright panel with a frame."""
    image = np.full((height_px, width_px, 3), (255.0, 253.0, 244.0), np.float32)
    image[:2] = image[-2:] = 170
    image[:, :2] = image[:, -2:] = 170
    return finished(image)


def _scatter(rng: Rng, image: NDArray[np.float32], count: int, radius_px: tuple[int, int]) -> None:
    """Draw chips of stone or flecks of wool: small turned triangles and quadrilaterals."""
    height_px, width_px = image.shape[:2]
    centres = rng.uniform(0, (width_px, height_px), (count, 2))
    angles = np.sort(rng.uniform(0, 2 * np.pi, (count, 4)), axis=1)
    radii = rng.uniform(*radius_px, (count, 1)) * rng.uniform(0.6, 1.2, (count, 4))
    points = centres[:, None, :] + np.stack([radii * np.cos(angles), radii * np.sin(angles)], axis=2)
    palette = np.array([[58, 54, 52], [228, 222, 208], [150, 104, 78], [96, 110, 122], [196, 170, 130], [40, 44, 50]])
    tones = palette[rng.integers(len(palette), size=count)] + rng.normal(0, 9, (count, 3))
    for chip, tone in zip(np.rint(points * 4).astype(np.int32), tones.tolist(), strict=True):
        cv2.fillConvexPoly(image, chip, tone, cv2.LINE_AA, shift=2)

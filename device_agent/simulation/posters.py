"""Painters of posters and notice boards: each picture is drawn from its own seed, so that no two are alike."""

from __future__ import annotations

import cv2
import numpy as np

from device_agent.simulation.lettering import INK, PAPER, write_lines, write_text
from device_agent.simulation.patterns import Colour, Image, Rng, cloud, finished, speckle, tinted

_PALETTES: tuple[tuple[Colour, ...], ...] = (
    ((245, 241, 230), (28, 43, 72), (214, 83, 60), (240, 180, 60), (70, 130, 140)),
    ((18, 30, 50), (240, 236, 220), (90, 170, 190), (232, 120, 70), (250, 205, 110)),
    ((250, 250, 248), (40, 40, 44), (0, 110, 170), (220, 60, 70), (120, 180, 90)),
    ((226, 214, 190), (70, 46, 38), (170, 60, 46), (52, 96, 88), (222, 160, 60)),
    ((64, 84, 60), (240, 234, 210), (206, 150, 60), (150, 60, 40), (160, 190, 150)),
    ((236, 220, 224), (60, 30, 70), (150, 70, 140), (230, 110, 120), (90, 120, 190)),
)
_WORDS = [
    "VISION",
    "ROUTE",
    "OFFICE",
    "SAFETY",
    "MEETING",
    "LIBRARY",
    "SUMMER",
    "TALK",
    "PROJECT",
    "DESIGN",
    "MUSIC",
    "CITY",
    "NATURE",
    "OPEN",
    "DAY",
    "TRAVEL",
    "NEW",
    "IDEAS",
    "TEAM",
    "HEALTH",
    "COFFEE",
    "RESEARCH",
    "MAP",
    "SCIENCE",
    "HISTORY",
    "LIGHT",
    "WATER",
    "NIGHT",
    "FORUM",
    "SPORT",
    "GARDEN",
    "RADIO",
    "CINEMA",
]


def poster(rng: Rng, width_px: int, height_px: int, label: str) -> Image:
    """A framed poster: a picture of one of five sorts, a title, some lines of text."""
    palette = _PALETTES[int(rng.integers(len(_PALETTES)))]
    image = np.full((height_px, width_px, 3), palette[0], np.float32)
    picture_h = int(height_px * rng.uniform(0.5, 0.72))
    drawers = (_shapes, _landscape, _chart, _street_map, _mosaic)
    image[:picture_h] = drawers[int(rng.integers(len(drawers)))](rng, width_px, picture_h, palette)
    title = " ".join(_WORDS[int(k)] for k in rng.integers(len(_WORDS), size=2))
    bottom = write_text(
        image, title, (int(0.06 * width_px), picture_h + int(0.03 * height_px)), int(0.88 * width_px), palette[1]
    )
    write_lines(
        rng, image, (int(0.06 * width_px), bottom + 4, int(0.88 * width_px), height_px - bottom - 12), palette[1]
    )
    cv2.rectangle(image, (0, 0), (width_px - 1, height_px - 1), (40.0, 38.0, 36.0), max(3, width_px // 45))
    return finished(image)


def notice_board(rng: Rng, width_px: int, height_px: int, label: str) -> Image:
    """Cork with sheets of paper pinned on it, some askew."""
    image = tinted((190.0, 150.0, 104.0), 14 * speckle(rng, width_px, height_px))
    sheet_w, sheet_h = width_px // 6, height_px // 3
    for left in range(8, width_px - sheet_w, int(sheet_w * 1.12)):
        for top in range(8, height_px - sheet_h, int(sheet_h * 1.1)):
            if rng.random() < 0.85:
                _pin_sheet(rng, image, left, top, sheet_w, sheet_h)
    cv2.rectangle(image, (0, 0), (width_px - 1, height_px - 1), (96.0, 72.0, 48.0), 6)
    return finished(image)


def _shapes(rng: Rng, width_px: int, height_px: int, palette: tuple[Colour, ...]) -> np.ndarray:
    image = np.full((height_px, width_px, 3), palette[int(rng.integers(1, 5))], np.float32)
    for _ in range(int(rng.integers(10, 22))):
        tone = palette[int(rng.integers(5))]
        centre = (int(rng.integers(width_px)), int(rng.integers(height_px)))
        radius = int(rng.uniform(0.04, 0.22) * width_px)
        if rng.random() < 0.4:
            cv2.circle(image, centre, radius, tone, -1, cv2.LINE_AA)
        else:
            angles = np.sort(rng.uniform(0, 2 * np.pi, int(rng.integers(3, 6))))
            points = np.stack([centre[0] + radius * np.cos(angles), centre[1] + radius * np.sin(angles)], axis=1)
            cv2.fillPoly(image, [np.rint(points).astype(np.int32)], tone, cv2.LINE_AA)
    return image


def _landscape(rng: Rng, width_px: int, height_px: int, palette: tuple[Colour, ...]) -> np.ndarray:
    image = tinted(palette[4], 40 * cloud(rng, width_px, height_px, width_px / 3, 4))
    for layer in range(4):
        ridge = height_px * (0.3 + 0.17 * layer) + 0.14 * height_px * cloud(rng, width_px, 1, width_px / 5, 4)[0]
        below = np.arange(height_px)[:, None] > ridge[None, :]
        tone = np.asarray(palette[1 + layer % 4]) * (0.55 + 0.15 * layer)
        image[below] = (tone + 26 * cloud(rng, width_px, height_px, 14, 3)[:, :, None])[below]
    cv2.circle(
        image,
        (int(rng.uniform(0.2, 0.8) * width_px), int(0.18 * height_px)),
        width_px // 11,
        (250.0, 230.0, 190.0),
        -1,
        cv2.LINE_AA,
    )
    return image


def _chart(rng: Rng, width_px: int, height_px: int, palette: tuple[Colour, ...]) -> np.ndarray:
    image = np.full((height_px, width_px, 3), PAPER, np.float32)
    bars = int(rng.integers(7, 13))
    for k in range(bars):
        left = int((0.08 + 0.86 * k / bars) * width_px)
        top = int(rng.uniform(0.2, 0.85) * height_px)
        cv2.rectangle(
            image, (left, top), (left + int(0.6 * width_px / bars), int(0.92 * height_px)), palette[1 + k % 4], -1
        )
    xs = np.linspace(0.06, 0.94, 14) * width_px
    points = np.stack([xs, rng.uniform(0.08, 0.6, 14) * height_px], axis=1)
    cv2.polylines(image, [np.rint(points).astype(np.int32)], False, palette[2], 2, cv2.LINE_AA)
    return image


def _street_map(rng: Rng, width_px: int, height_px: int, palette: tuple[Colour, ...]) -> np.ndarray:
    image = np.full((height_px, width_px, 3), (232.0, 228.0, 214.0), np.float32)
    for _ in range(26):
        centre = (int(rng.integers(width_px)), int(rng.integers(height_px)))
        cv2.ellipse(
            image,
            centre,
            (int(rng.integers(8, 34)), int(rng.integers(6, 20))),
            float(rng.uniform(0, 180)),
            0,
            360,
            palette[int(rng.integers(1, 5))],
            -1,
        )
    for _ in range(18):
        a, b = rng.uniform(-0.1, 1.1, (2, 2)) * (width_px, height_px)
        width = int(rng.integers(2, 6))
        cv2.line(image, (int(a[0]), int(a[1])), (int(b[0]), int(b[1])), INK, width + 2, cv2.LINE_AA)
        cv2.line(image, (int(a[0]), int(a[1])), (int(b[0]), int(b[1])), (255.0, 255.0, 252.0), width, cv2.LINE_AA)
    return image


def _mosaic(rng: Rng, width_px: int, height_px: int, palette: tuple[Colour, ...]) -> np.ndarray:
    cells = int(rng.integers(7, 12))
    tones = np.asarray(palette)[rng.integers(5, size=(max(2, cells * height_px // width_px), cells))]
    tones = tones * rng.uniform(0.75, 1.1, (*tones.shape[:2], 1))
    return cv2.resize(tones.astype(np.float32), (width_px, height_px), interpolation=cv2.INTER_NEAREST)


def _pin_sheet(rng: Rng, image: np.ndarray, left: int, top: int, width: int, height: int) -> None:
    sheet = np.full((height, width, 3), rng.uniform(215, 255, 3), np.float32)
    if rng.random() < 0.3:
        palette = _PALETTES[int(rng.integers(len(_PALETTES)))]
        sheet = _shapes(rng, width, height, palette)
    else:
        cv2.rectangle(sheet, (4, 4), (width - 5, 10), rng.uniform(0, 160, 3).tolist(), -1)
        write_lines(rng, sheet, (4, 15, width - 8, height - 18), INK)
    turn = cv2.getRotationMatrix2D((width / 2, height / 2), float(rng.normal(0, 5)), 1.0)
    turn[:, 2] += (left, top)
    size = (image.shape[1], image.shape[0])
    mask = cv2.warpAffine(np.ones((height, width), np.float32), turn, size)[:, :, None]
    image[:] = image * (1 - mask) + cv2.warpAffine(sheet, turn, size) * mask
    pin = (int(left + width / 2), top + 4)
    cv2.circle(image, pin, 3, rng.uniform(0, 220, 3).tolist(), -1, cv2.LINE_AA)

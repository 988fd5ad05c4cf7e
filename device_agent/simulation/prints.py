"""Painters of signs, doors, screens, books, bottles, windows and faces. See :mod:`patterns` for what a painter is."""

from __future__ import annotations

import cv2
import numpy as np

from device_agent.simulation.lettering import INK, PAPER, write_lines, write_text
from device_agent.simulation.patterns import Image, Rng, cloud, colour_of, finished, speckle, tinted, veneer


def sign(rng: Rng, width_px: int, height_px: int, label: str) -> Image:
    """A plate with the label in large letters; ``WC``, room numbers, names of places."""
    ground = (24.0, 70.0, 120.0) if label[:1].isdigit() else (28.0, 92.0, 84.0)
    image = tinted(ground, 2 * speckle(rng, width_px, height_px))
    write_text(
        image, label, (int(0.1 * width_px), int(0.2 * height_px)), int(0.8 * width_px), PAPER, int(0.6 * height_px)
    )
    cv2.rectangle(image, (2, 2), (width_px - 3, height_px - 3), PAPER, 2)
    return finished(image)


def exit_sign(rng: Rng, width_px: int, height_px: int, label: str) -> Image:
    """A lit escape sign: arrow and door."""
    image = np.full((height_px, width_px, 3), (20.0, 150.0, 80.0), np.float32)
    middle = height_px // 2
    white = (250.0, 255.0, 250.0)
    cv2.rectangle(
        image, (int(0.62 * width_px), int(0.15 * height_px)), (int(0.9 * width_px), int(0.85 * height_px)), white, -1
    )
    cv2.arrowedLine(
        image,
        (int(0.55 * width_px), middle),
        (int(0.1 * width_px), middle),
        white,
        max(2, height_px // 9),
        tipLength=0.4,
    )
    return finished(image)


def door(rng: Rng, width_px: int, height_px: int, label: str) -> Image:
    """A closed door in its frame: leaf, handle, kick plate, a plate with the label's number where it has one."""
    colour, _, text = label.partition(":")
    image = veneer(rng, width_px, height_px, colour).astype(np.float32)
    frame = max(4, width_px // 16)
    cv2.rectangle(image, (0, 0), (width_px - 1, height_px + frame), (92.0, 90.0, 88.0), frame)
    image[int(0.88 * height_px) : int(0.985 * height_px), frame : width_px - frame] = (168.0, 170.0, 172.0)
    cv2.rectangle(
        image,
        (int(0.83 * width_px), int(0.5 * height_px)),
        (int(0.88 * width_px), int(0.58 * height_px)),
        (60.0, 60.0, 62.0),
        -1,
    )
    cv2.line(
        image,
        (int(0.72 * width_px), int(0.52 * height_px)),
        (int(0.86 * width_px), int(0.52 * height_px)),
        (200.0, 200.0, 204.0),
        3,
    )
    if text:
        left, top, plate_w, plate_h = (
            int(0.3 * width_px),
            int(0.22 * height_px),
            int(0.4 * width_px),
            int(0.07 * height_px),
        )
        image[top : top + plate_h, left : left + plate_w] = (24.0, 70.0, 120.0)
        write_text(image, text, (left + 5, top + plate_h // 6), plate_w - 10, PAPER, int(0.66 * plate_h))
    return finished(image)


def screen(rng: Rng, width_px: int, height_px: int, label: str) -> Image:
    """A monitor that shows windows with text."""
    image = np.full((height_px, width_px, 3), (30.0, 60.0, 96.0), np.float32)
    for _ in range(3):
        left, top = int(rng.uniform(0.02, 0.4) * width_px), int(rng.uniform(0.04, 0.4) * height_px)
        w, h = int(0.52 * width_px), int(0.5 * height_px)
        cv2.rectangle(image, (left, top), (left + w, top + h), PAPER, -1)
        cv2.rectangle(image, (left, top), (left + w, top + 5), (200.0, 90.0, 60.0), -1)
        write_lines(rng, image, (left + 4, top + 9, w - 8, h - 12), INK)
    cv2.rectangle(image, (0, 0), (width_px - 1, height_px - 1), (22.0, 22.0, 24.0), 5)
    return finished(image)


def books(rng: Rng, width_px: int, height_px: int, label: str) -> Image:
    """A shelf unit, full of books and binders with titles on their spines."""
    image = np.full((height_px, width_px, 3), (58.0, 46.0, 38.0), np.float32)
    rows = max(2, round(height_px / 70))
    row_h = height_px // rows
    for row in range(rows):
        _book_row(rng, image[row * row_h + 4 : (row + 1) * row_h - 4])
        image[row * row_h : row * row_h + 4] = (176.0, 140.0, 100.0)
    return finished(image)


def bottles(rng: Rng, width_px: int, height_px: int, label: str) -> Image:
    """The back of a bar: shelves of bottles before a mirror."""
    image = tinted((120.0, 96.0, 80.0), 8 * cloud(rng, width_px, height_px, 30))
    rows = max(2, round(height_px / 60))
    row_h = height_px // rows
    for row in range(rows):
        base = (row + 1) * row_h - 5
        left = 5
        while left < width_px - 16:
            bottle_w, bottle_h = int(rng.integers(8, 15)), int(row_h * rng.uniform(0.45, 0.72))
            tone = rng.uniform(20, 200, 3).tolist()
            cv2.rectangle(image, (left, base - bottle_h), (left + bottle_w, base), tone, -1)
            neck = (left + bottle_w // 3, base - int(bottle_h * 1.25)), (left + 2 * bottle_w // 3, base - bottle_h)
            cv2.rectangle(image, neck[0], neck[1], tone, -1)
            label_top = base - int(bottle_h * 0.7)
            cv2.rectangle(
                image,
                (left, label_top),
                (left + bottle_w, base - int(bottle_h * 0.35)),
                rng.uniform(170, 255, 3).tolist(),
                -1,
            )
            left += bottle_w + int(rng.integers(2, 7))
        image[base : base + 5] = (220.0, 190.0, 140.0)
    return finished(image)


def window(rng: Rng, width_px: int, height_px: int, label: str) -> Image:
    """What is outside: sky, houses, trees, behind bars of the frame."""
    ramp = np.linspace(0, 1, height_px, dtype=np.float32)[:, None, None]
    image = (
        np.array([150, 190, 235], np.float32) * (1 - ramp) + np.array([232, 240, 246], np.float32) * ramp
    ) * np.ones((1, width_px, 1), np.float32)
    image += np.maximum(0, cloud(rng, width_px, height_px, 60, 3))[:, :, None] * 22
    for _ in range(max(3, width_px // 40)):
        _house(rng, image)
    for _ in range(width_px * height_px // 500):
        centre = (int(rng.integers(width_px)), int(height_px * rng.uniform(0.72, 1.0)))
        tone = (rng.uniform(30, 90), rng.uniform(80, 150), rng.uniform(30, 70))
        cv2.circle(image, centre, int(rng.integers(2, 8)), tone, -1, cv2.LINE_AA)
    for left in range(0, width_px, max(60, width_px // max(1, round(width_px / 130)))):
        image[:, left : left + 6] = 70
    image[:6] = image[-6:] = 70
    image[:, -6:] = 70
    return finished(image)


def vending(rng: Rng, width_px: int, height_px: int, label: str) -> Image:
    """The front of a vending machine."""
    image = np.full((height_px, width_px, 3), (176.0, 40.0, 44.0), np.float32)
    cv2.rectangle(image, (12, 14), (int(0.72 * width_px), int(0.78 * height_px)), (28.0, 30.0, 34.0), -1)
    for top in range(24, int(0.72 * height_px), 34):
        for left in range(18, int(0.68 * width_px), 16):
            tone = rng.uniform(40, 255, 3).tolist()
            cv2.rectangle(image, (left, top), (left + 11, top + 24), tone, -1)
            cv2.rectangle(image, (left + 2, top + 6), (left + 9, top + 14), (255 - np.asarray(tone)).tolist(), -1)
    cv2.rectangle(
        image,
        (int(0.8 * width_px), int(0.3 * height_px)),
        (int(0.94 * width_px), int(0.5 * height_px)),
        (200.0, 200.0, 205.0),
        -1,
    )
    cv2.rectangle(
        image, (20, int(0.84 * height_px)), (int(0.7 * width_px), int(0.94 * height_px)), (20.0, 20.0, 22.0), -1
    )
    return finished(image)


def face(rng: Rng, width_px: int, height_px: int, label: str) -> Image:
    """A head, roughly: skin below hair, two eyes and a mouth."""
    image = tinted(colour_of(label), 4 * cloud(rng, width_px, height_px, 10))
    image[: height_px // 3] = (52.0, 38.0, 30.0)
    for x in (0.3, 0.7):
        cv2.circle(image, (int(x * width_px), int(0.5 * height_px)), max(1, width_px // 14), (30.0, 30.0, 30.0), -1)
    cv2.line(
        image,
        (int(0.35 * width_px), int(0.78 * height_px)),
        (int(0.65 * width_px), int(0.78 * height_px)),
        (150.0, 60.0, 60.0),
        2,
    )
    return finished(image)


def _book_row(rng: Rng, row: np.ndarray) -> None:
    height, width = row.shape[:2]
    left = 4
    while left < width - 6:
        thick = int(rng.integers(4, 12))
        high = int(height * rng.uniform(0.62, 0.97))
        tone = rng.uniform(25, 225, 3)
        cv2.rectangle(row, (left, height - high), (min(width - 5, left + thick), height), tone.tolist(), -1)
        stripe = height - int(high * rng.uniform(0.4, 0.85))
        cv2.rectangle(
            row, (left + 1, stripe), (left + thick - 1, stripe + int(rng.integers(3, 12))), (255 - tone).tolist(), -1
        )
        left += thick + 1
        if rng.random() < 0.05:
            left += int(rng.integers(6, 20))


def _house(rng: Rng, image: np.ndarray) -> None:
    height_px, width_px = image.shape[:2]
    left, wide = int(rng.integers(-30, width_px)), int(rng.integers(30, 90))
    top = int(height_px * rng.uniform(0.25, 0.7))
    tone = rng.uniform(120, 215) + rng.normal(0, 12, 3)
    cv2.rectangle(image, (left, top), (left + wide, height_px), tone.tolist(), -1)
    for y in range(top + 6, height_px - 8, 14):
        for x in range(left + 5, left + wide - 7, 12):
            cv2.rectangle(image, (x, y), (x + 6, y + 8), (tone * rng.uniform(0.4, 0.8)).tolist(), -1)

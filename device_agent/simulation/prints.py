"""Painters of what hangs on walls and stands on shelves: posters, notices, signs, doors, screens, books, windows.

Each picture is drawn from its own seed, so that no two are alike: a place can be told by them. See :mod:`patterns`
for what a painter is.
"""

from __future__ import annotations

import cv2
import numpy as np

from device_agent.simulation.patterns import Colour, Image, Rng, cloud, colour_of, finished, speckle, tinted, veneer

_PALETTES: tuple[tuple[Colour, ...], ...] = (
    ((245, 241, 230), (28, 43, 72), (214, 83, 60), (240, 180, 60), (70, 130, 140)),
    ((18, 30, 50), (240, 236, 220), (90, 170, 190), (232, 120, 70), (250, 205, 110)),
    ((250, 250, 248), (40, 40, 44), (0, 110, 170), (220, 60, 70), (120, 180, 90)),
    ((226, 214, 190), (70, 46, 38), (170, 60, 46), (52, 96, 88), (222, 160, 60)),
    ((64, 84, 60), (240, 234, 210), (206, 150, 60), (150, 60, 40), (160, 190, 150)),
    ((236, 220, 224), (60, 30, 70), (150, 70, 140), (230, 110, 120), (90, 120, 190)),
)
_WORDS = ["VISION", "ROUTE", "OFFICE", "SAFETY", "MEETING", "LIBRARY", "SUMMER", "TALK", "PROJECT", "DESIGN", "MUSIC", "CITY", "NATURE", "OPEN", "DAY", "TRAVEL", "NEW", "IDEAS", "TEAM", "HEALTH", "COFFEE", "RESEARCH", "MAP", "SCIENCE", "HISTORY", "LIGHT", "WATER", "NIGHT", "FORUM", "SPORT", "GARDEN", "RADIO", "CINEMA"]
_PAPER: Colour = (248.0, 247.0, 242.0)
_INK: Colour = (34.0, 36.0, 42.0)


def poster(rng: Rng, width_px: int, height_px: int, label: str) -> Image:
    """A framed poster: a picture of one of five sorts, a title, some lines of text."""
    palette = _PALETTES[int(rng.integers(len(_PALETTES)))]
    image = np.full((height_px, width_px, 3), palette[0], np.float32)
    picture_h = int(height_px * rng.uniform(0.5, 0.72))
    drawers = (_shapes, _landscape, _chart, _street_map, _mosaic)
    image[:picture_h] = drawers[int(rng.integers(len(drawers)))](rng, width_px, picture_h, palette)
    title = " ".join(_WORDS[int(k)] for k in rng.integers(len(_WORDS), size=2))
    bottom = _write(
        image, title, (int(0.06 * width_px), picture_h + int(0.03 * height_px)), int(0.88 * width_px), palette[1]
    )
    _text_lines(
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


def sign(rng: Rng, width_px: int, height_px: int, label: str) -> Image:
    """A plate with the label in large letters; ``WC``, room numbers, names of places."""
    ground = (24.0, 70.0, 120.0) if label[:1].isdigit() else (28.0, 92.0, 84.0)
    image = tinted(ground, 2 * speckle(rng, width_px, height_px))
    _write(image, label, (int(0.1 * width_px), int(0.2 * height_px)), int(0.8 * width_px), _PAPER, int(0.6 * height_px))
    cv2.rectangle(image, (2, 2), (width_px - 3, height_px - 3), _PAPER, 2)
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
        _write(image, text, (left + 5, top + plate_h // 6), plate_w - 10, _PAPER, int(0.66 * plate_h))
    return finished(image)


def screen(rng: Rng, width_px: int, height_px: int, label: str) -> Image:
    """A monitor that shows windows with text."""
    image = np.full((height_px, width_px, 3), (30.0, 60.0, 96.0), np.float32)
    for _ in range(3):
        left, top = int(rng.uniform(0.02, 0.4) * width_px), int(rng.uniform(0.04, 0.4) * height_px)
        w, h = int(0.52 * width_px), int(0.5 * height_px)
        cv2.rectangle(image, (left, top), (left + w, top + h), _PAPER, -1)
        cv2.rectangle(image, (left, top), (left + w, top + 5), (200.0, 90.0, 60.0), -1)
        _text_lines(rng, image, (left + 4, top + 9, w - 8, h - 12), _INK)
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
    image = np.full((height_px, width_px, 3), _PAPER, np.float32)
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
        cv2.line(image, (int(a[0]), int(a[1])), (int(b[0]), int(b[1])), _INK, width + 2, cv2.LINE_AA)
        cv2.line(image, (int(a[0]), int(a[1])), (int(b[0]), int(b[1])), (255.0, 255.0, 252.0), width, cv2.LINE_AA)
    return image


def _mosaic(rng: Rng, width_px: int, height_px: int, palette: tuple[Colour, ...]) -> np.ndarray:
    cells = int(rng.integers(7, 12))
    tones = np.asarray(palette)[rng.integers(5, size=(max(2, cells * height_px // width_px), cells))]
    tones = tones * rng.uniform(0.75, 1.1, (*tones.shape[:2], 1))
    return cv2.resize(tones.astype(np.float32), (width_px, height_px), interpolation=cv2.INTER_NEAREST)


def _write(image: np.ndarray, text: str, at: tuple[int, int], width_px: int, colour: Colour, height_px: int = 0) -> int:
    """Write text as wide as asked (and not higher); return the row below it."""
    (full_w, full_h), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_DUPLEX, 1.0, 2)
    scale = width_px / max(1, full_w)
    if height_px:
        scale = min(scale, height_px / full_h)
    base = at[1] + int(full_h * scale)
    left = at[0] + int((width_px - full_w * scale) / 2)
    # Text is drawn on 8-bit images only: as a mask, then.
    mask = np.zeros(image.shape[:2], np.uint8)
    cv2.putText(mask, text, (left, base), cv2.FONT_HERSHEY_DUPLEX, scale, 255, max(1, round(2 * scale)), cv2.LINE_AA)
    share = mask[:, :, None].astype(np.float32) / 255
    image[:] = image * (1 - share) + np.asarray(colour, np.float32) * share
    return base + int(0.3 * full_h * scale)


def _text_lines(rng: Rng, image: np.ndarray, area: tuple[int, int, int, int], colour: Colour) -> None:
    """Fill an area (left, top, width, height) with lines of words, too small to read."""
    left, top, width, height = area
    for y in range(top, top + height - 4, 8):
        x = left
        while x < left + width - 8:
            word = int(rng.integers(5, 22))
            if x + word > left + width:
                break
            cv2.rectangle(image, (x, y), (x + word, y + int(rng.integers(2, 4))), colour, -1)
            x += word + 4


def _pin_sheet(rng: Rng, image: np.ndarray, left: int, top: int, width: int, height: int) -> None:
    sheet = np.full((height, width, 3), rng.uniform(215, 255, 3), np.float32)
    if rng.random() < 0.3:
        palette = _PALETTES[int(rng.integers(len(_PALETTES)))]
        sheet = _shapes(rng, width, height, palette)
    else:
        cv2.rectangle(sheet, (4, 4), (width - 5, 10), rng.uniform(0, 160, 3).tolist(), -1)
        _text_lines(rng, sheet, (4, 15, width - 8, height - 18), _INK)
    turn = cv2.getRotationMatrix2D((width / 2, height / 2), float(rng.normal(0, 5)), 1.0)
    turn[:, 2] += (left, top)
    size = (image.shape[1], image.shape[0])
    mask = cv2.warpAffine(np.ones((height, width), np.float32), turn, size)[:, :, None]
    image[:] = image * (1 - mask) + cv2.warpAffine(sheet, turn, size) * mask
    pin = (int(left + width / 2), top + 4)
    cv2.circle(image, pin, 3, rng.uniform(0, 220, 3).tolist(), -1, cv2.LINE_AA)


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

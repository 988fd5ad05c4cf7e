"""Corners spread evenly over an image: FAST-9 with the best few of every cell.

FAST calls a pixel a corner where nine contiguous pixels of the sixteen on a circle of radius 3 are all brighter, or all
darker, than the centre by a threshold (Rosten and Drummond 2006); its score is the largest such threshold. Cells share
the quota by turns, so that a poster does not take all features from a plain wall.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from navcore.compiled import kernel
from navcore.slam.keyframes import ByteArray, IntArray

BORDER_PX = 16
"""No corner is nearer to the image's edge: the descriptor's patch must fit."""
CELL_PX = 24
"""Side of the cells that share the quota."""
PER_CELL = 6
"""At most so many corners of one cell."""

CIRCLE_X: IntArray = np.array([0, 1, 2, 3, 3, 3, 2, 1, 0, -1, -2, -3, -3, -3, -2, -1], np.int32)
CIRCLE_Y: IntArray = np.array([-3, -3, -2, -1, 0, 1, 2, 3, 3, 3, 2, 1, 0, -1, -2, -3], np.int32)


def _contiguous_nine() -> NDArray[np.bool_]:
    flags = np.arange(1 << 16, dtype=np.uint32)
    doubled = flags | (flags << np.uint32(16))
    run = doubled.copy()
    for _ in range(8):
        run &= np.right_shift(doubled, 1)
        doubled = np.right_shift(doubled, 1)
    return np.asarray((run & np.uint32(0xFFFF)) != 0, dtype=np.bool_)


HAS_NINE: NDArray[np.bool_] = _contiguous_nine()
"""(65536,): whether sixteen flags on a circle have nine contiguous ones set."""


@kernel
def corner_strength(image: ByteArray, low: int, strength: ByteArray) -> None:
    """Write an upper bound of each pixel's FAST score, 0 where it is not above ``low``; the border is left alone.

    Of every two opposite pixels of the circle an arc of nine holds at least one, so the score is at most the smallest,
    over the eight pairs, of the larger difference. Written over row slices so that the compiler uses vectors of bytes.
    """
    height, width = image.shape
    n = width - 2 * BORDER_PX
    b = BORDER_PX
    for y in range(b, height - b):
        a0, b0 = image[y - 3, b : b + n], image[y + 3, b : b + n]
        a1, b1 = image[y - 3, b + 1 : b + 1 + n], image[y + 3, b - 1 : b - 1 + n]
        a2, b2 = image[y - 2, b + 2 : b + 2 + n], image[y + 2, b - 2 : b - 2 + n]
        a3, b3 = image[y - 1, b + 3 : b + 3 + n], image[y + 1, b - 3 : b - 3 + n]
        a4, b4 = image[y, b + 3 : b + 3 + n], image[y, b - 3 : b - 3 + n]
        a5, b5 = image[y + 1, b + 3 : b + 3 + n], image[y - 1, b - 3 : b - 3 + n]
        a6, b6 = image[y + 2, b + 2 : b + 2 + n], image[y - 2, b - 2 : b - 2 + n]
        a7, b7 = image[y + 3, b + 1 : b + 1 + n], image[y - 3, b - 1 : b - 1 + n]
        centre_row, out = image[y, b : b + n], strength[y, b : b + n]
        for i in range(n):
            centre = centre_row[i]
            bright = min(max(a0[i], b0[i]), max(a1[i], b1[i]))
            bright = min(bright, min(max(a2[i], b2[i]), max(a3[i], b3[i])))
            bright = min(bright, min(max(a4[i], b4[i]), max(a5[i], b5[i])))
            bright = min(bright, min(max(a6[i], b6[i]), max(a7[i], b7[i])))
            dark = max(min(a0[i], b0[i]), min(a1[i], b1[i]))
            dark = max(dark, max(min(a2[i], b2[i]), min(a3[i], b3[i])))
            dark = max(dark, max(min(a4[i], b4[i]), min(a5[i], b5[i])))
            dark = max(dark, max(min(a6[i], b6[i]), min(a7[i], b7[i])))
            bound = max(np.uint8(max(bright, centre) - centre), np.uint8(centre - min(dark, centre)))
            out[i] = bound if bound > low else np.uint8(0)


@kernel
def _score_if_corner(
    image: ByteArray, y: int, x: int, threshold: int, has_nine: NDArray[np.bool_], ring: IntArray
) -> int:
    """Return the largest threshold at which the pixel is a corner, 0 where that is not above ``threshold``.

    ``ring`` is scratch (25,): the differences, the first nine repeated at the end.
    """
    centre = np.int32(image[y, x])
    bright, dark = 0, 0
    for i in range(16):
        difference = np.int32(image[y + CIRCLE_Y[i], x + CIRCLE_X[i]]) - centre
        ring[i] = difference
        bright |= (1 if difference > threshold else 0) << i
        dark |= (1 if difference < -threshold else 0) << i
    if has_nine[bright]:
        sign = 1
    elif has_nine[dark]:
        sign = -1
    else:
        return 0
    for i in range(16):
        ring[i] *= sign
    for i in range(9):
        ring[16 + i] = ring[i]
    # Minimum over runs of nine by doubling: runs of 3, then three of them.
    for i in range(23):
        ring[i] = min(ring[i], min(ring[i + 1], ring[i + 2]))
    best = 0
    for i in range(16):
        best = max(best, min(ring[i], min(ring[i + 3], ring[i + 6])))
    return best


@kernel
def find_corners(
    image: ByteArray,
    strength: ByteArray,
    score: ByteArray,
    high: int,
    low: int,
    quota: int,
    has_nine: NDArray[np.bool_],
) -> IntArray:
    """Return up to ``quota`` corners (n, 3) as x, y, score, spread over the cells.

    ``strength`` and ``score`` are scratch images of the same size; ``score`` must be zero on entry and is zero again on
    return. A cell without a corner at threshold ``high`` is searched again at ``low``.
    """
    height, width = image.shape
    corner_strength(image, low, strength)
    rows = max(1, (height - 2 * BORDER_PX + CELL_PX - 1) // CELL_PX)
    columns = max(1, (width - 2 * BORDER_PX + CELL_PX - 1) // CELL_PX)
    ring = np.zeros(25, np.int32)
    found = np.empty((rows * columns * CELL_PX * CELL_PX // 4, 2), np.int32)
    count = 0
    for row in range(rows):
        for column in range(columns):
            y0, x0 = BORDER_PX + row * CELL_PX, BORDER_PX + column * CELL_PX
            y1, x1 = min(y0 + CELL_PX, height - BORDER_PX), min(x0 + CELL_PX, width - BORDER_PX)
            for threshold in (high, low):
                before = count
                for y in range(y0, y1):
                    for x in range(x0, x1):
                        if strength[y, x] > threshold and count < len(found):
                            value = _score_if_corner(image, y, x, threshold, has_nine, ring)
                            if value > threshold:
                                score[y, x] = value
                                found[count, 0] = x
                                found[count, 1] = y
                                count += 1
                if count > before:
                    break
    corners = _best_of_cells(score, found[:count], rows, columns, quota)
    for i in range(count):
        score[found[i, 1], found[i, 0]] = 0
    return corners


@kernel
def _is_peak(score: ByteArray, x: int, y: int) -> bool:
    value = score[y, x]
    for dy in range(-1, 2):
        for dx in range(-1, 2):
            neighbour = score[y + dy, x + dx]
            # Of two equal neighbours the first in reading order is the peak.
            if neighbour > value or (neighbour == value and (dy < 0 or (dy == 0 and dx < 0))):
                return False
    return True


@kernel
def _best_of_cells(score: ByteArray, found: IntArray, rows: int, columns: int, quota: int) -> IntArray:
    best = np.zeros((rows * columns, PER_CELL, 3), np.int32)
    held = np.zeros(rows * columns, np.int32)
    for i in range(len(found)):
        x, y = found[i, 0], found[i, 1]
        if not _is_peak(score, x, y):
            continue
        value = np.int32(score[y, x])
        cell = (y - BORDER_PX) // CELL_PX * columns + (x - BORDER_PX) // CELL_PX
        place = held[cell]
        while place > 0 and best[cell, place - 1, 2] < value:
            place -= 1
        if place == PER_CELL:
            continue
        last = min(held[cell], PER_CELL - 1)
        for j in range(last, place, -1):
            best[cell, j] = best[cell, j - 1]
        best[cell, place, 0] = x
        best[cell, place, 1] = y
        best[cell, place, 2] = value
        held[cell] = last + 1
    return _by_turns(best, held, quota)


@kernel
def _by_turns(best: IntArray, held: IntArray, quota: int) -> IntArray:
    """Take the best of every cell, then the second best of every cell, …; the last turn goes by score."""
    result = np.empty((quota, 3), np.int32)
    taken = 0
    for turn in range(PER_CELL):
        cells = np.flatnonzero(held > turn)
        if len(cells) == 0:
            break
        if taken + len(cells) > quota:
            scores = np.empty(len(cells), np.int64)
            for i in range(len(cells)):
                scores[i] = -np.int64(best[cells[i], turn, 2]) * 1_000_000 + cells[i]
            cells = cells[np.sort(np.argsort(scores)[: quota - taken])]
        for i in range(len(cells)):
            result[taken] = best[cells[i], turn]
            taken += 1
        if taken == quota:
            break
    return result[:taken]

"""Corners spread evenly over an image: FAST-9 with the best few of every cell.

FAST calls a pixel a corner where nine contiguous pixels of the sixteen on a circle of radius 3 are all brighter, or all
darker, than the centre by a threshold (Rosten and Drummond 2006); its score is the largest difference that all nine
reach. The score is computed for every pixel, without branches, so that the compiler makes it thirty-two pixels at a
time: that is faster than to look for candidates first. Cells share the quota by turns, so that a poster does not take
all features from a plain wall.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from navcore.compiled import kernel
from navcore.slam.keyframes import ByteArray, IntArray

RankArray = NDArray[np.int64]

BORDER_PX = 16
"""No corner is nearer to the image's edge: the descriptor's patch must fit."""
CELL_PX = 24
"""Side of the cells that share the quota."""
PER_CELL = 6
"""At most so many corners of one cell."""
RANK_UNIT = 1 << 40
"""A corner is kept as one number, its rank: score · RANK_UNIT + (RANK_UNIT − 1 − place in reading order). Of equal
scores the first in reading order ranks higher."""


@kernel
def find_corners(image: ByteArray, score: ByteArray, high: int, low: int, quota: int) -> IntArray:
    """Return up to ``quota`` corners (n, 3) of an image (h, w) as x, y, score, spread over the cells.

    A cell without a corner above ``high`` gives those above ``low``. ``score`` (h, w) is scratch; its border of
    BORDER_PX must be zero, and stays so.
    """
    height, width = image.shape
    for y in range(BORDER_PX, height - BORDER_PX):
        score_row(image, y, score)
    return _by_turns(_best_of_cells(score, high, low), high, quota, width)


@kernel
def _best_of_cells(score: ByteArray, high: int, low: int) -> RankArray:
    """Return the ranks (cells, PER_CELL) of the best corners of every cell, best first, 0 where there is none."""
    height, width = score.shape
    rows = max(1, (height - 2 * BORDER_PX + CELL_PX - 1) // CELL_PX)
    columns = max(1, (width - 2 * BORDER_PX + CELL_PX - 1) // CELL_PX)
    best = np.zeros((rows * columns, PER_CELL), np.int64)
    peaks = np.zeros((width + 7) // 8 * 8, np.uint8)
    eight_peaks = peaks.view(np.uint64)
    column_of = np.empty(len(peaks), np.uintp)
    for x in range(len(peaks)):
        column_of[x] = min(max(x - BORDER_PX, 0) // CELL_PX, columns - 1)
    for y in range(BORDER_PX, height - BORDER_PX):
        _peaks_of_row(score, y, np.uint8(low), peaks)
        first_cell = np.uintp((y - BORDER_PX) // CELL_PX * columns)
        for block in range(np.uintp(len(eight_peaks))):
            if eight_peaks[block] == 0:
                continue
            for x in range(np.uintp(8) * block, np.uintp(8) * block + np.uintp(8)):
                value = np.int64(peaks[x])
                cell = first_cell + column_of[x]
                if value > high or (value > 0 and best[cell, 0] < (high + 1) * RANK_UNIT):
                    _keep_best(best, cell, (value + 1) * RANK_UNIT - 1 - (y * width + np.int64(x)))
    return best


@kernel
def score_row(image: ByteArray, y: int, score: ByteArray) -> None:
    """Write the FAST-9 score of the pixels of one row, 0 where there is no corner; the border is left alone.

    The smallest of the nine pixels of an arc, largest over all sixteen arcs, is how bright a centre may be and still be
    a dark corner; likewise for bright ones. Two neighbouring arcs share eight pixels, and so their minimum.
    """
    width = image.shape[1]
    # Unsigned places into one flat array: with them the compiler sees that it can take many pixels at once.
    flat, out = image.reshape(-1), score.reshape(-1)
    middle = y * width + BORDER_PX
    at = np.uintp(middle)
    i0, i8 = np.uintp(middle - 3 * width), np.uintp(middle + 3 * width)
    i1, i9 = np.uintp(middle - 3 * width + 1), np.uintp(middle + 3 * width - 1)
    i2, i10 = np.uintp(middle - 2 * width + 2), np.uintp(middle + 2 * width - 2)
    i3, i11 = np.uintp(middle - width + 3), np.uintp(middle + width - 3)
    i4, i12 = np.uintp(middle + 3), np.uintp(middle - 3)
    i5, i13 = np.uintp(middle + width + 3), np.uintp(middle - width - 3)
    i6, i14 = np.uintp(middle + 2 * width + 2), np.uintp(middle - 2 * width - 2)
    i7, i15 = np.uintp(middle + 3 * width + 1), np.uintp(middle - 3 * width - 1)
    for x in range(np.uintp(max(width - 2 * BORDER_PX, 0))):
        p0, p1, p2, p3 = flat[i0 + x], flat[i1 + x], flat[i2 + x], flat[i3 + x]
        p4, p5, p6, p7 = flat[i4 + x], flat[i5 + x], flat[i6 + x], flat[i7 + x]
        p8, p9, p10, p11 = flat[i8 + x], flat[i9 + x], flat[i10 + x], flat[i11 + x]
        p12, p13, p14, p15 = flat[i12 + x], flat[i13 + x], flat[i14 + x], flat[i15 + x]
        two1, two3, two5, two7 = min(p1, p2), min(p3, p4), min(p5, p6), min(p7, p8)
        two9, two11, two13, two15 = min(p9, p10), min(p11, p12), min(p13, p14), min(p15, p0)
        four1, four3, four5, four7 = min(two1, two3), min(two3, two5), min(two5, two7), min(two7, two9)
        four9, four11, four13, four15 = min(two9, two11), min(two11, two13), min(two13, two15), min(two15, two1)
        bright = min(min(four1, four5), max(p0, p9))
        bright = max(bright, min(min(four3, four7), max(p2, p11)))
        bright = max(bright, min(min(four5, four9), max(p4, p13)))
        bright = max(bright, min(min(four7, four11), max(p6, p15)))
        bright = max(bright, min(min(four9, four13), max(p8, p1)))
        bright = max(bright, min(min(four11, four15), max(p10, p3)))
        bright = max(bright, min(min(four13, four1), max(p12, p5)))
        bright = max(bright, min(min(four15, four3), max(p14, p7)))
        two1, two3, two5, two7 = max(p1, p2), max(p3, p4), max(p5, p6), max(p7, p8)
        two9, two11, two13, two15 = max(p9, p10), max(p11, p12), max(p13, p14), max(p15, p0)
        four1, four3, four5, four7 = max(two1, two3), max(two3, two5), max(two5, two7), max(two7, two9)
        four9, four11, four13, four15 = max(two9, two11), max(two11, two13), max(two13, two15), max(two15, two1)
        dark = max(max(four1, four5), min(p0, p9))
        dark = min(dark, max(max(four3, four7), min(p2, p11)))
        dark = min(dark, max(max(four5, four9), min(p4, p13)))
        dark = min(dark, max(max(four7, four11), min(p6, p15)))
        dark = min(dark, max(max(four9, four13), min(p8, p1)))
        dark = min(dark, max(max(four11, four15), min(p10, p3)))
        dark = min(dark, max(max(four13, four1), min(p12, p5)))
        dark = min(dark, max(max(four15, four3), min(p14, p7)))
        centre = flat[at + x]
        out[at + x] = max(np.uint8(max(bright, centre) - centre), np.uint8(centre - min(dark, centre)))


@kernel
def _peaks_of_row(score: ByteArray, y: int, low: np.uint8, peaks: ByteArray) -> None:
    """Write the scores of one row that are above ``low`` and the highest of their 3×3 pixels, 0 elsewhere."""
    width = score.shape[1]
    flat = score.reshape(-1)
    above, below = np.uintp((y - 1) * width), np.uintp((y + 1) * width)
    row, one = np.uintp(y * width), np.uintp(1)
    for x in range(np.uintp(BORDER_PX), np.uintp(max(width - BORDER_PX, BORDER_PX))):
        # Of two equal neighbours the first in reading order is the peak.
        before = max(max(flat[above + x - one], flat[above + x]), max(flat[above + x + one], flat[row + x - one]))
        after = max(max(flat[below + x - one], flat[below + x]), max(flat[below + x + one], flat[row + x + one]))
        value = flat[row + x]
        peaks[x] = value if (value > max(before, low)) & (value >= after) else np.uint8(0)


@kernel
def _keep_best(best: RankArray, cell: int, rank: int) -> None:
    """Put a corner among the best of its cell."""
    one = np.uintp(1)
    place = np.uintp(PER_CELL - 1)
    if best[cell, place] >= rank:
        return
    while place > 0 and best[cell, place - one] < rank:
        best[cell, place] = best[cell, place - one]
        place -= one
    best[cell, place] = rank


@kernel
def _by_turns(best: RankArray, high: int, quota: int, width: int) -> IntArray:
    """Take the best of every cell, then the second best of every cell, …; the last turn goes by score."""
    corners = np.empty((quota, 3), np.int32)
    ranks = np.empty(len(best), np.int64)
    clear = (high + 1) * RANK_UNIT
    taken = 0
    for turn in range(PER_CELL):
        count = 0
        for cell in range(len(best)):
            rank = best[cell, turn]
            if rank >= clear or (rank > 0 and best[cell, 0] < clear):
                ranks[count] = rank
                count += 1
        least = _least_taken(ranks[:count], quota - taken) if count > quota - taken else 0
        for rank in ranks[:count]:
            if rank >= least:
                place = RANK_UNIT - 1 - rank % RANK_UNIT
                corners[taken, 0] = place % width
                corners[taken, 1] = place // width
                corners[taken, 2] = rank // RANK_UNIT
                taken += 1
        if count == 0 or taken == quota:
            break
    return corners[:taken]


@kernel
def _least_taken(ranks: RankArray, wanted: int) -> int:
    """Return the rank from which on just ``wanted`` are taken; ranks differ from each other."""
    of_score = np.zeros(257, np.int64)
    for rank in ranks:
        of_score[rank // RANK_UNIT] += 1
    score, above = 256, 0
    while score > 0 and above + of_score[score - 1] <= wanted:
        score -= 1
        above += of_score[score]
    least = score * RANK_UNIT
    # Of the next lower score only the first in reading order are taken.
    for _ in range(wanted - above):
        highest = 0
        for rank in ranks:
            if highest < rank < least:
                highest = rank
        least = highest
    return least

"""Binary descriptors: 256 comparisons around a corner, turned with its orientation, and their distance.

The orientation is that of the intensity centroid; the comparisons look at the image smoothed by a 5×5 box (Rublee et
al. 2011, ORB). A box costs a fifth of a Gaussian and matches as well; its sums need no division, for only their order
counts. Which points are compared: :func:`navcore.slam.pattern.comparison_pattern`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from navcore.compiled import kernel
from navcore.geometry import FloatArray
from navcore.slam.keyframes import ByteArray, IntArray
from navcore.slam.pattern import comparison_pattern

WordArray = NDArray[np.uint64]
ShortArray = NDArray[np.int16]
PlaceArray = NDArray[np.int32]
SumArray = NDArray[np.uint16]

DISC_RADIUS_PX = 15
"""Radius of the disc whose intensity centroid gives the orientation."""
ROW_PX = 32
"""Pixels of a row of the disc that are read: one more than it has, a round number for the compiler."""
TURN_COUNT = 64
"""The comparisons are kept turned to so many orientations."""


def turned_pattern() -> NDArray[np.int8]:
    """Return (TURN_COUNT, 512, 2): x, y of the points of all comparisons, turned."""
    points = comparison_pattern().reshape(-1, 2).astype(np.float64)
    angles = np.arange(TURN_COUNT) * (2 * np.pi / TURN_COUNT)
    c, s = np.cos(angles)[:, None], np.sin(angles)[:, None]
    turned = np.stack([c * points[:, 0] - s * points[:, 1], s * points[:, 0] + c * points[:, 1]], axis=2)
    return np.round(turned).astype(np.int8)


def pattern_places(width_px: int) -> PlaceArray:
    """Return (TURN_COUNT, 512): where the points of all comparisons lie from the corner in a flat image, turned."""
    points = turned_pattern().astype(np.int32)
    return np.ascontiguousarray(points[:, :, 1] * width_px + points[:, :, 0], dtype=np.int32)


def disc_weights() -> tuple[ShortArray, ShortArray]:
    """Return (16, ROW_PX) twice, for rows 0 to 15 of the disc: x of its pixels, and ones; 0 outside."""
    rows = np.arange(DISC_RADIUS_PX + 1)
    x = np.arange(ROW_PX) - DISC_RADIUS_PX
    half = np.sqrt((DISC_RADIUS_PX + 0.5) ** 2 - rows**2).clip(0, DISC_RADIUS_PX).astype(int)
    inside = (np.abs(x) <= half[:, None]).astype(np.int16)
    return np.ascontiguousarray(inside * x.astype(np.int16)), np.ascontiguousarray(inside)


def as_words(descriptors: NDArray[np.uint8]) -> WordArray:
    """Return descriptors (n, 32) bytes as (n, 4) words of 64 bits."""
    return np.ascontiguousarray(descriptors).view(np.uint64)


# --------------------------------------------------------------------------------------------------- kernels
@kernel
def bit_distance(a: WordArray, b: WordArray) -> int:
    """Return the Hamming distance of two descriptors (4,) of 64-bit words."""
    total = np.uint64(0)
    for i in range(4):
        v = a[i] ^ b[i]
        v = v - ((v >> np.uint64(1)) & np.uint64(0x5555555555555555))
        v = (v & np.uint64(0x3333333333333333)) + ((v >> np.uint64(2)) & np.uint64(0x3333333333333333))
        v = (v + (v >> np.uint64(4))) & np.uint64(0x0F0F0F0F0F0F0F0F)
        total += (v * np.uint64(0x0101010101010101)) >> np.uint64(56)
    return int(total)


@kernel
def describe(
    image: ByteArray,
    sums: SumArray,
    corners: IntArray,
    places: PlaceArray,
    disc_x: ShortArray,
    disc: ShortArray,
) -> tuple[FloatArray, WordArray]:
    """Return orientation (n,) in radians and descriptors (n, 4) of corners (n, ≥2) of one pyramid level.

    ``sums`` (h, w) is scratch; ``places``, ``disc_x`` and ``disc`` are the tables of :func:`pattern_places` and
    :func:`disc_weights`.
    """
    angles = np.empty(len(corners), np.float64)
    words = np.empty((len(corners), 4), np.uint64)
    if len(corners) > 0:
        box_sums(image, sums)
    for i in range(len(corners)):
        angles[i] = orientation(image, corners[i, 0], corners[i, 1], disc_x, disc)
        turn = int(np.floor(angles[i] * TURN_COUNT / (2 * np.pi) + 0.5)) % TURN_COUNT
        _compare(sums, corners[i, 1] * image.shape[1] + corners[i, 0], places, turn, words[i])
    return angles, words


@kernel
def box_sums(image: ByteArray, sums: SumArray) -> None:
    """Write the sums of 5×5 pixels; the outermost two rows and columns are left alone."""
    height, width = image.shape
    flat, out = image.reshape(-1), sums.reshape(-1)
    column = np.empty(width, np.uint16)
    one, two = np.uintp(1), np.uintp(2)
    # Unsigned places into flat arrays: with them the compiler sees that it can take many pixels at once.
    for y in range(2, height - 2):
        row0, row1, row2 = np.uintp((y - 2) * width), np.uintp((y - 1) * width), np.uintp(y * width)
        row3, row4 = np.uintp((y + 1) * width), np.uintp((y + 2) * width)
        for x in range(np.uintp(width)):
            outer = np.uint16(flat[row0 + x]) + np.uint16(flat[row1 + x]) + np.uint16(flat[row3 + x])
            column[x] = outer + np.uint16(flat[row4 + x]) + np.uint16(flat[row2 + x])
        for x in range(two, np.uintp(max(width - 2, 2))):
            out[row2 + x] = column[x - two] + column[x - one] + column[x] + column[x + one] + column[x + two]


@kernel
def orientation(image: ByteArray, x: int, y: int, disc_x: ShortArray, disc: ShortArray) -> float:
    """Return the direction of the intensity centroid of the disc around a pixel, radians."""
    width = image.shape[1]
    flat, weight_x, weight = image.reshape(-1), disc_x.reshape(-1), disc.reshape(-1)
    corner = y * width + x - DISC_RADIUS_PX
    m10, m01 = np.int32(0), np.int32(0)
    middle = np.uintp(corner)
    for k in range(np.uintp(ROW_PX)):
        m10 = np.int32(m10 + np.int32(flat[middle + k]) * np.int32(weight_x[k]))
    # Rows above and below the middle have the same weights, up to sign.
    for row in range(1, DISC_RADIUS_PX + 1):
        above, below = np.uintp(corner - row * width), np.uintp(corner + row * width)
        table = np.uintp(ROW_PX * row)
        difference = np.int32(0)
        for k in range(np.uintp(ROW_PX)):
            a, b = np.int16(flat[above + k]), np.int16(flat[below + k])
            m10 = np.int32(m10 + np.int32(np.int16(a + b)) * np.int32(weight_x[table + k]))
            difference = np.int32(difference + np.int32(np.int16(b - a)) * np.int32(weight[table + k]))
        m01 = np.int32(m01 + row * difference)
    return direction(float(m10), float(m01))


@kernel
def direction(x: float, y: float) -> float:
    """Return the angle of (x, y) in radians, −π to π, within 2e-6; 0 for (0, 0).

    A polynomial, fitted to the arctangent on 0–1, and not the C library's, which differs from machine to machine.
    """
    long, short = max(abs(x), abs(y)), min(abs(x), abs(y))
    if long == 0.0:
        return 0.0
    t = short / long
    s = t * t
    high_terms = s * (-0.11642647 + s * (0.05264733 - s * 0.01171913))
    angle = t * (0.99997722 + s * (-0.33262283 + s * (0.19354037 + high_terms)))
    angle = 0.5 * np.pi - angle if abs(y) > abs(x) else angle
    angle = np.pi - angle if x < 0.0 else angle
    return -angle if y < 0.0 else angle


@kernel
def _compare(sums: SumArray, corner: int, places: PlaceArray, turn: int, words: WordArray) -> None:
    flat, offsets = sums.reshape(-1), places[turn]
    for word in range(np.uintp(4)):
        bits = np.uint64(0)
        for bit in range(np.uintp(64)):
            pair = np.uintp(2) * (np.uintp(64) * word + bit)
            first, second = np.uintp(corner + offsets[pair]), np.uintp(corner + offsets[pair + np.uintp(1)])
            bits |= np.uint64(flat[first] < flat[second]) << bit
        words[word] = bits

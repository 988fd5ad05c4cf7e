"""Distances between binary descriptors: 256 bits, held as 32 bytes or as four 64-bit words."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from navcore.compiled import kernel

WordArray = NDArray[np.uint64]


def as_words(descriptors: NDArray[np.uint8]) -> WordArray:
    """Return descriptors (n, 32) bytes as (n, 4) words of 64 bits."""
    return np.ascontiguousarray(descriptors).view(np.uint64)


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

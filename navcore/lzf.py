"""LZF, the compression of Lehmann's liblzf, in which PCD files store their points."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from navcore.compiled import kernel


@kernel
def unpack_lzf(packed: NDArray[np.uint8], plain: NDArray[np.uint8]) -> int:
    """Unpack bytes (n,) into the beginning of others (m,); return how many came out, −1 where the input is damaged."""
    source, target = 0, 0
    while source < len(packed):
        control = int(packed[source])
        source += 1
        if control < 32:
            length = control + 1
            if source + length > len(packed) or target + length > len(plain):
                return -1
            for i in range(length):
                plain[target + i] = packed[source + i]
            source += length
            target += length
            continue
        length = control >> 5
        if length == 7:
            if source >= len(packed):
                return -1
            length += int(packed[source])
            source += 1
        if source >= len(packed):
            return -1
        back = target - ((control & 31) << 8) - int(packed[source]) - 1
        source += 1
        length += 2
        if back < 0 or target + length > len(plain):
            return -1
        for i in range(length):
            plain[target + i] = plain[back + i]
        target += length
    return target

"""The 256 comparisons of the binary descriptor."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def comparison_pattern() -> NDArray[np.int8]:
    """Return (256, 2, 2): for each bit two points (x, y) of the patch, pixels; it is set where the first is darker.

    Pairs are drawn from a Gaussian around the centre (Calonder et al. 2010, the second of their patterns).
    """
    rng = np.random.default_rng(20)
    pairs: list[NDArray[np.int64]] = []
    while len(pairs) < 256:
        pair = np.round(rng.normal(0.0, 7.0, (2, 2))).astype(np.int64)
        if (np.hypot(pair[:, 0], pair[:, 1]) <= 13.0).all() and np.abs(pair[0] - pair[1]).max() >= 2:
            pairs.append(pair)
    return np.stack(pairs).astype(np.int8)

"""The nearest of many numbers, for many, without a table of all differences."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from navcore.geometry import FloatArray


def nearest_index(values: FloatArray, at: FloatArray) -> NDArray[np.int64]:
    """Return which of ``values`` (n,), at least one, in any order, is nearest to each of ``at`` (m,): its index (m,).

    Of several that are equally near the first counts.
    """
    known, first = np.unique(values, return_index=True)
    above = np.clip(np.searchsorted(known, at), 1, max(len(known) - 1, 1))
    below, above = above - 1, np.minimum(above, len(known) - 1)
    gap_below, gap_above = np.abs(at - known[below]), np.abs(at - known[above])
    is_below = (gap_below < gap_above) | ((gap_below == gap_above) & (first[below] < first[above]))
    return np.asarray(np.where(is_below, first[below], first[above]), dtype=np.int64)

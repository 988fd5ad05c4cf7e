"""The glasses have one core to give: every library is told so."""

from __future__ import annotations

import cv2
import numba


def use_one_core() -> None:
    """Let OpenCV and Numba compute in the calling thread alone."""
    cv2.setNumThreads(1)
    numba.set_num_threads(1)

"""The glasses have one core to give: every library is told so."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path

import cv2
import numba


def use_one_core() -> None:
    """Let OpenCV and Numba compute in the calling thread alone (for BLAS, ``vbr`` sees to it at its start)."""
    cv2.setNumThreads(1)
    # No kernel runs in parallel; Numba's own pool is the one that is there on every machine.
    numba.config.THREADING_LAYER = "workqueue"  # type: ignore[attr-defined]  # set by name in Numba
    numba.set_num_threads(1)


def give_way() -> None:
    """Compute only when nobody else wants to, and be the first to go where memory runs out: guidance comes first."""
    os.nice(19)
    with contextlib.suppress(OSError):
        Path("/proc/self/oom_score_adj").write_text("1000", encoding="ascii")

"""The glasses have one core and little memory to give: every library is told so."""

from __future__ import annotations

import contextlib
import ctypes
import os
from pathlib import Path

import cv2
import numba

_M_ARENA_MAX = -8
"""``mallopt``'s name for the number of heaps (glibc's malloc.h)."""


def use_one_core() -> None:
    """Let OpenCV and Numba compute in the calling thread alone (for BLAS, ``vbr`` sees to it at its start)."""
    cv2.setNumThreads(1)
    # No kernel runs in parallel; Numba's own pool is the one that is there on every machine.
    numba.config.THREADING_LAYER = "workqueue"  # type: ignore[attr-defined]  # set by name in Numba
    numba.set_num_threads(1)
    _keep_one_heap()


def give_way() -> None:
    """Compute only when nobody else wants to, and be the first to go where memory runs out: guidance comes first."""
    os.nice(19)
    with contextlib.suppress(OSError):
        Path("/proc/self/oom_score_adj").write_text("1000", encoding="ascii")


def _keep_one_heap() -> None:
    """Let all threads take from one heap; a heap for each keeps what it once needed (10 MB more when mapping)."""
    libc = ctypes.CDLL(None)
    if hasattr(libc, "mallopt"):  # glibc has it, others do not
        libc.mallopt(_M_ARENA_MAX, 1)

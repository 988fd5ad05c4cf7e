"""The one place that knows how kernels are compiled.

Kernels are compiled by Numba once, kept on disk next to their module, and run without the interpreter's lock, so that
mapping does not stall tracking. ``vbr warm-up`` compiles all of them, so that nobody waits for it while walking.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba

F = TypeVar("F", bound=Callable[..., Any])


def kernel(function: F) -> F:
    """Compile a function of arrays and numbers to machine code on its first call, cached on disk."""
    return cast(F, numba.njit(cache=True, nogil=True, fastmath=False, error_model="numpy")(function))

"""Compiling every kernel before anybody walks: compiled once, they are kept on disk."""

from __future__ import annotations

import importlib
import multiprocessing
import os
import pkgutil
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor, as_completed

import navcore

Report = Callable[[int, int], None]
"""Called with the number done and their total."""
_MOST_PROCESSES = 2
"""Each takes some hundred megabytes while it compiles."""


def warm_up(report: Report = lambda done, total: None) -> int:
    """Call ``warm_up()`` of every module of navcore that has one; return how many there were."""
    stages = _stages()
    for index, name in enumerate(stages):
        report(index, len(stages))
        _warm_up_module(name)
    report(len(stages), len(stages))
    return len(stages)


def warm_up_side_by_side(report: Report = lambda done, total: None) -> int:
    """Do the same, two modules at a time where there are two cores, for somebody who waits for it."""
    processes = min(_MOST_PROCESSES, os.cpu_count() or 1)
    if processes < 2:
        return warm_up(report)
    stages = _stages()
    with ProcessPoolExecutor(processes, mp_context=multiprocessing.get_context("spawn")) as pool:
        # The last of them take longest, so they begin.
        waiting = [pool.submit(_warm_up_module, name) for name in reversed(stages)]
        for done, each in enumerate(as_completed(waiting)):
            report(done, len(stages))
            each.result()
    # What both have compiled may have been kept for one of them only.
    return warm_up(lambda done, total: report(total, total))


def _stages() -> list[str]:
    # Not the packages: theirs would call again what is called for their modules.
    names = [info.name for info in pkgutil.walk_packages(navcore.__path__, "navcore.") if not info.ispkg]
    return [name for name in names if hasattr(importlib.import_module(name), "warm_up")]


def _warm_up_module(name: str) -> None:
    importlib.import_module(name).warm_up()

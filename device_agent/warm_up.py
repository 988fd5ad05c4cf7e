"""Compiling every kernel before anybody walks: compiled once, they are kept on disk."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Callable

import navcore


def warm_up(report: Callable[[int, int], None] = lambda done, total: None) -> int:
    """Call ``warm_up()`` of every module of navcore that has one; return how many there were.

    ``report`` is called with the number done and their total.
    """
    # Not the packages: theirs would call again what is called for their modules.
    found = (info for info in pkgutil.walk_packages(navcore.__path__, "navcore.") if not info.ispkg)
    modules = [importlib.import_module(info.name) for info in found]
    stages: list[Callable[[], None]] = [module.warm_up for module in modules if hasattr(module, "warm_up")]
    for index, stage in enumerate(stages):
        report(index, len(stages))
        stage()
    report(len(stages), len(stages))
    return len(stages)

"""Every target, of files and of what comes over the air, in one table: for the driver and for its confined reader."""

from __future__ import annotations

from collections.abc import Callable

from fuzz import targets_wire
from fuzz.targets import TARGETS as OF_FILES
from fuzz.targets import Form, Target


def _of_wire(name: str, read: Callable[[bytes], None]) -> Target:
    form: Form = "json" if name in ("http_bodies", "edit_made", "page_said") else "binary"
    return Target(name, form, lambda data, _: read(data), lambda: targets_wire.SEEDS[name])


TARGETS = OF_FILES | {name: _of_wire(name, read) for name, read in targets_wire.TARGETS.items()}

"""One thing that the checker has found."""

from __future__ import annotations

from typing import Literal

import msgspec

Severity = Literal["error", "warning", "note"]


class Finding(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One thing that is wrong, or may be: what, where, and what to do."""

    code: str
    """Which check found it, as ``unreachable_poi``."""
    severity: Severity
    """An error keeps somebody from being led safely or at all; a warning should be looked at; a note may be wanted."""
    text: str
    """What is wrong, in one sentence."""
    action: str
    """What to do about it, in one sentence."""
    x_m: float
    y_m: float
    """Where to look, metres in the map."""
    poi_ids: tuple[str, ...] = ()
    edge_ids: tuple[str, ...] = ()
    road_ids: tuple[str, ...] = ()

"""What was said in a rehearsal, as the checker looks at it."""

from __future__ import annotations

import msgspec


class Announced(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One thing that was said in a rehearsal."""

    kind: str
    """A :class:`navcore.cues.table.CueKind`'s value."""
    poi_id: str
    """What place was announced; empty where it was none."""
    at_m: float
    """Way walked along the route when it was said."""
    distance_m: float
    """Way from there to what it announces; 0 where it names no distance."""
    x_m: float
    y_m: float


class RehearsedRoute(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A route on which the navigation was run without anyone walking, and what was said."""

    start_id: str
    goal_id: str
    length_m: float
    end_x_m: float
    end_y_m: float
    """Where it ends."""
    announced: tuple[Announced, ...]
    """In the order of ``at_m``."""

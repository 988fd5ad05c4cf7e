"""What has been said to the walker: the only memory between two calls of the cues."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from navcore.cues.bus import CueBus
from navcore.types import Action, Reason


@dataclass(frozen=True, slots=True)
class CueMemory:
    """What has been said, as far as it matters for what to say next."""

    bus: CueBus = field(default_factory=CueBus)
    told_action: Action | None = None
    """The last instruction that was spoken."""
    told_reason: Reason | None = None
    told_s: float = -math.inf
    """When."""
    told_target_rad: float | None = None
    """World direction that the last turn was to lead to."""
    heading_rad: float | None = None
    """Heading since which the walker has stood still."""
    still_since_s: float = -math.inf
    changed_since_s: float | None = None
    """Since when guidance has been another than what was told, while the walker stands."""
    tone_s: float = -math.inf
    """When the last tick or steering tone was due."""
    tone_angle_deg: float = 0.0
    aims: bool = False
    """A movement has been put into words, and no tone has said its exact direction yet."""
    beep_s: float = -math.inf
    off_road_s: float = -math.inf
    sonar_lost: bool = False
    """What the walker was last told of the rangefinder."""
    sonar_changed_s: float | None = None
    """Since when it has been otherwise."""
    uncertain_s: float = -math.inf
    """When the walker was last told that the position is uncertain."""
    straight_since_s: float | None = None
    """Since when the walker has been walking straight on."""
    route_version: int | None = None
    reassured_m: float | None = None
    """Distance left when the walker last heard that all is well."""
    announced: frozenset[str] = frozenset()
    """PoIs of this route, and what is to be known of its edges, that have been announced."""
    announcing: str | None = None
    """What was announced last of these: where other words cut its announcement off, it is announced anew."""
    corner_m: float = -math.inf
    """Arc length of the last corner of this route that was announced."""
    deviation_s: float = -math.inf
    """When the walker was last told where the road is."""
    explained: Reason | None = None
    """The stop that has been explained; None once they have been told to walk or turn again."""


AT_REST = CueMemory(told_action=Action.STOP, told_reason=Reason.NO_ROUTE)
"""The memory of who is not led: nobody walks yet, so that *stop* is no news."""

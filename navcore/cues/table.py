"""Everything that the walker can hear, in one place: the kinds, their priority, and the cue value."""

from __future__ import annotations

import enum
from dataclasses import dataclass


class CuePriority(enum.IntEnum):
    """A higher cue cuts a lower one off; at the same level the newest is kept."""

    POI = 1
    REASSURANCE = 2
    OFF_ROAD = 3
    TURN = 4
    OBSTACLE = 5
    STOP = 6


class CueKind(enum.Enum):
    """What a cue tells the walker to do, or tells them of."""

    STOP = "stop"
    """Stand still. ``reason`` in the text."""
    WALK = "walk"
    """Begin to move, or go on, in ``angle_deg``."""
    TURN = "turn"
    """Turn on the spot by ``angle_deg``, without a step."""
    STEER = "steer"
    """A tone, placed where to walk, while walking: ``angle_deg``."""
    TICK = "tick"
    """The heart-beat of guidance while walking straight: as long as it is heard, "walk" holds; silence is *stop*."""
    OBSTACLE_BEEP = "obstacle_beep"
    """Quickens and rises as an obstacle nears: ``distance_m``."""
    ARRIVED = "arrived"
    POI_AHEAD = "poi_ahead"
    REASSURANCE = "reassurance"
    MESSAGE = "message"
    """A sentence from a person at the console, or a notice of the device (a sensor failed, a map was taken)."""


PRIORITY: dict[CueKind, CuePriority] = {
    CueKind.STOP: CuePriority.STOP,
    CueKind.ARRIVED: CuePriority.STOP,
    CueKind.OBSTACLE_BEEP: CuePriority.OBSTACLE,
    CueKind.TURN: CuePriority.TURN,
    CueKind.WALK: CuePriority.TURN,
    CueKind.STEER: CuePriority.TURN,
    CueKind.TICK: CuePriority.REASSURANCE,
    CueKind.REASSURANCE: CuePriority.REASSURANCE,
    CueKind.POI_AHEAD: CuePriority.POI,
    CueKind.MESSAGE: CuePriority.OFF_ROAD,
}
"""The priority of each kind of cue."""


@dataclass(frozen=True, slots=True)
class Cue:
    """One thing to be heard now. Speech where there is a text; a tone where there is a frequency; both where both."""

    stamp_s: float
    kind: CueKind
    priority: CuePriority
    text: str = ""
    """What is spoken, in the walker's language; empty for a tone."""
    angle_deg: float | None = None
    """Direction in degrees relative to the heading, left positive, as the text says it or the tone's place tells."""
    distance_m: float | None = None
    frequency_hz: float | None = None
    """Pitch of the tone; None for pure speech."""
    duration_s: float = 0.0
    """Length of the tone."""
    pan: float = 0.0
    """Place of the tone between the ears: −1 left, +1 right."""

    @property
    def is_tone(self) -> bool:
        """Whether this is a short sound without words."""
        return not self.text

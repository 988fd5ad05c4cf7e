"""How the link to the console stands: a value that any thread may read, and that is left in the state folder."""

from __future__ import annotations

import enum

import msgspec


class LinkCondition(enum.Enum):
    """What the link does."""

    DIALLING = "dialling"
    JOINED = "joined"
    WAITING = "waiting"
    """The last attempt failed; the next one comes after a pause."""
    REFUSED = "refused"
    """The console does not take this device in; asked again after a long pause."""
    STOPPED = "stopped"


class LinkState(msgspec.Struct, frozen=True):
    """How the link stands. Times are on the device's clock."""

    condition: LinkCondition = LinkCondition.STOPPED
    since_s: float = 0.0
    reason: str = ""
    """Why it is not joined: the sentence of the last failure."""
    failure_count: int = 0
    """Attempts that failed in a row; 0 while joined."""
    pause_s: float = 0.0
    """How long it waits before it dials again."""
    clock_offset_s: float | None = None
    """Device clock minus the console's steady clock, as the console has measured it; None before that."""
    clock_uncertainty_s: float | None = None
    """The true offset is no farther than this from ``clock_offset_s``."""

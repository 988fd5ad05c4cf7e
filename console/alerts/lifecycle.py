"""The life of one alert of one device: raised, acknowledged, returned, shelved, as ISA-18.2 has it. Pure.

::

    NORMAL ──on-delay──▶ UNACKNOWLEDGED ──acknowledge──▶ ACKNOWLEDGED ──off-delay──▶ NORMAL
                           │        ▲                                                  ▲
                       off-delay  again                                                │
                           ▼        │                                                  │
                         RETURNED (not acknowledged yet) ──────────acknowledge─────────┘

Shelving lies over it: a shelved alert keeps silent, whatever its condition does, until its time is up or somebody takes
it off the shelf; where its condition holds then, it is unacknowledged again. Nothing but an acknowledgement ends an
alert, and whatever changes is told as a :class:`Change`.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass, replace

from console.alerts.rules import Priority, Rule, Verdict


class Phase(enum.Enum):
    """How an alert stands."""

    NORMAL = "normal"
    UNACKNOWLEDGED = "unacknowledged"
    ACKNOWLEDGED = "acknowledged"
    RETURNED = "returned"
    """Its condition is over, and nobody has acknowledged it."""
    SHELVED = "shelved"


class Change(enum.Enum):
    """Something that happens to an alert; the value is kept in the database."""

    RAISED = "raised"
    AGAIN = "again"
    """Its condition holds again before the alert was done with: it is the same one."""
    ESCALATED = "escalated"
    RETURNED = "returned"
    ACKNOWLEDGED = "acknowledged"
    SHELVED = "shelved"
    UNSHELVED = "unshelved"
    SHELF_ENDED = "shelf_ended"
    CLOSED = "closed"


@dataclass(frozen=True, slots=True)
class Life:
    """One kind of alert of one device. Times are the console's steady clock."""

    is_open: bool = False
    """It was raised, and is not done with."""
    is_active: bool = False
    """Its condition holds, delays included."""
    is_acknowledged: bool = False
    priority: Priority = Priority.LOW
    shelved_until_s: float | None = None
    unacknowledged_since_s: float = 0.0
    """Since when it waits for somebody."""
    is_holding: bool = False
    """What was said of its condition last, where anything was known."""
    holds_since_s: float | None = None
    """Since when the condition holds, while it is not active."""
    normal_since_s: float | None = None
    """Since when the condition is known to be normal, while it is active."""

    @property
    def phase(self) -> Phase:
        """How it stands."""
        if not self.is_open:
            return Phase.NORMAL
        if self.shelved_until_s is not None:
            return Phase.SHELVED
        if self.is_active:
            return Phase.ACKNOWLEDGED if self.is_acknowledged else Phase.UNACKNOWLEDGED
        return Phase.RETURNED


Step = tuple[Life, tuple[Change, ...]]


def step(life: Life, rule: Rule, verdict: Verdict, now_s: float) -> Step:
    """Return the alert as it is now, given what is known of its condition; and what has happened to it."""
    life, changes = _judged(life, rule, verdict, now_s)
    for follow in (_off_the_shelf, _escalated, _closed):
        life, more = follow(life, rule, now_s)
        changes += more
    return life, changes


def acknowledge(life: Life) -> Step:
    """Somebody has seen it. Nothing changes where it is not open, or was seen before."""
    if not life.is_open or life.is_acknowledged:
        return life, ()
    seen = replace(life, is_acknowledged=True)
    if seen.is_active or seen.shelved_until_s is not None:
        return seen, (Change.ACKNOWLEDGED,)
    return replace(seen, is_open=False), (Change.ACKNOWLEDGED, Change.CLOSED)


def shelve(life: Life, until_s: float) -> Step:
    """Keep it silent for a while. Nothing changes where it is not open."""
    return (replace(life, shelved_until_s=until_s), (Change.SHELVED,)) if life.is_open else (life, ())


def unshelve(life: Life, now_s: float) -> Step:
    """Take it off the shelf before its time."""
    if life.shelved_until_s is None:
        return life, ()
    life, closed = _closed(_taken_off(life, now_s))
    return life, (Change.UNSHELVED, *closed)


# --------------------------------------------------------------------------------------------------------- internals
def _judged(life: Life, rule: Rule, verdict: Verdict, now_s: float) -> Step:
    if verdict is Verdict.UNKNOWN:
        # Nothing ends by what is not known. What has begun to hold goes on from where it was.
        return replace(life, normal_since_s=None), ()
    holds = verdict is Verdict.HOLDS
    if life.is_active:
        since_s = None if holds else _since(life.normal_since_s, now_s)
        life = replace(life, is_holding=holds, normal_since_s=since_s)
        if since_s is None or now_s - since_s < rule.off_delay_s:
            return life, ()
        return replace(life, is_active=False, normal_since_s=None), (Change.RETURNED,)
    since_s = _since(life.holds_since_s, now_s) if holds else None
    life = replace(life, is_holding=holds, holds_since_s=since_s)
    if since_s is None or now_s - since_s < rule.on_delay_s:
        return life, ()
    return _risen(life, rule, now_s)


def _since(before_s: float | None, now_s: float) -> float:
    return now_s if before_s is None else before_s


def _risen(life: Life, rule: Rule, now_s: float) -> Step:
    life = replace(life, is_active=True, holds_since_s=None)
    if life.is_open:
        return life, (Change.AGAIN,)
    opened = replace(
        life, is_open=True, is_acknowledged=False, priority=rule.priority, unacknowledged_since_s=now_s
    )  # fmt: skip
    return opened, (Change.RAISED,)


def _off_the_shelf(life: Life, rule: Rule, now_s: float) -> Step:
    if life.shelved_until_s is None or now_s < life.shelved_until_s:
        return life, ()
    return _taken_off(life, now_s), (Change.SHELF_ENDED,)


def _taken_off(life: Life, now_s: float) -> Life:
    seen = life.is_acknowledged and not life.is_active
    return replace(life, shelved_until_s=None, is_acknowledged=seen, unacknowledged_since_s=now_s)


def _escalated(life: Life, rule: Rule, now_s: float) -> Step:
    at_first = life.priority == rule.priority < Priority.HIGH
    waits = life.phase is Phase.UNACKNOWLEDGED and at_first and rule.escalate_after_s is not None
    if not waits or now_s - life.unacknowledged_since_s < (rule.escalate_after_s or 0.0):
        return life, ()
    return replace(life, priority=Priority(life.priority + 1)), (Change.ESCALATED,)


def _closed(life: Life, rule: Rule | None = None, now_s: float = 0.0) -> Step:
    if life.is_open and life.is_acknowledged and not life.is_active and life.shelved_until_s is None:
        return replace(life, is_open=False), (Change.CLOSED,)
    return life, ()

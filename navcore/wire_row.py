"""What the message table says of a message, besides its form."""

from __future__ import annotations

import enum
from dataclasses import dataclass

import msgspec


class Direction(enum.Enum):
    """Which way a message goes."""

    UP = "device → console"
    DOWN = "console → device"


class Delivery(enum.Enum):
    """What becomes of a message on a slow or broken link; the value is the sentence for people."""

    GREETING = "begins a connection; without it there is none"
    ANSWER = "not kept over a break: the next connection measures, or confirms, anew"
    KEPT = "kept until sent; the newest of its kind is told again at each joining"
    CONFIRMED = "kept on the device's disk until the console has confirmed it: in order, once"
    NEWEST = "the newest replaces the one that is not sent yet"
    SPARE = "the newest replaces the one before, and goes only when nothing else waits"
    ORDER = "in order; one that meets a break is shown as unanswered; after 10 s the device does not carry it out"
    OFFER = "offered again at each joining until the device runs it, or has refused it"


@dataclass(frozen=True, slots=True)
class MessageRow:
    """One line of the table."""

    message: type[msgspec.Struct]
    direction: Direction
    since_version: int
    """The protocol version in which it has the form that it has now."""
    when: str
    """What it is sent upon."""
    rate_hz: float | None
    """How often at most, where that is limited: what a newer one may replace is sent no faster, and of everything more
    than that over half a minute is refused by whoever receives it."""
    priority: int
    """Of what waits in one direction, the smaller number goes first; within a number the older."""
    delivery: Delivery
    max_bytes: int
    """A larger one is neither sent nor taken."""

    @property
    def name(self) -> str:
        """The name of the message."""
        return self.message.__name__

    @property
    def meaning(self) -> str:
        """What it says: the first line of its docstring."""
        return (self.message.__doc__ or "").strip().split("\n")[0]

"""The states of a device, as device and console name them. What leads from one to another: device_agent/states.py."""

from __future__ import annotations

import enum


class Mode(enum.StrEnum):
    """What the device does; the value is the wire's, label and sentence are for people at the console."""

    OFF_DUTY = "off_duty"
    MAPPING = "mapping"
    LOCALIZING = "localizing"
    READY = "ready"
    GUIDING = "guiding"
    PAUSED = "paused"
    LOST = "lost"
    ARRIVED = "arrived"
    FAULT = "fault"

    @property
    def label(self) -> str:
        """The state in a word or two."""
        return _LABELS[self]

    @property
    def sentence(self) -> str:
        """The state in a sentence."""
        return _SENTENCES[self]


ON_THE_WAY = frozenset({Mode.GUIDING, Mode.LOST})
"""Somebody is being led and goes on by themselves, as soon as the position is known and nothing has failed."""

LED = ON_THE_WAY | {Mode.PAUSED}
"""Somebody is being led, though they may have been told to stand for a while."""


def is_led(mode: Mode, *, has_destination: bool) -> bool:
    """Return whether somebody is being led. In a fault, which hides the state beneath it, a destination tells."""
    return mode in LED or (mode is Mode.FAULT and has_destination)


_LABELS = {
    Mode.OFF_DUTY: "Off duty",
    Mode.MAPPING: "Recording a map",
    Mode.LOCALIZING: "Finding the position",
    Mode.READY: "Ready",
    Mode.GUIDING: "Guiding",
    Mode.PAUSED: "Paused",
    Mode.LOST: "Position lost",
    Mode.ARRIVED: "Arrived",
    Mode.FAULT: "Fault",
}
_SENTENCES = {
    Mode.OFF_DUTY: "The walker has put the device off duty: it looks for no position, and leads nobody.",
    Mode.MAPPING: "A sighted person records a map; nobody is led.",
    Mode.LOCALIZING: "Nobody is led. The place in the map is not known yet.",
    Mode.READY: "Nobody is led. The place in the map is known.",
    Mode.GUIDING: "The walker is led to the destination.",
    Mode.PAUSED: "The walker stands; the destination is kept.",
    Mode.LOST: "The walker stands, or turns to look round, until the place in the map is known again.",
    Mode.ARRIVED: "The walker stands at the destination.",
    Mode.FAULT: "Something has failed. The walker stands until all has worked again for a moment.",
}

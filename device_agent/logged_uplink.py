"""What the device tells the console is in its own log as well."""

from __future__ import annotations

import logging

from device_agent.ports import EventKind, KeptMessage, Uplink
from navcore.types import Frame
from navcore.wire import WalkerState

_log = logging.getLogger(__name__)


def log_event(stamp_s: float, kind: EventKind, text: str) -> None:
    """Write an event to the log, as a warning where something has failed."""
    level = logging.WARNING if kind in ("sensor", "watchdog") else logging.INFO
    _log.log(level, "%s", text, extra={"kind": kind, "stamp_s": round(stamp_s, 3)})


class LoggedUplink:
    """An uplink whose events are in the log as well: what a device without a console has met can be read there."""

    def __init__(self, uplink: Uplink) -> None:
        self._uplink = uplink

    def state(self, state: WalkerState) -> None:
        """Pass it on."""
        self._uplink.state(state)

    def depth_image(self, frame: Frame) -> None:
        """Pass it on."""
        self._uplink.depth_image(frame)

    def colour_image(self, frame: Frame) -> None:
        """Pass it on."""
        self._uplink.colour_image(frame)

    def message(self, message: KeptMessage) -> None:
        """Pass it on."""
        self._uplink.message(message)

    def event(self, stamp_s: float, kind: EventKind, text: str) -> None:
        """Log it, and pass it on."""
        log_event(stamp_s, kind, text)
        self._uplink.event(stamp_s, kind, text)

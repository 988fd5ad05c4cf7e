"""The messages of an incident, given to a hub again: at each of them, the device as the console knew it then."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace

from console.hub import DeviceHub
from console.live import LiveDevice
from console.message_log import MessageLogError, TimedMessage
from navcore.wire import ConsoleMessage, Hello


class _NoWay:
    """The way to a device of the past: nothing can be sent to it."""

    def send(self, message: ConsoleMessage) -> None:
        """Send nothing."""

    def close(self, code: int, reason: str) -> None:
        """Close nothing."""


def replayed(messages: Iterable[TimedMessage], name: str) -> Iterator[tuple[TimedMessage, LiveDevice]]:
    """Return each message with the device as the console knew it after it: the hub itself is fed with what was kept.

    Raises MessageLogError where the device does not say first who it is.
    """
    now = [0.0]
    hub = DeviceHub(now_s=lambda: now[0])
    device_id = ""
    for timed in messages:
        now[0] = timed.arrival_s
        message = timed.message
        if isinstance(message, Hello):
            device_id = message.device_id
            hub.connect(message, name, _NoWay())
        elif not device_id:
            raise MessageLogError("The messages do not begin with who sent them: they cannot be shown.")
        else:
            hub.receive(device_id, message)
        device = hub.device(device_id)
        yield timed, replace(device, clock_offset_s=timed.offset_s, clock_uncertainty_s=0.0)

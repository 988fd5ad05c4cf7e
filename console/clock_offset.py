"""The offset between a device's clock and the console's, from pings that tell both."""

from __future__ import annotations

from collections import deque

WINDOW_COUNT = 12


class ClockOffset:
    """Estimates ``device clock − console clock`` in seconds; not thread-safe.

    Of the last pings the one with the shortest way there and back is believed: its answer was delayed least.
    """

    def __init__(self, hello_device_s: float, arrival_s: float) -> None:
        self._first_s = hello_device_s - arrival_s
        self._samples: deque[tuple[float, float]] = deque(maxlen=WINDOW_COUNT)

    def add(self, sent_s: float, device_s: float, arrival_s: float) -> None:
        """Take in the answer to a ping: when it was sent, the device's clock, when the answer came."""
        round_trip_s = arrival_s - sent_s
        if round_trip_s >= 0.0:
            self._samples.append((round_trip_s, device_s - (sent_s + round_trip_s / 2)))

    @property
    def offset_s(self) -> float:
        """Device clock minus console clock."""
        return min(self._samples)[1] if self._samples else self._first_s

    @property
    def round_trip_s(self) -> float | None:
        """The shortest way there and back of late; None before the first answer."""
        return min(self._samples)[0] if self._samples else None

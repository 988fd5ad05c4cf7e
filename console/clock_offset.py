"""The offset between a device's clock and the console's, with how far it may be wrong, from pings that tell both.

A ping goes at *t₁* and comes at *t₂*; its answer goes at *t₃* and comes at *t₄*, *t₁* and *t₄* on the console's clock,
*t₂* and *t₃* on the device's. Nothing arrives before it is sent, so the true offset θ (device minus console) lies in
``t₃ − t₄ ≤ θ ≤ t₂ − t₁``, however differently long the two ways are. The middle is the estimate of NTP (RFC 5905,
section 8), and half of the width, which is half of the time spent on the way, is how far it may be wrong.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

WINDOW_COUNT = 12
"""Answers among which the one that was least on the way is looked for: about half a minute."""
DRIFT_S_PER_S = 2e-4
"""How fast two clocks may come apart: each may be wrong by 100 ppm, twice what crystals are sold with."""

RESOLUTION_S = 1e-6
"""What clocks tell apart, and differences of large numbers of seconds keep."""


@dataclass(frozen=True, slots=True)
class _Sample:
    round_trip_s: float
    slack_s: float
    offset_s: float
    at_s: float

    def uncertainty_s(self, now_s: float) -> float:
        return self.round_trip_s / 2 + self.slack_s + DRIFT_S_PER_S * max(0.0, now_s - self.at_s)

    def excludes(self, other: _Sample, now_s: float) -> bool:
        return abs(self.offset_s - other.offset_s) > self.uncertainty_s(now_s) + other.uncertainty_s(now_s)


class ClockOffset:
    """Estimates ``device clock − console clock`` in seconds; not thread-safe.

    Of the last answers the one that was least on the way is believed, and the less the older it is. Answers that
    exclude each other prove that a clock has jumped: the earlier ones are forgotten.
    """

    def __init__(self, hello_device_s: float, arrival_s: float) -> None:
        """Before the first answer, the device's hello tells the least that the offset can be."""
        self._least_s = hello_device_s - arrival_s
        self._now_s = arrival_s
        self._samples: deque[_Sample] = deque(maxlen=WINDOW_COUNT)

    def add(self, console_sent_s: float, device_received_s: float, device_sent_s: float, arrival_s: float) -> None:
        """Take in the answer to a ping: *t₁* to *t₄*; one that cannot be true is left out."""
        round_trip_s = (arrival_s - console_sent_s) - (device_sent_s - device_received_s)
        # While the ping was under way, the clocks came apart too.
        slack_s = RESOLUTION_S + DRIFT_S_PER_S * max(0.0, arrival_s - console_sent_s)
        if device_sent_s < device_received_s or round_trip_s < -slack_s:
            return
        middle_s = ((device_received_s - console_sent_s) + (device_sent_s - arrival_s)) / 2
        sample = _Sample(max(0.0, round_trip_s), slack_s, middle_s, arrival_s)
        if any(sample.excludes(earlier, arrival_s) for earlier in self._samples):
            self._samples.clear()
        self._samples.append(sample)
        self._now_s = arrival_s

    @property
    def offset_s(self) -> float:
        """Device clock minus console clock."""
        best = self._best()
        return self._least_s if best is None else best.offset_s

    @property
    def uncertainty_s(self) -> float | None:
        """The true offset is no farther than this from ``offset_s``; None before the first answer."""
        best = self._best()
        return None if best is None else best.uncertainty_s(self._now_s)

    @property
    def round_trip_s(self) -> float | None:
        """The shortest time on the way there and back of late; None before the first answer."""
        return min((sample.round_trip_s for sample in self._samples), default=None)

    def _best(self) -> _Sample | None:
        return min(self._samples, key=lambda sample: sample.uncertainty_s(self._now_s), default=None)

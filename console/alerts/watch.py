"""What is remembered of one device between two looks: when it was heard of, whether it led somebody, how that ended."""

from __future__ import annotations

from dataclasses import dataclass

from console.alerts.rules import Observation, observe
from console.live import LiveDevice
from navcore.modes import Mode
from navcore.wire import Event, WalkerState

ENDING_EVENTS: frozenset[str] = frozenset({"arrived", "route_refused"})
"""Events after which nobody is led, as it is meant to be. Whoever hears that no way leads there has not set out."""
ENDING_PRESSES = frozenset({"The walker pressed: stop.", "The walker pressed: off duty."})
"""What a device tells of the walker who ends guidance themselves (device_agent.menu)."""


@dataclass(frozen=True, slots=True)
class LedRecord:
    """That a device leads somebody, as it is kept over a restart of the console."""

    device_id: str
    name: str
    heard_at_s: float
    """Unix time at which what it said last was true."""
    event_sequence: int = 0
    """Its newest event then."""


@dataclass(slots=True)
class Watch:
    """What is remembered of a device between two looks. Times are the console's steady clock."""

    name: str
    heard_s: float
    """When what it said last was true."""
    was_led: bool = False
    broke_off: bool = False
    """Guidance ended, nothing explains why, and nobody has seen it yet."""
    led_since_s: float = 0.0
    event_sequence: int = 0
    """Its newest event one look before somebody was seen to be led last: what came later may tell how that ended."""
    next_sequence: int | None = None
    """Its newest event when somebody was seen to be led last; None before the first look."""
    ended_s: float | None = None
    """When somebody took it off watch: until it connects anew, nothing is known of it and nothing is missed."""

    @staticmethod
    def resumed(record: LedRecord, now_s: float, wall_s: float) -> Watch:
        """Return the watch over a device that led somebody when the console ended."""
        heard_s = now_s - max(0.0, wall_s - record.heard_at_s)
        sequence = record.event_sequence
        return Watch(record.name, heard_s, True, led_since_s=now_s, event_sequence=sequence, next_sequence=sequence)

    def is_off(self, device: LiveDevice | None) -> bool:
        """Say whether it was taken off watch, and has not connected since."""
        return self.ended_s is not None and (device is None or device.connected_at_s <= self.ended_s)

    def look(self, device: LiveDevice | None, now_s: float) -> Observation:
        """Return what is known of the device now, and remember it; None: it has not called since the console began."""
        heard = None if self.is_off(device) else device
        age_s = heard.longest_age_s(now_s) if heard is not None else None
        if age_s is not None:
            self.heard_s = now_s - age_s
        seen = observe(heard, now_s, self.heard_s, self.was_led)
        if heard is not None:
            self._heed(heard, seen.state, now_s)
        return Observation(seen.state, seen.silent_s, self.was_led, self.broke_off)

    def end(self, now_s: float) -> None:
        """Take it off watch until it connects anew."""
        self.ended_s, self.was_led, self.broke_off = now_s, False, False

    def record(self, device_id: str, wall_minus_steady_s: float) -> LedRecord | None:
        """Return what is to be kept over a restart; None where nobody is led."""
        if not self.was_led:
            return None
        return LedRecord(device_id, self.name, self.heard_s + wall_minus_steady_s, self.next_sequence or 0)

    def _heed(self, device: LiveDevice, state: WalkerState | None, now_s: float) -> None:
        if state is not None:
            self._heed_state(device, state, now_s)
        if self.broke_off and self._is_explained(device):
            self.broke_off = False

    def _heed_state(self, device: LiveDevice, state: WalkerState, now_s: float) -> None:
        leads, led_before = state.leads_somebody, self.was_led
        self.was_led = leads
        if led_before and not leads:
            self.broke_off = state.mode is not Mode.ARRIVED
            return
        if leads:
            self.led_since_s = self.led_since_s if led_before else now_s
            self.broke_off = False
        if not self.broke_off:
            newest = device.events[-1].sequence if device.events else 0
            self.event_sequence = newest if self.next_sequence is None else self.next_sequence
            self.next_sequence = newest

    def _is_explained(self, device: LiveDevice) -> bool:
        """Say whether it is known who or what has ended guidance: the goal is reached, the walker, or the console."""
        was_cleared = any(
            each.kind == "clear" and each.state in ("sent", "running") and each.asked_s >= self.led_since_s
            for each in device.commands
        )
        return was_cleared or any(each.sequence > self.event_sequence and _ends(each) for each in device.events)


def _ends(event: Event) -> bool:
    return event.kind in ENDING_EVENTS or (event.kind == "button" and event.text in ENDING_PRESSES)

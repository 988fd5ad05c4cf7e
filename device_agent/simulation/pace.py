"""Time in a live simulation: as fast as real time, and slower where the machine cannot keep up.

On the glasses a late loop is a fault, for the walker walks on. In the simulation it mostly means that this machine is
busy drawing the building, or a browser: then the simulated world waits too, and the walk becomes slower instead of
unsafe. A loop that is gone for good is not forgiven: the clock goes on, and the watchdog says so.
"""

from __future__ import annotations

import threading
from dataclasses import replace

import msgspec

from device_agent.ports import Clock, DepthCamera, EventKind, KeptMessage, Uplink
from navcore.types import CameraIntrinsics, Frame
from navcore.wire import RouteChanged, SettingsRunning, SharingRunning, WalkerState

PATIENCE_S = 3.0
"""Real time after which a loop that does not come back is not merely slow."""
_LONGEST_NAP_S = 0.01


class PacedClock:
    """Real time, but between two steps of the loop at most ``step_s`` of it passes. Any thread may read it."""

    def __init__(self, real: Clock, step_s: float) -> None:
        self._real = real
        self._step_s = step_s
        self._lock = threading.Lock()
        self._slipped_s = 0.0
        self._stepped_s = self._real.now_s()
        """Real time of the last step."""

    def step(self) -> None:
        """The loop has come round."""
        with self._lock:
            real_s = self._real.now_s()
            self._slipped_s += self._lost_s(real_s)
            self._stepped_s = real_s

    def now_s(self) -> float:
        """Seconds."""
        with self._lock:
            real_s = self._real.now_s()
            return real_s - self._slipped_s - self._lost_s(real_s)

    def real_s(self, stamp_s: float) -> float:
        """Return the real time at which something is as old as the stamp says now."""
        with self._lock:
            return stamp_s + self._slipped_s + self._lost_s(self._real.now_s())

    def sleep_until(self, stamp_s: float) -> None:
        """Wait until then."""
        while (remaining_s := stamp_s - self.now_s()) > 0:
            self._real.sleep_until(self._real.now_s() + min(remaining_s, _LONGEST_NAP_S))

    def _lost_s(self, real_s: float) -> float:
        """Return how much of the time since the last step does not count."""
        passed_s = real_s - self._stepped_s
        return min(max(0.0, passed_s - self._step_s), PATIENCE_S - self._step_s)


class PacedCamera:
    """A simulated camera that tells the clock each time the loop comes for a picture."""

    def __init__(self, camera: DepthCamera, clock: PacedClock) -> None:
        self._camera = camera
        self._clock = clock

    @property
    def intrinsics(self) -> CameraIntrinsics:
        """The camera's geometry."""
        return self._camera.intrinsics

    def read(self) -> Frame:
        """Wait for the next capture and return it."""
        self._clock.step()
        return self._camera.read()

    def close(self) -> None:
        """Deliver nothing from now on."""
        self._camera.close()


class RealTimeUplink:
    """Hands over to another uplink with stamps in real time, so that ages on the console are true ones."""

    def __init__(self, uplink: Uplink, clock: PacedClock) -> None:
        self._uplink = uplink
        self._clock = clock

    def state(self, state: WalkerState) -> None:
        """Offer the newest state."""
        cue_s = state.last_cue_stamp_s
        self._uplink.state(
            msgspec.structs.replace(
                state,
                stamp_s=self._clock.real_s(state.stamp_s),
                last_cue_stamp_s=None if cue_s is None else self._clock.real_s(cue_s),
            )
        )

    def depth_image(self, frame: Frame) -> None:
        """Offer the newest depth image."""
        self._uplink.depth_image(replace(frame, stamp_s=self._clock.real_s(frame.stamp_s)))

    def colour_image(self, frame: Frame) -> None:
        """Offer the newest colour picture."""
        self._uplink.colour_image(replace(frame, stamp_s=self._clock.real_s(frame.stamp_s)))

    def message(self, message: KeptMessage) -> None:
        """Hand over a message that is kept until it is sent."""
        if isinstance(message, RouteChanged):
            message = msgspec.structs.replace(message, stamp_s=self._clock.real_s(message.stamp_s))
        elif isinstance(message, SettingsRunning) and message.revert_at_s is not None:
            message = msgspec.structs.replace(message, revert_at_s=self._clock.real_s(message.revert_at_s))
        elif isinstance(message, SharingRunning) and message.colour_until_s is not None:
            message = msgspec.structs.replace(message, colour_until_s=self._clock.real_s(message.colour_until_s))
        self._uplink.message(message)

    def event(self, stamp_s: float, kind: EventKind, text: str) -> None:
        """Hand over something that must not be lost."""
        self._uplink.event(self._clock.real_s(stamp_s), kind, text)

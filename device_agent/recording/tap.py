"""Where somebody may listen in on the loop, or stand in for all that it reads.

Whatever the loop learns from outside goes through a :class:`Tap`: time, the camera, the pose, the scan, the
rangefinder, the orders, what the watchdog did. This one passes everything on. A recorder notes it on the way; a replay
gives back what was noted, so that the same loop comes to the same guidance, bit for bit.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from device_agent.ports import Clock, CueOutput, Uplink

if TYPE_CHECKING:
    from device_agent.cycle import Cycle
    from device_agent.load_plan import LoadLevel
    from device_agent.loop import Ports
    from device_agent.orders import Order
    from device_agent.state import DeviceState
    from device_agent.voice import VoiceMemory
    from navcore.types import CameraIntrinsics, Frame


class Tap:
    """Stands between the loop and its surroundings, and passes everything on."""

    def clock(self, clock: Clock) -> Clock:
        """Return the clock that the loop, and nobody else, reads."""
        return clock

    def uplink(self, uplink: Uplink) -> Uplink:
        """Return where the agent leaves what the console shall know."""
        return uplink

    def voice_output(self, output: CueOutput) -> CueOutput:
        """Return what the loop speaks through."""
        return output

    def watchdog_output(self, output: CueOutput) -> CueOutput:
        """Return what the watchdog speaks through, from its own thread."""
        return output

    def stop_count(self, count: Callable[[], int]) -> Callable[[], int]:
        """Return how the voice learns how often the watchdog has spoken."""
        return count

    def load_level(self, level: LoadLevel) -> LoadLevel:
        """Return what is to be left out of this cycle, because those before took too long."""
        return level

    def ports(self, ports: Ports) -> Ports:
        """Return what a cycle reads from."""
        return ports

    def begin(self, state: DeviceState, voice: VoiceMemory, intrinsics: CameraIntrinsics) -> None:
        """The agent has been put together; no cycle has run."""

    def rehearsed(self, frame: Frame) -> None:
        """The localizer has seen a frame before the agent was put together."""

    def cycle_begins(self) -> None:
        """Orders are taken next."""

    def order(self, order: Order) -> None:
        """An order is carried out."""

    def cycle_ended(self, state: DeviceState, voice: VoiceMemory, cycle: Cycle) -> None:
        """All of a cycle is done; this is what it left to be remembered, and what came out."""

    def check(self) -> None:
        """A lock-step driver has a moment for what else happens beside the loop."""

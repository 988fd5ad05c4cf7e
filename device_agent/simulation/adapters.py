"""The simulated world behind the product's ports: clock, camera, rangefinder, and the walker's ears.

The same adapters serve both ways of keeping time. With :class:`SimulatedClock` the world moves only when the loop
waits (lock step: as fast as the machine can, and the same every time). With a clock of the machine the world follows
real time, as in the live demo.
"""

from __future__ import annotations

from device_agent.ports import Clock
from device_agent.simulation.world import SimulatedWorld
from navcore.cues.table import Cue
from navcore.errors import InputError, SensorError
from navcore.types import CameraIntrinsics, Frame, SonarReading


class SimulatedClock:
    """The world's own time, for a loop of one thread: sleeping is what makes the world go on."""

    def __init__(self, world: SimulatedWorld) -> None:
        self._world = world

    def now_s(self) -> float:
        """Seconds."""
        return self._world.now_s()

    def sleep_until(self, stamp_s: float) -> None:
        """Let the world go on until then."""
        self._world.advance_to(stamp_s)


class SimulatedCamera:
    """The walker's depth camera, at a steady frame rate; frames that nobody asked for in time are skipped."""

    def __init__(self, world: SimulatedWorld, clock: Clock, rate_hz: float = 10.0) -> None:
        """Raises InputError for an impossible rate."""
        if not 1.0 <= rate_hz <= 60.0:
            raise InputError(f"A camera cannot run at {rate_hz:g} Hz: choose 1 to 60 Hz.")
        self._world = world
        self._clock = clock
        self._interval_s = 1.0 / rate_hz
        self._next_s = clock.now_s()
        self._closed = False

    @property
    def intrinsics(self) -> CameraIntrinsics:
        """The camera's geometry."""
        return self._world.camera

    def read(self) -> Frame:
        """Wait for the next capture and return it; its stamp is the time at which it was captured."""
        if self._closed:
            raise SensorError("The simulated camera is closed: start the simulation again.")
        self._clock.sleep_until(self._next_s)
        now_s = self._clock.now_s()
        self._world.advance_to(now_s)
        while self._next_s <= now_s + 1e-6:
            self._next_s += self._interval_s
        return self._world.capture()

    def close(self) -> None:
        """Deliver nothing from now on."""
        self._closed = True


class SimulatedSonar:
    """The ultrasonic rangefinder on the walker's glasses."""

    def __init__(self, world: SimulatedWorld, clock: Clock) -> None:
        self._world = world
        self._clock = clock
        self._closed = False

    def read(self) -> SonarReading:
        """Measure now. Raises SensorError once it is closed."""
        if self._closed:
            raise SensorError("The simulated rangefinder is closed: start the simulation again.")
        self._world.advance_to(self._clock.now_s())
        return self._world.ping()

    def close(self) -> None:
        """Deliver nothing from now on."""
        self._closed = True


class SimulatedEar:
    """A cue output that the simulated walker hears."""

    def __init__(self, world: SimulatedWorld, clock: Clock) -> None:
        self._world = world
        self._clock = clock

    def play(self, cue: Cue) -> None:
        """Let the walker hear it now."""
        self._world.advance_to(self._clock.now_s())
        self._world.hear(cue)

    def close(self) -> None:
        """Nothing is open."""

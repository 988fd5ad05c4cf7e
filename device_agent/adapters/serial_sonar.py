"""The ultrasonic rangefinder on a serial line, through the optional package pyserial (extra ``serial``).

A microcontroller pings and says what came back (:mod:`device_agent.adapters.sonar_line`, docs/hardware.md).
"""

from __future__ import annotations

import importlib.util
import os
from dataclasses import dataclass
from typing import TYPE_CHECKING

from device_agent.adapters.newest import NewestReader
from device_agent.adapters.reopening import Reopening
from device_agent.adapters.sensor_clock import SensorClock
from device_agent.adapters.sonar_line import LineParser, SonarKind, SonarLine
from device_agent.ports import Clock
from navcore.errors import MissingPackageError, SensorError
from navcore.follower.gate import FULL_RANGE_M
from navcore.types import SonarReading, SonarState

if TYPE_CHECKING:
    import serial

BAUD = 115_200
STALE_AFTER_S = 0.25
_READ_TIMEOUT_S = 0.2
_SILENT_READS = 5
"""Reads in a row without a byte, after which the line is silent: one second."""
_MAX_READ_BYTES = 4096
_NONSENSE_BYTES = 1024
"""So many bytes without one good line are no accident."""


@dataclass(frozen=True, slots=True)
class HeardLine:
    """A line, and when its ping was sent."""

    stamp_s: float
    """Seconds on the device's clock."""
    line: SonarLine


class SerialSource:
    """An open serial line, on which a rangefinder talks."""

    def __init__(self, path: str, clock: Clock, baud: int = BAUD) -> None:
        """Raises SensorError where the line cannot be opened, MissingPackageError without the package."""
        if importlib.util.find_spec("serial") is None:
            raise MissingPackageError(
                "A rangefinder on a serial line needs the package 'pyserial':"
                " run `pip install 'virtual-blind-road[serial]'`."
            )
        import serial

        self._path = path
        self._parser = LineParser()
        self._sensor_clock = SensorClock(clock)
        try:
            self._port: serial.Serial = serial.Serial(path, baud, timeout=_READ_TIMEOUT_S, exclusive=True)
        except (OSError, ValueError) as error:
            why = os.strerror(error.errno) if isinstance(error, OSError) and error.errno else str(error)
            raise SensorError(f"No rangefinder is found at {path} ({why}): plug it in, or name its port.") from error

    def read(self) -> HeardLine:
        """Wait for the next line; of several that have come, the newest counts.

        Raises SensorError where the line is silent for a second, says nothing but nonsense, or was unplugged.
        """
        silent_reads = nonsense_bytes = 0
        while silent_reads < _SILENT_READS and nonsense_bytes < _NONSENSE_BYTES:
            data = self._received()
            heard = [
                HeardLine(self._sensor_clock.stamp_s(each.sensor_ms / 1000.0), each) for each in self._parser.feed(data)
            ]
            if heard:
                return heard[-1]
            silent_reads = 0 if data else silent_reads + 1
            nonsense_bytes += len(data)
        if nonsense_bytes < _NONSENSE_BYTES:
            raise SensorError(f"The rangefinder at {self._path} says nothing: check its cable and its power.")
        raise SensorError(f"What comes from {self._path} is no rangefinder: check the port and its baud rate.")

    def close(self) -> None:
        """Let go of the line; closing twice is harmless."""
        self._port.close()

    def _received(self) -> bytes:
        try:
            return self._port.read(max(1, min(self._port.in_waiting, _MAX_READ_BYTES)))
        except (OSError, TypeError) as error:
            # pyserial raises TypeError where the line is closed from another thread meanwhile.
            raise SensorError(f"The rangefinder at {self._path} was unplugged: plug it in again.") from error


def check_line(heard: HeardLine, last: HeardLine | None) -> None:
    """Raise SensorError for a line that says nothing of *now*; ``last`` is the last good one."""
    if heard.line.kind is SonarKind.FAULT:
        raise SensorError("The rangefinder does not answer its microcontroller: check the wires between them.")
    if last is not None and (heard.line.sensor_ms == last.line.sensor_ms or heard.stamp_s < last.stamp_s):
        raise SensorError("The rangefinder repeats old readings: unplug it and plug it in again.")


def reading_of(heard: HeardLine) -> SonarReading:
    """Return what a line means for guidance: an echo from beyond the sensor's range is none."""
    distance_m = heard.line.distance_mm / 1000.0
    if heard.line.kind is SonarKind.ECHO and distance_m <= FULL_RANGE_M:
        return SonarReading(heard.stamp_s, SonarState.OK, distance_m)
    return SonarReading(heard.stamp_s, SonarState.NO_ECHO)


class SerialSonar:
    """The :class:`device_agent.ports.Sonar` on a serial line; unplugged and plugged in again, it goes on."""

    def __init__(self, path: str, clock: Clock, baud: int = BAUD) -> None:
        """Raises SensorError where the line cannot be opened, MissingPackageError without the package."""
        self._clock = clock
        reopening: Reopening[HeardLine] = Reopening(
            "The rangefinder", lambda: SerialSource(path, clock, baud), check_line, clock
        )
        reopening.open()
        self._began_s = clock.now_s()
        self._reader = NewestReader("rangefinder", reopening, clock, reopening.abandon)

    def read(self) -> SonarReading:
        """Return the latest reading, STALE where it is old. Raises SensorError where the rangefinder has failed."""
        heard = self._reader.recent()
        if not heard:
            return SonarReading(self._began_s, SonarState.STALE)
        reading = reading_of(heard[-1])
        is_stale = self._clock.now_s() - reading.stamp_s > STALE_AFTER_S
        return SonarReading(reading.stamp_s, SonarState.STALE) if is_stale else reading

    def close(self) -> None:
        """Deliver nothing from now on; closing twice is harmless."""
        self._reader.close()

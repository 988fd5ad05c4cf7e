"""Frames of a recording, unpacked on disk: a camera's driver hands over pictures, and does not decompress PNG."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np

from device_agent.ports import Clock
from navcore.errors import SensorError
from navcore.recording import depth_from_units, open_recording, units_from_depth
from navcore.types import CameraIntrinsics, Frame

UNITS_PER_M = 1000.0


@dataclass(frozen=True, slots=True)
class PreparedFrames:
    """One file: of each frame colour (h, w, 3) in bytes, then depth (h, w) in 16-bit millimetres."""

    path: Path
    intrinsics: CameraIntrinsics

    @property
    def frame_bytes(self) -> int:
        """Length of one frame."""
        return 5 * self.intrinsics.width_px * self.intrinsics.height_px

    @property
    def count(self) -> int:
        """Number of frames."""
        return self.path.stat().st_size // self.frame_bytes

    def read(self, file: BinaryIO, index: int, stamp_s: float) -> Frame:
        """Return a frame as if it had been taken at ``stamp_s``."""
        height, width = self.intrinsics.height_px, self.intrinsics.width_px
        file.seek(index * self.frame_bytes)
        colour = np.fromfile(file, np.uint8, 3 * height * width).reshape(height, width, 3)
        units = np.fromfile(file, np.uint16, height * width).reshape(height, width)
        return Frame(stamp_s, colour, depth_from_units(units, UNITS_PER_M))


def prepared(recording_folder: Path, path: Path) -> PreparedFrames:
    """Return a recording's frames, unpacked into ``path`` where that has not been done yet."""
    recording = open_recording(recording_folder)
    frames = PreparedFrames(path, recording.intrinsics)
    if not path.exists():
        unfinished = path.with_suffix(".part")
        with unfinished.open("wb") as file:
            for frame in recording.frames():
                file.write(frame.colour_rgb.tobytes())
                file.write(units_from_depth(frame.depth_m, UNITS_PER_M).tobytes())
        unfinished.replace(path)
    return frames


def back_and_forth(count: int) -> Iterator[int]:
    """Yield 0 … count − 1, back to 0, and so on for ever: the walk without a leap."""
    while True:
        yield from range(count - 1)
        yield from range(count - 1, 0, -1)


class PreparedCamera:
    """Gives the frames at a steady rate on a clock, back and forth; what the reader is too slow for is skipped."""

    def __init__(self, frames: PreparedFrames, clock: Clock, rate_hz: float) -> None:
        self._frames, self._clock, self._period_s = frames, clock, 1.0 / rate_hz
        self._file: BinaryIO | None = frames.path.open("rb")
        self._order = back_and_forth(frames.count)
        self._due_s = clock.now_s()
        self._begin_s = self._due_s
        self.captured_count = 0
        """Frames that a camera would have taken, skipped ones included."""

    @property
    def intrinsics(self) -> CameraIntrinsics:
        """The camera that made the recording."""
        return self._frames.intrinsics

    def read(self) -> Frame:
        """Wait for the next capture and return it. Raises SensorError after closing."""
        if self._file is None:
            raise SensorError("The camera is closed: start the benchmark again.")
        index = self._next()
        while self._clock.now_s() - self._due_s > self._period_s:
            index = self._next()
        self._clock.sleep_until(self._due_s)
        return self._frames.read(self._file, index, self._due_s)

    def index_at(self, stamp_s: float) -> int:
        """Return which frame of the recording was given with this stamp."""
        number, last = round((stamp_s - self._begin_s) / self._period_s) - 1, self._frames.count - 1
        place = number % (2 * last)
        return min(place, 2 * last - place)

    def _next(self) -> int:
        self._due_s += self._period_s
        self.captured_count += 1
        return next(self._order)

    def close(self) -> None:
        """Deliver nothing from now on."""
        if self._file is not None:
            self._file.close()
            self._file = None

"""A recording (TUM RGB-D layout) as a camera."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from device_agent.ports import Clock
from navcore.errors import RecordingError, SensorError
from navcore.recording import RecordedFrame, Recording
from navcore.types import CameraIntrinsics, Frame


class RecordedCamera:
    """Plays a recording at its own pace on a clock; what the reader was too slow for is skipped, as with a camera."""

    def __init__(self, recording: Recording, clock: Clock, fresh_for_s: float = 0.2) -> None:
        self._recording = recording
        self._clock = clock
        self._fresh_for_s = fresh_for_s
        self._offset_s = clock.now_s() - recording.entries[0].stamp_s
        self._entries: Iterator[RecordedFrame] | None = iter(recording.entries)

    @property
    def intrinsics(self) -> CameraIntrinsics:
        """The camera that made the recording."""
        return self._recording.intrinsics

    def read(self) -> Frame:
        """Return the next frame that is not late. Raises SensorError at the end, or where an image is damaged."""
        for entry in self._entries or ():
            stamp_s = entry.stamp_s + self._offset_s
            self._clock.sleep_until(stamp_s)
            if self._clock.now_s() - stamp_s <= self._fresh_for_s:
                return self._frame(entry, stamp_s)
        raise SensorError("The recording is at its end: start again to play it once more.")

    def _frame(self, entry: RecordedFrame, stamp_s: float) -> Frame:
        try:
            return _at(self._recording.read(entry), stamp_s)
        except RecordingError as error:
            raise SensorError(str(error)) from error

    def close(self) -> None:
        """Deliver nothing from now on."""
        self._entries = None


def _at(frame: Frame, stamp_s: float) -> Frame:
    """Return the frame as if it had been taken at another time, and its fisheye picture with it."""
    if frame.fisheye is None:
        return replace(frame, stamp_s=stamp_s)
    moved = replace(frame.fisheye, stamp_s=frame.fisheye.stamp_s + stamp_s - frame.stamp_s)
    return replace(frame, stamp_s=stamp_s, fisheye=moved)

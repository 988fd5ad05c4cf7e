"""Newest frame wins: a camera read by a thread of its own, so that a slow loop never works through old frames."""

from __future__ import annotations

from collections.abc import Callable

from device_agent.adapters.newest import NewestReader
from device_agent.ports import Clock, DepthCamera
from navcore.errors import SensorError
from navcore.types import CameraIntrinsics, Frame

_AHEAD_S = 0.2
"""Two clocks may differ by so much; a picture from the future would never be found stale."""


class NewestFrameCamera:
    """Wraps a camera; ``read`` gives its newest frame, each once, or SensorError after ``timeout_s`` without one.

    A camera that hangs inside its driver hangs only its thread. One that fails is asked again until it recovers.
    """

    def __init__(
        self, camera: DepthCamera, clock: Clock, timeout_s: float, abandon: Callable[[], None] | None = None
    ) -> None:
        """``abandon`` makes the camera leave a driver alone that does not return; None waits for it."""
        self._camera = camera
        self._clock = clock
        self.timeout_s = timeout_s
        """Longest time without a picture; may be changed at any time."""
        self._reader: NewestReader[Frame] = NewestReader("camera", camera, clock, abandon)

    @property
    def intrinsics(self) -> CameraIntrinsics:
        """The wrapped camera's geometry."""
        return self._camera.intrinsics

    def read(self) -> Frame:
        """Return the newest frame that was not given yet. Raises SensorError when none comes, or it is old."""
        frame = self._reader.wait(self.timeout_s)
        if frame is None:
            raise SensorError("The camera delivers no pictures: check its cable.")
        age_s = self._clock.now_s() - frame.stamp_s
        if not age_s >= -_AHEAD_S:
            raise SensorError("The camera's stamps are ahead of the clock: how old its pictures are cannot be told.")
        if age_s > self.timeout_s:
            raise SensorError(f"The camera's pictures are {age_s:.1f} s old: the device is overloaded.")
        return frame

    def close(self) -> None:
        """Stop the thread and close the camera."""
        self._reader.close()

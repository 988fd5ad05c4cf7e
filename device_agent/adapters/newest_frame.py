"""Newest frame wins: a camera read by a thread of its own, so that a slow loop never works through old frames."""

from __future__ import annotations

import threading

from device_agent.ports import Clock, DepthCamera
from navcore.errors import SensorError
from navcore.types import CameraIntrinsics, Frame

_RETRY_AFTER_S = 0.2
_AHEAD_S = 0.2
"""Two clocks may differ by so much; a picture from the future would never be found stale."""


class NewestFrameCamera:
    """Wraps a camera; ``read`` gives its newest frame, each once, or SensorError after ``timeout_s`` without one.

    A camera that hangs inside its driver hangs only the thread here. One that fails is asked again until it recovers.
    """

    def __init__(self, camera: DepthCamera, clock: Clock, timeout_s: float) -> None:
        self._camera = camera
        self._clock = clock
        self.timeout_s = timeout_s
        """Longest time without a picture; may be changed at any time."""
        self._arrived = threading.Condition()
        self._newest: Frame | None = None
        self._error: SensorError | None = None
        self._closed = threading.Event()
        self._thread = threading.Thread(target=self._fetch, name="camera", daemon=True)
        self._thread.start()

    @property
    def intrinsics(self) -> CameraIntrinsics:
        """The wrapped camera's geometry."""
        return self._camera.intrinsics

    def read(self) -> Frame:
        """Return the newest frame that was not given yet. Raises SensorError when none comes, or it is old."""
        with self._arrived:
            self._arrived.wait_for(lambda: self._newest or self._error or self._closed.is_set(), self.timeout_s)
            frame, self._newest = self._newest, None
            error, self._error = self._error, None
        if error is not None and frame is None:
            raise error
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
        self._closed.set()
        with self._arrived:
            self._arrived.notify_all()
        self._camera.close()
        self._thread.join(timeout=2 * self.timeout_s)

    def _fetch(self) -> None:
        while not self._closed.is_set():
            try:
                frame = self._camera.read()
            except SensorError as error:
                self._leave(None, error)
                self._closed.wait(_RETRY_AFTER_S)
            except Exception as error:
                self._leave(None, SensorError(f"The camera failed ({type(error).__name__}: {error}): check its cable."))
                self._closed.wait(_RETRY_AFTER_S)
            else:
                self._leave(frame, None)

    def _leave(self, frame: Frame | None, error: SensorError | None) -> None:
        with self._arrived:
            if frame is not None:
                self._newest, self._error = frame, None
            else:
                self._error = error
            self._arrived.notify_all()

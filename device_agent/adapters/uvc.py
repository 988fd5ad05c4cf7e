"""The fisheye camera: any USB camera (UVC) that OpenCV can read, or a video file in its place."""

from __future__ import annotations

import os
import re
import time
from collections.abc import Callable

import cv2
import numpy as np

from device_agent.adapters.reopening import Reopening
from device_agent.adapters.sensor_clock import SensorClock
from device_agent.ports import Clock
from navcore.errors import SensorError
from navcore.types import FisheyeCamera, FisheyeImage

_DEVICE = re.compile(r"/dev/video(\d+)")


class UvcSource:
    """An open camera, read through :class:`cv2.VideoCapture`."""

    def __init__(
        self, path: str, camera: FisheyeCamera, clock: Clock, monotonic_now_s: Callable[[], float] = time.monotonic
    ) -> None:
        """Open a device (``/dev/video2``, or a link to one) or a file. Raises SensorError where it cannot be opened.

        Args:
            path: the device, or the file.
            camera: lens, picture size and mounting.
            clock: the device's clock.
            monotonic_now_s: the clock with which the kernel stamps pictures, seconds.
        """
        self._path = path
        self._camera = camera
        self._clock = clock
        device = _DEVICE.fullmatch(os.path.realpath(path))
        self._capture = cv2.VideoCapture(int(device[1]), cv2.CAP_V4L2) if device else cv2.VideoCapture(path)
        if not self._capture.isOpened():
            raise SensorError(f"No fisheye camera is found at {path}: plug it in, or name another device.")
        self._capture.set(cv2.CAP_PROP_FRAME_WIDTH, camera.intrinsics.width_px)
        self._capture.set(cv2.CAP_PROP_FRAME_HEIGHT, camera.intrinsics.height_px)
        self._sensor_clock = SensorClock(clock, monotonic_now_s)
        self._began_s = None if device else clock.now_s()

    def read(self) -> FisheyeImage:
        """Wait for the next picture and return it. Raises SensorError when none comes, or it is of another size."""
        if not self._capture.grab():
            raise SensorError(f"The fisheye camera at {self._path} delivers no pictures: check its cable.")
        stamp_s = self._stamp_s(self._capture.get(cv2.CAP_PROP_POS_MSEC) / 1000.0)
        decoded, picture = self._capture.retrieve()
        if not decoded:
            raise SensorError(f"The fisheye camera at {self._path} gives damaged pictures: check its cable.")
        lens = self._camera.intrinsics
        if picture.shape[:2] != (lens.height_px, lens.width_px):
            raise SensorError(
                f"The fisheye camera gives {picture.shape[1]}×{picture.shape[0]} pixels, but is calibrated for"
                f" {lens.width_px}×{lens.height_px}: calibrate it at a size that it can deliver."
            )
        grey = picture if picture.ndim == 2 else cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)
        return FisheyeImage(stamp_s, np.array(grey, dtype=np.uint8), self._camera)

    def close(self) -> None:
        """Let go of the camera; closing twice is harmless."""
        self._capture.release()

    def _stamp_s(self, position_s: float) -> float:
        if self._began_s is None:
            return self._sensor_clock.stamp_s(position_s)
        # A file is played at its own pace.
        self._clock.sleep_until(self._began_s + position_s)
        return self._began_s + position_s


def check_picture(picture: FisheyeImage, last: FisheyeImage | None) -> None:
    """Raise SensorError for a picture that says nothing of *now*; ``last`` is the last good one."""
    if not np.isfinite(picture.stamp_s) or (last is not None and picture.stamp_s <= last.stamp_s):
        raise SensorError("The fisheye camera gives old pictures again: unplug it and plug it in again.")


def open_uvc_camera(path: str, camera: FisheyeCamera, clock: Clock) -> Reopening[FisheyeImage]:
    """Return the :class:`WideCamera` at a path, which comes back by itself. Raises SensorError where there is none."""
    reopening: Reopening[FisheyeImage] = Reopening(
        "The fisheye camera", lambda: UvcSource(path, camera, clock), check_picture, clock
    )
    reopening.open()
    return reopening

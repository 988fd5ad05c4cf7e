"""A depth camera that may stall, repeat itself, go blind or be unplugged, and comes back by itself."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from device_agent.adapters.reopening import Reopening, Source
from device_agent.ports import Clock
from navcore.errors import SensorError
from navcore.frame_check import check_frame
from navcore.types import CameraIntrinsics, Frame


class CameraSource(Source[Frame], Protocol):
    """An open depth camera: a thin layer over its SDK."""

    @property
    def intrinsics(self) -> CameraIntrinsics: ...


def check_live_frame(frame: Frame, last: Frame | None, intrinsics: CameraIntrinsics) -> None:
    """Raise SensorError, with the reason, for a frame that says nothing of what is before the walker *now*.

    Args:
        frame: what the camera gave.
        last: the last good frame, None where there was none.
        intrinsics: the camera's geometry.
    """
    check_frame(frame, intrinsics, None if last is None else last.stamp_s)
    if not (frame.depth_m > 0.0).any():
        raise SensorError("The camera measures no distance at all: see whether something covers it.")


class ReopenedCamera:
    """A :class:`DepthCamera` over a source that is opened anew whenever it fails."""

    def __init__(self, opener: Callable[[], CameraSource], clock: Clock, restart_after_s: float = 3.0) -> None:
        """Open the camera for the first time. Raises what the opener raises: at the start somebody can act on it."""
        self._open_source = opener
        self._intrinsics: CameraIntrinsics | None = None
        self._reopening: Reopening[Frame] = Reopening("The camera", self._opened, self._check, clock, restart_after_s)
        self._reopening.open()

    @property
    def intrinsics(self) -> CameraIntrinsics:
        """The camera's geometry, which stays what it was at the start."""
        assert self._intrinsics is not None
        return self._intrinsics

    def read(self) -> Frame:
        """Wait for the next frame and return it. Raises SensorError with the reason where there is none."""
        return self._reopening.read()

    def abandon(self) -> None:
        """Leave a driver alone that does not return; the next call opens the camera anew."""
        self._reopening.abandon()

    def close(self) -> None:
        """Deliver nothing from now on."""
        self._reopening.close()

    def _opened(self) -> CameraSource:
        source = self._open_source()
        if self._intrinsics is None:
            self._intrinsics = source.intrinsics
        elif source.intrinsics != self._intrinsics:
            source.close()
            raise SensorError("Another camera was plugged in: plug in the first one, or start the device again.")
        return source

    def _check(self, frame: Frame, last: Frame | None) -> None:
        check_live_frame(frame, last, self.intrinsics)

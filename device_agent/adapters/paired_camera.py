"""Depth camera and fisheye camera as one: each frame gets the fisheye picture that was taken nearest to it."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import replace

from device_agent.adapters.newest import NewestReader
from device_agent.ports import Clock, DepthCamera, WideCamera
from navcore.errors import SensorError
from navcore.fisheye_recording import MAX_FISHEYE_GAP_S
from navcore.types import CameraIntrinsics, FisheyeImage, Frame

_KEPT = 8
"""Pictures from among which one is chosen: depth takes longer to come than a picture."""
_log = logging.getLogger(__name__)


class PairedCamera:
    """A :class:`DepthCamera` with a second one beside it, without which it goes on as well."""

    def __init__(
        self, camera: DepthCamera, wide: WideCamera, clock: Clock, abandon: Callable[[], None] | None = None
    ) -> None:
        """``abandon`` makes the wide camera leave a driver alone that does not return."""
        self._camera = camera
        self._pictures: NewestReader[FisheyeImage] = NewestReader("fisheye camera", wide, clock, abandon, keep=_KEPT)
        self._failed = False

    @property
    def intrinsics(self) -> CameraIntrinsics:
        """The depth camera's geometry."""
        return self._camera.intrinsics

    def read(self) -> Frame:
        """Wait for the depth camera's next frame and return it. Raises SensorError as the depth camera does."""
        frame = self._camera.read()
        return replace(frame, fisheye=self._nearest(frame.stamp_s))

    def close(self) -> None:
        """Close both."""
        self._camera.close()
        self._pictures.close()

    def _nearest(self, stamp_s: float) -> FisheyeImage | None:
        try:
            pictures = self._pictures.recent()
        except SensorError as error:
            if not self._failed:
                _log.warning("%s Going on with the depth camera alone.", error)
            self._failed = True
            return None
        self._failed = False
        picture = min(pictures, key=lambda each: abs(each.stamp_s - stamp_s), default=None)
        return picture if picture is not None and abs(picture.stamp_s - stamp_s) <= MAX_FISHEYE_GAP_S else None

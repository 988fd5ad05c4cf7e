"""What a frame must be before anything is concluded from it: of a known time, later than the last, and of one size."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from navcore.errors import SensorError
from navcore.types import CameraIntrinsics, Frame


def check_frame(frame: Frame, intrinsics: CameraIntrinsics, last_stamp_s: float | None = None) -> None:
    """Raise SensorError, with what to do, for a frame that was not taken when or how the camera should take it.

    Args:
        frame: what the camera gave.
        intrinsics: the camera's geometry.
        last_stamp_s: when the frame before was taken; None where there was none, or where time may go backwards.
    """
    if not math.isfinite(frame.stamp_s):
        raise SensorError("The camera does not say when its pictures were taken: unplug it and plug it in again.")
    if last_stamp_s is not None and frame.stamp_s <= last_stamp_s:
        raise SensorError("The camera gives old pictures again: unplug it and plug it in again.")
    size = (intrinsics.height_px, intrinsics.width_px)
    if frame.colour_rgb.shape != (*size, 3) or frame.depth_m.shape != size:
        raise SensorError("The camera gives pictures of another size: start the device again.")


def with_known_depth(frame: Frame) -> Frame:
    """Return the frame with NaN, which means unknown, wherever its depth is no finite distance above zero."""
    is_known = np.isfinite(frame.depth_m) & (frame.depth_m > 0.0)
    if np.array_equal(is_known, ~np.isnan(frame.depth_m)):
        return frame
    return replace(frame, depth_m=np.where(is_known, frame.depth_m, np.float32(np.nan)))

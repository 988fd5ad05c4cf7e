"""Intel RealSense D4xx through the optional package pyrealsense2 (extra ``realsense``, x86-64).

Depth is aligned to the colour image by the SDK. Where the lens bends the picture, both are straightened here, so that
the camera is the ideal pinhole that the product works with. A file that the SDK has recorded is played in the camera's
place, at its own pace.
"""

from __future__ import annotations

import contextlib
import importlib
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from device_agent.adapters.gravity import GravityFilter
from device_agent.adapters.sensor_clock import SensorClock
from device_agent.ports import Clock
from navcore.errors import MissingPackageError, SensorError
from navcore.geometry import FloatArray
from navcore.types import CameraIntrinsics, Frame

WIDTH_PX, HEIGHT_PX, RATE_HZ = 640, 480, 30
_TIMEOUT_MS = 1000
_STRAIGHT = 1e-6
"""Distortion coefficients below this bend nothing by a pixel."""


def load_sdk() -> Any:
    """Return the module pyrealsense2. Raises MissingPackageError."""
    try:
        return importlib.import_module("pyrealsense2")
    except ModuleNotFoundError as error:
        raise MissingPackageError(
            "A RealSense camera needs the package 'pyrealsense2', which there is for x86-64 only:"
            " run `pip install 'virtual-blind-road[realsense]'`, or use an OAK camera."
        ) from error


class RealSenseSource:
    """An open camera; a :class:`device_agent.adapters.reopened_camera.CameraSource`."""

    def __init__(
        self,
        clock: Clock,
        serial: str | None = None,
        recording: Path | None = None,
        camera_from_imu: FloatArray | None = None,
        wall_now_s: Callable[[], float] = time.time,
    ) -> None:
        """Open the camera with a serial number, or the first one, or a recording. Raises SensorError without one.

        Raises MissingPackageError without the SDK.

        Args:
            clock: the device's clock.
            serial: the camera's serial number; None takes the first one.
            recording: a file that the SDK has recorded, to be played instead.
            camera_from_imu: how the accelerometer is mounted, its axes to the colour camera's (3, 3), for a recording
                that does not say it.
            wall_now_s: the machine's time of day, with which the SDK stamps, seconds.
        """
        self._sdk = load_sdk()
        self._clock = clock
        self._wall_now_s = wall_now_s
        self._sensor_clock: SensorClock | None = None
        self._gravity = GravityFilter()
        self._pipeline = self._sdk.pipeline()
        try:
            profile = self._started(_device_config(self._sdk, serial, recording))
        except RuntimeError as error:
            raise SensorError(_not_started(recording, error)) from error
        colour = profile.get_stream(self._sdk.stream.color).as_video_stream_profile()
        self._align = self._sdk.align(self._sdk.stream.color)
        lens = colour.get_intrinsics()
        self.intrinsics = CameraIntrinsics(lens.width, lens.height, lens.fx, lens.fy, lens.ppx, lens.ppy)
        """The ideal pinhole to which both images are brought."""
        self._straight = straightening(self._sdk, lens)
        self._camera_from_imu = camera_from_imu
        felt = [each for each in profile.get_streams() if each.stream_type() == self._sdk.stream.accel]
        if felt and camera_from_imu is None:
            self._camera_from_imu = mounting_of(felt[0], colour)

    def read(self) -> Frame:
        """Wait for the next frame and return it. Raises SensorError when none comes for a second."""
        arrived, frames = self._pipeline.try_wait_for_frames(_TIMEOUT_MS)
        if not arrived:
            raise SensorError("The RealSense camera delivers no pictures: check its cable.")
        aligned = self._align.process(frames)
        depth, colour = aligned.get_depth_frame(), aligned.get_color_frame()
        if not depth or not colour:
            raise SensorError("The RealSense camera gives colour without depth: unplug it and plug it in again.")
        stamp_s = self._stamp_s(depth)
        self._feel(frames, stamp_s)
        # The SDK's images lie in memory that it uses again: everything below is a copy.
        units = np.asanyarray(depth.get_data())
        depth_m = units.astype(np.float32) * np.float32(depth.get_units())
        depth_m[units == 0] = np.nan
        colour_rgb = np.array(colour.get_data(), dtype=np.uint8)
        if self._straight is not None:
            colour_rgb = cv2.remap(colour_rgb, *self._straight, cv2.INTER_LINEAR).astype(np.uint8, copy=False)
            # A mean of two distances is a thing that stands nowhere; and what lies outside was not seen.
            depth_m = cv2.remap(
                depth_m, *self._straight, cv2.INTER_NEAREST, borderMode=cv2.BORDER_CONSTANT, borderValue=np.nan
            ).astype(np.float32, copy=False)
        return Frame(stamp_s, colour_rgb, depth_m, gravity=self._gravity.down(stamp_s))

    def close(self) -> None:
        """Let go of the camera; closing twice is harmless."""
        with contextlib.suppress(RuntimeError):
            self._pipeline.stop()

    def _started(self, config: Any) -> Any:
        """Start colour and depth, and the accelerometer where the camera has one."""
        stream, form = self._sdk.stream, self._sdk.format
        config.enable_stream(stream.depth, WIDTH_PX, HEIGHT_PX, form.z16, RATE_HZ)
        config.enable_stream(stream.color, WIDTH_PX, HEIGHT_PX, form.rgb8, RATE_HZ)
        config.enable_stream(stream.accel)
        if not config.can_resolve(self._sdk.pipeline_wrapper(self._pipeline)):
            config.disable_stream(stream.accel)
        return self._pipeline.start(config)

    def _stamp_s(self, frame: Any) -> float:
        if self._sensor_clock is None:
            # The camera's own clock has nothing to do with the machine's; the SDK's other two are its time of day.
            hardware = frame.get_frame_timestamp_domain() == self._sdk.timestamp_domain.hardware_clock
            self._sensor_clock = SensorClock(self._clock, None if hardware else self._wall_now_s)
        return self._sensor_clock.stamp_s(frame.get_timestamp() / 1000.0)

    def _feel(self, frames: Any, stamp_s: float) -> None:
        accel = frames.first_or_default(self._sdk.stream.accel)
        if accel and self._camera_from_imu is not None:
            felt = accel.as_motion_frame().get_motion_data()
            self._gravity.add(stamp_s, self._camera_from_imu @ np.array([felt.x, felt.y, felt.z]))


def _device_config(sdk: Any, serial: str | None, recording: Path | None) -> Any:
    config = sdk.config()
    if recording is not None:
        config.enable_device_from_file(str(recording), False)
        return config
    # Asked first, for the SDK waits a quarter of a minute for a camera that is not there.
    found = [device.get_info(sdk.camera_info.serial_number) for device in sdk.context().query_devices()]
    if not found:
        raise SensorError("No RealSense camera is found: plug it into a USB 3 socket.")
    if serial is not None and serial not in found:
        raise SensorError(f"No RealSense camera {serial} is found, but {', '.join(found)}: name one of these.")
    config.enable_device(serial or found[0])
    return config


def _not_started(recording: Path | None, error: RuntimeError) -> str:
    if recording is not None:
        return f"{recording} is no recording of the RealSense SDK ({error}): name another file."
    return (
        f"The RealSense camera cannot be started ({error}): see whether another program uses it, and plug it into a"
        " USB 3 socket."
    )


def mounting_of(felt: Any, colour: Any) -> FloatArray | None:
    """Return the rotation (3, 3) of the accelerometer's axes to the colour camera's, from the SDK's stream profiles.

    None where the camera does not say it.
    """
    try:
        extrinsics = felt.get_extrinsics_to(colour)
    except RuntimeError:
        return None
    # The SDK stores matrices column by column.
    rotation: FloatArray = np.array(extrinsics.rotation, dtype=np.float64).reshape(3, 3, order="F")
    return rotation


def straightening(sdk: Any, lens: Any) -> tuple[NDArray[np.float32], NDArray[np.float32]] | None:
    """Return where each pixel of the ideal pinhole is found in the picture, x (h, w) and y (h, w).

    None where the picture is straight already. ``lens`` is the SDK's ``intrinsics``; the SDK itself is asked, for its
    distortion models are not OpenCV's.
    """
    if lens.model == sdk.distortion.none or all(abs(value) < _STRAIGHT for value in lens.coeffs):
        return None
    found_x, found_y = np.empty((2, lens.height, lens.width), np.float32)
    for v in range(lens.height):
        for u in range(lens.width):
            ray = [(u - lens.ppx) / lens.fx, (v - lens.ppy) / lens.fy, 1.0]
            found_x[v, u], found_y[v, u] = sdk.rs2_project_point_to_pixel(lens, ray)
    return found_x, found_y

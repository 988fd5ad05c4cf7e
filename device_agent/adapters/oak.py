"""Luxonis OAK cameras with stereo depth through the optional package depthai (extra ``oak``, x86-64 and aarch64).

The camera itself aligns depth to the colour image, straightens both, and pairs what was taken at the same time.
"""

from __future__ import annotations

import contextlib
import importlib.util
import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from datetime import timedelta
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from device_agent.adapters.gravity import GravityFilter
from device_agent.adapters.sensor_clock import SensorClock
from device_agent.ports import Clock
from navcore.errors import MissingPackageError, SensorError
from navcore.geometry import FloatArray
from navcore.types import CameraIntrinsics, Frame

if TYPE_CHECKING:
    # The package brings types, so that every call below is checked against the real interface.
    import depthai

WIDTH_PX, HEIGHT_PX, RATE_HZ = 640, 400, 20
ACCELEROMETER_HZ = 100
_TIMEOUT = timedelta(seconds=1)
_PAIRED_WITHIN = timedelta(milliseconds=15)
_QUEUED_FRAMES = 2
_QUEUED_SAMPLES = 50
_BEHAVES = {
    "DEPTHAI_TELEMETRY": "0",
    "DEPTHAI_DISABLE_CRASHDUMP_COLLECTION": "1",
    "DEPTHAI_DISABLE_FEEDBACK": "1",
    "DEPTHAI_DISABLE_STARTUP_NOTIFICATIONS": "1",
    "DEPTHAI_INSTALL_SIGNAL_HANDLER": "0",
}
"""What the SDK reads when it is loaded: lest it calls its maker, to whom it sends ids and what it is used for, and lest
it ends the process where a file may not grow any more, which Python takes for a write that fails."""


def require_sdk() -> None:
    """Raise MissingPackageError where the package is not there."""
    if importlib.util.find_spec("depthai") is None:
        raise MissingPackageError(
            "An OAK camera needs the package 'depthai': run `pip install 'virtual-blind-road[oak]'`."
        )


def restrain_sdk() -> None:
    """Let the SDK send nothing to its maker, and leave signals alone; to be called before it is loaded.

    Who has set a variable keeps theirs.
    """
    for name, value in _BEHAVES.items():
        os.environ.setdefault(name, value)


@dataclass(frozen=True, slots=True)
class OakStreams:
    """A running camera as the source reads it: the SDK's own queues, and how the accelerometer is mounted."""

    frames: depthai.MessageQueue
    """``MessageGroup`` with the ``ImgFrame`` *colour* (RGB888i) and *depth* (RAW16, mm)."""
    samples: depthai.MessageQueue | None
    """``IMUData``; None where the camera has no accelerometer."""
    camera_from_imu: FloatArray | None
    """Rotation (3, 3) of the accelerometer's axes to the colour camera's."""
    pipeline: depthai.Pipeline
    device: depthai.Device | None = None
    """The camera itself, to be let go of at the end."""


class OakSource:
    """An open camera; a :class:`device_agent.adapters.reopened_camera.CameraSource`."""

    def __init__(
        self,
        clock: Clock,
        device_id: str | None = None,
        streams: OakStreams | None = None,
        steady_now_s: Callable[[], float] = time.monotonic,
    ) -> None:
        """Open the camera with an id, or the first one, and wait for its first frame.

        Raises SensorError where there is none, MissingPackageError without the SDK.

        Args:
            clock: the device's clock.
            device_id: the camera's id; None takes the first one.
            streams: those of a camera that runs already, instead of opening one.
            steady_now_s: the clock to which the SDK brings all stamps (its ``Clock.now()``), seconds.
        """
        require_sdk()
        self._streams = streams or open_streams(device_id)
        self._sensor_clock = SensorClock(clock, steady_now_s)
        self._gravity = GravityFilter()
        self._first: depthai.MessageGroup | None = None
        try:
            self._first = self._next_group()
            self.intrinsics = intrinsics_of(_picture(self._first, "colour"))
            """The ideal pinhole to which the camera brings both images."""
        except Exception:
            self.close()
            raise

    def read(self) -> Frame:
        """Wait for the next frame and return it. Raises SensorError when none comes for a second."""
        group, self._first = self._first or self._next_group(), None
        colour, depth = _picture(group, "colour"), _picture(group, "depth")
        taken_s = colour.getTimestamp().total_seconds()
        self._feel()
        units = np.asarray(depth.getFrame())
        depth_m = units.astype(np.float32) * np.float32(1e-3)
        depth_m[units == 0] = np.nan
        return Frame(
            self._sensor_clock.stamp_s(taken_s),
            np.array(colour.getFrame(), dtype=np.uint8),
            depth_m,
            gravity=self._gravity.down(taken_s),
        )

    def close(self) -> None:
        """Let go of the camera; closing twice is harmless."""
        with contextlib.suppress(Exception):
            self._streams.pipeline.stop()
        if self._streams.device is not None:
            self._streams.device.close()

    def _next_group(self) -> depthai.MessageGroup:
        group = self._streams.frames.get(_TIMEOUT)
        if group is None:
            raise SensorError("The OAK camera delivers no pictures: check its cable.")
        return cast("depthai.MessageGroup", group)

    def _feel(self) -> None:
        samples, rotation = self._streams.samples, self._streams.camera_from_imu
        if samples is None or rotation is None:
            return
        for message in samples.tryGetAll():
            for packet in cast("depthai.IMUData", message).packets:
                felt = packet.acceleroMeter
                self._gravity.add(felt.getTimestamp().total_seconds(), rotation @ np.array([felt.x, felt.y, felt.z]))


def _picture(group: depthai.MessageGroup, name: str) -> depthai.ImgFrame:
    return cast("depthai.ImgFrame", group[name])


def intrinsics_of(colour: depthai.ImgFrame) -> CameraIntrinsics:
    """Return the pinhole behind a straightened picture."""
    # The SDK's own types leave this call untyped.
    transformation: Any = colour.getTransformation()
    matrix = np.array(transformation.getIntrinsicMatrix(), dtype=np.float64)
    fx_px, fy_px, cx_px, cy_px = (float(matrix[place]) for place in ((0, 0), (1, 1), (0, 2), (1, 2)))
    return CameraIntrinsics(colour.getWidth(), colour.getHeight(), fx_px, fy_px, cx_px, cy_px)


def open_streams(device_id: str | None) -> OakStreams:
    """Start a camera. Raises SensorError where there is none, or it has no depth."""
    restrain_sdk()
    import depthai

    # Asked first, for the SDK waits long for a camera that is not there.
    found = depthai.Device.getAllAvailableDevices()
    if not found:
        raise SensorError("No OAK camera is found: plug it into a USB 3 socket.")
    wanted = [info for info in found if device_id in (None, info.deviceId, info.name)]
    if not wanted:
        names = ", ".join(info.deviceId for info in found)
        raise SensorError(f"No OAK camera {device_id} is found, but {names}: name one of these.")
    try:
        device = depthai.Device(wanted[0])
    except RuntimeError as error:
        raise SensorError(f"The OAK camera does not answer ({error}): plug it in again.") from error
    try:
        return _started(depthai.Pipeline(device), device)
    except RuntimeError as error:
        device.close()
        raise SensorError(f"The OAK camera cannot be started ({error}): it must have stereo depth.") from error


def _started(pipeline: depthai.Pipeline, device: depthai.Device) -> OakStreams:
    from depthai import ImgFrame, node

    socket = _colour_socket(device)
    camera = pipeline.create(node.Camera).build(socket, sensorFps=RATE_HZ)
    colour = camera.requestOutput((WIDTH_PX, HEIGHT_PX), ImgFrame.Type.RGB888i, fps=RATE_HZ, enableUndistortion=True)
    depth = pipeline.create(node.Depth)
    depth.setAlignTo(colour)
    pairs = pipeline.create(node.Sync)
    pairs.setSyncThreshold(_PAIRED_WITHIN)
    colour.link(pairs.inputs["colour"])
    depth.depth.link(pairs.inputs["depth"])
    # Queues that do not block: what is not read in time gives way to what is newer.
    frames = pairs.out.createOutputQueue(_QUEUED_FRAMES, False)
    samples, rotation = _accelerometer(pipeline, device, socket)
    pipeline.start()
    return OakStreams(frames, samples, rotation, pipeline, device)


def _colour_socket(device: depthai.Device) -> depthai.CameraBoardSocket:
    from depthai import CameraSensorType

    for features in device.getConnectedCameraFeatures():
        if CameraSensorType.COLOR in features.supportedTypes:
            return features.socket
    raise SensorError("This OAK camera has no colour camera: use one with colour and stereo depth.")


def _accelerometer(
    pipeline: depthai.Pipeline, device: depthai.Device, socket: depthai.CameraBoardSocket
) -> tuple[depthai.MessageQueue | None, FloatArray | None]:
    """Return the accelerometer's queue and how it is mounted; neither where camera or calibration has none."""
    from depthai import IMUSensor, node

    if device.getConnectedIMU() in ("", "NONE"):
        return None, None
    try:
        rotation = mounting_of(device.readCalibration(), socket)
    except RuntimeError:
        return None, None
    imu = pipeline.create(node.IMU)
    imu.enableIMUSensor(IMUSensor.ACCELEROMETER_CALIBRATED, ACCELEROMETER_HZ)
    imu.setBatchReportThreshold(1)
    imu.setMaxBatchReports(10)
    return imu.out.createOutputQueue(_QUEUED_SAMPLES, False), rotation


def mounting_of(calibration: depthai.CalibrationHandler, socket: depthai.CameraBoardSocket) -> FloatArray:
    """Return the rotation (3, 3) of the accelerometer's axes to a camera's."""
    rotation: FloatArray = np.array(calibration.getImuToCameraExtrinsics(socket), dtype=np.float64)[:3, :3]
    return rotation

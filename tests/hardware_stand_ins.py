"""What stands in for hardware in the tests: pseudo-terminals, pipes, video files, and the SDKs' own objects."""

from __future__ import annotations

import datetime
import fcntl
import os
import struct
import termios
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from device_agent.adapters.evdev_buttons import EV_KEY, INPUT_EVENT
from device_agent.adapters.oak import OakStreams
from device_agent.adapters.sonar_line import SonarKind, SonarLine, encoded
from navcore.geometry import Transform
from navcore.types import FisheyeCamera, FisheyeIntrinsics

PATIENCE_S = 20.0
WIDTH_PX, HEIGHT_PX = 64, 48
FISHEYE = FisheyeCamera(
    FisheyeIntrinsics(160, 120, 45.0, 45.0, 79.5, 59.5, 0.01, 0.0, 0.0, 0.0, np.radians(80.0)), Transform.identity()
)


def eventually(what: Callable[[], bool]) -> None:
    """Return as soon as something that another thread does is so; fail when it never is."""
    give_up_s = time.monotonic() + PATIENCE_S
    nobody = threading.Event()
    while not what():
        assert time.monotonic() < give_up_s, "it never happened"
        nobody.wait(0.002)


def waiting_bytes(terminal: int) -> int:
    """Return how many bytes wait to be read from a terminal."""
    return int(struct.unpack("@i", fcntl.ioctl(terminal, termios.FIONREAD, bytes(4)))[0])


class SerialLine:
    """A pseudo-terminal behind a path that stays the same, as a serial adapter's does when it is plugged in again."""

    def __init__(self, folder: Path) -> None:
        self.path = str(folder / "ttyUSB0")
        self._ours: int | None = None
        self._theirs = -1
        self.plug()

    def plug(self) -> None:
        """Plug it in."""
        ours, self._theirs = os.openpty()
        os.symlink(os.ttyname(self._theirs), self.path)
        os.set_blocking(ours, False)
        self._ours = ours

    def unplug(self) -> None:
        """Pull it out."""
        assert self._ours is not None
        os.close(self._ours)
        os.close(self._theirs)
        os.unlink(self.path)
        self._ours = None

    def send(self, data: bytes) -> int:
        """Send what fits; return how much did. A line that nobody reads takes only so much."""
        assert self._ours is not None
        try:
            return os.write(self._ours, data)
        except BlockingIOError:
            return 0

    def settle(self, byte_count: int) -> None:
        """Return when so many bytes wait to be read: the kernel passes them on in its own time."""
        eventually(lambda: waiting_bytes(self._theirs) == byte_count)

    def say(self, sensor_ms: int, distance_mm: int) -> None:
        """Send one line as the microcontroller does."""
        kind = SonarKind.ECHO if distance_mm else SonarKind.NO_ECHO
        line = encoded(SonarLine(sensor_ms, kind, distance_mm))
        assert self.send(line) == len(line)

    def close(self) -> None:
        """Pull it out, where it is in."""
        if self._ours is not None:
            self.unplug()


def write_video(path: Path, picture_count: int = 60, rate_hz: int = 30) -> str:
    """Write a video of the fisheye camera, each picture brighter than the one before."""
    size = (FISHEYE.intrinsics.width_px, FISHEYE.intrinsics.height_px)
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), rate_hz, size)
    for index in range(picture_count):
        writer.write(np.full((size[1], size[0], 3), 4 * index % 256, np.uint8))
    writer.release()
    return str(path)


class InputDevice:
    """A pipe behind a path, through which key events come as from ``/dev/input``."""

    def __init__(self, folder: Path) -> None:
        self.path = str(folder / "event3")
        self._file: int | None = None
        self.plug()

    def plug(self) -> None:
        """Plug it in."""
        os.mkfifo(self.path)
        self._file = os.open(self.path, os.O_RDWR | os.O_NONBLOCK)

    def unplug(self) -> None:
        """Pull it out: whoever reads finds the end."""
        assert self._file is not None
        os.close(self._file)
        os.unlink(self.path)

    def key(self, stamp_s: float, code: int, value: int, kind: int = EV_KEY) -> None:
        """A key goes down (1), up (0), or repeats itself (2)."""
        self.send(INPUT_EVENT.pack(int(stamp_s), round(stamp_s % 1.0 * 1e6), kind, code, value))

    def send(self, data: bytes) -> None:
        """Send bytes as they are."""
        assert self._file is not None
        assert os.write(self._file, data) == len(data)


def make_framebuffer(folder: Path, bits_per_pixel: int = 32, width_px: int = 640, height_px: int = 180) -> Path:
    """Make what ``/sys/class/graphics/fb0`` says, and a file in the display's place; return the file."""
    said = folder / "fb0"
    said.mkdir()
    row_bytes = width_px * bits_per_pixel // 8 + 64
    (said / "virtual_size").write_text(f"{width_px},{2 * height_px}\n")
    (said / "mode").write_text(f"U:{width_px}x{height_px}p-60\n")
    (said / "bits_per_pixel").write_text(f"{bits_per_pixel}\n")
    (said / "stride").write_text(f"{row_bytes}\n")
    (folder / "dev").mkdir()
    device = folder / "dev" / "fb0"
    device.write_bytes(bytes(row_bytes * height_px))
    return device


# --------------------------------------------------------------------------------------------------- RealSense
def software_camera(sdk: Any, mounting: Any = None) -> tuple[Any, dict[str, Any], dict[str, Any]]:
    """Return the SDK's own ``software_device``, its sensors and its streams: colour, depth and accelerometer.

    ``mounting`` is the SDK's ``extrinsics`` of the accelerometer to the colour camera. The streams live no longer than
    the device.
    """
    device = sdk.software_device()
    device.register_info(sdk.camera_info.serial_number, "1234")
    device.register_info(sdk.camera_info.name, "camera of the test")
    sensors = {name: device.add_sensor(name) for name in ("depth", "colour", "accelerometer")}
    streams = {
        "depth": sensors["depth"].add_video_stream(_video(sdk, sdk.stream.depth, 0, sdk.format.z16, 2), True),
        "colour": sensors["colour"].add_video_stream(_video(sdk, sdk.stream.color, 1, sdk.format.rgb8, 3), True),
    }
    motion = sdk.motion_stream()
    motion.type, motion.index, motion.uid, motion.fps = sdk.stream.accel, 0, 2, 100
    motion.fmt, motion.intrinsics = sdk.format.motion_xyz32f, sdk.motion_device_intrinsic()
    streams["accelerometer"] = sensors["accelerometer"].add_motion_stream(motion, True)
    sensors["depth"].add_read_only_option(sdk.option.depth_units, 0.001)
    same = sdk.extrinsics()
    same.rotation, same.translation = [1.0, 0, 0, 0, 1, 0, 0, 0, 1], [0.0, 0, 0]
    for one in streams.values():
        for other in streams.values():
            if one is not other:
                is_mounting = one is streams["accelerometer"] and other is streams["colour"]
                one.register_extrinsics_to(other, mounting if mounting and is_mounting else same)
    device.create_matcher(sdk.matchers.default)
    return device, sensors, streams


def _video(sdk: Any, kind: Any, uid: int, form: Any, bytes_per_pixel: int) -> Any:
    stream = sdk.video_stream()
    stream.type, stream.index, stream.uid, stream.fps = kind, 0, uid, 30
    stream.width, stream.height, stream.bpp, stream.fmt = 640, 480, bytes_per_pixel, form
    stream.intrinsics = lens(sdk)
    return stream


def lens(sdk: Any, coefficients: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0, 0.0), model: str = "brown_conrady") -> Any:
    """Return ``intrinsics`` of the SDK."""
    made = sdk.intrinsics()
    made.width, made.height, made.fx, made.fy, made.ppx, made.ppy = 640, 480, 600.0, 600.0, 319.5, 239.5
    made.model, made.coeffs = getattr(sdk.distortion, model), list(coefficients)
    return made


def record_software_camera(
    sdk: Any, path: Path, frame_count: int, *, wall_s: float | None = None, interval_s: float = 0.0
) -> None:
    """Let the SDK record its software device: frame n is n everywhere in colour, and 1 m + n mm away.

    Stamps are of the camera's own clock, or, from ``wall_s`` on, of the machine's time of day. The SDK plays frames at
    the pace at which they came.
    """
    device, sensors, streams = software_camera(sdk)
    recorder = sdk.recorder(str(path), device)
    queue = sdk.frame_queue(4)
    for sensor in recorder.query_sensors():
        sensor.open(sensor.get_stream_profiles()[0])
        sensor.start(queue)
    pace = threading.Event()
    domain = sdk.timestamp_domain.hardware_clock if wall_s is None else sdk.timestamp_domain.system_time
    for number in range(1, frame_count + 1):
        stamp_ms = 1000.0 * ((wall_s or 0.0) + number / 30.0)
        _push(sdk, sensors, streams, number, stamp_ms, domain)
        pace.wait(interval_s)
    for sensor in recorder.query_sensors():
        sensor.stop()
        sensor.close()
    recorder.pause()


def _push(sdk: Any, sensors: Any, streams: Any, number: int, stamp_ms: float, domain: Any) -> None:
    depth_mm = np.full((480, 640), 1000 + number, np.uint16)
    depth_mm[:, :20] = 0
    pictures = {"depth": (depth_mm, 2), "colour": (np.full((480, 640, 3), number % 256, np.uint8), 3)}
    for name, (pixels, bytes_per_pixel) in pictures.items():
        frame = sdk.software_video_frame()
        frame.pixels, frame.bpp, frame.stride = pixels, bytes_per_pixel, 640 * bytes_per_pixel
        frame.timestamp, frame.domain, frame.frame_number = stamp_ms, domain, number
        frame.profile = streams[name].as_video_stream_profile()
        if name == "depth":
            frame.depth_units = 0.001
        sensors[name].on_video_frame(frame)
    felt = sdk.software_motion_frame()
    up = sdk.vector()
    up.x, up.y, up.z = 0.0, -9.81, 0.0
    felt.data = up
    felt.timestamp, felt.domain, felt.frame_number = stamp_ms, domain, number
    felt.profile = streams["accelerometer"].as_motion_stream_profile()
    sensors["accelerometer"].on_motion_frame(felt)


# --------------------------------------------------------------------------------------------------------- OAK
class OakStandIn:
    """The queues of a running OAK camera, made of the SDK's own objects, and filled by hand."""

    def __init__(self, sdk: Any) -> None:
        self._sdk = sdk
        self.frames = sdk.MessageQueue("frames", 4, False)
        self.samples = sdk.MessageQueue("samples", 50, False)
        self.streams = OakStreams(self.frames, self.samples, np.eye(3), sdk.Pipeline(False))

    def run(self, stopped: threading.Event) -> None:
        """Send pairs at 50 Hz, as a camera does, until ``stopped``."""
        while not stopped.wait(0.02):
            self.send(time.monotonic(), 90, 1500)

    def send(self, taken_s: float, level: int, depth_mm: int) -> None:
        """Send a pair of pictures, each the same all over, and what the accelerometer felt: the camera held level."""
        sdk, taken = self._sdk, datetime.timedelta(seconds=taken_s)
        colour, depth = sdk.ImgFrame(), sdk.ImgFrame()
        colour.setCvFrame(np.full((HEIGHT_PX, WIDTH_PX, 3), (30, 20, level), np.uint8), sdk.ImgFrame.Type.RGB888i)
        depth_image = np.full((HEIGHT_PX, WIDTH_PX), depth_mm, np.uint16)
        depth_image[:, :5] = 0
        depth.setCvFrame(depth_image, sdk.ImgFrame.Type.RAW16)
        matrix = [[60.0, 0.0, 31.5], [0.0, 61.0, 23.5], [0.0, 0.0, 1.0]]
        group = sdk.MessageGroup()
        for name, picture in (("colour", colour), ("depth", depth)):
            picture.setTransformation(sdk.ImgTransformation(WIDTH_PX, HEIGHT_PX, matrix))
            picture.setTimestamp(taken)
            group[name] = picture
        felt = sdk.IMUData()
        packet = sdk.IMUPacket()
        packet.acceleroMeter.x, packet.acceleroMeter.y, packet.acceleroMeter.z = 0.0, -9.81, 0.0
        packet.acceleroMeter.timestamp = _timestamp(sdk, taken_s)
        felt.packets = [packet]
        self.samples.send(felt)
        self.frames.send(group)


def _timestamp(sdk: Any, seconds: float) -> Any:
    stamp = sdk.Timestamp()
    stamp.sec, stamp.nsec = int(seconds), int((seconds % 1.0) * 1e9)
    return stamp

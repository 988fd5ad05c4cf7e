"""Where the frames, pictures and readings come from that a calibration is made of.

The simulator, a recording (a folder in the TUM layout, or a file of a walk), or the cameras themselves: each as an
iterator, so that the same measurement runs on all of them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from device_agent.adapters.clocks import SystemClock
from device_agent.adapters.fakes import NoSonar
from device_agent.adapters.newest_frame import NewestFrameCamera
from device_agent.adapters.reopened_camera import ReopenedCamera
from device_agent.ports import Clock, Sonar
from device_agent.sensor_names import SensorName
from device_agent.sensors import open_camera
from navcore.errors import InputError, SensorError
from navcore.geometry import Transform
from navcore.recorded_files import read_image
from navcore.recording import open_recording
from navcore.types import (
    CameraIntrinsics,
    FisheyeCamera,
    FisheyeImage,
    FisheyeIntrinsics,
    Frame,
    ImageGrey,
    SonarReading,
)

Sensed = tuple[Frame, SonarReading | None]
NamedPicture = tuple[str, ImageGrey]
_CAMERA_TIMEOUT_S = 2.0
_GIVES_UP_AFTER = 10
"""Failures of a camera in a row."""
_PICTURE_SUFFIXES = frozenset({".png", ".jpg", ".jpeg"})


@dataclass(frozen=True, slots=True, eq=False)
class FrameSource:
    """Frames with the rangefinder's readings of the same moments, from whatever was named."""

    intrinsics: CameraIntrinsics
    sensed: Iterator[Sensed]

    @property
    def frames(self) -> Iterator[Frame]:
        """The frames alone."""
        return (frame for frame, _ in self.sensed)


def simulated_standing(seed: int = 1) -> FrameSource:
    """Return what somebody sees who stands in the hall of the simulated office."""
    from device_agent.simulation.office_floor import office_floor
    from device_agent.simulation.walker import drawn_walker
    from device_agent.simulation.world import SimulatedWorld, start_at

    building = office_floor()
    world = SimulatedWorld(building, drawn_walker(seed), start_at(building, "Hall"), seed)

    def sensed() -> Iterator[Sensed]:
        while True:
            world.advance(0.1)
            yield world.capture(), world.ping()

    return FrameSource(world.camera, sensed())


def simulated_wall(seed: int = 1) -> FrameSource:
    """Return what somebody senses before a bare wall of the simulator, near and far, turned this way and that."""
    from device_agent.simulation.bare_wall import WALL_X_M, bare_wall
    from device_agent.simulation.building import Start, renderer_of
    from device_agent.simulation.walker import drawn_walker
    from device_agent.simulation.world import SimulatedWorld

    building = bare_wall()
    renderer, walker = renderer_of(building), drawn_walker(seed)
    spots = [(away_m, turn_deg) for away_m in (1.0, 1.4, 1.8, 2.2, 2.6) for turn_deg in range(-24, 25, 4)]
    worlds = (
        SimulatedWorld(
            building, walker, Start(WALL_X_M - away_m, 0.0, math.radians(turn_deg)), seed + number, renderer=renderer
        )
        for number, (away_m, turn_deg) in enumerate(spots)
    )
    first = SimulatedWorld(building, walker, Start(0.0, 0.0, 0.0), seed, renderer=renderer)
    return FrameSource(first.camera, ((world.capture(), world.ping()) for world in worlds))


def recorded(path: Path) -> FrameSource:
    """Return the frames of a recording: a folder (TUM layout), or a file of a walk with pictures. Raises InputError."""
    if path.is_dir():
        recording = open_recording(path)
        return FrameSource(recording.intrinsics, ((frame, None) for frame in recording.frames()))
    from device_agent.recording.reading import RecordedPart

    part = RecordedPart(path)
    if part.description.get("pictures") != "yes":
        raise InputError(f"{path} was recorded without pictures: record a walk with them, and calibrate from that.")
    sensed = ((cycle.frame, cycle.notes.sonar) for cycle in part.cycles() if cycle.frame is not None)
    return FrameSource(part.opening.intrinsics, sensed)


def live(camera: SensorName, sonar: SensorName | None, stack: ExitStack) -> FrameSource:
    """Open the cameras themselves; ``stack`` closes them. Raises SensorError, MissingPackageError."""
    clock = SystemClock()
    rangefinder = _rangefinder(sonar, clock)
    stack.callback(rangefinder.close)
    source = ReopenedCamera(lambda: open_camera(camera, clock), clock)
    newest = NewestFrameCamera(source, clock, _CAMERA_TIMEOUT_S, source.abandon)
    stack.callback(newest.close)

    def sensed() -> Iterator[Sensed]:
        for frame in _persistently(newest.read):
            try:
                yield frame, rangefinder.read()
            except SensorError:
                yield frame, None

    return FrameSource(newest.intrinsics, sensed())


def _rangefinder(name: SensorName | None, clock: Clock) -> Sonar:
    if name is None or name.where is None:
        return NoSonar(clock)
    from device_agent.adapters.serial_sonar import SerialSonar

    return SerialSonar(name.where, clock)


def _persistently(read: Callable[[], Frame]) -> Iterator[Frame]:
    """Read again and again; a camera may need some seconds to begin. Raises SensorError where it does not."""
    failure_count = 0
    while True:
        try:
            frame = read()
        except SensorError:
            failure_count += 1
            if failure_count >= _GIVES_UP_AFTER:
                raise
        else:
            failure_count = 0
            yield frame


# -------------------------------------------------------------------------------------------------- pictures
def pictures_in(folder: Path) -> Iterator[NamedPicture]:
    """Read the pictures of a folder, by name. Raises InputError where there are none, or one is damaged."""
    if not folder.is_dir():
        raise InputError(f"There is no folder {folder}: name one that holds the pictures of the board.")
    paths = sorted(path for path in folder.iterdir() if path.suffix.lower() in _PICTURE_SUFFIXES)
    if not paths:
        raise InputError(f"{folder} holds no pictures: put PNG or JPEG files of the board there.")
    for path in paths:
        grey = read_image(path, cv2.IMREAD_GRAYSCALE)
        if grey is None:
            raise InputError(f"{path} is damaged or no picture: take it again, or remove it.")
        yield path.name, np.ascontiguousarray(grey, dtype=np.uint8)


def colour_pictures(frames: Iterator[Frame]) -> Iterator[NamedPicture]:
    """Return the colour pictures of frames in grey, named by number."""
    for number, frame in enumerate(frames, 1):
        yield f"frame {number}", np.asarray(cv2.cvtColor(frame.colour_rgb, cv2.COLOR_RGB2GRAY), np.uint8)


def fisheye_pictures(frames: Iterator[Frame]) -> Iterator[NamedPicture]:
    """Return the fisheye pictures of frames, named by number; frames without one are left out."""
    for number, frame in enumerate(frames, 1):
        if frame.fisheye is not None:
            yield f"frame {number}", frame.fisheye.grey


def live_fisheye(path: str, size_px: tuple[int, int], stack: ExitStack) -> Iterator[NamedPicture]:
    """Open a fisheye camera that has no calibration yet; ``stack`` closes it. Raises SensorError."""
    from device_agent.adapters.uvc import UvcSource

    width_px, height_px = size_px
    # Only the size matters here: the driver refuses pictures of another one.
    focal_px = width_px / math.pi
    lens = FisheyeIntrinsics(
        width_px, height_px, focal_px, focal_px, width_px / 2, height_px / 2, 0, 0, 0, 0, math.radians(80.0)
    )
    source = UvcSource(path, FisheyeCamera(lens, Transform.identity()), SystemClock())
    stack.callback(source.close)
    return _pictures_of(source.read)


def _pictures_of(read: Callable[[], FisheyeImage]) -> Iterator[NamedPicture]:
    number = 0
    while True:
        number += 1
        yield f"picture {number}", read().grey

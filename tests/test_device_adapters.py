"""One contract over all adapters of each port: fresh or an error, never stale; closing twice is harmless."""

from __future__ import annotations

import contextlib
import functools
import io
import itertools
import os
import sys
import tempfile
import threading
import types
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
from device_room import small_room
from hardware_stand_ins import (
    FISHEYE,
    InputDevice,
    OakStandIn,
    SerialLine,
    eventually,
    make_framebuffer,
    record_software_camera,
    waiting_bytes,
    write_video,
)

from device_agent.adapters.clocks import FakeClock, SteppedClock, SystemClock
from device_agent.adapters.displays import PngDisplay
from device_agent.adapters.evdev_buttons import EvdevButtons
from device_agent.adapters.fakes import (
    FakeButtons,
    FakeCamera,
    FakeDisplay,
    FakeOutput,
    FakeSonar,
    FakeWideCamera,
    NoButtons,
    NoSonar,
)
from device_agent.adapters.framebuffer import FramebufferDisplay
from device_agent.adapters.keyboard_buttons import KeyboardButtons
from device_agent.adapters.newest_frame import NewestFrameCamera
from device_agent.adapters.oak import OakSource
from device_agent.adapters.outputs import TeeOutput, TextOutput
from device_agent.adapters.paired_camera import PairedCamera
from device_agent.adapters.realsense import RealSenseSource
from device_agent.adapters.recorded import RecordedCamera
from device_agent.adapters.reopened_camera import ReopenedCamera
from device_agent.adapters.serial_sonar import SerialSonar
from device_agent.adapters.sound_device import SoundDeviceOutput
from device_agent.adapters.uvc import open_uvc_camera
from device_agent.adapters.wav_file import WavFileOutput
from device_agent.ports import (
    Button,
    ButtonPress,
    Buttons,
    Clock,
    CueOutput,
    DepthCamera,
    DisplayOutput,
    PressKind,
    Sonar,
    WideCamera,
)
from device_agent.simulation.adapters import SimulatedCamera, SimulatedEar, SimulatedSonar
from device_agent.simulation.building import Building
from device_agent.simulation.renderer import Renderer
from device_agent.simulation.walker import drawn_walker
from device_agent.simulation.world import SimulatedWorld, start_at
from navcore.cues.overlay import render_overlay
from navcore.cues.overlay_display import Head
from navcore.cues.table import Cue, CueKind, CuePriority
from navcore.errors import SensorError
from navcore.espeak import Speech
from navcore.recording import RecordingWriter, open_recording
from navcore.settings import Settings
from navcore.types import CameraIntrinsics, FisheyeImage, Frame, SonarState

INTRINSICS = CameraIntrinsics(32, 24, 30.0, 30.0, 15.5, 11.5)
RATE_HZ = 10.0


def frames(count: int, begin_s: float = 100.0) -> list[Frame]:
    rng = np.random.default_rng(1)
    return [
        Frame(
            begin_s + index / RATE_HZ,
            rng.integers(0, 256, (24, 32, 3), np.uint8),
            rng.uniform(1.0, 3.0, (24, 32)).astype(np.float32),
        )
        for index in range(count)
    ]


# ----------------------------------------------------------------------------------------------------- cameras
MakeCamera = Callable[[Clock, Path, ExitStack], DepthCamera]


def _fake(clock: Clock, folder: Path, stack: ExitStack) -> DepthCamera:
    return FakeCamera(INTRINSICS, clock, frames(20))


def _recorded(clock: Clock, folder: Path, stack: ExitStack) -> DepthCamera:
    writer = RecordingWriter(folder, INTRINSICS)
    for frame in frames(20, begin_s=5000.0):
        writer.add(replace(frame, gravity=np.array([0.0, 0.8, 0.6])))
    writer.close()
    return RecordedCamera(open_recording(folder), clock)


def _simulated(clock: Clock, folder: Path, stack: ExitStack) -> DepthCamera:
    return SimulatedCamera(simulated_world(100.0), clock, RATE_HZ)


def _reopened(clock: Clock, folder: Path, stack: ExitStack) -> DepthCamera:
    return ReopenedCamera(lambda: FakeCamera(INTRINSICS, clock, frames(20)), clock)


def _paired(clock: Clock, folder: Path, stack: ExitStack) -> DepthCamera:
    return PairedCamera(FakeCamera(INTRINSICS, clock, frames(20)), FakeWideCamera(clock, []), clock)


def _realsense(clock: Clock, folder: Path, stack: ExitStack) -> DepthCamera:
    sdk = pytest.importorskip("pyrealsense2", reason="the RealSense SDK is not installed (extra 'realsense')")
    recording = Path(_sdk_recording(sdk).name) / "camera.db3"
    real = ReopenedCamera(lambda: RealSenseSource(clock, recording=recording), clock)
    return NewestFrameCamera(real, clock, 0.5, real.abandon)


@functools.cache
def _sdk_recording(sdk: Any) -> tempfile.TemporaryDirectory[str]:
    folder = tempfile.TemporaryDirectory()
    record_software_camera(sdk, Path(folder.name) / "camera.db3", 250, interval_s=0.0125)
    return folder


def _oak(clock: Clock, folder: Path, stack: ExitStack) -> DepthCamera:
    sdk = pytest.importorskip("depthai", reason="the OAK SDK is not installed (extra 'oak')")
    camera, stopped = OakStandIn(sdk), threading.Event()
    running = threading.Thread(target=camera.run, args=(stopped,))
    running.start()
    stack.callback(running.join)
    stack.callback(stopped.set)
    real = ReopenedCamera(lambda: OakSource(clock, streams=camera.streams), clock)
    return NewestFrameCamera(real, clock, 0.5, real.abandon)


@functools.cache
def _room() -> tuple[Building, Renderer]:
    building = small_room()
    return building, Renderer(building.surfaces, building.lamps_m, building.seed)


def simulated_world(start_s: float) -> SimulatedWorld:
    building, renderer = _room()
    start = start_at(building, "Start")
    return SimulatedWorld(building, drawn_walker(1), start, 1, size_px=(160, 120), start_s=start_s, renderer=renderer)


CAMERAS: list[MakeCamera] = [_fake, _recorded, _simulated, _reopened, _paired, _realsense, _oak]
LIVE = (_realsense, _oak)
"""Their SDKs keep time themselves."""


def _clock_for(make: MakeCamera) -> Clock:
    return SystemClock() if make in LIVE else SteppedClock(100.0)


def _fresh(camera: DepthCamera, clock: Clock) -> tuple[Frame, float]:
    """Return the next frame and when it was asked for, seconds; what comes in its place is an error.

    The SDKs' threads may be held back by a busy machine: an old picture is then refused, and asked for again.
    """
    for _ in range(10):
        asked_s = clock.now_s()
        try:
            return camera.read(), asked_s
        except SensorError:
            if not isinstance(clock, SystemClock):
                raise
    raise AssertionError("the camera gave no fresh picture")


@pytest.mark.parametrize("make", CAMERAS)
def test_every_frame_is_fresh_new_and_of_the_cameras_size(make: MakeCamera, tmp_path: Path) -> None:
    clock = _clock_for(make)
    stamps = []
    with ExitStack() as stack:
        camera = make(clock, tmp_path, stack)
        stack.callback(camera.close)
        for pause_s in (0.0, 0.0, 0.05, 0.45, 0.0, 0.9, 0.0):
            clock.sleep_until(clock.now_s() + pause_s)
            frame, asked_s = _fresh(camera, clock)
            assert frame.colour_rgb.shape == (camera.intrinsics.height_px, camera.intrinsics.width_px, 3)
            assert frame.colour_rgb.dtype == np.uint8
            assert frame.depth_m.shape == frame.colour_rgb.shape[:2]
            assert frame.depth_m.dtype == np.float32
            assert not (frame.depth_m <= 0.0).any()
            assert asked_s - 0.5 <= frame.stamp_s <= clock.now_s()
            if frame.gravity is not None:
                assert np.linalg.norm(frame.gravity) == pytest.approx(1.0)
            stamps.append(frame.stamp_s)
    assert stamps == sorted(set(stamps))


@pytest.mark.parametrize("make", [_fake, _recorded])
def test_a_camera_without_pictures_raises_and_goes_on_raising(make: MakeCamera, tmp_path: Path) -> None:
    camera = make(SteppedClock(100.0), tmp_path, ExitStack())
    for _ in range(20):
        camera.read()
    for _ in range(2):
        with pytest.raises(SensorError, match=r": \w"):
            camera.read()


@pytest.mark.parametrize("make", CAMERAS)
def test_a_closed_camera_raises_and_may_be_closed_again(make: MakeCamera, tmp_path: Path) -> None:
    with ExitStack() as stack:
        clock = _clock_for(make)
        camera = make(clock, tmp_path, stack)
        _fresh(camera, clock)
        camera.close()
        camera.close()
        with pytest.raises(SensorError):
            camera.read()


class HandFedCamera:
    """A camera whose driver hangs until the test hands it a frame."""

    intrinsics = INTRINSICS

    def __init__(self) -> None:
        self._handed: list[Frame | Exception] = []
        self._ready = threading.Condition()
        self._asked = 0

    def hand(self, entry: Frame | Exception) -> None:
        with self._ready:
            assert self._ready.wait_for(lambda: self._asked > 0, 60.0)
            asked = self._asked
            self._handed.append(entry)
            self._ready.notify_all()
            # The thread asks again only after it has passed the entry on.
            assert self._ready.wait_for(lambda: self._asked > asked, 60.0)

    def read(self) -> Frame:
        with self._ready:
            self._asked += 1
            self._ready.notify_all()
            assert self._ready.wait_for(lambda: bool(self._handed), 60.0)
            entry = self._handed.pop(0)
        if isinstance(entry, Exception):
            raise entry
        return entry

    def close(self) -> None:
        with self._ready:
            self._handed.append(SensorError("closed"))
            self._ready.notify_all()


@pytest.fixture
def hand_fed() -> Iterator[tuple[HandFedCamera, NewestFrameCamera, FakeClock]]:
    clock, inner = FakeClock(100.0), HandFedCamera()
    camera = NewestFrameCamera(inner, clock, timeout_s=0.2)
    yield inner, camera, clock
    inner.close()
    camera.close()
    camera.close()


def test_the_newest_frame_wins(hand_fed: tuple[HandFedCamera, NewestFrameCamera, FakeClock]) -> None:
    inner, camera, _ = hand_fed
    for frame in frames(3, begin_s=99.9):
        inner.hand(frame)
    assert camera.read().stamp_s == pytest.approx(100.1)
    with pytest.raises(SensorError, match="no pictures"):
        camera.read()


def test_an_old_frame_is_an_error(hand_fed: tuple[HandFedCamera, NewestFrameCamera, FakeClock]) -> None:
    inner, camera, clock = hand_fed
    inner.hand(frames(1)[0])
    clock.advance(3.0)
    with pytest.raises(SensorError, match=r"3\.0 s old"):
        camera.read()


@pytest.mark.parametrize("stamp_s", [110.0, float("nan")])
def test_a_frame_whose_age_cannot_be_told_is_an_error(
    hand_fed: tuple[HandFedCamera, NewestFrameCamera, FakeClock], stamp_s: float
) -> None:
    inner, camera, _ = hand_fed
    inner.hand(replace(frames(1)[0], stamp_s=stamp_s))
    with pytest.raises(SensorError, match="ahead of the clock"):
        camera.read()


def test_a_camera_that_fails_says_why_and_recovers(
    hand_fed: tuple[HandFedCamera, NewestFrameCamera, FakeClock],
) -> None:
    inner, camera, _ = hand_fed
    inner.hand(RuntimeError("USB fell out"))
    with pytest.raises(SensorError, match="USB fell out"):
        camera.read()
    inner.hand(frames(1)[0])
    assert camera.read().stamp_s == 100.0


# ----------------------------------------------------------------------------------------------- fisheye cameras
def pictures(count: int, begin_s: float = 100.0) -> list[FisheyeImage]:
    size = (FISHEYE.intrinsics.height_px, FISHEYE.intrinsics.width_px)
    return [FisheyeImage(begin_s + index / 30, np.full(size, index, np.uint8), FISHEYE) for index in range(count)]


def _fake_wide(clock: Clock, folder: Path) -> WideCamera:
    return FakeWideCamera(clock, pictures(60))


def _video_file(clock: Clock, folder: Path) -> WideCamera:
    return open_uvc_camera(write_video(folder / "fisheye.avi"), FISHEYE, clock)


@pytest.mark.parametrize("make", [_fake_wide, _video_file])
def test_fisheye_pictures_are_fresh_new_and_of_the_lens(
    make: Callable[[Clock, Path], WideCamera], tmp_path: Path
) -> None:
    clock = SteppedClock(100.0)
    camera = make(clock, tmp_path)
    stamps = []
    for index in range(60):
        picture = camera.read()
        assert picture.grey.shape == (FISHEYE.intrinsics.height_px, FISHEYE.intrinsics.width_px)
        assert picture.grey.dtype == np.uint8
        assert picture.camera is FISHEYE
        assert picture.stamp_s == pytest.approx(100.0 + index / 30, abs=1e-3)
        assert 0.0 <= clock.now_s() - picture.stamp_s <= 0.5
        stamps.append(picture.stamp_s)
    assert stamps == sorted(set(stamps))
    with pytest.raises(SensorError, match=r": \w"):
        camera.read()
    camera.close()
    camera.close()
    with pytest.raises(SensorError):
        camera.read()


# ------------------------------------------------------------------------------------------------------ sonars
def _simulated_sonar(clock: Clock, stack: ExitStack, folder: Path) -> Sonar:
    return SimulatedSonar(simulated_world(clock.now_s()), clock)


def _serial_sonar(clock: Clock, stack: ExitStack, folder: Path) -> Sonar:
    pytest.importorskip("serial", reason="pyserial is not installed (extra 'serial')")
    line = SerialLine(folder)
    stack.callback(line.close)
    sonar = SerialSonar(line.path, clock)
    line.say(1000, 1500)
    eventually(lambda: sonar.read().distance_m == 1.5)
    return sonar


@pytest.mark.parametrize(
    "make",
    [
        lambda clock, stack, folder: FakeSonar(clock, 1.5),
        lambda clock, stack, folder: NoSonar(clock),
        _simulated_sonar,
        _serial_sonar,
    ],
)
def test_a_rangefinder_never_gives_an_old_distance(
    make: Callable[[Clock, ExitStack, Path], Sonar], tmp_path: Path
) -> None:
    clock = SteppedClock(50.0)
    with ExitStack() as stack:
        sonar = make(clock, stack, tmp_path)
        stack.callback(sonar.close)
        for now_s in (50.0, 55.0):
            clock.sleep_until(now_s)
            try:
                reading = sonar.read()
            except SensorError:
                # It has failed meanwhile: no distance at all.
                continue
            fresh = now_s - reading.stamp_s <= 0.25
            assert (reading.distance_m is not None) == (reading.state is SonarState.OK)
            assert fresh or reading.state in (SonarState.STALE, SonarState.ABSENT)
        sonar.close()
        sonar.close()
        with contextlib.suppress(SensorError):
            assert sonar.read().state is SonarState.ABSENT


# ----------------------------------------------------------------------------------------------------- buttons
Press = Callable[[Button, PressKind], None]
"""Presses a button as a finger does."""


def _fake_buttons(clock: FakeClock, folder: Path) -> tuple[Buttons, Press]:
    buttons = FakeButtons()
    return buttons, lambda button, kind: buttons.press(ButtonPress(clock.now_s(), button, kind))


def _evdev_buttons(clock: FakeClock, folder: Path) -> tuple[Buttons, Press]:
    device = InputDevice(folder)
    codes = {Button.MAIN: 28, Button.NEXT: 106, Button.PREVIOUS: 105, Button.REPEAT: 439}

    def press(button: Button, kind: PressKind) -> None:
        device.key(clock.now_s(), codes[button], 1)
        clock.advance(1.0 if kind is PressKind.LONG else 0.1)
        device.key(clock.now_s(), codes[button], 0)

    return EvdevButtons(device.path, clock), press


def _keyboard_buttons(clock: FakeClock, folder: Path) -> tuple[Buttons, Press]:
    ours, theirs = os.openpty()
    letters = {Button.MAIN: "m", Button.NEXT: "n", Button.PREVIOUS: "p", Button.REPEAT: "r"}

    sent = itertools.count(1)

    def press(button: Button, kind: PressKind) -> None:
        letter = letters[button]
        os.write(ours, (letter.upper() if kind is PressKind.LONG else letter).encode())
        count = next(sent)
        eventually(lambda: waiting_bytes(theirs) == count)

    return KeyboardButtons(clock, theirs), press


@pytest.mark.parametrize("make", [_fake_buttons, _evdev_buttons, _keyboard_buttons])
def test_every_press_is_told_once_and_in_order(
    make: Callable[[FakeClock, Path], tuple[Buttons, Press]], tmp_path: Path
) -> None:
    clock = FakeClock(100.0)
    buttons, press = make(clock, tmp_path)
    assert buttons.pressed() == ()
    wanted = [(button, kind) for button in Button for kind in PressKind]
    for button, kind in wanted:
        press(button, kind)
    told = buttons.pressed()
    assert [(each.button, each.kind) for each in told] == wanted
    assert all(each.stamp_s <= clock.now_s() for each in told)
    assert buttons.pressed() == ()
    buttons.close()
    buttons.close()
    with pytest.raises(SensorError, match=r": \w"):
        buttons.pressed()


def test_where_there_are_no_buttons_nothing_is_pressed() -> None:
    buttons = NoButtons()
    assert buttons.pressed() == ()
    buttons.close()


# ----------------------------------------------------------------------------------------------------- outputs
def _sound_device(folder: Path) -> CueOutput:
    """On a stand-in for the package sounddevice: there is no earphone where tests run."""
    silent = types.SimpleNamespace(
        check_output_settings=lambda **_: None, play=lambda samples, rate_hz: None, wait=lambda: None
    )
    with patch.dict(sys.modules, sounddevice=silent):
        return SoundDeviceOutput(Speech())


OUTPUTS: list[Callable[[Path], CueOutput]] = [
    _sound_device,
    lambda folder: FakeOutput(),
    lambda folder: TextOutput(io.StringIO()),
    lambda folder: TeeOutput([FakeOutput(), TextOutput(io.StringIO())]),
    lambda folder: WavFileOutput(folder / "walk.wav", Speech()),
    lambda folder: SimulatedEar(simulated_world(0.0), SteppedClock(0.0)),
]


@pytest.mark.parametrize("make", OUTPUTS)
def test_an_output_takes_every_kind_of_cue_and_may_be_closed_twice(
    make: Callable[[Path], CueOutput], tmp_path: Path
) -> None:
    output = make(tmp_path)
    for index, kind in enumerate(CueKind):
        output.play(Cue(float(index), kind, CuePriority.STOP, frequency_hz=800.0, duration_s=0.1, angle_deg=20.0))
    output.close()
    output.play(Cue(99.0, CueKind.STOP, CuePriority.STOP, "Stop."))
    output.close()


def test_one_broken_output_does_not_silence_the_others() -> None:
    def broken(cue: Cue) -> None:
        raise OSError("unplugged")

    heard = FakeOutput()
    with pytest.raises(OSError, match="unplugged"):
        TeeOutput([FakeOutput(broken), heard]).play(Cue(0.0, CueKind.STOP, CuePriority.STOP, "Stop."))
    assert len(heard.cues) == 1


# ---------------------------------------------------------------------------------------------------- displays
@pytest.mark.parametrize(
    "make",
    [
        lambda folder: FakeDisplay(),
        lambda folder: PngDisplay(folder / "eyes"),
        lambda folder: FramebufferDisplay(make_framebuffer(folder), folder),
    ],
)
def test_a_display_takes_pictures_of_its_size_and_may_be_closed_twice(
    make: Callable[[Path], DisplayOutput], tmp_path: Path
) -> None:
    display = make(tmp_path)
    overlay = render_overlay(None, None, Head.level(), 7.0, Settings(), display.geometry)
    for picture in (overlay.left_rgba, overlay.right_rgba):
        assert picture.shape == (display.geometry.height_px, display.geometry.width_px, 4)
    display.show(overlay)
    display.close()
    display.show(overlay)
    display.close()


# ------------------------------------------------------------------------------------------------------ clocks
@pytest.mark.parametrize("clock", [SystemClock(), SteppedClock(5.0)])
def test_time_has_passed_after_sleeping_and_never_goes_back(clock: Clock) -> None:
    begin_s = clock.now_s()
    clock.sleep_until(begin_s + 0.01)
    assert clock.now_s() >= begin_s + 0.01
    later_s = clock.now_s()
    clock.sleep_until(begin_s)
    assert clock.now_s() >= later_s

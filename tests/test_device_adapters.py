"""One contract over all adapters of each port: fresh or an error, never stale; closing twice is harmless."""

from __future__ import annotations

import contextlib
import functools
import io
import threading
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from device_room import small_room

from device_agent.adapters.clocks import FakeClock, SteppedClock, SystemClock
from device_agent.adapters.displays import PngDisplay
from device_agent.adapters.fakes import FakeCamera, FakeDisplay, FakeOutput, FakeSonar, NoSonar
from device_agent.adapters.newest_frame import NewestFrameCamera
from device_agent.adapters.outputs import TeeOutput, TextOutput
from device_agent.adapters.recorded import RecordedCamera
from device_agent.adapters.wav_file import WavFileOutput
from device_agent.ports import Clock, CueOutput, DepthCamera, DisplayOutput, Sonar
from device_agent.simulation.adapters import SimulatedCamera, SimulatedEar, SimulatedSonar
from device_agent.simulation.building import Building
from device_agent.simulation.renderer import Renderer
from device_agent.simulation.walker import drawn_walker
from device_agent.simulation.world import SimulatedWorld, start_at
from device_agent.speech import Speech
from navcore.cues.overlay import render_overlay
from navcore.cues.overlay_display import Head
from navcore.cues.table import Cue, CueKind, CuePriority
from navcore.errors import SensorError
from navcore.recording import RecordingWriter, open_recording
from navcore.settings import Settings
from navcore.types import CameraIntrinsics, Frame, SonarState

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
MakeCamera = Callable[[Clock, Path], DepthCamera]


def _fake(clock: Clock, folder: Path) -> DepthCamera:
    return FakeCamera(INTRINSICS, clock, frames(20))


def _recorded(clock: Clock, folder: Path) -> DepthCamera:
    writer = RecordingWriter(folder, INTRINSICS)
    for frame in frames(20, begin_s=5000.0):
        writer.add(frame)
    writer.close()
    return RecordedCamera(open_recording(folder), clock)


def _simulated(clock: Clock, folder: Path) -> DepthCamera:
    return SimulatedCamera(simulated_world(100.0), clock, RATE_HZ)


@functools.cache
def _room() -> tuple[Building, Renderer]:
    building = small_room()
    return building, Renderer(building.surfaces, building.lamps_m, building.seed)


def simulated_world(start_s: float) -> SimulatedWorld:
    building, renderer = _room()
    start = start_at(building, "Start")
    return SimulatedWorld(building, drawn_walker(1), start, 1, size_px=(160, 120), start_s=start_s, renderer=renderer)


CAMERAS: list[MakeCamera] = [_fake, _recorded, _simulated]


@pytest.mark.parametrize("make", CAMERAS)
def test_every_frame_is_fresh_new_and_of_the_cameras_size(make: MakeCamera, tmp_path: Path) -> None:
    clock = SteppedClock(100.0)
    camera = make(clock, tmp_path)
    stamps = []
    for pause_s in (0.0, 0.0, 0.05, 0.45, 0.0, 0.9, 0.0):
        clock.sleep_until(clock.now_s() + pause_s)
        frame = camera.read()
        assert frame.colour_rgb.shape == (camera.intrinsics.height_px, camera.intrinsics.width_px, 3)
        assert frame.depth_m.shape == frame.colour_rgb.shape[:2]
        assert frame.depth_m.dtype == np.float32
        assert 0.0 <= clock.now_s() - frame.stamp_s <= 0.5
        stamps.append(frame.stamp_s)
    assert stamps == sorted(set(stamps))


@pytest.mark.parametrize("make", [_fake, _recorded])
def test_a_camera_without_pictures_raises_and_goes_on_raising(make: MakeCamera, tmp_path: Path) -> None:
    camera = make(SteppedClock(100.0), tmp_path)
    for _ in range(20):
        camera.read()
    for _ in range(2):
        with pytest.raises(SensorError, match=r": \w"):
            camera.read()


@pytest.mark.parametrize("make", CAMERAS)
def test_a_closed_camera_raises_and_may_be_closed_again(make: MakeCamera, tmp_path: Path) -> None:
    camera = make(SteppedClock(100.0), tmp_path)
    camera.read()
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
            asked = self._asked
            self._handed.append(entry)
            self._ready.notify_all()
            # The thread asks again only after it has passed the entry on.
            assert self._ready.wait_for(lambda: self._asked > asked or not self._handed, 10.0)
            assert self._ready.wait_for(lambda: self._asked > asked, 10.0)

    def read(self) -> Frame:
        with self._ready:
            self._asked += 1
            self._ready.notify_all()
            assert self._ready.wait_for(lambda: bool(self._handed), 10.0)
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


# ------------------------------------------------------------------------------------------------------ sonars
def _simulated_sonar(clock: Clock) -> Sonar:
    return SimulatedSonar(simulated_world(clock.now_s()), clock)


@pytest.mark.parametrize("make", [lambda clock: FakeSonar(clock, 1.5), NoSonar, _simulated_sonar])
def test_a_rangefinder_never_gives_an_old_distance(make: Callable[[Clock], Sonar]) -> None:
    clock = SteppedClock(50.0)
    sonar = make(clock)
    for now_s in (50.0, 55.0):
        clock.sleep_until(now_s)
        reading = sonar.read()
        fresh = now_s - reading.stamp_s <= 0.25
        assert (reading.distance_m is not None) == (reading.state is SonarState.OK)
        assert fresh or reading.state in (SonarState.STALE, SonarState.ABSENT)
    sonar.close()
    sonar.close()
    with contextlib.suppress(SensorError):
        assert sonar.read().state is SonarState.ABSENT


# ----------------------------------------------------------------------------------------------------- outputs
OUTPUTS: list[Callable[[Path], CueOutput]] = [
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
@pytest.mark.parametrize("make", [lambda folder: FakeDisplay(), lambda folder: PngDisplay(folder / "eyes")])
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

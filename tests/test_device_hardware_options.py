"""Hardware is named on the command line; what is missing or contradicts itself is told with what to do."""

from __future__ import annotations

import os
import threading
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest
from hardware_stand_ins import (
    FISHEYE,
    InputDevice,
    SerialLine,
    eventually,
    record_software_camera,
    waiting_bytes,
    write_video,
)

from device_agent.adapters.clocks import SystemClock
from device_agent.adapters.fakes import NoButtons, NoSonar
from device_agent.cli import main
from device_agent.device_options import DeviceOptions
from device_agent.ports import Button, PressKind
from device_agent.sensor_names import SensorName, named
from device_agent.sensors import open_hardware
from navcore.errors import InputError, SensorError, VbrError
from navcore.fisheye_recording import FisheyeWriter
from navcore.recording import RecordingWriter
from navcore.settings import Settings
from navcore.types import CameraIntrinsics, FisheyeImage, Frame, SonarState


@pytest.mark.parametrize(
    ("what", "text", "meant"),
    [
        ("camera", None, None),
        ("camera", "realsense", SensorName("realsense")),
        ("camera", "realsense:0123", SensorName("realsense", "0123")),
        ("camera", "oak", SensorName("oak")),
        ("sonar", "serial:/dev/ttyUSB0", SensorName("serial", "/dev/ttyUSB0")),
        ("buttons", "keyboard", SensorName("keyboard")),
        ("buttons", "evdev:/dev/input/by-id/a:b", SensorName("evdev", "/dev/input/by-id/a:b")),
        ("display", "fb:/dev/fb0", SensorName("fb", "/dev/fb0")),
    ],
)
def test_a_name_says_which_adapter_and_where(what: str, text: str | None, meant: SensorName | None) -> None:
    assert named(what, text) == meant


@pytest.mark.parametrize(
    ("what", "text", "sentence"),
    [
        ("camera", "webcam", r"no camera 'webcam': use realsense"),
        ("camera", "realsense:", r"write realsense\[:SERIAL"),
        ("sonar", "serial", "write serial:/dev/ttyUSB0"),
        ("sonar", "serial:", "write serial:/dev/ttyUSB0"),
        ("buttons", "", "no buttons ''"),
        ("display", "fb", "write fb:/dev/fb0"),
    ],
)
def test_what_is_no_name_is_refused_with_those_there_are(what: str, text: str, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        named(what, text)


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ([], "name --simulated, --recording DIR, or --camera NAME"),
        (["--simulated", "--camera", "oak"], "one camera"),
        (["--camera", "oak", "--recording", "x"], "one camera"),
        (["--camera", "webcam"], "use realsense"),
        (["--camera", "oak", "--fisheye-calibration", "x"], "name --fisheye DEVICE as well"),
        (["--simulated", "--sonar", "serial:/dev/ttyUSB0"], "leave --fisheye and --sonar out"),
        (["--recording", "x", "--fisheye", "y", "--fisheye-calibration", "z"], "leave --fisheye out"),
        (["--camera", "oak", "--sonar", "serial"], "write serial:/dev/ttyUSB0"),
    ],
)
def test_a_contradiction_is_one_sentence(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, arguments: list[str], sentence: str
) -> None:
    assert main(["device", "--site", str(tmp_path / "gone"), *arguments]) == 2
    error = capsys.readouterr().err
    assert sentence in error
    assert len(error.strip().splitlines()) == 1


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"sonar": SensorName("serial", "/dev/ttyUSB9")}, "No rangefinder is found"),
        ({"buttons": SensorName("evdev", "/dev/input/event99")}, "no buttons at"),
        ({"screen": SensorName("fb", "/dev/fb9")}, "no display fb9"),
        ({"screen": SensorName("fb", "/dev/fb0"), "overlay": Path("x")}, "one place"),
        ({}, "No RealSense camera is found"),
    ],
)
def test_hardware_that_is_not_there_is_told_at_the_start(
    tmp_path: Path, options: dict[str, object], sentence: str
) -> None:
    pytest.importorskip("pyrealsense2", reason="the RealSense SDK is not installed (extra 'realsense')")
    pytest.importorskip("serial", reason="pyserial is not installed (extra 'serial')")
    wanted = DeviceOptions(tmp_path, tmp_path, camera=SensorName("realsense"), print_cues=False, **options)  # type: ignore[arg-type]
    with ExitStack() as stack, pytest.raises(VbrError, match=sentence):
        open_hardware(wanted, Settings(), SystemClock(), stack)


def test_a_whole_device_is_put_together_from_names(tmp_path: Path) -> None:
    sdk = pytest.importorskip("pyrealsense2", reason="the RealSense SDK is not installed (extra 'realsense')")
    pytest.importorskip("serial", reason="pyserial is not installed (extra 'serial')")
    record_software_camera(sdk, tmp_path / "camera.db3", 250, interval_s=0.0125)
    writer = FisheyeWriter(tmp_path, FISHEYE)
    writer.add(FisheyeImage(1.0, np.zeros((120, 160), np.uint8), FISHEYE))
    writer.close()
    line, keys = SerialLine(tmp_path), InputDevice(tmp_path)
    options = DeviceOptions(
        tmp_path,
        tmp_path,
        camera=SensorName("realsense", str(tmp_path / "camera.db3")),
        fisheye=write_video(tmp_path / "fisheye.avi", 240),
        fisheye_calibration=tmp_path / "fisheye_calib.txt",
        sonar=SensorName("serial", line.path),
        buttons=SensorName("evdev", keys.path),
        print_cues=False,
    )
    with ExitStack() as stack:
        stack.callback(line.close)
        hardware = open_hardware(options, Settings(), SystemClock(), stack)
        frames: list[Frame] = []

        def with_fisheye() -> bool:
            try:
                frames.append(hardware.camera.read())
            except SensorError:
                return False
            return frames[-1].fisheye is not None

        eventually(with_fisheye)
        clock_ms = iter(range(1000, 10_000_000, 50))

        def heard() -> bool:
            line.say(next(clock_ms), 1700)
            try:
                return hardware.sonar.read().distance_m == 1.7
            except SensorError:
                # It was silent until now.
                return False

        eventually(heard)
        keys.key(10.0, 28, 1)
        keys.key(10.1, 28, 0)
        assert [(press.button, press.kind) for press in hardware.buttons.pressed()] == [(Button.MAIN, PressKind.SHORT)]
        hardware.apply(Settings().changed({"watchdog.camera_timeout_s": 1.5}))
        assert hardware.newest is not None
        assert hardware.newest.timeout_s == 1.5
        names = ("camera", "fisheye camera", "rangefinder")
        readers = [each for each in threading.enumerate() if each.name in names]
    with pytest.raises(SensorError):
        hardware.sonar.read()
    for reader in readers:
        # A driver that is slow to let go is waited for in vain, and ends later.
        reader.join(60.0)
        assert not reader.is_alive()


def test_what_is_not_named_is_not_there(tmp_path: Path, small_recording: Path) -> None:
    options = DeviceOptions(tmp_path, tmp_path, recording=small_recording, print_cues=False)
    with ExitStack() as stack:
        hardware = open_hardware(options, Settings(), SystemClock(), stack)
        assert isinstance(hardware.sonar, NoSonar)
        assert isinstance(hardware.buttons, NoButtons)
        assert hardware.sonar.read().state is SonarState.ABSENT
        assert hardware.display is None


def test_the_keyboard_can_be_the_buttons(
    tmp_path: Path, small_recording: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ours, theirs = os.openpty()
    options = DeviceOptions(
        tmp_path, tmp_path, recording=small_recording, print_cues=False, buttons=SensorName("keyboard")
    )
    with os.fdopen(theirs) as terminal, ExitStack() as stack:
        monkeypatch.setattr("sys.stdin", terminal)
        hardware = open_hardware(options, Settings(), SystemClock(), stack)
        os.write(ours, b"N")
        eventually(lambda: waiting_bytes(terminal.fileno()) == 1)
        assert [press.kind for press in hardware.buttons.pressed()] == [PressKind.LONG]
    os.close(ours)


@pytest.fixture
def small_recording(tmp_path: Path) -> Path:
    writer = RecordingWriter(tmp_path / "recording", CameraIntrinsics(32, 24, 30.0, 30.0, 15.5, 11.5))
    writer.add(Frame(1.0, np.zeros((24, 32, 3), np.uint8), np.ones((24, 32), np.float32)))
    writer.close()
    return tmp_path / "recording"

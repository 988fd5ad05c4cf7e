"""Real cameras without the hardware: through the SDKs' own objects, and OpenCV's own reading of a file."""

from __future__ import annotations

import math
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hardware_stand_ins import (
    FISHEYE,
    HEIGHT_PX,
    WIDTH_PX,
    OakStandIn,
    eventually,
    lens,
    record_software_camera,
    software_camera,
    write_video,
)

from device_agent.adapters.clocks import FakeClock, SteppedClock, SystemClock
from device_agent.adapters.fakes import FakeCamera, FakeWideCamera
from device_agent.adapters.oak import OakSource, mounting_of
from device_agent.adapters.paired_camera import PairedCamera
from device_agent.adapters.realsense import RealSenseSource, straightening
from device_agent.adapters.realsense import mounting_of as realsense_mounting_of
from device_agent.adapters.uvc import UvcSource, check_picture, open_uvc_camera
from navcore.errors import MissingPackageError, RecordingError, SensorError
from navcore.fisheye_recording import MAX_FISHEYE_GAP_S, FisheyeWriter, read_fisheye_camera
from navcore.types import CameraIntrinsics, FisheyeImage, Frame


@pytest.fixture
def realsense() -> Any:
    return pytest.importorskip("pyrealsense2", reason="the RealSense SDK is not installed (extra 'realsense')")


@pytest.fixture
def depthai() -> Any:
    return pytest.importorskip("depthai", reason="the OAK SDK is not installed (extra 'oak')")


# --------------------------------------------------------------------------------------------------- RealSense
def test_a_realsense_camera_gives_aligned_depth_in_metres_and_gravity(realsense: Any, tmp_path: Path) -> None:
    record_software_camera(realsense, tmp_path / "camera.db3", 60, interval_s=0.02)
    source = RealSenseSource(SystemClock(), recording=tmp_path / "camera.db3", camera_from_imu=np.eye(3))
    assert source.intrinsics == CameraIntrinsics(640, 480, 600.0, 600.0, 319.5, 239.5)
    frames = [source.read() for _ in range(3)]
    for frame in frames:
        number = int(frame.colour_rgb[0, 0, 0])
        assert (frame.colour_rgb == number).all()
        # The SDK pairs them; where the machine is busy, with a neighbour.
        assert frame.depth_m[240, 320] == pytest.approx(1.0 + number / 1000, abs=2.1e-3)
        assert np.isnan(frame.depth_m[:, :15]).all(), "nothing was measured there"
    assert frames[-1].gravity == pytest.approx([0.0, 1.0, 0.0])
    stamps = [frame.stamp_s for frame in frames]
    assert stamps == sorted(set(stamps))
    source.close()
    source.close()


def test_a_realsense_camera_that_ends_is_an_error(realsense: Any, tmp_path: Path) -> None:
    record_software_camera(realsense, tmp_path / "camera.db3", 3)
    source = RealSenseSource(SystemClock(), recording=tmp_path / "camera.db3")

    def read_on() -> None:
        for _ in range(10):
            source.read()

    with pytest.raises(SensorError, match="no pictures: check its cable"):
        read_on()
    source.close()


def test_stamps_of_the_time_of_day_tell_the_exact_age(realsense: Any, tmp_path: Path) -> None:
    wall_s = 1_700_000_000.0
    record_software_camera(realsense, tmp_path / "camera.db3", 10, wall_s=wall_s)
    clock = SteppedClock(500.0)
    source = RealSenseSource(clock, recording=tmp_path / "camera.db3", wall_now_s=lambda: wall_s + 1.0)
    frame = source.read()
    number = round(1000.0 * (float(frame.depth_m[240, 320]) - 1.0))
    assert frame.stamp_s == pytest.approx(500.0 - (1.0 - number / 30.0), abs=1e-3)
    source.close()


def test_a_realsense_camera_that_is_not_there_is_told_at_once(realsense: Any, tmp_path: Path) -> None:
    began_s = time.monotonic()
    for serial in (None, "nobody"):
        with pytest.raises(SensorError, match="plug it into a USB 3 socket"):
            RealSenseSource(SystemClock(), serial)
    assert time.monotonic() - began_s < 29.0, "the SDK would wait 15 s for each"
    with pytest.raises(SensorError, match="no recording of the RealSense SDK"):
        RealSenseSource(SystemClock(), recording=tmp_path / "none.db3")


def test_how_the_accelerometer_is_mounted_is_read_as_the_sdk_means_it(realsense: Any) -> None:
    tilted, _ = cv2.Rodrigues(np.array([0.1, -0.4, 0.3]))
    extrinsics = realsense.extrinsics()
    extrinsics.rotation, extrinsics.translation = tilted.T.ravel().tolist(), [0.0, 0.0, 0.0]
    device, _, streams = software_camera(realsense, extrinsics)
    rotation = realsense_mounting_of(streams["accelerometer"], streams["colour"])
    felt = [1.0, 2.0, 3.0]
    meant = realsense.rs2_transform_point_to_point(extrinsics, felt)
    assert rotation is not None
    assert rotation @ np.array(felt) == pytest.approx(meant, abs=1e-5)
    del device


def test_a_lens_that_bends_nothing_needs_no_straightening(realsense: Any) -> None:
    assert straightening(realsense, lens(realsense)) is None


@pytest.mark.parametrize("model", ["brown_conrady", "inverse_brown_conrady", "modified_brown_conrady"])
def test_a_bent_picture_is_straightened_as_the_sdk_bends_it(realsense: Any, model: str) -> None:
    bent = lens(realsense, (0.08, -0.05, 0.001, -0.002, 0.0), model)
    found = straightening(realsense, bent)
    assert found is not None
    for u, v in ((0, 0), (320, 240), (600, 100)):
        seen = realsense.rs2_project_point_to_pixel(bent, [(u - 319.5) / 600.0, (v - 239.5) / 600.0, 1.0])
        assert (found[0][v, u], found[1][v, u]) == pytest.approx(seen, abs=1e-3)


# --------------------------------------------------------------------------------------------------------- OAK
def test_an_oak_camera_gives_aligned_depth_in_metres_gravity_and_its_age(depthai: Any) -> None:
    camera, clock = OakStandIn(depthai), SteppedClock(500.0)
    camera.send(77.0, level=90, depth_mm=1234)
    source = OakSource(clock, streams=camera.streams, steady_now_s=lambda: 77.25)
    assert source.intrinsics == CameraIntrinsics(WIDTH_PX, HEIGHT_PX, 60.0, 61.0, 31.5, 23.5)
    frame = source.read()
    assert frame.stamp_s == pytest.approx(499.75)
    assert frame.colour_rgb[0, 0].tolist() == [90, 20, 30], "red first"
    assert frame.depth_m[0, 10] == pytest.approx(1.234)
    assert np.isnan(frame.depth_m[:, :5]).all()
    assert frame.gravity == pytest.approx([0.0, 1.0, 0.0])
    source.close()
    source.close()


def test_an_oak_camera_that_falls_silent_or_is_closed_is_an_error(depthai: Any) -> None:
    camera = OakStandIn(depthai)
    camera.send(77.0, level=90, depth_mm=1234)
    source = OakSource(SteppedClock(), streams=camera.streams)
    source.read()
    with pytest.raises(SensorError, match="no pictures: check its cable"):
        source.read()
    camera.frames.close()
    with pytest.raises(Exception, match="closed"):
        source.read()


def test_an_oak_camera_that_gives_no_first_picture_is_not_opened(depthai: Any) -> None:
    with pytest.raises(SensorError, match="no pictures"):
        OakSource(SteppedClock(), streams=OakStandIn(depthai).streams)


def test_the_oak_sdk_is_told_to_send_nothing_before_it_is_loaded(depthai: Any) -> None:
    # In a process of its own, for the SDK reads its settings once, when it is loaded.
    script = (
        "from device_agent.adapters.oak import open_streams\n"
        "try:\n    open_streams('no-such-camera')\nexcept Exception as error:\n    print(error)\n"
    )
    environment = {name: value for name, value in os.environ.items() if not name.startswith("DEPTHAI_")}
    done = subprocess.run(
        [sys.executable, "-c", script], env={**environment, "DEPTHAI_LEVEL": "debug"}, capture_output=True, text=True,
        timeout=60, check=True,
    )  # fmt: skip
    assert "No OAK camera" in done.stdout
    assert "Telemetry disabled" in done.stdout + done.stderr
    assert "Telemetry capture upload" not in done.stdout + done.stderr


def test_a_file_that_may_not_grow_is_a_write_that_fails_also_beside_the_oak_sdk(depthai: Any, tmp_path: Path) -> None:
    script = (
        "import contextlib, pathlib, resource\n"
        "from device_agent.adapters.oak import open_streams\n"
        "from navcore.errors import SensorError\n"
        "with contextlib.suppress(SensorError):\n    open_streams('no-such-camera')\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096))\n"
        f"try:\n    pathlib.Path({str(tmp_path / 'grows')!r}).write_bytes(bytes(10_000))\n"
        "except OSError as error:\n    print(error)\n"
    )
    environment = {name: value for name, value in os.environ.items() if not name.startswith("DEPTHAI_")}
    done = subprocess.run([sys.executable, "-c", script], env=environment, capture_output=True, text=True, timeout=60)
    assert (done.returncode, "File too large" in done.stdout) == (0, True), done.stderr


def test_an_oak_camera_that_is_not_there_is_told(depthai: Any) -> None:
    with pytest.raises(SensorError, match="No OAK camera is found"):
        OakSource(SteppedClock())


def test_how_the_oaks_accelerometer_is_mounted_is_read_from_its_calibration(depthai: Any) -> None:
    tilted, _ = cv2.Rodrigues(np.array([0.1, -0.4, 0.3]))
    calibration, socket = depthai.CalibrationHandler(), depthai.CameraBoardSocket.CAM_A
    calibration.setCameraIntrinsics(
        socket, [[600.0, 0.0, 320.0], [0.0, 600.0, 240.0], [0, 0, 1]], depthai.Size2f(640, 480)
    )
    calibration.setImuExtrinsics(socket, tilted.tolist(), [1.0, 0.0, 0.0], [1.0, 0.0, 0.0])
    assert mounting_of(calibration, socket) == pytest.approx(tilted, abs=1e-5)


@pytest.mark.parametrize(
    ("module", "make", "extra"),
    [
        ("pyrealsense2", lambda: RealSenseSource(SteppedClock()), "realsense"),
        ("depthai", lambda: OakSource(SteppedClock()), "oak"),
    ],
)
def test_a_missing_sdk_is_told_with_what_brings_it(
    monkeypatch: pytest.MonkeyPatch, module: str, make: Callable[[], object], extra: str
) -> None:
    monkeypatch.setitem(__import__("sys").modules, module, None)
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(MissingPackageError, match=rf"virtual-blind-road\[{extra}\]"):
        make()


# ----------------------------------------------------------------------------------------------------- fisheye
def test_a_video_file_is_read_through_opencv_at_its_own_pace(tmp_path: Path) -> None:
    clock = SteppedClock(100.0)
    camera = open_uvc_camera(write_video(tmp_path / "fisheye.avi", 10), FISHEYE, clock)
    pictures = [camera.read() for _ in range(10)]
    assert clock.now_s() == pytest.approx(100.3)
    assert [picture.grey.mean() for picture in pictures] == pytest.approx([4.0 * index for index in range(10)], abs=1.5)


def test_a_camera_of_another_size_is_refused_with_what_to_do(tmp_path: Path) -> None:
    smaller = replace(FISHEYE, intrinsics=replace(FISHEYE.intrinsics, width_px=150))
    source = UvcSource(write_video(tmp_path / "fisheye.avi"), smaller, SteppedClock())
    with pytest.raises(SensorError, match="160×120 pixels, but is calibrated for 150×120"):
        source.read()


@pytest.mark.parametrize("name", ["/dev/video63", "nothing.avi"])
def test_a_fisheye_camera_that_is_not_there_is_told(name: str) -> None:
    with pytest.raises(SensorError, match=r"No fisheye camera is found at .*: plug it in"):
        UvcSource(name, FISHEYE, SteppedClock())


def wide(stamp_s: float) -> FisheyeImage:
    return FisheyeImage(stamp_s, np.zeros((120, 160), np.uint8), FISHEYE)


def test_old_fisheye_pictures_are_refused() -> None:
    check_picture(wide(2.0), wide(1.0))
    for bad in (wide(1.0), wide(0.5), wide(math.nan)):
        with pytest.raises(SensorError, match="old pictures"):
            check_picture(bad, wide(1.0))


def test_the_calibration_of_a_recording_tells_a_live_camera_what_to_deliver(tmp_path: Path) -> None:
    writer = FisheyeWriter(tmp_path, FISHEYE)
    writer.add(wide(1.0))
    writer.close()
    read = read_fisheye_camera(tmp_path / "fisheye_calib.txt")
    assert read.intrinsics.max_angle_rad == pytest.approx(FISHEYE.intrinsics.max_angle_rad)
    assert replace(read.intrinsics, max_angle_rad=FISHEYE.intrinsics.max_angle_rad) == FISHEYE.intrinsics
    lines = (tmp_path / "fisheye_calib.txt").read_text().splitlines()
    (tmp_path / "without.txt").write_text("\n".join(line for line in lines if not line.startswith("width")))
    with pytest.raises(RecordingError, match="no width"):
        read_fisheye_camera(tmp_path / "without.txt")


def test_a_frame_gets_the_fisheye_picture_nearest_to_it_or_none() -> None:
    clock = FakeClock(1000.0)
    lens_of_depth = CameraIntrinsics(32, 24, 30.0, 30.0, 15.5, 11.5)
    stamps = (100.0, 100.033, 100.066, 100.1)
    all_read, end = threading.Event(), threading.Event()

    class Pausing(FakeWideCamera):
        """Gives its pictures, then waits as a camera does."""

        def read(self) -> FisheyeImage:
            if next(left, None) is None:
                all_read.set()
                assert end.wait(30.0)
            return super().read()

    left = iter(stamps)
    taken = [100.07, 100.1 + MAX_FISHEYE_GAP_S - 0.001, 100.1 + MAX_FISHEYE_GAP_S + 0.01, 99.0]
    depth = [Frame(at, np.zeros((24, 32, 3), np.uint8), np.ones((24, 32), np.float32)) for at in taken]
    camera = PairedCamera(
        FakeCamera(lens_of_depth, clock, depth, fresh_for_s=1e9), Pausing(clock, [wide(at) for at in stamps]), clock
    )
    assert camera.intrinsics is lens_of_depth
    assert all_read.wait(10.0)
    got = [camera.read().fisheye for _ in taken]
    assert [None if picture is None else picture.stamp_s for picture in got] == [100.066, 100.1, None, None]
    end.set()
    camera.close()


def test_a_fisheye_camera_that_fails_leaves_the_depth_camera_alone() -> None:
    clock = FakeClock(1000.0)
    depth = [Frame(100.0 + at, np.zeros((24, 32, 3), np.uint8), np.ones((24, 32), np.float32)) for at in range(100_000)]
    camera = PairedCamera(
        FakeCamera(CameraIntrinsics(32, 24, 30.0, 30.0, 15.5, 11.5), clock, depth, fresh_for_s=1e9),
        FakeWideCamera(clock, [wide(100.0), OSError("fell out")]),
        clock,
    )
    eventually(lambda: camera._failed or camera.read().fisheye is None)
    assert camera.read().fisheye is None
    camera.close()

"""The doctor: each check finds what is wrong, says what to do, and none stops or holds up the others."""

from __future__ import annotations

import json
import math
import os
import re
import shlex
import subprocess
import threading
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from device_console import TOKEN, Console
from device_hall import EYE_HEIGHT_M, INTRINSICS, empty_hall
from hardware_stand_ins import SerialLine

from device_agent.adapters.clocks import SteppedClock, SystemClock
from device_agent.adapters.fakes import FakeButtons, FakeCamera, FakeDisplay, FakeOutput, FakeSonar
from device_agent.calibration_store import CalibrationStore
from device_agent.cli import _parser, main
from device_agent.doctor import machine, sensing
from device_agent.doctor.checks import _calibrating, _new_token
from device_agent.doctor.findings import Check, Finding, Status, exit_code, made, ok
from device_agent.doctor_command import _patient
from navcore.calibration import Calibration, FloorCalibration
from navcore.errors import SensorError
from navcore.espeak import Speech
from navcore.geometry import world_from_camera_at
from navcore.settings import Settings
from navcore.site import Site, save_site
from navcore.types import Frame

FLOOR = FloorCalibration(1.0, EYE_HEIGHT_M, 0.0, math.radians(15.0), 0.0, 0.0, 0.0, 30)
NAMES = (
    "camera", "fisheye", "sonar", "buttons", "display", "audio",
    "calibration", "map", "disk", "recordings", "clock", "link", "system",
)  # fmt: skip


# ------------------------------------------------------------------------------------------------- running
def test_neither_an_exception_nor_a_hanging_check_stops_the_others() -> None:
    forever = threading.Event()

    def hangs() -> Finding:
        forever.wait()
        return ok("never")

    def breaks() -> Finding:
        raise ZeroDivisionError("a fault")

    def refuses() -> Finding:
        raise SensorError("No camera is found: plug it in.")

    checked = list(
        made(
            [
                Check("hangs", "", hangs, limit_s=0.2), Check("breaks", "", breaks), Check("refuses", "", refuses),
                Check("works", "", lambda: ok("all is well")),
            ]
        )
    )  # fmt: skip
    forever.set()
    assert [each.finding.status for each in checked] == [Status.FAILED] * 3 + [Status.OK]
    assert "no answer within 0.2 s" in checked[0].finding.found
    assert "ZeroDivisionError" in checked[1].finding.found
    assert (checked[2].finding.found, checked[2].finding.advice) == ("No camera is found", "plug it in")
    assert (exit_code(checked), exit_code(checked[3:])) == (1, 0)


# ------------------------------------------------------------------------------------------------- sensors
def frames(
    clock: SteppedClock, interval_s: float = 0.1, spoil: Callable[[Frame], Frame] = lambda frame: frame,
    pitch_deg: float = 15.0, grey: int = 120, late_s: float = 0.0,
) -> Iterator[Frame]:  # fmt: skip
    depth = empty_hall(world_from_camera_at((0.0, 0.0, EYE_HEIGHT_M), 0.0, math.radians(pitch_deg)))
    colour = np.full((INTRINSICS.height_px, INTRINSICS.width_px, 3), grey, np.uint8)
    while True:
        clock.sleep_until(clock.now_s() + interval_s)
        yield spoil(Frame(clock.now_s() - late_s, colour, depth))


def examined(seen: sensing.Seen | None = None, **how: object) -> Finding:
    clock = SteppedClock(50.0)
    camera = FakeCamera(INTRINSICS, clock, frames(clock, **how))  # type: ignore[arg-type]
    return sensing.check_camera(lambda: camera, clock, Settings(), seen or sensing.Seen())


def test_a_good_camera_is_ok_and_its_rate_is_told() -> None:
    finding = examined()
    assert finding.status is Status.OK
    assert finding.found.startswith("10.0 pictures a second")


@pytest.mark.parametrize(
    ("how", "status", "word"),
    [
        ({"interval_s": 0.4}, Status.FAILED, "2.5 pictures"),
        ({"interval_s": 0.15}, Status.WARNING, "6.7 pictures"),
        ({"spoil": lambda frame: replace(frame, depth_m=np.full_like(frame.depth_m, np.nan))}, Status.FAILED, "0%"),
        ({"grey": 2}, Status.WARNING, "dark"),
        ({"late_s": 0.45}, Status.WARNING, "0.45 s old"),
    ],
    ids=["too slow", "slow", "no depth", "dark", "old"],
)
def test_what_is_wrong_with_a_camera_is_told(how: dict[str, object], status: Status, word: str) -> None:
    finding = examined(**how)
    assert (finding.status, word in finding.found) == (status, True), finding
    assert finding.advice


def test_a_camera_that_gives_nothing_is_failed_with_its_own_words() -> None:
    clock = SteppedClock(50.0)

    class Patient(FakeCamera):
        """Waits a second before it says that there is nothing, as drivers do."""

        def read(self) -> Frame:
            clock.sleep_until(clock.now_s() + 1.0)
            return super().read()

    camera = Patient(INTRINSICS, clock, [])
    check = Check("camera", "", lambda: sensing.check_camera(lambda: camera, clock, Settings(), sensing.Seen()))
    (checked,) = made([check])
    assert (checked.finding.status, checked.finding.advice) == (Status.FAILED, "check its cable")


def test_the_rangefinder_is_heard_for_two_seconds() -> None:
    clock = SteppedClock(50.0)

    class Echoing(FakeSonar):
        def read(self):  # type: ignore[no-untyped-def]
            self.echo(1.5)
            return super().read()

    assert sensing.check_sonar(lambda: Echoing(clock), clock).status is Status.OK
    mute = FakeSonar(clock)
    clock.sleep_until(clock.now_s() + 1.0)
    silent = sensing.check_sonar(lambda: mute, clock)
    assert silent.status is Status.FAILED
    assert sensing.check_sonar(None, clock).status is Status.WARNING


def test_a_line_that_is_silent_or_gone_is_failed(tmp_path: Path) -> None:
    pytest.importorskip("serial", reason="pyserial is not installed (extra 'serial')")
    from device_agent.adapters.serial_sonar import SerialSonar

    clock, line = SystemClock(), SerialLine(tmp_path)
    checks = [
        Check("silent", "", lambda: sensing.check_sonar(lambda: SerialSonar(line.path, clock), clock)),
        Check("gone", "", lambda: sensing.check_sonar(lambda: SerialSonar("/dev/ttyUSB99", clock), clock)),
    ]
    silent, gone = made(checks)
    line.close()
    assert silent.finding.status is gone.finding.status is Status.FAILED
    assert "plug it in" in gone.finding.advice


def test_buttons_display_and_sound_are_opened_and_closed_again() -> None:
    buttons, display, sound = FakeButtons(), FakeDisplay(), FakeOutput()
    assert sensing.check_buttons(lambda: buttons).status is Status.OK
    assert sensing.check_display(lambda: display).found == "640×360 pixels for each eye"
    assert sensing.check_audio(lambda: True, lambda: sound).status is Status.OK
    with pytest.raises(SensorError):
        buttons.pressed()
    assert sensing.check_buttons(None).status is Status.WARNING
    assert sensing.check_audio(lambda: True, None).status is Status.WARNING
    assert sensing.check_audio(lambda: False, lambda: FakeOutput()).status is Status.FAILED


# --------------------------------------------------------------------------------------------- calibration
def again(part: str) -> str:
    return f"run `vbr calibrate {part} --camera oak`"


@pytest.mark.parametrize(
    ("pitch_deg", "age_days", "status"),
    [(15.0, 1.0, Status.OK), (23.0, 1.0, Status.FAILED), (7.0, 1.0, Status.FAILED), (15.0, 400.0, Status.WARNING)],
)
def test_the_calibration_is_compared_with_the_floor(pitch_deg: float, age_days: float, status: Status) -> None:
    seen = sensing.Seen()
    examined(seen, pitch_deg=pitch_deg)
    finding = sensing.check_calibration(Calibration(FLOOR), 0.0, age_days * 86_400.0, seen, Settings(), again)
    assert finding.status is status, finding
    assert (status is Status.FAILED) == ("vbr calibrate floor" in finding.advice and "8°" in finding.found)


def test_no_calibration_no_floor_and_no_camera_are_told_apart() -> None:
    seen = sensing.Seen()

    def checked(calibration: Calibration) -> Finding:
        return sensing.check_calibration(calibration, 0.0, 1.0, seen, Settings(), again)

    assert "vbr calibrate floor" in checked(Calibration()).advice
    assert "compared with nothing" in checked(Calibration(FLOOR)).found
    examined(seen, spoil=lambda frame: replace(frame, depth_m=np.ones_like(frame.depth_m)))
    assert "no floor" in checked(Calibration(FLOOR)).found


# ------------------------------------------------------------------------------------------------- machine
@pytest.mark.parametrize(
    ("free", "status"), [(10 << 30, Status.OK), (500 << 20, Status.WARNING), (50 << 20, Status.FAILED)]
)
def test_the_disk_is_written_and_measured(tmp_path: Path, free: int, status: Status) -> None:
    assert machine.check_disk(tmp_path / "state", lambda folder: free).status is status
    assert list((tmp_path / "state").iterdir()) == []


def test_a_folder_that_cannot_be_written_is_failed(tmp_path: Path) -> None:
    (tmp_path / "state").write_text("a file")
    (checked,) = made([Check("disk", "", lambda: machine.check_disk(tmp_path / "state"))])
    assert checked.finding.status is Status.FAILED
    assert "--state" in checked.finding.advice


NOW_S = 1_800_000_000.0


@pytest.mark.parametrize(
    ("leap_s", "newest_s", "synchronised", "status", "word"),
    [
        (0.0, NOW_S - 5.0, True, Status.OK, "synchronised"),
        (0.0, NOW_S - 5.0, False, Status.WARNING, "not synchronised"),
        (0.0, 0.0, None, Status.WARNING, "not known"),
        (30.0, 0.0, True, Status.WARNING, "leapt by +30.0 s"),
        (0.0, NOW_S + 3600.0, True, Status.FAILED, "earlier than what was noted"),
        (-NOW_S, 0.0, True, Status.FAILED, "earlier"),
    ],
)
def test_a_clock_is_believed_only_with_reason(
    leap_s: float, newest_s: float, synchronised: bool | None, status: Status, word: str
) -> None:
    walls = iter([NOW_S, NOW_S + 10.0 + leap_s])
    steadies = iter([100.0, 110.0])
    watch = machine.ClockWatch(lambda: next(walls), lambda: next(steadies))
    finding = watch.check(newest_s, lambda: synchronised)
    assert (finding.status, word in finding.found) == (status, True), finding


def test_memory_load_and_heat(tmp_path: Path) -> None:
    meminfo, zone = tmp_path / "meminfo", tmp_path / "thermal_zone0"
    zone.mkdir()

    def status(free_mib: int, degrees_c: float, load: float = 0.1) -> Status:
        meminfo.write_text(f"MemTotal: 1 kB\nMemAvailable: {free_mib * 1024} kB\n")
        (zone / "temp").write_text(f"{round(1000 * degrees_c)}\n")
        return machine.check_system(meminfo, tmp_path, load).status

    assert status(4000, 50.0) is Status.OK
    assert status(300, 50.0) is status(4000, 80.0) is status(4000, 50.0, 99.0) is Status.WARNING
    assert status(100, 50.0) is status(4000, 95.0) is Status.FAILED
    assert machine.check_system(tmp_path / "none", tmp_path / "none", 0.1).status is Status.WARNING


def test_each_want_of_the_machine_has_its_own_advice(tmp_path: Path) -> None:
    meminfo, zone = tmp_path / "meminfo", tmp_path / "thermal_zone0"
    zone.mkdir()

    def advice(free_mib: int, degrees_c: float, load: float) -> str:
        meminfo.write_text(f"MemAvailable: {free_mib * 1024} kB\n")
        (zone / "temp").write_text(f"{round(1000 * degrees_c)}\n")
        return machine.check_system(meminfo, tmp_path, load).advice

    wants = {"memory": (300, 50.0, 0.1), "processor": (4000, 50.0, 99.0), "cool down": (4000, 80.0, 0.1)}
    for want, how in wants.items():
        assert [other for other in wants if other in advice(*how)] == [want]
    assert all(want in advice(300, 80.0, 99.0) for want in wants)
    for command in re.findall(r"`(ps .*?)`", advice(300, 50.0, 99.0)):
        assert subprocess.run(["sh", "-c", command], capture_output=True, check=True).stdout


def test_the_link_is_tried_on_a_real_socket_without_disturbing_anybody() -> None:
    console = Console()
    console.start()
    url = f"ws://127.0.0.1:{console.port}"
    try:
        joined = machine.check_link(url, lambda: TOKEN, lambda: None, "make another")
        assert joined.status is Status.OK
        assert "token accepted" in joined.found
        assert console.of_type(object) == []
        refused = machine.check_link(url, lambda: "another", lambda: None, "make another")
        assert (refused.status, "refuses the token" in refused.found) == (Status.FAILED, True)
        assert refused.advice == "make another"
    finally:
        console.close()
    assert machine.check_link(url, lambda: TOKEN, lambda: None, "make another").status is Status.WARNING
    assert machine.check_link(None, lambda: TOKEN, lambda: None, "make another").status is Status.OK


def test_a_console_whose_clock_is_off_is_a_warning() -> None:
    assert machine._reached(0.1, machine._offset_s("Thu, 01 Jan 2026 00:00:30 GMT", 1_767_225_600.0)).status is (
        Status.WARNING
    )
    assert (
        machine._reached(0.1, machine._offset_s("Thu, 01 Jan 2026 00:00:01 GMT", 1_767_225_600.0)).status is Status.OK
    )
    assert machine._offset_s("nonsense", 0.0) is None


# ------------------------------------------------------------------------------------------------- command
def test_the_command_looks_at_everything_and_fails_where_something_does(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], small_site: Site
) -> None:
    save_site(small_site, tmp_path / "site")
    CalibrationStore(tmp_path / "state").store(Calibration(FLOOR), 1.0)
    common = ["doctor", "--state", str(tmp_path / "state"), "--simulated", "--json"]
    code = main([*common, "--site", str(tmp_path / "site")])
    findings = {entry["check"]: entry for entry in json.loads(capsys.readouterr().out)}
    assert tuple(findings) == NAMES
    # A machine on which a picture is late for want of a processor says so.
    assert "pictures a second" in findings["camera"]["found"]
    allowed = {"camera", "clock", "system", "audio" if not Speech().available else ""}
    assert {name for name, entry in findings.items() if entry["status"] == "failed"} <= allowed
    assert code == int(any(entry["status"] == "failed" for entry in findings.values()))
    assert "the floor agrees" in findings["calibration"]["found"]
    assert all(entry["advice"] for entry in findings.values() if entry["status"] != "ok")


def test_whatever_is_broken_the_rest_is_looked_at(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    state = tmp_path / "state"
    state.mkdir()
    (state / "calibration.json").write_text("broken")
    code = main(
        [
            "doctor", "--state", str(state), "--site", str(tmp_path / "gone"), "--recording", str(tmp_path / "gone"),
            "--sonar", "serial:/dev/ttyUSB99", "--buttons", "evdev:/dev/input/event99", "--display", "fb:/dev/fb9",
            "--console", "ws://127.0.0.1:9", "--token-file", str(tmp_path / "none"),
        ]
    )  # fmt: skip
    out = capsys.readouterr().out
    assert code == 1
    lines = [line.split() for line in out.splitlines() if not line.startswith(" ")]
    assert tuple(line[1] for line in lines) == NAMES
    broken = {line[1] for line in lines if line[0] == "failed"}
    assert {"camera", "sonar", "buttons", "display", "calibration", "map", "link"} <= broken
    assert out.count("→") >= 7


@pytest.mark.parametrize(
    "camera", [["--simulated"], ["--recording", "a walk's folder"], ["--camera", "realsense:FILE 1.db3"], []]
)
def test_what_is_advised_can_be_typed_as_it_stands(camera: list[str], tmp_path: Path) -> None:
    arguments = _parser().parse_args(["doctor", "--state", str(tmp_path / "its folder"), *camera])
    patient = _patient(arguments)
    advice = " ".join([*(_calibrating(patient)(part) for part in ("floor", "intrinsics")), _new_token("glasses-2")])
    commands = re.findall(r"`vbr (.*?)`", advice)
    assert len(commands) == (3 if camera else 1)
    for command in commands:
        typed = _parser().parse_args(shlex.split(command))
        if "calibrate" in command:
            assert typed.state == tmp_path / "its folder"
            assert (typed.simulated, typed.recording, typed.camera) == (
                arguments.simulated, arguments.recording, arguments.camera
            )  # fmt: skip


def test_the_page_of_the_docs_is_up_to_date(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["doctor", "--markdown"]) == 0
    page = Path(__file__).resolve().parent.parent / "docs" / "doctor.md"
    assert capsys.readouterr().out == page.read_text(encoding="utf-8")
    assert os.linesep == "\n"

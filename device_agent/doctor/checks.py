"""The checks of one device, in order. The page ``docs/doctor.md`` is made from this list."""

from __future__ import annotations

import contextlib
import shlex
import ssl
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

from device_agent.adapters.clocks import SystemClock
from device_agent.calibrate_command import DEFAULT_BOARD
from device_agent.calibration_store import CalibrationStore
from device_agent.device_options import DeviceOptions
from device_agent.device_store import DeviceStore
from device_agent.doctor import machine, sensing
from device_agent.doctor.findings import Check, Finding, failed
from device_agent.ports import Clock, CueOutput, DepthCamera, DisplayOutput, Sonar, WideCamera
from device_agent.recording.options import RecordingOptions
from device_agent.sensors import (
    open_buttons,
    open_depth_camera,
    open_display,
    open_fisheye,
    open_sonar,
    simulated_hardware,
)
from device_agent.simulation.pace import PATIENCE_S, PacedClock
from navcore.calibration import Calibration
from navcore.espeak import Speech
from navcore.machine_clock import clock_is_synchronised
from navcore.settings import Settings


@dataclass(frozen=True, slots=True)
class Link:
    """How to reach the console; read only when its check runs, for what is wrong with it is a finding."""

    url: Callable[[], str | None]
    token: Callable[[], str]
    tls: Callable[[], ssl.SSLContext | None]


@dataclass(frozen=True, slots=True)
class Patient:
    """Whom the doctor looks at."""

    options: DeviceOptions
    site: Path | None
    has_camera: bool
    link: Link


def checks_of(patient: Patient) -> list[Check]:
    """Return the checks of a device; nothing is opened before a check runs."""
    options, clock, seen = patient.options, SystemClock(), sensing.Seen()
    settings = DeviceStore(options.state, patient.site or Path()).load_settings()[0].changed(options.changes)
    clock_watch = machine.ClockWatch()
    simulated = patient.has_camera and options.simulated
    camera, sonar = _simulated(options) if simulated else _real(options, settings, clock)
    buttons, screen = options.buttons, options.screen
    return [
        Check(
            "camera",
            "Opens the depth camera; fails below 5 pictures a second, where they are older than guidance may be, or"
            " where less than `obstacle.min_valid_fraction` of them has a depth; warns of darkness.",
            lambda: sensing.check_camera(camera, clock, settings, seen) if patient.has_camera else _no_camera(),
            limit_s=30.0,
        ),
        Check(
            "fisheye",
            "Opens the fisheye camera, where one is named, with its calibration, and reads five pictures.",
            lambda: sensing.check_fisheye(_fisheye(options, clock), clock),
        ),
        Check(
            "sonar",
            "Opens the rangefinder and listens for two seconds; fails where nothing fresh comes, warns of gaps, and"
            " where none is named.",
            lambda: sensing.check_sonar(sonar, clock),
        ),
        Check(
            "buttons",
            "Opens the buttons; warns where none are named.",
            lambda: sensing.check_buttons(None if buttons is None else lambda: open_buttons(options, clock)),
        ),
        Check(
            "display",
            "Opens the glasses' display, where one is named.",
            lambda: sensing.check_display(None if screen is None else lambda: _display(options)),
        ),
        Check(
            "audio",
            "Lets espeak-ng speak a word, and opens the sound device; fails without a voice, warns without `--sound`.",
            lambda: sensing.check_audio(_speaks, _sound if options.sound else None),
        ),
        Check(
            "calibration",
            "Reads the stored calibration, and compares it with the floor that the camera has just seen; fails where it"
            " is damaged or the floor disagrees, warns where there is none, or it is older than half a year.",
            lambda: _calibration(options.state, seen, settings, _calibrating(patient)),
        ),
        Check(
            "map",
            "Reads the whole site with its checksums; warns where no place has a name.",
            lambda: machine.check_map(patient.site),
            limit_s=60.0,
        ),
        Check(
            "disk",
            "Writes to the device's own folder; fails where that cannot be done, or below 100 MiB of free space; warns"
            " below 1 GiB, or where stored settings or events are damaged.",
            lambda: machine.check_disk(options.state),
        ),
        Check(
            "recordings",
            "Looks at the recordings, where they are made; warns where the disk gets full and what goes next is what"
            " the console does not have.",
            lambda: machine.check_recordings(_recorded(options)),
        ),
        Check(
            "clock",
            "Fails where the time of day is earlier than one that this device has noted; warns where it is not"
            " synchronised, or leapt while the other checks ran.",
            lambda: clock_watch.check(_newest_noted_s(options.state), clock_is_synchronised),
        ),
        Check(
            "link",
            "Joins the console, where one is named, and leaves at once; fails where the token is refused, warns where"
            " nobody answers or the clocks are more than 5 s apart (guidance needs no console).",
            lambda: machine.check_link(
                patient.link.url(), patient.link.token, patient.link.tls, _new_token(options.device_id)
            ),
        ),
        Check(
            "system",
            "Fails below 150 MiB of free memory or above 90 °C; warns below 500 MiB, above 75 °C, or of a load above"
            " one and a half times the cores.",
            machine.check_system,
        ),
    ]


def _no_camera() -> Finding:
    return failed("none is named", "add `--camera oak` or `--camera realsense`, as for `vbr device`")


def _calibrating(patient: Patient) -> Callable[[str], str]:
    """Return what says how a part is measured again: a command as it is to be typed."""
    options, state = patient.options, shlex.quote(str(patient.options.state))
    if not patient.has_camera:
        return lambda part: "name the camera (`--camera oak` or `--camera realsense`) and run this again"
    if options.recording is not None:
        source = f"--recording {shlex.quote(str(options.recording))}"
    else:
        source = "--simulated" if options.camera is None else f"--camera {shlex.quote(str(options.camera))}"
    board = {"intrinsics": f" --board {DEFAULT_BOARD}"}
    return lambda part: f"run `vbr calibrate {part} {source}{board.get(part, '')} --state {state}`"


def _new_token(device_id: str) -> str:
    return (
        f"run `vbr console --site SITE token {device_id}` on the console's machine, SITE being its site's folder, and"
        " put what it prints into the file of --token-file"
    )


def _simulated(options: DeviceOptions) -> tuple[Callable[[], DepthCamera], Callable[[], Sonar] | None]:
    """Return what opens camera and rangefinder of one simulated walker, in real time."""
    clock = PacedClock(SystemClock(), PATIENCE_S)
    hardware = cache(lambda: simulated_hardware(options, clock))
    return lambda: hardware()[0], lambda: hardware()[1]


def _real(
    options: DeviceOptions, settings: Settings, clock: Clock
) -> tuple[Callable[[], DepthCamera], Callable[[], Sonar] | None]:
    sonar = None if options.sonar is None else lambda: open_sonar(options, clock)
    return lambda: open_depth_camera(options, settings, clock), sonar


def _recorded(options: DeviceOptions) -> RecordingOptions | None:
    return None if options.record is None else replace(options.record, map_walks=options.map_walks)


def _fisheye(options: DeviceOptions, clock: Clock) -> Callable[[], WideCamera] | None:
    path = options.fisheye
    return None if path is None else lambda: open_fisheye(path, options, clock)


def _display(options: DeviceOptions) -> DisplayOutput:
    display = open_display(replace(options, overlay=None))
    assert display is not None, "a display is named"
    return display


def _speaks() -> bool:
    return len(Speech().samples("Ready.")) > 0


def _sound() -> CueOutput:
    from device_agent.adapters.sound_device import SoundDeviceOutput

    return SoundDeviceOutput(Speech())


def _calibration(state: Path, seen: sensing.Seen, settings: Settings, again: Callable[[str], str]) -> Finding:
    stored = CalibrationStore(state).load()
    calibration, stored_s = (Calibration(), 0.0) if stored is None else (stored.calibration, stored.stored_s)
    return sensing.check_calibration(calibration, stored_s, time.time(), seen, settings, again)


def _newest_noted_s(state: Path) -> float:
    """Return the newest time that the device's own files tell of, seconds since 1970; 0 where there are none.

    The doctor's own traces are left out.
    """
    newest_s = 0.0
    for path in (*state.glob("*.json"), *state.glob("*.sqlite"), *state.glob("logs/*.jsonl")):
        with contextlib.suppress(OSError):
            newest_s = max(newest_s, path.stat().st_mtime)
    return newest_s

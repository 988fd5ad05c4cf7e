"""Checks of sensors and outputs; each is handed a function that opens the part: real, recorded, simulated or fake."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass, field

import numpy as np

from device_agent.doctor.findings import Finding, failed, ok, warning
from device_agent.ports import Buttons, Clock, CueOutput, DepthCamera, DisplayOutput, Sonar, WideCamera
from navcore.calibration import Calibration, FloorCalibration
from navcore.errors import SensorError
from navcore.obstacle.levelling import level_by_floor
from navcore.obstacle.mounting import floor_difference
from navcore.settings import Settings
from navcore.types import CameraIntrinsics, Frame, SonarState

_LOOKS_S = 2.0
_FIRST_WITHIN_S = 8.0
"""A camera may need some seconds to begin."""
_MIN_RATE_HZ, _USUAL_RATE_HZ = 5.0, 9.0
_MAX_AGE_S = 0.3
_MIN_GREY, _MAX_GREY = 8.0, 248.0
_LENS_TOLERANCE = 0.03
_OLD_AFTER_DAYS = 180.0
_MAX_KEPT = 5


@dataclass(slots=True)
class Seen:
    """What the camera's check has seen, for those that come after it."""

    frames: list[Frame] = field(default_factory=list)
    """Some, spread over the check."""
    intrinsics: CameraIntrinsics | None = None


def check_camera(open_camera: Callable[[], DepthCamera], clock: Clock, settings: Settings, seen: Seen) -> Finding:
    """Open the depth camera, and look at rate, age, share of valid depth and brightness for two seconds."""
    with closing(open_camera()) as camera:
        ages_s, stamps_s = _looked(camera, clock, seen)
    rate_hz = (len(stamps_s) - 1) / max(stamps_s[-1] - stamps_s[0], 1e-9)
    depth_share = float(np.mean([np.count_nonzero(each.depth_m > 0.0) / each.depth_m.size for each in seen.frames]))
    grey = float(np.mean([each.colour_rgb.mean() for each in seen.frames]))
    found = f"{rate_hz:.1f} pictures a second, {max(ages_s):.2f} s old, depth in {depth_share:.0%} of them"
    if rate_hz < _MIN_RATE_HZ:
        return failed(found, f"the loop needs {_MIN_RATE_HZ:g} a second: use a USB 3 socket, and end other programs")
    if max(ages_s) > settings.watchdog.guidance_timeout_s:
        return failed(found, "pictures so old stop guidance: end other programs, or lower the picture's size")
    if depth_share < settings.obstacle.min_valid_fraction:
        return failed(found, "clean the lenses, and look into a lit room, two metres or more from a wall")
    if not _MIN_GREY < grey < _MAX_GREY:
        return warning(
            f"{found}; the picture is {'dark' if grey <= _MIN_GREY else 'white'}", "uncover the lens, or light"
        )
    if rate_hz < _USUAL_RATE_HZ or max(ages_s) > _MAX_AGE_S:
        return warning(found, f"{_USUAL_RATE_HZ:g} a second and {_MAX_AGE_S:g} s are usual: end other programs")
    return ok(found)


def _looked(camera: DepthCamera, clock: Clock, seen: Seen) -> tuple[list[float], list[float]]:
    """Read for two seconds from the first frame on; return ages and stamps. Raises SensorError where none comes."""
    ages_s: list[float] = []
    stamps_s: list[float] = []
    begin_s, end_s = clock.now_s(), math.inf
    while clock.now_s() < end_s:
        try:
            frame = camera.read()
        except SensorError:
            if clock.now_s() - begin_s > _FIRST_WITHIN_S or stamps_s:
                raise
            continue
        if not stamps_s:
            end_s = clock.now_s() + _LOOKS_S
            seen.frames.clear()
        elif frame.stamp_s >= stamps_s[0] + len(seen.frames) * _LOOKS_S / _MAX_KEPT:
            seen.frames.append(frame)
        ages_s.append(clock.now_s() - frame.stamp_s)
        stamps_s.append(frame.stamp_s)
    seen.frames = seen.frames[:_MAX_KEPT] or [frame]
    seen.intrinsics = camera.intrinsics
    return ages_s, stamps_s


def check_fisheye(open_fisheye: Callable[[], WideCamera] | None, clock: Clock) -> Finding:
    """Open the fisheye camera and read some pictures."""
    if open_fisheye is None:
        return ok("none is named; the depth camera alone locates")
    with closing(open_fisheye()) as camera:
        pictures = [camera.read() for _ in range(5)]
    age_s = clock.now_s() - pictures[-1].stamp_s
    found = f"{pictures[-1].grey.shape[1]}×{pictures[-1].grey.shape[0]} pixels, {age_s:.2f} s old"
    if age_s > _MAX_AGE_S:
        return warning(found, "its pictures are too old to be paired with the depth camera's: use another USB socket")
    return ok(found)


def check_sonar(open_sonar: Callable[[], Sonar] | None, clock: Clock) -> Finding:
    """Open the rangefinder and look for a second at what it says."""
    if open_sonar is None:
        return warning(
            "none is named: glass is not heard",
            "add `--sonar serial:/dev/ttyUSB0`; `ls /dev/serial/by-id/` lists what is plugged in",
        )
    counts = dict.fromkeys(SonarState, 0)
    errors: list[SensorError] = []
    with closing(open_sonar()) as sonar:
        begin_s = clock.now_s()
        # A line has something to say only some time after it was opened.
        while clock.now_s() < begin_s + _LOOKS_S:
            clock.sleep_until(clock.now_s() + 0.05)
            try:
                counts[sonar.read().state] += 1
            except SensorError as error:
                errors.append(error)
    alive = counts[SonarState.OK] + counts[SonarState.NO_ECHO]
    total = sum(counts.values()) + len(errors)
    found = f"{counts[SonarState.OK]} echoes, {counts[SonarState.NO_ECHO]} times nothing in range, of {total} looks"
    if alive == 0:
        if errors:
            raise errors[-1]
        return failed(found, "nothing fresh comes: check its cable and its program (docs/hardware.md)")
    if alive < 0.7 * total:
        return warning(found, "it is silent at times: check its cable")
    return ok(found)


def check_buttons(open_buttons: Callable[[], Buttons] | None) -> Finding:
    """Open the buttons and ask them once."""
    if open_buttons is None:
        return warning(
            "none are named: the walker can neither begin nor stop guidance",
            "add `--buttons evdev:/dev/input/event3`; `cat /proc/bus/input/devices` lists what there is",
        )
    with closing(open_buttons()) as buttons:
        buttons.pressed()
    return ok("they are there")


def check_display(open_display: Callable[[], DisplayOutput] | None) -> Finding:
    """Open the display."""
    if open_display is None:
        return ok("none is named; guidance is heard")
    with closing(open_display()) as display:
        geometry = display.geometry
    return ok(f"{geometry.width_px}×{geometry.height_px} pixels for each eye")


def check_audio(speaks: Callable[[], bool], open_sound: Callable[[], CueOutput] | None) -> Finding:
    """Let espeak-ng speak a word, and open the sound device."""
    if not speaks():
        return failed("espeak-ng says nothing", "run `sudo apt install espeak-ng`: without it only tones are heard")
    if open_sound is None:
        return warning("espeak-ng speaks, but no sound device is named", "add `--sound`, else nothing is heard")
    with closing(open_sound()):
        return ok("espeak-ng speaks, and there is a sound device")


# --------------------------------------------------------------------------------------------- calibration
def check_calibration(
    calibration: Calibration,
    stored_s: float,
    now_s: float,
    seen: Seen,
    settings: Settings,
    again: Callable[[str], str],
) -> Finding:
    """Compare what is stored with what the camera saw; an empty calibration is told as such.

    ``again`` says how a part is measured again, with this device's camera.
    """
    floor = calibration.floor
    if floor is None:
        return warning("none: whether the camera has moved is not noticed", again("floor"))
    age_days = (now_s - stored_s) / 86_400.0
    found = f"{age_days:.0f} days old"
    other = _other_lens(calibration, seen.intrinsics)
    if other:
        return warning(f"{found}; {other}", again("intrinsics"))
    if not seen.frames or seen.intrinsics is None:
        return warning(f"{found}; it was compared with nothing", "see to the camera first")
    agrees = _agrees_with_floor(floor, seen.frames, seen.intrinsics, settings)
    if agrees is None:
        return warning(f"{found}; no floor is in view", "wear the glasses, look along free floor, and run this again")
    words, is_close = agrees
    if not is_close:
        return failed(
            f"{found}; the floor disagrees: the camera is {words}",
            f"wear the glasses upright and look straight ahead; if that does not help, {again('floor')}",
        )
    if age_days > _OLD_AFTER_DAYS:
        return warning(f"{found}; the floor agrees", f"calibrate again to be sure: {again('floor')}")
    return ok(f"{found}; the floor agrees")


def _other_lens(calibration: Calibration, intrinsics: CameraIntrinsics | None) -> str:
    """Say that the camera gives another lens than was measured; nothing where it does not."""
    if calibration.pinhole is None or intrinsics is None:
        return ""
    measured = calibration.pinhole.intrinsics
    scale = intrinsics.width_px / measured.width_px
    off = abs(intrinsics.fx_px / (measured.fx_px * scale) - 1.0)
    return "" if off <= _LENS_TOLERANCE else f"its lens and the camera's differ by {off:.0%} in focal length"


def _agrees_with_floor(
    floor: FloorCalibration, frames: list[Frame], intrinsics: CameraIntrinsics, settings: Settings
) -> tuple[str, bool] | None:
    """Return how the floor differs in the middle one of the frames that show it, and whether that is close enough."""
    differences = []
    for frame in frames:
        levelling = level_by_floor(frame.depth_m, intrinsics)
        difference = (
            None if levelling is None else floor_difference(levelling, floor, floor.up_by_gravity(frame.gravity))
        )
        if difference is not None:
            differences.append(difference)
    if not differences:
        return None
    middle = sorted(differences, key=lambda each: each.posture_rad)[len(differences) // 2]
    tolerance_rad = math.radians(settings.calibration.tilt_tolerance_deg)
    tilt_rad = middle.posture_rad if middle.tilt_rad is None else max(middle.tilt_rad, middle.posture_rad)
    close = tilt_rad <= tolerance_rad and abs(middle.height_m) <= settings.calibration.height_tolerance_m
    return middle.words(), close

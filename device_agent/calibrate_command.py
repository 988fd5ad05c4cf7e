"""``vbr calibrate``: measure how the camera is mounted, its lenses, and the rangefinder; look at what is stored."""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from device_agent.sensor_names import named, names_of
from device_agent.state_folder import add_state_options, state_folder_of
from navcore.errors import InputError

if TYPE_CHECKING:
    from device_agent.calibration_sources import FrameSource, NamedPicture
    from device_agent.calibration_store import CalibrationStore, StoredCalibration
    from navcore.calibrating.boards import BoardView
    from navcore.calibrating.lenses import LensReport
    from navcore.calibration import Calibration, FisheyeCalibration, PinholeCalibration

T = TypeVar("T")
RESTART = (
    "It counts once the device is started anew: run `sudo systemctl restart vbr-device`, or end `vbr device` and start"
    " it again."
)
"""What is calibrated is read at the start alone: the lenses belong to cameras that are open."""
_FLOOR_FRAMES, _SONAR_FRAMES, _BOARD_VIEWS = 30, 300, 20
_MAX_PICTURES = 3000
"""Live pictures that are looked through for the board, at most: some minutes."""
_ANOTHER_VIEW_SHARE = 0.06
"""A live picture counts once the board has moved by this share of the picture's width."""
EXIT_DAMAGED = 1
DEFAULT_BOARD = "charuco:8x6:30mm:22mm"
_BOARD_HELP = "checkerboard:10x7:25mm or charuco:8x6:35mm:26mm: squares, side of a square, side of a marker"


def add_commands(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add ``vbr calibrate`` with its actions."""
    calibrate = subparsers.add_parser("calibrate", help="measure how the sensors are mounted, and their lenses")
    actions = calibrate.add_subparsers(metavar="ACTION", required=True)
    floor = actions.add_parser(
        "floor",
        help="pitch, roll and height of the depth camera, from the floor",
        description="Wear the glasses, stand upright with two metres of free floor before you, look straight ahead, and"
        " keep still.",
    )
    _add_sources(floor)
    floor.add_argument(
        "--frames", type=_floor_frames, default=_FLOOR_FRAMES, help="frames to look at (default: %(default)s)"
    )
    floor.set_defaults(run=_floor)
    sonar = actions.add_parser(
        "sonar",
        help="where the rangefinder looks, and what its distances are off by",
        description="Face a bare, flat wall. Walk slowly from 1 m to 3 m before it, and turn slowly by 20° to the left"
        " and to the right.",
    )
    _add_sources(sonar)
    sonar.add_argument("--sonar", metavar="NAME", help=f"with --camera, the rangefinder: {names_of('sonar')}")
    sonar.add_argument(
        "--frames", type=_sonar_frames, default=_SONAR_FRAMES, help="frames to look at (default: %(default)s)"
    )
    sonar.set_defaults(run=_sonar)
    _add_lens(actions, "intrinsics", "the depth camera's colour lens, with a board", _intrinsics)
    fisheye = _add_lens(actions, "fisheye", "the fisheye camera's lens, with a board", _fisheye)
    fisheye.add_argument("--fisheye", metavar="DEVICE", help="the fisheye camera, /dev/video2 or a video file")
    fisheye.add_argument("--size", type=_size, default=(640, 480), metavar="WxH", help="of its pictures (640x480)")
    fisheye.add_argument("--field-deg", type=float, metavar="DEG", help="the whole field of view, from the data sheet")
    fisheye.add_argument("--mounting", type=Path, metavar="FILE", help="a fisheye_calib.txt that says where it sits")
    _add_others(actions)


def _add_others(actions: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    board = actions.add_parser("board", help="draw a board to print (PDF or PNG, in its true size)")
    board.add_argument("target", type=Path, metavar="OUT", help="a file that ends in .pdf or .png")
    board.add_argument("--board", default=DEFAULT_BOARD, metavar="BOARD", help=_BOARD_HELP)
    board.set_defaults(run=_board)
    show = actions.add_parser("show", help="what is stored, and what was before")
    add_state_options(show)
    show.add_argument("--json", action="store_true", help="print it as JSON")
    show.set_defaults(run=_show)
    restore = actions.add_parser("restore", help="go back to an earlier calibration")
    restore.add_argument("revision", type=int, metavar="NUMBER", help="as `vbr calibrate show` lists it")
    add_state_options(restore)
    restore.set_defaults(run=_restore)


def _add_lens(
    actions: argparse._SubParsersAction[argparse.ArgumentParser], name: str, what: str, run: Any
) -> argparse.ArgumentParser:
    parser = actions.add_parser(
        name,
        help=what,
        description="Take pictures of the board in every part of the picture, tilted by 20 to 40° this way and that, at"
        " several distances; `vbr calibrate board` draws one to print.",
    )
    _add_sources(parser)
    parser.add_argument("--pictures", type=Path, metavar="DIR", help="a folder with pictures of the board")
    parser.add_argument("--board", required=True, metavar="BOARD", help=_BOARD_HELP)
    parser.add_argument("--views", type=_board_views, default=_BOARD_VIEWS, help="live: pictures to use (%(default)s)")
    parser.set_defaults(run=run)
    return parser


def _add_sources(parser: argparse.ArgumentParser) -> None:
    sources = parser.add_argument_group("sensors")
    sources.add_argument("--simulated", action="store_true", help="the simulator's")
    sources.add_argument("--recording", type=Path, metavar="PATH", help="a recording's folder, or a file of a walk")
    sources.add_argument("--camera", metavar="NAME", help=f"the depth camera: {names_of('camera')}")
    add_state_options(parser)
    parser.add_argument("--dry-run", action="store_true", help="measure, and store nothing")
    parser.add_argument("--json", action="store_true", help="print the figures as JSON")


def _count(text: str, least: int) -> int:
    if not text.isdecimal() or not least <= int(text) <= 100_000:
        raise argparse.ArgumentTypeError(f"{text!r} will not do: give a whole number from {least} to 100000")
    return int(text)


def _floor_frames(text: str) -> int:
    from navcore.calibrating.floor import MIN_FRAMES

    return _count(text, MIN_FRAMES)


def _sonar_frames(text: str) -> int:
    from navcore.calibrating.sonar import MIN_READINGS

    return _count(text, MIN_READINGS)


def _board_views(text: str) -> int:
    from navcore.calibrating.lenses import MIN_VIEWS

    return _count(text, MIN_VIEWS)


def _size(text: str) -> tuple[int, int]:
    width, cross, height = text.replace("×", "x").partition("x")
    if not cross or not (width.isdecimal() and height.isdecimal()):
        raise argparse.ArgumentTypeError(f"{text!r} is no picture size: write it as 640x480")
    if not (64 <= int(width) <= 10_000 and 48 <= int(height) <= 10_000):
        raise argparse.ArgumentTypeError(f"{text!r} is no picture size: give 64 to 10000 pixels a side")
    return int(width), int(height)


# ------------------------------------------------------------------------------------------------ measuring
def _floor(arguments: argparse.Namespace) -> int:
    from navcore.calibrating.floor import calibrated_floor

    with ExitStack() as stack:
        source = _source(arguments, stack)
        floor = calibrated_floor(islice(source.frames, arguments.frames), source.intrinsics, time.time())
    return _keep(arguments, "floor", floor, _floor_lines(floor))


def _sonar(arguments: argparse.Namespace) -> int:
    from navcore.calibrating.sonar import measured_sonar
    from navcore.settings import Settings

    half_field_rad = math.radians(Settings().gate.half_field_deg)
    with ExitStack() as stack:
        source = _source(arguments, stack)
        sensed = islice(source.sensed, arguments.frames)
        sonar = measured_sonar(sensed, source.intrinsics, half_field_rad, time.time())
    return _keep(arguments, "sonar", sonar, _sonar_lines(sonar))


def _intrinsics(arguments: argparse.Namespace) -> int:
    from device_agent.calibration_sources import colour_pictures, pictures_in
    from navcore.calibrating.lenses import measured_pinhole

    with ExitStack() as stack:
        if arguments.pictures is not None:
            pictures = pictures_in(arguments.pictures)
        else:
            pictures = colour_pictures(_source(arguments, stack).frames)
        views, size_px = _views(arguments, pictures)
    report = measured_pinhole(views, *size_px, time.time())
    return _keep(arguments, "pinhole", report.calibration, [*_pinhole_lines(report.calibration), *_view_lines(report)])


def _fisheye(arguments: argparse.Namespace) -> int:
    from device_agent.calibration_sources import fisheye_pictures, live_fisheye, pictures_in
    from navcore.calibrating.lenses import measured_fisheye
    from navcore.fisheye_recording import read_fisheye_camera

    half_rad = None if arguments.field_deg is None else math.radians(arguments.field_deg / 2.0)
    mounted = None if arguments.mounting is None else read_fisheye_camera(arguments.mounting).fisheye_from_camera
    with ExitStack() as stack:
        if arguments.pictures is not None:
            pictures = pictures_in(arguments.pictures)
        elif arguments.fisheye is not None:
            pictures = live_fisheye(arguments.fisheye, arguments.size, stack)
        else:
            pictures = fisheye_pictures(_source(arguments, stack).frames)
        views, size_px = _views(arguments, pictures)
    report = measured_fisheye(views, *size_px, time.time(), half_rad)
    fisheye = report.calibration
    if mounted is not None:
        (x, y, z), (qx, qy, qz, qw) = mounted.translation.tolist(), mounted.quat_xyzw.tolist()
        fisheye = replace(fisheye, fisheye_from_camera=(x, y, z, qx, qy, qz, qw))
    return _keep(arguments, "fisheye", fisheye, [*_fisheye_lines(fisheye), *_view_lines(report)])


def _source(arguments: argparse.Namespace, stack: ExitStack) -> FrameSource:
    from device_agent.calibration_sources import live, recorded, simulated_standing, simulated_wall

    given = [arguments.simulated, arguments.recording is not None, arguments.camera is not None]
    if sum(given) != 1:
        raise InputError("Name one source of frames: --simulated, --recording PATH, or --camera NAME.")
    if arguments.recording is not None:
        return recorded(arguments.recording)
    camera, sonar = named("camera", arguments.camera), named("sonar", getattr(arguments, "sonar", None))
    if camera is not None:
        return live(camera, sonar, stack)
    return simulated_wall() if arguments.run is _sonar else simulated_standing()


def _views(arguments: argparse.Namespace, pictures: Iterator[NamedPicture]) -> tuple[list[BoardView], tuple[int, int]]:
    """Find the board in pictures; of live ones only those in which it has moved count."""
    from navcore.calibrating.boards import board_named, find_board, moved_px

    board = board_named(arguments.board)
    is_live = arguments.pictures is None
    views: list[BoardView] = []
    without: list[str] = []
    size_px: tuple[int, int] | None = None
    for name, grey in islice(pictures, _MAX_PICTURES):
        found_px = (grey.shape[1], grey.shape[0])
        if size_px is not None and found_px != size_px:
            raise InputError(f"{name} is {found_px[0]}×{found_px[1]} pixels, unlike the others: use one camera's.")
        size_px = found_px
        view = find_board(board, grey, name)
        if view is None:
            without.append(name)
        elif not is_live or all(moved_px(view, other) > _ANOTHER_VIEW_SHARE * size_px[0] for other in views):
            views.append(view)
            if is_live and len(views) >= arguments.views:
                break
    if size_px is None:
        raise InputError("There was no picture to look for the board in: see that the source delivers some.")
    if not is_live and without:
        sys.stderr.write(f"No board was found in {', '.join(without[:10])}: take these again.\n")
    return views, size_px


# -------------------------------------------------------------------------------------------- stored, and shown
def _store(arguments: argparse.Namespace) -> CalibrationStore:
    from device_agent.calibration_store import CalibrationStore

    return CalibrationStore(state_folder_of(arguments))


def _keep(arguments: argparse.Namespace, part: str, value: Any, lines: list[str]) -> int:
    """Store a measured part beside the others, and tell of it."""
    from navcore.calibration import Calibration

    revision: int | None = None
    store = _store(arguments)
    if not arguments.dry_run:
        stored, error = store.load_or_kept()
        lines = [*lines, *_replaced(stored, error)]
        calibration = Calibration() if stored is None else stored.calibration
        # A part is a value of the class that its field names: the fields are those of Calibration.
        revision = store.store(replace(calibration, **{part: value}), time.time()).revision
    if arguments.json:
        _print_json({"revision": revision, "part": part, part: value, "said": lines})
        return 0
    kept = "Nothing was stored." if revision is None else f"Stored as revision {revision} in {store.path}. {RESTART}"
    sys.stdout.write("\n".join([*lines, kept]) + "\n")
    return 0


def _replaced(kept: StoredCalibration | None, error: InputError | None) -> list[str]:
    """Say what was put in the place of a damaged calibration."""
    if error is None:
        return []
    since = "nothing else is kept" if kept is None else f"its other parts are those of revision {kept.revision}"
    return [f"{str(error).rpartition(': ')[0]}. It has been replaced; {since}."]


def _show(arguments: argparse.Namespace) -> int:
    store = _store(arguments)
    try:
        stored = store.load()
    except InputError as error:
        return _show_kept(store, error, as_json=arguments.json)
    if arguments.json:
        _print_json({"stored": stored, "history": list(store.history())})
        return 0
    if stored is None:
        sys.stdout.write(f"Nothing has been calibrated yet ({store.path}): begin with `vbr calibrate floor`.\n")
        return 0
    sys.stdout.write("\n".join([f"Revision {stored.revision}, {_date(stored.stored_s)}, {store.path}"]) + "\n")
    sys.stdout.write("\n".join(calibration_lines(stored.calibration)) + "\n")
    for earlier in store.history():
        if earlier.revision != stored.revision:
            sys.stdout.write(f"  before: {_in_a_line(earlier)}\n")
    return 0


def _show_kept(store: CalibrationStore, error: InputError, *, as_json: bool) -> int:
    """Show what can still be read where what runs cannot."""
    kept = list(store.history())
    if as_json:
        _print_json({"stored": None, "damage": str(error), "history": kept})
    else:
        lines = [str(error), *(f"  kept: {_in_a_line(each)}" for each in kept)]
        sys.stdout.write("\n".join([*lines, "" if kept else "  No earlier one is kept.\n"]))
    return EXIT_DAMAGED


def _restore(arguments: argparse.Namespace) -> int:
    store = _store(arguments)
    stored = store.restore(arguments.revision, time.time())
    sys.stdout.write(
        f"Revision {arguments.revision} is the calibration again, as revision {stored.revision}. {RESTART}\n"
    )
    return 0


def _board(arguments: argparse.Namespace) -> int:
    from navcore.calibrating.boards import board_named, board_picture, pdf_bytes, png_bytes
    from navcore.site_files import write_whole

    writers = {".pdf": pdf_bytes, ".png": png_bytes}
    target: Path = arguments.target
    if target.suffix.lower() not in writers:
        raise InputError(f"{target} is no PDF and no PNG: name a file that ends in .pdf or .png.")
    board = board_named(arguments.board)
    try:
        write_whole(target, writers[target.suffix.lower()](board_picture(board)))
    except OSError as error:
        raise InputError(f"{target} cannot be written ({error.strerror}): name another file.") from error
    width_mm, height_mm = (1000.0 * side for side in board.size_m)
    sys.stdout.write(
        f"{target}: {board.words()}, {width_mm:.0f} × {height_mm:.0f} mm without its margin of 10 mm. Print it at 100"
        f" %, glue it to something flat, measure a square, and calibrate with --board {board.words()}.\n"
    )
    return 0


def _print_json(value: object) -> None:
    import msgspec

    json.dump(msgspec.to_builtins(value), sys.stdout, indent=1)
    sys.stdout.write("\n")


# ------------------------------------------------------------------------------------------------ in words
def calibration_lines(calibration: Calibration) -> list[str]:
    """Return a calibration in words, a line each; what has not been measured says so."""
    lines = []
    lines += ["floor: not measured"] if calibration.floor is None else _floor_lines(calibration.floor)
    lines += ["lens: not measured"] if calibration.pinhole is None else _pinhole_lines(calibration.pinhole)
    lines += ["fisheye: not measured"] if calibration.fisheye is None else _fisheye_lines(calibration.fisheye)
    lines += ["sonar: not measured"] if calibration.sonar is None else _sonar_lines(calibration.sonar)
    return lines


def _floor_lines(floor: Any) -> list[str]:
    degrees = math.degrees
    gravity = "" if floor.up_from_gravity_rad is None else (
        f"; the accelerometer is {degrees(math.hypot(*floor.up_from_gravity_rad)):.1f}° off the floor's normal"
    )  # fmt: skip
    return [
        f"floor: {floor.height_m:.3f} ± {floor.height_sigma_m:.3f} m high, pitched"
        f" {degrees(floor.pitch_rad):z.1f} ± {degrees(floor.pitch_sigma_rad):.1f}° down, leaning"
        f" {degrees(floor.roll_rad):+z.1f} ± {degrees(floor.roll_sigma_rad):.1f}° to the right, from"
        f" {floor.frame_count} frames, {_date(floor.made_s)}{gravity}"
    ]


def _pinhole_lines(pinhole: PinholeCalibration) -> list[str]:
    lens, quality = pinhole.intrinsics, pinhole.quality
    bent = " ".join(f"{each:+z.4f}" for each in lens.distortion)
    return [
        f"lens: {lens.width_px}×{lens.height_px}, fx {lens.fx_px:.2f} fy {lens.fy_px:.2f} cx {lens.cx_px:.2f} cy"
        f" {lens.cy_px:.2f} px, k1 k2 p1 p2 k3 {bent}",
        _quality_line(quality),
    ]


def _fisheye_lines(fisheye: FisheyeCalibration) -> list[str]:
    lens, mounted = (
        fisheye.intrinsics,
        "" if fisheye.fisheye_from_camera else "; mounting unknown (--mounting)",
    )
    bent = " ".join(f"{each:+z.4f}" for each in lens.distortion)
    return [
        f"fisheye: {lens.width_px}×{lens.height_px}, fx {lens.fx_px:.2f} fy {lens.fy_px:.2f} cx {lens.cx_px:.2f} cy"
        f" {lens.cy_px:.2f} px, k1 k2 k3 k4 {bent}; to {math.degrees(lens.max_angle_rad):.0f}° off its axis{mounted}",
        _quality_line(fisheye.quality),
    ]


def _quality_line(quality: Any) -> str:
    return (
        f"  off by {quality.rms_px:.3f} px (RMS), {quality.picture_count} pictures, corners in {quality.coverage:.0%}"
        f" of the picture, {_date(quality.made_s)}"
    )


def _view_lines(report: LensReport[T]) -> list[str]:
    worst = sorted(report.view_rms_px.items(), key=lambda item: -item[1])[:3]
    lines = ["  worst pictures used: " + ", ".join(f"{name} ({rms:.2f} px)" for name, rms in worst)]
    if report.left_out:
        lines.append(f"  left out, for they do not fit; take again: {', '.join(report.left_out)}")
    return lines


def _sonar_lines(sonar: Any) -> list[str]:
    side = "left" if sonar.bearing_rad >= 0 else "right"
    return [
        f"sonar: looks {abs(math.degrees(sonar.bearing_rad)):.1f} ± {math.degrees(sonar.bearing_sigma_rad):.1f}° to the"
        f" {side} of the camera, says {sonar.bias_m:+z.3f} ± {sonar.bias_sigma_m:.3f} m too much, scatters by"
        f" {sonar.residual_m:.3f} m, from {sonar.reading_count} readings, {_date(sonar.made_s)}"
    ]


def _in_a_line(stored: StoredCalibration) -> str:
    return f"revision {stored.revision}, {_date(stored.stored_s)}, {_parts(stored)}"


def _parts(stored: StoredCalibration) -> str:
    from dataclasses import fields

    names = [each.name for each in fields(stored.calibration) if getattr(stored.calibration, each.name) is not None]
    return ", ".join(names) or "nothing"


def _date(stamp_s: float) -> str:
    return time.strftime("%Y-%m-%d %H:%M UTC", time.gmtime(stamp_s))
